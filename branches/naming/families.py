"""Choice of the one family that a name selects: the search finds orbits, their families are followed and compared.

A reference point never starts a family. It chooses among what was found, and its energy is one of those that are searched: at that energy
`branches.search.discovery` lists every orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from branches.branch import Branch
from branches.naming.labels import Label, Name, parse, parse_name
from branches.naming.matching import (
    REFERENCE_TOLERANCE,
    AmbiguousName,
    NameNotFound,
    fits_otherwise,
    matches,
    reference_point_of,
    remark_on_name,
    why_a_cover,
)
from branches.naming.search import (
    LEVELS,
    SMOOTH_LEVELS,
    Followed,
    Limits,
    Search,
    find_by_id,
    from_other_end,
    label_without_stops,
    passes,
    search_bounds,
)
from branches.search.discovery import discover_orbits
from branches.search.orbit_search import Found, judged
from branches.search.starts import FROM_LINEAR_MODES
from branches.tracing import SETTINGS, cut_branch, follow_family, report
from bvp.checks import checked_energy_range, require_system
from bvp.closures import EndsError, parse_end
from bvp.system import ImpactSystem

__all__ = ["resolve", "trace_named"]

CALLBACKS = ("on_event", "on_end", "on_point", "normal_forms")
"""Options of `follow_family` that do not change how a family is followed."""

DEFAULTS = {"points": None, "direction": "both", "stop_at": None, "stop_when": None, "settings": SETTINGS}
"""Options of `follow_family` that do, and their values where they are not given."""

_ROUNDING = 1e-13
"""Relative tolerance by which a start at a bound of the range of energies may lie outside it."""

_FROM_MODE = "expected saltus continue --from mode:K, the family that begins at a linear mode"


def resolve(
    text: str,
    system: ImpactSystem,
    *,
    reference_points: Mapping[str, Mapping[str, float]],
    limits: Limits,
    energy: tuple[float, float],
    followed: Followed | None = None,
) -> tuple[Found, Branch]:
    """An orbit of the family that a name selects, and the family as the search followed it.

    The search is kept to `energy`, the range in which the family will be followed. Families that it follows are added to those `followed`.

    Raises
    ------
    NameNotFound, AmbiguousName, LabelSyntaxError, ImpossibleLabelError
    ValueError
        For a system on which names cannot be searched.
    """
    followed = {} if followed is None else followed
    require_system(system, conservative="families of periodic orbits", smooth=True)
    # Labels count half-waves of an absorber and a primary from an origin on.
    has_labels = system.has_odd_symmetry and system.absorber is not None and system.primary is not None
    name = parse_name(text)
    if name.label is not None and name.label.kind == "L":
        raise NameNotFound(_linear_mode(system, name.label, has_labels))
    name = name if system.stops else label_without_stops(name)
    point = reference_point_of(text, name.label, reference_points) if name.h is None and name.alpha is None else None
    at_origin = name.family is None or name.family.startswith("origin")
    if at_origin:
        try:
            parse_end(system, "origin")
        except EndsError as error:
            raise NameNotFound(f"{text} starts at the origin: {str(error).partition('; expected')[0]}; {_by_id(system)}") from error
    if name.family is not None and (system.smooth_forces is None or not at_origin):
        orbit, branch = find_by_id(system, name, limits, energy, followed)
        found = [(orbit, branch)] if name.h is not None else _inside([(orbit, branch)], energy, lambda other: True)
        if not found:
            low, high = branch.points["h"].min(), branch.points["h"].max()
            there, asked = f"h = {low:.10g} to {high:.10g}", f"{energy[0]:.10g}:{energy[1]:.10g}"
            raise NameNotFound(f"{text} has {there}, outside the energy range {asked}")
    else:
        search = Search(system, name, limits, energy, followed)
        if name.label is not None and not has_labels:
            raise NameNotFound(
                f"{text} is a label, and labels count the half-waves of an absorber and a primary, which this system does not name; "
                "expected absorber and primary (in a scene NES and LO under [coordinates])"
            )
        label = search.name.label
        found = _at_reference_point(search, label, point) if point is not None and label is not None else []
        found = found or search.families(search.run(LEVELS)) or _passing(search, energy)
        if not found:
            raise NameNotFound(search.nothing())
    families = _select(name, found)
    if not families:
        raise NameNotFound(_elsewhere(name, found))
    if len(families) > 1 and point is not None and len(point) == 1:
        where = {"energy": point["h"]} if "h" in point else {"alpha": point["alpha"]}
        families = [(orbit, branch) for orbit, branch in families if branch.orbits_at(**where)] or families
    if len(families) > 1:
        families = _without_other_pieces(families)
    if len(families) > 1:
        listed = " ".join(f"{text.split('@')[0]}@h={f.h:.6g},alpha={f.alpha:.6g}" for f, _ in families)
        raise AmbiguousName(f"{text} matches {len(families)} families; choose one of {listed}")
    return families[0]


def trace_named(
    name: str,
    system: ImpactSystem,
    *,
    reference_points: Mapping[str, Mapping[str, float]] | None = None,
    bounds: Mapping[str, Any] | None = None,
    energy: tuple[float, float] | None = None,
    on_start: Callable[[str], object] | None = None,
    **options: Any,
) -> Branch:
    """Find the family that has a name, and follow it.

    Parameters
    ----------
    name : str
        ``LABEL[@h=..][,alpha=..]`` or a family's id.
    system : ImpactSystem
    reference_points : mapping of str to {"h", "alpha"}
        Orbits that are cited for bare names. They choose among the orbits that a search finds.
    bounds : mapping
        ``energy`` (lo, hi), ``quarter_period``, ``impacts`` (in the half period): where names are searched.
    energy : (float, float), optional
        Where the family is followed; by default the bounds' energy.
    on_start : callable, optional
        Called with a line about the orbit that was found.
    **options
        As for `branches.tracing.follow_family`. Errors are those of `saltus.trace`.
    """
    limits = search_bounds(bounds)
    energy = checked_energy_range(energy if energy is not None else limits.energy)
    followed: Followed = {}
    found, branch = resolve(name, system, reference_points=reference_points or {}, limits=limits, energy=energy, followed=followed)
    if not energy[0] * (1.0 - _ROUNDING) <= found.h <= energy[1] * (1.0 + _ROUNDING):
        raise ValueError(
            f"{name} has h = {found.h:.6g}, outside the energy range {energy[0]:.15g}:{energy[1]:.15g}; expected a range with it inside"
        )
    if on_start is not None:
        problem = found.problem
        label = (parse_name(name) if system.stops else label_without_stops(parse_name(name))).label
        remark = remark_on_name(label, found.label)
        on_start(
            f"{found.label or name}: ends {problem.ends[0]}, {problem.ends[1]}, "
            f"sequence {''.join(problem.sequence) or '(no inner impact)'}, "
            f"from h = {found.h:.10g}, alpha = {found.alpha:.10g}{remark and '; ' + remark}"
        )
    rising = bool(branch.points["h"][0] <= branch.points["h"][-1])
    callbacks = {option: options.pop(option, None) for option in CALLBACKS}
    options = {option: value for option, value in options.items() if option not in DEFAULTS or value != DEFAULTS[option]}
    if not options and rising and np.array_equal(followed[branch].solution.y, found.solution.y):
        asked = branch if branch.energy == energy else cut_branch(branch, energy)
        if asked is not None:
            return report(asked, **callbacks)
    cut = follow_family(found.problem, found.solution.y, energy=energy, rising=rising, **callbacks, **options)
    return cut.known_within(branch) if branch.energy[0] <= energy[0] and energy[1] <= branch.energy[1] else cut


def _by_id(system: ImpactSystem) -> str:
    """What is expected in place of a label, by the commands that find families of the system."""
    if system.smooth_forces is not None:
        return _FROM_MODE
    searched = system.degrees_of_freedom == 2 and len(system.stops) < 2
    return f"expected the id of a family{', which saltus discover or saltus build finds' if searched else f'; {FROM_LINEAR_MODES}'}"


def _linear_mode(system: ImpactSystem, label: Label, has_labels: bool) -> str:
    if system.smooth_forces is not None:
        other = ", or a label without impacts such as S11+" if has_labels and not system.stops else ""
        return f"{label} is a mode of a linear system, and this one has springs that are not linear; {_FROM_MODE}{other}"
    cover = why_a_cover(label, lambda root: True)
    if cover:
        return cover
    modes = system.modes
    k = 0 if label.sign == "+" else 1
    w, b = modes.frequencies[k], modes.contacts.gap[0, k]
    stop = system.stops[0]
    reach = min(abs(stop.lower), abs(stop.upper))
    expected = "expected the name of an impacting family such as S13O00+ or S11O00-" if has_labels else _by_id(system)
    return (
        f"{label} is a linear mode of frequency {w:.10g}: it has no impacts, and grazes the stops at h = "
        f"{0.5 * (w * reach / b) ** 2:.10g}; {expected}"
    )


def _passing(search: Search, energy: tuple[float, float]) -> list[tuple[Found, Branch]]:
    """Families found elsewhere within the limits, each with an orbit in a range of energies, or at the one energy of the name,
    where the search itself found none: one so narrow, or so near to grazing, that the orbits lie between its angles."""
    low, high = energy
    system, name, limits = search.system, search.name, search.limits
    if name.h is not None:
        beyond = (min(limits.energy[0], 0.9 * name.h), max(limits.energy[1], 1.1 * name.h))
        anywhere = Search(system, replace(name, h=None), limits, beyond, search.followed)
        return anywhere.families(anywhere.run(LEVELS[:1]))
    if not 0.0 < low < high < math.inf or (low <= limits.energy[0] and high >= limits.energy[1]):
        return []
    wide = Search(system, name, limits, limits.energy, search.followed)
    return _inside(wide.families(wide.run(LEVELS[:1])), energy, wide.fits)


def _inside(families: list[tuple[Found, Branch]], energy: tuple[float, float], fits: Callable[[Found], bool]) -> list[tuple[Found, Branch]]:
    """The families with an orbit that fits in a range of energies, each with that one."""
    low, high = energy
    out = []
    for found, branch in families:
        if low <= found.h <= high:
            out.append((found, branch))
            continue
        least, most = max(low, float(branch.points["h"].min())), min(high, float(branch.points["h"].max()))
        for part in (0.5, 0.1, 0.9) if least < most else ():
            candidates = branch.orbits_at(energy=least ** (1.0 - part) * most**part)
            judgements = (judged(candidate.problem, candidate.solution) for candidate in candidates)
            orbits = [orbit for orbit in judgements if isinstance(orbit, Found) and fits(orbit)]
            if orbits:
                out.append((orbits[0], branch))
                break
    return out


def _without_other_pieces(families: list[tuple[Found, Branch]]) -> list[tuple[Found, Branch]]:
    """The first piece of each family, of which a range of energies can cut several pieces. Families are followed past the range for it."""
    out: list[tuple[Found, Branch]] = []
    joined: dict[Branch, Branch] = {}

    def follows(branch: Branch, orbit: Found) -> bool:
        if branch not in joined:
            reach = branch.full_family.reach(branch.energy, math.inf)
            start = branch.orbit(branch.start).solution.y
            joined[branch] = branch if reach is None else follow_family(branch.problem, start, energy=reach[0])
        return passes(joined[branch], orbit)

    for found, branch in families:
        cut = [other for other in out if _cuts(branch) & _cuts(other[1])]
        if not any(follows(branch, other_orbit) or follows(other, found) for other_orbit, other in cut):
            out.append((found, branch))
    return out


def _cuts(branch: Branch) -> set[bool]:
    """At which bounds of its range of energies a branch is cut: False for the lowest one, True for the highest."""
    ends = [float(branch.points["h"][event.point]) for event in branch.events if event.type == "EP"]
    return {bool(k) for h in ends for k, bound in enumerate(branch.energy) if math.isclose(h, bound, rel_tol=1e-9)}


def _select(name: Name, families: list[tuple[Found, Branch]]) -> list[tuple[Found, Branch]]:
    """The families, each with its orbit at the energy or quarter period of the name's suffix, where it has one."""
    if name.h is None and name.alpha is None:
        return families
    chosen: list[tuple[float, Found, Branch]] = []
    for found, branch in families:
        orbits = branch.orbits_at(energy=name.h) if name.h is not None else branch.orbits_at(alpha=name.alpha)
        if not orbits:
            continue
        distances = [abs(orbit.alpha / name.alpha - 1.0) if name.h is not None and name.alpha is not None else 0.0 for orbit in orbits]
        distance, orbit = min(zip(distances, orbits, strict=True), key=lambda pair: pair[0])
        if distance < REFERENCE_TOLERANCE:
            same = np.allclose(orbit.solution.y, found.solution.y, rtol=1e-12, atol=1e-14)  # then the family starts at this orbit
            chosen.append((distance, found if same else Found(orbit.problem, orbit.solution, found.label), branch))
    if name.h is not None and name.alpha is not None and chosen:
        best = min(distance for distance, _, _ in chosen)
        chosen = [item for item in chosen if item[0] <= best + 1e-9]
    return [(found, branch) for _, found, branch in chosen]


