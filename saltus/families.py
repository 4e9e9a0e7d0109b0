"""Families and orbits by name: the public functions `trace` and `discover`, and the choice of one orbit of a family."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bvp.checks import checked_energy_range, require_system
from bvp.resting import resting_system
from bvp.texts import shown
from saltus import catalogues, compiling
from saltus.errors import BadInput
from saltus.scene import Scene, load_scene
from saltus.terminal import ProgressBar

if TYPE_CHECKING:
    import numpy as np

    from branches.branch import Branch, BranchEvent, Ended
    from branches.catalogue import Catalogue
    from branches.catalogue.find import NameMatch
    from branches.naming.labels import Name
    from branches.orbit import Orbit
    from branches.search.orbit_search import Discovery
    from bvp.system import ImpactSystem
    from continuation.control import Settings

__all__ = [
    "agreed", "branch_of", "called", "discover", "family_named", "has_label", "impulsive_orbit", "impulsive_place", "list_orbits",
    "orbits_of", "outside_text", "select", "start_of", "trace",
]  # fmt: skip

TOLERANCE = 0.01
"""How far, relatively, a selecting value may be from the orbit that it selects."""


def trace(
    name: str | Orbit,
    system: ImpactSystem | None = None,
    *,
    scene: Scene | str | os.PathLike[str] | None = None,
    energy: tuple[float, float] | None = None,
    catalogue: Catalogue | None = None,
    points: int | None = None,
    direction: str = "both",
    stop_at: str | None = None,
    stop_when: Callable[[Orbit], bool | str] | None = None,
    on_start: Callable[..., object] | None = None,
    on_event: Callable[[BranchEvent], object] | None = None,
    on_end: Callable[[Ended], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    settings: Settings | None = None,
    reference_points: Mapping[str, Mapping[str, float]] | None = None,
    bounds: Mapping[str, Any] | None = None,
    normal_forms: bool = False,
) -> Branch:
    """Follow a family of periodic orbits, given by its name or by one of its orbits.

    Parameters
    ----------
    name : str or Orbit
        A label of Lee et al., Physica D 238 (2009) 1868, such as ``S13O00+`` or ``U8353-@h=1.9,alpha=4.9``, a family's id, or an orbit of
        any origin. An orbit has its own system.
    system : ImpactSystem, optional
        By default the system of the scene. With an orbit it can only be the orbit's own.
    scene : Scene or path-like, optional
        Gives the bounds of the search and the energy range; by default the reference scene. Its reference points hold only for its own
        system.
    energy : (float, float), optional
        Lowest and highest energy h, per clearance squared; by default those of the scene.
    catalogue : Catalogue, optional
        Where the name is looked up. Without it the family is searched.
    points : int, optional
        Largest number of points; by default not limited.
    direction : {"both", "up", "down"}
        "up": energy rises at the first step; "down": it falls; "both" (default): the family is followed both ways.
    stop_at : str, optional
        Type of event at which the family ends, such as "SB".
    stop_when : callable, optional
        Called with each orbit. The family ends where it returns True or a text, the reason.
    on_start, on_event, on_end, on_point : callable, optional
        Called with a line about the start, each event, each end, and the number of points so far.
    settings : continuation.Settings, optional
        Step sizes and tolerances.
    reference_points : mapping of names to {"h", "alpha"}, optional
        More reference points, which choose among several families with a name.
    bounds : mapping, optional
        ``energy`` (two values of h), ``quarter_period`` (time) and ``impacts`` (in half a period) in place of the scene's: where a name is
        searched.
    normal_forms : bool
        Whether SN, SB and PD get the coefficients of their normal forms, which take some milliseconds each.

    Returns
    -------
    Branch

    Raises
    ------
    ValueError
        For a name that does not parse, that no orbit or more than one family has, or options that cannot be, in one line.
    RuntimeError
        Where the family cannot be followed for numerical reasons.

    Examples
    --------
    >>> branch = trace("S13O00+", energy=(0.1, 1.0))
    >>> branch.events[0].type, round(branch.events[0].h, 10)
    ('GR', 0.1185078106)
    >>> again = trace(branch.orbit(10), energy=(0.1, 1.0))
    >>> again.label, again.id == branch.id
    ('S13O00+', True)
    """
    from branches.orbit import Orbit

    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    options: dict[str, Any] = {
        "points": points, "direction": direction, "stop_at": stop_at, "stop_when": stop_when, "on_event": on_event, "on_end": on_end,
        "on_point": on_point, "normal_forms": normal_forms, **({} if settings is None else {"settings": settings}),
    }  # fmt: skip
    energy = checked_energy_range(scene.bounds["energy"] if energy is None else energy)
    if system is not None:
        require_system(system, smooth=True)
    if isinstance(name, Orbit):
        from branches.catalogue.rows import difference
        from branches.tracing import follow_family

        differs = None if system is None else difference(name.system.describe(), system.describe())
        if differs is not None:
            raise BadInput(f"the orbit belongs to another system than the one given: there {differs}; expected its own, or none")
        if not energy[0] * (1.0 - 1e-9) <= name.h <= energy[1] * (1.0 + 1e-9):
            raise BadInput(f"the orbit has h = {name.h:.10g}, outside the energy range {energy[0]:.15g}:{energy[1]:.15g}")
        if on_start is not None:
            on_start(f"{name.label or '-'.join(name.ends)}: from h = {name.h:.10g}, alpha = {name.alpha:.10g}")
        return follow_family(name.problem, name.solution.y, energy=energy, **options)
    from branches.naming.families import trace_named

    if system is None:
        scene = scene.about_rest
        scene.require_used("saltus.trace", ("springs",))
        system = scene.system
    for option, value in (("reference_points", reference_points), ("bounds", bounds)):
        if not isinstance(value, Mapping | None):
            raise BadInput(f"{option} = {shown(value)}: expected a mapping")
    system = resting_system(system)
    reference_points = {**scene.reference_points_for(system), **(reference_points or {})}
    bounds = {**scene.bounds, **(bounds or {})}
    if catalogue is not None:
        catalogue.require_system(system.describe())
        return _follow_kept(name, catalogue, energy, reference_points, on_start, **options)
    return trace_named(name, system, energy=energy, reference_points=reference_points, bounds=bounds, on_start=on_start, **options)


def _follow_kept(
    name: str,
    catalogue: Catalogue,
    energy: tuple[float, float],
    reference_points: Mapping[str, Mapping[str, float]],
    on_start: Callable[..., object] | None = None,
    **options: Any,
) -> Branch:
    """Follow a family of a catalogue inside the range of energies. The start is its point nearest to the orbit that the name selects."""
    import numpy as np

    from branches.tracing import extend

    match = catalogue.find(name, reference_points=reference_points)
    branch = branch_of(match, name, catalogue)
    h, alpha = branch.points["h"], branch.points["alpha"]
    inside = np.flatnonzero((h >= energy[0]) & (h <= energy[1]))
    if not len(inside):
        raise BadInput(f"{name} has h = {h.min():.6g} to {h.max():.6g}, outside the energy range {energy[0]:.15g}:{energy[1]:.15g}")
    i = branch.start if branch.start in inside else int(inside[0])
    if match.h is not None and match.alpha is not None:
        i = int(inside[np.argmin(np.hypot(np.log(h[inside] / match.h), np.log(alpha[inside] / match.alpha)))])
    if on_start is not None:
        on_start(f"{branch.points['label'][i] or match.id}: point {i} of {match.id} in {catalogue.path}, from h = {h[i]:.10g}")
    return extend(branch, i, energy=energy, rising=bool(h[0] <= h[-1]), **options)


def branch_of(match: NameMatch, name: str, catalogue: Catalogue) -> Branch:
    """The family that a name means in a catalogue. A linear mode has no impacts and is refused."""
    if match.kind != "family":
        raise BadInput(f"{name} is a {match.kind}: it has no impacts; expected the name of an impacting family")
    return catalogue.branch(match.id)


def discover(
    system: ImpactSystem,
    energy: float,
    *,
    quarter_period: float = 10.0,
    impacts: int | None = None,
    ends: Sequence[str] | None = None,
    budget: int | None = None,
    catalogue: Catalogue | None = None,
) -> Discovery:
    """Find every primitive symmetric orbit at an energy, within bounds.

    Parameters
    ----------
    system : ImpactSystem
        Conservative, two degrees of freedom, one stop.
    energy : float
        h > 0, per clearance squared.
    quarter_period : float
        Longest quarter period, in units of time; by default 10.
    impacts : int, optional
        Largest number of impacts in half a period; by default not limited.
    ends : sequence of str, optional
        Pairs of ends such as ``rest-stop``. The default is ``origin-origin``, which contains the published families; in a system without
        odd symmetry, it is all pairs without an origin.
    budget : int, optional
        Largest number of starts that are followed; by default a million, or less where flights are long.
    catalogue : Catalogue, optional
        Of the same system. The result then has, for each orbit, the id of its family in the catalogue, or None.

    Returns
    -------
    branches.search.orbit_search.Discovery

    Raises
    ------
    ValueError
        For a system or bounds that cannot be searched, or a catalogue of another system.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> found = discover(vibro_impact_nes(), 0.3, quarter_period=3.0, impacts=2)
    >>> [orbit.label for orbit in found.orbits], found.families
    (['S11O00-', 'U2111-', 'S13O00+'], ())
    """
    from branches.search.discovery import discover_orbits

    if impacts == 0:
        raise BadInput("at most 0 impacts in half a period: no orbit with impacts has so few, expected 1 or more")
    system = resting_system(system)
    if catalogue is not None:
        catalogue.require_system(system.describe())
    found = discover_orbits(system, energy, quarter_period=quarter_period, impacts=impacts, ends=ends, budget=budget)
    return found if catalogue is None else replace(found, families=tuple(map(catalogue.identify, found.orbits)))


def outside_text(system: ImpactSystem) -> str:
    """What follows where the rest position is not inside the gap of the one stop; empty where it is."""
    from branches.naming.search import least_energy

    reason = system.why_not_inside()
    if reason is None:
        return ""
    least = least_energy(system)
    return f"{reason}: no linear mode exists" + (f", and no motion has less energy than h = {least:.6g}" if least else "")


def agreed(text: str, key: str, said: float | None, option: str, given: float | None) -> float | None:
    """The value that a name or an option gives. If both give one, they must agree."""
    if said is not None and given is not None and said != given:
        raise BadInput(f"{text} says {key} = {said:.10g} and {option} says {given:.10g}: expected one of them")
    return said if given is None else given


def family_named(name: str, scene: Scene, energy: float | None, arguments: argparse.Namespace) -> Branch:
    """The family from a catalogue; else traced over the scene's energies, or farther if the given energy is outside."""
    with catalogues.lookup(name, arguments, scene) as opened:
        if opened is not None:
            return branch_of(opened.find(name), name, opened)

    compiling.prepare("continue")
    low, high = scene.bounds["energy"]
    if energy is not None:
        low, high = min(low, 0.9 * energy), max(high, 1.1 * energy)
    with ProgressBar() as bar:
        return trace(name, scene=scene, energy=(low, high), on_point=bar.update)


