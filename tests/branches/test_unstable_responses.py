"""Responses too unstable for shooting. Oracles: harmonic balance and Hill's determinant, closed forms, steps by collocation."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from branches.forced.branch import ForcedBranch
from branches.forced.closing import largest_residual
from branches.forced.record import problem_from, problem_record
from branches.forced.tracing import follow_response, go_on, switch_response
from branches.reading import RecordError
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from transitions.response.tracing import trace_response

LOAD = 0.1
CUBIC = (1.0, 1.3)


def cube(w):
    """w^3, which is not read as a formula: its flights have steps by collocation."""
    return np.polyval([1.0, 0.0, 0.0, 0.0], w)


def pendulums(stiffness, damping: float = 0.1, laws=None) -> ParametricSystem:
    """A chain of inverted pendulums, of which each one has a cubic spring of its own, or one with another law, or stops; a slow load pushes
    the first one."""
    n = len(stiffness)
    laws = [{"stiffness": CUBIC[i], "power": 3} for i in range(n)] if laws is None else laws
    system = {"mass": np.eye(n).tolist(), "damping": (damping * np.eye(n)).tolist(), "stiffness": np.array(stiffness).tolist()}
    system["springs"] = [{"c": np.eye(n)[i].tolist(), **law} for i, law in enumerate(laws)]
    system["stops"] = [] if laws else [{"c": np.eye(n)[0].tolist(), "lower": -1.0, "upper": 1.0}]
    load = {"load": np.eye(n)[0].tolist(), "amplitude": "F", "harmonic": 1}
    return ParametricSystem.from_description({"parameters": {"w": 1.0, "F": LOAD}, "system": system, "forces": [load]})


def harmonic_balance(stiffness, damping: float, w: float, harmonics: int):
    """(state at phase 0, the exponents of the multipliers in order of growth) of the response: Newton's method on the values at 2 N + 1
    instants of a period, whose derivatives are those of their trigonometric polynomial, and the eigenvalues of Hill's matrix there."""
    n, count = len(stiffness), 2 * harmonics + 1
    k = np.fft.fftfreq(count, 1.0 / count)
    rate = np.fft.ifft(1j * w * k[:, None] * np.fft.fft(np.eye(count), axis=0), axis=0).real
    identity, cubic = np.eye(n), np.array(CUBIC[:n])
    linear = np.kron(rate @ rate + damping * rate, identity) + np.kron(np.eye(count), stiffness)
    load = np.kron(LOAD * np.cos(2.0 * np.pi * np.arange(count) / count), identity[0])
    u = np.linalg.solve(linear, load)
    for _ in range(12):
        weights = np.tile(cubic, count)
        u -= np.linalg.solve(linear + np.diag(3.0 * weights * u**2), linear @ u + weights * u**3 - load)
    motion = u.reshape(count, n)
    hill = -np.kron(rate, np.eye(2 * n))
    for i, at in enumerate(motion):
        block = np.block([[np.zeros((n, n)), identity], [-np.array(stiffness) - np.diag(3.0 * cubic * at**2), -damping * identity]])
        hill[2 * n * i : 2 * n * (i + 1), 2 * n * i : 2 * n * (i + 1)] += block
    values, vectors = np.linalg.eig(hill)
    # Each exponent appears with every harmonic. Those whose motion has the lowest ones are best.
    spectrum = np.abs(np.fft.fft(vectors.reshape(count, 2 * n, -1), axis=0)).sum(axis=1)
    lowest = np.argsort((np.abs(k)[:, None] * spectrum).sum(axis=0) / spectrum.sum(axis=0))[: 2 * n]
    return np.concatenate([motion[0], (rate @ motion)[0]]), np.sort(values[lowest].real)[::-1]


def slowest(branch: ForcedBranch) -> tuple[np.ndarray, np.ndarray, int]:
    """The state, the logarithms of the multipliers, and the stability of the point with the lowest parameter."""
    i = int(np.argmin(branch.parameter))
    return branch.problem.states(branch.unknowns[i])[0], np.log(np.abs(branch.multipliers[i])), int(branch.stable[i])


@pytest.mark.parametrize(("w", "size"), [(0.2, 1e6), (0.04, 1e31), (0.02, 1e63)])
def test_a_chain_of_inverted_pendulums_is_followed(w, size):
    """Oracle: harmonic balance, and Hill's matrix: both pendulums fall; no rounding of the state grows there."""
    stiffness = [[-1.0, -0.05], [-0.05, -0.7]]
    (branch,) = trace_response(pendulums(stiffness), "w", (w, 1.0), start="rest")
    state, logarithms, stable = slowest(branch)
    exact, exponents = harmonic_balance(stiffness, 0.1, w, 24)
    assert branch.ended[0].text.endswith("lowest value of w asked for") and branch.residual.max() < 1e-12
    assert np.abs(state - exact).max() < 1e-12 * LOAD
    assert logarithms == pytest.approx(exponents * 2.0 * math.pi / w, abs=6e-11)
    assert math.exp(logarithms[0]) > size and stable == 0
    assert [event.type for event in branch.events] == ["EP", "EP"]


@pytest.mark.parametrize("start", [1.0, 0.02])
def test_a_start_that_is_too_unstable_for_a_single_flight_is_found(start):
    """Oracle: harmonic balance. The family begins where perturbations grow by 10^4 in half a period, or by 10^130 in a whole one."""
    (branch,) = trace_response(pendulums([[-1.0]]), "w", (0.02, 1.0), start="rest", values={"w": start})
    state, logarithms, _ = slowest(branch)
    exact, exponents = harmonic_balance([[-1.0]], 0.1, 0.02, 24)
    assert np.abs(state - exact).max() < 1e-12 * LOAD
    assert logarithms == pytest.approx(exponents * 2.0 * math.pi / 0.02, abs=6e-11)


