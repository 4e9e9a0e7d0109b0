"""Constant loads of a conservative system as a part of its potential energy.

A constant load f adds -f . u to the energy. Displacements are counted from the position u_r where loads, springs and stops balance, and the
energy is zero there. Pressed stops leave the linear potential p . x, with p the sum of the forces that press them; without any, a linear
system is linear again (docs/theory.md, section 17).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations, islice
from typing import Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.description import leaves, names_in
from bvp.expressions import FUNCTIONS, is_plain
from bvp.forcing import Constant
from bvp.parameters import ParametricSystem
from bvp.system import ImpactSystem

__all__ = ["Rest", "about_rest", "has_constant_force", "rest_position", "resting_system", "with_loads_in_potential"]

ROUNDS, LINEAR_ROUNDS = 50, 5
"""Most steps of Newton's method for a position at rest, and those of a linear system: one, and refinements."""

CHOICES = 20_000
"""Most sets of pressed stops that are tried."""

BALANCED = 1e-11
"""Largest force that is left at rest, in units of the forces there."""

SETTLED = 1e-9
"""Last change of the position, relative: Newton's method squares it, and rounding leaves more of it the softer a long chain is."""

CLOSED = 1e-12
"""Largest gap of a closed stop, in units of the displacements."""


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
        The slope p of the potential there, of the forces that press stops.
    pressed : tuple of (int, float)
        The stops that are pressed, each with its bound.
    """

    place: np.ndarray
    energy: float
    force: np.ndarray
    pressed: tuple[tuple[int, float], ...]


def has_constant_force(system: ImpactSystem) -> bool:
    """Whether a spring of a conservative system has a force at u = 0, beyond rounding."""
    forces = getattr(system, "smooth_forces", None)  # what is no system is refused elsewhere
    if forces is None or not system.is_conservative:
        return False
    zero = np.zeros(system.degrees_of_freedom)
    if not forces.acting(zero, zero).any():
        return False
    terms = forces.terms_at_rest()
    total, size = (np.array([sum(map(of, row)) for row in terms]) for of in (float.__pos__, float.__abs__))
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
    free = n - int(np.linalg.matrix_rank(system.stiffness))  # about so many stops are pressed
    sizes = sorted(range(min(n, len(contacts)) + 1), key=lambda size: abs(size - free))
    sets = (one for size in sizes for one in combinations(range(len(contacts)), size) if len({contacts[i][0] for i in one}) == size)
    for chosen in map(list, islice(sets, CHOICES)):
        place, pressing = _balanced(system, load, rows[chosen], bounds[chosen])
        slack = CLOSED * (np.abs(bounds) + np.abs(rows).sum(axis=1) * np.max(np.abs(place)))
        if np.all(pressing > 0.0) and np.all(rows @ place <= bounds + slack):
            energy = system.energy(place, np.zeros(n)) - float(load @ place)
            pressed = tuple((contacts[i][0], contacts[i][2]) for i in chosen)
            return Rest(place + 0.0, energy, 0.0 - pressing @ rows[chosen], pressed)
    if next(sets, None) is not None:
        raise InvalidSystem(f"no position at rest was found with {CHOICES} sets of pressed stops; expected fewer stops")
    names = [name for name, entry in zip(system.coordinates, load, strict=True) if entry]
    raise InvalidSystem(
        f"the system rests nowhere: no spring and no stop holds {' and '.join(names) or 'it'} against the constant load; "
        "expected a stop or a spring that does"
    )


def _balanced(system: ImpactSystem, load: np.ndarray, rows: np.ndarray, bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where springs and loads balance while some stops are closed, rows . u = bounds, and the forces that press them; NaN if nowhere."""
    n, count, forces = system.degrees_of_freedom, len(bounds), system.smooth_forces
    u, pressing, slope, bend = np.zeros(n), np.zeros(count), np.zeros(n), np.zeros((n, n))
    own = 1.0 / np.sqrt(np.diag(system.mass))
    for _ in range(LINEAR_ROUNDS if forces is None else ROUNDS):
        if forces is not None:
            slope, bend = forces.energy_slopes(u)
        left, beyond, matrix = system.stiffness @ u + slope - load + rows.T @ pressing, rows @ u - bounds, system.stiffness + bend
        if not np.isfinite(left).all():
            break
        size = np.max(np.abs(load)) + np.max(np.abs(system.stiffness) @ np.abs(u)) + np.max(np.abs(slope))
        closed = np.abs(beyond) <= CLOSED * (np.abs(bounds) + np.abs(rows).sum(axis=1) * np.max(np.abs(u)))
        # Equations and unknowns in units of masses, stops as stiff as the stiffest mode: ranks do not depend on units.
        stiff = float(np.max(np.abs(own[:, None] * matrix * own))) or 1.0
        units = np.concatenate([own, stiff / np.linalg.norm(rows * own, axis=1)])
        matrix = np.block([[matrix, rows.T], [rows, np.zeros((count, count))]])
        change = units * np.linalg.lstsq(units[:, None] * matrix * units, units * np.concatenate([left, beyond]), rcond=1e-13)[0]
        settled = np.max(np.abs(change[:n])) <= SETTLED * np.max(np.abs(u)) and np.all(np.abs(left) <= BALANCED * size) and np.all(closed)
        u, pressing = u - change[:n], pressing - change[n:]
        if settled:
            return np.where(np.abs(u) <= 1e-14 * np.max(np.abs(u)), 0.0, u), pressing
    return np.full(n, np.nan), np.full(count, np.nan)


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
    return about_rest(ParametricSystem.of(system))[0].system() if has_constant_force(system) else system


