"""A damped motion as plain data: the record for JSON, and tables of its samples and impacts."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus.motion_modes import modes_record
from saltus.units import Units

if TYPE_CHECKING:
    from branches.export.table_files import Table
    from bvp.forcing import Force
    from saltus.motion_start import Start
    from saltus.motions import Told
    from saltus.scene import Scene
    from transitions.empirical import Modes

ImpactTable = dict[str, np.ndarray]

__all__ = ["impact_table", "json_text", "motion_record", "sample_table"]

SCHEMA = 1

AT_ONCE = 1 << 16
"""Impacts that are made text at once, between two looks at whether there is a hurry."""

PATIENCE = 2.0
"""Seconds after an interrupt in which impacts are still made text."""


def motion_record(
    told: Told, scene: Scene, start: Start, units: Units, locked: Told | None = None, modes: Modes | None = None
) -> dict[str, Any]:
    """The motion as JSON has it; its impacts are in `impact_table`."""
    from transitions.stage import stages_as_data

    motion, t, e = told.motion, units.time, units.energy
    nes, lo = told.shares
    return {
        "schema": SCHEMA,
        "system": scene.system.describe(),
        "forces": [_force(force) for force in scene.forces],
        "units": {"clearance": units.length, "natural_frequency": units.frequency},
        "initial": {
            **start.record(),
            "follows": _follows(told, units),
            "left": _left(told, units),
            "u": (motion.start[: len(start.u)] * units.length).tolist(),
            "v": (motion.start[len(start.u) :] * units.speed).tolist(),
            "energy": motion.initial_energy * e,
        },
        "duration": motion.duration * t,
        "ended": {"reason": motion.status.name, "text": motion.status.value},
        "chatter": _chatter(told, units),
        "sticking": [{"begin": s.begin * t, "end": s.end * t, "stops": list(s.held)} for s in motion.stretches if s.held],
        "sticking_time": motion.held_time * t,
        "switch_error": motion.switch_error * t,
        "shares": {"nes": nes, "lo": lo},
        "shares_of": {"what": told.shares_of, "energy": told.reference * e},
        "at": {f"{100.0 * mark.fraction:.10g}": _mark(told, mark, units) for mark in motion.marks},
        "dissipated": {part: value * e for part, value in motion.dissipated.items()},
        "work": motion.work * e,
        "energy": motion.energy * e,
        "peaks": _peaks(told, units),
        "last_impact": None if motion.last_impact is None else motion.last_impact * t,
        "no_impact_from": None if motion.clear_from is None else motion.clear_from * t,
        "energy_balance_error": motion.balance_error,
        "energy_balance_of_turnover": abs(motion.balance) / motion.turnover if motion.turnover > 0.0 else 0.0,
        "stages": None if told.stages is None else [_in_units(stage, units) for stage in stages_as_data(told.stages)],
        "changes": None if told.stages is None else _changes(told, units),
        "stages_note": told.why_no_stages or None,
        "empirical": modes_record(modes, units),
        "locked": None if locked is None else {"peaks": _peaks(locked, units), "energy_balance_error": locked.motion.balance_error},
    }


def json_text(record: dict[str, Any], impacts: ImpactTable, samples: Table | None, hurry: Callable[[], bool]) -> tuple[str, str]:
    """The JSON text of a record and its impacts, an impact a line; with the samples where they are given, a list for each column.

    Once `hurry` is true, the impacts end after `PATIENCE` seconds. A note, which the text holds too, says where; "" where all are there."""
    from branches.export.table_files import plain_columns

    listed, count, hurried = [], len(impacts["time"]), math.inf
    for first in range(0, count, AT_ONCE):
        if hurry():
            now = time.monotonic()
            hurried = min(hurried, now)
            if now > hurried + PATIENCE:
                break
        listed.append(_rows_text(impacts, slice(first, first + AT_ONCE)))
    whole = record if samples is None else {**record, "samples": plain_columns(samples)}
    done = len(listed) * AT_ONCE
    note = f"the first {done} of {count}: the program was interrupted" if done < count else ""
    lines = []
    for key, value in whole.items():
        rows = isinstance(value, list) and len(value) > 0 and isinstance(value[0], dict)
        text = _listed([json.dumps(row, allow_nan=False) for row in value]) if rows else json.dumps(value, allow_nan=False)
        lines.append(f"  {json.dumps(key)}: {text}")
        if key == "ended":
            lines.append(f'  "impacts": {_listed(listed)}')
            if note:
                lines.append(f'  "impacts_note": {json.dumps(note)}')
    return "{\n" + ",\n".join(lines) + "\n}\n", note


def _listed(rows: Sequence[str]) -> str:
    """A list in JSON, a row a line."""
    return "[\n    " + ",\n    ".join(rows) + "\n  ]" if rows else "[]"


def _rows_text(columns: ImpactTable, part: slice) -> str:
    """Some rows of a table in JSON, a row a line."""
    texts = []
    for values in columns.values():
        if values.dtype.kind == "f" and not np.all(np.isfinite(values[part])):
            raise ValueError("a value of an impact is not finite, which JSON cannot express")
        texts.append(map(json.dumps if values.dtype.kind == "U" else repr, values[part].tolist()))
    row = "{" + ", ".join(f"{json.dumps(name)}: %s" for name in columns) + "}"
    return ",\n    ".join(map(row.__mod__, zip(*texts, strict=True)))


def sample_table(told: Told, samples: int, units: Units) -> Table:
    """The motion at uniform times: displacements, velocities, energies, what was dissipated, the work of the loads."""
    times = np.linspace(0.0, told.motion.duration, samples)
    u, v = told.motion.sample(times)
    whole, nes, lo = told.sharing.energies(told.motion, times)
    by_nes, by_lo, work = told.sharing.dissipated(told.motion, times)
    energies = {"energy": whole, "nes_energy": nes, "lo_energy": lo, "dissipated_nes": by_nes, "dissipated_lo": by_lo, "work": work}
    return {
        "time": times * units.time,
        "u": u * units.length,
        "v": v * units.speed,
        **{name: values * units.energy for name, values in energies.items()},
    }


def impact_table(told: Told, units: Units) -> ImpactTable:
    """The impacts, a column each of their entries."""
    from bvp.motion import EventKind

    motion = told.motion
    modes = motion.system.modes
    rows = np.flatnonzero(motion.kinds == EventKind.IMPACT.value)
    contacts = motion.contacts[rows]
    speeds = motion.speeds[rows] * units.speed
    return {
        "time": motion.times[rows] * units.time,
        "stop": np.array(modes.contact_letters, dtype=str)[contacts],
        "speed": speeds,
        "speed_after": np.asarray(modes.contact_restitution, dtype=float)[contacts] * speeds,
        "energy_lost": motion.losses[rows] * units.energy,
    }


def _left(told: Told, units: Units) -> dict[str, Any] | None:
    """Where a motion that starts on an orbit leaves its impact sequence."""
    left = None if told.began is None else told.began.left
    return None if left is None else {**left._asdict(), "time": left.time * units.time}


def _follows(told: Told, units: Units) -> dict[str, Any] | None:
    """The family that a motion starts on, up to where it leaves the impact sequence, or impacts no more."""
    began = told.began
    if began is None:
        return None
    # The first impact at another stop, and what it dissipates, is not of this time.
    end = began.end if began.left is None else float(np.nextafter(began.end, 0.0))
    energies = told.sharing.energies(told.motion, [0.0, end])[0]
    nes, lo, _ = told.sharing.dissipated(told.motion, [end])
    return {
        "family": began.family,
        "name": began.name,
        "label": began.label,
        "end": began.end * units.time,
        "impacts": began.impacts,
        "energies": sorted((energies * units.energy).tolist()),
        "dissipated_nes": float(nes[0]) * units.energy,
        "dissipated_lo": float(lo[0]) * units.energy,
    }


def _chatter(told: Told, units: Units) -> list[dict[str, Any]]:
    """Where a contact began to be held, with what the stops have dissipated since the last impact: the bounces that were summed."""
    from bvp.motion import EventKind

    motion = told.motion
    stops = slice(len(motion.parts) - len(motion.system.stops), len(motion.parts))
    out = []
    for k in np.flatnonzero(motion.kinds == EventKind.STICK.value).tolist():
        impact = k - 2 if motion.kinds[k - 1] == EventKind.CHATTER.value else k - 1
        lost = (motion.sums[k] - motion.sums[impact])[stops].sum()
        letter = motion.system.modes.contact_letters[int(motion.contacts[k])]
        out.append({"time": float(motion.times[k]) * units.time, "stop": letter, "energy_lost": float(lost) * units.energy})
    return out


def _mark(told: Told, mark: Any, units: Units) -> dict[str, float | None]:
    """When a fraction of the initial energy is gone, and who has dissipated it; None where it is not."""
    if mark.time is None or not told.motion.initial_energy > 0.0:
        return {"time": None, "nes": None, "lo": None}
    nes, lo = told.sharing.totals(mark.dissipated)
    return {"time": mark.time * units.time, "nes": nes / told.reference, "lo": lo / told.reference}


def _peaks(told: Told, units: Units) -> dict[str, dict[str, dict[str, float]]] | None:
    """Peak, its time and root mean square, of displacements, gaps and drifts; None where an interrupt came before."""
    if told.watched is None:
        return None
    found = told.watched.extents

    def entry(k: int) -> dict[str, float]:
        return {
            "peak": float(found.peaks[k]) * units.length,
            "time": float(found.times[k]) * units.time,
            "rms": float(found.rms[k]) * units.length,
        }

    groups = {"displacements": told.watched.coordinates, "gaps": told.watched.gaps, "drifts": told.watched.drifts}
    return {group: {name: entry(k) for name, k in members.items()} for group, members in groups.items()}


def _force(force: Force) -> dict[str, Any]:
    """A load; of a record the samples."""
    from bvp.forcing import Constant, Harmonic

    if isinstance(force, Constant):
        return {"kind": "constant", "load": force.load.tolist()}
    if isinstance(force, Harmonic):
        cosine, sine = (np.asarray(part).tolist() for part in (force.cosine, force.sine))
        return {"kind": "harmonic", "frequency": force.frequency, "cosine": cosine, "sine": sine}
    return {"kind": "record", "load": force.load.tolist(), "times": force.times.tolist(), "values": force.values.tolist()}


def _changes(told: Told, units: Units) -> list[dict[str, Any]]:
    """The captures and escapes between the stages."""
    from transitions.stage import changes

    return [{**asdict(change), "time": change.time * units.time} for change in changes(told.stages or ())]


def _in_units(stage: dict[str, Any], units: Units) -> dict[str, Any]:
    """The numbers of a stage in the units asked for."""
    scales = dict.fromkeys(("start", "end"), units.time) | dict.fromkeys(("frequency", "frequencies"), units.frequency)
    scales |= dict.fromkeys(("energies", "dissipated_nes", "dissipated_lo"), units.energy)
    out = dict(stage)
    for name, scale in scales.items():
        out[name] = [scale * value for value in out[name]] if isinstance(out[name], list) else scale * out[name]
    return out
