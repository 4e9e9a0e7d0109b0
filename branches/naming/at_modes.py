"""Choice of one family among those that begin where a linear mode touches the stops: `mode:2`, `mode:2,cover=3,origin-stop+:+-`.

`mode:K` counts the modes by rising frequency, rigid-body modes included. Alone it means the main family, with one impact at each touch of
the mode: one in half a period between equal gaps, one in a period where one side is touched. `cover=N` means the families with the period
of the N-fold cover. What follows without a key is the beginning of a family's id, and selects one of them.
With smooth forces `mode:K` means the family without impacts that begins at the mode.
In one degree of freedom, where a constant load presses the system onto a stop, `mode:1` means the family that begins at rest there.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from branches.full_family import risen
from branches.grazing.following import Neighbour
from branches.linear_modes import LinearMode, beginnings, linear_modes, resonant_modes
from branches.naming.at_events import id_without_hash
from branches.naming.at_states import FROM_STATE, orbit_near
from branches.naming.labels import most_alike
from branches.naming.matching import AmbiguousName, NameNotFound
from branches.orbit import Orbit
from branches.sequences import parse_sequence
from branches.tracing import follow_family
from bvp.multipoint import LARGEST, MultipointProblem, NotConverged, Solution, enough_pieces
from bvp.resting import Rest, has_constant_force, rest_position, resting_system
from bvp.saddles import REACHED, approached
from bvp.smooth_flights import make_flight
from bvp.system import ImpactSystem

__all__ = ["FORM", "ModeName", "orbit_at_mode", "parse_mode"]

FORM = "mode:K, mode:K,cover=N or mode:K,cover=N,ENDS:SEQUENCE"
"""What `parse_mode` reads, as messages name it."""

LOWEST = 1e-8
"""Energy at which the family of a linear mode begins where no range is given."""

SHORTEST = 1e-60
"""Time, in which no motion comes to rest, from which the quarter period is searched where the linear part does not oscillate."""

HALVED = 20
"""Times that the interval of that quarter period is halved before Newton's method."""

ATTEMPTS = 12
"""Energies that are tried there, each a tenth of the one before."""

NEAR = 0.02
"""Relative difference of periods, and square of that of states, up to which an orbit is near a linear mode."""

LISTED = 12
"""Most families that a message lists."""


@dataclass(frozen=True)
class ModeName:
    """A choice among the families that begin at a linear mode.

    Parameters
    ----------
    number : int
        Of the mode, from 1, by rising frequency.
    cover : int or None
        Of the mode's orbit; None means the main family where nothing else is said, else 1.
    family : str
        The beginning of the family's id, "" for any.

    Examples
    --------
    >>> parse_mode("mode:2,cover=3,origin-stop+:+-")
    ModeName(number=2, cover=3, family='origin-stop+:+-')
    """

    number: int
    cover: int | None = None
    family: str = ""


def parse_mode(text: str) -> ModeName:
    """Read the choice of a family at a linear mode.

    Raises
    ------
    ValueError
        With one line that names the part that cannot be read.
    """
    head, *parts = text.split(",")
    number = re.fullmatch(r"mode:([1-9][0-9]{0,8})", head)
    if number is None:
        raise ValueError(f"{head!r} is no linear mode; expected mode:1, mode:2, ..")
    cover, family = None, ""
    for part in parts:
        key, equals, value = part.partition("=")
        if equals and key == "cover" and cover is None and re.fullmatch(r"[0-9]{1,99}", value):
            cover = int(value)
        elif equals or family or not part:
            raise ValueError(f"{text}: unexpected {part!r}; expected {FORM}")
        else:
            family = part
    return ModeName(int(number[1]), cover, family)


