"""Checks that plain data read from a file is a branch: schema, keys and types, said in one line where it is not."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem

__all__ = ["RecordError", "check_branch", "check_points"]


class RecordError(ValueError):
    """A file that holds no branch that can be read; the message is one line."""


Check = Callable[[Any, str], None]


def _short(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 40 else shown[:37] + "..."


def _kind(words: str, fits: Callable[[Any], bool]) -> Check:
    """Make a check that a value is of a kind."""

    def check(value: Any, where: str) -> None:
        if not fits(value):
            raise RecordError(f"{where} is {_short(value)}, expected {words}")

    return check


def _is_number(value: Any) -> bool:
    # A number beyond the largest float reads as infinite, which no file of a branch holds.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


NUMBER = _kind("a number", _is_number)
NUMBER_OR_NULL = _kind("a number or null", lambda value: value is None or _is_number(value))
WHOLE = _kind("a whole number", _is_whole)
TEXT = _kind("a string", lambda value: isinstance(value, str))
TEXT_OR_NULL = _kind("a string or null", lambda value: value is None or isinstance(value, str))
TRUTH = _kind("true or false", lambda value: isinstance(value, bool))
TRUTH_OR_NULL = _kind("true, false or null", lambda value: value is None or isinstance(value, bool))
TABLE = _kind("an object", lambda value: isinstance(value, Mapping))


def _list_of(entry: Check, count: int | None = None) -> Check:
    """Make a check of a list, of a given length if `count` is given."""
    words = "a list" if count is None else f"a list of {count}"
    is_list = _kind(words, lambda value: isinstance(value, list) and (count is None or len(value) == count))

    def check(value: Any, where: str) -> None:
        is_list(value, where)
        for i, item in enumerate(value):
            entry(item, f"{where}[{i}]")

    return check


def _or_null(inner: Check) -> Check:
    def check(value: Any, where: str) -> None:
        if value is not None:
            inner(value, where)

    return check


def _object(optional: Mapping[str, Check] | None = None, **entries: Check) -> Check:
    """Make a check of an object that has at least the given keys; those in `optional` are checked where they are there."""

    def check(value: Any, where: str) -> None:
        TABLE(value, where)
        for key, entry in entries.items():
            if key not in value:
                raise RecordError(f"{where} lacks {key!r}" + _like(key, value, entries))
            entry(value[key], f"{where}.{key}")
        for key, entry in (optional or {}).items():
            if key in value:
                entry(value[key], f"{where}.{key}")

    return check


def _like(key: str, found: Mapping[str, Any], known: Mapping[str, Check]) -> str:
    """Name an unknown key that looks like the missing one."""
    near = difflib.get_close_matches(key, [str(name) for name in found if name not in known], n=1, cutoff=0.6)
    return f"; it has {near[0]!r}" if near else ""


NUMBERS = _list_of(NUMBER)

POINT = _object(
    h=NUMBER,
    alpha=NUMBER,
    frequency=NUMBER,
    frequency_index=NUMBER_OR_NULL,
    half_waves=WHOLE,
    start=_object(u=NUMBERS, v=NUMBERS),
    flight_times=NUMBERS,
    velocities=_or_null(NUMBERS),
    multipliers=_list_of(_or_null(_list_of(NUMBER, 2))),
    tau=NUMBER_OR_NULL,
    tau_half=NUMBER_OR_NULL,
    stable=TRUTH_OR_NULL,
    quality=_object(trivial=NUMBER_OR_NULL, pairing=NUMBER_OR_NULL, reliable=TRUTH),
    label=TEXT,
    arclength=NUMBER,
    residual=NUMBER_OR_NULL,
    impact_speeds=_list_of(NUMBER_OR_NULL),
)

EVENT = _object(
    id=TEXT,
    type=TEXT,
    h=NUMBER,
    alpha=NUMBER,
    arclength=NUMBER,
    status=TEXT,
    bracket=_list_of(NUMBER_OR_NULL, 2),
    residual=NUMBER_OR_NULL,
    label=TEXT,
    stop=TEXT_OR_NULL,
    p_q=_or_null(_list_of(WHOLE, 2)),
    breaks=TEXT_OR_NULL,
    note=TEXT_OR_NULL,
    point=WHOLE,
    number=WHOLE,
    stable=TRUTH_OR_NULL,
    multiplier=NUMBER_OR_NULL,
)

PLACE = _object(h=NUMBER, alpha=NUMBER)

BRANCH = _object(
    system=TABLE,
    branch=_object(
        {"energy": _list_of(NUMBER_OR_NULL, 2), "others": _list_of(_object(None, **{"from": PLACE, "to": PLACE}))},
        id=TEXT,
        label=TEXT,
        aliases=_list_of(_object(None, label=TEXT, **{"from": NUMBER, "to": NUMBER})),
        ends=_list_of(TEXT, 2),
        word=TEXT,
    ),
    points=_list_of(POINT),
    events=_list_of(EVENT),
    ended=_list_of(_object(reason=TEXT, text=TEXT), 2),
)

LENGTHS = ("flight_times", "multipliers", "impact_speeds")
"""Lists that are equally long at all points of a branch."""


def check_branch(record: Any, schema: int) -> None:
    """Refuse what is no record of a branch.

    Parameters
    ----------
    record : object
        What a JSON file holds.
    schema : int
        The schema that can be read.

    Raises
    ------
    RecordError
        With one line that names the place and what was expected.

    Examples
    --------
    >>> check_branch({"schema": 2}, 1)
    Traceback (most recent call last):
    branches.check.RecordError: its schema is 2, expected 1
    """
    TABLE(record, "the file")
    if "schema" not in record:
        raise RecordError("it lacks 'schema'")
    if record["schema"] != schema or not _is_whole(record["schema"]):
        raise RecordError(f"its schema is {_short(record['schema'])}, expected {schema}")
    BRANCH(record, "the file")
    points = record["points"]
    if not points:
        raise RecordError("it has no points")
    n = len(points[0]["start"]["u"])
    for i, point in enumerate(points):
        for key in LENGTHS:
            if len(point[key]) != len(points[0][key]):
                expected = f"{len(points[0][key])} as at the first point"
                raise RecordError(f"points[{i}].{key} has {len(point[key])} entries, expected {expected}")
        rows = {"start.u": point["start"]["u"], "start.v": point["start"]["v"], "velocities": point["velocities"]}
        for name, row in rows.items():
            if row is not None and len(row) != n:
                raise RecordError(f"points[{i}].{name} has {len(row)} entries, expected {n}, one for each coordinate")
    for i, event in enumerate(record["events"]):
        if not 0 <= event["point"] < len(points):
            raise RecordError(f"events[{i}].point is {event['point']}, expected 0 to {len(points) - 1}")


AGREEMENT = 1e-9
"""Part of its size by which a number of a point may differ from what the point's start and flight times give."""


