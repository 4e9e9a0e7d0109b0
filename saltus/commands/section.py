"""`saltus section --energy H`: the Poincare section of many motions of one energy; `--panels`: of several energies."""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from typing import TYPE_CHECKING

from saltus import catalogues, compiling, options, outputs
from saltus.errors import INTERRUPTED, BadInput, say
from saltus.options import ValueType, energy_range, finite, positive, whole_above_zero
from saltus.terminal import ProgressBar

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from saltus.scene import Scene
    from transitions.section.plane import SectionPlane
    from transitions.section.section import Section
    from transitions.section.view import OrbitMark, SectionView

PANELS = 8
"""Sections of panels that are given as a range of energies."""

MOST_PANELS = 26

_energies = ValueType(
    lambda text: energy_range(text) if ":" in text else [positive(part) for part in text.split(",")],
    lambda energies: list(energies) == sorted(set(energies)),
    "an energy above 0, LO:HI, or rising energies H1,H2,...",
)
_place = ValueType(
    lambda text: tuple(finite(part) for part in text.split(",")), lambda place: len(place) == 2, "finite numbers X,Y"
)
HEADER = f"{'energy h':>11} {'orbits':>7} {'points':>9} {'impacts':>10} {'energy drift':>12} {'lyapunov':>9} {'seconds':>8} {'points/s':>9}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument(
        "--energy", metavar="H", type=_energies, help="the energy h; with --panels also LO:HI, or H1,H2,... in rising order"
    )
    parser.add_argument("--panels", action="store_true", help="one figure with a section for each energy of the scene, or of --energy")
    parser.add_argument(
        "--orbits", metavar="N", type=whole_above_zero, default=150, help="number of motions, spread over the section (default: 150)"
    )
    parser.add_argument(
        "--crossings", metavar="K", type=whole_above_zero, default=400, help="number of points of each motion (default: 400)"
    )
    parser.add_argument(
        "--start",
        metavar="X,Y",
        type=_place,
        action="append",
        help="start here in the plane, instead of a spread of starts; can be repeated",
    )
    parser.add_argument(
        "--longest", metavar="T", type=positive, help="end a motion after this time (default: 50 periods for each crossing)"
    )
    parser.add_argument(
        "--colour",
        metavar="WHAT",
        choices=("none", "energy", "lyapunov", "rotation"),
        help="colour motions by their largest Lyapunov exponent (lyapunov), by their rotation number about an elliptic fixed point "
        "of the section (rotation), or, of a system that loses energy, by their energy (energy, which is the default there)",
    )
    parser.add_argument("--about", metavar="X,Y", type=_place, help="rotation numbers about the fixed point nearest to here only")
    parser.add_argument(
        "--catalogue", metavar="FILE", help="mark the periodic orbits that the families of this catalogue have at the energy"
    )
    parser.add_argument("--names", metavar="N", type=whole_above_zero, help="name at most N periodic orbits")
    outputs.add_arguments(parser, "json", "csv", "npz", "mat", "plot")
    options.add_scene(parser, ("springs",))


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    if arguments.names is not None and (arguments.plot is None or arguments.catalogue is None):
        raise BadInput("--names needs --plot FILE and --catalogue FILE: it counts the orbits that are named in the figure")
    scene = options.scene_of(arguments)
    energies = _asked(arguments, scene)

    from transitions.section.plane import SectionPlane
    from transitions.section.section import follow_crossings

    planes = [SectionPlane(scene.system, energy) for energy in energies]
    why = scene.system.why_not_conservative()
    if arguments.colour is None:
        arguments.colour = "none" if why is None else "energy"
    elif arguments.colour == "energy" and why is None:
        raise BadInput("--colour energy: the system keeps its energy, which is that of the section; expected none, lyapunov or rotation")
    if arguments.about is not None and (arguments.colour != "rotation" or arguments.panels):
        raise BadInput("--about chooses the fixed point of rotation numbers; expected it with --colour rotation, and without --panels")
    if arguments.colour == "rotation" and why is not None:
        raise BadInput(f"a rotation number belongs to motion that keeps its energy, and {why}; expected --colour lyapunov or none")
    for start in arguments.start or ():
        for plane in planes:
            plane.states([start])
    options.report_model(arguments, files, "explain_section", scene.system)
    with catalogues.given(arguments, scene) as catalogue:
        # The kernels are compiled before time is measured.
        compiling.prepare_for(scene.system, "section")
        follow_crossings(planes[0], planes[0].starts(1), 2)
        files.report([*options.rest_lines(scene), HEADER])
        views: list[SectionView] = []
        interrupted = False
        for plane in planes:
            view, seconds = _view(plane, arguments, catalogue)
            views.append(view)
            files.report([_row(view.section, seconds), *_remarks(view, why)])
            interrupted = view.section.interrupted
            if interrupted:
                say("interrupted; what was followed until now is written")
                break
    caption = _caption(scene, energies) if arguments.panels else ""
    if caption:
        files.report([f"note   {caption}"])

    named = {} if arguments.names is None else {"names": arguments.names}
    figure = "transitions.section.figure:section_figure", views, {"colour": arguments.colour, "caption": caption, **named}

    from branches.tables import csv_text
    from transitions.section.view import SCHEMA, view_record, views_table

    names, plane = scene.system.coordinates, planes[0]
    axes = {"zero": names[plane.primary], "x": names[plane.other], "y": "momentum over mass" if plane.momentum else "velocity"}
    record = {"schema": SCHEMA, "system": scene.system.describe(), "plane": axes}
    about = json.dumps({"schema": 1, "content": "section", "system": scene.system.describe()}, allow_nan=False)
    texts = {
        "json": lambda: outputs.json_text({**record, "sections": [view_record(view) for view in views]}),
        "csv": lambda: csv_text(views_table(views), codes=True),
    }
    code = files.write(texts, table=lambda: views_table(views), about=lambda: about, cells=False, figure=figure)
    return INTERRUPTED if interrupted else code


