"""A linear impacting system from its energies: kinetic and potential energy, Rayleigh dissipation and gaps as expressions.

With T = v M v/2, V = u K u/2 and Rayleigh's D = v C v/2, Lagrange's equations d/dt dT/dv + dD/dv + dV/du = 0 are
M u'' + C u' + K u = 0. Each quadratic form is read off term by term, in exact rational arithmetic, and rounded once at the end.
What is not quadratic (or, in a gap, not linear) is refused and named; nothing is linearised.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from bvp.checks import real
from bvp.expressions import LagrangianError, TooLarge, is_plain_name, limited, parse_expression, require_small
from bvp.texts import shown

__all__ = ["LagrangianError", "parts_from_lagrangian"]


def parts_from_lagrangian(
    kinetic: Any,
    potential: Any,
    coordinates: Sequence[Any],
    *,
    gaps: Sequence[Sequence[Any]],
    dissipation: Any = 0,
    parameters: Mapping[Any, Any] | None = None,
    velocities: Sequence[Any] | None = None,
    time: Any = None,
    absorber: str | int | None = None,
    primary: str | int | None = None,
) -> dict[str, Any]:
    """The parts of the linear system M u'' + C u' + K u = 0 between stops that has the given energies.

    Expressions are sympy's or text. Text is read as arithmetic of numbers, names and `bvp.expressions.FUNCTIONS`, nothing else.

    Parameters
    ----------
    kinetic, potential
        T, quadratic in the velocities with constant coefficients, and V, quadratic in the coordinates. Constants are ignored.
    coordinates
        n names, sympy symbols, or functions of time such as those of `sympy.physics.mechanics.dynamicsymbols`.
    gaps
        For each stop (expression, lower, upper) or (expression, lower, upper, restitution): the gap coordinate, linear in the
        coordinates, and its bounds, None where there is none. Bounds and restitution may contain parameters. A constant in the
        expression is moved into the bounds. The restitution is 1 where it is left out.
    dissipation
        Rayleigh's D, quadratic in the velocities; half the power lost.
    parameters
        Values of the other symbols, by name or symbol.
    velocities
        n names or symbols; by default the coordinates' derivatives if these are functions of time, else `u1_dot` for `u1`. In
        text the derivative of a function u1(t) is `u1_dot` too.
    time
        The symbol of time, by default the argument of the coordinates that are functions.
    absorber, primary
        Name or index of the coordinate of the nonlinear energy sink and of the linear oscillator, where the system has them.

    Returns
    -------
    dict
        The arguments of `bvp.system.ImpactSystem`; each stop as (row, lower, upper, restitution).

    Raises
    ------
    LagrangianError
        For a term that is not quadratic (energies) or linear (gaps), a symbol without a value, text that cannot be read.

    Examples
    --------
    >>> parts = parts_from_lagrangian(
    ...     "mu*u1_dot**2/2 + u2_dot**2/2", "u2**2/2 + sigma*(u1 - u2)**2/2", ["u1", "u2"],
    ...     gaps=[("u1 - u2", -1, 1)], parameters={"mu": 0.1, "sigma": 0.1})
    >>> parts["stiffness"].tolist(), parts["stops"]
    ([[0.1, -0.1], [-0.1, 1.1]], [((1.0, -1.0), -1.0, 1.0, 1.0)])
    """
    with limited("an expression of the system"):
        return _system(_Names(coordinates, velocities, time, parameters), kinetic, potential, dissipation, gaps, absorber, primary)


def _system(
    names: _Names, kinetic: Any, potential: Any, dissipation: Any, gaps: Sequence[Sequence[Any]], absorber: Any, primary: Any
) -> dict[str, Any]:
    """The parts; arguments as those of `parts_from_lagrangian`."""
    import numpy as np

    mass = _quadratic(names, kinetic, "the kinetic energy", "velocities")
    stiffness = _quadratic(names, potential, "the potential energy", "coordinates")
    damping = _quadratic(names, dissipation, "the dissipation", "velocities")
    if isinstance(gaps, (str, bytes)) or not isinstance(gaps, Sequence):
        raise LagrangianError(f"gaps is a list of (expression, lower, upper, restitution); received {shown(gaps)}")
    stops = []
    for k, gap in enumerate(gaps):
        what = f"gap {k + 1}"
        if isinstance(gap, (str, bytes)) or not isinstance(gap, Sequence) or len(gap) not in (3, 4):
            raise LagrangianError(f"{what} is (expression, lower, upper), with a restitution if it is not 1; received {shown(gap)}")
        row, constant = _linear(names, gap[0], what)
        bounds = [
            float(side) if isinstance(side, float) else float(side - constant)
            for side in (
                -math.inf if gap[1] is None else _value(names, gap[1], f"the lower bound of {what}"),
                math.inf if gap[2] is None else _value(names, gap[2], f"the upper bound of {what}"),
            )
        ]
        restitution = float(_value(names, gap[3], f"the restitution of {what}")) if len(gap) == 4 else 1.0
        stops.append((row, bounds[0], bounds[1], restitution))
    places = [names.index(place, what) for place, what in ((absorber, "absorber"), (primary, "primary"))]
    return {
        "mass": np.array(mass, dtype=float),
        "damping": np.array(damping, dtype=float),
        "stiffness": np.array(stiffness, dtype=float),
        "stops": stops,
        "coordinates": names.coordinates,
        "absorber": places[0],
        "primary": places[1],
    }


class _Names:
    """The meaning of the symbols in the expressions: coordinates, velocities, parameters with exact values."""

    def __init__(self, coordinates: Any, velocities: Any, time: Any, parameters: Mapping[Any, Any] | None):
        import sympy
        from sympy.core.function import AppliedUndef

        if isinstance(coordinates, (str, bytes)) or not isinstance(coordinates, Sequence) or not coordinates:
            raise LagrangianError(f"coordinates is a list of at least one name or symbol; received {shown(coordinates)}")
        functions = [item for item in coordinates if isinstance(item, AppliedUndef)]
        for item in functions:
            if len(item.args) != 1 or not item.args[0].is_Symbol:
                raise LagrangianError(f"coordinate {item} is neither a name, a symbol nor a function of time")
        times = {item.args[0] for item in functions} | ({time} if isinstance(time, sympy.Symbol) else set())
        if len(times) > 1:
            raise LagrangianError(f"coordinates depend on {' and '.join(sorted(map(str, times)))}, expected one time")
        self.time = str(time if time is not None else next(iter(times), "t"))
        self.coordinates = tuple(item.func.__name__ if item in functions else _name(item, "coordinate") for item in coordinates)
        dotted = [f"{name}_dot" for name in self.coordinates]
        if velocities is None:
            velocities = [item.diff() if item in functions else name for item, name in zip(coordinates, dotted, strict=True)]
        if isinstance(velocities, (str, bytes)) or not isinstance(velocities, Sequence) or len(velocities) != len(dotted):
            raise LagrangianError(f"velocities is a list of {len(dotted)} names or symbols; received {shown(velocities)}")
        derivatives = {item: name for item, name in zip(velocities, dotted, strict=True) if isinstance(item, sympy.Derivative)}
        self.velocities = tuple(derivatives[item] if item in derivatives else _name(item, "velocity") for item in velocities)
        # derivatives first: replacing the functions inside them would leave derivatives of symbols
        self.replacements = (
            {item: sympy.Symbol(name) for item, name in derivatives.items()},
            {item: sympy.Symbol(item.func.__name__) for item in functions},
        )
        self.values = {_name(key, "parameter"): _exact(value, f"parameter {key}") for key, value in (parameters or {}).items()}
        known = [*self.coordinates, *self.velocities, *self.values]
        double = sorted({name for name in known if known.count(name) > 1})
        if double:
            raise LagrangianError(f"the name {double[0]} is given twice among coordinates, velocities and parameters")

    def index(self, place: str | int | None, what: str) -> int | None:
        """The index of a coordinate given by name."""
        if not isinstance(place, str):
            return place
        if place not in self.coordinates:
            raise LagrangianError(f"{what} {shown(place)} is none of the coordinates {', '.join(self.coordinates)}")
        return self.coordinates.index(place)

    def read(self, expression: Any, what: str, allowed: Sequence[str]) -> Any:
        """The expression in plain symbols, each of which is among the allowed names or a parameter with a value."""
        import sympy
        from sympy.core.function import AppliedUndef

        if isinstance(expression, str):
            expression = parse_expression(expression, what)
        try:
            expression = sympy.sympify(expression, strict=True)
        except sympy.SympifyError:
            raise LagrangianError(f"{what} is neither an expression, text nor a number; received {shown(expression)}") from None
        if not isinstance(expression, sympy.Expr):
            raise LagrangianError(f"{what} is not an expression; received {expression}")
        if expression.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo, sympy.I):
            raise LagrangianError(f"{what} is not a finite real expression; received {expression}")
        for replacements in self.replacements:
            expression = expression.xreplace(replacements)
        unknown = sorted(map(str, expression.atoms(sympy.Derivative) or expression.atoms(AppliedUndef)))
        if unknown:
            raise LagrangianError(f"{what} has {unknown[0]}, which is neither a coordinate nor a velocity ({self.described()})")
        plain = {symbol: sympy.Symbol(symbol.name) for symbol in expression.free_symbols}
        try:
            require_small(expression, self.values)
        except TooLarge as error:
            raise LagrangianError(f"{what} is too large: {error}") from None
        expression = sympy.expand(expression.xreplace(plain))
        for name in sorted(symbol.name for symbol in expression.free_symbols):
            if name in self.values or name in allowed:
                continue
            if name in self.coordinates or name in self.velocities:
                kind = "coordinate" if name in self.coordinates else "velocity"
                term = next(term for term in sympy.Add.make_args(expression) if sympy.Symbol(name) in term.free_symbols)
                only = "numbers and parameters" if not allowed else f"{', '.join(allowed)} and parameters"
                raise LagrangianError(f"{what} has the {kind} {name} in the term {term}, expected {only} only")
            if name == self.time:
                raise LagrangianError(f"{what} depends on the time {name}, expected constant coefficients")
            close = get_close_matches(name, [*allowed, *self.values], n=1)
            raise LagrangianError(
                f"{what} has the symbol {name}, which is neither a coordinate nor a velocity ({self.described()}) "
                f"and has no value in parameters{f'; the nearest known is {close[0]}' if close else ''}"
            )
        return expression

    def described(self) -> str:
        return ", ".join([*self.coordinates, *self.velocities])

    def substitute(self, expression: Any) -> Any:
        """The expression with the parameters' exact values and exact rationals for its decimal numbers."""
        import sympy

        expression = expression.xreplace({sympy.Symbol(name): value for name, value in self.values.items()})
        return expression.xreplace({number: sympy.Rational(number) for number in expression.atoms(sympy.Float)})


