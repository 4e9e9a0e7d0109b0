"""Following one-parameter families of solutions: step control, events, switching; any problem, no mechanics.

The public names are loaded when first used, so importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from continuation.ends import End, EndReason, Tally
    from continuation.engine import follow
    from continuation.generic import GenericProblem
    from continuation.location import Location, bracketed_root
    from continuation.problem import Event, EventDetails, Point, Problem, Step, Test
    from continuation.run import Run, trace
    from continuation.settings import Settings, SettingsError
    from continuation.switching import SwitchError, branch_directions, switch

__all__ = [
    "End",
    "EndReason",
    "Event",
    "EventDetails",
    "GenericProblem",
    "Location",
    "Point",
    "Problem",
    "Run",
    "Settings",
    "SettingsError",
    "Step",
    "SwitchError",
    "Tally",
    "Test",
    "bracketed_root",
    "branch_directions",
    "follow",
    "switch",
    "trace",
]

_HOME = {
    "End": "ends",
    "EndReason": "ends",
    "Event": "problem",
    "EventDetails": "problem",
    "GenericProblem": "generic",
    "Location": "location",
    "Point": "problem",
    "Problem": "problem",
    "Run": "run",
    "Settings": "settings",
    "SettingsError": "settings",
    "Step": "problem",
    "SwitchError": "switching",
    "Tally": "ends",
    "Test": "problem",
    "bracketed_root": "location",
    "branch_directions": "switching",
    "follow": "engine",
    "switch": "switching",
    "trace": "run",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
