"""`saltus build`: find and follow every family within bounds, and save them in a catalogue."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from saltus import catalogues, options, outputs
from saltus.errors import DONE, FAILED, INTERRUPTED, say
from saltus.options import energy_range, positive, whole_above_zero
from saltus.tables import counted

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from pathlib import Path

    from branches.building.build import Progress
    from branches.building.plan import Bounds, BuildPlan
    from bvp.system import ImpactSystem
    from saltus.scene import Scene
    from saltus.terminal import ProgressBar

__all__ = ["add_arguments", "run"]

SCHEMA = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, help="range of energies h (default: the scene's)")
    parser.add_argument("--max-quarter-period", metavar="A", type=positive, help="longest quarter period (default: the scene's)")
    parser.add_argument("--max-impacts", metavar="K", type=whole_above_zero, help="most impacts in half a period (default: the scene's)")
    parser.add_argument("--workers", metavar="N", type=whole_above_zero, help="number of processes (default: one for each core)")
    parser.add_argument("--dask", metavar="ADDRESS", help="use a Dask cluster instead of processes")
    parser.add_argument("--catalogue", metavar="FILE", help="the catalogue (default: that of the scene in the user's data folder)")
    outputs.add_arguments(parser, "json")
    options.add_scene(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code, 1 if some of the work failed."""
    files = outputs.outputs_of(arguments)
    scene = options.scene_of(arguments)
    place = catalogues.place_to_save(arguments, scene)

    from branches.building.plan import Bounds, BuildPlan
    from branches.building.work import ends_of
    from branches.search.discovery import check
    from saltus.processes import open_executor

    complete = scene.complete
    bounds = Bounds(
        arguments.energy or complete["energy"],
        arguments.max_quarter_period or complete["quarter_period"],
        arguments.max_impacts or complete["impacts"],
    )
    if arguments.energy is None and arguments.max_quarter_period is None and arguments.max_impacts is None:
        plan = BuildPlan(bounds, Bounds(bounds.energy, scene.quarter_period, scene.impacts), scene.names, scene.reference_points)
    else:
        plan = BuildPlan.within(bounds)
    check(scene.system, bounds.energy[0], bounds.quarter_period, bounds.impacts, ends_of(scene.system))
    with open_executor(arguments.workers, arguments.dask) as (executor, count):
        return _build(files, scene, place, plan, executor, count)


def _build(files: outputs.Outputs, scene: Scene, place: Path, plan: BuildPlan, executor: Executor, workers: int) -> int:
    from branches.building.build import build
    from branches.building.plan import refuse_other_plan
    from branches.catalogue import Catalogue
    from saltus import __version__
    from saltus.catalogues import impacts_text
    from saltus.processes import prepare
    from saltus.terminal import ProgressBar

    bounds = plan.bounds
    provenance = {"saltus": __version__, "built": plan.plain()}
    with Catalogue(place, "a", scene=scene, provenance=provenance) as catalogue:
        refuse_other_plan(catalogue, plan)
        energies = f"h {bounds.energy[0]:g} to {bounds.energy[1]:g}"
        impacts = f"up to {impacts_text(bounds.impacts)}" + (f", and {len(plan.names)} names" if plan.names else "")
        files.report([f"build  {place}: {energies}, quarter period up to {bounds.quarter_period:g}, {impacts}"])
        prepare(discovery=True)
        try:
            with ProgressBar(None, "families") as bar:
                report = build(catalogue, plan, executor, workers, lambda progress: _show(bar, progress))
        except KeyboardInterrupt:
            say(f"interrupted; {place} keeps what was finished, and the same command goes on")
            return INTERRUPTED
    files.report(f"FAILS  {text}" for text in report["failed"])
    files.report(_summary(report, scene, bounds))
    code = files.write({"json": lambda: outputs.json_text({"schema": SCHEMA, "bounds": asdict(bounds), **report})})
    return max(code, FAILED if report["failed"] else DONE)


