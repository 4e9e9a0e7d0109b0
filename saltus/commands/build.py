"""`saltus build`: find and follow families within bounds, and save them in a catalogue."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from saltus import __version__, catalogues, compiling, options, outputs, processes, response_catalogues
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, say
from saltus.options import energy_range, whole_above_zero
from saltus.terminal import ProgressBar, counted

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from pathlib import Path

    from branches.building.build import Progress
    from branches.building.plan import Bounds, BuildPlan
    from saltus.scene import Scene

SCHEMA = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--energy", metavar="LO:HI", type=energy_range, help="range of energies h (default: the scene's)")
    parser.add_argument("--max-impacts", metavar="K", type=whole_above_zero, help="most impacts in half a period (default: the scene's)")
    parser.add_argument(
        "--named", action="store_true", default=None, help="with other bounds than the scene's: the families that the scene names, too"
    )
    options.add_shared(parser, "max-quarter-period", "workers", "dask")
    response_catalogues.add_arguments(parser)
    parser.add_argument("--catalogue", metavar="FILE", help="the catalogue (default: that of the scene in the user's data folder)")
    outputs.add_arguments(parser, "json")
    options.add_scene(parser, uses=("springs",))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code, 1 if some of the work failed."""
    if response_catalogues.wants_responses(arguments):
        return response_catalogues.fill_catalogue(arguments)
    files = outputs.outputs_of(arguments)
    scene = options.scene_of(arguments)
    place = catalogues.place_to_save(arguments, scene)

    from branches.building.plan import Bounds, BuildPlan

    # Without stops there are no impacts to bound.
    least = int(not scene.system.stops)
    given = arguments.energy, arguments.max_quarter_period, arguments.max_impacts
    if scene.energy is None and not all((*given[:2], given[2] or least)):
        ways = "--energy, --max-quarter-period and --max-impacts"
        raise BadInput(f"the scene has no table [bounds]; expected one with energy, quarter_period and impacts, or {ways}")
    complete = scene.complete
    bounds = Bounds(
        arguments.energy or complete["energy"],
        arguments.max_quarter_period or complete["quarter_period"],
        arguments.max_impacts or complete["impacts"] or least,
    )
    if arguments.named and not scene.names:
        raise BadInput("--named: the scene has no table [names]; expected it without --named")
    if arguments.named or not any(given):
        limits, points = scene.bounds, scene.reference_points
        named = Bounds(bounds.energy, limits["quarter_period"], limits["impacts"] or least)
        low, high = bounds.energy
        names = tuple(name for name in scene.names if low <= points.get(name, {}).get("h", low) <= high)
        plan = BuildPlan(bounds, named, names, points)
    else:
        plan = BuildPlan.within(bounds)
    _check(scene, plan)
    with processes.open_executor(arguments.workers, arguments.dask) as (executor, count):
        return _build(files, scene, place, plan, executor, count)


def _check(scene: Scene, plan: BuildPlan) -> None:
    """Raise ValueError for a system or bounds from which nothing can be built."""
    from branches.building.work import ends_of, is_searched

    if is_searched(scene.system):
        from branches.search.discovery import check

        check(scene.system, plan.bounds.energy[0], plan.bounds.quarter_period, plan.bounds.impacts, ends_of(scene.system))
        return
    from branches.linear_modes import linear_modes
    from bvp.checks import require_system

    require_system(scene.system, conservative="families of periodic orbits", smooth=True)
    if scene.system.smooth_forces is None and not linear_modes(scene.system):
        reason = scene.system.why_not_inside() or "no linear mode of the system reaches a stop"
        raise BadInput(f"{reason}, so no family begins at a linear mode; expected a system with a mode that reaches a stop")
    if plan.names:
        raise BadInput(f"the scene names {plan.names[0]}; names are searched for two degrees of freedom and one stop: expected no [names]")


