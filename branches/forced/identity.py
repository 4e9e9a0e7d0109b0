"""The identity of a family of orbits in a parameter: its closure, its impact sequence, and the events at which it ends or folds.

The id of a family is `closure:sequence:hash`, as that of a conservative family is `ends:sequence:hash`. It depends neither on where a run
starts, nor on its direction, its steps and its range: a family is identified by what it has in a window of the parameter, whatever was
followed of it. It is followed there past the ends of a cut branch. Of its grazing ends the one with the lowest value of the parameter
identifies it; without one its lowest fold, then its lowest branch point; without any the orbits at which it leaves the window. Where it
leaves the window nowhere its lowest break of symmetry or period doubling does. Only without these it is the last orbits before steps fail:
such a place is one of rounding, and the id then depends on the start.

Images of one orbit are one orbit: begun at another impact, or a period of the loads later; and the mirror image x(t) -> -x(t + pi/w)
of an odd system under odd loads. So are an orbit and its repetition, and an orbit with x(t + T/2) = -x(t) and the half of it that is
solved.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.family import SETTINGS
from branches.forced.along_parameters import unbounded
from branches.forced.closing import with_exact_ends
from branches.forced.family import parameter_family
from branches.forced.primitive import is_odd, primitive_orbit
from branches.full_family import FamilyMark, connected_part, digests
from branches.released.presentation import canonical_names, free_invariants, order_of
from bvp.contact_sequence import OPENS, joined_sequence
from bvp.description import BASE
from bvp.forced import ForcedProblem
from bvp.released import ReleasedProblem
from continuation.problem import EndReason
from continuation.run import follow_both_ways

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch

__all__ = ["FullResponse", "canonical_letters", "closure_name", "full_response", "impact_flux", "invariants", "window_of"]

WINDOW = 100.0
"""A family is looked for up to this factor above and below the scale of its parameter."""

_SMOOTH_WINDOW = 10.0
"""The same factor beside smooth forces: no impact ends a family there, and each point takes longer."""

_SLOWEST = 0.2
"""Lowest base frequency of the window beside smooth forces, in units of the scale: below it superharmonic resonances crowd."""

_TIE = 1e-8
"""Relative difference below which values of a parameter are equal."""

_ZERO = 1e-9
"""Value of a parameter, beside its scale, that counts as zero."""

_SLOW = 1e-6
"""Speed of an impact that grazes, in the unit of velocities: a located grazing has about 1e-12."""

_BESIDE = 1e-6
"""Distance from a branch point, beside the scale of the parameter, within which a fold is that of this point."""

_SLACK = 1e-3
"""Part by which a range is widened beyond the points of a coarse curve."""


def closure_name(problem: ForcedProblem) -> str:
    """The closure in an id: "period-2", "half-period-1", or "free-period" without harmonic loads; of free orbits of conservative systems
    their ends, "origin-stop+"."""
    if isinstance(problem, ReleasedProblem):
        return canonical_names(problem)[0]
    if not problem.has_clock:
        return "free-half-period" if problem.half else "free-period"
    return f"{'half-' if problem.half else ''}period-{problem.load_periods}"


def canonical_letters(problem: ForcedProblem) -> str:
    """The impact sequence in an id: of all images of an orbit, the first one in the order of the alphabet."""
    if isinstance(problem, ReleasedProblem):
        return canonical_names(problem)[1]
    sequence = list(problem.sequence)
    mirror = [problem.mirrored(symbol) for symbol in sequence] if is_odd(problem) else []
    full = [sequence + (mirror if problem.half else [])]
    full += [mirror + (sequence if problem.half else [])] if mirror else []
    begins = [(one, k) for one in full for k in range(len(one) or 1) if not one or not one[k].endswith(OPENS)]
    return min(joined_sequence((one[k:] + one[:k])[: len(sequence)]) for one, k in begins)


def invariants(problem: ForcedProblem, y: np.ndarray) -> np.ndarray:
    """Numbers of an orbit that no image changes, (5,): the parameter, the period, two sums over the phases of the impacts, and the root
    mean square of their speeds, in which each stop has a weight. Of a free orbit, which has no phase, the pattern of its impacts and the
    energy are in place of the sums. Without impacts, beside smooth forces, they are root mean squares of displacements and velocities at
    each half period of the loads."""
    if isinstance(problem, ReleasedProblem):
        return free_invariants(problem, y)
    value = float(y[problem.place])
    nodes = problem.nodes(y)[: len(problem.sequence)]
    # A period of the loads, and half of one, change twice the phase by whole turns.
    angles = 4.0 * math.pi * problem.load_periods * nodes[:, 2 * problem.degrees_of_freedom] if problem.has_clock else np.zeros(len(nodes))
    if not len(nodes):
        return np.array([value, problem.period(y), *(_root_mean_squares(problem, y) if problem.is_smooth else (0.0, 0.0)), 0.0])
    square = np.average(problem.impact_speeds(y) ** 2, weights=_weights(problem))
    return np.array([value, problem.period(y), np.mean(np.cos(angles)), np.mean(np.sin(angles)), np.sqrt(square)])


def _weights(problem: ForcedProblem) -> np.ndarray:
    """A weight of the stop of each impact: orbits of alike parts that do not interact can differ by which part moves in what way."""
    return np.asarray(np.sqrt(1.0 + problem.modes.contact_stop[np.roll(problem.contacts[:-1], 1)]))


def impact_flux(problem: ForcedProblem, y: np.ndarray) -> float:
    """The sum of the squared impact speeds over the period, in which each stop has a weight; 0 without impacts, and where all graze.

    It is one number of the orbit at an event in the unknowns of all families that meet there."""
    speeds = problem.impact_speeds(y)
    if not np.max(speeds, initial=0.0) > _SLOW * problem.units[problem.degrees_of_freedom]:
        return 0.0
    return float(_weights(problem) @ speeds**2) * (2.0 if problem.half else 1.0) / problem.period(y)


def _resultant(problem: ForcedProblem, y: np.ndarray) -> float:
    """Of an orbit that hits several stops: modulus of the sum of its weighted impact speeds as vectors that turn once in the solved
    segment, over the fastest one; 0 of others, and where all impacts graze. Families of parts that do not interact can share the rest."""
    weights, times = _weights(problem), problem.flight_times(y)
    if len(set(weights.tolist())) < 2 or not impact_flux(problem, y):
        return 0.0
    speeds, turns = problem.impact_speeds(y), np.exp(2j * math.pi * (np.cumsum(times) - times) / np.sum(times))
    return float(abs(weights * speeds @ turns) / (weights.sum() * speeds.max()))


def _root_mean_squares(problem: ForcedProblem, y: np.ndarray) -> list[float]:
    """Of the displacements and the velocities, at each half period of the loads. Images of an orbit exchange these states."""
    n = problem.degrees_of_freedom
    states = problem.cut(y, problem.load_periods * (1 if problem.half else 2))[0]
    return [float(np.sqrt(np.mean(part**2))) for part in (states[:, :n], states[:, n:])]


def window_of(problem: ForcedProblem) -> tuple[float, float]:
    """The range of the parameter in which a family is identified.

    It is `WINDOW` times a scale (beside smooth forces a tenth of that), upwards and downwards: for the base frequency the largest natural
    frequency, for another parameter its value in the scene; both rounded to a power of ten, so that small changes of them do not matter.
    A response with smooth forces is identified above a fifth of the scale of the base frequency.
    """
    name, parametric = problem.released[0], problem.parametric
    size = float(np.sqrt(np.abs(parametric.system().modes.squares).max())) if name == BASE else abs(parametric.values[name])
    scale = 10.0 ** round(math.log10(size)) if size > 0.0 else 1.0
    low, high = parametric.domain(name)
    window = _SMOOTH_WINDOW if problem.is_smooth else WINDOW
    least = scale / window if low >= 0.0 else -scale * window
    if name == BASE and problem.is_smooth and problem.ends is None:
        least = _SLOWEST * scale
    return max(low, least), min(high, scale * window)


@dataclass(frozen=True, eq=False)
class FullResponse:
    """A full family of forced orbits in its window.

    Attributes
    ----------
    ids : tuple of str
        Its id. There are several if a number of its hash is at a border of rounding; each of them names the family.
    marks : tuple of FamilyMark
        The orbits that identify it: values of the parameter, periods and phases.
    closed : bool
    parameter : (m,) float
        Along the full family.
    """

    ids: tuple[str, ...]
    marks: tuple[FamilyMark, ...]
    closed: bool
    parameter: np.ndarray

    def reach(self, interval: tuple[float, float]) -> tuple[float, float]:
        """The range within which the family hangs together, where it leaves the given one and comes back; else that one."""
        low, high = interval
        places = connected_part((self.parameter >= low) & (self.parameter <= high), self.closed)
        if places is None:
            return interval
        part = self.parameter[places]
        width = _SLACK * float(part.max() - part.min())
        return min(low, float(part.min()) - width), max(high, float(part.max()) + width)


def full_response(branch: ForcedBranch) -> FullResponse:
    """Follow a branch's family through the window of its parameter, and identify it."""
    problem, chosen = branch.problem, _plain_points(branch)
    canonical = [primitive_orbit(problem, branch.unknowns[i]) for i in chosen]
    # An orbit at which the symmetry of its family is higher is no orbit of the other family: several are tested.
    problem, y = max(canonical, key=lambda pair: _order(pair[0]))
    window = window_of(problem)
    if problem is branch.problem and _is_full(branch, window):
        found = [(event.type, branch.unknowns[event.point], event.point in (0, len(branch) - 1)) for event in branch.events]
        closed, parameter = branch.ended[1].reason == "CLOSED", branch.parameter
        cuts: list[np.ndarray] = []
    else:
        found, closed, parameter, cuts = _followed(problem, y, window)
    kind, orbits = _identifying(problem, found, closed) or ("EP", cuts or [y])
    marks = _lowest([_mark(problem, kind, y) for y in orbits])
    name = f"{closure_name(problem)}:{canonical_letters(problem)}"
    return FullResponse(tuple(f"{name}:{text}" for text in digests(marks)), marks, closed, parameter)


