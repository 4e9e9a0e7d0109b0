"""The next impact of a system from a state, and what an impact does to the velocities."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import reals
from bvp.kernels import impact as kernels
from bvp.kernels.flight import flow_state
from bvp.kernels.restitution import restitute as restitute_modes
from bvp.shown import shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["CONTACT_TOLERANCE", "ImpactStatus", "NextImpact", "checked_state", "contact_index", "next_impact", "restitute"]

CONTACT_TOLERANCE = kernels.CONTACT_TOLERANCE


class ImpactStatus(Enum):
    """What the search for the next impact found; the value says it in words."""

    NONE = "no stop is reached up to the horizon"
    HIT = "a stop is hit"
    TOUCH = "the gap turns within the contact tolerance of a stop and goes on without an impact"
    PRESSED = "the motion stays pressed against the stop that it starts on"
    OUTSIDE = "the start lies beyond a stop; start with every gap coordinate within its bounds"
    EXHAUSTED = "the search gave up; ask for a shorter horizon"


_STATUS = {
    kernels.NONE: ImpactStatus.NONE,
    kernels.HIT: ImpactStatus.HIT,
    kernels.TOUCH: ImpactStatus.TOUCH,
    kernels.PRESSED: ImpactStatus.PRESSED,
    kernels.OUTSIDE: ImpactStatus.OUTSIDE,
    kernels.EXHAUSTED: ImpactStatus.EXHAUSTED,
}


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


def next_impact(system: ImpactSystem, u: Any, v: Any, horizon: float, leaving: str | None = None) -> NextImpact:
    """The first impact or touch of the free flight from (u, v), found by bounds, none missed.

    Parameters
    ----------
    system : ImpactSystem
    u, v : (n,) array_like
    horizon : float
        Time up to which to look, >= 0 and finite.
    leaving : str, optional
        Letter of the contact that the start is on exactly.

    Returns
    -------
    NextImpact

    Raises
    ------
    ValueError
        For a state of the wrong length or not finite, a horizon that is negative or not finite, an unknown contact.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> oscillator = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), upper=1.0)])
    >>> found = next_impact(oscillator, [0.0], [2.0], 10.0)
    >>> found.contact, round(found.time * 6 / np.pi, 12), round(found.speed**2, 12)
    ('+', 1.0, 3.0)
    """
    modes = system.modes
    state = checked_state(system, u, v)
    if not (isinstance(horizon, (int, float, np.number)) and 0.0 <= horizon < np.inf):
        raise ValueError(f"horizon is a finite time of 0 or more; received {shown(horizon)}")
    z = modes.from_state @ state
    work = kernels.work_array(len(z), len(modes.contact_side))
    status, contact, time = kernels.next_impact(
        *modes.blocks, *modes.contacts, contact_index(system, leaving), z, float(horizon), work
    )
    end = np.empty_like(z)
    flow_state(*modes.blocks, z, time, end)
    state = modes.to_state @ end
    n = system.degrees_of_freedom
    speed = float(modes.contact_side[contact] * (modes.contact_rate[contact] @ end)) if contact >= 0 else 0.0
    letter = modes.contact_letters[contact] if contact >= 0 else ""
    return NextImpact(_STATUS[status], float(time), letter, state[:n], state[n:], speed)


def restitute(system: ImpactSystem, contact: str, v: Any) -> np.ndarray:
    """Velocities after an impact: v - (1 + r) M^-1 c (c . v)/(c . M^-1 c), Newton's restitution.

    Parameters
    ----------
    system : ImpactSystem
    contact : str
        Letter of the contact.
    v : (n,) array_like
        Velocities before it.

    Raises
    ------
    ValueError
        For an unknown contact, for velocities of the wrong length or not finite.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> (restitute(vibro_impact_nes(mu=1.0, sigma=0.1), "+", [2.0, 0.0]) + 1.0).round(12)
    array([1., 3.])
    """
    modes = system.modes
    n = system.degrees_of_freedom
    z = modes.from_state @ checked_state(system, np.zeros(n), v)
    index = contact_index(system, contact)
    if index < 0:
        raise ValueError(f"no contact was given; the system has {', '.join(modes.contact_letters)}")
    restitute_modes(modes.contact_rate, modes.contact_push, modes.contact_restitution, index, z, z)
    return (modes.to_state @ z)[n:]


def checked_state(system: ImpactSystem, u: Any, v: Any) -> np.ndarray:
    """(u, v) as one finite array of length 2n; ValueError else."""
    n = system.degrees_of_freedom
    parts = []
    for name, value in (("u", u), ("v", v)):
        try:
            part = reals(value)
        except (TypeError, ValueError):
            raise ValueError(f"{name} is a list of {n} numbers; received {shown(value)}") from None
        if part.shape != (n,) or not np.all(np.isfinite(part)):
            raise ValueError(f"{name} is a list of {n} finite numbers; received {part.tolist()}")
        parts.append(part)
    return np.concatenate(parts)


def contact_index(system: ImpactSystem, letter: str | None) -> int:
    """Index of a contact by its letter, -1 for None; ValueError with the nearest letter for an unknown one."""
    if letter is None:
        return -1
    letters = system.modes.contact_letters
    if letter not in letters:
        near = get_close_matches(str(letter), letters, 1, 0.0)
        raise ValueError(f"no contact {shown(letter)}; nearest: {near[0]!r}, all: {', '.join(letters)}")
    return letters.index(letter)
