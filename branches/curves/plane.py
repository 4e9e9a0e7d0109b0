"""The orbits of one impact sequence over the plane of two parameters: the surface on which curves of bifurcations lie.

The problem of a family keeps its second parameter by its last equation, "F = 0.3". Without that equation its solutions are a surface,
and its row is the derivative of the second parameter, which can be the energy or the quarter period of a free orbit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bvp.description import RESERVED
from bvp.forced import ForcedProblem
from bvp.forced_metric import position_slopes
from bvp.released import ReleasedProblem
from continuation.curves import Linearised

__all__ = ["LEAST", "ParameterPlane", "closing_block", "plane_of"]


LEAST = 1e-3
"""Least size of a state, in units of arclength."""


class ParameterPlane:
    """A surface of orbits: a `continuation.curves.Surface`.

    Parameters
    ----------
    problem : ForcedProblem
        Its last equation to keep is "NAME = value" of the second parameter.
    names : (str, str)
        The two parameters. The first one is a released parameter.

    Attributes
    ----------
    size, place : int
        u, the number of unknowns, and the place of the first parameter among them.
    domains : tuple of (float, float)
        In which each parameter can lie.
    """

    def __init__(self, problem: ForcedProblem, names: tuple[str, str]):
        self.problem, self.names = problem, names
        self.size = problem.unknowns
        self._kept_value = float(problem.keep[-1].partition("=")[2])
        self.place = problem.place + problem.released.index(names[0])
        known = problem.parametric.names
        problem.locate_domains([name for name in names if name in problem.released])
        self.domains = tuple(problem.parametric.domain(name) if name in known else (0.0, math.inf) for name in names)

    def linearised(self, y: np.ndarray) -> Linearised:
        """See `continuation.curves.Surface`. extra (u, u): the derivatives of the equations, and of the two parameters."""
        problem = self.problem
        residual = problem.residual(y)
        rows = np.empty((self.size, self.size))
        rows[:-1] = problem.jacobian(y)
        rows[-1] = rows[-2]
        rows[-2] = 0.0
        rows[-2, self.place] = 1.0
        return Linearised(y, residual[:-1], rows[:-2], self.parameters(y, residual), rows[-2:], rows)

    def parameters(self, y: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """The two parameters at y, from the residual of all equations of the problem (u - 1,)."""
        return np.array([y[self.place], residual[-1] + self._kept_value])

    def parameters_at(self, y: np.ndarray) -> np.ndarray:
        """The two parameters at the unknowns y."""
        first, released = self.problem.place, self.problem.released
        places = [first + released.index(name) for name in self.names if name in released]
        return y[places] if len(places) == 2 else self.linearised(y).parameters

    def worst(self, at: Linearised) -> float:
        """See `continuation.curves.Surface`."""
        return float(np.abs(at.residual / self.problem.scales(at.y)[: len(at.residual)]).max())

    def position(self, y: np.ndarray) -> np.ndarray:
        """The first node in the coordinates of arclength."""
        return self.problem.position(y)

    def directions(self, y: np.ndarray) -> np.ndarray:
        """Derivatives of the position, (N + 1, u)."""
        return position_slopes(self.problem, y)

    def scales(self, y: np.ndarray) -> np.ndarray:
        """See `continuation.curves.Surface`. All impacts of an orbit can be at the origin, at rest to rounding."""
        problem = self.problem
        found = problem.scales(y)
        np.maximum(problem.states(found), LEAST * problem.units[: problem.size], out=problem.states(found))
        found[found == 0.0] = 1.0
        return found

    def violation(self, y: np.ndarray) -> str | None:
        """Why the system cannot have the parameters of y."""
        return self.problem.violation(y)

    def of(self, problem: ForcedProblem, y: np.ndarray) -> tuple[ParameterPlane, np.ndarray]:
        """The surface of the orbits of another problem, with the same released parameters, over the same plane; and an orbit of it in its
        unknowns."""
        others = [name for name in problem.released if name not in self.names]
        return plane_of(problem, y, [*self.names, *others], problem.keep[:-1])

    def values(self, y: np.ndarray) -> dict[str, float]:
        """All parameters at y, and of a free orbit the energy and the quarter period."""
        return self.problem.known_values(y)


def plane_of(problem: ForcedProblem, y: np.ndarray, names: Sequence[str], keep: Sequence[str] = ()) -> tuple[ParameterPlane, np.ndarray]:
    """The surface of the orbits of a problem over two parameters, and an orbit in its unknowns.

    Parameters
    ----------
    problem : ForcedProblem
        Of a family, in any released parameters.
    y : (u,) float
        An orbit.
    names : sequence of str
        The parameters that vary. The first two span the plane; of a free orbit they can be energy and quarter_period.
    keep : sequence of str
        Equations that determine the others, as for `ForcedProblem`.

    Raises
    ------
    ValueError
        For names or equations that the problem cannot have.
    """
    known = problem.known_values(y)
    first, second = names[0], names[1]
    if first in RESERVED:
        first, second = second, first
    if first in RESERVED:
        raise ValueError(f"{first} and {second} are not both free: a plane needs a parameter of the system")
    released = [first, *(name for name in (second, *names[2:]) if name not in RESERVED)]
    for name in (first, second):
        if name not in known:
            raise ValueError(f"unknown parameter {name}; expected one of {', '.join(known)}")
    kept = [*keep, f"{second} = {known[second]!r}"]
    values = problem.parameters(y)
    made: ForcedProblem
    if isinstance(problem, ReleasedProblem):
        assert problem.ends is not None
        energy = known["energy"]
        made = ReleasedProblem(problem.parametric, problem.ends, problem.sequence, released, kept, values=values, energy=energy)
    else:
        made = ForcedProblem(
            problem.parametric, problem.sequence, released, load_periods=problem.load_periods, half=problem.half, values=values, keep=kept,
            pieces=problem.pieces,
        )  # fmt: skip
    unknowns = np.append(y[: problem.place], [values[name] for name in released])
    return ParameterPlane(made, (first, second)), unknowns


def closing_block(plane: ParameterPlane, y: np.ndarray) -> np.ndarray:
    """What lambda multiplies, (u, u): the first node, state and time, where it ends the orbit y."""
    problem = plane.problem
    found = np.zeros((plane.size, plane.size))
    first, states = problem.inner * (problem.size + 1), np.arange(problem.size)
    found[first + states, 1 + states] = -problem.closing[0]
    if problem.has_clock:
        found[:-2, 0] += problem.curvature.by_end(y)[:-1]
    return found
