"""The catalogue that a command uses: its option, opening it, saving in it, and its rows as plain data for JSON."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branches.files import reason
from saltus import __version__, options
from saltus.errors import BadInput, say
from saltus.outputs import check_writable

if TYPE_CHECKING:
    import numpy as np

    from branches.branch import Branch
    from branches.catalogue import Catalogue, Edge, FamilyRow, Node
    from branches.catalogue.rows import SceneRecord
    from branches.events import BranchEvent
    from branches.forced.branch import ForcedBranch
    from saltus.scene import Scene

__all__ = [
    "SCHEMA",
    "add_arguments",
    "default_path",
    "filters_for",
    "edge_record",
    "event_record",
    "family_record",
    "given",
    "impacts_text",
    "in_axes",
    "keep_branch",
    "lookup",
    "named",
    "node_record",
    "open_catalogue",
    "place_to_save",
    "printed_event",
    "range_line",
    "require_energies",
    "same_meeting",
    "save_branch",
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--catalogue``, ``--scene``, and the parameters of the model: a catalogue belongs to one system."""
    parser.add_argument("--catalogue", metavar="FILE", help="the catalogue (default: that of the scene in the user's data folder)")
    # Responses have loads; of families in the energy they are refused when the catalogue is opened.
    options.add_scene(parser, ("ground", "forces", "springs"), model=False)


def default_path(scene: str | None = None, parameters: dict[str, float] | None = None) -> Path:
    """The default catalogue of a scene, in the user's data folder. A system with other parameters than the scene's has one of its own.

    Examples
    --------
    >>> default_path("scenes/two-masses.toml", {"mu": 0.2}).name
    'two-masses-mu0.2.sqlite'
    """
    from platformdirs import user_data_path

    from saltus.scene import DEFAULT

    stem = DEFAULT if scene is None else Path(scene).name.removesuffix(".toml")
    changed = "".join(f"-{name}{value!r}" for name, value in sorted((parameters or {}).items()))
    return user_data_path("saltus", appauthor=False) / f"{stem}{changed}.sqlite"


def open_catalogue(arguments: argparse.Namespace) -> Catalogue:
    """Open the catalogue of the command line for reading. Raises `BadInput` if there is none, and `CatalogueError` if the file is not a
    catalogue or belongs to another system."""
    from branches.catalogue import Catalogue

    parameters = options.parameters_of(arguments)
    scene = options.scene_of(arguments).about_rest if arguments.scene is not None or parameters else None
    if scene is not None and not scene.loads:
        from bvp.checks import require_system

        require_system(scene.system, conservative="families of periodic orbits", smooth=True)
    path = arguments.catalogue or default_path(arguments.scene, parameters)
    if arguments.catalogue is None and not path.exists():
        raise BadInput(
            f"there is no catalogue {path}; expected --catalogue FILE, or one made by saltus build or saltus continue NAME --save"
        )
    catalogue = Catalogue(path)
    try:
        if scene is not None and catalogue.scene.parameters:
            catalogue.require_system(scene.in_parameters.describe())
        elif scene is not None:
            scene.require_used(f"saltus {arguments.command}", ("springs",))
            catalogue.require_system(scene.system.describe())
    except BaseException:
        catalogue.close()
        raise
    return catalogue


def require_energies(catalogue: Catalogue, what: str) -> None:
    """Refuse a catalogue of forced responses for what only families in the energy have."""
    if catalogue.scene.parameters:
        raise BadInput(f"{what} needs families in the energy, and {catalogue.path} holds {catalogue.scene.held}")


def filters_for(catalogue: Catalogue, arguments: argparse.Namespace) -> dict[str, Any]:
    """The filters of the command line. Responses have neither a label nor an energy."""
    filters = options.filters_of(arguments)
    for name in ("label", "energy"):
        if name in filters:
            require_energies(catalogue, f"--{name}")
    return filters


def in_axes(catalogue: Catalogue, record: Any) -> Any:
    """Plain data about families with the keys of their axes: of those in a parameter ``parameter`` and ``period`` in place of ``h`` and
    ``alpha``, and without labels; of responses ``closure`` in place of ``ends``."""
    if not catalogue.scene.parameters:
        return record
    first, second = catalogue.scene.axes.keys
    keys = {"h": first, "alpha": second} | ({} if catalogue.scene.is_free else {"ends": "closure"})
    if isinstance(record, dict):
        return {keys.get(key, key): in_axes(catalogue, value) for key, value in record.items() if key not in _OF_ENERGY}
    return [in_axes(catalogue, value) for value in record] if isinstance(record, list) else record


