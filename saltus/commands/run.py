"""`saltus run`: one damped motion, event by event, and where its energy goes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bvp.interrupts import defer_interrupts
from saltus import catalogues, compiling, options, outputs
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, refusing, say
from saltus.motion import simulation
from saltus.options import positive, value_range, whole_above_zero
from saltus.terminal import ProgressBar

if TYPE_CHECKING:
    from branches.tables import Table
    from saltus.motion.simulation import MotionReport, Start
    from saltus.scene import Scene
    from transitions.frequencies import IntrinsicModes

SAMPLES = 2000
MOST_IMPACTS = 10_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    simulation.add_arguments(parser)
    parser.add_argument("--duration", metavar="T", type=positive, help="time to run (default: the length of the scene's records)")
    parser.add_argument(
        "--max-impacts",
        metavar="K",
        type=whole_above_zero,
        default=MOST_IMPACTS,
        help="end after this number of impacts (default: ten million)",
    )
    parser.add_argument(
        "--samples", metavar="N", type=whole_above_zero, help=f"number of times in the time series of the files (default: {SAMPLES})"
    )
    parser.add_argument(
        "--locked", action="store_true", help="run the system with its sink locked, too, and compare peaks and mean squares"
    )
    parser.add_argument("--stages", action="store_true", help="compute the stages of the motion; --catalogue, --emd and --plot also do")
    parser.add_argument("--emd", action="store_true", help="report the empirical modes of the relative displacement (needs EMD-signal)")
    parser.add_argument("--catalogue", metavar="FILE", help="take the families that stages follow from this catalogue, and that of --on")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    parser.add_argument("--caption", metavar="TEXT", default="", help="a text below the figure")
    parser.add_argument("--window", metavar="T1:T2", type=value_range, help="times that the figure shows, a close-up (default: all)")
    options.add_shared(parser, "clearance", "natural-frequency")
    options.add_scene(parser, uses=("ground", "forces", "springs"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    if arguments.samples is not None and arguments.samples < 2:
        raise BadInput(f"--samples {arguments.samples}: expected 2 at least, the begin and the end of the motion")
    if arguments.caption and arguments.plot is None:
        raise BadInput("--caption needs --plot FILE")
    if arguments.window is not None and arguments.plot is None:
        raise BadInput("--window limits the times of a figure; expected it with --plot FILE")
    scene = options.scene_of(arguments)

    from bvp.forcing import Record
    from saltus.motion.simulation import NOT_ASKED, modes_of_motion, run_locked, run_scene, with_stages
    from transitions.frequencies import NotInstalled, sifting
    from transitions.sharing import lock

    records = [float(force.times[-1]) for force in scene.forces if isinstance(force, Record)]
    duration = arguments.duration or max(records, default=None)
    if duration is None:
        raise BadInput("--duration is required: the scene has no sampled load")
    if arguments.emd:
        with refusing("", NotInstalled):  # before the work
            sifting()
    options.report_model(arguments, files, "explain_motion", scene.system, scene.forces)
    with defer_interrupts() as interrupt, catalogues.given(arguments, scene.underlying) as catalogue:
        with interrupt.released():
            start = simulation.start_of_motion(arguments, scene)
            if arguments.locked:
                lock(scene.system, scene.nes, scene.forces)  # what cannot be locked is refused before the work
            compiling.prepare_for(scene.system, "run")
            with ProgressBar(100, "% of the motion and its peaks") as bar:
                report = run_scene(scene, start, duration, arguments.max_impacts, _percent(bar, duration))
        locked = modes = None
        code = DONE if report.motion.status.name in ("DURATION_REACHED", "IMPACTS_FULL") else FAILED
        try:
            if report.interrupted:
                raise KeyboardInterrupt
            with interrupt.released():
                if arguments.locked:
                    with ProgressBar(100, "% of the locked motion") as bar:
                        locked = run_locked(scene, start, duration, arguments.max_impacts, _percent(bar, duration))
                    if locked.interrupted:
                        locked = None
                        raise KeyboardInterrupt
                if arguments.stages or arguments.emd or arguments.plot is not None or catalogue is not None:
                    with ProgressBar(100, "% of the stages") as bar:
                        report = with_stages(report, scene, start, catalogue, _percent(bar, report.motion.duration))
                else:
                    report = replace(report, why_no_stages=NOT_ASKED)
                modes = modes_of_motion(report) if arguments.emd else None
        except KeyboardInterrupt:
            report = replace(report, why_no_stages=report.why_no_stages or "interrupted")
            code = INTERRUPTED
            # Another one ends the program.
            interrupt.came = True
            say("interrupted; the motion is written, without what was to be computed from it")
        code = max(code, _write(arguments, files, scene, start, report, locked, modes))
    if interrupt.came and code != INTERRUPTED:
        raise KeyboardInterrupt(outputs.WRITTEN)
    return code


def _write(
    arguments: argparse.Namespace,
    files: outputs.Outputs,
    scene: Scene,
    start: Start,
    report: MotionReport,
    locked: MotionReport | None,
    modes: IntrinsicModes | None,
) -> int:
    """Print and write what was computed; return the exit code."""
    from saltus.motion.record import (
        comparison,
        mode_lines,
        mode_table,
        motion_json,
        motion_lines,
        motion_record,
        of_the_start,
        sample_table,
    )
    from saltus.motion.simulation import impact_table

    scale = options.Units(arguments.clearance, arguments.natural_frequency)
    record = motion_record(report, scene, start, scale, locked, modes)
    impacts = impact_table(report.motion, scale)
    files.report(options.parameter_lines(scene))
    files.report(motion_lines(report, start, record, impacts))
    if arguments.emd:
        files.report(mode_lines(record))
    if locked is not None:
        files.report(comparison(record))

    from branches.tables import csv_text

    samples = arguments.samples or SAMPLES

    def text() -> str:
        return motion_json(record, impacts, None if arguments.samples is None else sample_table(report, samples, scale))

    def series() -> str:
        return csv_text(sample_table(report, samples, scale))

    def table() -> Table:
        of_impacts = {f"impact_{name}": values for name, values in impacts.items()}
        return {**sample_table(report, samples, scale), **of_impacts, **mode_table(modes, scale)}

    def about() -> str:
        return json.dumps({key: value for key, value in record.items() if key != "forces"}, allow_nan=False)

    def plot(path: Path) -> None:
        if report.shown is None:
            raise outputs.NotDrawn(f"cannot draw {files.places['plot']}: {report.why_no_stages}")
        captions = [f"The motion leaves {text}." for text in of_the_start(report, record, len(impacts["time"]))]
        if report.began is not None and report.began.explained != report.began.called:
            captions.insert(0, f"The family of the start is {report.began.explained}.")
        from transitions.figure import draw_transition
        from transitions.transition import atlas_behind

        caption = " ".join([*filter(None, [arguments.caption]), *captions])
        behind = atlas_behind(report.shown, catalogue, [] if start.branch is None else [start.branch])
        try:
            draw_transition(report.shown, behind, path, caption=caption, window=arguments.window, modes=modes)
        except ValueError as error:
            if arguments.window is None:
                raise
            raise outputs.NotDrawn(f"--window: {error}") from error
        if (scale.length, scale.frequency) != (1.0, 1.0):
            files.report(["note   the figure is in natural units"])

    with catalogues.given(arguments, scene.underlying) as catalogue:
        return files.write({"json": text, "csv": series}, table=table, about=about, files={"plot": plot})


def _percent(bar: ProgressBar, duration: float) -> Callable[[float], None]:
    """A callback that shows the time reached as a percentage of the duration."""
    return lambda time: bar.update(int(100.0 * time / duration))
