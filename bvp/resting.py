"""Constant loads of a conservative system as a part of its potential.

A constant load f adds -f . u to the potential energy. Displacements are then counted from the position u_r where the loads, the springs
and the stops balance: x = u - u_r. The stops move by c . u_r. The potential of x is that of u without its value at u_r, so the energy is
zero at rest. Where no stop is pressed there, no linear term is left; pressed stops leave the sum of p_j c_j . x, with p_j >= 0 the forces
with which they are pressed. A linear system whose rest position presses no stop is therefore linear again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.expressions import is_plain
from bvp.forcing import Constant

if TYPE_CHECKING:
    from bvp.parameters import ParametricSystem
    from bvp.system import ImpactSystem

__all__ = ["Rest", "about_rest", "has_constant_force", "rest_position", "resting_system", "with_loads_in_potential"]

ROUNDS = 50
"""Most steps of Newton's method for a rest position."""

CHOICES = 20_000
"""Most sets of pressed stops that are tried."""

BALANCED = 1e-11
"""Largest force that is left at rest, in units of the forces there."""


@dataclass(frozen=True, eq=False)
class Rest:
    """Where a conservative system rests under constant loads.

    Parameters
    ----------
    place : (n,) ndarray
        u_r.
    energy : float
        The potential energy there, with zero at u = 0.
    force : (n,) ndarray
        The slope of the potential there: the sum of the forces p_j c_j that press stops. Zero where none is pressed.
    pressed : tuple of (int, float)
        The stops that are pressed, each with its bound.
    """

    place: np.ndarray
    energy: float
    force: np.ndarray
    pressed: tuple[tuple[int, float], ...]


def has_constant_force(system: ImpactSystem) -> bool:
    """Whether a force acts at u = 0: a constant load, or a spring with a linear potential."""
    forces = getattr(system, "smooth_forces", None)  # what is no system is refused elsewhere
    if forces is None or not system.is_conservative:
        return False
    terms = forces.terms_at_rest()
    total, size = (np.array([sum(row) for row in rows]) for rows in (terms, [list(map(abs, row)) for row in terms]))
    return bool(np.any(np.abs(total @ forces.directions) > BALANCED * (size @ np.abs(forces.directions))))


def rest_position(system: ImpactSystem, load: np.ndarray) -> Rest:
    """Where a conservative system rests between its stops under a constant load (n,).

    Raises
    ------
    InvalidSystem
        Where it rests nowhere: nothing holds it against the load.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=-2.0)])
    >>> rest = rest_position(ball, np.array([-9.81]))
    >>> rest.place, rest.energy, rest.force, rest.pressed
    (array([-2.]), -19.62, array([9.81]), ((0, -2.0),))
    """
    n = system.degrees_of_freedom
    sides = [(k, side, bound) for k, s in enumerate(system.stops) for side, bound in ((-1.0, s.lower), (1.0, s.upper))]
    contacts = [contact for contact in sides if math.isfinite(contact[2])]
    rows = np.array([side * np.array(system.stops[k].gap) for k, side, _ in contacts]).reshape(-1, n)
    bounds = np.array([side * bound for _, side, bound in contacts])
    tried = 0
    for size in range(min(n, len(contacts)) + 1):
        for chosen in combinations(range(len(contacts)), size):
            tried += 1
            if tried > CHOICES:
                break
            found = _balanced(system, load, rows[list(chosen)], bounds[list(chosen)])
            if found is None:
                continue
            place, pressing = found
            slack = 1e-12 * (np.abs(bounds) + np.abs(rows).sum(axis=1) * np.max(np.abs(place)))
            if np.all(pressing > 0.0) and np.all(rows @ place <= bounds + slack):
                energy = system.energy(place, np.zeros(n)) - float(load @ place)
                pressed = tuple((contacts[i][0], contacts[i][2]) for i in chosen)
                return Rest(place + 0.0, energy, pressing @ rows[list(chosen)] * -1.0 + 0.0, pressed)
    names = [name for name, entry in zip(system.coordinates, load, strict=True) if entry]
    raise InvalidSystem(
        f"the system rests nowhere: no spring and no stop holds {' and '.join(names) or 'it'} against the constant load; "
        "expected a stop or a spring that does"
    )


