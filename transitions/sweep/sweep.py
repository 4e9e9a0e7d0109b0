"""Sweeps: a forced motion is simulated for one value of a parameter after the other, and goes on from where it was.

The parameter changes at phase 0 of the loads, between two periods. So the phase is continuous there, also if the frequency is the
parameter, and so is the state (u, v).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bvp.checks import finite_numbers, is_whole
from bvp.forcing import Force
from bvp.motion import MotionStatus
from bvp.system import ImpactSystem
from bvp.texts import brief, shown
from transitions.sweep.forced import Carried, ForcedMotion, carried_into, require_inside
from transitions.sweep.returns import drift_directions, find_period, largest_exponent, mean_growth, multipliers_of, without_drift

__all__ = ["Sweep", "SweepSettings", "System", "join_sweeps", "sweep"]

System = Callable[[float], "tuple[ImpactSystem, Sequence[Force]]"]
"""The system and its loads at a value of the parameter."""

MOST = 10**7
"""Largest number of periods."""


@dataclass(frozen=True)
class SweepSettings:
    """How long each value is simulated.

    Attributes
    ----------
    transient : int
        Periods of the loads that are left out after the parameter has changed.
    record : int
        Periods that are recorded.
    """

    transient: int = 200
    record: int = 100

    def __post_init__(self) -> None:
        for name, least in (("transient", 0), ("record", 1)):
            value = getattr(self, name)
            if not is_whole(value, least, MOST):
                raise ValueError(f"{name} is an integer from {least} to {MOST}; received {shown(value)}")


@brief
@dataclass(frozen=True, eq=False)
class Sweep:
    """Forced motion at V values of a parameter, in the order of the sweep, of a system with n coordinates. R periods are recorded at each.

    Attributes
    ----------
    coordinates : tuple of n str
    contacts : tuple of str
        Letters of the contacts.
    parts : tuple of D + S str
        Names of the dampers, then of the stops ("stop a").
    values, loads : (V,) ndarray
        The parameter; base frequency w of the loads.
    states : (V, R, 2n) ndarray
        (u, v) at phase 0, at the end of each recorded period; NaN after the simulation ended.
    periods : (V,) int64 ndarray
        Period of the motion in periods of the loads, 0 if none was found (`find_period`).
    exponents : (V,) ndarray
        Largest Lyapunov exponent of the stroboscopic map, per unit of time. For a periodic motion it follows from its multipliers, else
        from the growth of a tangent vector in the recorded periods. -inf where a sticking stop takes every tangent vector away.
    impact_rates, sticking : (V,) ndarray
        Impacts in a period; fraction of the time with a sticking contact. Bounces that are summed to their end are not counted.
    peaks : (V, n) ndarray
        Largest |u|.
    dissipated : (V, D + S) ndarray
        Energy dissipated by each damper and stop in a period.
    work : (V,) ndarray
        Work of the loads in a period.
    moved : (V,) ndarray
        Largest distance by which a gap was moved to its stop when the parameter changed; 0 where the state was carried as it was.
    released : tuple of V tuples of str
        Contacts that stuck before the parameter changed, and that the loads pull open at the new value.
    statuses : tuple of V MotionStatus
        How the simulation ended. After any but DURATION_REACHED the next value goes on from the state before this one.
    offsets : (V + 1,) int64 ndarray
        Impacts offsets[k] to offsets[k + 1] belong to value k.
    impact_contacts, impact_periods : (Q,) int64 ndarray
        Contact of each impact, and recorded period.
    impact_phases, impact_speeds : (Q,) ndarray
        Phase w t in [0, 2 pi), and speed of approach.
    """

    coordinates: tuple[str, ...]
    contacts: tuple[str, ...]
    parts: tuple[str, ...]
    values: np.ndarray
    loads: np.ndarray
    states: np.ndarray
    periods: np.ndarray
    exponents: np.ndarray
    impact_rates: np.ndarray
    sticking: np.ndarray
    peaks: np.ndarray
    dissipated: np.ndarray
    work: np.ndarray
    moved: np.ndarray
    released: tuple[tuple[str, ...], ...]
    statuses: tuple[MotionStatus, ...]
    offsets: np.ndarray
    impact_contacts: np.ndarray
    impact_periods: np.ndarray
    impact_phases: np.ndarray
    impact_speeds: np.ndarray

    def __len__(self) -> int:
        return len(self.values)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        title = f"Sweep over {len(self)} values, {self.values[0]:.6g} to {self.values[-1]:.6g}" if len(self) else "Sweep over no values"
        found = {p: int(np.sum(self.periods == p)) for p in np.unique(self.periods).tolist()}
        return title, [("periods", ", ".join(f"{count} of {p or 'no period'}" for p, count in found.items()))]


def sweep(
    at: System,
    values: Any,
    *,
    u: Any = None,
    v: Any = None,
    start: Carried | None = None,
    settings: SweepSettings | None = None,
    on_value: Callable[[int], object] | None = None,
) -> tuple[Sweep, Carried]:
    """Simulate a forced motion for one value of a parameter after the other. State and phase are carried over.

    A new value can put the state beyond a stop, if a gap or a stop depends on it. The state is then moved to the stop along M^-1 c, and the
    distance is recorded (`Sweep.moved`). A contact that sticks goes on to stick if its contact force presses at the new value. If not, it
    opens at once, and is recorded (`Sweep.released`).

    Parameters
    ----------
    at : callable
        at(value) returns the system and its loads: harmonic ones with a common base frequency, and constant ones.
    values : (V,) array_like
        Values of the parameter, in the order of the sweep.
    u, v : (n,) array_like, optional
        The start at the first value, at phase 0; by default rest at zero, moved to the bounds of the stops that exclude it.
    start : Carried, optional
        In place of u and v: a state from the end of another sweep, which this one goes on from.
    settings : SweepSettings, optional
    on_value : callable, optional
        Called after each value with the number of values that are done.

    Returns
    -------
    Sweep, Carried
        The results, and the state at the end.

    Raises
    ------
    BeyondStop
        For a given u, v beyond a stop.
    ValueError
        What `at` raises; for loads without a base frequency.

    Examples
    --------
    >>> from bvp.forcing import Harmonic
    >>> from bvp.system import ImpactSystem, Stop
    >>> def at(s):
    ...     return ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), upper=s, restitution=0.8)]), [Harmonic(2.8, [1.0])]
    >>> found, end = sweep(at, [-0.10, -0.09, -0.05], u=[-0.66], settings=SweepSettings(400, 40))
    >>> found.periods
    array([1, 1, 2])
    """
    settings = settings or SweepSettings()
    given = finite_numbers(values, "values", None)
    carried = start
    parts = []
    for k, value in enumerate(given.tolist()):
        system, forces = at(value)
        n = system.degrees_of_freedom
        if carried is None and (u is not None or v is not None):
            zero = np.zeros(n)
            carried = Carried(require_inside(system, zero if u is None else u, zero if v is None else v))
        inside, moved = carried_into(system, carried or Carried(np.zeros(2 * n)))
        moved = 0.0 if carried is None else moved
        motion = ForcedMotion(system, forces, inside)
        part, ended = _one_value(motion, value, moved, settings)
        parts.append(part)
        carried = ended or carried or inside
        if on_value is not None:
            on_value(k + 1)
    if not parts or carried is None:
        raise ValueError("values has no entry; expected one value of the parameter at least")
    return join_sweeps(parts), carried


def _one_value(motion: ForcedMotion, value: float, moved: float, settings: SweepSettings) -> tuple[Sweep, Carried | None]:
    """The motion at one value, and the state at its end; None if the simulation ended before."""
    system = motion.system
    before = motion.advance(settings.transient) if settings.transient else None
    motion.renew_tangent()
    if before is not None and before.status is not MotionStatus.DURATION_REACHED:
        record = replace(before, states=before.states[:0], growths=before.growths[:0], kept=before.kept[:0], peaks=None)
    else:
        record = motion.advance(settings.record, impacts=True, peaks=True)
    complete = record.status is MotionStatus.DURATION_REACHED
    frequency = 2.0 * math.pi / motion.period
    growth = mean_growth(record.growths) if complete else math.nan
    elapsed = settings.transient + settings.record
    done, impacts = max(len(record.states), 1), record.impacts
    states = np.full((1, settings.record, 2 * system.degrees_of_freedom), math.nan)
    states[0, : len(record.states)] = record.states
    peaks = np.full((1, system.degrees_of_freedom), math.nan) if record.peaks is None else record.peaks[None]
    size = 0.0 if drift_directions(system).size else frequency * float(peaks.max())
    found = find_period(without_drift(system, record.states), frequency, growth, elapsed, size) if complete else 0
    carried = motion.carried if complete else None
    exponent = growth / motion.period
    if found and np.isfinite(monodromy := motion.monodromy(found)).all():
        exponent = largest_exponent(multipliers_of(system, monodromy), found * motion.period)
    blank = 1.0 if complete else math.nan
    made = Sweep(
        coordinates=system.coordinates,
        contacts=tuple(system.modes.contact_letters),
        parts=motion.parts,
        values=np.array([value]),
        loads=np.array([frequency]),
        states=states,
        periods=np.array([found], dtype=np.int64),
        exponents=np.array([exponent]),
        impact_rates=np.array([blank * record.count / done]),
        sticking=np.array([blank * record.sticking_time / (done * motion.period)]),
        peaks=blank * peaks,
        dissipated=blank * record.totals[None, :-1] / done,
        work=blank * record.totals[-1:] / done,
        moved=np.array([moved]),
        released=(motion.released,),
        statuses=(record.status,),
        offsets=np.array([0, len(impacts)], dtype=np.int64),
        impact_contacts=impacts.contacts,
        impact_periods=impacts.periods,
        impact_phases=np.minimum(impacts.times * frequency, math.nextafter(2.0 * math.pi, 0.0)),
        impact_speeds=impacts.speeds,
    )
    return made, carried


def join_sweeps(parts: Sequence[Sweep]) -> Sweep:
    """One sweep of several that go on from each other."""
    first = parts[0]
    joined: dict[str, Any] = {}
    for field in fields(Sweep):
        items = [getattr(part, field.name) for part in parts]
        if field.name in ("coordinates", "contacts", "parts"):
            joined[field.name] = getattr(first, field.name)
        elif field.name == "offsets":
            joined[field.name] = np.concatenate([[0], np.cumsum(np.concatenate([np.diff(item) for item in items]))])
        elif isinstance(items[0], tuple):
            joined[field.name] = tuple(entry for item in items for entry in item)
        else:
            joined[field.name] = np.concatenate(items)
    return Sweep(**joined)