def about_rest(parametric: ParametricSystem) -> tuple[ParametricSystem, Rest]:
    """A conservative system with constant loads, without loads in displacements from its position at rest, and that position.

    The place is that of the parameters' values: at other values displacements count from the same one, and what is not balanced there is a
    linear potential.

    Raises
    ------
    InvalidSystem
        For a system that rests nowhere, and for springs whose law cannot be written about another position.
    """
    system, layout, expressions = parametric.system(), parametric.layout, parametric.entry_expressions
    n = system.degrees_of_freedom
    if system.smooth_forces is not None and system.smooth_forces.is_called:
        raise InvalidSystem("a constant load goes with springs that are formulas; received a Python function")
    rest = rest_position(system, parametric.entries()[layout.constant])
    if not rest.place.any() and not parametric.forces():
        return parametric, rest
    description: dict[str, Any] = {"coordinates": replace(system, model=None).describe()["coordinates"], "stops": []}
    for key in ("mass", "damping", "stiffness"):
        flat = [_plain(entry) for entry in expressions[getattr(layout, key)]]
        description[key] = [flat[i : i + n] for i in range(0, n * n, n)]
    for k, stop in enumerate(system.stops):
        table: dict[str, Any] = {"name": stop.name, "c": list(stop.gap), "restitution": _plain(expressions[layout.restitution][k])}
        for key, value in (("lower", stop.lower), ("upper", stop.upper)):
            if math.isfinite(value):
                shift = value if (k, value) in rest.pressed else float(np.array(stop.gap) @ rest.place)
                bound = _plain(expressions[getattr(layout, key)][k])
                table[key] = f"{bound} - ({shift!r})" if isinstance(bound, str) else bound - shift
        description["stops"].append(table)
    springs = _springs(parametric, rest)
    if springs or not system.stops:
        description["springs"] = springs or [{"c": np.eye(n)[0].tolist(), "stiffness": 0.0}]
    texts = [*(text for text, _ in leaves(description, "the system")), *(spring.get("potential", "") for spring in springs)]
    used = {name for text in texts for name in names_in(text)}
    return ParametricSystem(
        {"parameters": {name: value for name, value in parametric.values.items() if name in used}, "system": description}
    ), rest


def _springs(parametric: ParametricSystem, rest: Rest) -> list[dict[str, Any]]:
    """The spring whose potential is what is left of springs and loads; none where nothing is left."""
    system, layout, expressions = parametric.system(), parametric.layout, parametric.entry_expressions
    stiffness, load, n = expressions[layout.stiffness], expressions[layout.constant], len(rest.place)
    forces = parametric.smooth_forces_along(None, parametric.names) if system.springs or system.dampers else None
    pressing = [{"c": rest.force.tolist(), "potential": "w"}] if rest.force.any() else []
    if forces is None and not any(getattr(entry, "free_symbols", None) for entry in (*stiffness, *load)):
        return pressing
    import sympy

    from bvp.entries import exact

    for name in system.coordinates:
        if not is_plain(name) or name in parametric.values:
            raise InvalidSystem(f"the coordinate {name} cannot be named in a potential; expected letters, digits and _, and no parameter")
    symbols = [sympy.Symbol(name, real=True) for name in system.coordinates]
    place = [sympy.Rational(repr(value)) for value in rest.place.tolist()]  # the decimal number that spells it
    potential: Any = sympy.Integer(0)
    if forces is not None:
        rows = [[exact(entry) for entry in row] for row in forces.inputs[:, :n].tolist()]
        moved = [sum(c * (x + u) for c, x, u in zip(row, symbols, place, strict=True)) for row in rows]
        potential = forces.potential.xreplace(dict(zip(forces.symbols, moved, strict=True)))
        if any(part.func.__name__ not in FUNCTIONS for part in potential.atoms(sympy.Function)):
            raise InvalidSystem("a power that is no integer cannot be written about the position at rest under a constant load")
    here = {sympy.Symbol(name, real=True): exact(value) for name, value in parametric.values.items()}
    here |= dict.fromkeys(symbols, sympy.Integer(0))
    for i, (x, force) in enumerate(zip(symbols, rest.force.tolist(), strict=True)):
        pull = sum((exact(stiffness[i * n + j]) * place[j] for j in range(n)), sympy.Integer(0)) - exact(load[i])
        # What rounding leaves at these values of the parameters is taken out.
        left = (pull + potential.diff(x)).xreplace(here) - sympy.Rational(repr(force))
        potential += (pull - (left if left.is_Rational else sympy.Rational(repr(float(left))))) * x
    potential = sympy.expand(potential) if potential.is_polynomial(*symbols) else potential
    # Of numbers, what is linear is known without its rounding.
    return pressing if all(potential.diff(x).is_number for x in symbols) else [{"potential": str(potential)}]


def _plain(entry: Any) -> Any:
    """An entry as a number, or as the text of an expression."""
    return str(entry) if getattr(entry, "free_symbols", None) else float(entry)
