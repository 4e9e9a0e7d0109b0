"""A family of impacting orbits as a problem of the continuation engine: steps, test functions, and the classification of events.

Connects `bvp.multipoint` (the orbits) with `continuation` (the engine). The test functions are those of a symmetric orbit's half map
phi = [[a, b], [c, d]] between its ends, equation (13): each bifurcation is a plain zero of one entry, so no event
hides in a trace that touches +-2 without crossing it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np
import saltus_core as core

from branches.admissible import GRAZING, describe_grazing
from branches.images import Image, images_within
from branches.kernels.functions import is_orbit
from branches.orbit import label_at
from branches.presentation import starts_of
from branches.solved_family import FAILED, SINGULAR, SolvedFamily, step_of
from branches.steps import CoreSteps
from bvp.closures import cycle_of
from bvp.functions import cos, log
from bvp.multipoint import MultipointProblem, Solution, lost_digits
from bvp.stability import stability
from continuation.control import Settings
from continuation.images import Symmetry
from continuation.location import Location
from continuation.problem import Advance, EventDetails, Point, Step, TestFunction

__all__ = ["Family", "RESONANCES", "SETTINGS", "multiplication"]

RESONANCES = ((1, 3), (1, 4), (2, 5), (1, 5))
"""Rotation numbers p/q of the full period whose resonances are reported."""

SETTINGS = Settings(initial_step=0.01, maximum_step=0.025, minimum_step=1e-9, target_turn=0.05, maximum_points=20000)
"""How families are followed: a step is at most a fortieth of the metric's unit, so that curves drawn through the points are smooth."""

ENDS_AND_FOLDS = 7
"""Number of test functions that come first: the fold, the branch point, grazing and the bounds of the energy."""

_SHORT = 1e-3


def multiplication(p: int, q: int) -> float:
    """Trace 2 cos(2 pi p/q) of the full-period map at a p:q resonance."""
    return 2.0 * float(cos(2.0 * math.pi * p / q))


