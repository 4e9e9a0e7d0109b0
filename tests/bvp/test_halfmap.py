"""The reversible half map and the stability decided from it.

Oracles: central differences of the event-driven flow between the ends in 60 digits; determinant 1 and the symplectic relations; the
trace of the monodromy; eigenvectors of the return map for Krein's signatures; the closed form's fold.
"""

import mpmath
import numpy as np
import pytest

from benchmarks.saltation import reduced_monodromy, saltation_multipliers
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from bvp.stability import ERROR_FACTOR, balance, chain_half_map, decide, half_map_of, stability, velocity_scale
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.high_precision import Exact
from tests.bvp.orbits import backbone_segment, chains, collection

EPS = np.finfo(float).eps
FOLD = 1.13584395619551


def defect(problem, solution):
    """Error of the balanced entries, and the bound that `decide` claims for them."""
    exact = Exact(problem, solution).half_map()
    phi, magnified = chain_half_map(problem, solution)
    units = np.reshape(balance(problem, velocity_scale(problem, solution)), (2, 2))
    error = np.array([[float(mpmath.mpf(float(phi[i, j])) - exact[i][j]) for j in (0, 1)] for i in (0, 1)]) * units
    bound = ERROR_FACTOR * EPS * (problem.inner + 2) * magnified * np.max(np.abs(phi * units))
    return np.max(np.abs(error)), bound


@pytest.mark.parametrize("index", range(40))
def test_half_map_against_differences_of_the_flow(index):
    orbit = collection()[index]
    error, bound = defect(orbit.problem, orbit.solution)
    assert error < bound, orbit.name


@pytest.mark.parametrize(
    ("impacts", "alpha"), [*((0, alpha) for alpha in (0.01, 0.3, 1.0, FOLD, 1.2, 1.3, 1.31, 1.3141)), (10, 0.9), (16, 1.2), (12, 1.25)]
)
def test_error_bound_of_the_backbone(impacts, alpha):
    """Along the out-of-phase backbone, h from 455 down to its fold and on towards grazing; and several periods of an orbit as one segment:
    stable (0.9) and with entries that grow to 1e7 (1.25)."""
    problem, y = backbone_segment(vibro_impact_nes(), alpha, impacts=impacts)
    error, bound = defect(problem, problem.solve(y, quarter_period=alpha * max(impacts, 1)))
    assert error < bound


def test_half_map_is_symplectic():
    """n = 2: det = 1; n > 2: a'c and b'd symmetric, a'd - c'b = 1."""
    for orbit in collection() + chains():
        phi, magnified = chain_half_map(orbit.problem, orbit.solution)
        m = orbit.problem.pairs
        units = balance(orbit.problem, velocity_scale(orbit.problem, orbit.solution))
        a, b, c, d = phi[:m, :m] * units[0], phi[:m, m:] * units[1], phi[m:, :m] * units[2], phi[m:, m:] * units[3]
        size = np.max(np.abs([a, b, c, d])) ** 2
        error = ERROR_FACTOR * EPS * (orbit.problem.inner + 2) * magnified * size * m
        assert np.max(np.abs(a.T @ d - c.T @ b - np.eye(m))) < error
        assert np.max(np.abs(a.T @ c - c.T @ a)) < error and np.max(np.abs(b.T @ d - d.T @ b)) < error


def test_traces_are_those_of_the_monodromy():
    """tau_j = lambda_j + 1/lambda_j of the full period, for quarters through tau_half^2 - 2."""
    compared = 0
    for orbit in collection() + chains():
        found = stability(orbit.problem, orbit.solution)
        values = saltation_multipliers(cycle_of(orbit.problem, orbit.solution.y))
        size = np.max(np.abs(values))
        if size > 1e5:
            continue
        assert abs(np.sum(found.tau) - np.sum(values)) < 1e-9 * size, orbit.name
        matrix = reduced_monodromy(cycle_of(orbit.problem, orbit.solution.y))
        assert abs(np.sum(found.tau**2 - 2.0) - np.trace(matrix @ matrix)) < 1e-8 * size**2, orbit.name
        assert (found.tau_half is None) == (orbit.problem.quarters != 1)
        if found.tau_half is not None:
            assert np.max(np.abs(found.tau - (found.tau_half**2 - 2.0))) == 0.0
        if orbit.problem.half == 2:
            assert abs(found.tau[0] - orbit.solution["trace"]) < 1e-9 * size
        compared += 1
    assert compared > 30


def test_stable_agrees_with_the_multipliers():
    for orbit in collection() + chains():
        found = stability(orbit.problem, orbit.solution)
        values = saltation_multipliers(cycle_of(orbit.problem, orbit.solution.y))
        excess = np.max(np.abs(values)) - 1.0
        if excess > 1e-4:
            assert found.stable is False, orbit.name
        elif found.stable is False:
            # unstable by less than the multipliers show: then nearly on the limit
            assert np.min(np.abs(found.nu)) < 1e-6 or np.min(np.abs(1.0 + found.nu)) < 1e-6 or excess > 1e-9
        if found.stable:
            assert excess < 1e-5
    assert {stability(o.problem, o.solution).stable for o in collection()} >= {True, False}


