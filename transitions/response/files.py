"""Files of followed forced responses: JSON with a kind of its own, which holds one or several branches of one system."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.events import Ended
from branches.files import one_line, write_text
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.reading import RecordError, check_pattern, load_json
from branches.record import orbit_to_record
from branches.released.branch import ReleasedBranch, branch_in_parameter
from branches.released.impact_limit import ImpactLimit, impact_limits
from branches.tables import csv_text, dataframe, plain, plain_columns
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from transitions.response.measures import response_table

if TYPE_CHECKING:
    import pandas

__all__ = ["KIND", "SCHEMA", "is_response", "named_events", "read_responses", "response_dataframe", "responses_record", "save_responses"]

SCHEMA = 1
KIND = "response"

_AGREEMENT = 1e-8
"""Largest residual of a stored point."""

_EVENT = {
    "id": "a string",
    "type": "a string",
    "point": "an integer",
    "values": "an object",
    "arclength": "a number",
    "status": "a string",
    "bracket": ["a number", 2],
    "residual": "a number",
    "stop": "a string or null",
    "angle": "a number or null",
    "note": "a string or null",
    "multiplier": "a number or null",
    "neighbours": [{"sequence": "a string", "persists": "a boolean"}],
    "symmetric?": ["a boolean"],
    "coefficient?": "a number or null",
    "criticality?": "a string or null",
}
_POINT = {"arclength": "a number", "residual": "a number", "unknowns": ["a number"], "tangent": ["a number"]}
_BRANCH = {
    "id?": "a string",
    "ends?": ["a string", 2],
    "sequence": "a string",
    "solved": ["a string"],
    "load_periods": "an integer",
    "half": "a boolean",
    "released?": ["a string"],
    "keep?": ["a string"],
    "values": "an object",
    "range": ["a number or null", 2],
    "start": "an integer",
    "points": [_POINT],
    "events": [_EVENT],
    "ended": [{"reason": "a string", "text": "a string"}, 2],
}
_FILE = {"schema": "an integer", "kind": "a string", "parameter": "a string", "system": "an object", "branches": [_BRANCH]}


def responses_record(branches: Sequence[ForcedBranch], harmonics: int | None = None) -> dict[str, Any]:
    """Some branches of one system as plain data, in order; the measures of all points are computed, also their harmonics up to a number."""
    problem = branches[0].problem
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "parameter": branches[0].name,
        "coordinates": list(problem.system.coordinates),
        "system": plain(problem.parametric.describe()),
        "branches": [_branch_record(branch, harmonics) for branch in branches],
    }


def _branch_record(branch: ForcedBranch, harmonics: int | None) -> dict[str, Any]:
    problem = branch.problem
    columns = plain_columns(response_table([branch], harmonics))
    del columns["branch"], columns["point"]
    columns |= {"unknowns": plain(branch.unknowns), "tangent": plain(branch.tangents)}
    points = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    events = []
    for event in branch.events:
        neighbours = [{"sequence": sequence, "persists": persists} for sequence, persists in event.neighbours]
        events.append(plain(event._asdict() | {"values": dict(event.values), "neighbours": neighbours}))
    ends = {} if problem.ends is None else {"ends": list(problem.ends)}
    return {
        "id": branch.id,
        **ends,
        "sequence": branch.sequence,
        "solved": list(problem.sequence),
        "load_periods": problem.load_periods,
        "half": problem.half,
        "released": list(problem.released),
        "keep": list(problem.keep),
        "values": dict(problem.values),
        "range": plain(branch.interval),
        "start": branch.start,
        "ended": [{"reason": end.reason, "text": end.text} for end in branch.ended],
        "events": events,
        **_limits(branch),
        "points": points,
    }


def _limits(branch: ForcedBranch) -> dict[str, Any]:
    """The impacting orbits to which a branch leads: they follow from it, so a reader takes them as they are."""
    limits = [limit for limit in impact_limits(branch) if isinstance(limit, ImpactLimit)] if isinstance(branch, ReleasedBranch) else []
    found = [
        {
            "parameter": limit.name,
            "value": 0.0,
            "from": limit.value,
            "contacts": [contact._asdict() for contact in limit.contacts],
            "clearance": limit.clearance,
            "scaled": {"h": limit.scaled.h, "alpha": limit.scaled.alpha},
            "orbit": orbit_to_record(limit.orbit),
        }
        for limit in limits
    ]
    return {"limits": plain(found)} if found else {}


def save_responses(branches: Sequence[ForcedBranch], path: str | os.PathLike[str]) -> None:
    """Write some branches of one system. An older file is replaced only by a complete one.

    Parameters
    ----------
    branches : sequence of ForcedBranch
    path : path-like
        A name that ends in .json or .csv.

    Raises
    ------
    ValueError
        For another suffix, and for no branch.
    """
    writers: dict[str, Callable[[], str]] = {
        ".json": lambda: json.dumps(responses_record(branches), allow_nan=False), ".csv": lambda: csv_text(response_table(branches)),
    }  # fmt: skip
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in writers or not branches:
        what = "a name that ends in .json or .csv" if branches else "one branch at least"
        raise ValueError(f"cannot save {len(branches)} branches as {os.fspath(path)!r}: expected {what}")
    write_text(path, writers[suffix]())


def response_dataframe(branches: ForcedBranch | Sequence[ForcedBranch]) -> pandas.DataFrame:
    """The points of some branches as a pandas table with the columns of the CSV file.

    Parameters
    ----------
    branches : ForcedBranch or sequence of ForcedBranch

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    given = [branches] if isinstance(branches, ForcedBranch) else branches
    return dataframe(plain_columns(response_table(given)), "response_dataframe")


