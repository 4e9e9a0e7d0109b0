"""`saltus export WHAT`: write the contents of a catalogue as figures or as data."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bvp.expressions import normalised
from saltus import catalogues, compiling, curves, options, outputs
from saltus.errors import BadInput, nearest
from saltus.options import whole_above_zero
from saltus.terminal import ProgressBar, counted

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue, FamilyRow
    from branches.figures.atlas_data import Atlas, Bound
    from branches.forced.branch import ForcedBranch
    from branches.orbit import Orbit
    from branches.tables import Table
    from saltus.scene import Scene

WHAT = {
    "fep": "frequency-energy plot: a figure, or its data",
    "velocities": "start velocities against energy: a figure, or its data",
    "graph": "graph of the families: JSON (node-link), GraphML or DOT",
    "points": "a row for each point: CSV, JSON, NPZ or MAT",
    "orbits": "a row for each orbit: CSV, JSON, NPZ or MAT",
    "response": "forced responses: a figure, or their points",
    "curves": "curves in the plane of two parameters: a figure, or their points",
}
PICTURES = ("fep", "velocities")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parsers = parser.add_subparsers(dest="what", metavar="WHAT", title="what is written", required=True)
    for what, summary in WHAT.items():
        part = parsers.add_parser(what, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if what in PICTURES:
            _add_figure_options(part)
        elif what == "response":
            _add_response_options(part)
        elif what == "curves":
            part.add_argument("names", metavar="ID", nargs="*", help="ids of curves (default: all)")
            outputs.add_arguments(part, "plot", "json", "csv", "npz", "mat")
            catalogues.add_arguments(part)
        else:
            _add_data(part, what)
        part.set_defaults(parser=part)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    if not files.places:
        known = [f"--{kind}" for kind in outputs.KINDS if hasattr(arguments, kind)]
        raise BadInput(f"missing: {' or '.join(known)} (see saltus export {arguments.what} --help)")
    if arguments.what == "response":
        return _response(arguments, files)
    if arguments.what == "curves":
        return _curves(arguments, files)
    return _figure(arguments, files) if arguments.what in PICTURES else _data(arguments, files)


def _curves(arguments: argparse.Namespace, files: outputs.Outputs) -> int:
    """Draw the curves of a catalogue, or write their points."""
    from branches.catalogue.curves import find_curve

    with catalogues.open_catalogue(arguments) as catalogue:
        known = [row.id for row in catalogue.curve_rows()]
        if not known:
            raise BadInput(f"{catalogue.path} has no curve; expected one saved by saltus curve START --save")
        chosen: dict[str, None] = {}
        for name in arguments.names:
            row = find_curve(catalogue, name)
            if row is None:
                raise curves.no_curve(catalogue, name)
            chosen[row.id] = None
        compiling.prepare("parameter" if catalogue.scene.is_free else "response")
        found, title = [catalogue.curve(id) for id in chosen or known], catalogue.scene.title
    return curves.write(files, found, title)


def _add_response_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``response``."""
    parser.add_argument("names", metavar="ID", nargs="*", help="ids of families (default: all)")
    outputs.add_arguments(parser, "plot", "json", "csv", "npz", "mat")
    parser.add_argument("--branches", metavar="FILE", nargs="+", default=[], help="responses, as `saltus continue --in --json` writes them")
    parser.add_argument(
        "--y", metavar="COLUMN", type=normalised,
        help="what the figure shows: max:u1, rms:u1, speed, phase:1, share:.., ...",
    )
    parser.add_argument("--range", metavar="LO:HI", type=options.value_range, help="range of the parameter that the figure shows")
    options.add_filters(parser)
    catalogues.add_arguments(parser)


def _response(arguments: argparse.Namespace, files: outputs.Outputs) -> int:
    """Draw responses, or write their points."""
    from saltus import responses

    if arguments.branches:
        given = [f"--{name}" for name in options.filters_of(arguments)] + ["--catalogue"] * (arguments.catalogue is not None)
        if arguments.names or given:
            raise BadInput(f"{[*given, *arguments.names][0]} chooses families of a catalogue; expected it without --branches")
        return _write_responses(files, responses.read(arguments.branches), arguments, "")
    with catalogues.open_catalogue(arguments) as catalogue:
        if not catalogue.scene.parameters:
            raise BadInput(f"{catalogue.path} holds families in the energy; expected saltus export fep, or a catalogue of responses")
        families = _chosen(catalogue, arguments)
        branches, title = [catalogue.branch(row.id) for row in families], catalogue.scene.title
    return _write_responses(files, branches, arguments, title)


