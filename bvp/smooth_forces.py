"""The smooth forces of a system: what is left of its springs and dampers without their linear parts, as expressions.

Each input w_i is a row on the states (u, v), each force f_j acts along a row on the coordinates, and the left-hand side of
M u'' + C u' + K u = 0 gains the sum of d_j f_j(w). The forces of springs are the gradient of a potential where they have one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.dense import solve
from bvp.entries import exact
from bvp.expressions import ExpressionError, not_too_deep, parsed
from bvp.jet_programs import even_power, jet_program, plain_jet_program, plain_powers, signed_power
from bvp.kernels.expressions import Program
from bvp.kernels.jets import JetProgram
from bvp.programs import program_of, with_numbers
from bvp.springs import Damper, Element, Spring, is_nonlinear, is_symbolic
from bvp.texts import shown

if TYPE_CHECKING:
    from bvp.called_forces import CalledForces

__all__ = ["SmoothForces", "linear_part", "smooth_forces", "why_not_smooth"]

LARGEST_TEXT_POWER = 1000
"""Largest number in an exponent of a potential or force given as text."""

_NOT_SMOOTH = ("abs", "Abs", "sign", "sgn", "max", "Max", "min", "Min", "Heaviside", "Piecewise", "floor", "ceil", "ceiling")
_CALLED = re.compile(rf"\b({'|'.join(_NOT_SMOOTH)})\s*\(")


@dataclass(frozen=True, eq=False)
class SmoothForces:
    """Forces f_j(w) of inputs w_i, for n coordinates.

    Parameters
    ----------
    symbols : tuple of I sympy symbols
        The inputs.
    inputs : (I, 2 n) ndarray
        Their rows on the states (u, v).
    forces : tuple of F sympy expressions
        Of the inputs, and of parameters if the springs have any.
    directions : (F, n) ndarray
        The rows along which they act: M u'' + C u' + K u + directions^T f = 0.
    potential : sympy expression or None
        Of the inputs; None if the springs have none, or none that can be found.
    why_no_potential : str or None
        Which springs have none.
    why_dissipative : str or None
        Which dampers lose or gain energy beside C.
    coordinates : tuple of n str
    dampers : tuple of F str
        Which damper each force is of; empty for springs.
    called : tuple of str
        The springs and dampers whose force is a Python function of which no formula is known.
    parameters : tuple of P sympy symbols
        Those in the expressions.
    numbers : tuple of P floats
        Their values.
    """

    symbols: tuple[Any, ...]
    inputs: np.ndarray
    forces: tuple[Any, ...]
    directions: np.ndarray
    potential: Any
    why_no_potential: str | None
    why_dissipative: str | None
    coordinates: tuple[str, ...]
    dampers: tuple[str, ...]
    called: tuple[str, ...] = ()
    parameters: tuple[Any, ...] = ()
    numbers: tuple[float, ...] = ()

    def at(self, numbers: Sequence[float]) -> SmoothForces:
        """The same at other values of the parameters."""
        _ = self.why_not_odd  # it is known at all values then
        found = copy(self)
        object.__setattr__(found, "numbers", tuple(numbers))
        return found

    @cached_property
    def why_not_odd(self) -> str | None:
        """A force that does not change its sign with the state, or None."""
        mirrored = {symbol: -symbol for symbol in self.symbols}
        for k, (force, direction) in enumerate(zip(self.forces, self.directions, strict=True)):
            if not (self._is_odd(k) if self.is_called else _vanishes(force + force.xreplace(mirrored))):
                names = [name for name, entry in zip(self.coordinates, direction, strict=True) if entry]
                return f"a spring or damper on {' and '.join(names)} whose force is not odd"
        return None

    def _is_odd(self, k: int) -> bool:
        """Whether a force that is called is odd to rounding at elongations of several sizes, where it is a number."""
        from bvp.called_forces import tried

        at = np.geomspace(1e-3, 10.0, 40) * np.linspace(1.0, 0.3, len(self.symbols))[:, None]
        with np.errstate(all="ignore"):
            plus, minus = tried(self._functions[k], *at), tried(self._functions[k], *-at)
        return not np.any(np.abs(plus + minus) > 1e-12 * (np.abs(plus) + np.max(np.abs(at), axis=0)))

    def push(self, mass: np.ndarray) -> np.ndarray:
        """The accelerations (n, F) of unit forces."""
        return -solve(mass, self.directions.T)

    def program(self) -> JetProgram:
        """The program of the forces' jets (`bvp.jet_programs`)."""
        if self.is_called:
            return self.called_forces().program
        return plain_jet_program(self.forces, self.symbols, self.parameters, self.numbers)

    def released_program(self) -> tuple[JetProgram, Program]:
        """The same with derivatives by the parameters (`bvp.jet_programs.jet_program`)."""
        if self.is_called:
            return self.called_forces().program, program_of(list(self.parameters), self.parameters)
        return jet_program(self.forces, self.symbols, self.parameters, self.numbers)

    def energy_program(self) -> Program:
        """The program (`bvp.kernels.expressions`) of the potential, of the inputs; zero of forces that are called, whose energy is in
        `called_forces`."""
        if self.is_called:
            return program_of([0], self.symbols)
        return with_numbers(_energy_program(self._potential, (*self.symbols, *self.parameters)), self.numbers)

    def called_forces(self) -> CalledForces:
        """The functions of forces that are called."""
        from bvp.called_forces import called_forces

        return called_forces(self.forces, self.symbols, self.potential, self.parameters, self.numbers, _function)

    @cached_property
    def is_called(self) -> bool:
        """Whether a force is a Python function of which no formula is known."""
        return bool(self.called)

    def energy(self, u: np.ndarray) -> Any:
        """The potential at displacements (..., n), without the linear springs. A ValueError if there is none."""
        rows = self.inputs[:, : u.shape[-1]]
        with np.errstate(all="ignore"):
            return self._energy(*np.moveaxis(u @ rows.T, -1, 0), *self.numbers) + np.zeros(u.shape[:-1])

    def why_no_energy(self, u: np.ndarray) -> str | None:
        """A term of the potential that is no finite number at displacements (n,), by the coordinates that it depends on, or None."""
        at = [*(self.inputs[:, : len(u)] @ u), *self.numbers]
        for term in self._potential.as_ordered_terms():
            with np.errstate(all="ignore"):
                value = _function((*self.symbols, *self.parameters), term)(*at)
            if not np.isfinite(value):
                moved = np.any([row for row, symbol in zip(self.inputs, self.symbols, strict=True) if symbol in term.free_symbols], axis=0)
                names = [name for name, entry in zip(self.coordinates, moved, strict=False) if entry]
                return f"the potential of a spring on {' and '.join(names)} has no finite value there"
        return None

    def energy_slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first and second derivatives of the potential at displacements (n,): (n,) and (n, n). Of formulas."""
        rows = self.inputs[:, : len(u)]
        at = [*(rows @ u), *self.numbers]
        first, second = self._energy_derivatives
        slopes = np.array([float(function(*at)) for function in first])
        bends = np.array([[float(function(*at)) for function in line] for line in second])
        return slopes @ rows, rows.T @ bends @ rows

    def acting(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The forces (..., n) on the coordinates at displacements and velocities (..., n), on the left-hand side."""
        found: np.ndarray = self.values(u, v) @ self.directions
        return found

    def values(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The forces f_j (..., F) at displacements and velocities (..., n)."""
        inputs = np.moveaxis(np.concatenate([u, v], axis=-1) @ self.inputs.T, -1, 0)
        return np.stack([force(*inputs, *self.numbers) + np.zeros(u.shape[:-1]) for force in self._functions], axis=-1)

    def terms_at_rest(self) -> list[list[float]]:
        """The terms of each force where all inputs are 0: what is left of those that balance is small beside them."""
        known, at = (*self.symbols, *self.parameters), (*(0.0 for _ in self.symbols), *self.numbers)
        return [[float(_function(known, term)(*at)) for term in force.as_ordered_terms()] for force in self.forces]

    @property
    def _potential(self) -> Any:
        if self.potential is None:
            raise InvalidSystem(str(self.why_no_potential))
        return self.potential

    @cached_property
    def _energy(self) -> Callable[..., Any]:
        return _function((*self.symbols, *self.parameters), self._potential)

    @cached_property
    def _energy_derivatives(self) -> tuple[list[Callable[..., Any]], list[list[Callable[..., Any]]]]:
        from bvp.programs import derivative

        known = (*self.symbols, *self.parameters)
        first = [derivative(self._potential, symbol) for symbol in self.symbols]
        second = [[_function(known, derivative(slope, symbol)) for symbol in self.symbols] for slope in first]
        return [_function(known, slope) for slope in first], second

    @cached_property
    def _functions(self) -> list[Callable[..., Any]]:
        return [_function((*self.symbols, *self.parameters), force) for force in self.forces]


@lru_cache(maxsize=64)
def _energy_program(potential: Any, symbols: tuple[Any, ...]) -> Program:
    return program_of([plain_powers(potential)], symbols)


def smooth_forces(springs: Sequence[Spring], dampers: Sequence[Damper], coordinates: Sequence[str]) -> SmoothForces | None:
    """The forces of springs and dampers without their linear parts; None if nothing is left.

    Raises
    ------
    InvalidSystem
        For an expression that cannot be read, is not smooth, or has a force at rest.

    Examples
    --------
    >>> forces = smooth_forces([Spring((1.0, -1.0), polynomial=(1.0, 0.0, 4.0))], [], ["u1", "u2"])
    >>> forces.forces, forces.potential, forces.directions.tolist(), forces.why_not_odd
    ((4*@1**3,), @1**4, [[1.0, -1.0]], None)
    >>> float(forces.energy(np.array([2.0, 1.0])))
    1.0
    """
    collected = _Collected(coordinates)
    with not_too_deep("a force"):
        for element in (*springs, *dampers):
            if element.text:
                collected.add_text(element)
            elif is_nonlinear(element):
                collected.add_law(element)
    return collected.result()


def linear_part(elements: Sequence[Element], coordinates: Sequence[str]) -> Any:
    """The stiffness of the linear parts of springs, or the damping of those of dampers, without those that leave it out.

    Returns
    -------
    (n, n) ndarray
        Floats; numbers and expressions of parameters if an element has any.

    Examples
    --------
    >>> linear_part([Spring((1.0, -1.0), polynomial=(2.0, 0.0, 1.0)), Spring((1.0, 0.0), stiffness=1.0, power=3)], ["x", "y"])
    array([[ 2., -2.],
           [-2.,  2.]])
    """
    total = np.zeros((len(coordinates), len(coordinates)), dtype=object)
    for element in elements:
        if element.nonlinear_only:
            continue
        if element.text:
            with not_too_deep("a force"):
                total += _Collected(coordinates).add_text(element)
        else:
            row = np.array(element.row, dtype=object)
            total += element.coefficients().get(1, 0.0) * np.outer(row, row)
    symbolic = any(is_symbolic(entry) for entry in total.ravel())
    return total if symbolic else np.array(total, dtype=float)


def why_not_smooth(expression: Any) -> str | None:
    """The first part of an expression that is not smooth at all real values, and at rest; None if all are.

    Examples
    --------
    >>> import sympy
    >>> w = sympy.Symbol("w", real=True)
    >>> why_not_smooth(w**4 + sympy.Abs(w)), why_not_smooth(w**sympy.Rational(5, 2)), why_not_smooth(sympy.sqrt(1 + w**2))
    ('Abs(w)', 'w**(5/2)', None)
    """
    import sympy

    corners = (sympy.Abs, sympy.sign, sympy.Max, sympy.Min, sympy.Heaviside, sympy.Piecewise, sympy.floor, sympy.ceiling, sympy.DiracDelta)
    for part in sympy.preorder_traversal(expression):
        if isinstance(part, corners):
            return str(part)
        if part.is_Pow and part.base.free_symbols and not (part.exp.is_Integer and part.exp >= 0):
            rest = part.base.xreplace({symbol: sympy.Integer(0) for symbol in part.base.free_symbols})
            if rest == 0:
                return str(part)
    return None


class _Collected:
    """Collects the forces, by the row along which they act."""

    def __init__(self, coordinates: Sequence[str]):
        self.coordinates = tuple(coordinates)
        self.symbols: dict[tuple[float, ...], Any] = {}
        self.forces: dict[tuple[tuple[float, ...], str], Any] = {}
        import sympy

        self.potential: Any = sympy.Integer(0)
        self.unknown: str | None = None
        self.dissipative: str | None = None
        self.called: list[str] = []
        self.coupled: list[Any] = [0] * len(coordinates)
        """Forces of the coordinates whose potential is not known."""

    def input(self, row: Sequence[float], order: int = 0) -> Any:
        """The symbol of an input: a row on displacements, or on velocities (order 1)."""
        import sympy

        zeros = (0.0,) * len(self.coordinates)
        key = (*zeros, *row) if order else (*row, *zeros)
        # No name in an expression can be this one.
        return self.symbols.setdefault(key, sympy.Symbol(f"@{len(self.symbols) + 1}", real=True))

    def unit(self, k: int) -> tuple[float, ...]:
        return tuple(float(i == k) for i in range(len(self.coordinates)))

    def add(self, direction: tuple[float, ...], force: Any, damper: str) -> None:
        if force != 0:
            key = direction, damper
            self.forces[key] = self.forces.get(key, 0) + force

    def add_law(self, element: Element) -> None:
        """A power or a polynomial."""
        w = self.input(element.row, int(isinstance(element, Damper)))
        terms = {k: exact(value) for k, value in element.coefficients().items() if k != 1}
        if terms:
            force = sum(value * w**k for k, value in terms.items())
            potential = sum(value * w ** (k + 1) / (k + 1) for k, value in terms.items())
        else:
            value, power = exact(getattr(element, element.factor)), exact(element.power)
            force, potential = value * signed_power(w, power), value * even_power(w, power + 1) / (power + 1)
        place = element.place(self.coordinates)
        self.add(element.row, force, "" if isinstance(element, Spring) else place)
        if isinstance(element, Spring):
            self.potential += potential
        else:
            self.dissipative = self.dissipative or place

    def add_text(self, element: Element) -> np.ndarray:
        """An expression. Returns the stiffness or damping (n, n) of its linear part, which is left out."""
        expression, local = self._read(element)
        place = element.place(self.coordinates)
        order = int(isinstance(element, Damper))
        seen = expression.free_symbols
        on = [bool(entry) for entry in element.row] or [False] * len(self.coordinates)
        used = [k for k, moves in enumerate(on) if moves or {self.input(self.unit(k)), self.input(self.unit(k), 1)} & seen]
        rows = [element.row] if local and element.row else [self.unit(k) for k in used]
        symbols = [self.input(row, order) for row in rows]
        if not rows and expression != 0:  # it can be 0 at a value of a parameter
            raise InvalidSystem(f"the {'potential' if isinstance(element, Spring) else 'force'} of {place} has no coordinate: {expression}")
        if isinstance(element, Spring) and element.potential:
            parts = {tuple(rows): expression} if local else self._along_rows(expression, rows)
            return np.asarray(sum(self._add_potential(part, key, place) for key, part in parts.items()))
        forces = [expression] if local else [exact(element.row[k]) * expression for k in used]
        if order or element.called is not None:
            _require_at_rest(forces, symbols if order else [], place)
        rests, linear = self._split(forces, symbols, rows, place, damper=bool(order))
        if order:
            if any(rest != 0 for rest in rests):
                self.dissipative = self.dissipative or place
        elif local:
            if element.called is None:
                self._integrate(rests[0], symbols[0], place)
            else:
                stored, w = element.called.stored, symbols[0]
                self.potential += stored(w) - stored(0) - _at_rest(forces[0].diff(w), place) * w**2 / 2
        else:
            for k, rest in zip(used, rests, strict=True):
                self.coupled[k] += rest
        return linear

    def _add_potential(self, potential: Any, rows: Sequence[tuple[float, ...]], place: str) -> np.ndarray:
        """A potential of displacements along rows. Returns the stiffness (n, n) of its quadratic part, which is left out."""
        symbols = [self.input(row) for row in rows]
        _, stiffness = self._split([potential.diff(symbol) for symbol in symbols], symbols, rows, place, damper=False)
        quadratic = sum(_at_rest(potential.diff(a).diff(b), place) * a * b for a in symbols for b in symbols) / 2
        self.potential += potential - _at_rest(potential, place) - quadratic
        return stiffness

    def _split(
        self, forces: Sequence[Any], symbols: Sequence[Any], rows: Sequence[tuple[float, ...]], place: str, *, damper: bool
    ) -> tuple[list[Any], np.ndarray]:
        """Add forces along rows without their linear part; of springs without the symmetric one. Returns what was added, and the matrix
        (n, n) of the linear part."""
        import sympy

        slopes = sympy.Matrix([[_at_rest(force.diff(symbol), place) for symbol in symbols] for force in forces])
        linear = slopes if damper else (slopes + slopes.T) / 2
        rests = [_without(force, symbols, list(linear.row(k)), place) for k, force in enumerate(forces)]
        for row, rest in zip(rows, rests, strict=True):
            self.add(row, rest, place if damper else "")
        table = np.array(rows, dtype=object).reshape(len(rows), len(self.coordinates))
        return rests, np.asarray(table.T @ np.array(linear.tolist(), dtype=object).reshape(len(rows), len(rows)) @ table)

    def _along_rows(self, potential: Any, rows: Sequence[tuple[float, ...]]) -> dict[tuple[tuple[float, ...], ...], Any]:
        """A potential of coordinates as a sum, by the rows on which each part depends: a function of x - y has one row, and one force."""
        import sympy

        symbols = [self.input(row) for row in rows]
        parts: dict[tuple[tuple[float, ...], ...], Any] = {}
        for term in sympy.Add.make_args(potential):
            moved = [k for k, symbol in enumerate(symbols) if symbol in term.free_symbols]
            slopes = [term.diff(symbols[k]) for k in moved]
            ratios = [slope / slopes[0] for slope in slopes]
            key = tuple(rows[k] for k in moved)
            # Linear terms can balance others at rest only together with them.
            if any(_at_rest(slope, "") != 0 for slope in slopes):
                key = tuple(rows)
            elif len(moved) > 1 and all(ratio.is_number and ratio.is_real for ratio in ratios):
                row = tuple((np.array([float(ratio) for ratio in ratios]) @ np.array(key)).tolist())
                others = {symbols[k]: sympy.Integer(0) for k in moved[1:]}
                key, term = (row,), term.xreplace({symbols[moved[0]]: self.input(row), **others})
            if moved:
                parts[key] = parts.get(key, 0) + term
        return parts

    def _read(self, element: Element) -> tuple[Any, bool]:
        """The expression of a text, and whether it is a function of w and its rate only."""
        import sympy

        place = element.place(self.coordinates)
        if element.called is not None:
            self.called.append(place)
            return element.called.symbol(*(self.input(element.row, k) for k in range(element.called.arguments))), True
        law = "potential" if isinstance(element, Spring) and element.potential else "force"
        what = f"the {law} of {place}"
        found = _CALLED.search(element.text)
        if found:
            raise _not_smooth(what, f"{found[1]}(..)")
        values = {sympy.Symbol(name): exact(value) for name, value in element.parameters.items()}
        try:
            expression = parsed(element.text, what, values, exact=True, largest_power=LARGEST_TEXT_POWER)
        except ExpressionError as error:
            raise InvalidSystem(str(error)) from None
        names: dict[str, Any] = {"pi": sympy.pi}
        own = ["w", "w_dot"] if isinstance(element, Damper) else ["w"]
        everywhere = not element.row or law == "force"
        rows = [(name, self.unit(k)) for k, name in enumerate(self.coordinates)] if everywhere else []
        rates = [(f"{name}_dot", row) for name, row in rows] if isinstance(element, Damper) else []
        known = [*(own if element.row else []), *(name for name, _ in (*rows, *rates)), *element.parameters]
        used = {symbol.name for symbol in expression.free_symbols}
        for name in sorted(used):
            if name not in known and name != "pi":
                near = get_close_matches(name, known, 1, 0.0)
                expected = "neither a coordinate nor a parameter" if everywhere else "neither w nor a parameter"
                raise InvalidSystem(f"{what} has the symbol {name}, which is {expected}; nearest: {near[0]}")
        names |= {name: self.input(row) for name, row in rows if name in used}
        names |= {name: self.input(row, 1) for name, row in rates if name in used}
        local = not any(name in used for name, _ in (*rows, *rates) if name not in own or not element.row)
        if element.row:
            names |= {name: self.input(element.row, k) for k, name in enumerate(own) if name in used}
        names |= {name: exact(value) for name, value in element.parameters.items() if name not in names}
        expression = expression.xreplace({symbol: names[symbol.name] for symbol in expression.free_symbols})
        if any(part.is_number and part.is_real is False for part in sympy.preorder_traversal(expression)):
            raise InvalidSystem(f"{what} has a number that is not real, or not finite; received {shown(element.text)}")
        part = why_not_smooth(expression)
        if part is not None:
            back = {symbol: sympy.Symbol(name) for name, symbol in names.items() if symbol in expression.free_symbols}
            raise _not_smooth(what, str(expression.xreplace(back)) if part.count("@") else part)
        return expression, local

    def _integrate(self, force: Any, symbol: Any, place: str) -> None:
        """Add the potential of a force along its input."""
        import sympy

        if not force.is_polynomial(symbol):
            self.unknown = self.unknown or f"the potential of {place} is not known; expected potential = .. in place of force = .."
        else:
            self.potential += sympy.integrate(sympy.expand(force), symbol)

    def _integrate_coupled(self) -> str | None:
        """Add the potential of the coordinates' forces, the integral of u . G(s u) over s from 0 to 1. Returns why there is none."""
        import sympy

        moved = [k for k, force in enumerate(self.coupled) if force != 0 or self.unit(k) + (0.0,) * len(self.coordinates) in self.symbols]
        symbols = [self.input(self.unit(k)) for k in moved]
        for i, a in enumerate(moved):
            for j, b in enumerate(moved[:i]):
                if not _vanishes(sympy.diff(self.coupled[a], symbols[j]) - sympy.diff(self.coupled[b], symbols[i])):
                    one, other = self.coordinates[b], self.coordinates[a]
                    return f"the springs have no potential: the force on {one} changes with {other} unlike that on {other} with {one}"
        work = sympy.expand(sum((x * self.coupled[k] for k, x in zip(moved, symbols, strict=True)), sympy.Integer(0)))
        if work == 0:
            return None
        if not work.is_polynomial(*symbols):
            names = ", ".join(self.coordinates[k] for k in moved)
            return f"the potential of the springs on {names} is not known; expected potential = .. in place of force = .."
        for powers, coefficient in sympy.Poly(work, *symbols).terms():
            self.potential += coefficient * sympy.Mul(*(x**p for x, p in zip(symbols, powers, strict=True))) / sum(powers)
        return None

    def result(self) -> SmoothForces | None:
        forces = {key: force for key, force in self.forces.items() if force != 0}
        if not forces:
            return None
        why = self._integrate_coupled() or self.unknown
        # A constant force has no input; its potential has one.
        seen = self.potential.free_symbols.union(*(force.free_symbols for force in forces.values()))
        inputs = {row: symbol for row, symbol in self.symbols.items() if symbol in seen}
        return SmoothForces(
            tuple(inputs.values()),
            np.array(list(inputs), dtype=float),
            tuple(forces.values()),
            np.array([direction for direction, _ in forces], dtype=float),
            None if why else self.potential,
            why,
            self.dissipative and f"{self.dissipative} loses energy",
            self.coordinates,
            tuple(damper for _, damper in forces),
            tuple(self.called),
        )


def _not_smooth(what: str, part: str) -> InvalidSystem:
    expected = "expected smooth functions: a contact is a table [[stops]], k |w|^p sign w has power = p"
    return InvalidSystem(f"{what} is not smooth, in {part}; {expected}")


def _at_rest(expression: Any, place: str) -> Any:
    """An expression where all inputs are 0."""
    import sympy

    value = expression.xreplace({symbol: sympy.Integer(0) for symbol in expression.free_symbols if symbol.name.startswith("@")})
    if value.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo, sympy.I):
        raise InvalidSystem(f"the force of {place} or its derivative is not finite at rest, where all coordinates are 0")
    return value


