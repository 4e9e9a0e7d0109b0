"""Families that start at a point of a curve of bifurcations or grazings, in any parameter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from branches.admissible import unphysical
from branches.curves.grazing import observed
from branches.curves.record import BifurcationCurve
from branches.forced.family import ForcedFamily, parameter_family
from branches.forced.onwards import ResponseStart
from branches.forced.primitive import primitive_orbit
from branches.forced.resequencing import with_touch, without_impact
from branches.released.family import placed
from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from transitions.response.path import ParameterPath
from transitions.response.starting import NoOrbit, settled_orbit
from transitions.sweep.settle import settle

__all__ = ["free_start_on_curve", "starts_on_curve"]

_HOLDS = 1e-9
"""Largest residual of an equation that holds at a point."""

_GRAZES = 1e-7
"""Clearance and impact speed, in units of arclength, that are zero at a point of a curve."""

_AWAY = (1e-2, 1e-3)
"""Distances in the parameter, relative, from an orbit at which a stop sticks for ever to a simulation."""

_BESIDE = (1e-3, 1e-4, 1e-5)
"""Arclengths from a grazing orbit to the start of a family: the first one that leads to an orbit."""


def starts_on_curve(curve: BifurcationCurve, index: int, path: ParameterPath, direction: str = "both") -> list[ResponseStart]:
    """The starts of the families in the parameter of a path through the orbit at a point of a curve.

    At a grazing there are several: with the impact and without it, each on the side where its orbits exist. The family of a start ends at
    the grazing, so it is followed both ways from an orbit next to it.

    Parameters
    ----------
    curve : BifurcationCurve
        Of forced orbits.
    index : int
        Of the point.
    path : ParameterPath
        The parameters that vary, in the system of the curve.
    direction : {"both", "up", "down"}
        Where families meet at a grazing: those that are above or below its parameter.

    Raises
    ------
    ValueError
        For free orbits, if the path's equations do not hold at the point, and where no orbit is next to it.
    """
    if isinstance(curve.plane.problem, ReleasedProblem):
        raise ValueError("the curve is one of free orbits; expected one of responses to periodic loads")
    problem, y = path.through(*primitive_orbit(curve.plane.problem, curve.unknowns[index, : curve.plane.size]))
    if curve.grazing is not None and curve.grazing.kind == "held":
        return _chosen(list(_opened(path, problem, y)), y, problem, direction)
    seen = observed(problem, y)
    speed, clearance = seen["speed"] / problem.units[problem.degrees_of_freedom], seen["clearance"] / problem.units[0]
    if not min(abs(speed) if problem.sequence else np.inf, abs(clearance)) < _GRAZES:
        return [_through(problem, y, direction)]
    found = [*_beside(problem, y)]
    for change in (without_impact,) if abs(speed) < _GRAZES and problem.sequence else (with_touch,):
        try:
            made = change(problem, seen)
        except EndsError:
            continue
        if made is not None:
            found += _beside(*primitive_orbit(*made))
    return _chosen(found, y, problem, direction)


def _chosen(
    found: Sequence[tuple[ForcedProblem, np.ndarray]], y: np.ndarray, problem: ForcedProblem, direction: str
) -> list[ResponseStart]:
    """The starts at orbits next to a grazing one, y (u,), on the side that is asked for. found: these orbits, each with its problem."""
    if not found:
        raise ValueError("no orbit of a family is next to this grazing")
    side = {"both": 0.0, "up": 1.0, "down": -1.0}[direction]
    kept = [(made, other) for made, other in found if side * (other[made.place] - y[problem.place]) >= 0.0]
    if not kept:
        raise ValueError(f"all families that meet at this grazing are on its other side; expected another direction than {direction}")
    return [ResponseStart(*one, "both") for one in kept]


def _opened(path: ParameterPath, problem: ForcedProblem, y: np.ndarray) -> Iterator[tuple[ForcedProblem, np.ndarray]]:
    """The orbits on which a simulation settles next to one at which a stop sticks for the whole period."""
    values, n = problem.parameters(y), problem.degrees_of_freedom
    here, node = replace(path, values=values), problem.nodes(y)[0]
    phase = 2.0 * math.pi * (float(node[2 * n]) % 1.0 % 1.0)  # 1.0 is 0
    for sign in (1.0, -1.0):
        for part in _AWAY:
            try:
                at = here.at(values[path.name] + sign * part * (abs(values[path.name]) or 1.0))
                motion = settle(at.parametric.system(at.values), at.parametric.forces(at.values), node[:n], node[n : 2 * n], phase=phase)
                found = settled_orbit(at, motion)
            except (NoOrbit, ValueError):  # the system can have other values on one side only
                continue
            yield found.problem, found.y
            break


def free_start_on_curve(
    curve: BifurcationCurve, index: int, parametric: ParametricSystem, names: Sequence[str], keep: Sequence[str], direction: str = "both"
) -> ResponseStart:
    """The start of the family of free orbits through a point of a curve, in some parameters with equations that hold at the point.

    Raises
    ------
    ValueError
        For names and equations that cannot be, or that do not hold at the point.
    """
    problem = curve.plane.problem
    assert isinstance(problem, ReleasedProblem)
    solution = placed(problem, curve.unknowns[index, : curve.plane.size])
    if solution is None:
        raise ValueError("the orbit there could not be solved for; expected another point")
    own = solution.problem
    made = ReleasedProblem(parametric, own.ends, own.sequence, names, keep, energy=own.energy(solution.y))
    y = made.of_orbit(own, solution.y)
    rows = made.residual(y) / np.where(made.scales(y)[: made.unknowns - 1] > 0.0, made.scales(y)[: made.unknowns - 1], 1.0)
    if not np.abs(rows).max() < _HOLDS:
        raise ValueError(f"{' and '.join(keep)} does not hold at the point, which has {_values(curve, index)}")
    return _through(made, y, direction)


def _values(curve: BifurcationCurve, index: int) -> str:
    known = curve.plane.values(curve.unknowns[index, : curve.plane.size])
    return ", ".join(f"{name} = {known[name]:.15g}" for name in dict.fromkeys((*curve.names, "energy", "quarter_period")))


def _through(problem: ForcedProblem, y: np.ndarray, direction: str) -> ResponseStart:
    """The start of a family at one of its orbits with its tangent: at a fold the orbit has no neighbour at its parameter."""
    step = parameter_family(problem).begin(y)
    if not step.converged:
        raise ValueError("the orbit there could not be solved for; expected another point")
    return ResponseStart(problem, step, direction)


def _beside(problem: ForcedProblem, y: np.ndarray) -> Iterator[tuple[ForcedProblem, np.ndarray]]:
    """The orbits next to a grazing one in its family, on each side where there are some."""
    family = ForcedFamily(problem)
    begin = family.begin(y)
    for sign in (1.0, -1.0) if begin.converged else ():
        turned = family.step(begin.y, sign * begin.tangent, 0.0)
        for length in _BESIDE if turned.converged else ():
            step = family.step(turned.y, turned.tangent, length)
            if step.converged and unphysical(problem, step.extra) is None and step.extra["speed"] > 0.0 and step.extra["clearance"] > 0.0:
                yield problem, step.y
                break
