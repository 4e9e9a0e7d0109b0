"""Descriptions of systems and loads as plain data, in which texts are expressions of parameters: their parts, names and order."""

from __future__ import annotations

import ast
import keyword
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.entries import exact
from bvp.expressions import FUNCTIONS, is_plain
from bvp.forcing import Constant, Force, Harmonic, Record, ground_load
from bvp.springs import Damper, Spring, element_from, require_keys
from bvp.system import MODELS, ImpactSystem
from bvp.texts import shown

__all__ = [
    "BASE", "FORCE", "RESERVED", "elements_from", "force_from", "in_reciprocal", "leaves", "load_entries", "mapped", "names_in",
    "ordered_by_dependence", "own_parameters", "parts_from", "reciprocals", "replaced_values", "require_name", "require_used",
]  # fmt: skip

BASE = "w"
"""The parameter of which ``harmonic`` gives the multiple. If the loads have one frequency, a number, it is this parameter."""

RESERVED = ("energy", "quarter_period")
"""Parameters of every conservative family, which no scene defines."""

FORCE = ("load", "ground", "amplitude", "phase", "frequency", "harmonic", "constant", "cosine", "sine", "times", "values", "scale")
"""Keys of a load."""

_TEXTS = ("potential", "force")
"""Keys of springs and dampers whose text is an expression of coordinates too. Its parameters are given beside it."""

_PLAIN = ("model", "names", "name", "c", "coordinates", "times", "values", "harmonic", "between", "on", "nonlinear_only", *_TEXTS)
"""Keys of a description whose content has no expressions."""

_ELEMENTS: dict[str, Any] = {"springs": Spring, "dampers": Damper}
"""Keys of a description whose tables are springs and dampers, and what each of these is."""


def own_parameters(system: dict[str, Any], forces: list[dict[str, Any]], table: Mapping[str, Any]) -> dict[str, float]:
    """The values of parameters of themselves: those of the model, and the one frequency of the loads. Their names replace their numbers.

    Springs and dampers with expressions of coordinates gain a table of the parameters in these."""
    found: dict[str, float] = {}
    for key, kind in _ELEMENTS.items():
        if key not in system:
            continue
        for element in system[key]:
            require_keys(kind, element)
        known = system.get("coordinates", {})
        names = known.get("names") if isinstance(known, Mapping) else known
        named = names or [f"u{k}" for k, _ in enumerate(system.get("mass", ()), 1)]
        system[key] = _with_text_parameters(system[key], [*table], named)
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


def _with_text_parameters(elements: Sequence[Mapping[str, Any]], known: Sequence[str], coordinates: Sequence[str]) -> list[dict[str, Any]]:
    """Springs or dampers with tables of the parameters that are in their expressions.
    Of {"on": "u1", "potential": "k*w**4"} it is {"k": "k"}: w is no parameter there."""
    found = []
    for element in elements:
        own = {"w", "w_dot", *coordinates, *(f"{name}_dot" for name in coordinates)}
        texts = [element[key] for key in _TEXTS if isinstance(element.get(key), str)]
        names = sorted({name for text in texts for name in names_in(text)} & set(known) - own)
        given = {name: name for name in names} | dict(element.get("parameters", {}))
        found.append({**element, "parameters": given} if given else dict(element))
    return found


def elements_from(system: Mapping[str, Any], coordinates: Sequence[str]) -> dict[str, list[Any]]:
    """The springs and dampers of a description, whose numbers can be expressions."""
    return {key: [element_from(kind, entry, coordinates) for entry in system.get(key, ())] for key, kind in _ELEMENTS.items()}


def parts_from(system: Mapping[str, Any], coordinates: Sequence[str]) -> dict[str, Any]:
    """The matrices and stops of a description with matrices, of numbers and expressions; the linear parts of springs and dampers added."""
    stops = [(s["c"], s.get("lower", -math.inf), s.get("upper", math.inf), s.get("restitution", 1.0)) for s in system.get("stops", ())]
    zero = [[0.0] * len(system["mass"]) for _ in system["mass"]]
    parts = {"mass": system["mass"], "damping": system.get("damping", zero), "stiffness": system["stiffness"], "stops": stops}
    elements = elements_from(system, coordinates)
    for key, name in (("springs", "stiffness"), ("dampers", "damping")):
        if elements[key]:
            from bvp.smooth_forces import linear_part

            parts[name] = _added(parts[name], linear_part(elements[key], coordinates).tolist())
    return parts