def _require_at_rest(forces: Sequence[Any], rates: Sequence[Any], place: str) -> None:
    """Refuse forces at rest, and those of dampers without speed."""
    import sympy

    for force in forces:
        value = _at_rest(force, place)
        if not _vanishes(value):
            raise InvalidSystem(f"the force of {place} is {value} at rest, expected 0: a constant load is a table [[forces]]")
        if rates and not _vanishes(force.xreplace({rate: sympy.Integer(0) for rate in rates})):
            raise InvalidSystem(f"the force of {place} is not 0 without speed, expected a force that a table [[springs]] adds")


def _without(force: Any, symbols: Sequence[Any], slopes: Sequence[Any], place: str) -> Any:
    """A force without its linear part. A term without one is left as it is written."""
    import sympy

    rest: Any = 0
    for term in sympy.Add.make_args(force):
        own = [_at_rest(term.diff(symbol), place) for symbol in symbols]
        line = sum((slope * symbol for slope, symbol in zip(own, symbols, strict=True)), sympy.Integer(0))
        slopes = [slope - taken for slope, taken in zip(slopes, own, strict=True)]
        if line != 0:
            term = sympy.expand(term - line) if term.is_polynomial(*symbols) else term - line
        rest += term
    # What the symmetric part of the stiffness has and the force has not, or the other way.
    return rest - sum((sympy.expand(slope) * symbol for slope, symbol in zip(slopes, symbols, strict=True)), sympy.Integer(0))