def _write_responses(files: outputs.Outputs, branches: list[ForcedBranch], arguments: argparse.Namespace, title: str) -> int:
    from saltus import responses

    compiling.prepare("response")
    y, interval = arguments.y, arguments.range
    if interval is not None and "plot" not in files.places:
        raise BadInput("--range needs --plot FILE")
    if interval is not None and not any(((b.parameter >= interval[0]) & (b.parameter <= interval[1])).any() for b in branches):
        low, high = min(b.parameter.min() for b in branches), max(b.parameter.max() for b in branches)
        raise BadInput(f"--range {interval[0]:g}:{interval[1]:g} has no point of the responses; expected a part of {low:.6g}:{high:.6g}")
    if y is not None:
        first = branches[0].problem
        responses.check_column("--y", y, first.parametric, max(branch.speeds.shape[1] for branch in branches), free=first.ends is not None)
    return responses.write(files, branches, y, title, interval=interval)


def _add_data(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the options of ``graph``, ``points`` and ``orbits``."""
    names = {"orbits": "orbits: S13O00+@h=1, an id with @h=.."}.get(what, "names of families (default: all)")
    parser.add_argument("names", metavar="NAME", nargs="*", help=names)
    kinds = {"graph": ("json", "graphml", "dot"), "orbits": ("json", "csv", "npz", "mat", "plot")}
    outputs.add_arguments(parser, *kinds.get(what, ("json", "csv", "npz", "mat")))
    if what == "points":
        parser.add_argument("--columns", metavar="A,B", help="columns, in this order (default: all but the states)")
    if what == "orbits":
        parser.add_argument("--samples", metavar="N", type=whole_above_zero, help="add the motion at N times over a period")
    options.add_filters(parser)
    catalogues.add_arguments(parser)


def _data(arguments: argparse.Namespace, files: outputs.Outputs) -> int:
    """Write the graph, or a table of points or orbits."""
    from branches.tables import DEFAULT_COLUMNS, POINT_NAMES, orbit_rows, orbit_samples, points_table, table_text

    figure: outputs.Drawing | None = None
    with catalogues.open_catalogue(arguments) as catalogue:
        if arguments.what == "graph":
            return _graph(catalogue, _chosen(catalogue, arguments) if len(catalogue) else [], files)
        if arguments.what == "orbits":
            catalogues.require_energies(catalogue, "saltus export orbits")
            found = _orbits(catalogue, arguments)
            rows = [(id, orbit) for id, _, orbit in found]
            table = orbit_samples(rows, arguments.samples) if arguments.samples else orbit_rows(rows)
            figure = "branches.figures.single:orbits_figure", [(name, orbit) for _, name, orbit in found], {}
        elif catalogue.scene.parameters:
            table = _response_points(catalogue, arguments)
        else:
            columns = _columns(arguments, POINT_NAMES) or DEFAULT_COLUMNS
            table = points_table(catalogue, _chosen(catalogue, arguments), columns)
    thing = "samples" if getattr(arguments, "samples", None) else arguments.what
    note = counted(len(next(iter(table.values()))), thing[:-1])
    return files.write(
        {"json": lambda: table_text(table, "json", thing)}, table=lambda: table, figure=figure, notes=dict.fromkeys(files.places, note)
    )


def _columns(arguments: argparse.Namespace, known: Sequence[str]) -> tuple[str, ...]:
    """The columns of ``--columns``, which are known and differ; empty without it."""
    columns = tuple(name.strip() for name in arguments.columns.split(",")) if arguments.columns is not None else ()
    for name in columns:
        if columns.count(name) > 1:
            raise BadInput(f"column {name!r} is given {columns.count(name)} times; expected each column once")
        if name not in known:
            hint = nearest(name, known) or f", expected some of {', '.join(known)}"
            raise BadInput(f"unknown column {name!r} of points{hint}")
    return columns


def _response_points(catalogue: Catalogue, arguments: argparse.Namespace) -> Table:
    """The points of forced responses, one family after the other."""
    import numpy as np

    from transitions.response.measures import response_table

    families = _chosen(catalogue, arguments)
    compiling.prepare("response")
    branches = [catalogue.branch(row.id) for row in families]
    table = response_table(branches)
    del table["branch"]
    table = {"family": np.repeat([row.id for row in families], [row.points for row in families]), **table}
    return {name: table[name] for name in _columns(arguments, [*table]) or table}


def _chosen(catalogue: Catalogue, arguments: argparse.Namespace) -> list[FamilyRow]:
    """The families that the names and the filters choose."""
    filters = catalogues.filters_for(catalogue, arguments)
    families = catalogue.families(**filters)
    if arguments.names:
        named = {catalogue.find(name).id for name in arguments.names}
        families = [row for row in families if row.id in named]
    if not families:
        raise options.nothing_fits(str(catalogue.path), len(catalogue), filters, arguments.names)
    return families


def _graph(catalogue: Catalogue, families: list[FamilyRow], files: outputs.Outputs) -> int:
    """Write the graph of some families, without the dead ends of others."""
    from branches.catalogue.catalogue import FLATTENED, graph_text

    graph = catalogue.graph()
    kept = {row.id for row in families}
    if len(kept) < len(catalogue):
        graph.remove_nodes_from([id for id, data in graph.nodes(data=True) if data["kind"] == "family" and id not in kept])
        graph.remove_nodes_from([id for id, data in graph.nodes(data=True) if data["kind"] == "dead end" and not graph.degree(id)])
    if not files.to_stdout:
        files.report(f"note   {FLATTENED.format(kind)}" for kind in files.places if kind != "json")
    note = f"{counted(graph.number_of_nodes(), 'node')}, {counted(graph.number_of_edges(), 'edge')}"
    texts = {kind: lambda kind=kind: graph_text(graph, kind) for kind in files.places}
    return files.write(texts, notes=dict.fromkeys(files.places, note))


def _orbits(catalogue: Catalogue, arguments: argparse.Namespace) -> list[tuple[str, str, Orbit]]:
    """The orbits that are named, or those that the families chosen have at an energy: the family's id, its label as given, the orbit."""
    from branches.naming.labels import parse_name
    from saltus.families import branch_of, called

    found: list[tuple[str, str, Orbit]] = []
    filters = options.filters_of(arguments)
    if arguments.names:
        if filters:
            raise BadInput(f"names and --{next(iter(filters))} both choose orbits; expected names, or --energy H for all that cross it")
        for name in arguments.names:
            match = catalogue.find(name)
            branch = branch_of(match, match.id, catalogue)
            if "@" not in name:
                raise BadInput(f"an orbit of {name} needs {name}@h=.. or @alpha=..")
            h, alpha = match.h, match.alpha
            assert h is not None and alpha is not None
            orbits = branch.orbits_at(energy=h) if "h=" in name else branch.orbits_at(alpha=alpha)
            if not orbits:
                raise BadInput(f"the orbit {name} could not be solved for; expected one farther from the end of its family")
            distances = [abs(orbit.h / h - 1.0) + abs(orbit.alpha / alpha - 1.0) for orbit in orbits]
            orbit = orbits[distances.index(min(distances))]
            found.append((match.id, called(parse_name(name), orbit), orbit))
    elif arguments.energy is None:
        raise BadInput("orbits need names such as S13O00+@h=1, or --energy H for all families that cross it")
    else:
        for row in catalogue.families(**filters):
            found += [(row.id, orbit.label, orbit) for orbit in catalogue.branch(row.id).orbits_at(energy=arguments.energy)]
        if not found:
            raise options.nothing_fits(str(catalogue.path), len(catalogue), filters)
    return found


def _add_figure_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``fep`` and ``velocities``."""
    outputs.add_arguments(parser, "plot", "json", "csv", "npz", "mat")
    parser.add_argument("--branches", metavar="FILE", nargs="+", default=[], help="families, as `saltus continue --json` writes them")
    parser.add_argument(
        "--catalogue", metavar="FILE", help="families of this catalogue (default: that of the scene in the user's data folder)"
    )
    parser.add_argument("--data", metavar="FILE", help="draw from exported data")
    options.add_filters(parser, shown=True)
    options.add_shared(parser, "frequency", "clearance", "natural-frequency", "max-quarter-period")
    parser.add_argument("--impulsive", action="store_true", help="add the curve of impulsive motions, and the periodic ones")
    parser.add_argument("--regimes", action="store_true", help="add the bounds of the regimes I to IV, as saltus computes them")
    parser.add_argument(
        "--inset",
        metavar="LO:HI[,FLO:FHI]",
        action="append",
        default=[],
        help="enlarge a range of energies, and of frequencies; can be repeated",
    )
    parser.add_argument("--named", action="store_true", help="the families that the scene names, alone")
    parser.add_argument("--names", metavar="N", type=whole_above_zero, help="name at most N families")
    options.add_scene(parser, ("springs",))


def _figure(arguments: argparse.Namespace, files: outputs.Outputs) -> int:
    """Draw a figure of many families, or write the data that it is drawn from."""
    from branches.figures.curves import parse_inset

    for kind, path in files.places.items():
        if kind != "plot" and Path(path).suffix.lower() != f".{kind}":
            raise BadInput(f"--{kind} {path}: expected a file ending in .{kind}")
    for option in ("names", "inset"):
        if "plot" not in files.places and getattr(arguments, option):
            raise BadInput(f"--{option} needs --plot FILE")
    insets = [parse_inset(text) for text in arguments.inset]
    if sum((bool(arguments.branches), arguments.data is not None, arguments.catalogue is not None)) > 1:
        raise BadInput("families come from one place: give one of --catalogue, --branches and --data")
    if arguments.what == "velocities" and insets:
        raise BadInput("--inset shows a part of the frequency-energy plot; expected it with fep")
    atlas = _atlas(arguments)

    def write_data(path: Path) -> None:
        from branches.figures.data import write_atlas

        write_atlas(atlas, path)

    names = {} if arguments.names is None else {"names": arguments.names}
    if arguments.what == "velocities":
        figure = "branches.figures.atlas:velocities_figure", atlas, names
    else:
        figure = "branches.figures.atlas:atlas_figure", atlas, {"frequency": arguments.frequency, "insets": insets, **names}
    return files.write(files={kind: write_data for kind in files.places if kind != "plot"}, figure=figure)


def _atlas(arguments: argparse.Namespace) -> Atlas:
    """The data of the figure: read from `--data`, or collected from the chosen families and, on request, the impulsive motions."""
    from branches.figures.atlas_data import atlas_of, cited_names, regime_bounds, rescaled

    if arguments.data is not None:
        from branches.figures.data import read_atlas

        chosen = *options.parameters_of(arguments), *options.filters_of(arguments)
        for option in ("impulsive", "regimes", "named", "energy", "scene", *chosen):
            if getattr(arguments, option) not in (None, False):
                raise BadInput(f"--{option} chooses what is in the data, and {arguments.data} holds them already; give it without --data")
        atlas = read_atlas(arguments.data)
        # Data keep the units in which they were written, unless others are asked for.
        scaled = (arguments.clearance, arguments.natural_frequency) != (1.0, 1.0)
        return rescaled(atlas, arguments.clearance, arguments.natural_frequency) if scaled else atlas

    scene = options.scene_of(arguments)
    branches, everything = _families(arguments, scene)
    system = branches[0].system
    points = scene.names_for(system)
    if arguments.named:
        named = cited_names(branches, points)
        branches = [branch for branch in branches if branch.id in named]
        if not branches:
            raise BadInput("--named: no family here has a name of the scene; expected saltus build --named, or a scene with [names]")
    curve = periodic = None
    energy = shown = arguments.energy if isinstance(arguments.energy, tuple) else None
    if arguments.impulsive:
        from branches.search.impulsive_motions import impulsive_manifold
        from branches.search.impulsive_orbits import impulsive_orbits

        compiling.prepare("impulsive")
        if energy is None:
            energy = min(float(b.points["h"].min()) for b in branches), max(float(b.points["h"].max()) for b in branches)
        with ProgressBar():
            periodic = impulsive_orbits(system, energy, quarter_period=arguments.max_quarter_period or scene.bounds["quarter_period"])
            curve = impulsive_manifold(system, energy)
    bounds: tuple[Bound, ...] = ()
    if arguments.regimes:
        bounds, missing = regime_bounds(system, everything)
        for text in missing:
            print(f"note   no bound {text}")
    atlas = atlas_of(system, branches, reference_points=points, manifold=curve, impulsive=periodic, bounds=bounds, energy=shown)
    return rescaled(atlas, arguments.clearance, arguments.natural_frequency)


def _families(arguments: argparse.Namespace, scene: Scene) -> tuple[list[Branch], list[Branch]]:
    """The families that the filters choose, and those that bound the regimes: all of them where the regimes are asked for."""
    filters = options.filters_of(arguments)
    if arguments.branches:
        from branches.catalogue.find import chosen
        from branches.catalogue.packing import pack_family
        from branches.catalogue.rows import difference
        from branches.reading import read_branch

        everything = [read_branch(path) for path in arguments.branches]
        differs = difference(everything[0].system.describe(), scene.system.describe())
        if differs is not None:
            given = arguments.scene is not None or options.parameters_of(arguments)
            there = f": there {differs}" if given else " than the scene lee2009; expected --scene FILE with its system"
            raise BadInput(f"{arguments.branches[0]} belongs to another system{there}")
        kept = {row.id for row in chosen([pack_family(branch).row for branch in everything], **filters)}
        place = "the files given"
    else:
        with catalogues.open_catalogue(arguments) as catalogue:
            place = str(catalogue.path)
            catalogues.require_energies(catalogue, f"saltus export {arguments.what}")
            if not len(catalogue):
                raise options.nothing_fits(place, 0, filters)
            kept = {row.id for row in catalogue.families(**filters)}
            everything = [catalogue.branch(row.id) for row in catalogue.families() if arguments.regimes or row.id in kept]
    branches = [branch for branch in everything if branch.id in kept]
    if not branches:
        raise options.nothing_fits(place, len(everything) or 1, filters)
    return branches, everything
