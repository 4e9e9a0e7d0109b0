"""The scene that a catalogue belongs to, as plain data, and how two systems differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["SceneRecord", "difference"]


@dataclass(frozen=True)
class SceneRecord:
    """What a catalogue keeps of its scene.

    Attributes
    ----------
    system : dict
        As `bvp.system.ImpactSystem.describe` gives it.
    bounds : dict
        ``energy``, ``quarter_period``, ``impacts``.
    pins : dict of str to dict
        Bare names with the cited ``h`` and ``alpha`` that choose among matches.
    title, source, text : str
        The scene's title and source, and its TOML where it was read from a file.
    """

    system: dict[str, Any]
    bounds: dict[str, Any] = field(default_factory=dict)
    pins: dict[str, dict[str, float]] = field(default_factory=dict)
    title: str = ""
    source: str = ""
    text: str = ""

    @classmethod
    def of(cls, scene: Any) -> SceneRecord:
        """The record of a scene, or of a system alone.

        Parameters
        ----------
        scene : saltus.Scene, bvp.system.ImpactSystem or SceneRecord
        """
        if isinstance(scene, cls):
            return scene
        if hasattr(scene, "describe"):
            return cls(scene.describe())
        bounds = {key: list(value) if isinstance(value, tuple) else value for key, value in scene.bounds.items()}
        pins = {name: dict(point) for name, point in scene.pins.items()}
        return cls(scene.system.describe(), bounds, pins, scene.title, scene.source, getattr(scene, "text", ""))


def difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str | None:
    """How two descriptions of systems differ, in words; None where they do not.

    Examples
    --------
    >>> difference({"model": "vibro_impact_nes", "mu": 0.1}, {"model": "vibro_impact_nes", "mu": 0.2})
    'mu is 0.1, not 0.2'
    >>> difference({"mass": [[1.0]]}, {"mass": [[1.0]]})
    """
    mine, theirs = dict(_leaves(one)), dict(_leaves(other))
    told = []
    for key in dict.fromkeys([*mine, *theirs]):
        if mine.get(key) != theirs.get(key):
            told.append(f"{key} is {_shown(mine.get(key))}, not {_shown(theirs.get(key))}")
    if len(told) > 3:
        told = [*told[:3], f"and {len(told) - 3} more"]
    return ", ".join(told) or None


def _leaves(value: Any, name: str = "") -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [leaf for key, entry in value.items() for leaf in _leaves(entry, f"{name}.{key}" if name else key)]
    if isinstance(value, list | tuple) and any(isinstance(entry, list | tuple | Mapping) for entry in value):
        return [leaf for i, entry in enumerate(value) for leaf in _leaves(entry, f"{name}[{i}]")]
    return [(name, list(value) if isinstance(value, tuple) else value)]


def _shown(value: Any) -> str:
    return "absent" if value is None else f"{value:.15g}" if isinstance(value, float) else str(value)