def _order(problem: ForcedProblem) -> tuple[float, ...]:
    """Orders the problems of primitive orbits: the less symmetry and the more repetitions, the higher."""
    return order_of(problem) if isinstance(problem, ReleasedProblem) else (problem.load_periods, not problem.half)


def _identifying(
    problem: ForcedProblem, found: Sequence[tuple[str, np.ndarray, bool]], closed: bool
) -> tuple[str, list[np.ndarray]] | None:
    """The events that identify a family, with their type: grazing ends, else folds, branch points, the ends of the window, breaks of
    symmetry, and period doublings."""
    place, scale = problem.place, window_of(problem)[1] / WINDOW
    points = [y for kind, y, _ in found if kind == "BP"]
    # Where a family passes through another one it turns, too: the branch point is located better.
    folds = [y for kind, y, _ in found if kind == "SN" and all(abs(y[place] - other[place]) > _BESIDE * scale for other in points)]
    at_ends = [(kind, y) for kind, y, at_end in found if at_end and not closed]
    kinds = {
        "GR": [y for kind, y in at_ends if kind == "GR"],
        "SN": folds,
        "BP": points,
        "EP": [y for _, y in at_ends],
        **{code: [y for kind, y, _ in found if kind == code] for code in ("SB", "PD")},
    }
    return next(((kind, orbits) for kind, orbits in kinds.items() if orbits), None)


