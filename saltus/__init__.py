"""saltus follows families of periodic orbits of mechanical systems that impact, and says which orbits are stable.

>>> import saltus
>>> saltus.vibro_impact_nes(mu=0.1, sigma=0.1).degrees_of_freedom
2

Names are imported when they are first asked for, so that ``import saltus`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.catalogue import Catalogue
    from branches.orbit import Orbit
    from branches.reading import read_branch
    from branches.search.discovery import Discovery
    from bvp.damped import Mover, run
    from bvp.forcing import Constant, Harmonic, Record, ground_load
    from bvp.system import ImpactSystem, Stop, vibro_impact_nes
    from saltus.families import discover, trace
    from saltus.scene import Scene, load_scene
    from transitions.section.section import Section, section
    from transitions.study.study import Study

__all__ = [
    "Branch",
    "Catalogue",
    "Constant",
    "Discovery",
    "Harmonic",
    "ImpactSystem",
    "Mover",
    "Orbit",
    "Record",
    "Scene",
    "Section",
    "Stop",
    "Study",
    "discover",
    "ground_load",
    "load_scene",
    "read_branch",
    "run",
    "section",
    "trace",
    "vibro_impact_nes",
]

__version__ = "0.1.0"

_HOME = {
    "Branch": "branches.branch",
    "Catalogue": "branches.catalogue.catalogue",
    "Constant": "bvp.forcing",
    "Discovery": "branches.search.discovery",
    "Harmonic": "bvp.forcing",
    "ImpactSystem": "bvp.system",
    "Mover": "bvp.damped",
    "Orbit": "branches.orbit",
    "Record": "bvp.forcing",
    "Scene": "saltus.scene",
    "Section": "transitions.section.section",
    "Stop": "bvp.system",
    "Study": "transitions.study.study",
    "discover": "saltus.families",
    "ground_load": "bvp.forcing",
    "load_scene": "saltus.scene",
    "read_branch": "branches.reading",
    "run": "bvp.damped",
    "section": "transitions.section.section",
    "trace": "saltus.families",
    "vibro_impact_nes": "bvp.system",
}

_BRANCHES = ("Branch", "Catalogue", "discover", "read_branch", "trace")
"""Public names that give branches: their methods `switch`, `neighbours`, `trace` and `save` come with them."""


def __getattr__(name: str) -> Any:
    """Import a public name from where it lives, and keep it."""
    if name not in _HOME:
        raise AttributeError(f"module 'saltus' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    if name in _BRANCHES:
        importlib.import_module("branches.methods")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