def _balanced(system: ImpactSystem, load: np.ndarray, rows: np.ndarray, bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Where springs and loads balance while some stops are closed, rows . u = bounds, and the forces with which these are pressed."""
    n, count = system.degrees_of_freedom, len(bounds)
    u, pressing, forces = np.zeros(n), np.zeros(count), system.smooth_forces
    for _ in range(ROUNDS):
        slope, bend = (np.zeros(n), np.zeros((n, n))) if forces is None else forces.energy_slopes(u)
        pull = system.stiffness @ u + slope - load
        if not np.isfinite(pull).all():
            return None
        matrix = np.block([[system.stiffness + bend, rows.T], [rows, np.zeros((count, count))]])
        residual = np.concatenate([pull + rows.T @ pressing, rows @ u - bounds])
        change = np.linalg.lstsq(matrix, residual, rcond=1e-13)[0]
        u, pressing = u - change[:n], pressing - change[n:]
        if np.max(np.abs(change[:n])) <= 1e-15 * np.max(np.abs(u)):
            break
    slope = np.zeros(n) if forces is None else forces.energy_slopes(u)[0]
    left = system.stiffness @ u + slope - load + rows.T @ pressing
    size = np.max(np.abs(load)) + np.max(np.abs(system.stiffness) @ np.abs(u)) + np.max(np.abs(slope))
    closed = np.abs(rows @ u - bounds) <= 1e-12 * (np.abs(bounds) + np.abs(rows).sum(axis=1) * np.max(np.abs(u)))
    if not (np.all(np.abs(left) <= BALANCED * size) and np.all(closed)):
        return None
    return np.where(np.abs(u) <= 1e-14 * np.max(np.abs(u)), 0.0, u), pressing


def with_loads_in_potential(parametric: ParametricSystem) -> ParametricSystem:
    """The system about its position at rest (`about_rest`) where it is conservative and its loads are constant; else the system itself."""
    system, forces = parametric.system(), parametric.forces()
    constant = all(isinstance(force, Constant) for force in forces)
    wanted = constant and system.is_conservative and (forces or has_constant_force(system))
    return about_rest(parametric)[0] if wanted else parametric


def resting_system(system: ImpactSystem) -> ImpactSystem:
    """A system with constant forces about its position at rest; any other one as it is.

    Examples
    --------
    >>> from bvp.system import ImpactSystem
    >>> hanging = ImpactSystem.from_lagrangian("y_dot**2/2", "2*y**2 + y", ["y"], gaps=[("y", -1, None)])
    >>> system = resting_system(hanging)
    >>> system.stops[0].lower, system.smooth_forces
    (-0.75, None)
    """
    from bvp.parameters import ParametricSystem

    return about_rest(ParametricSystem.of(system))[0].system() if has_constant_force(system) else system


def about_rest(parametric: ParametricSystem) -> tuple[ParametricSystem, Rest]:
    """A conservative system with constant loads, in displacements from its rest position at the values of its parameters.

    The place is a number: for other values of the parameters the displacements are counted from the same one, and what is not balanced
    there is a linear potential.

    Returns
    -------
    ParametricSystem
        Without loads.
    Rest

    Raises
    ------
    InvalidSystem
        For a system that rests nowhere, and for springs whose law cannot be written about another position.
    """
    system, layout = parametric.system(), parametric.layout
    entries, expressions = parametric.entries(), parametric.entry_expressions
    n = system.degrees_of_freedom
    if system.smooth_forces is not None and system.smooth_forces.is_called:
        raise InvalidSystem("a constant load goes with springs that are formulas; received a Python function")
    rest = rest_position(system, entries[layout.constant])
    if not rest.place.any() and not parametric.forces():
        return parametric, rest
    place = [_number(value) for value in rest.place.tolist()]

    def written(part: slice) -> list[Any]:
        return [_plain(entry) for entry in expressions[part]]

    stops: list[dict[str, Any]] = []
    for k, stop in enumerate(system.stops):
        shift, bounds = float(np.array(stop.gap) @ rest.place), {}
        for key, value in (("lower", stop.lower), ("upper", stop.upper)):
            if math.isfinite(value):
                bounds[key] = _less(expressions[getattr(layout, key)][k], value if (k, value) in rest.pressed else shift)
        stops.append({"name": stop.name, "c": list(stop.gap), **bounds, "restitution": written(layout.restitution)[k]})
    description: dict[str, Any] = {"stops": stops, "coordinates": _names(system)}
    for key in ("mass", "damping", "stiffness"):
        flat = written(getattr(layout, key))
        description[key] = [flat[i : i + n] for i in range(0, n * n, n)]
    springs = _potential(parametric, rest, place)
    if springs or not stops:
        description["springs"] = springs or [{"c": np.eye(n)[0].tolist(), "stiffness": 0.0}]
    from bvp.description import names_in

    used = {name for text in _texts(description) for name in names_in(text)}
    parameters = {name: value for name, value in parametric.values.items() if name in used}
    return type(parametric)({"parameters": parameters, "system": description}), rest


def _potential(parametric: ParametricSystem, rest: Rest, place: list[Any]) -> list[dict[str, Any]]:
    """The springs whose potential is what is left of springs and loads, as a list of one table; empty where nothing is left."""
    system, layout, n = parametric.system(), parametric.layout, len(place)
    expressions = parametric.entry_expressions
    forces = parametric.smooth_forces_along(None, parametric.names) if system.springs or system.dampers else None
    loading = [*expressions[layout.stiffness], *expressions[layout.constant]]
    pressing = [{"c": rest.force.tolist(), "potential": "w"}] if rest.force.any() else []
    if forces is None and not any(getattr(entry, "free_symbols", None) for entry in loading):
        return pressing
    import sympy

    from bvp.entries import exact

    for name in system.coordinates:
        if not is_plain(name) or name in parametric.values:
            raise InvalidSystem(f"the coordinate {name} cannot be named in a potential; expected letters, digits and _, and no parameter")
    symbols = [sympy.Symbol(name, real=True) for name in system.coordinates]
    stiffness, load = expressions[layout.stiffness], expressions[layout.constant]
    pulls = [sum(exact(stiffness[i * n + j]) * place[j] for j in range(n)) - exact(load[i]) for i in range(n)]
    at = {sympy.Symbol(name, real=True): exact(value) for name, value in parametric.values.items()}
    potential: Any = sympy.Integer(0)
    if forces is not None:
        rows = forces.inputs[:, :n]
        moved: dict[Any, Any] = {
            symbol: sum(_number(c) * (x + u) for c, x, u in zip(row.tolist(), symbols, place, strict=True) if c)
            for symbol, row in zip(forces.symbols, rows, strict=True)
        }
        potential = forces.potential.xreplace(moved)
        unknown = [part for part in potential.atoms(sympy.Function) if part.func.__name__ not in ("exp", "log", *_TRIGONOMETRIC)]
        if unknown:
            raise InvalidSystem("a power that is no integer cannot be written about the rest position under a constant load")
    slopes = [potential.diff(x).xreplace(dict.fromkeys(symbols, sympy.Integer(0))).xreplace(at) for x in symbols]
    for x, pull, slope, force in zip(symbols, pulls, slopes, rest.force.tolist(), strict=True):
        # What rounding leaves at these values of the parameters is taken out.
        left = sympy.sympify(pull).xreplace(at) + slope - _number(force)
        potential += (pull - (left if left.is_Rational else _number(float(left)))) * x
    potential = sympy.expand(potential) if potential.is_polynomial(*symbols) else potential
    # Of numbers, what is linear is known without its rounding.
    return pressing if all(potential.diff(x).is_number for x in symbols) else [{"potential": str(potential)}]


_TRIGONOMETRIC = ("sin", "cos", "tan", "sinh", "cosh", "tanh")


def _number(value: float) -> Any:
    """The decimal number that spells a float."""
    import sympy

    return sympy.Rational(repr(value))


def _plain(entry: Any) -> Any:
    """An entry as a number, or as the text of an expression."""
    return str(entry) if getattr(entry, "free_symbols", None) else float(entry)


def _less(entry: Any, value: float) -> Any:
    """An entry less a number."""
    if getattr(entry, "free_symbols", None):
        return f"{entry} - ({value!r})" if value else str(entry)
    return float(entry) - value


def _names(system: ImpactSystem) -> dict[str, Any]:
    names: dict[str, Any] = {"names": list(system.coordinates)}
    for key in ("absorber", "primary"):
        index = getattr(system, key)
        if index is not None:
            names[key] = system.coordinates[index]
    return names


def _texts(node: Any) -> list[str]:
    """All texts in a description that can be expressions."""
    if isinstance(node, str):
        return [node]
    if isinstance(node, dict):
        return [text for key, value in node.items() if key not in ("name", "coordinates") for text in _texts(value)]
    return [text for value in node for text in _texts(value)] if isinstance(node, list) else []
