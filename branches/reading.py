"""Reading of a branch from a file. A file with a wrong schema, wrong keys or types, or contradictory numbers is refused in one line."""

from __future__ import annotations

import difflib
import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from branches.branch import Branch, BranchEvent, Ended
from branches.files import one_line, read_input, reason
from branches.orbit import Orbit
from branches.record import SCALARS, SCHEMA
from branches.sequences import parse_sequence, segments_per_period
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.system import ImpactSystem
from bvp.texts import shown

__all__ = ["RecordError", "branch_of_record", "check_branch", "check_points", "points_of", "read_branch", "read_orbit"]


class RecordError(ValueError):
    """The file does not contain a readable branch; the message is one line."""


Check = Callable[[Any, str], None]


def _short(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 40 else shown[:37] + "..."


def _kind(expected: str, fits: Callable[[Any], bool]) -> Check:
    """Make a check that a value is of a kind."""

    def check(value: Any, where: str) -> None:
        if not fits(value):
            raise RecordError(f"{where} is {_short(value)}, expected {expected}")

    return check


def _is_number(value: Any) -> bool:
    # A number beyond the largest float reads as infinite, which no file of a branch holds.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


NUMBER = _kind("a number", _is_number)
NUMBER_OR_NULL = _kind("a number or null", lambda value: value is None or _is_number(value))
INTEGER = _kind("an integer", _is_integer)
TEXT = _kind("a string", lambda value: isinstance(value, str))
TEXT_OR_NULL = _kind("a string or null", lambda value: value is None or isinstance(value, str))
TRUTH = _kind("true or false", lambda value: isinstance(value, bool))
TRUTH_OR_NULL = _kind("true, false or null", lambda value: value is None or isinstance(value, bool))
TABLE = _kind("an object", lambda value: isinstance(value, Mapping))


def _list_of(entry: Check, count: int | None = None) -> Check:
    """Make a check of a list, of a given length if `count` is given."""
    expected = "a list" if count is None else f"a list of {count}"
    is_list = _kind(expected, lambda value: isinstance(value, list) and (count is None or len(value) == count))

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
    half_waves=INTEGER,
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
    p_q=_or_null(_list_of(INTEGER, 2)),
    breaks=TEXT_OR_NULL,
    note=TEXT_OR_NULL,
    point=INTEGER,
    number=INTEGER,
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
        sequence=TEXT,
    ),
    points=_list_of(POINT),
    events=_list_of(EVENT),
    ended=_list_of(_object(reason=TEXT, text=TEXT), 2),
)

LENGTHS = ("flight_times", "multipliers", "impact_speeds")
"""Lists that are equally long at all points of a branch."""


def check_branch(record: Any, schema: int) -> None:
    """Raise an error if an object is not the record of a branch.

    Parameters
    ----------
    record : object
        The content of a JSON file.
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
    branches.reading.RecordError: its schema is 2, expected 1
    """
    TABLE(record, "the file")
    if "schema" not in record:
        raise RecordError("it lacks 'schema'")
    if record["schema"] != schema or not _is_integer(record["schema"]):
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
"""Relative tolerance between a stored number of a point and its value computed from the point's start and flight times."""


