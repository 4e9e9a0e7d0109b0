"""The options that choose the scene, shared by the commands."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from saltus.arguments import number

if TYPE_CHECKING:
    from saltus.scene import Scene

__all__ = ["add_arguments", "add_parameters", "from_arguments", "parameters"]

_PARAMETERS = {
    "mu": "mass ratio, above 0",
    "sigma": "coupling stiffness, 0 or more",
    "lam": "viscous damping of the oscillator, 0 or more",
    "rho": "restitution, 0 to 1",
}


def add_arguments(parser: argparse.ArgumentParser, uses: tuple[str, ...] = ()) -> None:
    """Add ``--scene``, the parameters of the model, and ``--model``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    uses : tuple of str
        What the command uses of a scene beside its system, of `saltus.scene.LOADS`.
    """
    parser.set_defaults(scene_uses=uses)
    parser.add_argument("--scene", metavar="FILE", help="TOML file of the system and its bounds (default: lee2009)")
    add_parameters(parser)
    parser.add_argument("--model", action="store_true", help="say which model was chosen and why")


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add the parameters of the model."""
    for name, meaning in _PARAMETERS.items():
        parser.add_argument(f"--{name}", metavar="X", type=number, help=f"{meaning}, in place of the scene's")


def from_arguments(arguments: argparse.Namespace) -> Scene:
    """Return the scene asked for.

    Raises
    ------
    BadInput
        Also where the scene has what the command does not use.
    """
    from saltus.scene import load_scene

    scene = load_scene(arguments.scene, **parameters(arguments))
    scene.require_used(f"saltus {arguments.command}", getattr(arguments, "scene_uses", ()))
    return scene


def parameters(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the parameters of the model that were given in place of the scene's."""
    return {name: getattr(arguments, name) for name in _PARAMETERS if getattr(arguments, name, None) is not None}