def _summary(report: dict[str, Any], scene: Scene, bounds: Bounds) -> list[str]:
    """The lines that say what a build has found, and how complete it is."""
    searched = ", ".join(f"{level['energies']} ({level['new']} new)" for level in report["levels"])
    new = report["levels"][-1]["new"]
    complete = "not complete" if new else "complete"
    complete += f": the last energies gave {counted(new, 'new family') if new else 'no new family'}"
    if report["open"]:
        complete += ", but open in h = " + ", ".join(f"{low:.6g}:{high:.6g}" for low, high in report["open"])
    lines = [
        f"done   {counted(report['families'], 'family')}, {counted(report['points'], 'point')}, {counted(report['events'], 'event')}, "
        f"{counted(report['edges'], 'edge')}; {counted(report['beyond'], 'neighbour')} beyond the bounds",
        f"       energies searched: {searched}; {complete}",
        "       families without a reversal are found only where they meet one with a reversal",
    ]
    if report["incomplete"]:
        energies = ", ".join(f"{energy:.6g}" for energy in sorted(report["incomplete"]))
        lines.append(f"       starts a rounding error apart part at h = {energies}: there the list may lack an orbit")
    if report["halves"]:
        lines.append(f"       of {counted(report['halves'], 'family')} one side of a branch point was followed; the other is its image")
    digits = report["digits"]
    if digits["orbits"]:
        solved = counted(digits["orbits"], "orbit")
        lines.append(f"       {solved} solved in fifty digits to decide stability, in {digits['seconds']:.1f} s")
    if report["missed"]:
        lines.append(f"       {counted(len(report['missed']), 'event')} missed: `saltus check` lists them")
    if report["lost"]:
        lost = counted(len(report["lost"]), "bifurcation")
        lines.append(f"       at {lost} no new family was found (dead ends of the graph, which say why)")
    if not report["families"]:
        lines.append(f"       {_nothing_inside(scene.system, bounds, scene.quarter_period)}")
    return lines


def _show(bar: ProgressBar, progress: Progress) -> None:
    bar.update(progress.families, f"{progress.queued} queued, {progress.points} points, {progress.events} events")


def _nothing_inside(system: ImpactSystem, bounds: Bounds, longest: float) -> str:
    """The line about bounds without a family: the shortest orbit at their lowest or highest energy.

    Parameters
    ----------
    system : bvp.system.ImpactSystem
    bounds : branches.building.plan.Bounds
    longest : float
        Longest quarter period of the search. It starts at that of the bounds and is doubled until there is an orbit.

    Examples
    --------
    >>> from branches.building.plan import Bounds
    >>> from bvp.system import vibro_impact_nes
    >>> print(_nothing_inside(vibro_impact_nes(), Bounds((0.01, 0.02), 2.0, 3), 10.0))
    nothing lies inside the bounds: no motion reaches a stop below h = 0.05
    """
    from branches.building.work import ends_of
    from branches.naming.search import least_energy
    from branches.search.discovery import discover_orbits

    begin = "nothing lies inside the bounds: "
    least = least_energy(system)
    if bounds.energy[1] <= least:
        return f"{begin}no motion reaches a stop below h = {least:.6g}"
    quarter_period = bounds.quarter_period
    while quarter_period < longest:
        quarter_period = min(2.0 * quarter_period, longest)
        found = [
            (orbit.alpha, energy, orbit.label or "-".join(orbit.ends))
            for energy in bounds.energy
            for orbit in discover_orbits(system, energy, quarter_period=quarter_period, impacts=bounds.impacts, ends=ends_of(system)).orbits
        ]
        if found:
            alpha, energy, name = min(found)
            shortest = f"the shortest at their lowest and highest energy is {alpha:.6g} ({name}, h = {energy:g})"
            return f"{begin}no orbit has so short a quarter period; {shortest}"
    energies = " and at ".join(f"h = {energy:g}" for energy in bounds.energy)
    return f"{begin}at {energies} no orbit within the impacts has a quarter period up to {quarter_period:g}"