def is_response(record: Any) -> bool:
    """Whether the data of a JSON file are forced responses."""
    return isinstance(record, Mapping) and record.get("kind") == KIND


def read_responses(path: str | os.PathLike[str]) -> list[ForcedBranch]:
    """The branches of a file.

    Parameters
    ----------
    path : path-like
        A JSON file.

    Raises
    ------
    RecordError
        In one line, for a file that cannot be read or has no responses.
    """
    record = load_json(path, "responses")
    if not is_response(record):
        raise RecordError(f"{path} holds no response; expected a file of saltus continue --in NAME --json FILE")
    try:
        check_pattern(record, _FILE, "the file")
        if record["schema"] != SCHEMA:
            raise RecordError(f"schema {record['schema']} is not known; expected {SCHEMA}")
        if not record["branches"]:
            raise RecordError("it has no branch")
        parametric = ParametricSystem.from_description(record["system"])
        return [_branch(parametric, record["parameter"], item) for item in record["branches"]]
    except (LookupError, TypeError, ValueError) as error:
        raise RecordError(f"{path} is not a readable file of responses: {one_line(error)}") from error


def _branch(parametric: ParametricSystem, name: str, item: Mapping[str, Any]) -> ForcedBranch:
    released, keep = item.get("released", (name,)), item.get("keep", ())
    problem: ForcedProblem
    if "ends" in item:
        energy = item["points"][item["start"]]["h"]
        problem = ReleasedProblem(parametric, tuple(item["ends"]), item["solved"], released, keep, values=item["values"], energy=energy)
    else:
        options = {key: item[key] for key in ("load_periods", "half", "values")}
        problem = ForcedProblem(parametric, item["solved"], released, keep=keep, **options)
    points, count = item["points"], problem.unknowns
    if not points or any(len(point[key]) != count for point in points for key in ("unknowns", "tangent")):
        raise RecordError(f"a point has not the {count} unknowns of its sequence")
    if not 0 <= item["start"] < len(points) or any(not 0 <= event["point"] < len(points) for event in item["events"]):
        raise RecordError("the start or an event has no point")
    unknowns = np.array([point["unknowns"] for point in points])
    worst = max(float(np.abs(problem.residual(y) / problem.scales(y)[: count - 1]).max()) for y in unknowns[[0, item["start"], -1]])
    if not worst < _AGREEMENT:
        raise RecordError(f"its points do not solve the equations of its system: residual {worst:.1e}")
    events = [
        ForcedEvent(
            **{
                **event,
                "bracket": tuple(event["bracket"]),
                "neighbours": tuple((one["sequence"], one["persists"]) for one in event["neighbours"]),
                "symmetric": tuple(event.get("symmetric", ())),
            }
        )
        for event in item["events"]
    ]
    low, high = item["range"]
    ended = [Ended(end["reason"], end["text"]) for end in item["ended"]]
    columns = [np.array([point[key] for point in points]) for key in ("tangent", "arclength", "residual")]
    interval = -np.inf if low is None else low, np.inf if high is None else high
    rest = *columns, tuple(events), (ended[0], ended[1]), item["start"], interval
    branch = branch_in_parameter(problem, unknowns, *rest)
    return branch.known_as(item["id"]) if "id" in item else branch


def named_events(branches: Sequence[ForcedBranch]) -> dict[str, tuple[ForcedBranch, ForcedEvent]]:
    """The events of some branches by name: "PD1"; of the second branch and later ones with its number before it, "2.PD1"."""
    return {
        (f"{number}." if number > 1 else "") + event.id: (branch, event)
        for number, branch in enumerate(branches, 1)
        for event in branch.events
    }
