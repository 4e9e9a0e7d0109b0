"""A family of impacting orbits as the engine sees it: steps, test functions, and what an event means.

Binds `bvp.multipoint` (the orbits) to `continuation` (the following). The test functions are those of a symmetric orbit's half map
phi = [[a, b], [c, d]] between its ends (see `bvp.kernels.stability`): each bifurcation is a plain zero of one entry, so no event
hides in a trace that touches +-2 without crossing it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.grazing_notes import describe_merging, describe_touch, describe_vanishing
from branches.kernels.advance import Block, advance_block
from branches.markers import COMMON, NOISE, PIVOT_NOISE, common_tests, is_orbit, two_dof_tests
from branches.naming.labels import ImpossibleLabelError, Label, label_of
from branches.steps import AdvancedSteps, step_of
from bvp.checks import changeable
from bvp.kernels import multipoint as kernel
from bvp.kernels.newton import set_scale
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from bvp.stability import half_map_of
from continuation.control import Control, Settings, kinds_of
from continuation.problem import Advance, EventDetails, Point, Step, TestFunction
from continuation.switching import refine_branch_point

if TYPE_CHECKING:
    from continuation.location import Location

__all__ = ["Family", "RESONANCES", "SETTINGS", "label_at", "label_text", "multiplication", "scales_of"]

RESONANCES = ((1, 3), (1, 4), (2, 5), (1, 5))
"""Rotation numbers p/q of the full period whose q-tuplings are reported."""

SETTINGS = Settings(initial_step=0.01, maximum_step=0.025, minimum_step=1e-9, target_turn=0.05, maximum_points=20000)
"""How families are followed: a step is at most a fortieth of the metric's unit, so that curves drawn through the points are smooth."""

_I = RESULT_INDEX
_BRANCHING = 1
_SINGULAR = 1e-5
"""Smallest pivot, relative to its column, below which signs are rounding: the error of a tangent is rounding over its square."""

_SHORT = 1e-3
_ALONG = 0.9  # cosine of the angle up to which two directions of the unknowns are one

_GRAZING = (
    (TestFunction("GR", "guard", True, "a flight touches a stop"), "touches", describe_touch),
    (TestFunction("GR", "guard", True, "the speed of an impact reaches zero"), "vanishes", describe_vanishing),
    (TestFunction("GR", "guard", True, "a flight time reaches zero"), "merge", describe_merging),
)
"""The three ways of grazing: the test function, the word that tells the way's notes, and what describes it."""


def multiplication(p: int, q: int) -> float:
    """Trace 2 cos(2 pi p/q) of the full-period map at a q-tupling."""
    return 2.0 * math.cos(2.0 * math.pi * p / q)


def half_multiplication(p: int, q: int) -> tuple[float, float]:
    """Traces +-2 cos(pi p/q) of the half map composed with u -> -u at a q-tupling: the full period's trace is their square less 2."""
    level = 2.0 * math.cos(math.pi * p / q)
    return level, -level


def label_at(problem: MultipointProblem, result: Any) -> Label | None:
    """Label of an orbit from its result entries; None for orbits outside the grammar (no origin start, no absorber named)."""
    if problem.kinds[0] != kernel.ORIGIN or result[_I["waves_absorber"]] < 0:
        return None
    if problem.kinds[1] == kernel.ORIGIN:
        parity = None
    else:
        parity = "O" if problem.kinds[1] == kernel.STOP else "E"
    return label_of(
        int(result[_I["waves_absorber"]]),
        int(result[_I["waves_primary"]]),
        parity,
        int(result[_I["first_quarter"]]),
        int(result[_I["second_quarter"]]),
        "+" if result[_I["in_phase"]] == 1.0 else "-",
    )


def label_text(problem: MultipointProblem, result: Any) -> str:
    """Label of an orbit as text, "" outside the grammar and where a velocity that is zero to rounding contradicts the counts."""
    try:
        label = label_at(problem, result)
    except ImpossibleLabelError:
        return ""
    return "" if label is None else str(label)


