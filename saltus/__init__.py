"""saltus follows families of periodic orbits of mechanical systems with impacts, and reports their stability.

>>> import saltus
>>> saltus.vibro_impact_nes(mu=0.1, sigma=0.1).degrees_of_freedom
2

A name is imported when it is first used. So ``import saltus`` is fast.
"""

from __future__ import annotations

import functools
import importlib
import re
from pathlib import Path
from typing import Any

from bvp.kernels import hook

__version__ = "0.1.0"


def _compile_together(module: str, name: str, types: Any) -> None:
    """Compile a kernel with all others that the same command calls."""
    from saltus.compiling import prepare_with

    prepare_with(module, name, types)


hook.before_compiling = _compile_together

_WITHOUT_METHODS = ("bvp.system", "bvp.springs", "bvp.forcing", "saltus.scene", "saltus.__main__")
"""Modules whose names lead to no object of `_add_methods`."""

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")

_MODULES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _STUB, re.MULTILINE)}
"""The module of each public name: the stub has the only list of them."""

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name from its module, and keep it."""
    if name not in _MODULES:
        raise AttributeError(f"module 'saltus' has no attribute {name!r}")
    try:
        value = getattr(importlib.import_module(_MODULES[name]), name)
    except ImportError as error:
        from saltus.errors import core_fault

        fault = core_fault(error)
        if not fault:
            raise
        raise ImportError(fault, name=error.name) from error
    if not _MODULES[name].startswith(_WITHOUT_METHODS):
        _add_methods()
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__


@functools.cache
def _add_methods() -> None:
    """Give `Branch`, `Orbit`, `Motion` and `Catalogue` their methods. They are data and import no operation."""
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.figures.atlas import plot_catalogue
    from branches.figures.single import plot_branch, plot_motion, plot_orbit
    from branches.grazing.following import neighbours
    from branches.orbit import Orbit
    from branches.record import save, to_dataframe
    from branches.switching import switch
    from branches.tracing import extend
    from bvp.motion import Motion

    Branch.save = save
    Branch.trace = extend
    Branch.switch = switch
    Branch.neighbours = neighbours
    Branch.plot = plot_branch
    Branch.to_dataframe = to_dataframe
    Orbit.plot = plot_orbit
    Motion.plot = plot_motion
    Catalogue.plot = plot_catalogue
