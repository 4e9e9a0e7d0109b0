"""The options that choose a catalogue, shared by the commands that read one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus.errors import BadInput

if TYPE_CHECKING:
    from branches.catalogue import Catalogue

__all__ = ["add_arguments", "add_json", "default_path", "from_arguments"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--catalogue`` and ``--scene``."""
    parser.add_argument("--catalogue", metavar="FILE", help="the catalogue (default: that of the scene in the user's data folder)")
    parser.add_argument("--scene", metavar="FILE", help="TOML file of the scene that the catalogue belongs to (default: lee2009)")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", metavar="FILE", help="write all data as JSON; - is standard output, which then carries nothing else")


def default_path(scene: str | None = None, parameters: dict[str, float] | None = None) -> Path:
    """Where the catalogue of a scene is kept when no file is named: in the user's data folder.

    Parameters
    ----------
    scene : str, optional
        Path or bare name of the scene.
    parameters : dict, optional
        Values given in place of the scene's: their system has a catalogue of its own.

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


def from_arguments(arguments: argparse.Namespace) -> Catalogue:
    """Open the catalogue asked for, to read.

    Raises
    ------
    BadInput
        Where there is none.
    CatalogueError
        For a file that is none, or that belongs to another system than the scene that is named.
    """
    from branches.catalogue import Catalogue

    path = default_path(arguments.scene) if arguments.catalogue is None else Path(arguments.catalogue)
    scene: Any = None
    if arguments.scene is not None:
        from saltus.scene import load_scene

        scene = load_scene(arguments.scene)
    if arguments.catalogue is None and not path.exists():
        raise BadInput(f"there is no catalogue {path}; expected --catalogue FILE, or one made by saltus continue NAME --save")
    return Catalogue(path, scene=scene)
