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
    from branches.catalogue.store import Catalogue
    from branches.discovery.search import Discovery
    from branches.orbit import Orbit
    from branches.record import read_branch
    from bvp.damped import Mover
    from bvp.forcing import Constant, Harmonic, Record, ground_load
    from bvp.run import run
    from bvp.system import ImpactSystem, Stop, vibro_impact_nes
    from saltus.discovery import discover
    from saltus.scene import Scene, load_scene
    from saltus.tracing import trace
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
    "Stop",
    "Study",
    "discover",
    "ground_load",
    "load_scene",
    "read_branch",
    "run",
    "trace",
    "vibro_impact_nes",
]

__version__ = "0.1.0"

_HOME = {
    "Branch": "branches.branch",
    "Catalogue": "branches.catalogue.store",
    "Constant": "bvp.forcing",
    "Discovery": "branches.discovery.search",
    "Harmonic": "bvp.forcing",
    "ImpactSystem": "bvp.system",
    "Mover": "bvp.damped",
    "Orbit": "branches.orbit",
    "Record": "bvp.forcing",
    "Scene": "saltus.scene",
    "Stop": "bvp.system",
    "Study": "transitions.study.study",
    "discover": "saltus.discovery",
    "ground_load": "bvp.forcing",
    "load_scene": "saltus.scene",
    "read_branch": "branches.record",
    "run": "bvp.run",
    "trace": "saltus.tracing",
    "vibro_impact_nes": "bvp.system",
}


def __getattr__(name: str) -> Any:
    """Import a public name from where it lives, and keep it."""
    if name not in _HOME:
        raise AttributeError(f"module 'saltus' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
