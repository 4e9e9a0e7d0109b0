"""Data of pictures as files - CSV, JSON, NPZ, MAT - and back; each picture can be drawn again from its data."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.export.atlas import DATA_FORMATS, ExportError, data_format, read_atlas, write_atlas

__all__ = ["DATA_FORMATS", "ExportError", "data_format", "read_atlas", "write_atlas"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("branches.export.atlas"), name)
