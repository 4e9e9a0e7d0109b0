"""JSON files that a command is given: their kind, contents and events. A file is parsed once to find its kind, and read once."""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

from saltus.errors import BadInput, nearest, refusing

if TYPE_CHECKING:
    from branches.curves.record import BifurcationCurve
    from branches.forced.branch import ForcedBranch

__all__ = ["curves_in", "event_named", "file_and_event", "is_curve_file", "is_response_file", "responses_in"]

_State = tuple[int, ...]


def _state(path: str) -> _State | None:
    """What changes when a regular file is written again; None where there is no such file."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size) if stat.S_ISREG(found.st_mode) else None


def is_response_file(path: str) -> bool:
    """Whether a path leads to a JSON file of responses. RecordError for a file that is not JSON, in one line."""
    kind = _kind_of(path)
    if kind is None:
        return False
    from transitions.response.files import KIND

    return kind == KIND


def is_curve_file(path: str) -> bool:
    """Whether a path leads to a JSON file of curves. RecordError for a file that is not JSON, in one line."""
    kind = _kind_of(path)
    if kind is None:
        return False
    from branches.curves.files import CHART, KIND

    return kind in (KIND, CHART)


def _kind_of(path: str) -> str | None:
    """The kind that a JSON file names, and None where it names none or where there is no such file. RecordError for a damaged one."""
    state = _state(path)
    return None if state is None else _parsed_kind(path, state)


@lru_cache(maxsize=4)
def _parsed_kind(path: str, _: _State) -> str | None:
    from branches.reading import load_json

    record = load_json(path, "results")
    kind = record.get("kind") if isinstance(record, Mapping) else None
    return kind if isinstance(kind, str) else None


def responses_in(path: str) -> list[ForcedBranch]:
    """The branches of a file of responses; errors as for `transitions.response.files.read_responses`."""
    return list(_responses(path, _state(path)))


@lru_cache(maxsize=1)
def _responses(path: str, _: _State | None) -> tuple[ForcedBranch, ...]:
    from transitions.response.files import read_responses

    return tuple(read_responses(path))


def curves_in(path: str) -> list[BifurcationCurve]:
    """The curves of a file of curves; BadInput for one that cannot be read."""
    from branches.reading import RecordError

    with refusing("", RecordError):
        return list(_curves(path, _state(path)))


@lru_cache(maxsize=1)
def _curves(path: str, _: _State | None) -> tuple[BifurcationCurve, ...]:
    from branches.curves.files import read_curves

    return tuple(read_curves(path))


def file_and_event(text: str) -> tuple[str, str | None]:
    """The path and the event of FILE[:EVENT]."""
    if os.path.exists(text) or ":" not in text:
        return text, None
    path, _, event = text.rpartition(":")
    return path, event


def event_named(source: str | None, event: str | None, known: Collection[str], more: str = "") -> str:
    """The one event of a file that a name or a type means. `more`: what else the file has, for messages."""
    listed = (", ".join(known) or "none") + more
    if event is None:
        raise BadInput(f"{source}: which event? expected {source}:EVENT with one of {listed}")
    matches = [key for key in known if key == event or key.rpartition(".")[2].rstrip("0123456789") == event]
    if not matches:
        raise BadInput(f"{source} has no event {event}{nearest(event, known)}; it has {listed}")
    if len(matches) > 1:
        raise BadInput(f"{source}:{event}: matches {', '.join(matches)}; expected one of them")
    return matches[0]
