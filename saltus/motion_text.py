"""The table of a damped motion: where it starts, its impacts, where the energy goes, peaks, stages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bvp.motion import Motion
    from saltus.motion_data import ImpactTable
    from saltus.motion_start import Start
    from saltus.motions import Told

__all__ = ["comparison", "describe", "of_the_start"]

SHOWN = 12
"""Impacts that are listed; the files hold all."""


def describe(told: Told, start: Start, record: dict[str, Any], impacts: ImpactTable) -> Iterator[str]:
    """The lines that tell a motion.

    Parameters
    ----------
    told : Told
    start : Start
    record : dict
        `saltus.motion_data.motion_record` of it.
    impacts : ImpactTable
        `saltus.motion_data.impact_table` of it.
    """
    initial, motion = record["initial"], told.motion
    yield f"start    {start.text}, energy {initial['energy']:.10g}"
    yield from (f"leaves   {text}" for text in of_the_start(told, record, len(impacts["time"])))
    yield f"state    u = {_numbers(initial['u'])}  v = {_numbers(initial['v'])}"
    yield f"ended    {motion.status.value}, at time {record['duration']:.10g}"
    last = f", the last at {record['last_impact']:.10g}" if record["last_impact"] is not None else ""
    never = f"; none is possible any more from {record['no_impact_from']:.10g} on" if record["no_impact_from"] is not None else ""
    yield f"impacts  {motion.impacts}{last}{never}"
    if record["sticking"] or record["chatter"]:
        chatter = f"chattering ends {len(record['chatter'])} times, each time known to {record['switch_error']:.1e}"
        yield f"sticking {len(record['sticking'])} times, {record['sticking_time']:.10g} in all; {chatter}"
    nes, lo = told.shares
    reference = record["shares_of"]
    left = motion.energy / told.reference if told.reference > 0.0 else 0.0
    of = f"of the {reference['what']} {reference['energy']:.10g}"
    first, second = told.sharing.names
    yield f"shares   {first} {nes:.4%}  {second} {lo:.4%}  still there {left:.4%}  {of}"
    yield f"balance  error {record['energy_balance_error']:.1e}" + _turnover(record, motion)
    if told.motion.initial_energy > 0.0 and motion.marks:
        yield f"{'gone':>6}  {'time':>14}  {'by ' + first:>9}  {'by ' + second:>9}"
        for name, at in record["at"].items():
            if at["time"] is None:
                yield f"{name + ' %':>6}  {'not reached':>14}"
            else:
                yield f"{name + ' %':>6}  {at['time']:>14.10g}  {at['nes']:>9.4%}  {at['lo']:>9.4%}"
    if record["peaks"] is None:
        yield "peaks    not computed: interrupted"
    else:
        yield f"{'':<24}  {'peak':>14}  {'at time':>14}  {'rms':>14}"
        for entries in record["peaks"].values():
            for name, entry in entries.items():
                yield f"{name:<24}  {entry['peak']:>14.8g}  {entry['time']:>14.8g}  {entry['rms']:>14.8g}"
    yield from _impact_lines(impacts)
    yield from _stage_lines(told, record)


def of_the_start(told: Told, record: dict[str, Any], count: int) -> list[str]:
    """How long the motion keeps the impact sequence of the orbit that it starts on, in at most one line: a stage may follow another family
    from the first impact on. `count`: of the impacts."""
    if told.began is None:
        return []
    name = told.began.called
    left = record["initial"]["left"]
    if left is not None:
        where = f"impact {left['impact']} is at stop {left['stop']}, that of the orbit at stop {left['expected']}"
        return [f"{name} at {left['time']:.6g}: {where}"]
    last = "" if record["last_impact"] is None else f", the last at {record['last_impact']:.6g}"
    return [f"{name} at no impact: all {count} are in its impact sequence{last}"]


def comparison(record: dict[str, Any]) -> Iterator[str]:
    """The lines that set a motion beside that with the sink locked."""
    yield f"{'NES free and locked':<24}  {'peak':>12}  {'locked':>12}  {'ratio':>7}  {'rms':>12}  {'locked':>12}  {'ratio':>7}"
    for group in ("displacements", "drifts"):
        for name, other in record["locked"]["peaks"][group].items():
            own = record["peaks"][group].get(name)
            if own is None:
                continue
            cells = [cell for key in ("peak", "rms") for cell in (own[key], other[key], own[key] / other[key] if other[key] else 1.0)]
            yield f"{name:<24}  " + "  ".join(f"{x:>7.4f}" if k % 3 == 2 else f"{x:>12.6g}" for k, x in enumerate(cells))


def _numbers(values: list[float]) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _turnover(record: dict[str, Any], motion: Motion) -> str:
    """What the balance line says where loads do work."""
    if not motion.work:
        return ""
    of = f" of the {record['shares_of']['what']}, {record['energy_balance_of_turnover']:.1e} of the largest energy that passed through"
    return f"{of}; work of the loads {record['work']:.10g}"


def _impact_lines(impacts: ImpactTable) -> Iterator[str]:
    count = len(impacts["time"])
    if not count:
        return
    yield f"{'impact':>6}  {'time':>16}  stop  {'speed':>14}  {'after':>14}  {'energy lost':>14}"
    for k in range(min(count, SHOWN)):
        row = {name: values[k] for name, values in impacts.items()}
        numbers = f"{row['speed']:>14.8g}  {row['speed_after']:>14.8g}  {row['energy_lost']:>14.8g}"
        yield f"{k + 1:>6}  {row['time']:>16.12g}  {row['stop']:<4}  {numbers}"
    if count > SHOWN:
        yield f"{'...':>6}  and {count - SHOWN} more, which --json lists"


def _stage_lines(told: Told, record: dict[str, Any]) -> Iterator[str]:
    if told.stages is None:
        yield f"stages   not told: {told.why_no_stages}"
        return
    if not told.stages:
        yield "stages   none: no ridge of the spectrum holds for three periods"
    elif told.why_no_stages:
        yield f"stages   {told.why_no_stages}"
    if not told.stages:
        return
    by = "  ".join(f"{'by ' + name:>8}" for name in told.sharing.names)
    yield f"{'stage':<5}  {'from':>9}  {'to':>9}  {'periods':>7}  {'frequency':>9}  {'energy':>19}  {by}  follows"
    scale = record["shares_of"]["energy"] or 1.0

    def spent(data: dict[str, Any]) -> str:
        span = f"{data['energies'][1]:.4g} to {data['energies'][0]:.4g}"
        return f"{span:>19}  {data['dissipated_nes'] / scale:>8.3%}  {data['dissipated_lo'] / scale:>8.3%}"

    if told.began is not None:
        data = record["initial"]["follows"]
        head = f"{'start':<5}  {0.0:>9.5g}  {data['end']:>9.5g}  {'':>7}  {'':>9}"
        yield f"{head}  {spent(data)}  follows {told.began.called}, where it starts: {told.began.kept}"
    for k, (stage, data) in enumerate(zip(told.stages, record["stages"], strict=True), 1):
        head = f"{k:<5}  {data['start']:>9.5g}  {data['end']:>9.5g}  {data['periods']:>7.1f}  {data['frequency']:>9.5g}"
        yield f"{head}  {spent(data)}  {stage.text}"
    if record["changes"]:
        yield f"{'change':<8}  {'at':>9}"
    for change in record["changes"]:
        called = change["name"] or change["label"] or change["family"]
        yield f"{change['kind']:<8}  {change['time']:>9.5g}  harmonic {change['harmonic']} of {called}"
