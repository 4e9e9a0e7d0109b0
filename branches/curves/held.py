"""The equations of orbits with a stop that sticks for the whole period, at the instant at which its contact force touches zero.

The sequence is that of the impacting orbits beyond: the stop opens, and is hit again. Here the flight in between has no duration, and its
equations vanish to the third order. That the contact force is least at the instant takes the place of the distance that it flies.
"""

from __future__ import annotations

import numpy as np

from branches.curves.grazing import Grazing
from branches.curves.plane import ParameterPlane
from branches.forced.closing import without_chatter
from continuation.curves import Linearised

__all__ = ["HeldSurface", "surface_of"]

_STEP = 1e-3
"""Of the difference that gives the derivatives of the force's rate by the state, in parts of the period."""


def surface_of(plane: ParameterPlane, grazing: Grazing | None, y: np.ndarray) -> ParameterPlane:
    """The equations of the orbits of a curve. y: one of them."""
    return HeldSurface(plane, y) if grazing is not None and grazing.kind == "held" else plane


class HeldSurface(ParameterPlane):
    """A surface of such orbits: a `continuation.curves.Surface`.

    Parameters
    ----------
    plane : ParameterPlane
        Of the problem that `branches.curves.grazing.held_grazing` makes.
    y : (u,) float
        One of the orbits.
    """

    def __init__(self, plane: ParameterPlane, y: np.ndarray):
        problem = without_chatter(plane.problem, y)
        super().__init__(problem, plane.names)
        self._stop = int(problem.modes.contact_stop[problem.events[0].contact])

    def linearised(self, y: np.ndarray) -> Linearised:
        """See `continuation.curves.Surface`."""
        at, problem = super().linearised(y), self.problem
        residual, rows = at.residual.copy(), at.jacobian  # a view of all rows
        size, n = problem.size, problem.degrees_of_freedom
        state = np.arange(size)
        first, gap = size + 1, 2 * size + 1
        after, before = problem.states(y)  # behind the impact, and behind the release
        stopped, place = rows[gap].copy(), residual[gap]
        # Without duration of the second flight its ends are the same state, a period apart.
        rows[first : gap + 1] = 0.0
        rows[first + state, first + 1 + state], rows[first + state, 1 + state] = 1.0, -1.0
        residual[first:gap] = before - after
        # The first flight keeps the gap and its rate: they are those of the stop.
        c = problem.gap[1, :n]
        kept = first + int(np.argmax(np.abs(c)))
        rows[kept], residual[kept] = stopped, place
        rows[kept + n] = 0.0
        rows[kept + n, 1 + n : 1 + size], residual[kept + n] = c, c @ after[n:]
        residual[gap], slopes = self._rate(problem.nodes(y)[1], problem.period(y))
        rows[gap] = 0.0
        rows[gap, first + 1 : first + 1 + size], rows[gap, first] = slopes[:size], slopes[size]
        rows[gap, problem.place :] = slopes[size + 1 :]
        return at._replace(residual=residual)

    def _rate(self, node: np.ndarray, period: float) -> tuple[float, np.ndarray]:
        """The rate of the contact force at a node of the first flight, and its derivatives by the node."""
        step = _STEP * period

        def force(time: float) -> tuple[np.ndarray, float]:
            """Derivatives by the node, and by the time."""
            place = self.problem.flown(node, time, 0, self._stop)
            return place.slopes[-1], float(place.rates[-1])

        far, near, ahead, beyond = (force(k * step)[0] for k in (-2, -1, 1, 2))
        return force(0.0)[1], (far - 8.0 * near + 8.0 * ahead - beyond) / (12.0 * step)
