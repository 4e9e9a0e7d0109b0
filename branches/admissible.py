"""Whether a solution of the equations is an orbit, and the three kinds of grazing at which its family ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, cast

from bvp.contact_sequence import pulled_open
from continuation.problem import TestFunction

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.multipoint import MultipointProblem, Solution

__all__ = ["BEYOND", "GRAZING", "INSTANT", "ForceEvent", "describe_grazing", "force_event", "unphysical"]

BEYOND = 1e-8
"""How far a solution of the equations may lie beyond a grazing, relative to gap, speed and period, and still count as the grazing orbit."""

INSTANT = 1e-6
"""Part of the period within which a touch is at an impact."""

_NO_SPEED = 1e-6
"""Part of the typical speed of an orbit below which an impact has none, where its flight touches the stop again at once."""

GRAZING = {
    "touches": TestFunction("GR", "guard", True, "a flight touches a stop"),
    "vanishes": TestFunction("GR", "guard", True, "the speed of an impact reaches zero"),
    "merge": TestFunction("GR", "guard", True, "a flight time reaches zero"),
}
"""The three kinds of grazing, by the verb of their notes, with their test functions."""


def describe_grazing(problem: MultipointProblem | ForcedProblem, solution: Solution, verb: str) -> dict[str, Any]:
    """What is known of a kind of grazing: the stop's letter and a note."""
    if verb == "touches":
        if solution["clearance_side"] == 0.0:
            letter = problem.modes.contact_letters[int(problem.contacts[int(solution["clearance_flight"])])]
            if solution["clearance_time"] == 0.0:
                return {"stop": letter, "note": f"the bounces at stop {letter} hardly end: the contact force behind them nearly vanishes"}
            return {"stop": letter, "note": f"the bounces at stop {letter} last too long to be summed from the first one on"}
        force = force_event(problem, solution)
        if force is not None:
            return {"stop": force.letter, "note": force.note}
        modes = problem.modes
        stop, side = int(solution["clearance_stop"]), solution["clearance_side"]
        letter = next(x for c, x in enumerate(modes.contact_letters) if modes.contact_stop[c] == stop and modes.contacts.side[c] == side)
        beside = _impact_beside(problem, solution, letter)
        if beside is not None:
            if solution["speed"] > _NO_SPEED * problem.speed(solution):
                return {"stop": letter, "note": f"the rebound at stop {letter} vanishes: its restitution reaches zero"}
            return _vanishing_impact(problem, beside)
        flight, time, flights = _whole_flight(problem, solution)
        where = f"flight {flight + 1} of {flights} touches stop {letter} at {time:.6g} after its start"
        events = getattr(problem, "events", ())
        pulled = pulled_open(problem.system, events[flight].closed, modes.contact_letters.index(letter)) if events else None
        if pulled is not None:
            return {"stop": letter, "note": f"{where}: its impact would pull stop {modes.contact_letters[pulled]} open, which sticks"}
        return {"stop": letter, "note": f"{where}: a new impact becomes possible"}
    if verb == "vanishes":
        return _vanishing_impact(problem, int(solution["speed_node"]))
    flight = int(solution["flight_index"]) // problem.pieces
    if any(event.is_release for event in getattr(problem, "events", ())):
        return _merging_events(problem, flight)
    here, there = (_impact_name(problem, number) for number in (flight, flight + 1))
    return {"note": f"{here} and {there} merge: the flight between them has no duration"}


def _impact_name(problem: MultipointProblem | ForcedProblem, number: int) -> str:
    """The impact at the begin of a flight with this number, and that behind the last one: of closed orbits the first one again."""
    count = (problem.inner + 1) // problem.pieces
    if problem.periodic:
        return f"impact {number % count + 1} of {count}"
    return f"impact {number} of {count - 1}" if 0 < number < count else "the far end" if number else "the start"