def check_points(problem: MultipointProblem, points: Mapping[str, np.ndarray]) -> None:
    """Refuse points whose energy or quarter period is not that of their own start and flights.

    Parameters
    ----------
    problem : MultipointProblem
    points : mapping of str to (N, ...) ndarray
        As `branches.record.points_of` gives them.

    Raises
    ------
    RecordError
        With one line that names the first such point and both numbers.
    """
    system = problem.system
    n = system.degrees_of_freedom
    if points["start_u"].shape[1] != n:
        raise RecordError(f"points[0].start.u has {points['start_u'].shape[1]} entries, but the system has {n} coordinates")
    u, v = points["start_u"], points["start_v"]
    # The sizes of the terms, not their sum, bound the rounding of the sum.
    size = 0.5 * np.sum((np.abs(v) @ np.abs(system.mass)) * np.abs(v) + (np.abs(u) @ np.abs(system.stiffness)) * np.abs(u), axis=1)
    alpha = np.sum(points["flight_times"], axis=1) / problem.quarters
    own = {"h": (np.atleast_1d(system.energy(u, v)), size, "start has the energy"), "alpha": (alpha, alpha, "flight_times make")}
    for name, (values, scale, words) in own.items():
        off = np.flatnonzero(~(np.abs(points[name] - values) <= AGREEMENT * scale))
        if off.size:
            i = int(off[0])
            raise RecordError(f"points[{i}].{name} is {points[name][i]:.12g}, but its {words} {values[i]:.12g}")
