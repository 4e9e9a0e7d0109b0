"""Files of followed forced responses: JSON with a kind of its own, which holds one or several branches of one system."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.files import write_text
from branches.forced import record
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.closing import largest_residual
from branches.reading import RecordError, load_json
from branches.record import orbit_to_record
from branches.released.branch import ReleasedBranch, branch_in_parameter
from branches.released.impact_limit import ImpactLimit, impact_limits
from branches.tables import csv_text, dataframe, plain, plain_columns
from bvp.parameters import ParametricSystem
from transitions.response.measures import response_table

if TYPE_CHECKING:
    import pandas

__all__ = ["KIND", "read_responses", "response_dataframe", "responses_record", "save_responses"]

KIND = "response"

_EVENT = {
    **record.EVENT,
    "angle": "a number or null",
    "multiplier": "a number or null",
    "neighbours": [{"sequence": "a string", "persists": "a boolean"}],
    "symmetric?": ["a boolean"],
    "coefficient?": "a number or null",
    "criticality?": "a string or null",
}
_OLDER = ("released", "keep")
"""Fields of a problem that an older file can lack."""

_BRANCH = {
    **{f"{key}?" if key in _OLDER else key: pattern for key, pattern in record.PROBLEM.items()},
    "id?": "a string or null",
    "sequence": "a string",
    "range": record.RANGE,
    "start": "an integer",
    "points": [record.POINT],
    "events": [_EVENT],
    "ended": record.ENDED,
}
_FILE = {"schema": "an integer", "kind": "a string", "parameter": "a string", "system": "an object", "branches": [_BRANCH]}


def responses_record(branches: Sequence[ForcedBranch], harmonics: int | None = None) -> dict[str, Any]:
    """Some branches of one system as plain data, in order; the measures of all points are computed, also their harmonics up to a number."""
    problem = branches[0].problem
    return {
        "schema": record.SCHEMA,
        "kind": KIND,
        "parameter": branches[0].name,
        "coordinates": list(problem.system.coordinates),
        "system": plain(problem.parametric.describe()),
        "branches": [_branch_record(branch, harmonics) for branch in branches],
    }


def _branch_record(branch: ForcedBranch, harmonics: int | None) -> dict[str, Any]:
    problem = branch.problem
    columns = plain_columns(response_table([branch], harmonics, events=False))
    del columns["branch"], columns["point"]
    columns |= {"unknowns": plain(branch.unknowns), "tangent": plain(branch.tangents)}
    points = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    events = []
    for event in branch.events:
        neighbours = [{"sequence": sequence, "persists": persists} for sequence, persists in event.neighbours]
        events.append(plain(event._asdict() | {"values": dict(event.values), "neighbours": neighbours}))
    given = record.problem_record(problem)
    given.pop("energy", None)  # that of the point at the start
    return {
        "id": branch.known_id,
        "sequence": branch.sequence,
        **given,
        "range": plain(branch.interval),
        "start": branch.start,
        "ended": [end._asdict() for end in branch.ended],
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
    given = load_json(path, "responses")
    if not isinstance(given, Mapping) or given.get("kind") != KIND:
        raise RecordError(f"{path} holds no response; expected a file of saltus continue --in NAME --json FILE")
    return record.restored(given, _FILE, str(path), ("branches", "responses"), partial(_branch, given.get("parameter")))


def _branch(name: Any, parametric: ParametricSystem, item: Mapping[str, Any]) -> ForcedBranch:
    points = item["points"]
    if not points:
        raise RecordError("a branch has no point")
    energy = {"energy": points[item["start"]]["h"]} if "ends" in item else {}
    problem = record.problem_from(parametric, {"released": (name,), "keep": (), **item, **energy})
    count = problem.unknowns
    if any(len(point[key]) != count for point in points for key in ("unknowns", "tangent")):
        raise RecordError(f"a point has not the {count} unknowns of its sequence")
    unknowns = np.array([point["unknowns"] for point in points])
    record.require_fitting(item, len(points), lambda i: largest_residual(problem, unknowns[i]))
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
    columns = [np.array([point[key] for point in points]) for key in ("tangent", "arclength", "residual")]
    rest = *columns, tuple(events), record.ended_from(item["ended"]), item["start"], record.range_from(item["range"])
    branch = branch_in_parameter(problem, unknowns, *rest)
    return branch if item.get("id") is None else branch.known_as(item["id"])
