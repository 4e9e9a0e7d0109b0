"""What an impact does to the velocities of a system, and checks of a state and of a contact that are given."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import reals
from bvp.kernels.restitution import restitute as restitute_modes
from bvp.shown import shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["checked_state", "contact_index", "restitute"]


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
    restitute_modes(modes.contacts, index, z, z)
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