def check_points(problem: MultipointProblem, points: Mapping[str, np.ndarray]) -> None:
    """Refuse a point if its energy or quarter period contradicts its start and flight times.

    Parameters
    ----------
    problem : MultipointProblem
    points : mapping of str to (N, ...) ndarray
        As `points_of` gives them.

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
    for name, (values, scale, source) in own.items():
        off = np.flatnonzero(~(np.abs(points[name] - values) <= AGREEMENT * scale))
        if off.size:
            i = int(off[0])
            raise RecordError(f"points[{i}].{name} is {points[name][i]:.12g}, but its {source} {values[i]:.12g}")


def read_branch(path: str | os.PathLike[str]) -> Branch:
    """Read a branch from a JSON file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    branches.branch.Branch

    Raises
    ------
    RecordError
        A `ValueError` with one line: the file cannot be read, is no JSON, is truncated, has another schema, lacks a key, or
        holds something of another type.
    """
    record = in_present_terms(_record(path, "a branch"))
    try:
        check_branch(record, SCHEMA)
        return branch_of_record(record)
    except ValueError as error:
        raise RecordError(f"{path} is not a readable branch file: {one_line(error)}") from error


def read_orbit(path: str | os.PathLike[str]) -> Orbit:
    """Read an orbit from a JSON file. `saltus.trace` follows its family.

    Parameters
    ----------
    path : path-like
        A file of ``saltus orbit --json``.

    Raises
    ------
    RecordError
        A `ValueError` with one line: the file cannot be read, or its orbit does not solve its equations.
    """
    record = _record(path, "an orbit")
    try:
        orbit = record["orbit"]
        first, last = orbit["ends"]
        system = ImpactSystem.from_description(record["system"])
        sequence = orbit["sequence"] if record["schema"] != 1 else orbit["word"]
        problem = MultipointProblem(system, (first, last), parse_sequence(sequence))
        segment = orbit["period"] / segments_per_period((first, last))
        inner = [impact["time"] for impact in orbit["impacts"] if 1e-9 * segment < impact["time"] < (1.0 - 1e-9) * segment]
        if len(inner) != problem.inner:
            raise ValueError(f"{len(inner)} impacts lie inside the solved segment; its sequence has {problem.inner}")
        start = system.modes.from_state @ np.concatenate([orbit["start"]["u"], orbit["start"]["v"]])
        return Orbit(problem, problem.solve(problem.pack(start, None, np.diff([0.0, *inner, segment])), energy=orbit["h"]))
    except KeyError as error:
        raise RecordError(f"{path} is not a readable orbit file: it lacks {error}") from error
    except (LookupError, TypeError, ValueError, NotConverged) as error:
        raise RecordError(f"{path} is not a readable orbit file: {one_line(error)}") from error


def _record(path: str | os.PathLike[str], what: str) -> Any:
    """The data of a JSON file."""
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"a path is text; received {shown(path)}, expected the name of a JSON file")
    try:
        text = read_input(path).decode("utf-8")
    except OSError as error:
        raise RecordError(f"cannot read {path}: {reason(error)}") from error
    except ValueError as error:
        raise RecordError(f"{path} is not a file of {what}: it is not UTF-8 text") from error
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        # An error behind the last character says that something was still to come.
        if error.pos >= len(text.rstrip()) or error.msg.startswith("Unterminated"):
            end = text.count("\n") + 1
            raise RecordError(f"{path} is truncated: it ends in line {end} before its JSON is complete") from error
        raise RecordError(f"{path} is not JSON: {error.msg} in line {error.lineno}, column {error.colno}") from error
    except (RecursionError, ValueError) as error:  # a number of thousands of digits is a ValueError
        raise RecordError(f"{path} is not a file of {what}: {one_line(error)}") from error


def in_present_terms(record: Any) -> Any:
    """A record of schema 1 as one of schema 2; any other as it is.

    Examples
    --------
    >>> in_present_terms({"schema": 1, "branch": {"word": "+-"}})
    {'schema': 2, 'branch': {'sequence': '+-'}}
    """
    if not isinstance(record, dict) or record.get("schema") != 1 or record["schema"] is True or not isinstance(record.get("branch"), dict):
        return record
    head = {"sequence" if key == "word" else key: value for key, value in record["branch"].items()}
    return {**record, "schema": 2, "branch": head}


def branch_of_record(record: dict[str, Any]) -> Branch:
    """The branch from the plain data that `branches.record.to_record` makes.

    Raises
    ------
    ValueError
        If ends, sequence and flight times contradict each other, or a number is none.
    """
    system = ImpactSystem.from_description(record["system"])
    head = record["branch"]
    problem = MultipointProblem(system, (head["ends"][0], head["ends"][1]), parse_sequence(head["sequence"]))
    flights = {len(point["flight_times"]) for point in record["points"]}
    if flights != {problem.inner + 1}:
        raise ValueError(
            f"the impact sequence {head['sequence']!r} between the ends {', '.join(head['ends'])} makes {problem.inner + 1} flights; "
            f"the points have {', '.join(map(str, sorted(flights)))} flight_times"
        )
    points = points_of(record)
    check_points(problem, points)
    names = set(BranchEvent._fields)
    events = []
    for item in record["events"]:
        fields = {key: value for key, value in item.items() if key in names}
        fields["bracket"] = tuple(fields["bracket"])
        events.append(BranchEvent(**fields))
    ended = [Ended(item["reason"], item["text"]) for item in record["ended"]]
    start = next((event.point - event.number for event in events), 0)
    low, high = head.get("energy") or (0.0, None)
    energy = (float(low), math.inf if high is None else float(high))
    return Branch(problem, points, tuple(events), (ended[0], ended[1]), start, energy)


def points_of(record: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the points of a record as arrays: what `branches.record.to_record` was made from, with NaN where it holds null.

    Parameters
    ----------
    record : mapping
        As `branches.record.to_record` returns it.

    Returns
    -------
    dict of str to ndarray
        All of length N, the number of points; the names are those of `Branch.points`.
    """
    points = record["points"]
    n = len(points[0]["start"]["u"])
    columns: dict[str, np.ndarray] = {name: _column([point[name] for point in points]) for name in SCALARS}
    columns["half_waves"] = np.array([point["half_waves"] for point in points], dtype=int)
    columns["stable"] = np.array([-1 if point["stable"] is None else int(point["stable"]) for point in points], dtype=np.int8)
    columns["label"] = np.array([point["label"] for point in points])
    columns["velocities"] = _rows([point["velocities"] or [None] * n for point in points])
    columns["start_u"] = _rows([point["start"]["u"] for point in points])
    columns["start_v"] = _rows([point["start"]["v"] for point in points])
    columns["flight_times"] = _rows([point["flight_times"] for point in points])
    columns["impact_speeds"] = _rows([point["impact_speeds"] for point in points])
    parts = np.array([[pair or (None, None) for pair in point["multipliers"]] for point in points], dtype=float)
    parts = parts.reshape(len(points), -1, 2)
    multipliers = np.empty(parts.shape[:2], dtype=complex)
    multipliers.real, multipliers.imag = parts[..., 0], parts[..., 1]
    columns["multipliers"] = multipliers
    for name in ("trivial", "pairing"):
        columns[name] = _column([point["quality"][name] for point in points])
    columns["reliable"] = np.array([point["quality"]["reliable"] for point in points], dtype=bool)
    return columns


def _column(values: Sequence[float | None]) -> np.ndarray:
    return np.array(values, dtype=float)


def _rows(values: Sequence[Sequence[float | None]]) -> np.ndarray:
    return np.array(values, dtype=float).reshape(len(values), -1)


def _refuse_constant(name: str) -> float:
    raise RecordError(f"it holds {name}, which no file of a branch holds")
