"""The impulsive motion at many energies, and the energies at which it meets an end set.

At one energy the impulsive motion is one trajectory. `ImpulsiveMotions` follows it event by event, with all derivatives with respect to
log h. The events change at some energies: a new impact by grazing, or a new pair of crossings of zero by the gap coordinate. In between,
each event's residual is a smooth function of log h. `scan_energies` halves intervals of log h until it can close them. An interval is
closed if, for each event, twice the largest derivative at its ends is too small to bring the residual to zero in between, or the residual
is monotone there: the derivatives at both ends and the secant agree within a factor. The same is required of the distance of each turning
point from the stops and from zero, and of the speeds of impacts, so that no change of the events hides inside. At a change of events an
interval is halved down to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from branches.impulsive.start import check_system, impulsive_state
from branches.search.scope import require_two_degrees
from bvp.kernels import shooting as kernel
from bvp.kernels.impact import work_array
from bvp.kernels.shooting import TURN, ZERO

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Bracket", "Scan", "Traces", "ImpulsiveMotions", "scan_energies"]

_LARGEST = 1 << 20


@dataclass(frozen=True, eq=False)
class Traces:
    """Events of M motions, E at most; those beyond `count` mean nothing.

    count : (M,) events, -1 where the motion could not be followed.
    kind : (M, E) the contact hit, or `bvp.kernels.shooting.ZERO` (the gap coordinate passes zero) or `TURN` (its velocity does).
    time, residual, gap : (M, E) time; what is transverse to the end set - the other displacement at a ZERO (end origin), the other velocity
    at a TURN (rest) and at an impact (stop) -; the gap coordinate. passing : (M, E) square of the rate at which what tells the event
    passes zero, zero where two events of a kind meet, such as an impact and a turning point at grazing. time_slope, residual_slope,
    gap_slope, passing_slope: their derivatives by log h.
    """

    count: np.ndarray
    kind: np.ndarray
    time: np.ndarray
    time_slope: np.ndarray
    residual: np.ndarray
    residual_slope: np.ndarray
    gap: np.ndarray
    gap_slope: np.ndarray
    passing: np.ndarray
    passing_slope: np.ndarray

    def rows(self, which: np.ndarray | slice) -> Traces:
        """Those of some of the motions."""
        return Traces(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


class ImpulsiveMotions:
    """Follows the impulsive start of a system for a time.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one stop with equal gaps on both sides, undamped and elastic, absorber and primary named.
    longest : float

    Raises
    ------
    ValueError
        For another system.
    """

    def __init__(self, system: ImpactSystem, longest: float):
        check_system(system)
        require_two_degrees(system, "periodic impulsive orbits are found by one scan over energy on")
        if len(system.stops) != 1 or not system.has_odd_symmetry:
            raise ValueError("periodic impulsive orbits need one stop with equal gaps on both sides: they pass through the origin")
        self.system = system
        self.longest = longest
        self.modes = modes = system.modes
        row = modes.contact_gap[0]
        rows = [row]
        for _ in range(3):
            rows.append(rows[-1] @ modes.matrix)
        self.functional = np.ascontiguousarray(rows)
        across = np.array([-row[1], row[0]]) / math.hypot(row[0], row[1])
        self.across_displacement = np.concatenate([across, np.zeros(2)])
        self.across_velocity = np.concatenate([np.zeros(2), across])
        self.room = 64

    def start(self, energy: float) -> np.ndarray:
        """Start state of the modes (4,)."""
        return self.modes.from_state @ np.concatenate(impulsive_state(self.system, energy))

    def _follow(self, levels: np.ndarray, longest: float) -> tuple[np.ndarray, ...]:
        modes = self.modes
        unit = self.start(1.0)
        starts = np.exp(0.5 * levels)[:, None] * unit
        changes = 0.5 * starts
        while True:
            shape = (len(levels), self.room)
            kind = np.zeros(shape, dtype=np.int64)
            time, shift = np.zeros(shape), np.zeros(shape)
            state, change = np.zeros((*shape, 4)), np.zeros((*shape, 4))
            count = np.zeros(len(levels), dtype=np.int64)
            kernel.sensitivities(
                modes.flight, modes.contacts, self.functional, starts, changes, float(longest), kind, time, shift, state, change, count,
                work_array(4, len(modes.contact_side)),
            )  # fmt: skip
            if not np.any(count == kernel.FULL) or self.room >= _LARGEST:
                return kind, time, shift, state, change, np.where(count < 0, -1, count)
            self.room *= 2

    def at(self, levels: np.ndarray) -> Traces:
        """The motions at log h = `levels` (M,)."""
        kind, time, shift, state, change, count = self._follow(levels, self.longest)
        rows = np.array([self.across_displacement, self.across_velocity, *self.functional[:3]])
        values, slopes = state @ rows.T, change @ rows.T
        passing, turning = np.where(kind == kernel.ZERO, 0, 1)[..., None], np.where(kind == kernel.TURN, 4, 3)[..., None]
        rate, rate_slope = _pick(values, turning), _pick(slopes, turning)
        return Traces(
            count, kind, time, shift, _pick(values, passing), _pick(slopes, passing), values[..., 2], slopes[..., 2], rate**2,
            2.0 * rate * rate_slope,
        )  # fmt: skip

    def segment(self, level: float, event: int) -> tuple[np.ndarray, tuple[str, ...], np.ndarray, np.ndarray]:
        """The motion up to an event: its start (4,), the contacts hit before (k), the states after them (k, 4), and the times of
        flight (k + 1,)."""
        kind, time, _, state, _, count = self._follow(np.array([level]), self.longest)
        if count[0] <= event:
            raise ValueError(f"the motion has {count[0]} events; there is no event {event}")
        modes = self.modes
        hits = np.flatnonzero(kind[0, :event] >= 0)
        contacts = kind[0, hits]
        before = state[0, hits]
        speed = np.einsum("ij,ij->i", modes.contact_rate[contacts], before)
        after = before - ((1.0 + modes.contact_restitution[contacts]) * speed)[:, None] * modes.contact_push[contacts]
        stamps = np.concatenate([[0.0], time[0, hits], [time[0, event]]])
        return self.start(math.exp(level)), tuple(modes.contact_letters[c] for c in contacts), after, np.diff(stamps)


def _pick(values: np.ndarray, which: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, which, axis=2)[..., 0]


PANEL = 0.05
"""Width in log h of the intervals that a scan starts from."""

FLOOR = 2e-14
"""Width in log h that is not halved any more."""

SAFETY = 2.0
"""How many times steeper than at both ends a residual may be inside an interval that is closed."""

BATCH = 256
MOST_MOTIONS = 400_000


@dataclass(frozen=True)
class Bracket:
    """A zero of the residual at one event: log h below and above, index and kind of the event."""

    low: float
    high: float
    event: int
    kind: int


@dataclass(eq=False)
class Scan:
    """What a scan found: brackets of zeros; counts; `open`, the intervals of log h that could not be closed."""

    brackets: list[Bracket] = field(default_factory=list)
    open: list[tuple[float, float]] = field(default_factory=list)
    motions: int = 0
    changes: int = 0
    """Energies at which the events change, each an interval of width `FLOOR`."""


def scan_energies(motions: ImpulsiveMotions, energy: tuple[float, float], quarter_period: float) -> Scan:
    """Bracket each energy at which the impulsive motion meets an end set.

    Parameters
    ----------
    motions : ImpulsiveMotions
        That follows for two quarter periods at least.
    energy : (float, float)
    quarter_period : float
        Longest; an origin is met after two quarter periods, rest and stop after one.

    Returns
    -------
    Scan
    """
    scan = Scan()
    low, high = math.log(energy[0]), math.log(energy[1])
    edges = np.linspace(low, high, max(2, math.ceil((high - low) / PANEL) + 1))
    at = motions.at(edges)
    scan.motions += len(edges)
    # Last in, first out: only the intervals next to be halved are kept in memory.
    pending = [(edges[:-1], edges[1:], at.rows(np.arange(len(edges) - 1)), at.rows(np.arange(1, len(edges))))]
    while pending:
        a, b, first, last = pending.pop()
        if len(a) > BATCH:
            half = len(a) // 2
            pending.append((a[half:], b[half:], first.rows(slice(half, None)), last.rows(slice(half, None))))
            pending.append((a[:half], b[:half], first.rows(slice(half)), last.rows(slice(half))))
            continue
        width = first.kind.shape[1]
        changed, closed, clear, zero = judge(first, last, b - a, motions, quarter_period)
        narrow = b - a <= FLOOR
        done = narrow | (closed.all(axis=1) & clear.all(axis=1) & ~changed)
        for i, j in np.argwhere(zero & done[:, None]):
            scan.brackets.append(Bracket(float(a[i]), float(b[i]), int(j), int(first.kind[i, j])))
        scan.changes += int(np.sum(narrow & changed))
        for i in np.flatnonzero(narrow & ~(closed | zero).all(axis=1)):
            scan.open.append((float(a[i]), float(b[i])))
        split = np.flatnonzero(~done)
        if not len(split):
            continue
        if scan.motions > MOST_MOTIONS:
            scan.open += [(float(a[i]), float(b[i])) for i in split]
            continue
        middle = 0.5 * (a[split] + b[split])
        between = motions.at(middle)
        scan.motions += len(split)
        if between.kind.shape[1] != width:
            first, last = padded(first, between.kind.shape[1]), padded(last, between.kind.shape[1])
        pending.append(
            (
                np.concatenate([a[split], middle]),
                np.concatenate([middle, b[split]]),
                joined(first.rows(split), between),
                joined(between, last.rows(split)),
            )
        )
    scan.brackets.sort(key=lambda bracket: (bracket.low, bracket.event))
    return scan


def judge(
    first: Traces, last: Traces, width: np.ndarray, motions: ImpulsiveMotions, quarter_period: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compare the motions at both ends of I intervals.

    Returns
    -------
    changed : (I,) bool
        The events differ, other than by one that leaves the time followed.
    closed, clear, zero : (I, E) bool
        Whether the residual of each event hides no zero but one; whether a turning point hides no change of events; whether the residual
        changes sign. Events after the first that differs are left out.
    """
    size = min(first.kind.shape[1], last.kind.shape[1])
    index = np.arange(size)
    both = index < np.minimum(first.count, last.count)[:, None]
    same = np.logical_and.accumulate(both & (first.kind[:, :size] == last.kind[:, :size]), axis=1)
    prefix = same.sum(axis=1)
    changed = (first.count > prefix) & (last.count > prefix)
    for one, other in ((first, last), (last, first)):
        more = (one.count > prefix) & (other.count <= prefix)
        row = np.flatnonzero(more)
        here = prefix[row]
        # Only the next event may leave at the end of the time, as far as its time moves over the interval.
        moves = SAFETY * np.abs(one.time_slope[row, here]) * width[row]
        leaves = one.time[row, here] + moves + 1e-12 * motions.longest >= motions.longest
        changed[row] = ~leaves
    changed |= (first.count < 0) | (last.count < 0)
    kind = first.kind[:, :size]
    late = np.minimum(first.time[:, :size], last.time[:, :size])
    within = same & (late <= np.where(kind == ZERO, 2.0, 1.0) * quarter_period)
    w = width[:, None]
    slopes = first.residual_slope[:, :size], last.residual_slope[:, :size]
    sure, sign = certain(first.residual[:, :size], last.residual[:, :size], *slopes, w)
    steady = kind != TURN
    alone, _ = certain(first.passing[:, :size], last.passing[:, :size], first.passing_slope[:, :size], last.passing_slope[:, :size], w)
    clear = ~same | alone
    for bound in (0.0, *motions.modes.contact_bound):
        alone, _ = certain(
            first.gap[:, :size] - bound, last.gap[:, :size] - bound, first.gap_slope[:, :size], last.gap_slope[:, :size], w
        )
        clear &= ~same | steady | alone
    return changed, ~within | sure, clear, within & sign


def certain(
    low: np.ndarray, high: np.ndarray, low_slope: np.ndarray, high_slope: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether a function with these values and derivatives at both ends of an interval has no zero or just one in it, and whether it
    changes sign."""
    secant = (high - low) / width
    steepest = SAFETY * np.maximum(np.maximum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    sign = (low > 0.0) != (high > 0.0)
    away = ~sign & (np.abs(low) + np.abs(high) > steepest * width)
    least = np.minimum(np.minimum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    monotone = (low_slope * high_slope > 0.0) & (low_slope * secant > 0.0) & (SAFETY * least >= steepest / SAFETY)
    return away | monotone, sign


def padded(traces: Traces, size: int) -> Traces:
    """With room for `size` events."""
    more = size - traces.kind.shape[1]
    if more <= 0:
        return traces
    return Traces(
        *(
            np.pad(getattr(traces, name), ((0, 0), (0, more))) if name != "count" else traces.count
            for name in traces.__dataclass_fields__
        )
    )


def joined(first: Traces, second: Traces) -> Traces:
    """All of both."""
    size = max(first.kind.shape[1], second.kind.shape[1])
    first, second = padded(first, size), padded(second, size)
    return Traces(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in first.__dataclass_fields__))
