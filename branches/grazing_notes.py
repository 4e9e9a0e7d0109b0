"""What is said of a grazing: which flight touches which stop, which impact vanishes, which two merge; and of what lies beyond one.

Each function gives the stop's letter, the note, and ("touch", flight, time after its start), ("vanish", node, 0) or ("merge", flight, 0).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem, Solution

__all__ = ["describe_merging", "describe_touch", "describe_vanishing", "unphysical"]

BEYOND = 1e-8
"""How far a solution of the equations may lie beyond a grazing, relative to gap, speed and period, and still count as the grazing orbit."""


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


def unphysical(problem: MultipointProblem, solution: Solution) -> str | None:
    """Why a solution of the equations is no orbit, in words; None where it is one: it passes beyond a stop, an impact pulls, or a flight
    goes back in time.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> from bvp.multipoint import MultipointProblem
    >>> problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    >>> start = problem.modes.from_state @ [0.0, 0.0, 4.6, 8.3]
    >>> unphysical(problem, problem.solve(problem.pack(start, [], [1.635]), quarter_period=1.635))
    'flight 1 of 1 passes beyond stop - by 0.96 at 0.813044 after its start'
    """
    inner = problem.inner
    if solution["clearance"] < -BEYOND:
        at = describe_touch(problem, solution)
        flight, time = at["graze"][1:]
        depth = -solution["clearance"]
        return f"flight {flight + 1} of {inner + 1} passes beyond stop {at['stop']} by {depth:.2g} at {time:.6g} after its start"
    if solution["speed"] < -BEYOND * (2.0 * solution["energy"]) ** 0.5:
        at = describe_vanishing(problem, solution)
        return f"{at['note'].partition(' vanishes')[0]} would have to pull: its speed of approach is {solution['speed']:.2g}"
    if solution["flight"] < -BEYOND * solution["quarter_period"]:
        flight = int(solution["flight_index"])
        return f"flight {flight + 1} of {inner + 1} goes back in time: it lasts {solution['flight']:.2g}"
    return None
