"""`saltus continue NAME --in PARAMETER --keep EQUATION`: where a family of free orbits in a parameter starts."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bvp.forcing import Constant
from saltus import curves, options, starts
from saltus.errors import BadInput, refusing
from saltus.inputs import curves_in, file_and_event, is_curve_file, is_response_file, responses_in
from saltus.response_starts import check_equations, check_range, event_named, further, in_names, kept_lines, refuse_scene
from saltus.terminal import stability_word

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.forced.onwards import ResponseStart
    from branches.naming.labels import Name
    from branches.orbit import Orbit
    from branches.released.branch import ReleasedBranch
    from bvp.parameters import ParametricSystem
    from saltus.scene import Scene

__all__ = ["free_start", "limit_lines", "settles_nowhere", "wants_free_family"]

_FIXED = re.compile(r"\s*(energy|quarter_period)\s*=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})?)\s*")
_NEAR = 0.01
"""Relative distance from the energy and quarter period of a name within which an orbit is meant."""


def wants_free_family(arguments: argparse.Namespace) -> bool:
    """Whether the command line asks for a family of free orbits in a parameter."""
    start = arguments.start or ""
    source, _ = file_and_event(start)
    if is_curve_file(source):
        return curves_in(source)[0].plane.problem.ends is not None
    if arguments.parameter is None and not _free_branches(start):
        return False
    if start == "simulate" and arguments.name is None:
        return settles_nowhere(arguments)
    path = start.rpartition("@")[0] if "@" in start and not os.path.exists(start) else start
    of_a_file = bool(_free_branches(start)) or (os.path.isfile(path) and not is_response_file(path))
    return arguments.name is not None or start.startswith("mode:") or of_a_file


def settles_nowhere(arguments: argparse.Namespace) -> bool:
    """Whether the scene is conservative, under constant loads at most, so that its orbits are free ones."""
    from saltus.scene import load_scene

    scene = load_scene(arguments.scene, **options.parameters_of(arguments)).about_rest
    return scene.system.is_conservative and not scene.loads


def _free_branches(start: str) -> list[ReleasedBranch]:
    """The branches of free orbits in a file; none where it has none."""
    path, _ = file_and_event(start)
    if not is_response_file(path):
        return []
    from branches.released.branch import ReleasedBranch

    return [branch for branch in responses_in(path) if isinstance(branch, ReleasedBranch)]


def free_start(
    arguments: argparse.Namespace, report: Callable[[Sequence[str]], object]
) -> tuple[list[ResponseStart], tuple[float, float], str]:
    """The orbit from which the family is followed, the range of the parameter, and a title; `report` gets the lines about it.

    Raises
    ------
    BadInput
        For what cannot be followed.
    """
    given = _free_branches(arguments.start or "")
    if given:
        return _from_file(arguments, given)
    if is_curve_file(file_and_event(arguments.start or "")[0]):
        return _from_curve(arguments, report)
    arguments.scene_uses = ("ground", "forces", "springs")  # loads are refused below, with what to do
    scene = options.scene_of(arguments).about_rest
    what = arguments.name or f"--from {arguments.start}"
    if any(not isinstance(force, Constant) for force in scene.forces):
        from saltus.scene import LOADS

        instead = "expected --from rest or --from simulate with --in"
        raise BadInput(f"{what} is a free orbit, and the scene has {LOADS[scene.loads[0]]}; {instead}")
    why = scene.system.why_not_conservative()
    if why is not None:
        settles = scene.system.stops and scene.system.has_potential
        instead = "--from simulate with --in" if settles else "loads, and --from rest with --in"
        raise BadInput(f"families of free orbits need a conservative system: {why}; expected {instead}")
    if arguments.start == "simulate" and (arguments.begin is None or not arguments.keep):
        raise BadInput(starts.NO_STATE)
    names, keep = _names(arguments, scene)
    if arguments.range is None:
        raise BadInput("--range LO:HI is required: the range of the parameter")
    parametric = scene.parametric
    assert parametric is not None
    parametric = in_names(parametric, names)
    check_range(names[0], parametric.values[names[0]], arguments.range)
    interval = _until_limit(parametric, names[0], arguments.range)
    orbit = _orbit(arguments, scene, parametric, names, keep, report)
    report(options.rest_lines(scene))
    title = f"{orbit.label or '-'.join(orbit.ends)}, {' and '.join(keep)}"
    return [_start(parametric, orbit, names, keep, arguments.direction or "both", report)], interval, title


def _source(arguments: argparse.Namespace) -> tuple[str, str | None]:
    """The file of ``--from`` and the event in it. A name or a scene beside it is refused."""
    source, event = file_and_event(arguments.start)
    if arguments.name is not None:
        raise BadInput(f"received {arguments.name} and --from {source}; expected one of them")
    refuse_scene(arguments, source)
    return source, event


def _from_curve(
    arguments: argparse.Namespace, report: Callable[[Sequence[str]], object]
) -> tuple[list[ResponseStart], tuple[float, float], str]:
    """The family through a point of a curve. Without --keep it keeps its energy, or its quarter period in a plane with that."""
    from bvp.description import RESERVED
    from transitions.response.curve_points import free_start_on_curve

    source, place = _source(arguments)
    curve, index, name = curves.place_named(curves_in(source), source, place)
    problem, y = curve.plane.problem, curve.unknowns[index, : curve.plane.size]
    if not arguments.keep and len(arguments.parameter) == 1:
        kept = next((one for one in curve.names if one in RESERVED), RESERVED[0])
        arguments.keep = [f"{kept} = {problem.known_values(y)[kept]!r}"]
    names, keep = _names(arguments)
    parametric = in_names(problem.parametric.replaced(problem.parameters(y)), names)
    interval = curves.interval_on(curve, source, names[0], arguments.range)
    check_range(names[0], parametric.values[names[0]], interval)
    with refusing(f"{source}:{name}"):
        start = free_start_on_curve(curve, index, parametric, names, keep, arguments.direction or "both")
    report([curves.start_line(curve, index, source, name)])
    return [start], _until_limit(parametric, names[0], interval), ""


def _until_limit(parametric: ParametricSystem, name: str, interval: tuple[float, float]) -> tuple[float, float]:
    """The range in which smooth orbits are followed: in 1/n not to 0, if springs become stops there."""
    from branches.released.impact_limit import NEAREST
    from bvp.stiff_springs import stiff_limit

    low, high = interval
    if not name.startswith("1/") or not low <= 0.0 < NEAREST < high:
        return interval
    with refusing(f"--in {name} --range {low:g}:{high:g}"):
        system, _ = stiff_limit(parametric, name)
    if system is not None and low < 0.0:
        raise BadInput(
            f"--in {name} --range {low:g}:{high:g}: springs become stops at {name} = 0; expected a range from 0, or from above 0"
        )
    return interval if system is None else (NEAREST, high)


def limit_lines(branch: ReleasedBranch) -> list[str]:
    """What is printed of the impacting orbits to which a branch leads."""
    from branches.released.impact_limit import ImpactLimit, impact_limits

    lines = []
    for limit in impact_limits(branch):
        if not isinstance(limit, ImpactLimit):
            lines.append(f"note   {limit}")
            continue
        orbit, impacts = limit.orbit, len(limit.contacts)
        what = f"{orbit.label or '(no label)'}, {'-'.join(orbit.ends)}, sequence {orbit.sequence or '(none)'}"
        stable = stability_word(-1 if orbit.stable is None else int(orbit.stable))
        lines.append(f"limit  {limit.name} = 0: {what}, h = {orbit.h:.10g}, alpha = {orbit.alpha:.10g}, stable: {stable}")
        contacts = f"{impacts} contact{'s' * (impacts != 1)} at {limit.name} = {limit.value:g}"
        difference = limit.smooth.alpha - limit.scaled.alpha
        lines.append(
            f"       from {contacts}, where alpha = {limit.smooth.alpha:.10g} differs by {difference:.1e} from that with impacts at the "
            f"effective clearance {limit.clearance:.8g}"
        )
    return lines


def _names(arguments: argparse.Namespace, scene: Scene | None = None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The parameters of ``--in``, and as many equations of ``--keep``; without --keep, the energy or quarter period that a name has."""
    names, keep = tuple(arguments.parameter), tuple(arguments.keep or ())
    if not keep and len(names) == 1 and arguments.name is not None and scene is not None:
        from branches.naming.labels import parse_name
        from saltus import catalogues

        name = parse_name(catalogues.named(arguments.name, arguments, scene))
        keep = (f"energy = {name.h!r}",) if name.h is not None else (f"quarter_period = {name.alpha!r}",) if name.alpha is not None else ()
    check_equations(names, keep, len(names), ", such as --keep energy=0.8 or --keep quarter_period=1.3")
    return names, keep


