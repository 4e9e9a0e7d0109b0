"""`saltus spring --scene SCENE --in NAME --values A,B,..`: the force of a spring at values of a parameter, and the stop that it becomes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from bvp.expressions import normalised
from saltus import options, outputs
from saltus.errors import BadInput
from saltus.options import ValueType
from saltus.terminal import table_lines

if TYPE_CHECKING:
    from branches.tables import Table

_values = ValueType(lambda text: [float(part) for part in text.split(",")], lambda found: len(found) > 0, "numbers A,B,..")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument(
        "--in", dest="parameter", metavar="NAME", type=normalised, required=True, help="the parameter that the law of the spring has"
    )
    parser.add_argument("--values", metavar="A,B,..", type=_values, required=True, help="values of the parameter")
    parser.add_argument("--range", metavar="LO:HI", type=options.value_range, default=(-1.2, 1.2), help="displacements (default: -1.2:1.2)")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser, ("springs", "forces", "ground"), model=False)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    import numpy as np

    from branches.tables import table_text
    from bvp.stiff_springs import force_along, stiff_limit

    files = outputs.outputs_of(arguments)
    parametric, name = options.scene_of(arguments).parametric, arguments.parameter
    if parametric is None or name not in parametric.names:
        known = f"one of {', '.join(parametric.names)}" if parametric is not None else "a scene with [parameters]"
        raise BadInput(f"--in {name}: no such parameter; expected {known}")
    springs, coordinates = parametric.system().springs, parametric.system().coordinates
    if len(springs) != 1:
        raise BadInput(f"the scene has {len(springs)} springs; expected a scene with one, under [[springs]]")
    low, high = arguments.range
    at = np.linspace(low, high, 401)
    systems = {f"{value:.10g}": parametric.system({**parametric.values, name: value}) for value in arguments.values}
    forces = {value: force_along(system.springs[0], coordinates, at) for value, system in systems.items()}
    limit, _ = stiff_limit(parametric.in_reciprocal(name), f"1/{name}") if parametric.values[name] > 0.0 else (None, [])
    walls = [] if limit is None else [limit.stops[-1].lower, limit.stops[-1].upper]
    rows = [(value, f"{force[0]:.6g}", f"{force[-1]:.6g}") for value, force in forces.items()]
    place = springs[0].place(coordinates)
    files.report([place, *table_lines((name, *(f"force at {w:g}" for w in arguments.range)), rows, columns="rrr")])
    if walls:
        files.report([f"limit  {name} to infinity: a stop at {' and '.join(f'{wall:g}' for wall in walls)}"])
    table: Table = {"displacement": at, **{f"{name}={value}": force for value, force in forces.items()}}
    figure = "branches.figures.springs:spring_figure", forces, {"at": at, "name": name, "place": place, "walls": walls}
    return files.write({"json": lambda: table_text(table, "json", "points")}, table=lambda: table, figure=figure)
