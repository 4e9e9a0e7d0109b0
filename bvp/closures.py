"""The end conditions of a solved segment, and the full period that follows from them by reversal."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bvp.checks import finite_numbers
from bvp.dense import length, orthonormal, product, quadratic, singular
from bvp.smooth_flights import sample_path
from bvp.texts import shown

if TYPE_CHECKING:
    from bvp.modes import Modes
    from bvp.multipoint import MultipointProblem
    from bvp.system import ImpactSystem

__all__ = [
    "ORIGIN", "PERIODIC", "REST", "STOP", "Cycle", "EndsError", "contact_of", "cycle_of", "deflated_motions",
    "end_maps", "free_motions", "free_translation", "held_motions", "parse_end",
]  # fmt: skip

ORIGIN, REST, STOP, PERIODIC = range(4)
"""Kinds of an end, as the core has them."""

KINDS = {"origin": ORIGIN, "rest": REST, "stop": STOP, "periodic": PERIODIC}


class EndsError(ValueError):
    """The ends asked for do not fit the system; the message names what is missing."""


def contact_of(system: ImpactSystem, letter: str) -> int:
    """Index of the contact with a letter; EndsError where the system has none."""
    return _contact_among(letter, system.modes.contact_letters)


def _contact_among(letter: str, letters: tuple[str, ...]) -> int:
    if letter not in letters:
        raise EndsError(f"there is no contact {shown(letter)}; this system's contacts are {', '.join(letters)}")
    return letters.index(letter)


def parse_end(system: ImpactSystem, end: str) -> tuple[int, int]:
    """Kind and contact (-1: none) of an end "origin", "rest", "periodic" or "stop" with the contact's letter; EndsError if the system has
    none."""
    found = _end_among(end, system.modes.contact_letters)
    if found[0] == ORIGIN and not system.has_odd_symmetry:
        raise EndsError(
            f"an origin end needs odd symmetry (two-sided stops with equal gaps, odd springs); this system has {system.why_not_odd()}; "
            "expected rest or stop ends"
        )
    return found


@lru_cache(maxsize=256)
def _end_among(end: str, letters: tuple[str, ...]) -> tuple[int, int]:
    """The same for a system whose contacts have these letters."""
    match = re.fullmatch(r"(origin|rest|periodic|stop)([a-z]?[+-])?", end)
    if match is None or (match[1] == "stop") != (match[2] is not None):
        raise EndsError(f"unknown end {shown(end)}; expected origin, rest, periodic or one of " + ", ".join("stop" + s for s in letters))
    return KINDS[match[1]], _contact_among(match[2], letters) if match[2] else -1


@lru_cache(maxsize=64)
def end_maps(modes: Modes, kind: int, contact: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States that begin at an end, z = Z s + c, and the condition L z = l that holds there: Z (2 n, s), c (2 n,), L (n, 2 n), l (n,).

    Shared by all who ask, and not to be written to. A periodic end fixes nothing: Z is the identity and L has no rows.
    """
    size = modes.matrix.shape[0]
    n = size // 2
    if kind == PERIODIC:
        return np.eye(size), np.zeros(size), np.zeros((0, size)), np.zeros(0)
    start_map, offset = np.zeros((size, n)), np.zeros(size)
    rows, bounds = np.zeros((n, size)), np.zeros(n)
    if kind == ORIGIN:
        start_map[n:] = np.eye(n)
        rows[:, :n] = np.eye(n)
    elif kind == REST:
        start_map[:n] = np.eye(n)
        rows[:, n:] = np.eye(n)
    else:
        gap = modes.contacts.gap[contact, :n]
        normal = gap / length(gap)
        basis = orthonormal(np.column_stack([gap, np.eye(n)]))[:, 1:]  # orthonormal, of the complement of the normal
        start_map[:n, : n - 1] = basis
        start_map[n:, n - 1] = normal
        offset[:n] = normal * modes.contacts.bound[contact] / length(gap)
        rows[0, :n] = gap
        bounds[0] = modes.contacts.bound[contact]
        rows[1:, n:] = basis.T
    return start_map, offset, rows, bounds


_NONE = 1e-9
"""Part of its size below which an entry of a direction is rounding."""


@lru_cache(maxsize=64)
def free_motions(system: ImpactSystem, hit: frozenset[int] | None = None) -> np.ndarray:
    """Orthonormal rows (f, n) in modal displacements: the motions that no spring resists, and none of the stops `hit`, by default all.

    Shared by all who ask, and not to be written to.
    """
    modes = system.modes
    n = len(modes.squares)
    index = np.flatnonzero(modes.squares == 0.0)
    if not index.size:
        return np.zeros((0, n))
    rigid = modes.shapes[:, index]
    size = np.sqrt(quadratic(np.eye(n), rigid))
    resisting = [np.asarray(stop.gap) for k, stop in enumerate(system.stops) if hit is None or k in hit]
    if system.smooth_forces is not None:
        resisting += [row for row in system.smooth_forces.inputs[:, :n] if np.any(row)]
    rows = np.array([row / length(row) for row in resisting]).reshape(-1, n)
    values, directions = singular(product(rows, rigid / size))
    felt = int(np.sum(values > _NONE))
    free = np.zeros((index.size - felt, n))
    free[:, index] = orthonormal((directions[felt:] / size).T)[:, : len(free)].T
    return free


