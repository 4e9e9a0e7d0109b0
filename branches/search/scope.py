"""Which systems a scan of starts can search, and the words in which others are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["START_FROM_A_STATE", "require_conservative", "require_one_stop", "require_two_degrees"]

START_FROM_A_STATE = "start its families from a given state"
"""Advice where a scan cannot find them."""


def require_conservative(system: ImpactSystem, what: str) -> None:
    """Refuse a system that loses energy, or is driven.

    Parameters
    ----------
    system : ImpactSystem
    what : str
        What needs it, the subject of the sentence.

    Raises
    ------
    ValueError
    """
    reason = system.why_not_conservative()
    if reason is not None:
        raise ValueError(f"{what} need a conservative system: {reason}; its motion is for saltus run")


def require_two_degrees(system: ImpactSystem, what: str, advice: str = "") -> None:
    """Refuse another number of degrees of freedom.

    Parameters
    ----------
    system : ImpactSystem
    what : str
        What is for two degrees of freedom, up to the preposition.
    advice : str
        What to do instead.

    Raises
    ------
    ValueError
    """
    if system.degrees_of_freedom != 2:
        raise ValueError(f"{what} two degrees of freedom; this system has {system.degrees_of_freedom}{': ' if advice else ''}{advice}")


def require_one_stop(system: ImpactSystem, what: str) -> None:
    """Refuse another number of stops; parameters as for `require_two_degrees`.

    Raises
    ------
    ValueError
    """
    if len(system.stops) != 1:
        raise ValueError(f"{what} a system with one stop; this one has {len(system.stops)}")
