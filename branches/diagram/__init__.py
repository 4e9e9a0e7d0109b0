"""Pictures of branches and of orbits; matplotlib is loaded only when one is drawn."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.diagram.atlas import atlas_figure, draw_atlas, draw_velocities, velocities_figure
    from branches.diagram.atlas_data import Atlas, atlas_of, regime_bounds, rescaled
    from branches.diagram.branch_picture import branch_figure, draw_branch
    from branches.diagram.files import PICTURE_FORMATS, picture_format
    from branches.diagram.insets import Inset, parse_inset
    from branches.diagram.orbit_picture import draw_orbit, orbit_figure

__all__ = [
    "PICTURE_FORMATS",
    "Atlas",
    "Inset",
    "atlas_figure",
    "atlas_of",
    "branch_figure",
    "draw_atlas",
    "draw_branch",
    "draw_orbit",
    "draw_velocities",
    "orbit_figure",
    "parse_inset",
    "picture_format",
    "regime_bounds",
    "rescaled",
    "velocities_figure",
]

_HOMES = {
    "PICTURE_FORMATS": "files",
    "Atlas": "atlas_data",
    "Inset": "insets",
    "atlas_figure": "atlas",
    "atlas_of": "atlas_data",
    "draw_atlas": "atlas",
    "draw_velocities": "atlas",
    "parse_inset": "insets",
    "regime_bounds": "atlas_data",
    "rescaled": "atlas_data",
    "velocities_figure": "atlas",
    "branch_figure": "branch_picture",
    "draw_branch": "branch_picture",
    "draw_orbit": "orbit_picture",
    "orbit_figure": "orbit_picture",
    "picture_format": "files",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