def select(branch: Branch, name: Name, energy: float | None, alpha: float | None) -> Orbit:
    """Find the one orbit of a family with an energy, with a quarter period, or nearest to both."""
    key, value, other, wish = ("h", energy, "alpha", alpha) if energy is not None else ("alpha", alpha, "h", None)
    assert value is not None
    found = orbits_of(branch, name, energy, alpha)
    if not found:
        values = branch.points[key]
        followed = f"the family was followed from {key} = {values.min():.15g} to {values.max():.15g}"
        bounds = {event.point for event in branch.events if event.type == "EP"}
        ends = [f"end {end.text}" for point, end in zip((0, len(branch) - 1), branch.ended, strict=True) if point not in bounds]
        raise BadInput("; ".join([f"no orbit of {name} has {key} = {value:.15g}: {followed}", *dict.fromkeys(ends)]))
    if wish is not None:
        nearest = min(found, key=lambda orbit: abs(getattr(orbit, other) - wish))
        if abs(getattr(nearest, other) - wish) > TOLERANCE * wish:
            near = list_orbits([nearest], branch)
            raise BadInput(f"no orbit of {name} has {key} = {value:.10g} and {other} = {wish:.10g}; nearest: {near}")
        return nearest
    if len(found) > 1:
        raise BadInput(f"{len(found)} orbits of {name} have {key} = {value:.10g}, expected one of {list_orbits(found, branch)}")
    return found[0]


