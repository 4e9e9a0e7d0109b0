"""From a bifurcation of a branch onto the families that are born there or cross there.

At a branch point both families solve the same multipoint problem. Where a symmetry breaks or the period doubles, the new family solves
another one - a longer segment between other ends, or the periodic closure - of which the old family is a solution too, and the event a
branch point of it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from branches.branch import Branch, BranchEvent
from branches.family import Family
from branches.tracing import follow_family
from branches.words import PERIODIC
from bvp.cycle import cycle_of
from bvp.kernels.metric import locate, metric_direction
from bvp.kernels.newton import set_scale
from bvp.multipoint import MultipointProblem
from continuation.problem import Step
from continuation.switching import SwitchError, branch_directions

__all__ = ["embed", "switch"]

DISTANCE = 0.01
"""Arclength from the event to the first orbit looked for on a new family; halved where there is none."""

_GAP = 1e-6
"""Singular values below this fraction of the largest count as zero at a located bifurcation."""


def switch(branch: Branch, event: BranchEvent, **options: Any) -> list[Branch]:
    """The families born or crossed at an event, each followed away from it.

    Parameters
    ----------
    branch : Branch
    event : BranchEvent
        Of type BP, SB or PD.
    **options
        As for `branches.tracing.follow_family`.

    Returns
    -------
    list of Branch
        One for each side; at an SB or PD the two are images of each other under the broken symmetry.

    Raises
    ------
    ValueError
        For an event of another type.
    RuntimeError
        Where no orbit of a new family is found next to the event.
    """
    if event.type not in ("BP", "SB", "PD"):
        raise ValueError(f"{event.id} is of type {event.type}; switching starts from BP, SB or PD")
    problem = branch.problem
    out = []
    if event.type == "BP":
        at = branch.unknowns(event.point)
        known = branch.unknowns(min(event.point + 1, len(branch) - 1)) - branch.unknowns(max(event.point - 1, 0))
        try:
            directions = list(branch_directions(Family(problem), at, known)[:2])
        except SwitchError as error:
            raise RuntimeError(f"no second family at {event.id}: {error}") from error
        out += _follow(problem, at, directions, options)
    else:
        here = problem.step(branch.unknowns(event.point), np.zeros(2 * problem.unknowns), 0.0)
        if here is None:
            raise RuntimeError(f"the orbit at {event.id} could not be corrected")
        for window in _windows(problem, event):
            stretch = embed(problem, here.y, window)
            wide = MultipointProblem(problem.system, stretch.ends, stretch.word)
            nudge = 1e-6 * here.tangent[: problem.unknowns]
            ahead, behind = (embed(problem, here.y + sign * nudge, window).unknowns(wide) for sign in (1.0, -1.0))
            y = stretch.unknowns(wide)
            out += _follow(wide, y, _across(wide, y, ahead - behind, event), options)
    if not out:
        raise RuntimeError(f"no orbit of a new family was found next to {event.id}")
    return out


def _follow(problem: MultipointProblem, y: np.ndarray, directions: list[np.ndarray], options: dict[str, Any]) -> list[Branch]:
    family = Family(problem)
    steps = [_first(family, y, direction) for direction in directions]
    return [follow_family(problem, step, direction="along", **options) for step in steps if step is not None]


def _windows(problem: MultipointProblem, event: BranchEvent) -> list[tuple[int, int] | int]:
    """The stretches of the old orbit that the new families are solved on: (first, last) in segments, or a number of periods that
    close on themselves."""
    if problem.periodic:
        return [2]
    if event.breaks == "reversal":
        return [1]
    if event.type == "PD" and problem.quarters == 1:
        return [(0, 4), (1, 5)]
    return [(0, 2)] if "about the start" in (event.note or "") else [(1, 3)]


class Stretch(NamedTuple):
    """A stretch of an orbit: its ends, inner contacts, start state, the states after its inner impacts, flight times."""

    ends: tuple[str, str]
    word: tuple[str, ...]
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray

    def unknowns(self, problem: MultipointProblem) -> np.ndarray:
        """The stretch as unknowns of a problem with its ends and word."""
        return problem.pack(self.start, self.nodes, self.times)


def embed(problem: MultipointProblem, y: np.ndarray, window: tuple[int, int] | int) -> Stretch:
    """The orbit y over a window of its time (see `_windows`)."""
    cycle = cycle_of(problem, y)
    count = len(cycle.duration)
    if isinstance(window, int):
        word = cycle.letters * window
        nodes = np.tile(cycle.after, (window, 1))
        return Stretch(PERIODIC, word, nodes[0], nodes[1:], np.tile(cycle.duration, window))
    length = float(np.sum(problem.flight_times(y)))
    first, last = window[0] * length, window[1] * length
    turns = range(2 + math.ceil(last / cycle.period))
    instants = np.concatenate([cycle.times + turn * cycle.period for turn in turns])
    slack = 1e-9 * cycle.period
    inner = [i for i in range(len(instants)) if first + slack < instants[i] < last - slack]
    ends = []
    for segment, time in zip(window, (first, last), strict=True):
        kind = problem.ends[segment % 2]
        if kind.startswith("stop"):
            kind = "stop" + cycle.letters[int(np.argmin(np.abs(instants - time))) % count]
        ends.append(kind)
    if ends[0].startswith("stop"):
        start = cycle.after[int(np.argmin(np.abs(instants - first))) % count]
    else:
        u, v = cycle.sample(np.array([first]))
        start = problem.modes.from_state @ np.concatenate([u[0], v[0]])
    stamps = np.concatenate([[first], instants[inner], [last]])
    word = tuple(cycle.letters[i % count] for i in inner)
    return Stretch((ends[0], ends[1]), word, start, cycle.after[[i % count for i in inner]], np.diff(stamps))


def _across(wide: MultipointProblem, y: np.ndarray, known: np.ndarray, event: BranchEvent) -> list[np.ndarray]:
    """Both directions of the null space of the Jacobian that are not those of the known family."""
    scale = _scales(wide, y)
    _, singular, rows = np.linalg.svd(wide.jacobian(y) * scale)
    if singular[-1] > _GAP * singular[0]:
        raise RuntimeError(
            f"{event.id} is no bifurcation of the wider problem: its smallest singular value is {singular[-1] / singular[0]:.1e}"
        )
    null = rows[-2:]
    along = null @ (known / scale)
    across = np.array([-along[1], along[0]]) / np.hypot(along[0], along[1])
    direction = (across @ null) * scale
    return [direction, -direction]


def _scales(problem: MultipointProblem, y: np.ndarray) -> np.ndarray:
    """Sizes of the unknowns: displacements, velocities, times."""
    problem.residual(y)
    problem._factor.before[:] = problem.end_states(y)
    set_scale(problem.segment, np.ascontiguousarray(y), problem._factor)
    return problem._factor.scale.copy()


def _first(family: Family, y: np.ndarray, direction: np.ndarray) -> Step | None:
    """A corrected orbit at a small distance in a direction, with its tangent pointing on."""
    problem = family.problem
    position, change = np.empty((2, problem.size + 2))
    energy, alpha = locate(problem.segment, y, position)
    _, length = metric_direction(problem.segment, y, position, energy, alpha, np.ascontiguousarray(direction), change)
    if length == 0.0:
        return None
    tangent = np.concatenate([direction / length, np.zeros(problem.unknowns)])
    ds = DISTANCE
    for _ in range(20):
        step = family.step(y, tangent, ds)
        near = step.converged and np.linalg.norm(np.asarray(step.position) - position) < 2.0 * ds
        if near and step.turn > 0.8:
            solution = step.extra
            if solution["clearance"] > 0.0 and solution["speed"] > 0.0 and solution["flight"] > 0.0:
                return step
        ds *= 0.5
    return None