def _asked(arguments: argparse.Namespace, scene: Scene) -> list[float]:
    """The energies of the sections."""
    given = arguments.energy
    if not arguments.panels:
        if given is None:
            raise BadInput("--energy H or --panels is required")
        if len(given) != 1:
            raise BadInput("--energy gives several energies; expected one, or --panels for a section of each")
        return list(given)
    if given is None:
        if not scene.sections:
            raise BadInput("the scene gives no [sections] energies for panels; expected --energy LO:HI or H1,H2,... with --panels")
        return list(scene.sections)
    if isinstance(given, tuple):
        low, high = given
        return [low * (high / low) ** (k / (PANELS - 1)) for k in range(PANELS)]
    if len(given) > MOST_PANELS:
        raise BadInput(f"--energy gives {len(given)} energies; expected {MOST_PANELS} at most")
    return list(given)


def _caption(scene: Scene, energies: list[float]) -> str:
    """The texts of the panels about their energies."""
    cited = [energy for energy in energies if energy in scene.cited_sections]
    if not cited:
        return "the energies are our choice"
    listed = " and ".join(f"{energy:g}" for energy in cited)
    return f"h = {listed} as in {scene.source}; the other energies are our choice"


def _view(plane: SectionPlane, arguments: argparse.Namespace, catalogue: Catalogue | None) -> tuple[SectionView, float]:
    """One section with what was asked to be seen on it, and the seconds that its motions took."""
    from transitions.section.section import section
    from transitions.section.view import SectionView

    with ProgressBar(len(arguments.start or ()) or arguments.orbits, "orbits") as bar:
        begun = time.perf_counter()
        found = section(
            plane.system,
            plane.energy,
            orbits=arguments.orbits,
            crossings=arguments.crossings,
            starts=arguments.start,
            longest=arguments.longest,
            on_orbits=bar.update,
        )
        seconds = time.perf_counter() - begun
    marks: tuple[OrbitMark, ...] = ()
    if catalogue is not None:
        from transitions.section.view import catalogue_marks

        marks = tuple(catalogue_marks(plane, catalogue))
    turning = None
    if arguments.colour == "rotation":
        from transitions.section.rotation import about_point, rotations

        turning = rotations(found, None if arguments.about is None else [about_point(found, arguments.about)])
    return SectionView(found, marks, turning), seconds


def _row(section: Section, seconds: float) -> str:
    exponents = section.exponents[section.exponents == section.exponents]
    largest = f"{exponents.max():.4g}" if len(exponents) else "-"
    return (
        f"{section.plane.energy:>11.6g} {len(section.counts):>7} {len(section):>9} {int(section.impacts.sum()):>10} "
        f"{section.drift:>12.2g} {largest:>9} {seconds:>8.3f} {len(section) / max(seconds, 1e-9):>9.0f}"
    )


def _remarks(view: SectionView, why: str | None) -> list[str]:
    """Lines printed below the table: facts that the table does not show."""
    from transitions.section.section import SectionEnd

    section = view.section
    lines = []
    if why is not None:
        least = float(section.energies[section.energies == section.energies].min())
        lines.append(f"note   {why}: the section is that of motions and not of an energy surface; their energies fall to {least:.6g}")
    for end, count in Counter(section.ends).items():
        if end is not SectionEnd.COMPLETE:
            lines.append(f"ended  {count} of {len(section.counts)} orbits: {end.value}")
    stuck = int((section.sticking_times > 0.0).sum())
    if stuck:
        lines.append(
            f"sticks {stuck} of {len(section.counts)} orbits, for a time of {section.sticking_times.sum():.6g} in all: their points go on, "
            "but the plane maps to a curve there, so that they have no Lyapunov exponent"
        )
    if view.marks:
        kinds = Counter(mark.kind for mark in view.marks)
        counts = ", ".join(f"{kinds[kind]} {kind}" for kind in ("elliptic", "hyperbolic", "undecided") if kinds[kind])
        lines.append(f"found  {len(view.marks)} periodic orbits ({counts}), {sum(len(mark.points) for mark in view.marks)} points")
    if view.rotations is not None:
        for k, centre in enumerate(view.rotations.centres):
            numbers = view.rotations.numbers[view.rotations.about == k]
            numbers = numbers[numbers == numbers]
            found = f"{len(numbers)} orbits"
            if len(numbers):
                found += f" at {numbers.min():.6g} to {numbers.max():.6g} rotations a crossing"
            lines.append(f"about  {centre.place}, elliptic, period {centre.period:.6g}: {found}")
        count = int((view.rotations.numbers != view.rotations.numbers).sum())
        lines.append(f"about  none: {count} orbits, chaotic or round no elliptic fixed point")
    return lines
