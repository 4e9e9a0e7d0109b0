"""With what a catalogue was made."""

from __future__ import annotations

import platform
import sqlite3
from importlib import metadata

__all__ = ["versions"]

LIBRARIES = ("saltus", "numpy", "scipy", "numba", "networkx")


def versions() -> dict[str, str | None]:
    """Versions of Python, SQLite and the libraries; None for one that is not installed as a package."""
    found: dict[str, str | None] = {"python": platform.python_version(), "sqlite": sqlite3.sqlite_version}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found
