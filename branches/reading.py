"""Reading of a branch from a file. A file with a wrong schema, wrong keys or types, or contradictory numbers is refused in one line."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from branches.branch import Branch, BranchEvent, Ended
from branches.files import one_line, read_input, reason
from branches.orbit import Orbit
from branches.record import EVENT, EVENT_FIELDS, HARMONIC, SCALARS, SCHEMA
from branches.sequences import parse_sequence, segments_per_period
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.system import ImpactSystem
from bvp.texts import shown

__all__ = ["RecordError", "branch_of_record", "check_pattern", "load_json", "points_of", "read_branch", "read_orbit", "read_start"]


class RecordError(ValueError):
    """The file does not contain a readable branch; the message is one line."""


def _is_number(value: Any) -> bool:
    # A number beyond the largest float reads as infinite, which no file of a branch holds.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


KINDS: dict[str, Callable[[Any], bool]] = {
    "a number": _is_number,
    "an integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "a string": lambda value: isinstance(value, str),
    "a boolean": lambda value: isinstance(value, bool),
    "an object": lambda value: isinstance(value, Mapping),
}
"""What a value of a record can be. In a pattern, " or null" may follow."""

NUMBER, NUMBERS = "a number or null", ["a number"]

POINT = {
    **dict.fromkeys(("h", "alpha", "frequency", "arclength"), "a number"),
    **dict.fromkeys(("frequency_index", "tau", "tau_half", "residual"), NUMBER),
    "half_waves": "an integer",
    "start": {"u": NUMBERS, "v": NUMBERS},
    "flight_times": NUMBERS,
    "velocities": ["a number", None],
    "multipliers": [["a number", 2, None]],
    "stable": "a boolean or null",
    "quality": {"trivial": NUMBER, "pairing": NUMBER, "reliable": "a boolean"},
    "label": "a string",
    "impact_speeds": [NUMBER],
    "harmonic?": "an object",
}

PLACE = {"h": "a number", "alpha": "a number"}

BRANCH = {
    "system": "an object",
    "branch": {
        "id": "a string",
        "label": "a string",
        "aliases": [{"label": "a string", "from": "a number", "to": "a number"}],
        "ends": ["a string", 2],
        "sequence": "a string",
        "pieces?": "an integer",
        "energy?": [NUMBER, 2],
        "others?": [{"from": PLACE, "to": PLACE}],
    },
    "points": [POINT],
    "events": [EVENT],
    "ended": [{"reason": "a string", "text": "a string"}, 2],
}
"""The pattern of a record. A list holds the pattern of the entries, their number if it is fixed, and None if it can be null. A key with a
question mark can be absent."""


def check_pattern(value: Any, pattern: Any, where: str) -> None:
    """Refuse a value that does not fit a pattern."""
    if isinstance(pattern, str):
        kind = pattern.removesuffix(" or null")
        if not KINDS[kind](value) and (value is not None or kind == pattern):
            raise RecordError(f"{where} is {shown(value)}, expected {pattern}")
    elif isinstance(pattern, list):
        entry, *rest = pattern
        if value is None and None in rest:
            return
        counts = [count for count in rest if count is not None]
        if not isinstance(value, list) or len(value) not in (counts or [len(value)]):
            raise RecordError(f"{where} is {shown(value)}, expected a list{f' of {counts[0]}' if counts else ''}")
        for i, item in enumerate(value):
            check_pattern(item, entry, f"{where}[{i}]")
    else:
        check_pattern(value, "an object", where)
        for key, entry in pattern.items():
            name = key.removesuffix("?")
            if name in value:
                check_pattern(value[name], entry, f"{where}.{name}")
            elif name == key:
                raise RecordError(f"{where} lacks {key!r}")


AGREEMENT = 1e-9
"""Relative tolerance between a stored number of a point and its value computed from the point's start and flight times."""


def _check_points(problem: MultipointProblem, points: Mapping[str, np.ndarray]) -> None:
    """Refuse a point if its energy or quarter period contradicts its start and flight times."""
    system = problem.system
    u, v = points["start_u"], points["start_v"]
    if u.shape[1] != system.degrees_of_freedom:
        raise RecordError(f"points[0].start.u has {u.shape[1]} entries, but the system has {system.degrees_of_freedom} coordinates")
    flights, expected = points["flight_times"].shape[1], (problem.inner + 1) // problem.pieces
    if flights != expected:
        raise RecordError(
            f"the impact sequence {''.join(problem.sequence)!r} between the ends {', '.join(problem.ends)} makes {expected} "
            f"flights; the points have {flights} flight_times"
        )
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
    return _branch_of_file(path, load_json(path, "a branch"))


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
    return _orbit_of_file(path, load_json(path, "an orbit"))


def read_start(path: str | os.PathLike[str]) -> Branch | Orbit:
    """Read the branch or the orbit that a JSON file holds.

    Raises
    ------
    RecordError
        As in `read_branch` and `read_orbit`.
    """
    record = load_json(path, "a branch or an orbit")
    if not isinstance(record, dict) or not {"branch", "orbit"} & set(record):
        raise RecordError(f"{path} holds neither a branch nor an orbit; expected a file of saltus continue --json or saltus orbit --json")
    return _branch_of_file(path, record) if "branch" in record else _orbit_of_file(path, record)


