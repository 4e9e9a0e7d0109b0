"""Pictures of branches and of orbits; matplotlib is loaded only when one is drawn."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.diagram.branch_picture import branch_figure, draw_branch
    from branches.diagram.files import PICTURE_FORMATS, picture_format
    from branches.diagram.orbit_picture import draw_orbit, orbit_figure

__all__ = ["PICTURE_FORMATS", "branch_figure", "draw_branch", "draw_orbit", "orbit_figure", "picture_format"]

_HOMES = {
    "PICTURE_FORMATS": "files",
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