def deflated_motions(system: ImpactSystem, hit: frozenset[int] | None = None) -> np.ndarray:
    """Those of `free_motions` whose pair of multipliers 1 is left out: none for two degrees of freedom, which have no other pair."""
    free = free_motions(system, hit)
    return free if free.shape[1] > 2 else free[:0]


@lru_cache(maxsize=64)
def held_motions(system: ImpactSystem, hit: frozenset[int] | None = None) -> np.ndarray:
    """Orthonormal rows (n - f, n) in modal displacements: those perpendicular to `deflated_motions`.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> free = ImpactSystem([[1, 0], [0, 2]], [[0, 0], [0, 0]], [[3, -3], [-3, 3]], [Stop((1, -1), -1, 1)])
    >>> held_motions(free)
    array([[1., 0.],
           [0., 1.]])
    """
    free = deflated_motions(system, hit)
    unit = np.eye(free.shape[1])
    mixed = np.flatnonzero(np.any(free != 0.0, axis=0))
    others = orthonormal(free[:, mixed].T)[:, len(free) :]
    return np.ascontiguousarray(np.vstack([product(others.T, unit[mixed]), np.delete(unit, mixed, axis=0)]))


def free_translation(system: ImpactSystem, hit: frozenset[int] | None = None) -> np.ndarray | None:
    """A direction (n,) of displacement that no spring resists, and none of the stops `hit`, by default all, the first of its largest
    entries 1; None where there is none.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> free = ImpactSystem([[1, 0], [0, 2]], [[0, 0], [0, 0]], [[3, -3], [-3, 3]], [Stop((1, -1), -1, 1)])
    >>> free_translation(free)
    array([1., 1.])
    """
    free = free_motions(system, hit)
    if not len(free):
        return None
    found = product(system.modes.shapes, free[-1])
    found = found / found[np.argmax(np.abs(found) > (1.0 - _NONE) * np.abs(found).max())]
    return np.where(np.abs(found) < _NONE, 0.0, found)


@dataclass(frozen=True, eq=False)
class Cycle:
    """A closed orbit, impact by impact.

    Parameters
    ----------
    system : ImpactSystem
    before, after : (P, N) float
        Modal states at each impact, in order of time from the orbit's start.
    duration : (P,) float
        Free time after each impact; the last one leads to the first.
    contact : (P,) int
        Contact hit (row of the contact arrays of `Modes`); -1 for a plain cut of a flight. An orbit without impacts is cut at its start.
    lead : float
        Time from the orbit's start to the first impact.

    """

    system: ImpactSystem
    before: np.ndarray
    after: np.ndarray
    duration: np.ndarray
    contact: np.ndarray
    lead: float

    @cached_property
    def period(self) -> float:
        """T."""
        return float(np.sum(self.duration))

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the impacts in [0, T), (P,)."""
        return self.lead + np.concatenate([[0.0], np.cumsum(self.duration[:-1])])

    @cached_property
    def hit(self) -> frozenset[int]:
        """The stops that it hits."""
        stops = self.system.modes.contact_stop
        return frozenset(int(stops[c]) for c in self.contact.tolist() if c >= 0)

    @cached_property
    def letters(self) -> tuple[str, ...]:
        """Contact letters in order of time."""
        letters = self.system.modes.contact_letters
        return tuple([letters[c] for c in self.contact.tolist() if c >= 0])

    @property
    def speeds(self) -> np.ndarray:
        """Speeds of approach at the impacts, (P,)."""
        contacts, hit = self.system.modes.contacts, self.contact >= 0
        contact = self.contact[hit]
        return contacts.side[contact] * np.einsum("ij,ij->i", contacts.rate[contact], self.before[hit])

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (m, n) at any times (m,) from the orbit's start; at an impact the velocity is the one after it.

        Raises
        ------
        ValueError
            For times that are not a list of finite numbers.
        """
        modes = self.system.modes
        times = finite_numbers(times, "times", None)
        n = self.system.degrees_of_freedom
        states = np.empty((times.size, 2 * n))
        # The flight that the orbit starts in began before its start.
        begins = np.concatenate([[self.times[-1] - self.period], self.times])
        flights = np.concatenate([self.after[-1:], self.after])
        sample_path(self.system, begins, flights, np.mod(times, self.period), states)
        physical = product(states, modes.to_state.T)
        return physical[:, :n], physical[:, n:]


def cycle_of(problem: MultipointProblem, y: np.ndarray) -> Cycle:
    """The full period of the solution y of a multipoint problem, unfolded by the reversals of its ends."""
    period, contacts, rows = problem.orbits.unfold(y), np.array(problem.contacts), problem.modes.contacts
    if not period.node:
        start = problem.start(y)[None]
        whole = 4.0 / problem.quarters * float(np.sum(problem.flight_times(y)))
        return Cycle(problem.system, start, start, np.array([whole]), np.array([-1]), 0.0)
    contact = contacts[period.node]
    # An image of an impact can be on the other side of the stop.
    hit = np.flatnonzero(contact >= 0)
    mirrored = hit[rows.bound[contact[hit]] * np.einsum("ij,ij->i", rows.gap[contact[hit]], period.before[hit]) < 0.0]
    contact[mirrored] = problem.modes.contact_opposite[contact[mirrored]]
    return Cycle(problem.system, period.before, period.after, period.duration, contact, period.lead)