def _start(
    parametric: ParametricSystem,
    orbit: Orbit,
    names: tuple[str, ...],
    keep: tuple[str, ...],
    direction: str,
    report: Callable[[Sequence[str]], object],
) -> ResponseStart:
    """The problem in which an orbit is followed, and the orbit in its unknowns."""
    from bvp.multipoint import NotConverged
    from transitions.response.tracing import orbit_start

    with refusing(), refusing("--keep", NotConverged):
        start = orbit_start(parametric, orbit, names, keep, direction)
    found = start.problem.known_values(np.asarray(start.orbit))
    report([f"start  {orbit.label or '-'.join(orbit.ends)}: from h = {found['energy']:.10g}, alpha = {found['quarter_period']:.10g}"])
    report(kept_lines(names, found, parametric.values))
    return start


def _orbit(
    arguments: argparse.Namespace,
    scene: Scene,
    parametric: ParametricSystem,
    names: tuple[str, ...],
    keep: tuple[str, ...],
    report: Callable[[Sequence[str]], object],
) -> Orbit:
    """The orbit of the family in the energy, at the scene's parameters, that fulfils the first equation for energy or quarter period."""
    from branches.naming.labels import Name, parse_name
    from bvp.description import RESERVED
    from saltus import catalogues
    from saltus.families import family_named, list_orbits, orbits_of, select, trace

    with refusing("--keep"):
        parametric.equations(keep, names, RESERVED)
    fixed = {match[1]: float(match[2]) for text in keep if (match := _FIXED.fullmatch(text))}
    energy, alpha = fixed.get("energy"), fixed.get("quarter_period")
    place = None  # the quarter period at this energy that the name gives
    for what, value in (("energy", energy), ("quarter_period", alpha)):
        if value is not None and not value > 0.0:
            raise BadInput(f"--keep {what}={value:g}: expected a value above 0")
    begin: Orbit | None = None
    if arguments.name is not None:
        text = catalogues.named(arguments.name, arguments, scene)
        name = parse_name(text)
        branch = family_named(text, scene, energy, arguments)
        # The place at another energy says which family is meant.
        place = name.alpha if name.h in (None, energy) else None
    else:
        given = starts.name_or_orbit(arguments, scene)
        assert not isinstance(given, str)
        begin = given
        name = Name(family=arguments.start)
        low, high = (f(begin.h, begin.h if energy is None else energy) for f in (min, max))
        branch = trace(begin, scene=scene, energy=(min(scene.bounds["energy"][0], 0.9 * low), max(scene.bounds["energy"][1], 1.1 * high)))
    if begin is None and (energy is not None or alpha is not None):
        if energy is None or place is not None:
            return select(branch, name, energy, alpha if energy is None else place)
        return _nearest_along(branch, orbits_of(branch, name, energy), report) or select(branch, name, energy, None)
    if energy is None and alpha is None:
        found = _crossings(branch, name, parametric, names, keep)
    else:
        found = orbits_of(branch, name, energy, alpha)
    if begin is not None and found:  # of several orbits the nearest is meant
        return min(found, key=lambda orbit: abs(np.log(orbit.alpha / begin.alpha)) + abs(np.log(orbit.h / begin.h)))
    kept = f"--keep {' '.join(keep)}"
    if not found:
        h, alphas = branch.points["h"], branch.points["alpha"]
        ends = f"h = {h.min():.8g} to {h.max():.8g}, alpha = {alphas.min():.8g} to {alphas.max():.8g}"
        raise BadInput(f"{kept}: no orbit of {name} fulfils it at the scene's parameters; the family has {ends}")
    if len(found) > 1:
        raise BadInput(f"{kept}: {len(found)} orbits of {name} fulfil it, expected one of {list_orbits(found, branch)}")
    return found[0]