def _vanishing_impact(problem: MultipointProblem | ForcedProblem, node: int) -> dict[str, Any]:
    """The stop's letter and the note of an impact whose speed reaches zero. node: the flight that it ends; inner + 1: that at the start."""
    # A half period ends with the mirror image of its first impact.
    letter = problem.modes.contact_letters[problem.contacts[node + 1 if problem.periodic and node == problem.inner else node]]
    name = _impact_name(problem, 0 if node > problem.inner else (node + 1) // problem.pieces)
    place = name if name.startswith("impact") else f"impact at {name}"
    return {"stop": letter, "note": f"the {place} (stop {letter}) vanishes: its speed reaches zero"}


def _impact_beside(problem: MultipointProblem | ForcedProblem, solution: Solution, letter: str) -> int | None:
    """The impact at the stop that a flight touches, as for `_vanishing_impact`, if the touch is at that end of the flight to rounding."""
    flight, time, instant = int(solution["clearance_flight"]), float(solution["clearance_time"]), INSTANT * problem.duration(solution)
    nodes = [flight - 1 if flight else problem.inner + 1] if time <= instant else []
    if float(problem.flight_times(solution.y)[flight]) - time <= instant:
        nodes.append(flight)
    hit = [node for node in nodes if problem.contacts[node] >= 0 and problem.modes.contact_letters[problem.contacts[node]] == letter]
    return hit[0] if hit else None


def _whole_flight(problem: MultipointProblem | ForcedProblem, solution: Solution) -> tuple[int, float, int]:
    """The flight in which the clearance is least, the time from its start, and the number of flights: cuts are no impacts."""
    flight, time, pieces = int(solution["clearance_flight"]), float(solution["clearance_time"]), problem.pieces
    if pieces > 1:
        time += flight % pieces * float(problem.flight_times(solution.y)[flight])
    return flight // pieces, time, (problem.inner + 1) // pieces


class ForceEvent(NamedTuple):
    """Where a contact force reaches zero. kind: "begin" where a stop begins to stick, "inside" the flight, "after" an impact without
    rebound at a stop that is open. wrong: what is wrong where it is below zero."""

    letter: str
    kind: str
    note: str
    wrong: str


def force_event(problem: MultipointProblem | ForcedProblem, solution: Solution) -> ForceEvent | None:
    """What the clearance of a solution is where it is the contact force of a stop; None where it is the distance of a gap."""
    events = getattr(problem, "events", ())
    if not events or solution["clearance_side"] == 0.0:
        return None
    modes, letters = problem.modes, problem.modes.contact_letters
    flight, time, stop = int(solution["clearance_flight"]), float(solution["clearance_time"]), int(solution["clearance_stop"])
    event = events[flight]
    contact = next((c for c in event.closed if modes.contact_stop[c] == stop), None)
    if contact is not None:
        letter = letters[contact]
        if time == 0.0 and event.contact == contact:
            note = f"the contact force at stop {letter} is zero where it begins to stick: it would open at once"
            return ForceEvent(letter, "begin", note, f"stop {letter} sticks though it is pulled")
        where = f"{time:.6g} after the begin of flight {flight + 1}"
        note = f"the contact force at stop {letter} touches zero {where}: it can open there"
        return ForceEvent(letter, "inside", note, f"stop {letter} sticks though it is pulled, {where}")
    plastic = not (event.is_release or event.sticks) and cast("ForcedProblem", problem).restitution(solution.y, event.contact) == 0.0
    # Where this force vanishes, the gap turns just behind the impact.
    if plastic and modes.contact_stop[event.contact] == stop and time <= INSTANT * problem.duration(solution):
        letter = letters[event.contact]
        note = f"the contact force after the impact at stop {letter} reaches zero: it would stay closed"
        return ForceEvent(letter, "after", note, f"stop {letter} opens after its impact though it is pressed")
    return None


def _merging_events(problem: Any, flight: int) -> dict[str, Any]:
    """What it means that the flight between two events of an orbit with sticking has no duration."""
    events, letters = problem.events, problem.modes.contact_letters
    first, second = events[flight], events[(flight + 1) % len(events)]
    letter = letters[first.contact]
    if first.sticks and second.is_release and first.contact == second.contact:
        return {"stop": letter, "note": f"sticking at stop {letter} vanishes: its duration reaches zero"}
    if first.is_release and not second.is_release and first.contact == second.contact:
        return {"stop": letter, "note": f"stop {letter} opens no more: the flight until its next impact has no duration"}
    names = [f"{'the release of' if event.is_release else 'the impact at'} stop {letters[event.contact]}" for event in (first, second)]
    return {"note": f"{names[0]} and {names[1]} merge: the flight between them has no duration"}


def unphysical(problem: MultipointProblem | ForcedProblem, solution: Solution, tolerance: float = BEYOND) -> str | None:
    """Why a solution of the equations is no orbit; None if it is one.

    It can pass beyond a stop, an impact can pull, or a flight can go back in time. The grazing orbit counts as one unless `tolerance` is 0.

    Examples
    --------
    >>> from bvp.multipoint import MultipointProblem
    >>> from bvp.system import vibro_impact_nes
    >>> problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    >>> start = problem.modes.from_state @ [0.0, 0.0, 4.6, 8.3]
    >>> unphysical(problem, problem.solve(problem.pack(start, [], [1.635]), quarter_period=1.635))
    'flight 1 of 1 passes beyond stop - by 0.96 at 0.813044 after its start'
    """
    inner, passed = problem.inner, solution["clearance"] <= -tolerance * problem.reach(solution)
    if passed and solution["clearance_side"] == 0.0:
        return str(describe_grazing(problem, solution, "touches")["note"])
    if passed:
        force = force_event(problem, solution)
        if force is not None:
            return f"{force.wrong}: the force is {solution['clearance']:.2g} in units of length"
        letter = describe_grazing(problem, solution, "touches")["stop"]
        flight, time, flights = _whole_flight(problem, solution)
        depth = -solution["clearance"]
        return f"flight {flight + 1} of {flights} passes beyond stop {letter} by {depth:.2g} at {time:.6g} after its start"
    if solution["speed"] <= -tolerance * problem.speed(solution) and not problem.contacts[int(solution["speed_node"])] >= 0:
        return "it starts where the sum of the modal displacements is least; an orbit without impacts starts where it is largest"
    if solution["speed"] <= -tolerance * problem.speed(solution):
        impact = describe_grazing(problem, solution, "vanishes")["note"].partition(" vanishes")[0]
        return f"{impact} would have to pull: its speed of approach is {solution['speed']:.2g}"
    if solution["flight"] <= -tolerance * problem.duration(solution):
        return f"flight {int(solution['flight_index']) + 1} of {inner + 1} goes back in time: it lasts {solution['flight']:.2g}"
    return None
