"""Descriptions of systems and loads as plain data, in which texts are expressions of parameters: their parts, names and order."""

from __future__ import annotations

import ast
import keyword
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.expressions import FUNCTIONS, is_plain
from bvp.forcing import Constant, Force, Harmonic, Record, ground_load
from bvp.system import MODELS, ImpactSystem
from bvp.texts import shown

__all__ = [
    "BASE", "FORCE", "RESERVED", "force_from", "leaves", "mapped", "names_in", "ordered_by_dependence", "own_parameters", "require_name",
]

BASE = "w"
"""The parameter of which ``harmonic`` gives the multiple. If the loads have one frequency, a number, it is this parameter."""

RESERVED = ("energy", "quarter_period")
"""Parameters of every conservative family, which no scene defines."""

FORCE = ("load", "ground", "amplitude", "phase", "frequency", "harmonic", "constant", "cosine", "sine", "times", "values", "scale")
"""Keys of a load."""

_PLAIN = ("model", "names", "name", "c", "coordinates", "times", "values", "harmonic")
"""Keys of a description whose content has no expressions."""


def own_parameters(system: dict[str, Any], forces: list[dict[str, Any]], table: Mapping[str, Any]) -> dict[str, float]:
    """The values of parameters of themselves: those of the model, and the one frequency of the loads. Their names replace their numbers."""
    found: dict[str, float] = {}
    if system.get("model") in MODELS:
        defaults = MODELS[system["model"]].make().parameters or {}
        for name in MODELS[system["model"]].domains:
            value = system.get(name, defaults[name])
            if name in table:
                raise InvalidSystem(f"{name} is a parameter of the model {system['model']} itself; expected another name")
            if not isinstance(value, str):
                found[name] = value
                system[name] = name
    frequencies = {force["frequency"] for force in forces if "frequency" in force}
    if len(frequencies) == 1 and not isinstance(number := next(iter(frequencies)), str) and BASE not in table:
        found[BASE] = float(number)
        for force in forces:
            if "frequency" in force:
                force["frequency"] = BASE
    return found


def force_from(load: Mapping[str, Any], system: ImpactSystem) -> Force:
    """A load from numbers."""
    if "cosine" in load:
        return Harmonic(load["frequency"], load["cosine"], load["sine"])
    row = ground_load(system, load["ground"]) if "ground" in load else np.array(load["load"], dtype=float)
    if "times" in load:
        return Record((load.get("scale", 1.0) * row).tolist(), load["times"], load["values"])
    if "constant" in load:
        return Constant((load["constant"] * row).tolist())
    amplitude, phase = load["amplitude"], load.get("phase", 0.0)
    cosine, sine = amplitude * math.cos(phase) * row, -amplitude * math.sin(phase) * row
    return Harmonic(load["frequency"], cosine.tolist(), sine.tolist())


def leaves(node: Any, where: str) -> Iterator[tuple[str, str]]:
    """The expressions in a description, each with its place in words."""
    if isinstance(node, str):
        yield node, where
    elif isinstance(node, Mapping):
        for key, inner in node.items():
            if key not in _PLAIN:
                yield from leaves(inner, key if where == "the system" else f"{key} of {where}")
    elif isinstance(node, Sequence):
        for k, inner in enumerate(node, 1):
            if isinstance(inner, Mapping):
                yield from leaves(inner, f"{where.removesuffix('s')} {k}")
            else:
                yield from leaves(inner, f"{'entry' if isinstance(inner, str) else 'row'} {k} of {where}")


def mapped(node: Any, function: Callable[[str], Any]) -> Any:
    """A description with values in place of its expressions."""
    if isinstance(node, str):
        return function(node)
    if isinstance(node, Mapping):
        return {key: inner if key in _PLAIN else mapped(inner, function) for key, inner in node.items()}
    if isinstance(node, Sequence):
        return [mapped(inner, function) for inner in node]
    return node


def require_name(name: str) -> None:
    """Refuse the name of a parameter that expressions or commands take for something else."""
    if name in RESERVED:
        raise InvalidSystem(f"parameter {name} would hide the {name.replace('_', ' ')} of an orbit; expected another name")
    if name in FUNCTIONS or name == "pi":
        raise InvalidSystem(f"parameter {name} would hide the {'number' if name == 'pi' else 'function'} {name}; expected another name")
    if not is_plain(name) or keyword.iskeyword(name):
        raise InvalidSystem(f"parameter {shown(name)} cannot be named in expressions; expected letters, digits and _, such as k1")


def names_in(text: str) -> set[str]:
    """The names in an expression, without those of functions and numbers."""
    try:
        tree = ast.parse(" ".join(text.split()), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()  # what is wrong with it is found where it is read
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - {*FUNCTIONS, "pi"}


def ordered_by_dependence(derived: Mapping[str, str]) -> list[str]:
    """Derived parameters, each after those that it depends on. Refuses a cycle."""
    found: list[str] = []

    def visit(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            cycle = " -> ".join([*above[above.index(name) :], name])
            raise InvalidSystem(f"parameters depend on each other in a cycle: {cycle}; expected a number for one of them")
        for inner in sorted(names_in(derived[name]) & derived.keys()):
            visit(inner, (*above, name))
        if name not in found:
            found.append(name)

    for name in derived:
        visit(name, ())
    return found