def _quadratic(names: _Names, expression: Any, what: str, kind: str) -> list[list[Any]]:
    """The matrix A of a form x A x/2, exact numbers; x the coordinates or velocities, all terms but constants quadratic."""
    variables = getattr(names, kind)
    matrix: list[list[Any]] = [[0] * len(variables) for _ in variables]
    for powers, coefficient, term in _monomials(names, expression, what, variables, f"quadratic in the {kind}"):
        if sum(powers) == 0:
            continue
        if sum(powers) != 2:
            load = ", a constant load" if kind == "coordinates" and sum(powers) == 1 else ""
            raise LagrangianError(f"{what} has the term {term}{load}, which is not quadratic in the {kind}")
        i, j = [k for k, power in enumerate(powers) for _ in range(power)]
        matrix[i][j] += coefficient
        matrix[j][i] += coefficient
    return matrix


def _linear(names: _Names, expression: Any, what: str) -> tuple[tuple[float, ...], Any]:
    """The row c and the constant of a gap c . u + constant."""
    row: list[Any] = [0] * len(names.coordinates)
    constant: Any = 0
    for powers, coefficient, term in _monomials(names, expression, what, names.coordinates, "linear in the coordinates"):
        if sum(powers) > 1:
            raise LagrangianError(f"{what} has the term {term}, which is not linear in the coordinates")
        if sum(powers) == 0:
            constant += coefficient
        else:
            row[powers.index(1)] += coefficient
    if not any(row):
        raise LagrangianError(f"{what} ({expression}) contains no coordinate, expected one that moves towards a stop")
    return tuple(float(value) for value in row), constant