def _elsewhere(name: Name, families: list[tuple[Found, Branch]]) -> str:
    """The error if the suffix of a name selects no family. It lists the values that exist, the nearest in quarter period first."""
    key, value = ("h", name.h) if name.h is not None else ("alpha", name.alpha)
    assert value is not None
    asked = ", ".join(f"{k} = {v:g}" for k, v in (("h", name.h), ("alpha", name.alpha)) if v is not None)
    text = f"no orbit {name.label or name.family} found at {asked}"
    near = [orbit for _, branch in families for orbit in (branch.orbits_at(energy=value) if key == "h" else [])]
    if near:
        near.sort(key=lambda orbit: abs(orbit.alpha - (name.alpha or 0.0)))
        there = ", ".join(f"{orbit.label or orbit.sequence}@h={orbit.h:.6g},alpha={orbit.alpha:.6g}" for orbit in near[:5])
        return f"{text}; at h = {value:g} there are {there}"
    ranges = [(float(branch.points[key].min()), float(branch.points[key].max())) for _, branch in families]
    return f"{text}; followed over {key} = " + ", ".join(f"{low:.6g}:{high:.6g}" for low, high in sorted(ranges)[:5])


def _at_reference_point(search: Search, label: Label, point: Mapping[str, float]) -> list[tuple[Found, Branch]]:
    """The family through the orbit nearest to a reference point (h, alpha), with one of its orbits in the range of energies.

    An orbit with the same label is preferred; otherwise one with the same impacts and other half-waves. The list is empty if no orbit
    is near, or if the reference point does not give both numbers.
    """
    if "h" not in point or "alpha" not in point:
        return []
    longest = min(search.limits.quarter_period, (1.0 + REFERENCE_TOLERANCE) * point["alpha"])
    most = search.limits.impacts
    if label.p is not None and label.q is not None:
        most = label.p + label.q + (label.parity == "O")
    if search.system.smooth_forces is None:
        orbits = discover_orbits(search.system, point["h"], quarter_period=longest, impacts=most).orbits
        listed = [Found(orbit.problem, orbit.solution, parse(orbit.label)) for orbit in orbits if orbit.label]
    else:
        listed = search.orbits_at(point["h"], SMOOTH_LEVELS[-1][1], longest / search.longest)
    near = [(abs(orbit.alpha / point["alpha"] - 1.0), orbit, orbit.label) for orbit in listed if orbit.label is not None]
    for fits in (matches, fits_otherwise):
        fitting = [(distance, orbit) for distance, orbit, other in near if distance < REFERENCE_TOLERANCE and fits(label, other)]
        if not fitting:
            continue
        _, found = min(fitting, key=lambda item: item[0])
        assert found.label is not None
        if label.kind == "U" and label.p is not None and label.p != found.label.p:
            found = from_other_end(found)
        return _inside(search.families([found]), search.range, lambda other: other.label is not None and fits_otherwise(label, other.label))
    return []
