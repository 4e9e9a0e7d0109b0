"""Events of a family as rows, and back."""

from __future__ import annotations

import json
import math
from typing import Any

from branches.catalogue.rows import EVENT_COLUMNS, no_nan
from branches.events import BranchEvent

__all__ = ["event_values", "read_event"]


def event_values(event: BranchEvent) -> tuple[Any, ...]:
    """The row of an event, in the order of `EVENT_COLUMNS`; fields without a column of their own go together as JSON."""
    more = {name: value for name, value in event._asdict().items() if name not in _KNOWN}
    p, q = event.p_q or (None, None)
    return (
        event.id, event.type, int(event.point), int(event.number), no_nan(event.h), no_nan(event.alpha), no_nan(event.arclength),
        str(event.status), no_nan(event.bracket[0]), no_nan(event.bracket[1]), no_nan(event.residual), event.label, event.stop,
        p, q, event.breaks, event.note, None if event.stable is None else int(event.stable), no_nan(event.multiplier),
        json.dumps(more, sort_keys=True) if more else None,
    )  # fmt: skip


def read_event(values: tuple[Any, ...]) -> BranchEvent:
    """The inverse of `event_values`."""
    (
        id, type, point, number, h, alpha, arclength, status, low, high, residual, label,
        stop, p, q, breaks, note, stable, multiplier, more,
    ) = values  # fmt: skip
    return BranchEvent(
        id, type, point, number, h, alpha, arclength, status, (_number(low), _number(high)), _number(residual), label, stop,
        None if p is None else [p, q], breaks, note, None if stable is None else bool(stable), multiplier,
        **({} if more is None else json.loads(more)),
    )  # fmt: skip


_KNOWN = {*EVENT_COLUMNS, "bracket", "p_q"}


def _number(value: float | None) -> float:
    return math.nan if value is None else value
