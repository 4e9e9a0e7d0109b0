"""Figures of families and of orbits. The modules, and with them matplotlib, are loaded when a name is first used."""

from importlib import import_module
from typing import Any

_HOMES = {
    "Atlas": "atlas_data", "Inset": "insets", "atlas_figure": "atlas", "atlas_of": "atlas_data", "branch_figure": "branch",
    "draw_atlas": "atlas", "draw_branch": "branch", "draw_orbit": "orbit", "draw_velocities": "atlas", "orbit_figure": "orbit",
    "parse_inset": "insets", "regime_bounds": "atlas_data", "rescaled": "atlas_data", "velocities_figure": "atlas",
}  # fmt: skip

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
