"""`saltus basin`: the basins of attraction of forced motion over a grid of starts."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.expressions import normalised
from saltus import compiling, options, outputs, processes, responses
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, refusing, say
from saltus.options import ValueType, finite
from saltus.response_starts import same_parametric
from saltus.terminal import ProgressBar, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.forced.branch import ForcedBranch
    from saltus.scene import Scene
    from transitions.basin.grid import StartGrid
    from transitions.basin.plan import BasinPlan
    from transitions.basin.record import Attractor, Basin
    from transitions.response.path import ParameterPath

GRID = 200
MOST_ROWS = 40
"""Rows of a table on the terminal; the files have all."""

FEW, FEW_SMOOTH = 512, 16
"""Grids up to so many starts are followed in this process, unless workers are asked for; with smooth forces a start takes longer."""


def _axis(text: str) -> tuple[str, tuple[float, float] | None]:
    """The name and the range of NAME[:LO:HI]."""
    parts = normalised(text).split(":")
    if len(parts) == 1:
        return parts[0], None
    return parts[0], (float(parts[1]), float(parts[2])) if len(parts) == 3 else (math.nan, math.nan)


_coordinate = ValueType(
    _axis,
    lambda found: found[0] != "" and (found[1] is None or (all(map(math.isfinite, found[1])) and found[1][0] < found[1][1])),
    "NAME or NAME:LO:HI with LO < HI, such as u1:-2:2",
)
_grid = ValueType(
    lambda text: tuple(int(part) for part in text.lower().split("x")),
    lambda found: len(found) == 2 and all(2 <= count <= 10**5 for count in found),
    "NXxNY, two integers above 1, such as 200x200",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    axis = "state coordinate along the {} axis, and its range: u1 or u1' of the scene's names (default: the first {})"
    parser.add_argument("--x", metavar="NAME[:LO:HI]", type=_coordinate, help=axis.format("horizontal", "displacement"))
    parser.add_argument("--y", metavar="NAME[:LO:HI]", type=_coordinate, help=axis.format("vertical", "velocity"))
    parser.add_argument(
        "--fix", metavar="NAME=VALUE", type=options.assignment, action="append",
        help="value of another coordinate of the state (default: 0); repeatable",
    )  # fmt: skip
    parser.add_argument("--phase", metavar="X", type=finite, default=0.0, help="phase w t of the starts, in radians (default: 0)")
    parser.add_argument("--grid", metavar="NXxNY", type=_grid, default=(GRID, GRID), help=f"number of starts (default: {GRID}x{GRID})")
    parser.add_argument(
        "--periods", metavar="N", type=options.periods, help="most periods of the load that a start is followed (default: 4000)"
    )
    parser.add_argument(
        "--from", dest="sources", metavar="RESPONSE", action="append",
        help="name attractors by the branches of this file of saltus continue --in, and take its unstable orbits as saddles; repeatable",
    )  # fmt: skip
    options.add_shared(parser, "workers", "dask")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser, uses=("ground", "forces", "springs"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    scene = options.scene_of(arguments)
    _check_coordinates(arguments, scene)
    plan = _plan(arguments, scene)

    from transitions.basin.basin import find_basin
    from transitions.basin.record import SIMULATION_ENDED

    options.report_model(arguments, files, "explain_motion", scene.system, scene.forces)
    compiling.prepare_for(scene.system, "basin")
    begun = time.perf_counter()
    total = int(plan.grid.possible(scene.system).sum())
    few = FEW if scene.system.smooth_forces is None else FEW_SMOOTH
    with ProgressBar(total, "starts") as bar, processes.executor_of(arguments, len(plan.grid) <= few) as executor:
        basin, interrupted = find_basin(plan, executor, bar.update)
    seconds = time.perf_counter() - begun
    if interrupted:
        say("interrupted; the starts that were finished are written")
    files.report(_head(plan.grid))
    files.report(_lines(basin, arguments, terminal_width(files.words), interrupted))
    done = total - sum(basin.undecided.values()) if interrupted else total
    files.report([f"speed    {done} starts in {seconds:.1f} s, {done / max(seconds, 1e-9):.0f} a second"])
    code = _write(files, basin, scene)
    failed = any(reason.startswith(SIMULATION_ENDED) for reason in basin.undecided)
    return INTERRUPTED if interrupted else max(code, FAILED if failed else DONE)


def _check_coordinates(arguments: argparse.Namespace, scene: Scene) -> None:
    """Refuse coordinates that the state lacks, and fewer than two that vary."""
    from transitions.basin.grid import state_names

    known = state_names(scene.system.coordinates)
    given = [(option, axis[0]) for option, axis in (("--x", arguments.x), ("--y", arguments.y)) if axis is not None]
    for option, name in (*given, *(("--fix", name) for name, _ in arguments.fix or ())):
        if name not in known:
            raise BadInput(f"{option} {name}: no such coordinate of the state; expected one of {', '.join(known)}{nearest(name, known)}")
    if len(given) == 1:
        option, name = given[0]
        other = "--y" if option == "--x" else "--x"
        partner = name.removesuffix("'") if name.endswith("'") else f"{name}'"
        raise BadInput(
            f"a basin needs two state coordinates to vary, received {option} {name} alone; expected {other} too, such as {partner}"
        )
    fixed = [name for name, _ in arguments.fix or ()]
    for name in fixed:
        if fixed.count(name) > 1:
            raise BadInput(f"--fix {name} is given twice; expected one value")


def _plan(arguments: argparse.Namespace, scene: Scene) -> BasinPlan:
    """The basin that is asked for; BadInput if the scene cannot have it."""
    from transitions.basin.grid import BasinAxis, StartGrid, default_range
    from transitions.basin.plan import PERIODS, BasinPlan, path_of
    from transitions.sweep.forced import harmonics_of

    with refusing():
        harmonics_of(scene.forces)
    coordinates = scene.system.coordinates
    fixed = dict(arguments.fix or ())
    (x, x_range), (y, y_range) = arguments.x or (coordinates[0], None), arguments.y or (f"{coordinates[0]}'", None)
    free = sum(name in coordinates for name in (x, y))
    with refusing():
        ranges = [
            given or default_range(scene.system, scene.forces, name, fixed, free) for name, given in ((x, x_range), (y, y_range))
        ]  # fmt: skip
        axes = [BasinAxis(name, low, high, count) for name, (low, high), count in zip((x, y), ranges, arguments.grid, strict=True)]
        grid = StartGrid(coordinates, axes[0], axes[1], fixed, arguments.phase % (2.0 * math.pi))
        path = path_of(scene.in_parameters)
        path.problem(())
    if not grid.possible(scene.system).any():
        raise BadInput(f"every start over {x} and {y} is beyond a stop; expected another range, or another --fix")
    branches = _branches(arguments.sources, path) if arguments.sources else ()
    plan = BasinPlan(path, grid, arguments.periods or PERIODS, branches)
    _check_orbits(plan, arguments.sources)
    return plan


def _branches(sources: Sequence[str], path: ParameterPath) -> list[ForcedBranch]:
    """The branches of files of responses of the same system and parameters."""
    branches, source = responses.read(sources), " and ".join(sources)
    first, wanted = branches[0].problem, path.parametric
    if not first.has_clock or first.ends is not None:
        raise BadInput(f"--from {source} holds no responses to periodic loads; expected a file of saltus continue --in NAME --json")
    if not same_parametric(first.parametric, wanted):
        raise BadInput(f"--from {source} has another system than the scene; expected the responses of the scene")
    return branches


def _check_orbits(plan: BasinPlan, sources: Sequence[str] | None) -> None:
    """Refuse responses without an orbit at the parameters of the basin."""
    source = " and ".join(sources or ())
    with refusing(f"--from {source}"):
        found = plan.orbits
    if plan.branches and not found:
        name = plan.branches[0].name
        low = min(branch.parameter.min() for branch in plan.branches)
        high = max(branch.parameter.max() for branch in plan.branches)
        raise BadInput(
            f"--from {source} has no orbit at {name} = {plan.path.values[name]:.10g}; its branches have {name} = {low:.6g} to {high:.6g}"
        )


def _head(grid: StartGrid) -> list[str]:
    """The line about the starts."""
    from transitions.basin.grid import state_names

    spans = " and ".join(f"{axis.name} = {axis.low:.6g} to {axis.high:.6g}" for axis in (grid.x, grid.y))
    others = [
        f"{name} = {value:.6g}"
        for k, (name, value) in enumerate(zip(state_names(grid.coordinates), grid.base.tolist(), strict=True))
        if k not in grid.axes
    ]
    return [f"basin    {grid.x.count} x {grid.y.count} starts over {spans}; {', '.join([*others, f'phase {grid.phase:.6g}'])}"]


def _lines(basin: Basin, arguments: argparse.Namespace, width: int | None, interrupted: bool) -> list[str]:
    """The tables of a report, and what was not decided."""
    counts, shares = basin.counts, basin.shares
    rows: list[tuple[str, ...]] = [
        (
            f"A{k + 1}", found.kind.value, _named(found.branch, found.family), str(found.period or "-"), found.sequence or "-",
            _number(found.largest_multiplier), str(counts[k]), f"{shares[k]:.2%}", _remark(k, found),
        )
        for k, found in enumerate(basin.attractors)
    ]  # fmt: skip
    head: tuple[str, ...] = ("attractor", "kind", "family", "period", "impacts", "|multiplier|", "starts", "share", "remark")
    if not any(row[-1] for row in rows):
        rows, head = [tuple(row[:-1]) for row in rows], head[:-1]
    lines = table_lines(head, rows[:MOST_ROWS], width=width, columns="llirlrrrt")
    if len(rows) > MOST_ROWS:
        lines.append(f"note     {len(rows) - MOST_ROWS} more attractors; the files have all")
    if basin.saddles:
        cells = [
            (f"S{k + 1}", _named(found.branch, found.family), str(found.period), _number(float(np.abs(found.multipliers).max())),
             _place(basin, found.states))
            for k, found in enumerate(basin.saddles)
        ]  # fmt: skip
        names = f"{basin.grid.x.name}, {basin.grid.y.name}"
        lines += table_lines(("saddle", "family", "period", "|multiplier|", names), cells[:MOST_ROWS], width=width, columns="lirrl")
    elif interrupted:
        pass
    elif basin.saddles_from == "file":
        lines.append(f"saddles  none: the orbits of {' and '.join(arguments.sources)} at these parameters are stable")
    elif len(basin.attractors) > 1:
        lines.append("saddles  none was found from the boundaries between the basins; --from RESPONSE takes those of followed families")
    else:
        lines.append("saddles  none was looked for: one attractor has no boundary; --from RESPONSE takes those of followed families")
    if basin.saddles_from == "part of the boundary":
        lines.append("note     saddles were sought from a part of the boundary only: its motions take long")
    impossible = len(basin) - basin.possible
    if impossible:
        lines.append(f"beyond   {impossible} of {len(basin)} starts are beyond a stop")
    lines += [f"undecided {count} of {basin.possible} starts: {reason}" for reason, count in basin.undecided.items()]
    return lines


def _remark(k: int, found: Attractor) -> str:
    mirror = f"mirror image of A{found.mirror + 1}" if 0 <= found.mirror < k else ""
    return "; ".join(part for part in (mirror, found.note) if part)


def _named(branch: int, family: str) -> str:
    return f"branch {branch}, {family}" if branch else family


def _number(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else "-"


def _place(basin: Basin, states: np.ndarray) -> str:
    """The place of an orbit in the picture, in its first period."""
    i, j = basin.grid.axes
    return f"{states[0, i]:.6g}, {states[0, j]:.6g}"


def _write(files: outputs.Outputs, basin: Basin, scene: Scene) -> int:
    """Write the files; return the exit code."""
    from branches.tables import csv_text
    from transitions.basin.record import basin_record, basin_table
    from transitions.study.plan import loads_as_data

    about: dict[str, Any] = {
        "schema": outputs.SCHEMA,
        "system": scene.system.describe(),
        "forces": loads_as_data(scene.forces),
        **basin_record(basin),
    }
    table = basin_table(basin)

    def text() -> str:
        rows: Sequence[Any] = basin.grid.image(basin.attractor + 1).tolist()
        return outputs.json_text({**about, "cells": rows})

    described = json.dumps(about, allow_nan=False)
    return files.write(
        {"json": text, "csv": lambda: csv_text(table)},
        table=lambda: table,
        about=lambda: described,
        figure=("transitions.basin.figure:basin_figure", basin, {"title": scene.title}),
    )
