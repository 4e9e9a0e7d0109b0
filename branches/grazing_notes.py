"""What is said of a grazing: which flight touches which stop, which impact vanishes, which two merge.

Each function gives the stop's letter, the note, and ("touch", flight, time after its start), ("vanish", node, 0) or ("merge", flight, 0).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem, Solution

__all__ = ["describe_merging", "describe_touch", "describe_vanishing"]


def describe_touch(problem: MultipointProblem, solution: Solution) -> dict[str, Any]:
    """A flight touches a stop."""
    modes = problem.modes
    stop = int(solution["clearance_stop"])
    side = solution["clearance_side"]
    letter = next(x for c, x in enumerate(modes.contact_letters) if modes.contact_stop[c] == stop and modes.contact_side[c] == side)
    note = (
        f"flight {int(solution['clearance_flight']) + 1} of {problem.inner + 1} touches stop {letter} "
        f"at {solution['clearance_time']:.6g} after its start: a new impact becomes possible"
    )
    graze = ("touch", int(solution["clearance_flight"]), float(solution["clearance_time"]))
    return {"stop": letter, "note": note, "graze": graze}


def describe_vanishing(problem: MultipointProblem, solution: Solution) -> dict[str, Any]:
    """The speed of an impact reaches zero."""
    inner = problem.inner
    node = int(solution["speed_node"])
    stop = problem.modes.contact_letters[problem.contacts[node]]
    place = "at the far end" if node == inner else "at the start" if node == inner + 1 else f"{node + 1} of {inner}"
    note = f"the impact {place} (stop {stop}) vanishes: its speed reaches zero"
    return {"stop": stop, "note": note, "graze": ("vanish", node, 0.0)}


def describe_merging(problem: MultipointProblem, solution: Solution) -> dict[str, Any]:
    """A flight time reaches zero."""
    flight = int(solution["flight_index"])
    here = f"impact {flight}" if flight else "the start"
    there = f"impact {flight + 1}" if flight < problem.inner else "the far end"
    note = f"{here} and {there} merge: the flight between them has no duration"
    return {"note": note, "graze": ("merge", flight, 0.0)}
