"""Free orbits in released parameters: closed forms, complex steps, and the problem of the system at each value."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.linalg import expm

from benchmarks.backbone import Backbone
from bvp.closures import EndsError
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.stability import half_map_of
from bvp.system import vibro_impact_nes

NES = ParametricSystem.of(vibro_impact_nes())


def chain(**parameters):
    """Three masses between springs, with a two-sided stop; all numbers are expressions."""
    return ParametricSystem.from_description(
        {
            "parameters": {"m": 1.3, "k": 0.7, "d": 1.1} | parameters,
            "system": {
                "mass": [["m", 0.0, 0.0], [0.0, "1 + m*k/5", 0.1], [0.0, 0.1, 0.6]],
                "stiffness": [["1 + k", "-k", 0.0], ["-k", "k + 1.4", -0.9], [0.0, -0.9, "0.9 + k**2"]],
                "stops": [{"c": [1.0, -0.5, 0.0], "lower": "-d", "upper": "d"}],
            },
        }
    )


def released(parametric, ends, sequence, names, keep, start, times, nodes=None):
    """The problem and an orbit of it, solved at the parameters' defaults for the quarter period of the guess."""
    plain = MultipointProblem(parametric.system(), ends, sequence)
    guess = plain.pack(plain.modes.from_state @ np.array(start), nodes, times)
    y = plain.solve(guess, quarter_period=plain.quarter_period(guess)).y
    h, alpha = plain.energy(y), plain.quarter_period(y)
    problem = ReleasedProblem(parametric, ends, sequence, names, [text.format(h=h, alpha=alpha) for text in keep], energy=h)
    return problem, problem.of_orbit(plain, y), h, alpha


def backbone_at(keep, parameters):
    """The in-phase backbone S13O00+ at alpha = 1.7, with an equation to keep."""
    return released(NES, ("origin", "stop+"), (), parameters, [keep], [0.0, 0.0, 1.4, 1.0], [1.7])


def exact(mu, sigma, h, near):
    """The quarter period of the closed form at an energy, in 30 digits."""
    with mp.workdps(30):
        form = Backbone(mu, sigma)
        return float(mp.findroot(lambda alpha: form.energy(alpha) - mp.mpf(h), mp.mpf(near)))


@pytest.mark.parametrize("name", ["mu", "sigma"])
def test_backbone_at_a_fixed_energy(name):
    """The closed form of the orbit with one impact a half period has the same quarter period and start at every value, to 1e-12."""
    problem, y, h, alpha = backbone_at("energy = {h!r}", (name,))
    values = np.linspace(0.1, 0.16, 13)
    for value in values:
        y[problem.place] = value
        y = problem.solve(y).y
        at = problem.parameters(y)
        found = problem.period(y) / 4.0
        wanted = exact(at["mu"], at["sigma"], h, found)
        assert found == pytest.approx(wanted, rel=1e-12)
        assert problem.states(y)[0, 2:] == pytest.approx([float(v) for v in Backbone(at["mu"], at["sigma"]).velocities(wanted)], rel=1e-11)


@pytest.mark.parametrize("name", ["mu", "sigma"])
def test_backbone_at_a_fixed_quarter_period(name):
    """The closed form gives the energy."""
    problem, y, _, alpha = backbone_at("quarter_period = {alpha!r}", (name,))
    for value in np.linspace(0.1, 0.16, 7):
        y[problem.place] = value
        y = problem.solve(y).y
        at = problem.parameters(y)
        plain, orbit = problem.orbit_problem(y)
        assert plain.quarter_period(orbit) == pytest.approx(alpha, rel=1e-15)
        assert plain.energy(orbit) == pytest.approx(float(Backbone(at["mu"], at["sigma"]).energy(alpha)), rel=1e-12)


