"""A damped motion as plain data - the record for JSON, tables of its samples and impacts - and as the lines of its report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus.options import Units
from saltus.outputs import json_text
from saltus.terminal import table_lines

if TYPE_CHECKING:
    from branches.tables import Table
    from bvp.motion import EnergyMark
    from saltus.motion.simulation import ImpactTable, MotionReport, Start
    from saltus.scene import Scene
    from transitions.frequencies import IntrinsicModes

__all__ = ["comparison", "mode_lines", "mode_table", "motion_json", "motion_lines", "motion_record", "of_the_start", "sample_table"]

SCHEMA = 1

SHOWN = 12
"""Impacts that are listed; the files hold all."""


def motion_record(
    report: MotionReport, scene: Scene, start: Start, units: Units, locked: MotionReport | None = None, modes: IntrinsicModes | None = None
) -> dict[str, Any]:
    """The motion as JSON has it; its impacts are in `saltus.motion.simulation.impact_table`."""
    from transitions.stage import changes, stages_as_data
    from transitions.study.plan import loads_as_data

    motion, t, e = report.motion, units.time, units.energy
    nes, lo = report.shares
    left = None if report.began is None else report.began.left
    stages = report.stages
    return {
        "schema": SCHEMA,
        "system": scene.system.describe(),
        "forces": loads_as_data(scene.forces),
        "parameters": scene.parameters,
        "units": {"clearance": units.length, "natural_frequency": units.frequency},
        "initial": {
            **start.record(),
            "follows": _follows(report, units),
            "left": None if left is None else {**left._asdict(), "time": left.time * t},
            "u": (motion.start[: len(start.u)] * units.length).tolist(),
            "v": (motion.start[len(start.u) :] * units.speed).tolist(),
            "energy": motion.initial_energy * e,
        },
        "duration": motion.duration * t,
        "ended": {"reason": motion.status.name, "text": motion.status.value},
        "chatter": _chatter(report, units),
        "sticking": [{"begin": s.begin * t, "end": s.end * t, "stops": list(s.sticking)} for s in motion.contact_intervals if s.sticking],
        "sticking_time": motion.sticking_time * t,
        "switch_error": motion.switch_error * t,
        "shares": {"nes": nes, "lo": lo},
        "shares_of": {"what": report.shares_of, "energy": report.reference * e},
        "at": {f"{100.0 * mark.fraction:.10g}": _mark(report, mark, t) for mark in motion.marks},
        "dissipated": {part: value * e for part, value in motion.dissipated.items()},
        "work": motion.work * e,
        "energy": motion.energy * e,
        "peaks": _peaks(report, units),
        "last_impact": None if motion.last_impact is None else motion.last_impact * t,
        "no_impact_from": None if motion.clear_from is None else motion.clear_from * t,
        "energy_balance_error": motion.balance_error,
        "energy_balance_of_turnover": abs(motion.balance) / motion.turnover if motion.turnover > 0.0 else 0.0,
        "stages": None if stages is None else [_in_units(stage, units) for stage in stages_as_data(stages)],
        "changes": None if stages is None else [{**asdict(change), "time": change.time * t} for change in changes(stages)],
        "stages_note": report.why_no_stages or None,
        "empirical": modes_record(modes, units),
        "locked": None if locked is None else {"peaks": _peaks(locked, units), "energy_balance_error": locked.motion.balance_error},
    }


def motion_json(record: dict[str, Any], impacts: ImpactTable, samples: Table | None) -> str:
    """The JSON text of a record and its impacts, an impact a line; with the samples where they are given, a list for each column."""
    from branches.tables import plain_columns

    content: dict[str, Any] = {}
    for key, value in record.items():
        content[key] = value
        if key == "ended":
            content["impacts"] = []
    if samples is not None:
        content["samples"] = plain_columns(samples)
    rows = _rows_text(impacts)
    return json_text(content).replace('"impacts": []', f'"impacts": [\n    {rows}\n  ]' if rows else '"impacts": []', 1)


def _rows_text(columns: ImpactTable) -> str:
    """The rows of a table in JSON, a row a line: millions of them in seconds."""
    texts = []
    for values in columns.values():
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise ValueError("a value of an impact is not finite, which JSON cannot express")
        texts.append(map(json.dumps if values.dtype.kind == "U" else repr, values.tolist()))
    row = "{" + ", ".join(f"{json.dumps(name)}: %s" for name in columns) + "}"
    return ",\n    ".join(map(row.__mod__, zip(*texts, strict=True)))


def sample_table(report: MotionReport, samples: int, units: Units) -> Table:
    """The motion at uniform times: displacements, velocities, energies, what was dissipated, the work of the loads."""
    times = np.linspace(0.0, report.motion.duration, samples)
    u, v = report.motion.sample(times)
    left, nes, lo = report.sharing.energies(report.motion, times)
    by_nes, by_lo, work = report.sharing.dissipated(report.motion, times)
    energies = {"energy": left, "nes_energy": nes, "lo_energy": lo, "dissipated_nes": by_nes, "dissipated_lo": by_lo, "work": work}
    return {
        "time": times * units.time,
        "u": u * units.length,
        "v": v * units.speed,
        **{name: values * units.energy for name, values in energies.items()},
    }


def _follows(report: MotionReport, units: Units) -> dict[str, Any] | None:
    """The family that a motion starts on, up to where it leaves the impact sequence, or impacts no more."""
    began = report.began
    if began is None:
        return None
    # The first impact at another stop, and what it dissipates, is not of this time.
    end = began.end if began.left is None else float(np.nextafter(began.end, 0.0))
    energies = report.sharing.energies(report.motion, [0.0, end])[0]
    nes, lo, _ = report.sharing.dissipated(report.motion, [end])
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


def _chatter(report: MotionReport, units: Units) -> list[dict[str, Any]]:
    """The contacts that began to stick, each with the dissipation of the stops since the last impact. It contains the bounces summed as a
    series."""
    from bvp.motion import EventKind

    motion = report.motion
    stops = slice(len(motion.parts) - len(motion.system.stops), len(motion.parts))
    out = []
    for k in np.flatnonzero(motion.kinds == EventKind.STICK.value).tolist():
        impact = k - 2 if motion.kinds[k - 1] == EventKind.CHATTER.value else k - 1
        lost = (motion.sums[k] - motion.sums[impact])[stops].sum()
        letter = motion.system.modes.contact_letters[int(motion.contacts[k])]
        out.append({"time": float(motion.times[k]) * units.time, "stop": letter, "energy_lost": float(lost) * units.energy})
    return out


def _mark(report: MotionReport, mark: EnergyMark, unit: float) -> dict[str, float | None]:
    """The time at which a fraction of the initial energy is dissipated, and the parts of the NES and the LO; None if it never is."""
    if mark.time is None or not report.motion.initial_energy > 0.0:
        return {"time": None, "nes": None, "lo": None}
    nes, lo = report.sharing.totals(mark.dissipated)
    return {"time": mark.time * unit, "nes": nes / report.reference, "lo": lo / report.reference}


def _peaks(report: MotionReport, units: Units) -> dict[str, dict[str, dict[str, float]]] | None:
    """Peak, its time and root mean square, of displacements, gaps and drifts; None if an interrupt came before."""
    if report.peaks is None:
        return None
    length, t = units.length, units.time
    return {
        group: {name: {"peak": peak * length, "time": time * t, "rms": rms * length} for name, (peak, time, rms) in rows.items()}
        for group, rows in report.peaks.items()
    }


def _in_units(stage: dict[str, Any], units: Units) -> dict[str, Any]:
    """The numbers of a stage in the units of the results."""
    scales = dict.fromkeys(("start", "end"), units.time) | dict.fromkeys(("frequency", "frequencies"), units.frequency)
    scales |= dict.fromkeys(("energies", "dissipated_nes", "dissipated_lo"), units.energy)
    out = dict(stage)
    for name, scale in scales.items():
        out[name] = [scale * value for value in out[name]] if isinstance(out[name], list) else scale * out[name]
    return out


def modes_record(modes: IntrinsicModes | None, units: Units) -> dict[str, Any] | None:
    """The modes as JSON has them: of each its mean frequency, weighted by its squared amplitude (None where it has none), and the root
    mean square of itself."""
    if modes is None:
        return None
    sizes = np.sqrt(np.mean(modes.functions**2, axis=1))
    rows = zip((modes.mean_frequencies * units.frequency).tolist(), (sizes * units.length).tolist(), strict=True)
    return {
        "orthogonality": modes.orthogonality,
        "modes": [{"frequency": frequency if size > 0.0 else None, "rms": size} for frequency, size in rows],
        "residue_rms": float(np.sqrt(np.mean(modes.residue**2))) * units.length,
    }


def mode_table(modes: IntrinsicModes | None, units: Units) -> Table:
    """The modes over time, with amplitude and frequency by the Hilbert transform, (m, k) each; nothing where there are none."""
    if modes is None:
        return {}
    return {
        "emd_time": modes.times * units.time,
        "emd_modes": modes.functions.T * units.length,
        "emd_amplitudes": modes.amplitudes.T * units.length,
        "emd_frequencies": modes.frequencies.T * units.frequency,
        "emd_residue": modes.residue * units.length,
    }


def motion_lines(report: MotionReport, start: Start, record: dict[str, Any], impacts: ImpactTable) -> Iterator[str]:
    """The lines about a motion, its record, and its impacts (`saltus.motion.simulation.impact_table`)."""
    initial, motion = record["initial"], report.motion
    yield f"start    {start.text}, energy {initial['energy']:.10g}"
    yield from (f"leaves   {text}" for text in of_the_start(report, record, len(impacts["time"])))
    yield f"state    u = {_numbers(initial['u'])}  v = {_numbers(initial['v'])}"
    yield f"ended    {motion.status.value}, at time {record['duration']:.10g}"
    last = f", the last at {record['last_impact']:.10g}" if record["last_impact"] is not None else ""
    never = f"; none is possible any more from {record['no_impact_from']:.10g} on" if record["no_impact_from"] is not None else ""
    yield f"impacts  {motion.impacts}{last}{never}"
    if record["sticking"] or record["chatter"]:
        chatter = f"chattering ends {len(record['chatter'])} times, each time known to {record['switch_error']:.1e}"
        yield f"sticking {len(record['sticking'])} times, {record['sticking_time']:.10g} in all; {chatter}"
    runs_away = record["peaks"] is not None and not any(record["peaks"].values())
    if runs_away:  # the parts of its last energy cancel to rounding
        yield "shares   not computed: the motion runs away"
    else:
        yield from _energy_lines(report, record)
    if record["peaks"] is None:
        yield "peaks    not computed: interrupted"
    elif runs_away:
        yield "peaks    not computed: the motion runs away"
    else:
        peaks = [(name, entry) for entries in record["peaks"].values() for name, entry in entries.items()]
        rows = [(name, *(f"{entry[key]:.8g}" for key in ("peak", "time", "rms"))) for name, entry in peaks]
        yield from table_lines(("", "peak", "at time", "rms"), rows, columns="lrrr")
    yield from _impact_lines(impacts)
    yield from _stage_lines(report, record)


def _energy_lines(report: MotionReport, record: dict[str, Any]) -> Iterator[str]:
    """Where the energy of a motion went, how well that adds up, and when."""
    motion = report.motion
    nes, lo = report.shares
    reference = record["shares_of"]
    left = motion.energy / report.reference if report.reference > 0.0 else 0.0
    of = f"of the {reference['what']} {reference['energy']:.10g}"
    first, second = report.sharing.names
    yield f"shares   {first} {nes:.4%}  {second} {lo:.4%}  remaining {left:.4%}  {of}"
    passed = ""
    if motion.work:
        passed = f" of the {reference['what']}, {record['energy_balance_of_turnover']:.1e} of the largest energy that passed through"
        passed += f"; work of the loads {record['work']:.10g}"
    yield f"balance  error {record['energy_balance_error']:.1e}{passed}"
    if motion.initial_energy > 0.0 and motion.marks:
        rows = [
            (f"{name} %", "not reached", "", "")
            if at["time"] is None
            else (f"{name} %", f"{at['time']:.10g}", f"{at['nes']:.4%}", f"{at['lo']:.4%}")
            for name, at in record["at"].items()
        ]
        yield from table_lines(("dissipated", "time", f"by {first}", f"by {second}"), rows, columns="rrrr")


def of_the_start(report: MotionReport, record: dict[str, Any], count: int) -> list[str]:
    """How long a motion with impacts keeps the impact sequence of the orbit that it starts on, in at most one line.

    A stage may follow another family from the first impact on. `count` is the number of impacts.
    """
    if report.began is None:
        return []
    name = report.began.called
    left = record["initial"]["left"]
    if left is not None:
        where = f"impact {left['impact']} is at stop {left['stop']}, that of the orbit at stop {left['expected']}"
        return [f"{name} at {left['time']:.6g}: {where}"]
    if not count:
        return []
    last = "" if record["last_impact"] is None else f", the last at {record['last_impact']:.6g}"
    return [f"{name} at no impact: all {count} are in its impact sequence{last}"]


def comparison(record: dict[str, Any]) -> list[str]:
    """The lines that compare a motion with the motion of the same system with a locked sink."""
    rows = []
    for group in ("displacements", "drifts"):
        for name, other in record["locked"]["peaks"][group].items():
            own = record["peaks"][group].get(name)
            if own is not None:
                ratios = {key: own[key] / other[key] if other[key] else 1.0 for key in ("peak", "rms")}
                rows.append((name, *(cell for key in ratios for cell in (f"{own[key]:.6g}", f"{other[key]:.6g}", f"{ratios[key]:.4f}"))))
    return table_lines(("NES free and locked", "peak", "locked", "ratio", "rms", "locked", "ratio"), rows, columns="lrrrrrr")


def _numbers(values: list[float]) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _impact_lines(impacts: ImpactTable) -> list[str]:
    count = len(impacts["time"])
    if not count:
        return []
    names = ("speed", "speed_after", "energy_lost")
    rows = [
        (str(k + 1), f"{impacts['time'][k]:.12g}", impacts["stop"][k], *(f"{impacts[name][k]:.8g}" for name in names))
        for k in range(min(count, SHOWN))
    ]
    lines = table_lines(("impact", "time", "stop", "speed", "after", "energy lost"), rows, columns="rrlrrr")
    return [*lines, f"   ...  and {count - SHOWN} more, which --json lists"] if count > SHOWN else lines


def _stage_lines(report: MotionReport, record: dict[str, Any]) -> Iterator[str]:
    if report.stages is None:
        yield f"stages   not computed: {report.why_no_stages}"
        return
    if report.why_no_stages and report.stages:
        yield f"stages   {report.why_no_stages}"
    if not report.stages:
        yield "stages   none: no ridge of the spectrum holds for three periods"
        return
    scale = record["shares_of"]["energy"] or 1.0

    def spent(data: dict[str, Any]) -> tuple[str, ...]:
        low, high = data["energies"]
        return f"{high:.4g} to {low:.4g}", f"{data['dissipated_nes'] / scale:.3%}", f"{data['dissipated_lo'] / scale:.3%}"

    rows = []
    if report.began is not None:
        data = record["initial"]["follows"]
        follows = f"follows {report.began.called}, where it starts: {report.began.kept}"
        rows.append(("start", "0", f"{data['end']:.5g}", "", "", *spent(data), follows))
    for k, (stage, data) in enumerate(zip(report.stages, record["stages"], strict=True), 1):
        span = (f"{data['start']:.5g}", f"{data['end']:.5g}", f"{data['periods']:.1f}", f"{data['frequency']:.5g}")
        rows.append((str(k), *span, *spent(data), stage.text))
    by = tuple(f"by {name}" for name in report.sharing.names)
    yield from table_lines(("stage", "from", "to", "periods", "frequency", "energy", *by, "follows"), rows, columns="lrrrrrrrl")
    rows = [
        (item["kind"], f"{item['time']:.5g}", f"harmonic {item['harmonic']} of {item['name'] or item['label'] or item['family']}")
        for item in record["changes"]
    ]
    if rows:
        yield from table_lines(("change", "at", ""), rows, columns="lr")


def mode_lines(record: dict[str, Any]) -> Iterator[str]:
    """The lines about the empirical modes, from `motion_record`."""
    modes = record["empirical"]
    if modes is None:
        yield f"emd      not computed: {record['stages_note']}"
        return
    count, index = len(modes["modes"]), modes["orthogonality"]
    yield f"emd      {count} empirical modes of the relative displacement; index of orthogonality {index:.3g}"
    rows = [
        (str(k), "none" if mode["frequency"] is None else f"{mode['frequency']:.6g}", f"{mode['rms']:.6g}")
        for k, mode in enumerate(modes["modes"], 1)
    ]
    yield from table_lines(("mode", "frequency", "rms"), [*rows, ("rest", "", f"{modes['residue_rms']:.6g}")], columns="rrr")
