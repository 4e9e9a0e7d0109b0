"""The equations of orbits, beside what the problems of the package hand out themselves."""

from typing import NamedTuple

import numpy as np

from bvp.closures import end_maps, parse_end
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
    """Return the units in which arclength is measured, of a problem in parameters: of (u, v), of the time, of the parameters."""
    return problem.units


class Arclength:
    """The coordinates in which arclength is measured, at the unknowns y of a problem.

    position : (m,)
    value, period : float
        The energy and the quarter period; of a problem in parameters the first two numbers that the core keeps beside the position.
    """

    def __init__(self, problem, y):
        self._core, self._y = problem.core, y
        self.position, _, self.value, self.period, _, _ = self._core.course(y, np.zeros(len(y)))

    def row(self, direction):
        """Return the row r with r . dy = <direction, change of the position along dy>."""
        return self._core.constraint_row(self._y, direction)

    def change(self, tangent):
        """Return the change of the position along a tangent, its length, and the change of the value."""
        _, out, _, _, slope, length = self._core.course(self._y, tangent)
        return out, length, slope


def fly(problem, node, time):
    """Return the end of a flight of a forced problem from a node (u, v, s, parameters), its derivatives by the node, and its rate."""
    place, size, count = problem.flown(np.array(node, float), float(time), 0), problem.size, len(problem.released)
    slopes = np.vstack([place.slopes[: size + 1], np.eye(count, size + 1 + count, size + 1)])
    return np.append(place.values[: size + 1], node[size + 1 :]), slopes, np.append(place.rates[: size + 1], np.zeros(count))


def clearance_under_loads(problem, y):
    """Return the smallest distance from a stop along an orbit of a forced problem; y need not be a solution."""
    result = problem.observed(y)
    assert result[RESULT_INDEX["gave_up"]] == 0.0
    return result[RESULT_INDEX["clearance"]]


class ChatterEnd(NamedTuple):
    """The end of infinitely many bounces: node (u, v, s, parameters), and its derivatives by the node at their begin."""

    node: np.ndarray
    derivatives: np.ndarray


def chatter_end(problem, impact, before):
    """Return where the chatter of a forced problem ends that begins with the impact at the end of a flight, from the node before it."""
    size, flight = problem.size, (impact + 1) % (problem.inner + 1)
    y = np.zeros(problem.unknowns)
    y[problem.place :], problem.instants(y)[flight], problem.states(y)[flight] = before[size + 1 :], before[size], before[:size]
    return ChatterEnd(problem.nodes(y)[flight], problem.core.begin_slopes(y, flight))