def residual_twin(problem, y):
    """The equations by matrix exponentials, in complex numbers: an independent computation."""
    n, k = problem.degrees_of_freedom, problem.inner
    symbols = dict(problem.values)
    symbols.update(zip(problem.released, problem.released_values(y), strict=True))
    mass, stiffness, bounds = matrices(symbols)
    inverse = np.linalg.inv(mass)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, np.zeros((n, n))]])
    states, times = problem.states(y), problem.flight_times(y)
    out = []

    def struck(state, row, jump):
        push = inverse @ row / (row @ inverse @ row)
        return np.concatenate([state[:n], state[n:] - jump * push * (row @ state[n:])])

    def condition(end, state):
        kind = end[:4]
        if kind == "orig":
            return state[:n]
        if kind == "rest":
            return state[n:]
        stop = problem.system.stops[0]
        row = np.array(stop.gap)
        basis = np.linalg.qr(np.column_stack([row, np.eye(n)]))[0][:, 1:]
        return np.concatenate([[row @ state[:n] - bounds[end[-1]]], basis.T @ struck(state, row, 1.0)[n:]])

    hits = [problem.modes.contact_letters[c] for c in problem.contacts[: k + 1] if c >= 0]
    row = np.array(problem.system.stops[0].gap)
    for i in range(k):
        state = struck(expm(flow * times[i]) @ states[i], row, 2.0)
        out += [*(state - states[i + 1]), row @ states[i + 1, :n] - bounds[hits[i]]]
    end, first = expm(flow * times[k]) @ states[k], states[0]
    gradient = np.concatenate([stiffness @ first[:n], mass @ first[n:]])
    if problem.structure.periodic:
        out += [*(struck(end, row, 2.0) - first + y[problem.place - 1] * gradient), row @ first[:n] - bounds[hits[k]]]
    else:
        out += [*condition(problem.ends[0], first), *condition(problem.ends[1], end)]
    known = symbols | {"energy": 0.5 * gradient @ first, "quarter_period": times.sum() / problem.quarters}
    for text in problem.keep:
        left, right = text.split("=")
        out.append(eval(left, {}, known) - eval(right, {}, known))
    return np.array(out)


def matrices(at):
    """Mass, stiffness and bounds of the chain at complex values of its parameters."""
    m, k, d = at["m"], at["k"], at["d"]
    mass = np.array([[m, 0.0, 0.0], [0.0, 1.0 + m * k / 5.0, 0.1], [0.0, 0.1, 0.6]])
    stiffness = np.array([[1.0 + k, -k, 0.0], [-k, k + 1.4, -0.9], [0.0, -0.9, 0.9 + k**2]])
    return mass, stiffness, {"+": d, "-": -d}


CASES = {
    "origin-stop": (("origin", "stop+"), (), ("m",), ["energy = 0.8"], 1),
    "origin-rest": (("origin", "rest"), ("+",), ("k", "d"), ["energy = 0.8*d", "quarter_period = 1.5*k + energy/7"], 2),
    "origin-origin": (("origin", "origin"), ("+", "-"), ("d",), ["quarter_period = 1.3"], 3),
    "rest-stop": (("rest", "stop-"), ("+",), ("m", "k"), ["k = m**2/2", "energy = quarter_period"], 2),
    "stop-stop": (("stop+", "stop-"), (), ("k",), ["energy*quarter_period = 0.9*k"], 1),
    "stop-rest": (("stop-", "rest"), ("+", "-"), ("m", "d"), ["energy = 0.7", "d = 2 - m"], 3),
    "periodic": (("periodic", "periodic"), ("+", "-", "+"), ("k", "m"), ["energy = 0.8 + m", "quarter_period = 1.1*k"], 3),
}


@pytest.mark.parametrize("case", CASES)
def test_residual_and_derivatives(case):
    """The equations and all their derivatives, by states, times, parameters and the unfolding, are those of a twin in complex numbers."""
    ends, sequence, names, keep, flights = CASES[case]
    problem = ReleasedProblem(chain(), ends, sequence, names, keep)
    rng = np.random.default_rng(3)
    rows = problem.inner + 1
    assert rows == flights
    start = [problem.values[name] * 1.07 for name in names]
    y = problem.pack(rng.normal(size=(rows, 6)), rng.normal(size=rows), start, rng.uniform(0.4, 1.5, rows))
    if problem.structure.periodic:
        y[problem.place - 1] = 0.3
    found = problem.residual(y)
    assert found == pytest.approx(residual_twin(problem, y).real, abs=1e-12)
    step = 1e-30
    wanted = np.array([residual_twin(problem, y + 1j * step * unit).imag / step for unit in np.eye(len(y))]).T
    assert np.abs(problem.jacobian(y) - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize(("names", "message"), [(("lam",), "lam damps the system"), (("rho",), "rho changes a restitution")])
def test_parameters_that_lose_energy_are_refused(names, message):
    with pytest.raises(EndsError, match=message):
        ReleasedProblem(NES, ("origin", "stop+"), (), names, ["energy = 0.8"])


def test_a_bound_that_breaks_the_symmetry_is_refused():
    parametric = ParametricSystem.from_description(
        {"parameters": {"d": 1.0}, "system": {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "lower": -1.0, "upper": "d"}]}}
    )
    with pytest.raises(EndsError, match="d breaks the odd symmetry"):
        ReleasedProblem(parametric, ("origin", "stop+"), (), ["d"], ["energy = 0.8"])


