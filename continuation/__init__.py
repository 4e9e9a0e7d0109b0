"""Continuation of one-parameter families of solutions: step control, events, switching. It works for any problem and knows no mechanics."""

from continuation.bracketing import bracketed_root
from continuation.control import Settings, SettingsError
from continuation.engine import follow
from continuation.generic import GenericProblem
from continuation.location import Location
from continuation.problem import End, EndReason, Event, EventDetails, Point, Problem, Step, Tally, TestFunction
from continuation.run import Run, follow_both_ways
from continuation.switching import SwitchError, branch_directions, other_branch_starts

__all__ = [
    "End", "EndReason", "Event", "EventDetails", "GenericProblem", "Location", "Point", "Problem", "Run", "Settings", "SettingsError",
    "Step", "SwitchError", "Tally", "TestFunction", "branch_directions", "bracketed_root", "follow", "follow_both_ways",
    "other_branch_starts",
]  # fmt: skip
