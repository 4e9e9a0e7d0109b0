"""Scenes: a system with the bounds inside which its orbits are searched, and the names that its literature uses."""

from saltus.scene.scene import DEFAULT, LOADS, Scene, load_scene

__all__ = ["DEFAULT", "LOADS", "Scene", "load_scene"]
