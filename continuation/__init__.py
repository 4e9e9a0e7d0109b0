"""Continuation of one-parameter families of solutions: step control, events, switching. It works for any problem and knows no mechanics.

The public names are loaded when first used, so importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from continuation.control import Settings as Settings
    from continuation.control import SettingsError as SettingsError
    from continuation.engine import follow as follow
    from continuation.generic import GenericProblem as GenericProblem
    from continuation.location import Location as Location
    from continuation.location import bracketed_root as bracketed_root
    from continuation.problem import End as End
    from continuation.problem import EndReason as EndReason
    from continuation.problem import Event as Event
    from continuation.problem import EventDetails as EventDetails
    from continuation.problem import Point as Point
    from continuation.problem import Problem as Problem
    from continuation.problem import Step as Step
    from continuation.problem import Tally as Tally
    from continuation.problem import TestFunction as TestFunction
    from continuation.run import Run as Run
    from continuation.run import follow_both_ways as follow_both_ways
    from continuation.switching import SwitchError as SwitchError
    from continuation.switching import branch_directions as branch_directions
    from continuation.switching import other_branch_starts as other_branch_starts

_NAMES = {
    "control": ("Settings", "SettingsError"),
    "engine": ("follow",),
    "generic": ("GenericProblem",),
    "location": ("Location", "bracketed_root"),
    "problem": ("End", "EndReason", "Event", "EventDetails", "Point", "Problem", "Step", "Tally", "TestFunction"),
    "run": ("Run", "follow_both_ways"),
    "switching": ("SwitchError", "branch_directions", "other_branch_starts"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
