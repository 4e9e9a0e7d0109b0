"""The next impact of a system from a state, and the velocities after an impact, as the kernels find them."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from bvp.closures import contact_of
from bvp.kernels import impact as kernels
from bvp.kernels.contact_mode import restitute_state
from bvp.kernels.flight import flow_state
from bvp.simulate import checked_state

ImpactStatus = Enum("ImpactStatus", "NONE HIT TOUCH PRESSED OUTSIDE EXHAUSTED", start=0)
"""What the search for the next impact found, as the kernel numbers it."""


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
    """The first impact or touch of the free flight from (u, v) up to the horizon; `leaving`: letter of the contact that the start is on
    exactly.

    >>> from bvp.system import ImpactSystem, Stop
    >>> oscillator = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), upper=1.0)])
    >>> found = next_impact(oscillator, [0.0], [2.0], 10.0)
    >>> found.contact, round(found.time * 6 / np.pi, 12), round(found.speed**2, 12)
    ('+', 1.0, 3.0)
    """
    modes = system.modes
    n = system.degrees_of_freedom
    z = modes.from_state @ checked_state(system, u, v)
    work = kernels.work_array(len(z), len(modes.contacts.side))
    left = -1 if leaving is None else contact_of(system, leaving)
    status, contact, time = kernels.next_impact(modes.flight, modes.contacts, left, z, float(horizon), work)
    end = np.empty_like(z)
    flow_state(modes.flight, z, time, end)
    state = modes.to_state @ end
    speed = float(modes.contacts.side[contact] * (modes.contacts.rate[contact] @ end)) if contact >= 0 else 0.0
    letter = modes.contact_letters[contact] if contact >= 0 else ""
    return NextImpact(ImpactStatus(status), float(time), letter, state[:n], state[n:], speed)


def restitute(system, contact, v):
    """Velocities after an impact at the contact with this letter."""
    n = system.degrees_of_freedom
    z = system.modes.from_state @ checked_state(system, np.zeros(n), v)
    restitute_state(system.modes.contacts, contact_of(system, contact), z, z)
    return (system.modes.to_state @ z)[n:]