def _build(files: outputs.Outputs, scene: Scene, place: Path, plan: BuildPlan, executor: Executor, workers: int) -> int:
    from branches.building.build import build
    from branches.building.plan import refuse_other_plan
    from branches.building.work import is_searched
    from branches.catalogue import Catalogue

    bounds = plan.bounds
    provenance = {"saltus": __version__, "built": plan.plain()}
    with Catalogue(place, "a", scene=scene, provenance=provenance) as catalogue:
        refuse_other_plan(catalogue, plan)
        energies = f"h {bounds.energy[0]:.15g} to {bounds.energy[1]:.15g}"
        impacts = f"up to {catalogues.impacts_text(bounds.impacts)}" if scene.system.stops else "no stops"
        impacts += f", and {len(plan.names)} names" if plan.names else ""
        files.report([f"build  {place}: {energies}, quarter period up to {bounds.quarter_period:g}, {impacts}"])
        if scene.system.smooth_forces is not None:
            compiling.prepare("smooth", "smooth discover")
        else:
            compiling.prepare("build" if is_searched(catalogue.system) else "build modes")
        try:
            with ProgressBar(None, "families") as bar:

                def show(progress: Progress) -> None:
                    bar.update(progress.families, f"{progress.queued} queued, {progress.points} points, {progress.events} events")

                report = build(catalogue, plan, executor, workers, show)
        except KeyboardInterrupt:
            say(f"interrupted; {place} keeps what was finished, and the same command goes on")
            return INTERRUPTED
    files.report(f"FAILS  {text}" for text in report["failed"])
    files.report(_summary(report, scene, bounds))
    code = files.write({"json": lambda: outputs.json_text({"schema": SCHEMA, "bounds": asdict(bounds), **report})})
    return max(code, FAILED if report["failed"] else DONE)


def _summary(report: dict[str, Any], scene: Scene, bounds: Bounds) -> list[str]:
    """The lines that say what a build has found, and how complete it is."""
    from saltus.families import outside_text

    lines = [
        f"done   {counted(report['families'], 'family')}, {counted(report['points'], 'point')}, {counted(report['events'], 'event')}, "
        f"{counted(report['edges'], 'edge')}; {counted(report['beyond'], 'neighbour')} beyond the bounds",
        f"       {_completeness(report, scene)}",
        "       families without a reversal are found only where they meet one with a reversal",
    ]
    outside = outside_text(scene.system)
    if outside:
        lines.append(f"       {outside}")
    if report["incomplete"] and scene.system.smooth_forces is None:
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
        lines.append(f"       nothing lies inside the bounds: {_nearest_outside(scene, bounds)}")
    return lines


def _completeness(report: dict[str, Any], scene: Scene) -> str:
    """The energies that a build searched, and whether it is complete."""
    if not any(level["energies"] for level in report["levels"]):
        others = "and one stop" if scene.system.smooth_forces is None else "with odd symmetry, and one stop or none"
        return f"families that begin at linear modes, and those that they meet; others are searched for two degrees of freedom {others}"
    searched = ", ".join(f"{level['energies']} ({level['new']} new)" for level in report["levels"])
    new = report["levels"][-1]["new"]
    if scene.system.smooth_forces is not None:
        return f"energies searched: {searched}; not complete: neighbouring starts at the origin were compared, which proves nothing"
    complete = "not complete" if new else "complete"
    complete += f": the last energies gave {counted(new, 'new family') if new else 'no new family'}"
    if report["open"]:
        complete += ", but open in h = " + ", ".join(f"{low:.6g}:{high:.6g}" for low, high in report["open"])
    return f"energies searched: {searched}; {complete}"


def _nearest_outside(scene: Scene, bounds: Bounds) -> str:
    """The orbit with the shortest quarter period at the lowest and the highest energy of bounds that contain no family."""
    from branches.building.work import ends_of, is_searched
    from branches.linear_modes import linear_modes
    from branches.naming.search import least_energy
    from branches.search.discovery import discover_orbits

    if not is_searched(scene.system):
        touched = [f"{mode.name} at h = {mode.energies[1]:.6g}, quarter period {mode.alpha:.6g}" for mode in linear_modes(scene.system)]
        if not touched:
            return "no linear mode touches a stop; expected saltus continue --from simulate --start U1,..,V1,.. of zero speed"
        return f"the linear modes touch the stops at other places, or begin no family: {', '.join(touched)}"
    system, quarter_period = scene.system, bounds.quarter_period
    least = least_energy(system)
    if bounds.energy[1] <= least:
        return f"no motion reaches a stop below h = {least:.6g}"
    longest = scene.quarter_period or quarter_period
    while quarter_period < longest:
        quarter_period = min(2.0 * quarter_period, longest)
        found = [
            (orbit.alpha, energy, orbit.label or "-".join(orbit.ends))
            for energy in bounds.energy
            for orbit in discover_orbits(system, energy, quarter_period=quarter_period, impacts=bounds.impacts, ends=ends_of(system)).orbits
        ]
        if found:
            alpha, energy, name = min(found)
            shortest = f"the shortest at their lowest and highest energy is {alpha:.6g} ({name}, h = {energy:.15g})"
            return f"no orbit has so short a quarter period; {shortest}"
    energies = " and at ".join(f"h = {energy:.15g}" for energy in bounds.energy)
    return f"at {energies} no orbit within the impacts has a quarter period up to {quarter_period:g}"
