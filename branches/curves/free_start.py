"""Where curves of bifurcations and of grazings of free orbits start: at an event of a family in the energy, or in a parameter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from branches.curves.free import FOLD, SYMMETRIES, Breaking, FreeKind, Symmetry, free_condition, names_quarter_period, smallest_singular
from branches.curves.free_grazing import free_grazing_at
from branches.curves.free_monitor import FreeGrazingMonitor, FreeMonitor
from branches.curves.free_points import event_of, observed_free
from branches.curves.grazing import Grazing, grazing_condition
from branches.curves.monitor import Window
from branches.curves.plane import ParameterPlane, plane_of
from branches.orbit import Orbit
from branches.presentation import canonical_orbit, is_solved_as_it_is
from branches.released.presentation import embedded_orbit, released_orbit
from bvp.description import RESERVED
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from continuation.curves import Curve, SingularCondition

__all__ = ["FREE_CURVES", "free_curve", "free_curve_start", "free_event", "released_of"]

FREE_CURVES = ("SN", "SB", "PD", "BP", "GR")
"""Events of free orbits that can be continued in two parameters."""

_SINGULAR = 1e-6
"""A matrix is singular at a located event where its smallest singular value is below this part of the next one."""


def released_of(orbit: Orbit, names: Sequence[str], parametric: ParametricSystem | None = None) -> tuple[ReleasedProblem, np.ndarray]:
    """An orbit, such as ``branch.orbit(event.point)``, as a solution with the parameters of a plane released.

    Parameters
    ----------
    orbit : Orbit
    names : sequence of str
        The parameters that vary; those among them that are of the system are released.
    parametric : ParametricSystem, optional
        The orbit's system with its parameters; by default those of its model.

    Returns
    -------
    problem, y : ReleasedProblem, (u,) ndarray

    Raises
    ------
    ValueError
        For parameters that the system lacks, or that no family of free orbits can have.
    """
    parametric = ParametricSystem.of(orbit.system) if parametric is None else parametric
    released = [name for name in names if name not in RESERVED]
    if not released:
        raise ValueError(f"{' and '.join(names)} are not both free: a plane needs a parameter of the system")
    for name in released:
        if name not in parametric.names:
            raise ValueError(f"unknown parameter {name}; expected one of {', '.join((*parametric.names, *RESERVED))}")
    keep = [*(f"{name} = {parametric.values[name]!r}" for name in released[1:]), f"energy = {orbit.h!r}"]
    problem = ReleasedProblem(parametric, orbit.ends, orbit.problem.sequence, released, keep, energy=orbit.h)
    return problem, problem.of_orbit(orbit.problem, orbit.solution.y)


def free_curve_start(
    problem: ReleasedProblem, y: np.ndarray, code: str, names: Sequence[str], keep: Sequence[str], window: Window
) -> tuple[ParameterPlane, Curve, np.ndarray]:
    """The curve through an event of a family of free orbits.

    Parameters
    ----------
    problem, y : ReleasedProblem, (u,) float
        The orbit at the event, for example from `released_of`.
    code : {"SN", "SB", "PD", "BP", "GR"}
        The type of the event.
    names, keep : sequence of str
        The parameters that vary, and equations that hold: see `branches.curves.plane.plane_of`.
    window : ((float, float), (float, float))
        Ranges of the two parameters in which the curve is followed, in the order of their names.

    Returns
    -------
    plane : ParameterPlane
        Of the orbits of the curve. They are solved between other ends than those of the family where it has more symmetry or less.
    curve : Curve
        Its monitor has the type of the curve as `code`, and of a bifurcation the `symmetry` of the critical perturbation.
    y : (u,) ndarray
        The orbit at the event, in the unknowns of the curve.

    Raises
    ------
    ValueError
        For an event that cannot be continued, and for parameters that the problem cannot have. The message says why.
    """
    if names[0] in RESERVED:  # the first parameter of a plane is one of the system
        window = window[1], window[0]
    plane, code, kind, start = free_event(problem, y, code, names, keep)
    return plane, free_curve(plane, code, kind, start, window), start


def free_event(
    problem: ReleasedProblem, y: np.ndarray, code: str, names: Sequence[str], keep: Sequence[str]
) -> tuple[ParameterPlane, str, FreeKind | Grazing, np.ndarray]:
    """What is continued at an event: the plane, the type, what is critical or grazes, and the orbit. Arguments and errors as for
    `free_curve_start`."""
    if code not in FREE_CURVES:
        raise ValueError(f"an event of type {code} has no curve of free orbits; expected one of {', '.join(FREE_CURVES)}")
    problem, y = problem.in_pieces(1, y)
    if code == "SN":
        plane, start = plane_of(problem, y, names, keep)
        return plane, "SN", FreeKind(FOLD, False, _is_in_energy(plane, start)), start
    if code == "GR":
        made, start, grazing = free_grazing_at(problem, y, observed_free(problem, y))
        plane, start = plane_of(made, start, names, keep)
        return plane, "GR", grazing, start
    found = min(_candidates(problem, y, code, names, keep), key=lambda one: round(one.singular, 10), default=None)
    if found is None or found.singular > _SINGULAR:
        raise ValueError(_why_none(problem, y, code))
    return found.plane, found.code, FreeKind(found.symmetry, found.doubled), found.y


def free_curve(plane: ParameterPlane, code: str, kind: FreeKind | Grazing, y: np.ndarray, window: Window) -> Curve:
    """A curve of free orbits as a `continuation.Problem`. y: an orbit of it. window: in the order of the plane."""
    if isinstance(kind, Grazing):
        return Curve(plane, grazing_condition(plane, kind), FreeGrazingMonitor(plane, kind, y, window))
    condition = free_condition(plane, code, kind.symmetry, kind.in_energy)
    return Curve(plane, condition, FreeMonitor(plane, code, kind.symmetry, window, kind.doubled))


def _is_in_energy(plane: ParameterPlane, y: np.ndarray) -> bool:
    """Whether the fold that an orbit is at is one in the energy, where that differs from the fold over the plane."""
    if not names_quarter_period(plane):
        return False
    at, scale = plane.linearised(y), plane.scales(y)
    sizes = [smallest_singular(free_condition(plane, "SN", in_energy=given), at, scale)[0] for given in (False, True)]
    return sizes[1] < sizes[0]


class _Candidate(NamedTuple):
    """A critical matrix at an orbit. singular: its smallest singular value, as a part of the next one. doubled: see `FreeMonitor`."""

    plane: ParameterPlane
    y: np.ndarray
    code: str
    symmetry: Symmetry
    condition: SingularCondition
    singular: float
    doubled: bool


def _candidates(problem: ReleasedProblem, y: np.ndarray, code: str, names: Sequence[str], keep: Sequence[str]) -> Iterator[_Candidate]:
    """All critical matrices of the orbit at an event, solved between its own reversals."""
    plain, at = problem.orbit_problem(y)
    if not is_solved_as_it_is(plain, at):
        plain, at = canonical_orbit(plain, at)
        problem, y = released_orbit(problem, problem.parameters(y), plain, at)
    segments: list[tuple[ReleasedProblem, np.ndarray, bool]] = [(problem, y, False)]
    if problem.quarters == 1 and code != "SB":
        segments.append((*embedded_orbit(problem, problem.parameters(y), plain, at, (0, 2)), True))
    for made, unknowns, doubled in segments:
        plane, start = plane_of(made, unknowns, names, keep)
        linearised, scale = plane.linearised(start), plane.scales(start)
        if made.structure.periodic:
            conditions = [("PD", FOLD, free_condition(plane, "PD"))]
        else:
            breaking = Breaking(plane)
            wanted = [(False, True)] if doubled else SYMMETRIES
            conditions = [(event_of(made, symmetry)[0], symmetry, breaking.condition(symmetry)) for symmetry in wanted]
        for kind, symmetry, condition in conditions:
            if code in (kind, "BP"):
                least, second = smallest_singular(condition, linearised, scale)
                yield _Candidate(plane, start, kind, symmetry, condition, least / second, doubled)


def _why_none(problem: ReleasedProblem, y: np.ndarray, code: str) -> str:
    """Why an event has no curve."""
    if code != "BP":
        return f"no perturbation that breaks a symmetry is critical at this {code}; expected the orbit at the event"
    if is_solved_as_it_is(*problem.orbit_problem(y)):
        return (
            "two families with the same symmetries cross at this branch point, and a second parameter parts them; expected SN, SB, PD or GR"
        )
    return "the other family repeats an orbit at a p:q resonance, which changes no stability; expected SN, SB, PD or GR"