def orbits_of(branch: Branch, name: Name, energy: float | None = None, alpha: float | None = None) -> list[Orbit]:
    """The orbits of a family with an energy, or else with a quarter period, that a name can mean."""
    from branches.presentation import same_orbit

    found = branch.orbits_at(energy=energy) if energy is not None else branch.orbits_at(alpha=alpha)
    kept: list[Orbit] = []
    # A family carries several labels: where some of its orbits here have the label asked for, the others are not meant.
    for orbit in [orbit for orbit in found if has_label(orbit, name)] or found:
        mine = orbit.problem, orbit.solution.y
        # A family that folds back on itself passes through the same orbit twice, the second time from its other end.
        if not any(abs(other.alpha / orbit.alpha - 1.0) < 1e-9 and same_orbit((other.problem, other.solution.y), mine) for other in kept):
            kept.append(orbit)
    return kept


def impulsive_place(branch: Branch, name: Name, energy: float | None, alpha: float | None) -> tuple[float, float]:
    """Energy and quarter period of a family's impulsive orbit. If there are several, the given values select one.

    A family that folds back on itself passes through the same orbit twice. Both passes count as one orbit."""
    found = [event for event in branch.events if event.type == "IO"]
    found = [
        event
        for k, event in enumerate(found)
        if not any(abs(event.h / other.h - 1.0) < 1e-9 and abs(event.alpha / other.alpha - 1.0) < 1e-9 for other in found[:k])
    ]
    listed = " ".join(f"@h={event.h:.10g},alpha={event.alpha:.10g}" for event in found)
    near = [
        event
        for event in found
        if all(wish is None or abs(value / wish - 1.0) <= TOLERANCE for value, wish in ((event.h, energy), (event.alpha, alpha)))
    ]
    if len(near) != 1:
        which = "no impulsive orbit" if not found else f"{len(near)} impulsive orbits"
        asked = "" if energy is None and alpha is None else " with these values"
        raise BadInput(f"{name} has {which}{asked}{f', expected one of {listed}' if found else ''}")
    return near[0].h, near[0].alpha


