"""Impacting systems: exact free flight, next impact by bound, restitution, event-driven runs, orbits, the multipoint problem.

Names are imported when first asked for, so `import bvp` costs nothing.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bvp.damped import Mover
    from bvp.forcing import Constant, Harmonic, Record, ground_load
    from bvp.impact import NextImpact, next_impact, restitute
    from bvp.modes import Modes
    from bvp.motion import Batch, Motion, MotionStatus
    from bvp.stop_events import StopEvents
    from bvp.system import ImpactSystem, InvalidSystem, Stop, vibro_impact_nes

__all__ = [
    "Batch",
    "Constant",
    "Harmonic",
    "ImpactSystem",
    "InvalidSystem",
    "Modes",
    "Motion",
    "MotionStatus",
    "Mover",
    "NextImpact",
    "Record",
    "Stop",
    "StopEvents",
    "ground_load",
    "next_impact",
    "restitute",
    "vibro_impact_nes",
]

_HOME = {
    "Batch": "motion",
    "Constant": "forcing",
    "Harmonic": "forcing",
    "ImpactSystem": "system",
    "InvalidSystem": "system",
    "Modes": "modes",
    "Motion": "motion",
    "MotionStatus": "motion",
    "Mover": "damped",
    "NextImpact": "impact",
    "Record": "forcing",
    "Stop": "system",
    "StopEvents": "stop_events",
    "ground_load": "forcing",
    "next_impact": "impact",
    "restitute": "impact",
    "vibro_impact_nes": "system",
}


def __getattr__(name: str) -> Any:
    """Import the module that a public name lives in."""
    if name not in _HOME:
        raise AttributeError(f"module 'bvp' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"bvp.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
