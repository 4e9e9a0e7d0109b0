"""A discovery as plain data and as JSON, schema 1."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from itertools import repeat
from typing import TYPE_CHECKING, Any

from branches.words import impacts_per_period

if TYPE_CHECKING:
    from branches.discovery.search import Discovery
    from branches.orbit import Orbit

__all__ = ["half_period_impacts", "to_json", "to_record"]

SCHEMA = 1


def half_period_impacts(orbit: Orbit) -> int | float:
    """Impacts in half a period; half of an odd number between a rest and a stop."""
    count = impacts_per_period(orbit.problem.word, orbit.ends)
    return count // 2 if count % 2 == 0 else count / 2


def to_record(found: Discovery, families: Sequence[str | None] | None = None) -> dict[str, Any]:
    """Plain data: lists, dicts, strings, finite numbers, booleans and None only.

    Parameters
    ----------
    found : Discovery
    families : sequence of (str or None), optional
        Of each orbit; by default those of the catalogue.

    Returns
    -------
    dict
        ``{"schema", "energy", "bounds", "settled", "counts", "orbits", "unpolished"}``.
    """
    return {
        "schema": SCHEMA,
        "energy": found.energy,
        "bounds": {"quarter_period": found.quarter_period, "impacts": found.impacts, "ends": list(found.ends)},
        "settled": found.settled,
        "counts": found.counts,
        "orbits": [_orbit(*item) for item in zip(found.orbits, families or found.families or repeat(None), strict=False)],
        "unpolished": [
            {
                "ends": list(item.ends),
                "word": item.word,
                "angle": item.parameter,
                "alpha": _finite(item.alpha),
                "miss": _finite(item.miss),
                "reason": item.reason,
            }
            for item in found.unpolished
        ],
    }


def to_json(found: Discovery, families: Sequence[str | None] | None = None) -> str:
    """JSON text with one line an orbit, so that files can be compared by line; see `to_record`."""
    lines = []
    for key, value in to_record(found, families).items():
        if isinstance(value, list) and value:
            entries = ",\n    ".join(_text(entry) for entry in value)
            lines.append(f"  {_text(key)}: [\n    {entries}\n  ]")
        else:
            lines.append(f"  {_text(key)}: {_text(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _orbit(orbit: Orbit, family: str | None) -> Mapping[str, Any]:
    velocities = orbit.velocities
    return {
        "label": orbit.label or None,
        "family": family,
        "ends": list(orbit.ends),
        "word": orbit.word,
        "impacts": half_period_impacts(orbit),
        "alpha": orbit.alpha,
        "h": orbit.h,
        "velocities": None if velocities is None else [float(v) for v in velocities],
        "impact_speeds": [_finite(speed) for speed in orbit.impact_speeds],
        "tau": _finite(orbit.tau),
        "stable": orbit.stable,
        "residual": orbit.residual,
    }


def _text(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
