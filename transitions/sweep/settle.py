"""Simulate a forced motion until its transient is gone, and say what it has settled to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np

from bvp.checks import is_finite, is_whole
from bvp.forcing import Force
from bvp.motion import MotionStatus
from bvp.multipliers import sort_multipliers
from bvp.system import ImpactSystem
from bvp.texts import brief, shown
from transitions.sweep.forced import Carried, ForcedMotion, ImpactRecord, PeriodRecord, carried_into, require_inside
from transitions.sweep.returns import (
    RETURN,
    SLACK,
    distance_scale,
    drift_directions,
    find_period,
    largest_exponent,
    mean_growth,
    multipliers_of,
    shortest_period,
    without_drift,
)

__all__ = ["Settled", "SettledKind", "settle"]

CLOSED = 1e-11
"""Distance of a return, relative to the largest state, at which the transient is gone."""

FIRST, LARGEST = 64, 2048
"""Periods of the first block and of the largest one. Each is twice as long as the one before."""

MOST = 20_000
"""Periods that are simulated at most, unless something else is asked for."""

CERTAIN = 1024
"""Periods after which a motion can be called chaotic."""

SIGMAS = 5.0
"""Standard errors that decide the sign of an exponent."""

NEUTRAL = 1e-3
"""Growth in a period below which a motion that does not return is called quasiperiodic."""

DECAY = 1e-12
"""Decay in a period that rounding can leave to a motion which neither grows nor decays."""

PARTS = 16
"""Parts of a block whose means give the standard error of its growth."""


class SettledKind(Enum):
    """What a motion has settled to. The value says it in words."""

    PERIODIC = "a periodic motion"
    AT_REST = "rest: it sticks to its stops for ever"
    TORUS = "probably quasiperiodic motion (a torus): it does not return, and a tangent vector neither grows nor shrinks"
    CHAOS = "chaotic motion: a tangent vector grows"
    LONG_PERIOD = "it has settled"
    NOT_CONVERGED = "it has not settled yet; allow more periods"
    FAILED = "the simulation ended before it settled"


@brief
@dataclass(frozen=True, eq=False)
class Settled:
    """What a forced motion has settled to.

    Attributes
    ----------
    kind : SettledKind
    period : int
        p, in periods of the loads. For NOT_CONVERGED the period that the returns suggest. 0 if there is none.
    states : (p, 2n) ndarray
        (u, v) at phase 0 of the loads, at the start of each of the p periods; the last state alone if p is 0.
    impacts : ImpactRecord
        Impacts in these p periods, from states[0]; of one period if p is 0.
    stops : tuple of str
        Letter of the contact of each impact.
    sticking : tuple of str
        Contacts that stick all the time.
    sticking_time : float
        Time with a sticking contact, in the same periods as `impacts`.
    period_of_loads : float
        2 pi/w.
    multipliers : (2n - f,) complex ndarray
        Of p stroboscopic maps, as `sort_multipliers` orders them, without those of f directions of drift; empty if not periodic.
    drift : (n,) ndarray
        Growth of the displacements in p periods; not 0 where no spring and no stop acts along it.
    growth : float
        Mean growth of a tangent vector in a period of the loads; for a periodic motion the logarithm of its largest multiplier over p.
    growth_error : float
        Its standard error; 0 for a periodic motion.
    distance : float
        Distance of the last return, of (w u, v), relative to the largest state; NaN if p is 0.
    elapsed : int
        Periods that were simulated.
    status : MotionStatus
        How the simulation ended, for FAILED.
    remaining : float
        For NOT_CONVERGED the periods after which the motion is expected to return, from its rate; NaN if it does not certainly decay.
    longest : int
        For LONG_PERIOD the largest period that was sought: that of the motion is above.
    """

    kind: SettledKind
    period: int
    states: np.ndarray
    impacts: ImpactRecord
    stops: tuple[str, ...]
    period_of_loads: float
    distance: float
    sticking: tuple[str, ...] = ()
    sticking_time: float = 0.0
    multipliers: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=complex))
    growth: float = math.nan
    growth_error: float = 0.0
    elapsed: int = 0
    status: MotionStatus = MotionStatus.DURATION_REACHED
    remaining: float = math.nan
    longest: int = 0
    drift: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def exponent(self) -> float:
        """Largest Lyapunov exponent, per unit of time."""
        return self.growth / self.period_of_loads

    @property
    def text(self) -> str:
        """What was found, in one line."""
        after = f"after {self.elapsed} {self._counted}"
        return f"{self.kind.value}, {after}: {self.status.value}" if self.kind is SettledKind.FAILED else self._found(after)

    _counted = "periods of the loads"
    """What `elapsed` counts."""

    def _found(self, after: str) -> str:
        """What was found in a simulation that did not fail."""
        rate = f"growth {self.growth:.4g}{self.growth_error and f' +- {self.growth_error:.1g}' or ''} in a period"
        if self.kind is SettledKind.PERIODIC:
            stuck = f", {' and '.join(self.sticking)} sticking all the time" if self.sticking else ""
            drift = f", drifting by {', '.join(f'{part:.6g}' for part in self.drift)} in its period" if np.any(self.drift) else ""
            return f"{self.kind.value} of period {self.period} with {len(self.impacts)} impacts{stuck}{drift}, {after}; {rate}"
        if self.kind is SettledKind.NOT_CONVERGED:
            near = f"; near period {self.period}, {self.distance:.1e} from closing" if self.period else ""
            more = f"; about {float(f'{self.remaining:.2g}'):.7g} more are expected" if self.remaining > 0.0 else ""
            return f"{self.kind.value} ({after}{near}; {rate}{more})"
        long = f", but its period is above {self.longest}" if self.longest else ""
        return f"{self.kind.value}{long} ({after}; {rate})"

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"Settled: {self.text}", []


def settle(
    system: ImpactSystem,
    forces: Sequence[Force],
    u: Any = None,
    v: Any = None,
    *,
    phase: float = 0.0,
    most: int = MOST,
    longest: int = 128,
    on_progress: Callable[[int], object] | None = None,
) -> Settled:
    """Simulate a motion under periodic loads until its transient is gone.

    It is periodic if its states at phase 0 return to rounding. Otherwise the growth of a tangent vector decides between chaos, a torus and
    a motion that needs more periods. A transient can look like each of these for any time, so all but a periodic motion is a
    statement about the periods that were simulated.

    Parameters
    ----------
    system : ImpactSystem
    forces : sequence of loads
        Harmonic with a common base frequency w, and constant.
    u, v : (n,) array_like, optional
        The start; by default rest at zero, moved to the bounds of the stops that exclude it.
    phase : float
        Phase w t of the start, in [0, 2 pi).
    most : int
        Most periods.
    longest : int
        Largest period p that is sought.
    on_progress : callable, optional
        Called with the number of periods that were simulated.

    Returns
    -------
    Settled

    Raises
    ------
    BeyondStop
        For a start beyond a stop.
    ValueError
        For loads without a base frequency, other numbers than those expected.

    Examples
    --------
    >>> from bvp.forcing import Harmonic
    >>> from bvp.system import ImpactSystem, Stop
    >>> oscillator = ImpactSystem([[1.0]], [[0.1]], [[1.0]], [Stop((1.0,), upper=1.0, restitution=0.8)])
    >>> found = settle(oscillator, [Harmonic(1.0, [0.099])])
    >>> found.kind.name, found.period, len(found.impacts)
    ('PERIODIC', 1, 0)
    """
    if not (is_finite(phase) and 0.0 <= phase < 2.0 * math.pi):
        raise ValueError(f"phase is a number from 0 to below 2 pi; received {shown(phase)}")
    for name, value in (("most", most), ("longest", longest)):
        if not is_whole(value, 1, 10**9):
            raise ValueError(f"{name} is an integer above 0; received {shown(value)}")
    n = system.degrees_of_freedom
    zero = np.zeros(n)
    start = Carried(require_inside(system, zero if u is None else u, zero if v is None else v)) if u is not None or v is not None else None
    motion = ForcedMotion(system, forces, start or carried_into(system, Carried(np.zeros(2 * n)))[0], phase=phase)
    frequency = 2.0 * math.pi / motion.period
    elapsed, block, last = 0, FIRST, math.nan
    rate = max(np.linalg.eigvals(system.modes.matrix), key=np.real)
    growths, states = np.zeros(0), np.zeros((0, 2 * n))
    while True:
        motion.renew_tangent()
        record = motion.advance(max(1, min(block, most - elapsed)), peaks=True)
        elapsed += len(record.states)
        if on_progress is not None:
            on_progress(elapsed)
        # Of the growths the later half counts: the tangent vector has turned by then.
        growths = np.concatenate([growths, record.growths])
        states = np.concatenate([states, without_drift(system, record.states)])[-2 * longest :]
        peaks = None if drift_directions(system).size else record.peaks
        record = replace(record, growths=growths[len(growths) // 2 :], states=states, peaks=peaks)
        if record.status is not MotionStatus.DURATION_REACHED:
            return _settled(SettledKind.FAILED, 0, motion, record, elapsed)
        size = _size(record, frequency)
        p = find_period(states, frequency, mean_growth(record.growths), math.inf, size)
        if p:
            distance = _return(states, p, frequency, size)
            # Rounding ends the convergence. A motion that keeps its distance has come as close as it will.
            if distance <= CLOSED or (distance <= RETURN and distance >= 0.5 * last):
                return _settled(SettledKind.PERIODIC, p, motion, record, elapsed)
            last = distance
        growth, error = _growth(record.growths)
        if not p and elapsed >= CERTAIN and growth > max(SIGMAS * error, NEUTRAL):
            return _settled(SettledKind.CHAOS, 0, motion, record, elapsed)
        # Weighted means leave out what only turns, whose size hides a slow decay. On a torus a tangent vector keeps its size.
        error = min(error, _growth(record.growths, mean_growth)[1])
        decays = math.isfinite(growth) and growth < -max(SIGMAS * error, DECAY)
        remaining = _remaining(record, frequency, size, growth, longest) if decays else math.nan
        # Free flight that creeps to a place between the stops goes on as it does. More than twice the periods that are left are too many.
        creeps = system.smooth_forces is None and not (rate.imag or record.count or record.sticking_time)
        is_late = creeps and remaining > 2.0 * (most - elapsed)
        if elapsed >= most or (is_late and not carried_into(system, Carried(states[-1] - (states[-1] - states[-2]) / growth))[1]):
            break
        block = min(2 * block, LARGEST)
    p = p or find_period(states, frequency, growth, elapsed, size)
    if p and _return(states, p, frequency, size) <= RETURN:
        return _settled(SettledKind.PERIODIC, p, motion, record, elapsed)
    halves = [abs(mean_growth(part)) for part in np.array_split(record.growths, 2)]
    if not p and decays and SLACK * math.exp(growth * len(record.growths)) < RETURN:  # it would have returned
        return replace(_settled(SettledKind.LONG_PERIOD, 0, motion, record, elapsed), growth_error=error, longest=longest)
    torus = not p and elapsed >= CERTAIN and max(halves) <= NEUTRAL and not decays
    found = _settled(SettledKind.TORUS if torus else SettledKind.NOT_CONVERGED, p, motion, record, elapsed)
    return replace(found, growth_error=error, remaining=remaining)


def _remaining(record: PeriodRecord, frequency: float, size: float, growth: float, longest: int) -> float:
    """Periods after which the closest return is as close as one that counts, if its distance decays by exp(growth) in each. NaN if it has
    not decayed so in the periods whose growths count."""
    count = min(longest, len(record.states) // 2)
    p = min(range(1, count + 1), key=lambda p: _return(record.states, p, frequency, size), default=0)
    p = shortest_period(distance_scale(record.states, frequency), p, growth, size)
    nearest = _return(record.states, p, frequency, size) if p else 0.0
    decayed = RETURN < nearest <= SLACK * math.exp(growth * len(record.growths))
    return math.log(nearest / RETURN) / -growth if decayed else math.nan


def _size(record: PeriodRecord, frequency: float) -> float:
    """Size of the largest state (w u, v): at phase 0, or w times the largest displacement."""
    largest = float(np.linalg.norm(distance_scale(record.states, frequency), axis=1).max())
    return largest if record.peaks is None else max(largest, frequency * float(record.peaks.max()))


def _return(states: np.ndarray, p: int, frequency: float, size: float) -> float:
    """Distance of the last p states from those p before, relative to a size."""
    points = distance_scale(states, frequency)
    return float(np.linalg.norm(points[-p:] - points[-2 * p : -p], axis=1).max()) / size if size > 0.0 else 0.0


def _growth(growths: np.ndarray, mean_of: Callable[[np.ndarray], float] = np.mean) -> tuple[float, float]:
    """The mean growth in a period, and its standard error by the means of parts."""
    mean = mean_growth(growths)
    if not math.isfinite(mean):
        return mean, 0.0
    parts = np.array([mean_of(part) for part in np.array_split(growths, min(PARTS, len(growths)))])
    return mean, float(parts.std(ddof=1) / math.sqrt(len(parts))) if len(parts) > 1 else math.inf


def _settled(kind: SettledKind, p: int, motion: ForcedMotion, record: PeriodRecord, elapsed: int) -> Settled:
    """The result, with the impacts of the next p periods."""
    growth, error = _growth(record.growths)
    start = motion.carried.state
    if kind is SettledKind.FAILED:
        orbit, states = record, start[None]
    else:
        orbit = motion.advance(max(p, 1), impacts=True)
        states = np.concatenate([start[None], orbit.states[:-1]])[: max(p, 1)]
    multipliers = np.zeros(0, dtype=complex)
    if kind is SettledKind.PERIODIC:
        monodromy = motion.monodromy(p)
        if not np.isfinite(monodromy).all():
            raise RuntimeError("the derivatives of the settled motion are no numbers: a force has none, as |w|^p can at w = 0")
        multipliers = sort_multipliers(multipliers_of(motion.system, monodromy))
        growth, error = largest_exponent(multipliers, float(p)), 0.0
    kept = motion.named(int(np.bitwise_and.reduce(orbit.kept))) if len(orbit.kept) else ()
    n = motion.system.degrees_of_freedom
    free = drift_directions(motion.system)
    drift = free @ (free.T @ (orbit.states[-1] - start)[:n]) if kind is SettledKind.PERIODIC else np.zeros(n)
    drift[np.abs(drift) <= CLOSED * np.abs(start[:n]).max(initial=0.0)] = 0.0
    if kind is SettledKind.PERIODIC and kept and not (orbit.count or np.any(states[:, n:]) or np.any(orbit.states[:, n:])):
        kind = SettledKind.AT_REST
    frequency = 2.0 * math.pi / motion.period
    letters = motion.system.modes.contact_letters
    return Settled(
        kind=kind,
        period=p,
        states=states,
        impacts=orbit.impacts,
        stops=tuple(letters[c] for c in orbit.impacts.contacts),
        sticking=kept,
        sticking_time=orbit.sticking_time,
        period_of_loads=motion.period,
        multipliers=multipliers,
        growth=growth,
        growth_error=error,
        distance=_return(record.states, p, frequency, _size(record, frequency)) if p else math.nan,
        elapsed=elapsed,
        status=record.status,
        drift=drift,
    )