_OF_ENERGY = ("label", "labels", "p_q", "breaks")
"""Keys of data that families in a parameter do not have."""


def given(arguments: argparse.Namespace, scene: Scene) -> AbstractContextManager[Catalogue | None]:
    """The catalogue that is given, to read; None where none is."""
    from branches.catalogue import Catalogue

    return nullcontext() if arguments.catalogue is None else Catalogue(arguments.catalogue, scene=scene)


def lookup(name: str, arguments: argparse.Namespace, scene: Scene) -> AbstractContextManager[Catalogue | None]:
    """The catalogue for looking up a name; None if there is none. It is the catalogue given for reading. Without one, an id is looked up in
    the catalogue to save in, then in the scene's own."""
    if arguments.catalogue is not None and not getattr(arguments, "save", False):
        return given(arguments, scene)
    id = name.partition("@")[0]
    for catalogue in _with_ids(arguments, scene) if ":" in id else ():
        if id in catalogue:
            return catalogue
        catalogue.close()
    return nullcontext()


def named(text: str, arguments: argparse.Namespace, scene: Scene) -> str:
    """Replace a shortened id by the full id of a catalogue; return any other name unchanged. A shortened id is the beginning of the id or
    of its hash, or the id as a table shortens it. `lookup` describes which catalogues are searched."""
    from branches.naming.labels import LabelSyntaxError, parse_name
    from branches.naming.matching import NameNotFound

    id, at, suffix = text.partition("@")
    try:
        parse_name(text)
        return text
    except LabelSyntaxError:
        from branches.catalogue.find import is_part_of_id

        if not is_part_of_id(id):
            raise
    unknown: ValueError = BadInput(f"{id} is a part of an id, and no catalogue is there to look it up: expected --catalogue FILE")
    for catalogue in _with_ids(arguments, scene):
        with catalogue:
            try:
                return catalogue.find(id).id + at + suffix
            except NameNotFound as error:
                unknown = error
    raise unknown


def _with_ids(arguments: argparse.Namespace, scene: Scene) -> Iterator[Catalogue]:
    """The catalogues for looking up an id: the one given for reading, else the one to save in and the scene's own, if they exist."""
    from branches.catalogue import Catalogue

    if arguments.catalogue is not None and not getattr(arguments, "save", False):
        yield Catalogue(arguments.catalogue, scene=scene)
        return
    # Damping and restitution change no family: a damped run uses the families of the system without them.
    changed = {key: value for key, value in options.parameters_of(arguments).items() if key not in ("lam", "rho")}
    for place in (arguments.catalogue, default_path(arguments.scene, changed)):
        if place is not None and Path(place).exists():
            yield Catalogue(place, scene=scene)


def place_to_save(arguments: argparse.Namespace, scene: Scene | SceneRecord, names: Sequence[str] = ()) -> Path:
    """The catalogue to save in. A place where that is not possible is refused before the work starts. `names`: parameters whose values do
    not make another catalogue."""
    changed = {name: value for name, value in options.parameters_of(arguments).items() if name not in names}
    place = Path(arguments.catalogue or default_path(arguments.scene, changed))
    if arguments.catalogue is None:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(f"cannot make the directory {place.parent}: {reason(error)}") from error
    check_writable(str(place), database=True)
    if place.is_file() and not place.stat().st_size:  # as a run that was killed at its start leaves it
        say(f"{place} is empty: a new catalogue is written in its place")
    if place.exists():
        from branches.catalogue import Catalogue

        Catalogue(place, "a", scene=scene).close()
    return place


def save_branch(branch: Branch, place: Path, scene: Scene) -> str:
    """Keep a branch in a catalogue, which is made if there is none; as `keep_branch`."""
    from branches.catalogue import Catalogue

    with Catalogue(place, "a", scene=scene, provenance={"saltus": __version__}) as catalogue:
        return keep_branch(catalogue, place, branch, "h", branch.points["h"])


def keep_branch(catalogue: Catalogue, place: Path, branch: Branch | ForcedBranch, name: str, values: np.ndarray) -> str:
    """Keep a branch over the values of a parameter, or of the energy, with a name; return a line about the result. `CannotWiden` if the
    family stays kept over another range."""
    from branches.catalogue.widening import CannotWiden, Kept

    def kept_range() -> str:
        return range_line(name, *catalogue.family(branch.id).h)

    before = kept_range() if branch.id in catalogue else ""
    try:
        kept = catalogue.widen(branch)
    except CannotWiden as error:
        wanted = range_line(name, values.min(), values.max())
        raise CannotWiden(f"{branch.id} stays kept in {place} with {before}, and not with {wanted}: {error}") from error
    if kept is Kept.WIDER:
        return f"wider  {branch.id} in {place}, now with {kept_range()}; before with {before}"
    return f"{'known' if kept is Kept.KNOWN else 'saved'}  {branch.id} in {place}, with {kept_range()}"