def test_vectorised_decision_is_the_same():
    orbits = [orbit for orbit in collection() if np.isfinite(orbit.solution["a"])]
    columns = {name: np.array([orbit.solution[name] for orbit in orbits]) for name in ("a", "b", "c", "d", "magnified", "branching")}
    impacts = np.array([orbit.problem.inner for orbit in orbits])
    units = np.array([balance(orbit.problem, velocity_scale(orbit.problem, orbit.solution)) for orbit in orbits])
    entries = [columns[name] * units[:, i] for i, name in enumerate("abcd")]
    decided = decide(*entries, columns["magnified"], impacts, columns["branching"])
    assert decided.dtype == np.int8
    expected = [{True: 1, False: 0, None: -1}[stability(orbit.problem, orbit.solution).stable] for orbit in orbits]
    assert list(decided) == expected


def return_map(phi, m):
    """[[d'a + b'c, 2 d'b], [2 a'c, a'd + c'b]]: there and back."""
    a, b, c, d = phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:]
    return np.block([[d.T @ a + b.T @ c, 2.0 * d.T @ b], [2.0 * a.T @ c, a.T @ d + c.T @ b]])


def test_krein_signatures_of_eigenvectors():
    """sign(i x* J x) of the eigenvectors of the return map with positive imaginary part."""
    signs = set()
    for orbit in collection() + chains():
        found = stability(orbit.problem, orbit.solution)
        m = orbit.problem.pairs
        phi, _ = chain_half_map(orbit.problem, orbit.solution)
        values, vectors = np.linalg.eig(return_map(phi, m))
        form = np.block([[np.zeros((m, m)), np.eye(m)], [-np.eye(m), np.zeros((m, m))]])
        for nu, sign in zip(found.nu, found.krein, strict=True):
            if np.imag(nu) != 0.0 or not -0.999 < np.real(nu) < -0.001 or np.min(np.abs(np.delete(found.nu, 0) - nu), initial=1) == 0:
                continue
            target = 1.0 + 2.0 * nu + 1j * np.sqrt(-4.0 * nu * (1.0 + nu))
            k = int(np.argmin(np.abs(values - target)))
            others = np.delete(np.abs(values - target), k)
            if abs(values[k] - target) > 1e-6 or np.min(others) < 1e-3:
                continue
            x = vectors[:, k]
            assert sign == np.sign(np.real(1j * np.conj(x) @ form @ x)), orbit.name
            signs.add(int(sign))
    assert signs == {-1, 1}


def test_periodic_closure_decides_by_the_trace():
    """The same orbits closed on themselves: xi = 0, the period 4 alpha, and stable where their halves say so."""
    compared = 0
    for orbit in collection()[::3] + chains()[::3]:
        expected = stability(orbit.problem, orbit.solution)
        if expected.stable is None or np.max(np.abs(expected.tau)) > 1e3:
            continue
        if np.min(np.abs(np.abs(expected.tau) - 2.0)) < 1e-3:
            continue
        if orbit.problem.pairs < orbit.problem.half - 1:
            continue  # a periodic closure lets it drift
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        problem = MultipointProblem(orbit.problem.system, ("periodic", "periodic"), cycle.letters)
        y = problem.pack(cycle.after[0], cycle.after[1:], cycle.duration)
        assert np.max(np.abs(problem.residual(y))) < 1e-13 * np.max(np.abs(y)), orbit.name
        solution = problem.solve(y, energy=orbit.energy)
        assert abs(solution.y[-1]) < 1e-13
        assert abs(solution["quarter_period"] / orbit.solution["quarter_period"] - 1.0) < 1e-10
        found = stability(problem, solution)
        assert found.tau_half is None
        assert abs(np.sum(found.tau) - np.sum(expected.tau)) < 1e-7 * (1.0 + abs(np.sum(expected.tau))), orbit.name
        assert found.stable == expected.stable, orbit.name
        compared += 1
        with pytest.raises(ValueError, match="no half map"):
            half_map_of(problem, solution)
    assert compared >= 8


def test_units_of_time_do_not_change_the_decision():
    """The same orbit with stiffness times 1e8 (time in units 1e-4): the same tau, decision and number of undecided points."""
    system = vibro_impact_nes()
    fast = ImpactSystem(system.mass, np.zeros((2, 2)), 1e8 * system.stiffness, (Stop((1.0, -1.0), -1.0, 1.0),))
    for alpha in (0.5, FOLD - 1e-9, FOLD + 1e-9, 1.2):
        results = []
        for s, t in ((system, alpha), (fast, 1e-4 * alpha)):
            problem, y = backbone_segment(s, t)
            results.append(stability(problem, problem.solve(y, quarter_period=t)))
        assert abs(results[0].tau[0] - results[1].tau[0]) < 1e-12 * max(1.0, abs(results[0].tau[0]))
        assert results[0].stable == results[1].stable and results[0].stable is not None


def test_the_step_has_the_same_half_map():
    """Two degrees of freedom: to rounding, as magnified by the impacts."""
    for orbit in collection():
        phi, magnified = chain_half_map(orbit.problem, orbit.solution)
        known, other = half_map_of(orbit.problem, orbit.solution)
        assert abs(magnified / other - 1.0) < 1e-12
        assert np.max(np.abs(phi - known)) < ERROR_FACTOR * EPS * magnified * np.max(np.abs(phi))