def test_number_of_equations():
    with pytest.raises(ValueError, match="2 released parameters need 2 equations to keep; received 1"):
        ReleasedProblem(NES, ("origin", "stop+"), (), ("mu", "sigma"), ["energy = 0.8"])


@pytest.mark.parametrize("names", [("m", "k"), ("k", "d"), ("m",)])
def test_undamped_modes_at_other_parameters(names):
    """Oracle: the modes of the system that is made there (`bvp.forced_modes`), by all equations and their derivatives."""
    start = [0.0, 0.0, 0.0, 1.1, 0.8, 0.5]
    problem, y, *_ = released(chain(), ("origin", "stop+"), (), names, ["energy = {h!r}"] + ["d = 1.1"] * (len(names) - 1), start, [1.4])
    assert problem.is_undamped
    for factor in (1.1, 0.7, 1.0):
        there = y.copy()
        problem.released_values(there)[:] *= factor
        other = Damped(problem)
        found, wanted = problem.jacobian(there), other.jacobian(there)
        assert np.abs(problem.residual(there) - other.residual(there)).max() < 1e-12
        assert np.abs(found - wanted).max() < 1e-11 * max(1.0, np.abs(wanted).max())


class Damped(ReleasedProblem):
    """The same problem, whose modes are made by Python at each value of the parameters."""

    is_undamped = False

    def __init__(self, problem):
        super().__init__(problem.parametric, problem.ends, problem.sequence, problem.released, problem.keep, values=problem.values)


@pytest.mark.parametrize("bad", [-1.3, 0.0, 1e-26, np.nan])
def test_a_mass_that_a_system_cannot_have(bad):
    """No step converges there, and none is disturbed afterwards."""
    start = [0.0, 0.0, 0.0, 1.1, 0.8, 0.5]
    problem, y, *_ = released(chain(), ("origin", "stop+"), (), ("m",), ["energy = {h!r}"], start, [1.4])
    before = problem.residual(y)
    there = y.copy()
    there[problem.place] = bad
    assert np.isnan(problem.residual(there)).any()
    assert problem.residual(y) == pytest.approx(before, abs=1e-15)


def test_multipliers_of_an_orbit_with_negative_energy():
    """A spring that pushes away leaves the energy without a lower bound. Oracle: the half map has the same pair."""
    system = {
        "mass": [["m", 0.0], [0.0, 0.7]],
        "stiffness": [["k - 1", "-k"], ["-k", "k + 1.4"]],
        "stops": [{"c": [1.0, -0.3], "lower": -1.0, "upper": 1.0}],
    }
    parametric = ParametricSystem.from_description({"parameters": {"m": 1.0, "k": 0.3}, "system": system})
    plain = MultipointProblem(parametric.system(), ("rest", "stop+"), ())
    guess = plain.pack(plain.modes.from_state @ np.array([0.8, 0.2, 0.0, 0.0]), None, [1.0])
    y = plain.solve(guess, quarter_period=plain.quarter_period(guess)).y
    assert plain.energy(y) < -0.1
    problem = ReleasedProblem(parametric, ("rest", "stop+"), (), ("k",), [f"energy = {plain.energy(y)!r}"], energy=0.3)
    found = problem.multipliers(problem.of_orbit(plain, y))
    solution = Solution(y, np.zeros(2 * y.size), np.zeros(0), plain.end_states(y), np.full(len(RESULT_INDEX), np.nan))
    phi = half_map_of(plain, solution)[0]
    trace = 2.0 + 4.0 * float(phi[0, 1] * phi[1, 0])
    assert found[0] + found[-1] == pytest.approx(trace, rel=1e-10) and found[1:-1] == pytest.approx([1.0, 1.0])