def _plain_points(branch: ForcedBranch) -> list[int]:
    """Points at a third and at two thirds of the arclength of a branch, at no event. Points are close near singular orbits."""
    located = {event.point for event in branch.events}
    plain = np.array([i for i in range(len(branch)) if i not in located] or [*range(len(branch))])
    parts = branch.arclength[plain] - branch.arclength[0]
    return [int(plain[np.argmin(np.abs(parts - part * (branch.arclength[-1] - branch.arclength[0]) / 3.0))]) for part in (1, 2)]


def _is_full(branch: ForcedBranch, window: tuple[float, float]) -> bool:
    """Whether a branch was cut neither by its range nor by anything else, and is in the window."""
    inside = (branch.parameter >= window[0]) & (branch.parameter <= window[1])
    if branch.ended[1].reason == "CLOSED":
        return bool(inside.all())
    ends = {event.point for event in branch.events if event.type in ("GR", "BP")}
    return bool(inside.all()) and {0, len(branch) - 1} <= ends


def _followed(
    problem: ForcedProblem, y: np.ndarray, window: tuple[float, float]
) -> tuple[list[tuple[str, np.ndarray, bool]], bool, np.ndarray, list[np.ndarray]]:
    """The family of an orbit, both ways, through the window: its events, whether it is closed, its values of the parameter, and the orbits
    at which it is cut."""
    place = problem.place
    family = parameter_family(problem, window, begin=float(y[place]))
    run = follow_both_ways(family, family.begin(y), SETTINGS, stop_when=unbounded(problem))
    run = with_exact_ends(family, run)
    if not run.points:
        return [], False, np.array([y[place]]), [y]
    last = len(run.points) - 1
    events = [(event.code, event.point.y, event.index in (0, last)) for event in run.events]
    ends = list(zip((run.points[0], run.points[-1]), run.ends, strict=True))
    # Where the motion grows without bound the last orbit is any of them.
    ends = [pair for pair in ends if pair[1].reason is not EndReason.STOP_WHEN] or ends
    cuts = [] if run.closed else [point.step.y for point, _ in ends]
    return events, run.closed, np.array([point.step.y[place] for point in run.points]), cuts


def _mark(problem: ForcedProblem, kind: str, y: np.ndarray) -> FamilyMark:
    """What identifies an orbit: the values of the parameter, the period and the phases of the impacts."""
    value, period, first, second, _ = invariants(problem, y).tolist()
    scale = window_of(problem)[1] / WINDOW
    path = ",".join((*problem.released, *problem.keep))
    if isinstance(problem, ReleasedProblem):
        phases, path = first, path.replace(" ", "")
    elif problem.sequence:  # a sum of phases far from zero has six digits
        phases = 3.0 + first + 0.5 * second + 0.25 * _resultant(problem, y)
    else:  # at a value of the parameter that is no event's the displacements alone tell families apart
        rest = _ZERO * float(problem.units[: problem.degrees_of_freedom].max())
        phases = first if kind == "EP" and first > rest else 0.0
    return FamilyMark(f"{kind} {path}", 0.0 if abs(value) < _ZERO * scale else value, period, phases)


def _lowest(marks: Sequence[FamilyMark]) -> tuple[FamilyMark, ...]:
    """The mark with the lowest value of the parameter, of several that with the lowest phases; all that are equal within their error."""
    kept = list(marks)
    for name in ("h", "pattern"):
        least = min(getattr(mark, name) for mark in kept)
        kept = [mark for mark in kept if getattr(mark, name) <= least + _TIE * max(abs(least), _ZERO)]
    return tuple(mark for mark, _ in itertools.groupby(sorted(kept)))