def _monomials(
    names: _Names, expression: Any, what: str, variables: Sequence[str], wanted: str
) -> list[tuple[tuple[int, ...], Any, Any]]:
    """Powers, exact coefficient (not zero) and the term as it was written, of each monomial in the variables."""
    import sympy

    symbols = [sympy.Symbol(name) for name in variables]
    collected: dict[tuple[int, ...], Any] = {}
    for term in sympy.Add.make_args(names.read(expression, what, variables)):
        if not term.is_polynomial(*symbols):
            valued = sympy.expand(names.substitute(term))  # a power may be a parameter, a coefficient may be zero
            if not valued.is_polynomial(*symbols):
                raise LagrangianError(f"{what} has the term {term}, which is not {wanted}")
            term = valued
        for powers, coefficient in sympy.Poly(term, *symbols).terms():
            collected[powers] = collected.get(powers, 0) + coefficient
    found = []
    for powers, coefficient in collected.items():
        value = names.substitute(coefficient)
        term = coefficient * sympy.Mul(*(symbol**power for symbol, power in zip(symbols, powers, strict=True)))
        if not value.is_Rational:
            value = sympy.Rational(_finite(value, f"the coefficient {coefficient} of {what}"))
        if value != 0:
            found.append((powers, value, term))
    return found


def _value(names: _Names, expression: Any, what: str) -> Any:
    """A bound or restitution as an exact number, or as a float where it is infinite."""
    import sympy

    if isinstance(expression, (int, float)) and not isinstance(expression, bool) and math.isinf(expression):
        return float(expression)
    if expression in (sympy.oo, -sympy.oo):
        return float(expression)
    return _exact(names.substitute(names.read(expression, what, ())), what)


def _name(item: Any, what: str) -> str:
    """The name of a coordinate, velocity or parameter given as text or symbol."""
    import sympy

    name = item.name if isinstance(item, sympy.Symbol) else item
    if not isinstance(name, str) or (isinstance(item, str) and not is_plain_name(name)):
        raise LagrangianError(f"{what} {shown(item)} is neither a name nor a symbol")
    return name


def _exact(value: Any, what: str) -> Any:
    """A finite real number as an exact rational."""
    import sympy

    if isinstance(value, sympy.Rational):
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        return sympy.Integer(value)
    return sympy.Rational(_finite(value, what))


def _finite(value: Any, what: str) -> float:
    try:
        number = real(value)
    except (TypeError, ValueError):
        raise LagrangianError(f"{what} is a finite real number; received {shown(value)}") from None
    if not math.isfinite(number):
        raise LagrangianError(f"{what} is a finite real number; received {value}")
    return number