def _nearest_along(branch: Branch, found: list[Orbit], report: Callable[[Sequence[str]], object]) -> Orbit | None:
    """Of several orbits of a family that was started from its name, the nearest one along the family; None if there is one at most."""
    from saltus.families import list_orbits

    if len(found) < 2:
        return None
    h, alpha, arclength = (branch.points[key] for key in ("h", "alpha", "arclength"))
    places = [arclength[np.argmin(np.abs(h / orbit.h - 1.0) + np.abs(alpha / orbit.alpha - 1.0))] for orbit in found]
    order = np.argsort(np.abs(np.array(places) - arclength[branch.start])).tolist()
    chosen, others = found[order[0]], [found[k] for k in order[1:]]
    report([f"note   of {len(found)} orbits this is the nearest to the start of the family; the others: {list_orbits(others, branch)}"])
    return chosen


def _crossings(branch: Branch, name: Name, parametric: ParametricSystem, names: tuple[str, ...], keep: tuple[str, ...]) -> list[Orbit]:
    """The orbits of a family in the energy near which the first equation that names the energy or the quarter period holds."""
    from bvp.description import RESERVED
    from bvp.programs import evaluate_program

    at = next((text for text in keep if any(word in text for word in RESERVED)), None)
    if at is None:
        raise BadInput(f"--keep: no equation names {' or '.join(RESERVED)}: an orbit of the family is not determined")
    program = parametric.equations([at], names, RESERVED)
    values = [parametric.values[one] for one in parametric.names]
    h, alpha = branch.points["h"], branch.points["alpha"]
    residual = np.array([evaluate_program(program, [*values, *place])[0] for place in zip(h, alpha, strict=True)])
    found = np.flatnonzero(residual[:-1] * residual[1:] <= 0.0)
    orbits = [branch.orbit(int(k + (abs(residual[k + 1]) < abs(residual[k])))) for k in found]
    for key, value in (("h", name.h), ("alpha", name.alpha)):
        if value is not None:
            orbits = [orbit for orbit in orbits if abs(getattr(orbit, key) / value - 1.0) < _NEAR]
    return orbits