def _added(matrix: Sequence[Sequence[Any]], part: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """The sum of two matrices of numbers and expressions. Numbers are added as those of a system are."""

    def plus(a: Any, b: Any) -> Any:
        return a + b if isinstance(a, int | float) and isinstance(b, int | float) else exact(a) + exact(b)

    return [[plus(a, b) for a, b in zip(*rows, strict=True)] for rows in zip(matrix, part, strict=True)]


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


def load_entries(
    forces: Sequence[Mapping[str, Any]], values: Sequence[Mapping[str, Any]], mass: Sequence[Sequence[Any]]
) -> list[dict[str, Any]]:
    """The loads of a description as `bvp.entries.entries_of` takes them. values: the same loads, with expressions for their texts."""
    loads: list[dict[str, Any]] = []
    if not forces:
        return loads
    from sympy import cos, sin

    for force, given in zip(forces, values, strict=True):
        if "times" in force:
            raise ValueError("a load is a record, which has no period; expected harmonic and constant loads")
        if "cosine" in given:
            loads.append({**given, "text": str(force["frequency"])})
            continue
        if "ground" in given:
            row = [-sum(exact(m) * exact(r) for m, r in zip(masses, given["ground"], strict=True)) for masses in mass]
        else:
            row = [exact(entry) for entry in given["load"]]
        if "constant" in given:
            loads.append({"constant": [exact(given["constant"]) * entry for entry in row]})
            continue
        amplitude, phase = exact(given["amplitude"]), exact(given.get("phase", 0.0))
        loads.append(
            {
                "cosine": [amplitude * cos(phase) * entry for entry in row],
                "sine": [-amplitude * sin(phase) * entry for entry in row],
                "frequency": given["frequency"],
                "text": str(force["frequency"]),
            }
        )
    return loads


def leaves(node: Any, where: str) -> Iterator[tuple[str, str]]:
    """The expressions in a description, each with its place in words."""
    if isinstance(node, str):
        yield node, where
    elif isinstance(node, Mapping):
        for key, inner in node.items():
            if key == "parameters":
                for name, value in inner.items():
                    yield from leaves(value, f"parameter {name} of {where}")
            elif key not in _PLAIN:
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
        own = {name: mapped(value, function) for name, value in node.get("parameters", {}).items()}
        found = {key: inner if key in _PLAIN else mapped(inner, function) for key, inner in node.items() if key != "parameters"}
        return found | ({"parameters": own} if own else {})
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


def reciprocals(table: Mapping[str, Any]) -> dict[str, str]:
    """The parameters that a table gives by their reciprocals: {"n": "1/n"}."""
    found = {name.removeprefix("1/"): name for name in table if name.startswith("1/")}
    for name in found.keys() & table.keys():
        raise InvalidSystem(f"parameter {name} is given twice, as {name} and as 1/{name}; expected one of them")
    return found


def in_reciprocal(description: Mapping[str, Any], name: str, value: float) -> dict[str, Any]:
    """A description in which the reciprocal of an independent parameter with a value is the parameter, in its place."""
    if value == 0.0:
        raise InvalidSystem(f"1/{name} has no value: {name} = 0")
    system, table = dict(description["system"]), dict(description.get("parameters", {}))
    if name in table:
        table = {f"1/{name}" if key == name else key: 1.0 / value if key == name else entry for key, entry in table.items()}
    elif name in MODELS[system["model"]].domains if "model" in system else False:
        system[name], table[f"1/{name}"] = name, 1.0 / value
    else:
        raise InvalidSystem(f"1/{name}: expected the reciprocal of a parameter of the scene, and {name} is the frequency of its loads")
    return {**description, "system": system, "parameters": table}


def replaced_values(description: Mapping[str, Any], system: Mapping[str, Any], at: Mapping[str, float]) -> dict[str, Any]:
    """A description with other values of its independent parameters. system: its system, with the parameters of its model by name."""
    given, table = dict(description), dict(description.get("parameters", {}))
    own = [name for name in at if name not in table]
    given["system"] = {**given["system"], **{name: at[name] for name in own if name in system}}
    if BASE in own:
        given["forces"] = [{**force, "frequency": at[BASE]} if "frequency" in force else force for force in given["forces"]]
    if table:
        given["parameters"] = {name: at.get(name, value) for name, value in table.items()}
    return given


def require_used(table: Mapping[str, Any], texts: Iterable[str], derived: Mapping[str, str]) -> None:
    """Refuse a parameter of a table on which nothing depends. texts: the expressions of the system and its loads."""
    used = {name for text in texts for name in names_in(text)}
    waiting = list(used)
    while waiting:
        inner = names_in(derived.get(waiting.pop(), "")) - used
        used |= inner
        waiting += inner
    for name in table:
        if name.removeprefix("1/") not in used:
            raise InvalidSystem(f"parameter {name} is used nowhere; expected it in an expression of the system or of a load")


def names_in(text: str) -> set[str]:
    """The names in an expression, without those of functions and numbers."""
    try:
        tree = ast.parse(" ".join(text.split()), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()  # what is wrong with it is found where it is read
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - {*FUNCTIONS, "pi"}


def ordered_by_dependence(derived: Mapping[str, str]) -> list[str]:
    """Derived parameters, each after those that it depends on. Refuses a cycle."""
    try:
        return list(TopologicalSorter({name: sorted(names_in(text) & derived.keys()) for name, text in derived.items()}).static_order())
    except CycleError as error:
        cycle = " -> ".join(reversed(error.args[1]))
        raise InvalidSystem(f"parameters depend on each other in a cycle: {cycle}; expected a number for one of them") from None
