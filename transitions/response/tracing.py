"""Responses of a system to its loads in a parameter: from a simulation, from rest, and behind the events of another one. And families of
free orbits in a parameter."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.onwards import MOST_BRANCHES, ResponseStart, follow_onwards, trace_start
from branches.forced.tracing import SWITCHES, switch_response
from branches.orbit import Orbit
from branches.released.branch import ReleasedBranch
from branches.released.switching import switch_released
from bvp.multipoint import NotConverged
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.resting import with_loads_in_potential
from bvp.system import ImpactSystem
from transitions.response.free import settle_free
from transitions.response.path import ParameterPath
from transitions.response.starting import Periodic, Unbounded, linear_response, settled_orbit
from transitions.sweep.settle import MOST, Settled, settle

__all__ = ["emanating_responses", "orbit_start", "rest_starts", "simulated_start", "trace_in_parameter", "trace_response"]


def rest_starts(path: ParameterPath, interval: tuple[float, float], direction: str = "both") -> tuple[list[ResponseStart], list[str]]:
    """The response without impacts at the parameter's value and at both ends of the range, and why it is no orbit where it is none.

    Raises
    ------
    ValueError
        If it is an orbit at none of them.
    """
    starts: list[ResponseStart] = []
    reasons: dict[str, str] = {}  # with and without the value
    for value in (path.values[path.name], *interval):
        try:
            at = path.at(value)
            if at.parametric.violation(at.values) is not None:
                continue
            problem, y, why = linear_response(at)
        except Unbounded as error:
            why = str(error)
        else:
            if why is None:
                starts.append(ResponseStart(problem, y, direction))
                continue
            why = f"the response without impacts at {path.name} = {value:.10g} is no orbit: {why}"
        reasons[why] = why.replace(f" at {path.name} = {value:.10g}", "")
    if not starts:
        where = f"at {path.name} = {path.values[path.name]:g} and at the ends of the range"
        raise ValueError("; ".join([f"there is no response without impacts {where}", *dict.fromkeys(reasons.values())]))
    return starts, list(reasons)


def simulated_start(
    path: ParameterPath,
    u: Any = None,
    v: Any = None,
    *,
    phase: float = 0.0,
    most: int = MOST,
    on_progress: Callable[[int], object] | None = None,
) -> tuple[Settled, Periodic]:
    """What a simulation settles to, and its orbit; the parameters are those of `settle`.

    Raises
    ------
    NoOrbit
        If it is no periodic motion that can be solved.
    """
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    if path.parametric.layout.harmonics:
        path.problem(())  # what cannot be followed is refused before the work
        settled = settle(system, forces, u, v, phase=phase % math.tau % math.tau, most=most, on_progress=on_progress)  # 2 pi is 0
    else:
        settled = settle_free(system, forces, u, v)
    return settled, settled_orbit(path, settled)


def trace_response(
    system: ParametricSystem,
    names: str | Sequence[str],
    interval: tuple[float, float],
    *,
    start: str = "simulate",
    u: Any = None,
    v: Any = None,
    phase: float = 0.0,
    keep: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
    marks: Sequence[float] = (),
    points: int | None = None,
    direction: str = "both",
    through: Collection[str] = ("LB",),
) -> list[ForcedBranch]:
    """Follow the response of a system to its loads in a parameter.

    Parameters
    ----------
    system : ParametricSystem
        Such as the `parametric` of a scene.
    names : str or sequence of str
        The parameter; or several of them, of which the first one is reported.
    interval : (float, float)
        Range of the first parameter. It contains its value.
    start : {"simulate", "rest"}
        The motion that a simulation settles to, or the response without impacts.
    u, v : (n,) array_like, optional
        Where the simulation starts; by default at rest.
    phase : float
        Phase w t at which it starts, in radians.
    keep : sequence of str
        Equations such as "F = 0.3*w**2", one less than there are parameters.
    values : mapping, optional
        Values of parameters that replace the defaults.
    marks : sequence of float
        Values of the first parameter at which events UZ are wanted.
    points : int, optional
        Largest number of points of a branch.
    direction : {"both", "up", "down"}
        How the parameter changes from the start on.
    through : collection of str
        Types of the events behind which other families are followed: of GR, SB, PD, BP and LB. By default LB alone, where impacts
        exchange their order.

    Returns
    -------
    list of ForcedBranch
        In the order in which they were followed. What was not followed is a RuntimeWarning.

    Raises
    ------
    ValueError
        For names, equations and values that cannot be, in one line.
    NoOrbit
        If the simulation does not settle on an orbit; the message says what was found.
    RuntimeError
        Where the family cannot be followed.

    Examples
    --------
    >>> from bvp.parameters import ParametricSystem
    >>> stop = {"c": [1.0], "upper": 1.0, "restitution": 0.8}
    >>> oscillator = ParametricSystem.from_description({
    ...     "parameters": {"F": 0.5, "w": 1.0}, "system": {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], "stops": [stop]},
    ...     "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}]})
    >>> branch, = trace_response(oscillator, "F", (0.01, 0.5), values={"F": 0.05}, start="rest")
    >>> [(event.type, round(event.values["F"], 12)) for event in branch.events]
    [('EP', 0.01), ('GR', 0.1)]
    """
    if start not in ("simulate", "rest"):
        raise ValueError(f"start is 'simulate' or 'rest'; received {start!r}")
    path = ParameterPath(system, [names] if isinstance(names, str) else names, keep, dict(values or {})).at()
    _require_inside(path.name, path.values[path.name], interval)
    if start == "rest":
        starts, _ = rest_starts(path, interval, direction)
    else:
        _, found = simulated_start(path, u, v, phase=phase)
        starts = [ResponseStart(found.problem, found.y, direction)]
    return _traced(starts, interval, through, {"values": tuple(map(float, marks)), "points": points})


def _parts(system: ImpactSystem) -> tuple[np.ndarray, ...]:
    """Masses, dampers, springs and stops of a system."""
    stops = np.array([(*stop.gap, stop.lower, stop.upper, stop.restitution) for stop in system.stops])
    return system.mass, system.damping, system.stiffness, stops


def _require_inside(name: str, value: float, interval: tuple[float, float]) -> None:
    if not interval[0] <= value <= interval[1]:
        raise ValueError(f"the range {interval[0]:g} to {interval[1]:g} has not the value {name} = {value:g}; expected it inside")


def orbit_start(
    system: ParametricSystem, orbit: Orbit, names: Sequence[str], keep: Sequence[str], direction: str = "both"
) -> ResponseStart:
    """The orbit near a free one that fulfils the equations; of the parameters the first one has its value.

    Raises
    ------
    ValueError
        For names and equations that cannot be.
    NotConverged
        If no orbit near it fulfils them.
    """
    problem = ReleasedProblem(system, orbit.ends, orbit.problem.sequence, names, keep, energy=orbit.h)
    try:
        return ResponseStart(problem, problem.solve(problem.of_orbit(orbit.problem, orbit.solution.y)).y, direction)
    except NotConverged as error:
        raise NotConverged(f"no orbit near {orbit.label or '-'.join(orbit.ends)} fulfils {' and '.join(keep)}: {error}") from None


def trace_in_parameter(
    orbit: Orbit,
    names: str | Sequence[str],
    interval: tuple[float, float],
    *,
    keep: str | Sequence[str],
    system: ParametricSystem | None = None,
    marks: Sequence[float] = (),
    points: int | None = None,
    direction: str = "both",
) -> ReleasedBranch:
    """Follow the family of a free orbit of a conservative system in a parameter.

    Parameters
    ----------
    orbit : Orbit
        Such as ``branch.orbit_at(energy=0.8)``.
    names : str or sequence of str
        The parameter; or several of them, of which the first one is reported.
    interval : (float, float)
        Range of the first parameter. It contains its value.
    keep : str or sequence of str
        Equations of parameters, ``energy`` and ``quarter_period`` that hold along the family, such as "energy = 0.8": as many as there are
        parameters.
    system : ParametricSystem, optional
        The orbit's system with its parameters, such as the `parametric` of a scene. Its constant loads are part of its potential energy,
        and displacements count from its position at rest. By default
        the parameters are those of its model.
    marks : sequence of float
        Values of the first parameter at which events UZ are wanted.
    points : int, optional
        Largest number of points.
    direction : {"both", "up", "down"}
        How the parameter changes from the start on.

    Returns
    -------
    ReleasedBranch
        Its `columns` are those of a family in the energy. `branch.orbit(i)` is the orbit at point i. `saltus.emanating_responses` follows
        the families that begin at one of its events.

    Raises
    ------
    ValueError
        For names, equations and systems that cannot be, in one line.
    RuntimeError
        Where no orbit fulfils the equations, or the family cannot be followed.

    Examples
    --------
    The backbone S11O00- over the mass ratio, at a fixed energy. It ends where its impact vanishes.

    >>> import saltus
    >>> orbit = saltus.trace("S11-", energy=(0.075, 1.0)).orbit_at(energy=0.1)
    >>> branch = trace_in_parameter(orbit, "mu", (0.05, 0.2), keep="energy = 0.1", points=30)
    >>> branch.name, round(float(branch.columns["h"].min()), 12), round(float(branch.columns["h"].max()), 12)
    ('mu', 0.1, 0.1)
    """
    names, keep = ([given] if isinstance(given, str) else [*given] for given in (names, keep))
    system = ParametricSystem.of(orbit.system) if system is None else with_loads_in_potential(system)
    for what, own, at in zip(("mass", "damping", "stiffness", "stops"), _parts(orbit.system), _parts(system.system()), strict=True):
        if not np.array_equal(own, at):
            raise ValueError(f"the orbit belongs to another system: its {what} differ from the defaults; expected system.replaced(..)")
    start = orbit_start(system, orbit, names, keep, direction)
    assert isinstance(start.problem, ReleasedProblem)
    _require_inside(names[0], start.problem.values[names[0]], interval)
    (branch,) = _traced([start], interval, (), {"values": tuple(map(float, marks)), "points": points})
    assert isinstance(branch, ReleasedBranch)
    return branch


def _traced(
    starts: Sequence[ResponseStart], interval: tuple[float, float], through: Collection[str], options: dict[str, Any]
) -> list[ForcedBranch]:
    unknown = sorted(set(through) - set(SWITCHES))
    if unknown:
        raise ValueError(f"families begin at events of type {', '.join(SWITCHES)}; received {', '.join(unknown)}")
    found = follow_onwards(starts, lambda start: trace_start(start, interval, **options), through=through)
    if found.left:
        found.notes.append(f"{found.left} starts were not followed: there are more than {MOST_BRANCHES} families")
    for note in found.notes:
        warnings.warn(note, RuntimeWarning, stacklevel=3)
    return found.branches


def emanating_responses(branch: ForcedBranch, event: ForcedEvent | str, *, points: int | None = None) -> list[ForcedBranch]:
    """Follow the families that begin at an event of a response, or of a family of free orbits in a parameter, in its range.

    See `saltus.trace_response` and `saltus.trace_in_parameter`.

    Parameters
    ----------
    branch : ForcedBranch or ReleasedBranch
    event : ForcedEvent or str
        One of its events, or the id of one, such as "PD1".
    points : int, optional
        Largest number of points of a branch.

    Raises
    ------
    ValueError
        For an event that the branch has not, or where no family begins.
    RuntimeError
        Where none was found.
    """
    known = {own.id: own for own in branch.events}
    name = event if isinstance(event, str) else event.id
    if name not in known:
        raise ValueError(f"the branch has no event {name}; known: {', '.join(known) or 'none'}")
    at = known[name]
    origin = f"{at.id}, {branch.name} = {at.values[branch.name]:.12g}"
    if isinstance(branch, ReleasedBranch):
        starts = [ResponseStart(problem, step, "both", origin) for problem, step in switch_released(branch, at)]
        return _traced(starts, branch.interval, (), {"points": points})
    starts = [ResponseStart(problem, step, "along", origin) for problem, step in switch_response(branch, at)]
    return _traced(starts, branch.interval, ("LB",), {"points": points})
