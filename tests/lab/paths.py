"""What is found along one flight: sign changes, clearance, the next impact, integrals."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
import saltus_core as core

from bvp.closures import contact_of
from bvp.kernels import energy_budget, impact
from bvp.kernels.contact_mode import restitute_state
from bvp.multipoint import observed_of
from bvp.simulate import checked_state
from tests.core.systems import core_of
from tests.lab.flights import LinearFlight

__all__ = [
    "ImpactStatus", "NextImpact", "clearance", "integral", "next_hit", "next_impact", "restitute", "sign_changes",
]  # fmt: skip


def sign_changes(system, row, z, duration, sign=0):
    """Return the number of sign changes of w = row . (u, v) in a flight from the modal state z after an earlier sign, and the last one."""
    modes = system.modes
    value = np.ascontiguousarray(modes.to_state.T @ row)
    rate = np.ascontiguousarray(value @ modes.matrix)
    second = np.ascontiguousarray(rate @ modes.matrix)
    return core.sign_changes(core_of(modes)[0], np.array([value, rate, second]), z, float(duration), sign)


def clearance(system, z, duration, first_of_equal=False):
    """Return the smallest distance of the first stop's gap coordinate from its bounds at a turning point inside a flight, the side and the
    time; infinite without turning points. first_of_equal: of distances that are equal to rounding the first counts."""
    observed = observed_of(system)
    rows, (lower, upper) = np.ascontiguousarray(observed.rows[0]), observed.bounds[:, 0]
    tie = core.tie_of(*rows[:2], z, z, float(duration)) if first_of_equal else 0.0
    return core.clearance(core_of(system.modes)[0], rows, lower, upper, z, float(duration), tie)


def integral(system, first, second, z, t, by=None):
    """Return the integral of (first . z(s)) (second . z(s)) for 0 <= s <= t, of rows and a state in (u, v).

    by : None, "series" or "doubling"
        How it is summed; None: as the core chooses.
    """
    modes = system.modes
    rows = [np.array([row]) @ modes.to_state for row in (first, second)]
    products, start, out = energy_budget.Products(rows[0], rows[1], np.ones(1)), modes.from_state @ z, np.zeros(1)
    work, fastest = energy_budget.integral_work(len(z), 1), LinearFlight(system).fastest_rate
    if by is None:
        energy_budget.integrals(modes.flight, products, start, t, work, out)
    elif by == "series":
        energy_budget.series_integrals(modes.flight, products, start, t, fastest, int(fastest * t) + 1, work, out)
    else:
        energy_budget.doubled_integrals(modes.flight, products, start, t, fastest, out)
    return out[0]


ImpactStatus = Enum("ImpactStatus", "NONE HIT TOUCH PRESSED OUTSIDE EXHAUSTED", start=0)
"""What the search for the next impact found."""


@dataclass(frozen=True, eq=False)
class NextImpact:
    """The end of a free flight: status, time, letter of the contact ("" where there is none), state (u, v) there before any
    impact, and the speed of approach side * w' (>= 0 at a hit)."""

    status: ImpactStatus
    time: float
    contact: str
    u: np.ndarray
    v: np.ndarray
    speed: float


def next_impact(system, u, v, horizon, leaving=None):
    """Return the first impact or touch of the free flight from (u, v) up to the horizon; `leaving`: letter of the contact that the start
    is on exactly.

    >>> from bvp.system import ImpactSystem, Stop
    >>> oscillator = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), upper=1.0)])
    >>> found = next_impact(oscillator, [0.0], [2.0], 10.0)
    >>> found.contact, round(found.time * 6 / np.pi, 12), round(found.speed**2, 12)
    ('+', 1.0, 3.0)
    """
    modes, n = system.modes, system.degrees_of_freedom
    z = modes.from_state @ checked_state(system, u, v)
    flight, contacts = core_of(modes)
    left = -1 if leaving is None else contact_of(system, leaving)
    status, contact, time = core.next_impact(flight, contacts, left, False, z, float(horizon))
    end = flight.end(z, time)
    state = modes.to_state @ end
    speed = float(modes.contacts.side[contact] * (modes.contacts.rate[contact] @ end)) if contact >= 0 else 0.0
    letter = modes.contact_letters[contact] if contact >= 0 else ""
    return NextImpact(ImpactStatus(status), float(time), letter, state[:n], state[n:], speed)


def next_hit(system, z, leaving, horizon):
    """Return (status, contact, time) of the first hit from the modal state z, where touches are skipped; contact -1: none. leaving: the
    contact that the start is on, -1 for none."""
    contacts = system.modes.contacts
    work = impact.work_array(len(z), len(contacts.side))
    status, contact, time = impact.next_hit(system.modes.flight, contacts, leaving, z.copy(), horizon, work, np.zeros(len(z)))
    return ImpactStatus(status), contact, time


def restitute(system, contact, v):
    """Return the velocities after an impact at the contact with this letter."""
    n = system.degrees_of_freedom
    z = system.modes.from_state @ checked_state(system, np.zeros(n), v)
    restitute_state(system.modes.contacts, contact_of(system, contact), z, z)
    return (system.modes.to_state @ z)[n:]