def orbit_at_mode(text: str, system: ImpactSystem, energy: tuple[float, float] = (0.0, math.inf)) -> Orbit:
    """An orbit of the one family that a text selects, next to the mode.

    Parameters
    ----------
    text : str
        As `parse_mode` reads it.
    system : ImpactSystem
        Conservative. Under a constant load the orbit is that of the system about its position at rest (`bvp.resting`).
    energy : (float, float), optional
        The mode has to touch the stops inside.

    Raises
    ------
    NameNotFound, AmbiguousName
        A `ValueError` with one line, which lists the families that there are, each with the text that selects it.
    ValueError
        For a text that cannot be read, a mode that the system does not have, or a system that loses energy.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> orbit_at_mode("mode:1", vibro_impact_nes()).label, orbit_at_mode("mode:2,origin-stop+", vibro_impact_nes()).label
    ('S13O00+', 'S11O00-')
    """
    name = parse_mode(text)
    if has_constant_force(system):
        system = resting_system(system)
        rest = rest_position(system, np.zeros(system.degrees_of_freedom))
        if rest.pressed:
            return _above_rest(name, system, rest, energy)
    outside = system.why_not_inside()
    if outside is not None:
        raise NameNotFound(f"{text}: {outside}, so no linear mode exists; expected an orbit, as NAME or from a file")
    if system.smooth_forces is not None:
        return _smooth_orbit(name, system, energy)
    if not system.stops:
        modes = ", ".join(f"mode:{k + 1} {0.5 * math.pi / w:.10g}" for k, w in enumerate(system.modes.frequencies) if w > 0.0)
        raise NameNotFound(
            f"{text}: the system is linear and has no stops: at each energy the quarter periods are {modes or 'none'}; "
            "expected stops or springs that are not linear"
        )
    mode = _mode(name.number, system)
    low, high = energy
    if not low <= mode.energies[1] <= high:
        raise NameNotFound(
            f"mode:{name.number} touches the stops at h = {mode.energies[1]:.10g}, outside the energy range {low:.15g}:{high:.15g}; "
            "expected a range with it inside"
        )
    cover = 1 if name.cover is None else name.cover
    touches = cover * len(mode.touching().times)
    begun = beginnings(mode, cover, touches)
    found = {item: id_without_hash(system, item.ends, parse_sequence(item.sequence)) for item in begun if item.ends}
    place = f"mode:{name.number},cover={cover}"
    if not found:
        others = " and ".join(f"mode:{other.index + 1}" for other in resonant_modes(mode, cover))
        if others:
            raise NameNotFound(f"no family was found at {place}: it is in resonance with {others}; expected another mode")
        raise NameNotFound(f"no family begins at {place}: no orbit of this period next to the mode hits a stop; expected another cover")
    if name.cover is None and not name.family:
        chosen = [item for item in found if item.impacts == touches]
        missing = "no family with an impact at each touch of the stops begins at"
    else:
        family = name.family
        exact = [item for item, id in found.items() if family and family in (id, id.removesuffix(":"))]
        chosen = exact or [item for item, id in found.items() if id.startswith(family)]
        chosen = chosen or [item for item, id in found.items() if family.startswith(f"{id}:") and _full_id(item).startswith(family)]
        missing = f"no family {family} begins at"
    if not chosen:
        near = most_alike(name.family, found.values(), 3) if name.family else tuple(found.values())
        listed = ", ".join(f"{place},{id}" for id in near)
        raise NameNotFound(f"{missing} mode:{name.number}; expected one of {listed}")
    if len(chosen) > 1:
        ids = [found[item] for item in chosen]
        # Families with equal ends and sequences are told apart by the hashes of their ids, for which they are followed.
        full = [id if ids.count(id) == 1 else _full_id(item) for item, id in zip(chosen[:LISTED], ids, strict=False)]
        more = f" and {len(ids) - LISTED} more" if len(ids) > LISTED else ""
        raise AmbiguousName(f"{text} matches {len(ids)} families; choose one of {', '.join(f'{place},{id}' for id in full)}{more}")
    beside = chosen[0].beside
    assert beside is not None
    return Orbit(beside.problem, beside.problem.solve(beside.y, energy=beside.problem.energy(beside.y)))


def _above_rest(name: ModeName, system: ImpactSystem, rest: Rest, energy: tuple[float, float]) -> Orbit:
    """The orbit of lowest energy of a system that a constant load presses onto a stop, in one degree of freedom: it falls onto the stop."""
    if system.degrees_of_freedom > 1 or name != ModeName(1):
        stops = " and ".join(f"stop {system.stops[k].name}" for k, _ in rest.pressed)
        expected = "mode:1" if system.degrees_of_freedom == 1 else FROM_STATE
        raise NameNotFound(f"mode:{name.number}: at rest the system lies on {stops}, so no linear mode exists; expected {expected}")
    lowest = energy[0] if energy[0] > 0.0 else LOWEST
    orbit = orbit_near(system, [lowest / float(rest.force[0])], [0.0])
    return Orbit(orbit.problem, orbit.problem.solve(orbit.solution.y, energy=lowest))


def _smooth_orbit(name: ModeName, system: ImpactSystem, energy: tuple[float, float]) -> Orbit:
    """The orbit of lowest energy of the family of a linear mode, in a system with smooth forces."""
    if name.cover is not None or name.family:
        raise NameNotFound("a family of smooth motion begins once at each linear mode; expected mode:K alone")
    ends = ("origin", "rest") if system.has_odd_symmetry else ("rest", "rest")
    problem = MultipointProblem(system, ends, ())
    lowest = energy[0] if energy[0] > 0.0 else LOWEST
    frequencies = system.modes.frequencies
    k = name.number - 1
    if k >= len(frequencies) or not frequencies[k] > 0.0:
        if k == 0 and len(frequencies) == 1 and system.has_odd_symmetry:
            return Orbit(problem, _through_origin(problem, lowest))
        which = " or ".join(f"mode:{i + 1}" for i, w in enumerate(frequencies) if w > 0.0)
        reason = f"the system has {len(frequencies)} modes" if k >= len(frequencies) else f"mode {name.number} does not oscillate"
        searched = len(frequencies) == 2 and system.has_odd_symmetry
        expected = which or ("a family that saltus discover finds" if searched else "a system with a mode that oscillates")
        raise NameNotFound(f"mode:{name.number}: {reason} without the smooth forces; expected {expected}")
    problem = MultipointProblem(system, ends, (), _pieces_beside(problem, k))
    tried, last = lowest, NotConverged("nothing was tried")
    for _ in range(ATTEMPTS):
        try:
            solution = _beside_mode(problem, k, tried)
        except NotConverged as error:
            tried, last = 0.1 * tried, error
            continue
        return Orbit(problem, solution if tried == lowest else _risen(problem, solution, lowest, f"mode:{name.number}"))
    raise NameNotFound(f"mode:{name.number}: no orbit was found near the linear mode, down to h = {10.0 * tried:.3g} ({last})")