class Family(SolvedFamily):
    """A family of orbits with given ends and sequence: a `continuation.Problem`.

    Parameters
    ----------
    problem : MultipointProblem
    energy : (float, float)
        The family ends at these energies.
    quarter_period : float
        The family ends at this quarter period.
    ends_only : bool
        Watch only for folds, branch points and ends.

    Attributes
    ----------
    tests : tuple of TestFunction
        In the order of their values in each step.
    advance : callable
        Takes blocks of steps.
    """

    def __init__(
        self,
        problem: MultipointProblem,
        energy: tuple[float, float] = (0.0, math.inf),
        quarter_period: float = math.inf,
        ends_only: bool = False,
    ):
        self.problem = problem
        tests = [
            TestFunction("SN", "crossing", False, "fold in the energy", True),
            TestFunction("BP", "crossing", False, "branch point", True, ("SN", "SB"), SINGULAR),
            *GRAZING.values(),
            TestFunction("EP", "guard", True, "lowest energy asked for"),
            TestFunction("EP", "guard", True, "highest energy asked for"),
            TestFunction("EP", "guard", True, "longest quarter period asked for"),
            TestFunction("IO", "crossing", False, "impulsive orbit at the start", False, ("LB",)),
            TestFunction("IO", "crossing", False, "impulsive orbit at the half period", False, ("LB",)),
            TestFunction("LB", "change", False, "the label changes"),
        ]
        if problem.periodic and not problem.sequence:
            tests[3] = TestFunction("EP", "guard", True, "the maximum at which the orbit starts vanishes; start from another one")
        if problem.quarters == 1:
            tests += [
                TestFunction("SB", "crossing", False, "the last reversal is broken"),
                TestFunction("SB", "crossing", False, "half-period symmetry breaks, the reversal about the start stays"),
                TestFunction("SB", "crossing", False, "half-period symmetry breaks, the reversal about the far end stays"),
                TestFunction("PD", "crossing", False, "period doubling"),
            ]
        elif problem.quarters == 2:
            tests += [
                TestFunction("SB", "crossing", False, "the last reversal is broken"),
                TestFunction("PD", "crossing", False, "period doubling, the reversal about the start stays"),
                TestFunction("PD", "crossing", False, "period doubling, the reversal about the far end stays"),
            ]
        else:
            tests += [TestFunction("PD", "crossing", False, "period doubling")]
        if problem.periodic or not problem._two_dof:
            words = "Krein collision: two pairs of multipliers meet and leave the unit circle, or come back"
            tests += [TestFunction("NS", "crossing", False, words)]
        # Of a quarter the trace +-2 cos(pi p/q) of the half map composed with u -> -u is followed: that of the full period, its square
        # less 2, passes a level twice where the former passes zero.
        if problem.quarters == 1:
            self._resonant = [(p, q, sign * cos(math.pi * p / q)) for p, q in RESONANCES for sign in (2.0, -2.0)]
        else:
            self._resonant = [(p, q, multiplication(p, q)) for p, q in RESONANCES]
        tests += [TestFunction("RT", "crossing", False, f"{p}:{q} resonance") for p, q, _ in self._resonant]
        self._computed = len(tests)
        self.tests = tuple(tests[:ENDS_AND_FOLDS] if ends_only else tests)
        self.advance: Callable[..., Advance] | None = self._advance
        bounds = (*energy, quarter_period)
        low, high, longest = (log(bound) if 0.0 < bound < math.inf else math.copysign(math.inf, bound - 1.0) for bound in bounds)
        self._limits = low, high, longest, core.SMOOTH_TANGENT_NOISE if problem.is_smooth else core.TANGENT_NOISE
        self._targets = [level for _, _, level in self._resonant]

    def _steps_of(self, problem: MultipointProblem) -> CoreSteps:
        """What takes steps along a family of a problem with its test functions."""
        return CoreSteps(problem, self.tests[: self._computed], self._limits, self._targets, self._computed)

    @cached_property
    def _steps(self) -> CoreSteps:
        return self._steps_of(self.problem)

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`. One compiled call takes the step and computes the test functions."""
        block = self._block(1)
        if not self._steps.step(y, tangent, ds, block):
            return FAILED
        solution = Solution(*(array[0] for array in block[:5]))
        return step_of(solution, solution.result.tolist(), block.tests[0, : len(self.tests)].tolist())

    def _step(self, solution: Solution | None) -> Step:
        if solution is None:
            return FAILED
        result = solution.result.tolist()
        if not is_orbit(result):
            return FAILED
        return step_of(solution, result, self._steps.values(solution)[: len(self.tests)])

    def why_not_flown(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        """Why a step along the family fails where a flight cannot be computed; empty where it does not fail, or for another reason."""
        return "" if not self.problem.is_smooth or self.step(y, tangent, ds).converged else self.problem.orbits.why_not_flown()

    def failure(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        """Where steps fail: the energy and the quarter period reached; why a flight cannot be computed, or not to enough digits."""
        limit = self.why_not_flown(y, tangent, ds) or lost_digits(self.problem, y)
        return f"at h = {self.problem.energy(y):.6g}, alpha = {self.problem.quarter_period(y):.6g}" + (f": {limit}" if limit else "")

    def symmetries(self, y: np.ndarray) -> list[Symmetry]:
        """See `continuation.Problem`."""
        problem = self.problem
        starts = starts_of(cycle_of(problem, y)) if problem.periodic else 1
        return [partial(image.unknowns, problem) for image in images_within(problem, starts) if image != Image(False, False)]

    def sizes(self, y: np.ndarray) -> np.ndarray:
        """See `continuation.Problem`."""
        return self.problem.scales(y)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is, in the terms of the record."""
        test = self.tests[index]
        solution: Solution = at.extra
        data: dict[str, Any] = {"stop": None, "p_q": None, "breaks": None, "note": test.label}
        code = test.code
        counted: Solution = location.low.extra
        if code in ("GR", "IO"):
            counted = self._near(before, before.step, location.s, -1)
        if code == "GR":
            verb = next(verb for verb, kind in GRAZING.items() if kind == test)
            data.update(describe_grazing(getattr(solution, "problem", self.problem), solution, verb))
        elif code == "SB":
            data["breaks"] = "reversal" if "last" in test.label else "half-period symmetry"
        elif code == "NS" and not self._is_krein_collision(solution):
            return None
        elif code == "RT":
            data["p_q"] = list(self._resonant[index - self._computed][:2])
        on_sides = [counted]
        if code == "LB":
            on_sides.append(location.high.extra)
        elif code == "IO":
            on_sides.append(self._near(before, after.step, location.s, 1, after.step_size if location.s > 0.0 else 0.0))
        sides = [(str(label_at(self.problem, one.result) or ""), max(1, int(one["waves_absorber"]))) for one in on_sides]
        if code == "LB" and sides[0] == sides[1]:
            return None
        if len(sides) > 1:
            data["sides"] = tuple(sides)
        data["label"], data["half_waves"] = sides[0]
        return EventDetails(code, test.terminal, data)

    def _is_krein_collision(self, solution: Solution) -> bool:
        """Whether the two pairs of multipliers that are nearest to each other are on the unit circle: they can meet elsewhere, too."""
        problem, solution = self.orbit_of(solution)
        found = stability(problem, solution)
        nu = 0.25 * (found.tau - 2.0) if problem.periodic else found.nu
        first, second = np.triu_indices(len(nu), 1)
        apart = np.abs(nu[first] - nu[second])
        nearest = int(np.argmin(apart))
        return bool(-1.0 < 0.5 * (nu[first] + nu[second])[nearest].real < 0.0)

    def orbit_of(self, solution: Solution) -> tuple[MultipointProblem, Solution]:
        """The problem that a solution belongs to, with it."""
        return self.problem, solution

    def _near(self, before: Point, otherwise: Step, place: float, way: int, room: float = math.inf) -> Solution:
        """The orbit a little before (-1) or after (1) an event, else that of a neighbouring step.

        At grazing a turning point meets an impact, and at an impulsive orbit a velocity is zero. There rounding decides the counts.
        """
        offset = max(1e-7, _SHORT * place)
        if (way < 0 and place > 2.0 * offset) or (way > 0 and place < room - 2.0 * offset):
            near = self.step(before.step.y, before.step.tangent, place + way * offset)
            if near.converged:
                found: Solution = near.extra
                return found
        solution: Solution = otherwise.extra
        return solution

    def grazing(self, note: str, solution: Solution) -> dict[str, Any]:
        """What `classify` gives for the grazing of an orbit, from the note of its image."""
        data: dict[str, Any] = {"stop": None, "note": note}
        for verb in GRAZING:
            if verb in note:
                data.update(describe_grazing(self.problem, solution, verb))
        return data
