"""The equations of orbits, beside what the problems of the package hand out themselves."""

from typing import NamedTuple

import numpy as np

from bvp.closures import end_maps, parse_end
from bvp.kernels import step
from bvp.kernels.forced import set_parameters
from bvp.kernels.loaded_paths import forced_observe
from bvp.kernels.summed_chatter import sum_chatter
from bvp.multipoint import RESULT_INDEX

__all__ = [
    "Arclength", "ChatterEnd", "Equations", "chatter_end", "clearance_under_loads", "fly", "units",
]  # fmt: skip


class Equations:
    """What the equations of an orbit are made of, in modal coordinates: for N = 2 n entries a state and k inner nodes.

    gap, gap_rate, push (k + 2, N), jump, bound (k + 2,) : of the contact at each node, then at the far end, then at the start; zero
        where there is none. An impact takes z to z - jump push (gap_rate . z).
    start_map (N, s), start_offset (N,) : states at the start
    end_map (c, N), end_offset (c,) : the condition at the far end
    weights (N,) : h = sum(weights z^2)/2
    """

    def __init__(self, problem):
        modes, contacts = problem.modes, problem.modes.contacts
        at = np.array(problem.contacts)
        hit = at >= 0
        self.gap, self.gap_rate, self.push = (rows[at] * hit[:, None] for rows in (contacts.gap, contacts.rate, contacts.push))
        self.jump, self.bound = (np.where(hit, values[at], 0.0) for values in (1.0 + contacts.restitution, contacts.bound))
        start, end = (parse_end(problem.system, end) for end in problem.ends)
        self.start_map, self.start_offset = end_maps(modes, *start)[:2]
        self.end_map, self.end_offset = end_maps(modes, *end)[2:]
        self.weights = np.concatenate([modes.squares, np.ones(problem.half)])


def units(problem):
    """Return the units of a node's entries in which arclength is measured, of a problem in parameters."""
    return problem.segment.scale


class Arclength:
    """The coordinates in which arclength is measured, at the unknowns y of a problem.

    position : (m,)
    value, period : float
        The energy and the quarter period; of a problem in parameters the first two numbers that the core keeps beside the position.
    """

    def __init__(self, problem, y, entries):
        self._orbits, self._segment = getattr(problem, "orbits", None), getattr(problem, "segment", None)
        self._y = y
        if self._orbits is not None:
            self.position, _, self.value, self.period, _, _ = self._orbits.core.course(y, np.zeros(len(y)))
        else:
            self.position = np.empty(entries)
            self.value, self.period = step.locate(self._segment, y, self.position)

    def row(self, direction):
        """Return the row r with r . dy = <direction, change of the position along dy>."""
        if self._orbits is not None:
            return self._orbits.core.constraint_row(self._y, direction)
        row = np.empty(len(self._y))
        step.constraint_row(self._segment, self._y, self.value, self.period, self.position, direction, row)
        return row

    def change(self, tangent):
        """Return the change of the position along a tangent, its length, and the change of the value."""
        if self._orbits is not None:
            _, out, _, _, slope, length = self._orbits.core.course(self._y, tangent)
            return out, length, slope
        out = np.empty(len(self.position))
        slope, length = step.metric_direction(self._segment, self._y, self.position, self.value, self.period, tangent, out)
        return out, length, slope


def fly(problem, node, time):
    """Return the end of a flight of a forced problem from a node (N,), its derivatives by the node (N, N), and its rate (N,)."""
    set_parameters(problem.segment, np.array(node, float))
    return problem.flown(np.array(node, float), float(time), 0)


def clearance_under_loads(problem, y):
    """Return the smallest distance from a stop along an orbit of a forced problem; y need not be a solution."""
    problem.residual(y)
    result = np.full(len(RESULT_INDEX), np.nan)
    forced_observe(problem.segment, problem._watched, np.array(y), problem._factor.before.copy(), problem._nothing, result)
    assert result[RESULT_INDEX["gave_up"]] == 0.0
    return result[RESULT_INDEX["clearance"]]


class ChatterEnd(NamedTuple):
    """The end of infinitely many bounces: node (N,), derivatives by the node at their begin (N, N), and an error estimate."""

    node: np.ndarray
    derivatives: np.ndarray
    error: float


def chatter_end(problem, impact, before):
    """Return where the chatter of a forced problem ends that begins with an impact, from the node before it."""
    after = np.empty(len(before))
    set_parameters(problem.segment, before)
    sum_chatter(problem.segment, impact, before, after)
    chatter = problem.segment.sticking.chatter
    return ChatterEnd(after, chatter.slope[impact].copy(), float(chatter.error[impact]))
