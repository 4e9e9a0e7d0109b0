"""The families that meet at a grazing orbit: each candidate is solved there, and followed to the side where its orbits are admissible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from branches.admissible import unphysical
from branches.branch import Branch, BranchEvent
from branches.family import Family
from branches.grazing.touching import Candidate, Touching, candidate, mode_name, mode_of, touching
from branches.presentation import is_solved_as_it_is
from branches.sequences import Ends, impacts_per_period
from branches.tracing import follow_family
from bvp.checks import require_branch
from bvp.dense import inner, product, singular
from bvp.multipoint import MultipointProblem
from bvp.texts import brief, takes_options_of
from continuation.problem import Step
from continuation.switching import SwitchError, branch_directions, oriented

__all__ = ["CannotMerge", "Neighbour", "SolvedProblem", "leaves_upward", "meet", "meetings_at", "merged", "neighbours"]

PROBES = (1e-5, 1e-4, 1e-3, 1e-2)
"""Arclengths from the grazing orbit at which a candidate has to be an orbit. The nearest decides; the family is followed from the last."""

_SOLVED = 1e-15
"""Residual, scaled by the state, from which on a correction has nothing left to correct."""

_SINGULAR = 1e-10
"""Singular values below this part of the largest are zero: two families of one sequence cross at the grazing orbit."""

_MOVED = 1e-7
"""A correction by more than this, in scales of the orbit, leads to another orbit."""

_STRAIGHT = 0.9
"""Least cosine of the turn of the tangent in a step to a probe."""

_STILL = 1e-13
"""Speed of an impact, as a part of sqrt(2h), below which it is rounding. In a family speeds grow in proportion to the arclength."""

_NEAR = 1e-5
"""Length of the difference, in scales of the orbit, that gives the slope of an energy that is not quadratic."""

_SHORT = 1e-8
"""Duration of a flight that has vanished, as a part of the segment."""

_SAME_AFTER = 1e-8
"""Difference of states, relative to their size, after two impacts whose order does not matter."""

_SAME_EVENT = 1e-8
"""Relative difference of energies and quarter periods of one grazing on two families."""


class SolvedProblem(NamedTuple):
    """A problem with the unknowns y by which the grazing orbit solves it, and the scaled residual."""

    problem: MultipointProblem
    y: np.ndarray
    residual: float


@brief
@dataclass(frozen=True, eq=False)
class Neighbour:
    """A family that meets another one at a grazing orbit, or the reason why a sequence has none there.

    Parameters
    ----------
    kind : str
        "fold": both families exist on the same side of the grazing energy; "passage": on opposite sides; "linear mode": all impacts
        vanish, and the orbit there is one of linear motion; "dead end": no admissible orbits next to the grazing orbit.
    ends, sequence : (str, str), str
        Of the neighbour. Empty for a linear mode.
    label : str
        Of the neighbour next to the grazing orbit, "" outside the grammar; the name of the linear mode.
    h, alpha : float
        Energy of the grazing orbit, and a quarter of the neighbour's period there.
    stops : tuple of str
        Contacts that are grazed.
    impacts : int
        Impacts in a period of the neighbour.
    cover : int
        How many periods of the neighbour the given period of the grazing orbit contains.
    reason : str
        Why there are no orbits; "" if there are some.
    branch : Branch or None
        The neighbour, followed both ways from an orbit next to the grazing one; None before it is.
    event : BranchEvent or None
        The same grazing on the neighbour; None where it was not reached within the options.
    here, there : SolvedProblem or None
        The grazing orbit as a solution of the problem of the family that it was reached on, and of the neighbour's.
    beside : SolvedProblem or None
        An orbit of the neighbour next to the grazing one; None where there are no admissible ones.
    """

    kind: str
    ends: Ends | tuple[()]
    sequence: str
    label: str
    h: float
    alpha: float
    stops: tuple[str, ...]
    impacts: int
    cover: int
    reason: str = ""
    branch: Branch | None = None
    event: BranchEvent | None = None
    here: SolvedProblem | None = None
    there: SolvedProblem | None = None
    beside: SolvedProblem | None = None

    def followed(self, **options: Any) -> Neighbour:
        """This neighbour with its family followed, if there is one. `**options` are those of `saltus.trace`: points, stop_at, ..."""
        if self.beside is None or self.there is None:
            return self
        branch = follow_family(self.beside.problem, self.beside.y, direction="both", **options)
        h, alpha = self.there.problem.energy(self.there.y), self.there.problem.quarter_period(self.there.y)
        grazings = (event for event in branch.events if event.type == "GR")
        same = (event for event in grazings if abs(event.h / h - 1.0) < _SAME_EVENT and abs(event.alpha / alpha - 1.0) < _SAME_EVENT)
        return replace(self, label=branch.label, branch=branch, event=next(same, None))


@takes_options_of(follow_family)
def neighbours(branch: Branch, event: BranchEvent | str, *, cover: int = 1, **options: Any) -> list[Neighbour]:
    """The families that meet a branch at a grazing.

    Each grazing instant of the orbit over its period - a touch, or an impact of zero speed - may count as an impact or not. All choices
    are tried, one of each class under the orbit's symmetries, with the ends or the periodic closure that the choice leaves.

    Parameters
    ----------
    branch : Branch
    event : BranchEvent or str
        A GR of this branch, or its id.
    cover : int
        Periods of the grazing orbit that are unfolded: neighbours of up to that many times its period.
    **options
        As for `branches.tracing.follow_family`.

    Returns
    -------
    list of Neighbour
        Those with a family first.

    Raises
    ------
    ValueError
        For an event of another type, or one that this branch does not have.

    Examples
    --------
    >>> import saltus
    >>> branch = saltus.trace("S13O00+", saltus.vibro_impact_nes(mu=0.1, sigma=0.1), energy=(0.05, 20.0))
    >>> [(item.kind, item.label) for item in neighbours(branch, "GR2", points=60) if item.label]
    [('fold', 'U1302+'), ('fold', 'S13O11+')]
    """
    require_branch(branch)
    event = branch.event(event)
    if cover < 1:
        raise ValueError(f"cover is {cover}, expected 1 or more")
    if event.type != "GR":
        raise ValueError(f"{event.id} is of type {event.type}; neighbours need an event of type GR")
    solution = branch.orbit(event.point).solution
    here = SolvedProblem(branch.problem, solution.y, solution["residual"])
    found = meetings_at(branch.problem, solution.y, leaves_upward(branch, event.point), cover=cover)
    return [replace(item, here=here).followed(**options) for item in found]


def meetings_at(
    problem: MultipointProblem,
    y: np.ndarray,
    rising: bool,
    *,
    cover: int = 1,
    impacts: int = 0,
    accept: Callable[[float, Candidate], bool] | None = None,
    energy: tuple[float, float] = (0.0, np.inf),
) -> list[Neighbour]:
    """`neighbours` at the grazing orbit y of a problem. Each has one orbit `beside` the grazing orbit, and is not followed.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
    rising : bool
        Whether the family that it was reached on leaves it upward in energy.
    cover : int
        As for `neighbours`.
    impacts : int
        Of the neighbours, in a period; others are left out, and as many periods are unfolded as they need. 0 for any number.
    accept : callable, optional
        (quarter period at the grazing orbit, problem of the neighbours) -> whether it is solved; others are left out.
    energy : (float, float)
        Range of the orbits `beside` the grazing one.
    """
    try:
        swapped = merged(problem, y)
    except CannotMerge as error:
        return [Neighbour("dead end", (), "", "", problem.energy(y), problem.quarter_period(y), (), 0, 1, str(error))]
    if swapped is not None:
        other, start, stops = swapped
        return [_meet(other, start, stops, impacts_per_period(other.sequence, other.ends), 1, rising, energy)]
    orbit = touching(problem, y)
    if orbit.is_linear:
        return [_linear(orbit)]
    orbit = orbit.repeated(max(cover, -(-impacts // len(orbit.times))))
    own = orbit.smallest(orbit.kept)
    masks = (mask for mask in orbit.choices() if mask != own and not (impacts and mask.bit_count() % impacts))
    found = []
    for choice in (candidate(orbit, mask) for mask in masks):
        if accept is None or not choice.impacts or accept(0.25 * orbit.period / choice.cover, choice):
            found.append(meet(orbit, choice, rising, energy))
    return sorted(found, key=lambda item: (item.beside is None, item.cover, item.ends, item.sequence))


def meet(orbit: Touching, choice: Candidate, rising: bool, energy: tuple[float, float] = (0.0, np.inf)) -> Neighbour:
    """The family of a candidate at a grazing orbit, not followed; `rising` and `energy` as for `meetings_at`."""
    if not choice.impacts and orbit.system.smooth_forces is None:
        return _linear(orbit)
    problem = MultipointProblem(orbit.system, choice.ends, choice.sequence)
    y = problem.pack(choice.start, choice.nodes, choice.times)
    return _meet(problem, y, orbit.stops, choice.impacts, choice.cover, rising, energy)


def _meet(
    problem: MultipointProblem,
    y: np.ndarray,
    stops: tuple[str, ...],
    impacts: int,
    cover: int,
    rising: bool,
    energy: tuple[float, float],
) -> Neighbour:
    """Solve a problem at the grazing orbit y, and look for its admissible sides."""

    def neighbour(kind: str, **more: Any) -> Neighbour:
        sequence = "".join(problem.sequence)
        return Neighbour(kind, problem.ends, sequence, "", problem.energy(y), problem.quarter_period(y), stops, impacts, cover, **more)

    y, residual, directions = _solve(problem, y)
    if not residual < 1e-12:
        return neighbour("dead end", reason="the grazing orbit does not solve this problem")
    there = SolvedProblem(problem, y, residual)
    family = Family(problem)
    sides: list[str] = []
    for direction in directions:
        steps = _first(family, y, direction, sides)
        if steps:
            kind = "fold" if (steps[0].parameter > problem.energy(y)) == rising else "passage"
            inside = [SolvedProblem(problem, step.y, step.extra["residual"]) for step in steps if energy[0] <= step.parameter <= energy[1]]
            # The corrector can fall from a far probe onto a multiple cover of a shorter orbit, or one of more symmetry, that is near.
            own = [closure for closure in inside if is_solved_as_it_is(problem, closure.y)] or inside
            return neighbour(kind, there=there, beside=own[-1] if own else None)
    reason = "; ".join(dict.fromkeys(sides)) or "several families cross there, and their directions were not found"
    return neighbour("dead end", reason=reason, there=there)


def _solve(problem: MultipointProblem, y: np.ndarray) -> tuple[np.ndarray, float, list[np.ndarray]]:
    """The grazing orbit as a solution of a problem, its residual scaled by the state, and the directions in which the family may leave it.

    By dense linear algebra in scales of the full orbit: at grazing, the velocities at all nodes may be zero.
    """
    speed, times = np.sqrt(2.0 * problem.energy(y)), problem.flight_times(y)
    displacement = np.max(np.abs(problem.end_states(y)[:, : problem.half]), initial=np.max(np.abs(problem.start(y)[: problem.half])))
    size = np.repeat([displacement, speed], problem.half)
    nodes = np.tile(size, (problem.inner, 1))
    scale = np.abs(problem.pack(size + problem.start_offset, nodes, np.full(len(times), np.sum(times))))
    scale[: problem.parameters] = product(np.abs(problem.start_map.T), size)  # the sizes of coordinates do not cancel
    scale[scale == 0.0] = 1.0
    start, largest = y, float(np.max(size))
    for attempt in range(4):
        error = problem.residual(y)
        residual = float(np.max(np.abs(error))) / largest
        if attempt and (attempt == 3 or residual < _SOLVED):
            break
        matrix = problem.jacobian(y) * scale
        values, rows = singular(matrix)
        keep = values > _SINGULAR * values[0]
        images = product(rows[: len(values)][keep], matrix.T)  # of the left singular vectors times their values
        y = y - scale * product(product(images, error) / values[keep] ** 2, rows[: len(values)][keep])
    null = oriented(rows[-1]) * scale
    if not keep.all():
        try:
            directions = list(branch_directions(Family(problem), y, null))
        except SwitchError:
            directions = []
    else:
        directions = [null, -null]
        # Along the family to the energy of the start. Without smooth forces it is quadratic in the unknowns: the slope is exact.
        near = _NEAR if problem.is_smooth else 1.0
        slope = 0.5 * (problem.energy(y + near * null) - problem.energy(y - near * null)) / near
        part = (problem.energy(start) - problem.energy(y)) / slope if slope != 0.0 else np.inf
        y = y + part * null if abs(part) < _MOVED else y
        residual = float(np.max(np.abs(problem.residual(y)))) / largest
    return y, residual if np.all(np.abs(y - start) <= _MOVED * scale) else np.inf, directions


def _first(family: Family, y: np.ndarray, direction: np.ndarray, sides: list[str]) -> list[Step]:
    """Orbits next to the grazing one in a direction, as far from it as the probes go on being orbits; if none, the reason into `sides`."""
    problem = family.problem
    length = problem.orbits.length(y, direction)
    if not length > 0.0:
        sides.append("the orbit does not change with the first impulses")
        return []
    tangent = np.concatenate([direction / length, np.zeros(problem.unknowns)])
    steps, reason = [], "no orbit next to the grazing one could be corrected"
    for ds in PROBES:
        step = family.step(y, tangent, ds)
        if not step.converged or not step.turn > _STRAIGHT:
            continue  # nearer than this, the speeds at the nodes may be lost in rounding
        found = unphysical(problem, step.extra, 0.0)
        if found is None and step.extra["speed_node"] >= 0 and abs(step.extra["speed"]) < _STILL * problem.speed(step.extra):
            found = "beside the grazing orbit an impact has no speed: another mode is in resonance, and moves without impacts"
        if found is not None:
            reason = found
            break
        steps.append(step)
    if not steps:
        sides.append(reason)
    return steps


def leaves_upward(branch: Branch, point: int) -> bool:
    """Whether a branch that ends at a point leaves it upward in energy: by its tangent there, as a fold may be next to it."""
    inside = point + 1 if point + 1 < len(branch) else point - 1
    problem = branch.problem
    y = branch.orbit(point).solution.y
    at = problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0, full=False)
    if at is None or inside < 0:
        return bool(branch.points["h"][max(inside, 0)] > branch.points["h"][point])
    tangent = at.tangent[: problem.unknowns]
    return bool(at["slope"] * inner(tangent, branch.unknowns(inside) - y) > 0.0)


class CannotMerge(ValueError):
    """Impacts that merge without a family behind; the message says why."""


def merged(problem: MultipointProblem, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray, tuple[str, str]] | None:
    """The family behind a flight that has vanished: the problem with its two impacts in the other order, its solution, the two contacts.

    None if no flight has vanished between impacts at different contacts. Raises `CannotMerge` if the order matters, because the impulse of
    one stop changes the speed at the other, or if an impact comes to an end of the segment."""
    times = problem.whole_flight_times(y)
    flight = int(np.argmin(times))
    if times[flight] > _SHORT * float(np.sum(times)):
        return None
    sequence, states, start = list(problem.sequence), problem.impact_states(y), problem.start(y)
    if problem.periodic:
        # Impacts are numbered from the start, and turned so that the start is another one than the two.
        turned = [(i + flight - 1) % len(sequence) for i in range(len(sequence))]
        sequence, states, times = [sequence[i] for i in turned], np.vstack([start, states])[turned], times[turned]
        i = 1
    else:
        i = flight - 1
    if i < 0 or i + 1 >= len(sequence):
        raise CannotMerge("an impact comes to an end of the solved segment: it and its image cannot change their order")
    here, there = sequence[i], sequence[i + 1]
    if here == there:
        return None
    before = _after_impact(problem, here, states[i])
    between = _after_impact(problem, there, before)
    if not np.allclose(_after_impact(problem, here, between), states[i + 1], rtol=0.0, atol=_SAME_AFTER * float(np.max(np.abs(states)))):
        raise CannotMerge(f"impacts at {here} and {there} act on each other, so that at one instant their order would matter")
    states = states.copy()
    states[i] = between
    sequence[i], sequence[i + 1] = there, here
    other = MultipointProblem(problem.system, problem.ends, sequence)
    y = other.pack(states[0], states[1:], times) if problem.periodic else other.pack(start, states, times)
    return other, y, (here, there)


def _after_impact(problem: MultipointProblem, letter: str, z: np.ndarray) -> np.ndarray:
    """The state after an elastic impact, from the one before it or the other way round."""
    modes = problem.modes
    c = modes.contact_letters.index(letter)
    return z - (1.0 + modes.contacts.restitution[c]) * modes.contacts.push[c] * float(modes.contacts.rate[c] @ z)


def _linear(orbit: Touching) -> Neighbour:
    """Linear motion without any impact, with the name of the mode."""
    mode = mode_of(orbit)
    label = "" if mode is None else mode_name(orbit.system, mode)
    which = "a linear motion of several modes" if mode is None else f"the linear mode {label or mode + 1}"
    reason = f"{which}, which touches the stops: other families begin there, too"
    return Neighbour("linear mode", (), "", label, orbit.h, 0.25 * orbit.period, orbit.stops, 0, 1, reason)