def _from_file(arguments: argparse.Namespace, given: list[ReleasedBranch]) -> tuple[list[ResponseStart], tuple[float, float], str]:
    """The branch of a file beyond its ends, its first orbit in other parameters, or the families that begin at an event."""
    from branches.forced.onwards import ResponseStart
    from branches.released.branch import ReleasedBranch

    source, event = _source(arguments)
    branch = given[0]
    interval = arguments.range or branch.interval
    direction = arguments.direction or "both"
    if event is not None:
        from branches.released.switching import switch_released

        if arguments.parameter is not None or arguments.keep:
            kept = " and ".join(branch.problem.keep)
            raise BadInput(f"--from {arguments.start}: the family keeps {kept}; expected no --in and no --keep")
        key, at_branch, at = event_named(given, source, event)
        assert isinstance(at_branch, ReleasedBranch)
        found = switch_released(at_branch, at)
        return [ResponseStart(problem, step, direction, begins=(at_branch, at)) for problem, step in found], interval, f"{key} of {source}"
    if arguments.parameter is None:
        if arguments.keep:
            raise BadInput(f"--keep {arguments.keep[0]!r} needs --in NAME, the parameter that varies")
        return [further(one, interval, direction) for one in given], interval, ""
    names, keep = _names(arguments)
    parametric = branch.problem.parametric.replaced(branch.problem.parameters(branch.unknowns[branch.start]))
    parametric = in_names(parametric, names)
    if arguments.range is None:
        raise BadInput("--range LO:HI is required: the range of the parameter")
    interval = _until_limit(parametric, names[0], interval)
    check_range(names[0], parametric.values[names[0]], interval)
    return [_start(parametric, branch.orbit(branch.start), names, keep, direction, lambda _: None)], interval, ""