def scales_of(problem: MultipointProblem, y: np.ndarray) -> np.ndarray:
    """Sizes of the unknowns (u,): displacements, velocities, times."""
    problem.residual(y)
    problem._factor.before[:] = problem.end_states(y)
    set_scale(problem.segment, changeable(y), problem._factor)
    return problem._factor.scale.copy()


def _is_along(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(one @ other > _ALONG * np.linalg.norm(one) * np.linalg.norm(other))


class Family:
    """A family of orbits with given ends and sequence: a `continuation.Problem`.

    Parameters
    ----------
    problem : MultipointProblem
    energy : (float, float)
        The family ends at these energies.
    quarter_period : float
        The family ends at this quarter period.
    """

    def __init__(self, problem: MultipointProblem, energy: tuple[float, float] = (0.0, math.inf), quarter_period: float = math.inf):
        self.problem = problem
        self.energy = energy
        tests = [
            TestFunction("SN", "crossing", False, "fold in the energy", True),
            TestFunction("BP", "crossing", False, "branch point", True, ("SN", "SB"), _SINGULAR),
            *(test for test, _, _ in _GRAZING),
            TestFunction("EP", "guard", True, "lowest energy asked for"),
            TestFunction("EP", "guard", True, "highest energy asked for"),
            TestFunction("EP", "guard", True, "longest quarter period asked for"),
            TestFunction("IO", "crossing", False, "impulsive orbit at the start", False, ("LB",)),
            TestFunction("IO", "crossing", False, "impulsive orbit at the half period", False, ("LB",)),
            TestFunction("LB", "change", False, "the label changes"),
        ]
        self.fixed = len(tests)
        self._two_dof = problem.half == 2
        self._full = True  # false: no more than the tangent and the fold
        if problem.quarters == 1:
            self._kind = "quarter"
            tests += [
                TestFunction("SB", "crossing", False, "the last reversal is broken"),
                TestFunction("SB", "crossing", False, "half-period symmetry breaks, the reversal about the start stays"),
                TestFunction("SB", "crossing", False, "half-period symmetry breaks, the reversal about the far end stays"),
                TestFunction("PD", "crossing", False, "period doubling"),
            ]
        elif problem.quarters == 2:
            self._kind = "half"
            tests += [
                TestFunction("SB", "crossing", False, "the last reversal is broken"),
                TestFunction("PD", "crossing", False, "period doubling, the reversal about the start stays"),
                TestFunction("PD", "crossing", False, "period doubling, the reversal about the far end stays"),
            ]
        else:
            self._kind = "periodic"
            tests += [TestFunction("PD", "crossing", False, "period doubling")]
        if not self._two_dof and not problem.periodic:
            tests += [TestFunction("NS", "crossing", False, "Krein collision: two pairs of multipliers meet and leave the unit circle")]
        # Of a quarter the trace of the half map is followed: that of the full period passes a level twice where the former passes zero.
        quarter = problem.quarters == 1
        levels = {(p, q): half_multiplication(p, q) if quarter else (multiplication(p, q),) for p, q in RESONANCES}
        self._resonant = [(p, q, level) for (p, q), both in levels.items() for level in both]
        if self._two_dof:
            tests += [TestFunction("RT", "crossing", False, f"{q}-tupling, {p}/{q}") for p, q, _ in self._resonant]
        self._tests = tuple(tests)
        self._low = math.log(energy[0]) if energy[0] > 0.0 else -math.inf
        self._high = math.log(energy[1]) if energy[1] < math.inf else math.inf
        self._longest = math.log(quarter_period) if quarter_period < math.inf else math.inf
        self._targets = [level for _, _, level in self._resonant]
        self._kinds = np.array(kinds_of(self._tests))
        self._singular = np.array([test.singular for test in self._tests])
        self._bounds = np.array([self._low, self._high, self._longest])
        self._aims = np.array(self._targets)
        self._unknown = np.full(problem.size + 2, math.nan)

    @property
    def tests(self) -> tuple[TestFunction, ...]:
        """The test functions, in the order of their values in each step."""
        return self._tests

    def begin(self, y: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        return self._step(self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0))

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`; the tangent carries its curvature behind it, (2 u,)."""
        return self._step(self.problem.step(y, tangent, ds))

    def step_near(self, y: np.ndarray, tangent: np.ndarray, ds: float, guess: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        along = tangent[: y.size]
        # the prediction is y + ds (tangent + ds/2 curvature)
        return self.step(y, np.concatenate([along, 2.0 * (guess - y - ds * along) / (ds * ds)]), ds)

    def _step(self, solution: Solution | None) -> Step:
        if solution is None:
            return _FAILED
        result = solution.result.tolist()
        if not is_orbit(result):
            return _FAILED
        tests = [0.0] * len(self._tests)
        common_tests(result, self._low, self._high, self._longest, tests)
        if self._two_dof:
            two_dof_tests(result, self.problem.quarters, self._targets, tests)
        else:
            tests[COMMON:] = self._general(solution)
        return step_of(solution, result, tests)

    @property
    def advance(self) -> Callable[..., Advance] | None:
        """See `continuation.Problem`; None where there are more than two degrees of freedom."""
        return self._advance if self._two_dof else None

    def _advance(
        self, step: Step, tests: list[float], older: list[float], oldest: list[float], before: float, first: float, ds: float, goal: Any,
        direction: Any, room: int, control: Control,
    ) -> Advance:  # fmt: skip
        problem = self.problem
        rows = room + 1
        size, unknowns = problem.size, problem.unknowns
        block = Block(
            np.empty((rows, unknowns)),
            np.empty((rows, 2 * unknowns)),
            np.empty((rows, size + 2)),
            np.empty((rows, problem.inner + 1, size)),
            np.empty((rows, len(RESULT_INDEX))),
            np.empty((rows, len(self._tests))),
            np.empty((rows, 2)),
        )
        count, tried, ds = problem.compiled(
            advance_block, control, self._kinds, self._singular, self._bounds, self._aims, step.y, step.tangent, np.array(step.position),
            np.array(tests), np.array(older), np.array(oldest), np.asarray(goal), self._unknown if direction is None else direction,
            before, first, ds, np.empty((5, size + 2)), block, full=self._full,
        )  # fmt: skip
        if 2 * (count + tried) < rows:  # let no short piece keep a whole block
            block = Block(*(array[: count + tried].copy() for array in block))
        trial = None
        if tried:
            trial = self._step(
                Solution(block.y[count], block.tangent[count], block.position[count], block.ends[count], block.result[count])
            )
        taken = Block(*(array[:count] for array in block))
        return Advance(AdvancedSteps(taken), taken.lengths[:, 0], taken.lengths[:, 1], ds, trial)

    def _general(self, solution: Solution) -> list[float]:
        """More than two degrees of freedom: determinants of the blocks of the half map in place of its entries."""
        if self.problem.periodic:
            return [math.nan]
        phi = half_map_of(self.problem, solution)[0]
        m = self.problem.half - 1
        a, b, c, d = phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:]
        if not np.isfinite(phi).all():
            return [math.nan] * (5 if self._kind == "quarter" else 4)
        pivot = abs(float(solution["branching"]))
        level = (NOISE + PIVOT_NOISE / pivot) * float(np.max(np.abs(phi))) if pivot > 0.0 else math.inf
        speeds = float(solution["speeds"])  # see `branches.markers.two_dof_tests`
        out = []
        for block in (b, a, d):
            singular = np.linalg.svd(block, compute_uv=False)
            out.append(speeds * float(np.linalg.det(block)) if singular[-1] > level else math.nan)
        product = b.T @ c
        if self._kind == "quarter":
            out.append(speeds**2 * float(np.linalg.det(product + 0.5 * np.eye(m))))
        nu = np.linalg.eigvals(product)
        first, second = np.triu_indices(m, 1)
        out.append(speeds ** (4 * (m - 1)) * float(np.prod((nu[first] - nu[second]) ** 2).real))
        return out

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), for switching."""
        return self.problem.residual(y)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), for switching."""
        return self.problem.jacobian(y)

    def refined(self, index: int, at: Step) -> Step | None:
        """See `continuation.Problem`. At branch points the equations are singular, and steps nearby fall onto the other family."""
        if index != _BRANCHING:
            return None
        y = refine_branch_point(self, at.y, scales_of(self.problem, at.y))
        return None if y is None else self._branch_point(y, at)

    def _branch_point(self, y: np.ndarray, near: Step) -> Step | None:
        """A branch point as it stands: where the equations are singular a corrector has nothing to hold on to, nor has a tangent."""
        solution = self.problem.step(y, near.tangent, 0.0, maximum=0)
        found = self._step(None if solution is None else replace(solution, tangent=near.tangent))
        return found._replace(turn=near.turn) if found.converged else None

    def beyond(self, at: Step) -> tuple[Step, Step] | None:
        """See `continuation.Problem`. The point behind the branch point begins as the image of the one before it."""
        scale = scales_of(self.problem, at.y)
        y = refine_branch_point(self, at.y, scale)
        if y is None:
            return None
        ahead = (y - at.y) / scale
        point, after = self._branch_point(y, at), self.begin(2.0 * y - at.y)
        if point is None or not after.converged or not _is_along(at.tangent[: y.size] / scale, ahead):
            return None
        behind = (after.y - y) / scale
        if not _is_along(ahead, behind) or not 0.5 < np.linalg.norm(behind) / np.linalg.norm(ahead) < 2.0:
            return None
        if after.tangent[: y.size] / scale @ behind < 0.0:
            after = self.step(after.y, -after.tangent, 0.0)
        return (point, after) if after.converged else None

    def failure(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        """Where steps fail: the energy and the quarter period reached."""
        return f"at h = {self.problem.energy(y):.6g}, alpha = {self.problem.quarter_period(y):.6g}"

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is, in the words of the record."""
        test = self._tests[index]
        solution: Solution = at.extra
        if location.kind in ("pole", "jump") and test.kind == "crossing":
            return None
        data: dict[str, Any] = {"stop": None, "p_q": None, "breaks": None, "note": test.label}
        code = test.code
        if code == "GR":
            describe = next(describe for way, _, describe in _GRAZING if way == test)
            data.update(describe(self.problem, solution))
        elif code == "SB":
            data["breaks"] = "reversal" if "last" in test.label else "half-period symmetry"
        elif code == "RT":
            data["p_q"] = list(self._resonant[index - len(self._tests)][:2])
        elif code == "LB":
            data["sides"] = self._side(location.low.extra), self._side(location.high.extra)
            if data["sides"][0] == data["sides"][1]:
                return None
        elif code == "IO":
            data["sides"] = self._side(self._just_before(before, location)), self._side(self._just_after(before, after, location))
        counted: Solution = self._just_before(before, location) if code in ("GR", "IO") else location.low.extra
        data["label"], data["half_waves"] = self._side(counted)
        return EventDetails(code, test.terminal, data)

    def _just_before(self, before: Point, location: Location) -> Solution:
        """The orbit a little before an event. At grazing itself a turning point meets an impact, at an impulsive orbit a velocity
        is zero, and which of them counts is rounding."""
        offset = max(1e-7, _SHORT * location.s)
        if location.s > 2.0 * offset:
            near = self.step(before.y, before.tangent, location.s - offset)
            if near.converged:
                found: Solution = near.extra
                return found
        solution: Solution = before.step.extra
        return solution

    def _just_after(self, before: Point, after: Point, location: Location) -> Solution:
        """The orbit a little behind an event; see `_just_before`."""
        offset = max(1e-7, _SHORT * location.s)
        if 0.0 < location.s < after.step_size - 2.0 * offset:
            near = self.step(before.y, before.tangent, location.s + offset)
            if near.converged:
                found: Solution = near.extra
                return found
        solution: Solution = after.step.extra
        return solution

    def _side(self, solution: Solution) -> tuple[str, int]:
        """Label and half-waves on one side of an event."""
        return label_text(self.problem, solution.result), int(solution["waves_absorber"])

    def grazing(self, note: str, solution: Solution) -> dict[str, Any]:
        """What `classify` says of the grazing of an orbit, where the same was noted of an image of it."""
        data: dict[str, Any] = {"stop": None, "note": note}
        for _, word, describe in _GRAZING:
            if word in note:
                data.update(describe(self.problem, solution))
        return data


_FAILED = Step(False, np.empty(0), np.empty(0), (), 0.0, math.inf, 0, math.inf, math.nan, math.nan, [])
