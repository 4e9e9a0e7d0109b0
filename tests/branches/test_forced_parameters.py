"""Forced families in parameters that change masses, dampers and springs."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from branches.forced.tracing import follow_response
from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.system import Stop
from continuation.run import follow_both_ways
from tests.branches.forced_systems import settled
from tests.branches.test_forced_chains import expected_product, require_motion
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle


def chain(**values):
    """Three masses; m is one of them, k a spring, c a damper, and the stop is on the first one."""
    return ParametricSystem.from_description(
        {
            "parameters": {"m": 0.7, "k": 0.9, "c": 0.1, "F": 1.4, "w": 1.1, "r": 0.6} | values,
            "system": {
                "mass": [["m", 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.3]],
                "damping": [["c", 0.0, 0.0], [0.0, "2*c", "-c"], [0.0, "-c", "0.5 + c*k"]],
                "stiffness": [["1 + k", "-k", 0.0], ["-k", "k + 0.8", -0.8], [0.0, -0.8, 1.8]],
                "stops": [{"c": [1.0, -0.5, 0.0], "upper": "0.4 + m/10", "restitution": "r"}],
            },
            "forces": [
                {"load": [0.0, 1.0, 0.0], "amplitude": "F*k", "harmonic": 1},
                {"load": [1.0, 0.0, 1.0], "constant": "0.1*m"},
                {"load": [1.0, 0.0, 0.0], "amplitude": "0.2", "phase": "c", "harmonic": 3},
            ],
        }
    )  # fmt: skip


def oscillator(**values):
    """m x'' + c x' + k x = A cos(w t), x <= 1."""
    return ParametricSystem.from_description(
        {
            "parameters": {"m": 1.0, "c": 0.1, "k": 1.0, "A": 0.3, "w": 1.6} | values,
            "system": {
                "mass": [["m"]], "damping": [["c"]], "stiffness": [["k"]], "stops": [{"c": [1.0], "upper": 1.0, "restitution": 0.8}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )  # fmt: skip


@pytest.mark.parametrize("name", ["m", "k", "c", "F", "w"])
def test_the_jacobian_is_the_derivative(name):
    """Oracle: differences of the residual, extrapolated: the error of the central ones is removed to fourth order."""
    problem = ForcedProblem(chain(), ["+", "+"], [name])
    random = np.random.RandomState(2)
    y = problem.pack(random.uniform(-1.0, 1.0, (2, 6)), [0.1, 0.6], [problem.values[name]])
    exact = problem.jacobian(y)
    for column in range(problem.unknowns):
        slopes = []
        for h in (2e-3, 1e-3, 5e-4):
            ahead, behind = y.copy(), y.copy()
            ahead[column] += h
            behind[column] -= h
            slopes.append((problem.residual(ahead) - problem.residual(behind)) / (2.0 * h))
        once = [(4.0 * b - a) / 3.0 for a, b in zip(slopes, slopes[1:], strict=False)]
        best = (16.0 * once[1] - once[0]) / 15.0
        assert best == pytest.approx(exact[:, column], abs=2e-9)


def test_the_response_grazes_where_the_formula_says():
    """Oracle: A = sqrt((k - m w^2)^2 + c^2 w^2), solved for k, for m and for c."""
    for name, begin, exact in (
        ("k", 1.0, 1.6**2 - math.sqrt(0.09 - 0.01 * 1.6**2)),
        ("m", 1.0, (1.0 + math.sqrt(0.09 - 0.01 * 1.6**2)) / 1.6**2),
        ("c", 0.9, math.sqrt(0.09 - (1.0 - 0.4 * 1.6**2) ** 2) / 1.6),
    ):
        parametric = oscillator(m=0.4, c=0.9) if name == "c" else oscillator()
        problem = ForcedProblem(parametric, [], [name])
        begun = problem.solve(problem.pack([[0.0, 0.0]], [0.0], [begin])).y
        run = follow_both_ways(ForcedFamily(problem, (0.1, 3.0)), begun, SETTINGS)
        grazings = [event.point.parameter for event in run.events if event.code == "GR"]
        assert min(abs(value - exact) for value in grazings) < 1e-12


@pytest.mark.parametrize("name", ["m", "k", "c"])
def test_orbits_along_the_family_are_motions(name):
    """Oracle: simulation, the product of the multipliers, and the problem with the parameter's new value, which is another system."""
    problem, y = settled(chain(), [name])
    assert np.abs(problem.residual(y)).max() < 1e-7
    value = problem.values[name]
    family = ForcedFamily(problem, (0.5 * value, 2.0 * value))
    run = follow_both_ways(family, problem.solve(y).y, replace(SETTINGS, maximum_points=24))
    assert len(run.points) >= 10
    for point in run.points[::3]:
        at = point.step.y
        if point.event is None:
            require_motion(problem, at, periods=3)
            assert np.prod(problem.multipliers(at)) == pytest.approx(expected_product_at(problem, at), rel=1e-9)
    at = run.points[-1].step.y
    other = ForcedProblem(problem.parametric, problem.sequence, ["F"], values=problem.parameters(at))
    moved = at.copy()
    moved[other.place] = problem.values["F"]
    assert np.abs(other.residual(moved)).max() < 1e-12


def expected_product_at(problem, y):
    """`expected_product` of the system at the parameters of y."""
    fixed = ForcedProblem(problem.parametric, problem.sequence, problem.released, values=problem.parameters(y))
    return expected_product(fixed, y)


def test_a_family_ends_where_its_parameter_leaves_its_domain():
    """A mass that falls to zero: the family ends there, and says so."""
    problem, y = settled(chain(), ["m"])
    run = follow_both_ways(ForcedFamily(problem), problem.solve(y).y, replace(SETTINGS, maximum_points=400))
    assert all(event.point.parameter > 0.0 for event in run.events)
    assert all(point.step.parameter > 0.0 for point in run.points)


def test_the_change_of_a_flight_with_a_spring_has_all_digits():
    """Oracle: the flight of one mass in forty digits, differentiated there."""
    problem = ForcedProblem(oscillator(), ["+"], ["k"])
    y = problem.pack([[1.0, -0.4]], [0.2], [1.0])
    ours = problem.jacobian(y)[:2, 3]
    with mp.workdps(40):

        def end(k):
            m, c, w, force = mp.mpf(1), mp.mpf(0.1), mp.mpf(1.6), mp.mpf(0.3)
            whole = mp.matrix([[0, 1, 0, 0], [-k / m, -c / m, force / m, 0], [0, 0, 0, -w], [0, 0, w, 0]])
            angle = 2 * mp.pi * mp.mpf(0.2)
            time = mp.mpf(float(problem.flight_times(y)[0]))
            state = mp.expm(whole * time) * mp.matrix([mp.mpf(1), mp.mpf(-0.4), mp.cos(angle), mp.sin(angle)])
            return state[0], -mp.mpf(0.8) * state[1]

        step = mp.mpf(10) ** -12
        theirs = [float((a - b) / (2 * step)) for a, b in zip(end(1 + step), end(1 - step), strict=True)]
    assert ours == pytest.approx(theirs, abs=1e-14)


def test_a_user_equation_is_kept():
    """Oracle: x'' + 0.1 x' + x = A cos(w t) with A = 0.2 w^2 grazes x = 1 where 0.2 w^2 = sqrt((1 - w^2)^2 + 0.01 w^2): a quadratic in w^2;
    and the derivatives of the equations."""
    problem = ForcedProblem(oscillator(A=0.05, w=0.5), [], ["w", "A"], keep=["A = 0.2*w**2"])
    begun = problem.solve(problem.pack([[0.0, 0.0]], [0.0], [0.5, 0.05])).y
    run = follow_both_ways(ForcedFamily(problem, (0.3, 3.0)), begun, SETTINGS)
    (grazing,) = [event for event in run.events if event.code == "GR"]
    # (1 - 0.04) q^2 - 1.99 q + 1 = 0 for q = w^2
    exact = math.sqrt((1.99 - math.sqrt(1.99**2 - 4.0 * 0.96)) / (2.0 * 0.96))
    assert grazing.point.parameter == pytest.approx(exact, abs=1e-12)
    for point in run.points:
        at = problem.parameters(point.step.y)
        assert at["A"] == pytest.approx(0.2 * at["w"] ** 2, abs=1e-14)
    with pytest.raises(ValueError, match="2 released parameters need 1 equations to keep; received 0"):
        ForcedProblem(oscillator(), [], ["w", "A"])
    with pytest.raises(ValueError, match="such as F = 0.3"):
        ForcedProblem(oscillator(), [], ["w", "A"], keep=["A + w"])
    with pytest.raises(ValueError, match="nearest: A|no parameter"):
        ForcedProblem(oscillator(), [], ["w", "A"], keep=["AA = w"])


def test_a_restitution_and_its_square_end_at_their_bounds():
    """Oracle: r and r^2 are restitutions for 0 <= r <= 1, bounds included; the family without the square ends at EP there, too."""
    stops = [{"c": [1.0], "upper": 0.05, "restitution": "r"}, {"c": [1.0], "lower": -0.06, "restitution": "r**2"}]
    system = {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], "stops": stops}
    forces = [{"load": [1.0], "amplitude": 0.3, "harmonic": 1}]
    description = {"parameters": {"r": 0.5, "w": 1.6}, "system": system, "forces": forces}
    problem, start = settled(ParametricSystem.from_description(description), ["r"])
    for highest, text in ((1.0, "asked for"), (2.0, "leaves its domain")):
        branch = follow_response(problem, start, (0.0, highest), direction="up")
        assert branch.events[-1].type == "EP" and branch.ended[1].reason == "EVENT" and text in branch.ended[1].text
        assert branch.parameter[-1] == pytest.approx(1.0, abs=1e-12)


def test_an_expression_that_is_rounded_at_its_bound_is_a_restitution():
    assert Stop((1.0,), upper=1.0, restitution=math.nextafter(1.0, 2.0)).restitution == 1.0
    assert Stop((1.0,), upper=1.0, restitution=-1e-16).restitution == 0.0
    with pytest.raises(ValueError, match="restitution lies in"):
        Stop((1.0,), upper=1.0, restitution=1.0 + 1e-12)


def one_sided(extra):
    """An oscillator under a harmonic load that is odd at the parameters given, and at no other d."""
    system = {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], **extra}
    return ParametricSystem.from_description(
        {"parameters": {"d": 1.0, "w": 0.8}, "system": system, "forces": [{"load": [1.0], "amplitude": 0.9, "harmonic": 1}]}
    )


STOPS = {"stops": [{"c": [1.0], "lower": -1.0, "upper": "d", "restitution": 0.8}]}
SPRINGS = {"springs": [{"c": [1.0], "potential": "0.1*w**4 + (d - 1)*w**3", "parameters": {"d": "d"}}]}


@pytest.mark.parametrize("extra", [STOPS, SPRINGS], ids=["stop", "spring"])
def test_a_parameter_that_breaks_the_symmetry_needs_the_full_period(extra):
    parametric = one_sided(extra)
    sequence = ("+",) if extra is STOPS else ()
    with pytest.raises(EndsError, match="d breaks the odd symmetry that a half period needs"):
        ForcedProblem(parametric, sequence, ["d"], half=True)
    assert ForcedProblem(parametric, sequence, ["w"], half=True).half


def test_the_family_in_one_bound_of_a_gap():
    """Oracle: simulations at points of the family, which was begun where the gap is equal on both sides."""
    path = ParameterPath(one_sided(STOPS), ["d"])
    found = settled_orbit(path, settle(path.parametric.system(), path.parametric.forces()))
    branch = follow_response(found.problem, found.y, (0.5, 1.5))
    assert not branch.problem.half and np.ptp(branch.parameter) > 0.3
    for y in branch.unknowns[5:-5:20]:
        require_motion(branch.problem, y)
