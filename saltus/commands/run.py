"""`saltus run`: one damped motion, event by event, and where its energy goes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING

from bvp.interrupts import held
from saltus import catalogue_arguments, motion_start, outputs, scene_arguments, units
from saltus.arguments import positive, whole_above_zero
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, say

if TYPE_CHECKING:
    from saltus.motion_start import Start
    from saltus.motions import Told
    from saltus.progress import ProgressBar
    from saltus.scene import Scene
    from transitions.empirical import Modes

__all__ = ["add_arguments", "run"]

SAMPLES = 2000
MOST_IMPACTS = 10_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    motion_start.add_arguments(parser)
    parser.add_argument("--duration", metavar="T", type=positive, help="time to run (default: as long as the scene's records last)")
    parser.add_argument("--max-impacts", metavar="K", type=whole_above_zero, default=MOST_IMPACTS, help="end there (default: ten million)")
    parser.add_argument("--samples", metavar="N", type=whole_above_zero, help=f"times in the time series of the files (default: {SAMPLES})")
    parser.add_argument("--locked", action="store_true", help="run the system with its sink locked too, and compare peaks and mean squares")
    parser.add_argument(
        "--stages", action="store_true", help="compute the stages of the motion, as --catalogue, --emd and --plot do, too"
    )
    parser.add_argument("--emd", action="store_true", help="tell the empirical modes of the relative displacement (EMD-signal)")
    catalogue_arguments.add_file(parser, "tell the families that stages follow from this catalogue; --on is taken from it, too")
    outputs.add_arguments(parser, arrays=True)
    parser.add_argument("--caption", metavar="TEXT", default="", help="a text under the panels of the picture")
    units.add_arguments(parser)
    scene_arguments.add_arguments(parser, uses=("ground", "forces"))


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    files = outputs.from_arguments(arguments)
    if arguments.samples is not None and arguments.samples < 2:
        raise BadInput(f"--samples {arguments.samples}: expected 2 at least, the begin and the end of the motion")
    if arguments.caption and arguments.plot is None:
        raise BadInput("--caption stands under the picture; expected --plot FILE with it")
    scene = scene_arguments.from_arguments(arguments)

    from saltus.first_run import prepare_motion
    from saltus.motion_modes import modes_of_motion, require_sifting
    from saltus.motions import NOT_ASKED, default_duration, run_locked, run_scene, tell_stages
    from saltus.progress import ProgressBar

    duration = arguments.duration if arguments.duration is not None else default_duration(scene)
    if duration is None:
        raise BadInput("how long? expected --duration T: the scene has no record that would tell")
    if arguments.emd:
        require_sifting()
    if arguments.model:
        from saltus.model import explain_motion

        for line in explain_motion(scene.system, scene.forces):
            print(f"model  {line}", file=files.words, flush=True)
    with held() as interrupt, catalogue_arguments.given(arguments, scene.underlying) as catalogue:
        with interrupt.released():
            start = motion_start.from_arguments(arguments, scene)
            prepare_motion()
            with ProgressBar(100, "% of the motion") as bar:
                told = run_scene(scene, start, duration, arguments.max_impacts, _percent(bar, duration))
        locked = modes = None
        code = DONE if told.motion.status.name in ("DURATION_REACHED", "IMPACTS_FULL") else FAILED
        try:
            if told.interrupted:
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
                        told = tell_stages(told, scene, start, catalogue, _percent(bar, told.motion.duration))
                else:
                    told = replace(told, why_no_stages=NOT_ASKED)
                modes = modes_of_motion(told) if arguments.emd else None
        except KeyboardInterrupt:
            told = replace(told, why_no_stages=told.why_no_stages or "interrupted")
            code = INTERRUPTED
            # Another one ends the program.
            interrupt.came = True
            say("interrupted; the motion is written, without what was to be computed from it")
        code = max(code, _write(arguments, files, scene, start, told, locked, modes, lambda: interrupt.came))
    return outputs.after(interrupt, code)


def _write(
    arguments: argparse.Namespace,
    files: outputs.Outputs,
    scene: Scene,
    start: Start,
    told: Told,
    locked: Told | None,
    modes: Modes | None,
    hurry: Callable[[], bool],
) -> int:
    """Print and write what was computed; return the exit code."""
    from saltus.motion_data import impact_table, json_text, motion_record, sample_table
    from saltus.motion_modes import mode_lines, mode_table
    from saltus.motion_picture import draw
    from saltus.motion_text import comparison, describe, of_the_start

    scale = units.from_arguments(arguments)
    record = motion_record(told, scene, start, scale, locked, modes)
    impacts = impact_table(told, scale)
    for line in describe(told, start, record, impacts):
        print(line, file=files.words)
    if arguments.emd:
        for line in mode_lines(record):
            print(line, file=files.words)
    if locked is not None:
        for line in comparison(record):
            print(line, file=files.words)

    from branches.export.table_files import csv_text, write_binary

    samples = arguments.samples or SAMPLES
    notes: list[str] = []

    def text() -> str:
        data, note = json_text(record, impacts, None if arguments.samples is None else sample_table(told, samples, scale), hurry)
        if note:
            notes.append(note)
            say(f"the impacts in the JSON data are {note}")
        return data

    def series() -> str:
        return csv_text(sample_table(told, samples, scale))

    def arrays(kind: str, file: IO[bytes]) -> None:
        of_impacts = {f"impact_{name}": values for name, values in impacts.items()}
        table = {**sample_table(told, samples, scale), **of_impacts, **mode_table(modes, scale)}
        about = {key: value for key, value in record.items() if key != "forces"}
        write_binary(table, kind, file, about=json.dumps(about, allow_nan=False))

    def picture(path: Path) -> None:
        if told.shown is None:
            raise outputs.NotDrawn(f"cannot draw {files.plot}: {told.why_no_stages}")
        captions = [f"The motion leaves {text}." for text in of_the_start(told, record, len(impacts["time"]))]
        if told.began is not None and told.began.explained != told.began.called:
            captions.insert(0, f"The family of the start is {told.began.explained}.")
        draw(told.shown, catalogue, start.branch, path, " ".join([*filter(None, [arguments.caption]), *captions]))
        if (scale.length, scale.frequency) != (1.0, 1.0):
            print("note   the picture is in natural units", file=files.words)

    with catalogue_arguments.given(arguments, scene.underlying) as catalogue:
        code = files.write(json=text, csv=series, draw=picture, arrays=arrays)
    return INTERRUPTED if notes else code


def _percent(bar: ProgressBar, duration: float) -> Callable[[float], None]:
    """Shows the time that a run has come to as a part of its duration."""
    return lambda time: bar.update(int(100.0 * time / duration))
