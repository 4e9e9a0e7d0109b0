"""Families and curves of orbits in parameters as plain data: what files of responses, files of curves and catalogues have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from branches.events import Ended
from branches.files import one_line
from branches.reading import RecordError, check_pattern
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem

__all__ = [
    "ENDED", "EVENT", "POINT", "PROBLEM", "RANGE", "SCHEMA", "ended_from", "event_name", "named_events", "problem_from",
    "problem_record", "range_from", "require_fitting", "restored",
]  # fmt: skip

SCHEMA = 2

_AGREEMENT = 1e-8
"""Largest residual of a stored point."""

PROBLEM = {
    "ends?": ["a string", 2],
    "pieces?": "an integer",
    "solved": ["a string"],
    "load_periods": "an integer",
    "half": "a boolean",
    "values": "an object",
    "released": ["a string"],
    "keep": ["a string"],
}
EVENT = {
    "id": "a string",
    "type": "a string",
    "point": "an integer",
    "values": "an object",
    "arclength": "a number",
    "status": "a string",
    "bracket": ["a number", 2],
    "residual": "a number",
    "stop": "a string or null",
    "note": "a string or null",
}
POINT = {"arclength": "a number", "residual": "a number", "unknowns": ["a number"], "tangent": ["a number"]}
ENDED = [{"reason": "a string", "text": "a string"}, 2]
RANGE = ["a number or null", 2]
"""Patterns (`branches.reading`) of a problem without its system, an event, a point, the two ends, and a range, where null is no bound."""

Item = TypeVar("Item")


def problem_record(problem: ForcedProblem) -> dict[str, Any]:
    """A problem without its system, as plain data."""
    free: dict[str, Any] = {}
    if isinstance(problem, ReleasedProblem):
        free = {"ends": list(problem.ends), "energy": problem.energy}
    if problem.pieces > 1:
        free["pieces"] = problem.pieces
    return free | {
        "solved": list(problem.sequence), "load_periods": problem.load_periods, "half": problem.half, "values": dict(problem.values),
        "released": list(problem.released), "keep": list(problem.keep),
    }  # fmt: skip


def problem_from(parametric: ParametricSystem, given: Mapping[str, Any]) -> ForcedProblem:
    """The inverse of `problem_record`."""
    if given.get("pieces", 1) < 1:
        raise RecordError(f"pieces is {given['pieces']}, expected 1 or more")
    if "ends" in given:
        ends = given["ends"][0], given["ends"][1]
        own = {name: given[name] for name in ("values", "energy", "pieces") if name in given}
        return ReleasedProblem(parametric, ends, given["solved"], given["released"], given["keep"], **own)
    options = {name: given[name] for name in ("load_periods", "half", "values", "keep", "pieces") if name in given}
    return ForcedProblem(parametric, given["solved"], given["released"], **options)


def ended_from(given: Sequence[Mapping[str, str]]) -> tuple[Ended, Ended]:
    """Both ends from plain data."""
    first, last = (Ended(end["reason"], end["text"]) for end in given)
    return first, last


def range_from(given: Sequence[float | None]) -> tuple[float, float]:
    """A range from plain data, in which None is no bound."""
    low, high = given
    return -math.inf if low is None else low, math.inf if high is None else high


def require_fitting(item: Mapping[str, Any], count: int, residual: Callable[[int], float]) -> None:
    """Refuse places that are no point, and points that do not solve their equations.

    Parameters
    ----------
    item : mapping
        With the ``start`` and the ``events``.
    count : int
        Number of points.
    residual : callable
        The scaled residual of the point with an index. It is called for the first point, the start and the last point.

    Raises
    ------
    RecordError
    """
    if not 0 <= item["start"] < count or any(not 0 <= event["point"] < count for event in item["events"]):
        raise RecordError("the start or an event has no point")
    worst = max(residual(i) for i in (0, item["start"], count - 1))
    if not worst < _AGREEMENT:
        raise RecordError(f"its points do not solve the equations of its system: residual {worst:.1e}")


def restored(
    record: Mapping[str, Any], pattern: Any, path: str, items: tuple[str, str], restore: Callable[[ParametricSystem, Any], Item]
) -> list[Item]:
    """The branches or curves of the data of a file.

    Parameters
    ----------
    record : mapping
    pattern : mapping
        See `branches.reading.check_pattern`.
    path : str
        The file's name.
    items : (str, str)
        The key of their list; what the file holds, in words.
    restore : callable
        Makes one of them from the system and its data.

    Raises
    ------
    RecordError
        In one line, for data that do not fit the pattern or each other.
    """
    key, what = items
    try:
        check_pattern(record, pattern, "the file")
        if record["schema"] != SCHEMA:
            raise RecordError(f"schema {record['schema']} is not known; expected {SCHEMA}")
        if not record[key]:
            raise RecordError(f"it has no {key}")
        parametric = ParametricSystem.from_description(record["system"])
        return [restore(parametric, item) for item in record[key]]
    except (LookupError, TypeError, ValueError) as error:
        raise RecordError(f"{path} is not a readable file of {what}: {one_line(error)}") from error


def event_name(number: int, id: str) -> str:
    """The name of an event in a file: its id, with the number of its branch or curve before it unless that is 1.

    Examples
    --------
    >>> event_name(1, "NS-GR1"), event_name(12, "CP1")
    ('NS-GR1', '12.CP1')
    """
    return id if number == 1 else f"{number}.{id}"


def named_events(items: Iterable[Item]) -> dict[str, tuple[Item, Any]]:
    """The events of some branches or curves by `event_name`, each with its branch or curve."""
    found: dict[str, tuple[Item, Any]] = {}
    for number, item in enumerate(items, 1):
        events: Iterable[Any] = item.events  # type: ignore[attr-defined]
        found |= {event_name(number, event.id): (item, event) for event in events}
    return found