def impulsive_orbit(branch: Branch, name: Name, energy: float | None, alpha: float | None) -> Orbit:
    """A family's impulsive orbit, begun where the oscillator alone moves, in the positive direction."""
    import numpy as np

    from branches.orbit import Orbit
    from branches.presentation import segment_images
    from bvp.multipoint import MultipointProblem

    h, alpha = impulsive_place(branch, name, energy, alpha)
    impulsive = (event for event in branch.events if event.type == "IO")
    orbit = branch.orbit(min(impulsive, key=lambda event: abs(event.h / h - 1.0) + abs(event.alpha / alpha - 1.0)).point)
    system, n = branch.system, branch.system.degrees_of_freedom
    start = np.zeros(2 * n)
    assert system.primary is not None  # or there were no such event
    start[n + system.primary] = math.sqrt(2.0 * h / system.mass[system.primary, system.primary])
    images = segment_images(orbit.problem, orbit.solution.y)
    image = min(images, key=lambda image: float(np.abs(system.modes.to_state @ image.start - start).max()))
    problem = MultipointProblem(system, image.ends, image.sequence)
    return Orbit(problem, problem.solve(image.unknowns(problem), energy=h))


def has_label(orbit: Orbit, name: Name) -> bool:
    """Whether an orbit has the label of a name."""
    from branches.naming.labels import parse
    from branches.naming.matching import matches

    return name.label is not None and bool(orbit.label) and matches(name.label, parse(orbit.label))


def called(name: Name, orbit: Orbit) -> str:
    """The name of the family of an orbit: the label that was asked for, or that of the orbit where an incomplete label or an id was."""
    if name.label is None or (not name.label.is_complete and has_label(orbit, name)):
        return orbit.label
    return str(name.label)


def start_of(orbit: Orbit) -> tuple[np.ndarray, np.ndarray, str | None]:
    """The displacements and velocities at the start of an orbit, and the contact that it leaves there."""
    import numpy as np

    if orbit.velocities is not None:
        return np.zeros(len(orbit.velocities)), orbit.velocities, None
    u, v = orbit.sample(np.zeros(1))
    at_impact = bool(orbit.impacts) and orbit.impacts[0].time == 0.0
    return u[0], v[0], orbit.impacts[0].stop if at_impact else None


def list_orbits(orbits: list[Orbit], branch: Branch) -> str:
    """Names that select orbits of a branch: its label or id, and a suffix with enough digits to distinguish the orbits."""
    for digits in range(6, 18):
        suffixes = {f"@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits}
        if len(suffixes) == len(orbits):
            break
    return " ".join(f"{orbit.label or branch.id}@h={orbit.h:.{digits}g},alpha={orbit.alpha:.{digits}g}" for orbit in orbits)