@pytest.mark.parametrize("w", [0.1, 0.004])
def test_a_linear_pendulum_between_stops_is_followed(w):
    """Oracle: u = Re(F e^(iwt)/(-1 - w^2 + 0.1 i w)), and multipliers exp(rate T), of which one has no number at w = 0.004."""
    (branch,) = trace_response(pendulums([[-1.0]], laws=[]), "F", (0.05, 0.2), start="rest", values={"w": w})
    shape = branch.parameter[0] / (-1.0 - w * w + 0.1j * w)
    assert branch.problem.states(branch.unknowns[0])[0] == pytest.approx([shape.real, (1j * w * shape).real], abs=1e-14)
    rates = -0.05 + math.sqrt(1.0025) * np.array([1.0, -1.0])
    largest, least = np.abs(branch.multipliers[0])
    assert branch.stable[0] == 0 and branch.ended[0].text.endswith("lowest value of F asked for")
    if w == 0.004:
        assert largest == math.inf and least == 0.0
    else:
        assert np.log([largest, least]) == pytest.approx(rates * 2.0 * math.pi / w, abs=2e-11)


def test_steps_of_both_kinds_give_one_unstable_response():
    """Oracle: the other kind of steps. Perturbations grow by 10^39 in half a period, which is solved in 40 pieces."""
    found = []
    for spring in ({"stiffness": 1.0, "power": 3}, {"force": cube}):
        problem = ForcedProblem(pendulums([[-1.0]], laws=[spring]), (), ["w"], half=True, values={"w": 0.0333}, pieces=40)
        assert problem.system.smooth_forces.is_called == ("force" in spring)
        fractions = 0.5 * np.arange(40) / 40
        shape = LOAD / -1.0 * np.cos(2.0 * np.pi * fractions)
        y = problem.solve(problem.pack(np.column_stack([shape, 0.0 * shape]), fractions, [0.0333])).y
        found.append((y, np.log(np.abs(problem.multipliers(y)))))
    (one, first), (other, second) = found
    assert first[0] > math.log(1e38)
    assert np.abs(one - other).max() < 1e-14 and first == pytest.approx(second, abs=1e-12)


def duffing() -> ParametricSystem:
    """x'' + 0.1 x' + x^3 = F cos w t."""
    spring = {"c": [1.0], "stiffness": 1.0, "power": 3}
    system = {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[0.0]], "springs": [spring]}
    load = {"load": [1.0], "amplitude": "F", "harmonic": 1}
    return ParametricSystem.from_description({"parameters": {"w": 1.0, "F": 7.5}, "system": system, "forces": [load]})


@pytest.mark.parametrize("pieces", [4, 5])
def test_a_response_does_not_see_its_cuts(pieces):
    """Oracle: equality of paths. In pieces a response has the events, the normal forms, the id and the neighbours of its whole flights."""
    (whole,) = trace_response(duffing(), "w", (0.9, 2.5), start="rest")
    problem, y = whole.problem.in_pieces(pieces, whole.unknowns[whole.start])
    cut = follow_response(problem, y, (0.9, 2.5))
    assert cut.problem.pieces == pieces and cut.id == whole.id
    for one, other in zip(whole.events, cut.events, strict=True):
        assert one.type == other.type and one.values["w"] == pytest.approx(other.values["w"], rel=1e-11)
        assert one.coefficient == (None if one.coefficient is None else pytest.approx(other.coefficient, rel=1e-9))
    broken = [follow_response(*switch_response(branch, branch.events[1])[0], (0.9, 2.5), points=400) for branch in (whole, cut)]
    assert broken[0].problem.pieces == 1 and broken[1].problem.pieces == 2 * pieces
    folds = [next(event for event in branch.events if event.type == "SN") for branch in broken]
    assert folds[0].values["w"] == pytest.approx(folds[1].values["w"], rel=1e-11) and broken[0].id == broken[1].id
    again = problem_from(duffing(), json.loads(json.dumps(problem_record(problem))))
    assert np.array_equal(again.residual(cut.unknowns[0]), problem.residual(cut.unknowns[0]))


def test_a_response_goes_on_in_more_pieces():
    """Oracle: harmonic balance at the new end; all points solve the equations in more pieces."""
    (first,) = trace_response(pendulums([[-1.0]]), "w", (0.5, 1.0), start="rest")
    branch, ends = go_on(first, (0.05, 1.0))
    assert first.problem.pieces < branch.problem.pieces and len(ends) == 1
    assert max(np.abs(branch.problem.residual(y)).max() for y in branch.unknowns) < 1e-12
    exact, _ = harmonic_balance([[-1.0]], 0.1, 0.05, 24)
    assert np.abs(slowest(branch)[0] - exact).max() < 1e-12 * LOAD


def test_points_in_pieces_are_checked_as_they_were_solved():
    """Oracle: the solver's own residual. Where velocities are small, they have the rounding of displacements times the rate of growth."""
    (branch,) = trace_response(pendulums([[-1.0]]), "w", (0.02, 1.0), start="rest")
    assert branch.problem.pieces > 8
    assert max(largest_residual(branch.problem, y) for y in branch.unknowns) < 1e-12


@pytest.mark.parametrize("pieces", [0, -1])
def test_a_number_of_pieces_is_refused(pieces):
    (branch,) = trace_response(pendulums([[-1.0]]), "w", (0.6, 1.0), start="rest")
    record = problem_record(branch.problem) | {"pieces": pieces}
    with pytest.raises(RecordError, match=f"pieces is {pieces}, expected 1 or more"):
        problem_from(pendulums([[-1.0]]), record)