def _branch_of_file(path: str | os.PathLike[str], record: Any) -> Branch:
    try:
        return branch_of_record(record)
    except ValueError as error:
        raise RecordError(f"{path} is not a readable branch file: {one_line(error)}") from error


def _orbit_of_file(path: str | os.PathLike[str], record: Any) -> Orbit:
    try:
        orbit = record["orbit"]
        first, last = orbit["ends"]
        system = ImpactSystem.from_description(record["system"])
        problem = MultipointProblem(system, (first, last), parse_sequence(orbit["sequence"]))
        segment = orbit["period"] / segments_per_period((first, last))
        inner = [impact["time"] for impact in orbit["impacts"] if 1e-9 * segment < impact["time"] < (1.0 - 1e-9) * segment]
        if len(inner) != problem.inner:
            raise ValueError(f"{len(inner)} impacts lie inside the solved segment; its sequence has {problem.inner}")
        start = system.modes.from_state @ np.concatenate([orbit["start"]["u"], orbit["start"]["v"]])
        y = problem.pack(start, None, np.diff([0.0, *inner, segment]))
        finer = problem.in_enough_pieces(y)
        return Orbit(finer, finer.solve(problem.in_pieces_of(finer, y), energy=orbit["h"]))
    except KeyError as error:
        raise RecordError(f"{path} is not a readable orbit file: it lacks {error}") from error
    except (LookupError, TypeError, ValueError, NotConverged) as error:
        raise RecordError(f"{path} is not a readable orbit file: {one_line(error)}") from error


def load_json(path: str | os.PathLike[str], what: str) -> Any:
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


def branch_of_record(record: Any) -> Branch:
    """The branch from the plain data that `branches.record.to_record` makes.

    Raises
    ------
    RecordError
        With one line that names the place and what was expected.
    """
    check_pattern(record, {"schema": "an integer"}, "the file")
    if record["schema"] != SCHEMA:
        raise RecordError(f"its schema is {shown(record['schema'])}, expected {SCHEMA}")
    check_pattern(record, BRANCH, "the file")
    points, head = points_of(record), record["branch"]
    for i, event in enumerate(record["events"]):
        if not 0 <= event["point"] < len(points["h"]):
            raise RecordError(f"events[{i}].point is {event['point']}, expected 0 to {len(points['h']) - 1}")
    system = ImpactSystem.from_description(record["system"])
    pieces = head.get("pieces", 1)
    if pieces < 1:
        raise RecordError(f"branch.pieces is {pieces}, expected 1 or more")
    problem = MultipointProblem(system, (head["ends"][0], head["ends"][1]), parse_sequence(head["sequence"]), pieces)
    _check_points(problem, points)
    events = [
        BranchEvent(**{name: item.get(name) for name in EVENT_FIELDS} | {"bracket": tuple(item["bracket"])}) for item in record["events"]
    ]
    first, last = (Ended(item["reason"], item["text"]) for item in record["ended"])
    start = next((event.point - event.number for event in events), 0)
    low, high = head.get("energy") or (0.0, None)
    energy = (float(low), math.inf if high is None else float(high))
    return Branch(problem, points, tuple(events), (first, last), start, energy)


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
    if not points:
        raise RecordError("it has no points")

    def rows(name: str, lists: list[Any], width: int) -> np.ndarray:
        for i, row in enumerate(lists):
            if len(row) != width:
                raise RecordError(f"points[{i}].{name} has {len(row)} entries, expected {width} as at the first point")
        return np.array(lists, dtype=float).reshape(len(points), -1)

    n = len(points[0]["start"]["u"])
    columns = {name: np.array([point[name] for point in points], dtype=float) for name in SCALARS}
    columns["half_waves"] = np.array([point["half_waves"] for point in points], dtype=int)
    columns["stable"] = np.array([-1 if point["stable"] is None else point["stable"] for point in points], dtype=np.int8)
    columns["label"] = np.array([point["label"] for point in points])
    columns["velocities"] = rows("velocities", [point["velocities"] or [None] * n for point in points], n)
    for part in ("u", "v"):
        columns[f"start_{part}"] = rows(f"start.{part}", [point["start"][part] for point in points], n)
    for name in ("flight_times", "impact_speeds"):
        columns[name] = rows(name, [point[name] for point in points], len(points[0][name]))
    pairs = [[pair or (None, None) for pair in point["multipliers"]] for point in points]
    columns["multipliers"] = rows("multipliers", pairs, len(pairs[0])).view(complex)
    columns |= {name: np.array([point["quality"][name] for point in points], dtype=float) for name in ("trivial", "pairing")}
    columns["reliable"] = np.array([point["quality"]["reliable"] for point in points], dtype=bool)
    for coordinate, amplitudes in points[0].get("harmonic", {}).items():
        check_pattern(amplitudes, "an object", f"points[0].harmonic.{coordinate}")
        pattern = {"harmonic": {coordinate: dict.fromkeys(amplitudes, NUMBER)}}
        for i, point in enumerate(points):
            check_pattern(point, pattern, f"points[{i}]")
        columns |= {
            f"{HARMONIC}{coordinate}.{k}": np.array([point["harmonic"][coordinate][k] for point in points], dtype=float) for k in amplitudes
        }
    return columns


def _refuse_constant(name: str) -> float:
    raise RecordError(f"it holds {name}, which no file of a branch holds")
