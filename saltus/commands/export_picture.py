"""`saltus export fep|velocities --out FILE`: pictures of many families, and the data that they are drawn from."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import catalogue_arguments, family_filters, scene_arguments
from saltus.arguments import one_of, positive, whole_above_zero
from saltus.errors import DONE, BadInput, nearest, say_and_code
from saltus.files import STANDARD_OUTPUT, WriteFailure, check_writable, replacing

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.diagram.atlas_data import Atlas, Bound
    from saltus.scene import Scene

__all__ = ["add_arguments", "run"]

def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--out", metavar="FILE", required=True, help="picture: FILE.png, .pdf, .svg; data: FILE.csv, .json, .npz, .mat")
    parser.add_argument("--branches", metavar="FILE", nargs="+", default=[], help="families, as `saltus continue --json` writes them")
    catalogue_arguments.add_file(parser, "families of this catalogue (default: that of the scene in the user's data folder)")
    parser.add_argument("--data", metavar="FILE", help="draw from data that were exported before")
    family_filters.add_arguments(parser, shown=True)
    parser.add_argument("--frequency", metavar="AXIS", type=one_of("index", "fundamental"), default="index", help="as in `saltus continue`")
    parser.add_argument("--impulsive", action="store_true", help="add the impulsive motions: their curve and the periodic ones")
    parser.add_argument("--max-quarter-period", metavar="A", type=positive, help="longest quarter period of periodic impulsive orbits")
    parser.add_argument("--regimes", action="store_true", help="add the bounds of the regimes I to IV, which are ours and not the paper's")
    parser.add_argument(
        "--inset", metavar="LO:HI[,FLO:FHI]", action="append", default=[], help="show a part larger: its energies, and its frequencies"
    )
    parser.add_argument("--names", metavar="N", type=whole_above_zero, help="name N families at most")
    parser.add_argument("--clearance", metavar="D", type=positive, default=1.0, help="scale lengths by D and energies by its square")
    parser.add_argument(
        "--natural-frequency", metavar="W", type=positive, default=1.0, help="scale frequencies by that of the oscillator alone, in rad/s"
    )
    scene_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from branches.diagram.files import PICTURE_FORMATS
    from branches.diagram.insets import parse_inset
    from branches.export import DATA_FORMATS, data_format

    suffix = Path(arguments.out).suffix[1:].lower()
    known = (*PICTURE_FORMATS, *DATA_FORMATS)
    if arguments.out == STANDARD_OUTPUT or suffix not in known:
        raise BadInput(f"unknown format of {arguments.out!r}: expected a file ending in {', '.join(known)}{nearest(suffix, known)}")
    check_writable(arguments.out)
    for option in ("names", "inset"):
        if suffix in DATA_FORMATS and getattr(arguments, option):
            kinds = ", ".join(PICTURE_FORMATS)
            raise BadInput(f"--{option} is of a picture, and {arguments.out} holds data; expected a file ending in {kinds}")
    insets = [parse_inset(text) for text in arguments.inset]
    if sum((bool(arguments.branches), arguments.data is not None, arguments.catalogue is not None)) > 1:
        raise BadInput("families come from one place: give one of --catalogue, --branches and --data")
    if arguments.what == "velocities" and insets:
        raise BadInput("--inset shows a part of the frequency-energy plot; expected it with fep")
    atlas = _atlas(arguments)

    def write(path: Path) -> None:
        from branches.diagram.atlas import draw_atlas
        from branches.diagram.velocity_picture import draw_velocities

        names = {} if arguments.names is None else {"names": arguments.names}
        if arguments.what == "velocities":
            draw_velocities(atlas, path, **names)
        else:
            draw_atlas(atlas, path, frequency=arguments.frequency, insets=insets, **names)

    try:
        if data_format(arguments.out) is not None:
            from branches.export import write_atlas

            write_atlas(atlas, arguments.out)
        else:
            with replacing(arguments.out) as beside:
                write(beside)
    except WriteFailure as failure:
        return say_and_code(failure)
    print(f"wrote  {arguments.out}", flush=True)
    return DONE


def _require_system(scene: Scene, branch: Branch, path: str) -> None:
    """Refuse a branch of another system than the one that was asked for."""
    from branches.catalogue.scene import difference

    told = difference(branch.system.describe(), scene.system.describe())
    if told is not None:
        raise BadInput(f"{path} belongs to another system: there {told}")


def _atlas(arguments: argparse.Namespace) -> Atlas:
    from branches.diagram.atlas_data import atlas_of, regime_bounds, rescaled

    if arguments.data is not None:
        from branches.export import read_atlas

        filters = family_filters.told(family_filters.from_arguments(arguments))
        for option in ("impulsive", "regimes", "energy", "scene", *scene_arguments.parameters(arguments), *filters):
            if getattr(arguments, option) not in (None, False):
                raise BadInput(f"--{option} chooses what is in the data, and {arguments.data} holds them already; give it without --data")
        atlas = read_atlas(arguments.data)
        if (arguments.clearance, arguments.natural_frequency) == (1.0, 1.0):
            return atlas
        return rescaled(atlas, arguments.clearance, arguments.natural_frequency)

    scene = scene_arguments.from_arguments(arguments)
    branches, everything = _families(arguments, scene)
    system = branches[0].system
    curve = periodic = None
    energy = shown = arguments.energy if isinstance(arguments.energy, tuple) else None
    if arguments.impulsive:
        from branches.impulsive import impulsive_manifold, impulsive_orbits
        from saltus.first_run import prepare

        prepare(impulsive=True)
        if energy is None:
            energy = min(float(b.points["h"].min()) for b in branches), max(float(b.points["h"].max()) for b in branches)
        periodic = impulsive_orbits(system, energy, quarter_period=arguments.max_quarter_period or scene.quarter_period)
        curve = impulsive_manifold(system, energy)
    bounds: tuple[Bound, ...] = ()
    if arguments.regimes:
        bounds, missing = regime_bounds(system, everything)
        for text in missing:
            print(f"note   no bound {text}", flush=True)
    atlas = atlas_of(system, branches, pinned=scene.names_for(system), manifold=curve, impulsive=periodic, bounds=bounds, energy=shown)
    return rescaled(atlas, arguments.clearance, arguments.natural_frequency)


def _families(arguments: argparse.Namespace, scene: Scene) -> tuple[list[Branch], list[Branch]]:
    """The families that the filters choose, and, where the regimes are asked for, whose bounds any family can tell, all of them."""
    filters = family_filters.from_arguments(arguments)
    if arguments.branches:
        from branches.catalogue.find import chosen
        from branches.catalogue.packing import pack
        from branches.record import read_branch

        everything = [read_branch(path) for path in arguments.branches]
        if arguments.scene is not None or scene_arguments.parameters(arguments):
            _require_system(scene, everything[0], arguments.branches[0])
        kept = {row.id for row in chosen([pack(branch).row for branch in everything], **filters)}
        place = "the files given"
    else:
        with catalogue_arguments.from_arguments(arguments) as catalogue:
            place = str(catalogue.path)
            if not len(catalogue):
                raise family_filters.nothing_fits(place, 0, filters)
            kept = {row.id for row in catalogue.families(**filters)}
            everything = [catalogue.branch(row.id) for row in catalogue.families() if arguments.regimes or row.id in kept]
    branches = [branch for branch in everything if branch.id in kept]
    if not branches:
        raise family_filters.nothing_fits(place, len(everything) or 1, filters)
    return branches, everything
