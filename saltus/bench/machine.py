"""What the figures were measured on."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

from saltus import __version__

__all__ = ["describe"]


def describe() -> list[str]:
    """Lines that name the processor, its load, and the versions that count."""
    load = ", ".join(f"{x:.2f}" for x in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown"
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return [
        f"Machine: {_processor()}, {os.cpu_count()} cores; {platform.system()} {platform.machine()}.",
        f"Load averages at the start: {load} (1, 5 and 15 minutes); figures of a loaded machine are too long.",
        f"saltus {__version__}, Python {platform.python_version()} ({sys.implementation.name}), {packages}.",
    ]


def _processor() -> str:
    """The processor's name as the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"