def range_line(name: str, low: float, high: float) -> str:
    """The range of a parameter, to ten digits."""
    return f"{name} = {low:.10g}:{high:.10g}"


SCHEMA = 2
"""Of the records of families. Schema 1 has `word` in place of `sequence`."""


def family_record(catalogue: Catalogue, row: FamilyRow) -> dict[str, Any]:
    """A family without its points; its labels as they are printed."""
    from branches.naming.matching import spelled

    cited = list(catalogue.scene.reference_points)
    names = ("id", "label", "ends", "sequence", "impacts", "h", "alpha", "points", "events", "stable_fraction")
    plain = {name: getattr(row, name) for name in names}
    return plain | {
        "label": spelled(row.label, cited),
        "h": list(row.h),
        "alpha": list(row.alpha),
        "labels": [_interval("label", spelled(part.value, cited), part) for part in row.labels],
        "stability": [_interval("stable", None if part.value < 0 else bool(part.value), part) for part in row.stability],
        "ended": [{"reason": reason, "text": text} for reason, text in row.ended],
    }


def _interval(name: str, value: Any, part: Any) -> dict[str, Any]:
    return {name: value, "arclength": list(part.arclength), "h": list(part.h), "alpha": list(part.alpha)}


def printed_event(catalogue: Catalogue, event: BranchEvent) -> BranchEvent:
    """An event with the labels as they are printed, also where its note says that one becomes another."""
    from branches.naming.matching import spelled

    cited = list(catalogue.scene.reference_points)
    note = _CHANGED.sub(lambda found: spelled(found[0], cited), event.note) if event.note else event.note
    return event._replace(label=spelled(event.label, cited), note=note)


_LABEL = r"[SU][\d(][\dEO()]*[+-]?"
_CHANGED = re.compile(rf"\b{_LABEL}(?= becomes )|(?<= becomes ){_LABEL}")
"""Both labels of a note such as "U3502+ becomes U4502-"."""


def event_record(event: BranchEvent) -> dict[str, Any]:
    """An event with the fields that a branch's file has."""
    low, high, residual = (value if math.isfinite(value) else None for value in (*event.bracket, event.residual))
    return {**event._asdict(), "bracket": [low, high], "residual": residual}


def edge_record(edge: Edge) -> dict[str, Any]:
    """An edge without its orbits."""
    names = ("source", "source_event", "type", "kind", "target", "target_event", "h", "alpha", "stop", "note")
    return {name: getattr(edge, name) for name in names}


def same_meeting(one: Edge, other: Edge) -> bool:
    """Whether two edges describe the same event, each seen from one of the two families that meet there.

    Examples
    --------
    >>> from branches.catalogue import Edge
    >>> here, there = Edge("A", "GR1", "GR", "fold", "B", 1.0, 1.7), Edge("B", "GR2", "GR", "fold", "A", 1.0, 1.7, "GR1")
    >>> same_meeting(here, there), same_meeting(here, Edge("B", "GR2", "GR", "fold", "A", 1.0, 1.7, "GR3")), same_meeting(here, here)
    (True, False, False)
    """
    sides = (one.source_event, other.target_event), (one.target_event, other.source_event)
    return (
        (one.source, one.target, one.kind) == (other.target, other.source, other.kind)
        and abs(one.h / other.h - 1.0) < 1e-6
        and all(a == b or not (a and b) for a, b in sides)
    )


def node_record(catalogue: Catalogue, id: str) -> dict[str, Any]:
    """A node of the graph in a few words: a family by its label and energies, another node by what it is."""
    from branches.naming.matching import spelled

    if id in catalogue:
        row = catalogue.family(id)
        return {"id": id, "kind": "family", "label": spelled(row.label, catalogue.scene.reference_points), "h": list(row.h)}
    node: Node | None = next((node for node in catalogue.nodes if node.id == id), None)
    if node is None:
        return {"id": id, "kind": "missing", "label": "", "h": None}
    record = {"id": id, "kind": node.kind, "label": node.label, "h": None if node.h is None else list(node.h)}
    return {**record, "note": node.note} if node.note else record


def impacts_text(impacts: float) -> str:
    """Impacts in half a period, which are half a number where a period has an odd one.

    Examples
    --------
    >>> impacts_text(1.0), impacts_text(2.5)
    ('1 impact in half a period', '2.5 impacts in half a period')
    """
    return f"{impacts:g} impact{'' if impacts == 1 else 's'} in half a period"
