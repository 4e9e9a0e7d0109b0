"""The report of a damped motion as lines: its start, impacts, energy shares, peaks, stages and empirical modes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from saltus.tables import table_lines

if TYPE_CHECKING:
    from bvp.motion import Motion
    from saltus.motion.simulation import ImpactTable, MotionReport
    from saltus.motion.start import Start

__all__ = ["comparison", "motion_lines", "mode_lines", "of_the_start"]

SHOWN = 12
"""Impacts that are listed; the files hold all."""


def motion_lines(report: MotionReport, start: Start, record: dict[str, Any], impacts: ImpactTable) -> Iterator[str]:
    """The lines about a motion.

    Parameters
    ----------
    report : MotionReport
    start : Start
    record : dict
        `saltus.motion.record.motion_record` of it.
    impacts : ImpactTable
        `saltus.motion.simulation.impact_table` of it.
    """
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
    nes, lo = report.shares
    reference = record["shares_of"]
    left = motion.energy / report.reference if report.reference > 0.0 else 0.0
    of = f"of the {reference['what']} {reference['energy']:.10g}"
    first, second = report.sharing.names
    yield f"shares   {first} {nes:.4%}  {second} {lo:.4%}  still there {left:.4%}  {of}"
    yield f"balance  error {record['energy_balance_error']:.1e}" + _turnover(record, motion)
    if motion.initial_energy > 0.0 and motion.marks:
        rows = [
            (f"{name} %", "not reached", "", "")
            if at["time"] is None
            else (f"{name} %", f"{at['time']:.10g}", f"{at['nes']:.4%}", f"{at['lo']:.4%}")
            for name, at in record["at"].items()
        ]
        yield from table_lines(("gone", "time", f"by {first}", f"by {second}"), rows, columns="rrrr")
    if record["peaks"] is None:
        yield "peaks    not computed: interrupted"
    else:
        peaks = [(name, entry) for entries in record["peaks"].values() for name, entry in entries.items()]
        rows = [(name, *(f"{entry[key]:.8g}" for key in ("peak", "time", "rms"))) for name, entry in peaks]
        yield from table_lines(("", "peak", "at time", "rms"), rows, columns="lrrr")
    yield from _impact_lines(impacts)
    yield from _stage_lines(report, record)


def of_the_start(report: MotionReport, record: dict[str, Any], count: int) -> list[str]:
    """How long the motion keeps the impact sequence of the orbit that it starts on, in at most one line.

    A stage may follow another family from the first impact on. `count` is the number of impacts.
    """
    if report.began is None:
        return []
    name = report.began.called
    left = record["initial"]["left"]
    if left is not None:
        where = f"impact {left['impact']} is at stop {left['stop']}, that of the orbit at stop {left['expected']}"
        return [f"{name} at {left['time']:.6g}: {where}"]
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


def _turnover(record: dict[str, Any], motion: Motion) -> str:
    """The end of the balance line where loads do work."""
    if not motion.work:
        return ""
    of = f" of the {record['shares_of']['what']}, {record['energy_balance_of_turnover']:.1e} of the largest energy that passed through"
    return f"{of}; work of the loads {record['work']:.10g}"


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
    from transitions.stage import changes

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
        span = f"{data['energies'][1]:.4g} to {data['energies'][0]:.4g}"
        return span, *(f"{data[key] / scale:.3%}" for key in ("dissipated_nes", "dissipated_lo"))

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
        (data["kind"], f"{data['time']:.5g}", f"harmonic {change.harmonic} of {change.called}")
        for change, data in zip(changes(report.stages), record["changes"], strict=True)
    ]
    if rows:
        yield from table_lines(("change", "at", ""), rows, columns="lr")


def mode_lines(record: dict[str, Any]) -> Iterator[str]:
    """The lines about the empirical modes, from `saltus.motion.record.motion_record`."""
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