def _through_origin(problem: MultipointProblem, energy: float) -> Solution:
    """The orbit of an energy through the origin, in one degree of freedom, whatever its linear part. A motion that has not turned after a
    time comes to rest later; that time is doubled, then halved between."""
    flight, start = make_flight(problem.system), np.array([0.0, math.sqrt(2.0 * energy)])

    def goes_on(time: float) -> bool:
        return bool(flight.end(start, time)[1] > 0.0)

    later = SHORTEST
    while goes_on(later):
        later *= 2.0
    before = 0.5 * later
    for _ in range(HALVED):
        middle = 0.5 * (before + later)
        before, later = (middle, later) if goes_on(middle) else (before, middle)
    try:
        return problem.solve(problem.pack(start, None, [before]), energy=energy)
    except NotConverged as error:
        raise NameNotFound(f"mode:1: no motion of h = {energy:g} comes to rest ({error}); expected other energies") from error


def _pieces_beside(problem: MultipointProblem, k: int) -> int:
    """How many pieces the flight of linear mode k needs beside other modes that grow."""
    modes = problem.system.modes
    rate = math.sqrt(max(0.0, -float(modes.squares.min())))
    lasting = (1.0 if problem.ends[0] == "origin" else 2.0) * 0.5 * math.pi / float(modes.frequencies[k])
    return enough_pieces(math.exp(min(rate * lasting, LARGEST)), 1)


def _beside_mode(problem: MultipointProblem, k: int, energy: float) -> Solution:
    """The orbit of an energy beside linear mode k. NotConverged if what the mode leads to is not near it, and may be of another family."""
    w, n, origin = float(problem.system.modes.frequencies[k]), problem.system.degrees_of_freedom, problem.ends[0] == "origin"
    quarter, pieces = 0.5 * math.pi / w, problem.pieces
    lasting = quarter if origin else 2.0 * quarter
    angles = w * lasting * np.arange(pieces) / pieces - (0.5 * math.pi if origin else 0.0)
    states = np.zeros((pieces, 2 * n))
    states[:, k], states[:, n + k] = math.sqrt(2.0 * energy) * np.cos(angles) / w, -math.sqrt(2.0 * energy) * np.sin(angles)
    start = states[0]
    solution = problem.solve(problem.pack(start, states[1:], np.full(pieces, lasting / pieces)), energy=energy)
    if abs(problem.quarter_period(solution.y) / quarter - 1.0) > NEAR:
        raise NotConverged(f"the orbit of h = {energy:g} has another period than the mode")
    if np.linalg.norm(problem.start(solution.y) - start) > math.sqrt(NEAR) * np.linalg.norm(start):
        raise NotConverged(f"the orbit of h = {energy:g} has another shape than the mode")
    return solution


def _risen(problem: MultipointProblem, beside: Solution, energy: float, name: str) -> Solution:
    """The first orbit of an energy on the family of an orbit with less energy."""
    y, why = risen(problem, beside.y, energy)
    if y is not None:
        saddle = approached(problem, y)
        if saddle is None or abs(energy / saddle.h - 1.0) >= REACHED**2:
            return problem.solve(y, energy=energy)
        why = f"ends at {saddle}"
    raise NameNotFound(f"{name}: the family of the mode {why}; received {energy:g}, expected lower energies")


def _mode(number: int, system: ImpactSystem) -> LinearMode:
    """The linear mode with a number. Its reason is given where it is none that reaches a stop."""
    modes = linear_modes(system)
    found = next((mode for mode in modes if mode.index == number - 1), None)
    if found is not None:
        return found
    frequencies = system.modes.frequencies
    if number > len(frequencies):
        reason = f"the system has {len(frequencies)} modes"
    elif frequencies[number - 1] == 0.0:
        reason = f"mode {number} is a rigid-body mode, which does not come to rest"
    else:
        reason = f"mode {number} moves no gap, so it never reaches a stop"
    listed = ("one of " if len(modes) > 1 else "") + ", ".join(f"mode:{mode.index + 1}" for mode in modes)
    raise NameNotFound(f"mode:{number}: {reason}; expected {listed or 'a system with a mode that reaches a stop'}")


def _full_id(item: Neighbour) -> str:
    assert item.beside is not None
    return follow_family(item.beside.problem, item.beside.y, points=1).id