def _vanishes(expression: Any) -> bool:
    """Whether an expression is zero at all values of its symbols: after it is multiplied out, or at three points in thirty digits."""
    import sympy

    expanded = sympy.expand(expression)
    if expanded == 0:
        return True
    symbols = sorted(expanded.free_symbols, key=str)
    for point in range(1, 4):
        at = {symbol: sympy.Rational(point * (2 * k + 7), 13 + 3 * k) * (-1) ** (k + point) for k, symbol in enumerate(symbols)}
        parts = [plain_powers(part).xreplace(at).evalf(30) for part in sympy.Add.make_args(expanded)]
        if not abs(sum(parts)) <= 1e-20 * sum(map(abs, parts)):
            return False
    return True


@lru_cache(maxsize=64)
def _function(symbols: tuple[Any, ...], expression: Any) -> Callable[..., Any]:
    import sympy

    # With names of its own, numbered by the process, sympy would sort the terms of a sum differently each time.
    named = {symbol: sympy.Symbol(f"input_{k:03}", real=True) for k, symbol in enumerate(symbols)}
    plain = plain_powers(sympy.sympify(expression)).xreplace(named)
    calls = {part.func.__name__: part.func.called for part in plain.atoms(sympy.Function) if hasattr(part.func, "called")}
    return sympy.lambdify(list(named.values()), plain, [calls, "numpy"] if calls else "numpy", cse=True)
