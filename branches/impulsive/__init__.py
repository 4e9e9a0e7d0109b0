"""Impulsive motion: everything at rest but the oscillator. Its periodic orbits, and its dominant frequency against energy."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.impulsive.manifold import Manifold, impulsive_manifold
    from branches.impulsive.periodic import ImpulsiveOrbit, ImpulsiveOrbits, impulsive_orbits

__all__ = ["ImpulsiveOrbit", "ImpulsiveOrbits", "Manifold", "impulsive_manifold", "impulsive_orbits"]

_HOMES = {
    "ImpulsiveOrbit": "periodic",
    "ImpulsiveOrbits": "periodic",
    "Manifold": "manifold",
    "impulsive_orbits": "periodic",
    "impulsive_manifold": "manifold",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
