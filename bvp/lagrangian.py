"""An impacting system from its energies: kinetic and potential energy, Rayleigh dissipation and gaps as expressions.

With T = v M v/2, V = u K u/2 and Rayleigh's D = v C v/2, Lagrange's equations d/dt dT/dv + dD/dv + dV/du = 0 are
M u'' + C u' + K u = 0. Each quadratic form is read off term by term, in exact rational arithmetic, and rounded once at the end.
Other smooth terms of V are the potential of a spring. What is not quadratic in T or D, or not linear in a gap, is refused and named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from bvp.checks import is_finite, real
from bvp.expressions import ExpressionError, is_plain, normalised, not_too_deep, parsed, require_small
from bvp.springs import Spring
from bvp.texts import shown

__all__ = ["LagrangianError", "parts_from_lagrangian"]


class LagrangianError(ValueError):
    """Energies, gaps or parameters that make no impacting system; the message is one line that names the term."""


@contextmanager
def _as_of_lagrangian() -> Iterator[None]:
    """Within it, an expression that cannot be read is an error of the energies or gaps."""
    try:
        with not_too_deep("an expression of the system"):
            yield
    except ExpressionError as error:
        raise LagrangianError(str(error)) from None


@_as_of_lagrangian()
def parts_from_lagrangian(
    kinetic: Any,
    potential: Any,
    coordinates: Sequence[Any],
    *,
    gaps: Sequence[Sequence[Any]] = (),
    dissipation: Any = 0,
    parameters: Mapping[Any, Any] | None = None,
    velocities: Sequence[Any] | None = None,
    time: Any = None,
    absorber: str | int | None = None,
    primary: str | int | None = None,
) -> dict[str, Any]:
    """The parts of the system M u'' + C u' + K u = 0 between stops, with springs that are not linear, that has the given energies.

    Expressions are sympy's or text. Text is read as arithmetic of numbers, names and `bvp.expressions.FUNCTIONS`, nothing else.

    Parameters
    ----------
    kinetic, potential
        T, quadratic in the velocities with constant coefficients, and V, smooth in the coordinates. Its linear terms are constant loads.
        Constants are ignored.
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
        The arguments of `bvp.system.ImpactSystem`; each stop as (row, lower, upper, restitution). ``springs`` are there if V has terms
        that are not quadratic.

    Raises
    ------
    LagrangianError
        For a term that is not quadratic (T, D), smooth (V) or linear (gaps), a symbol without a value, text that cannot be read.

    Examples
    --------
    >>> parts = parts_from_lagrangian(
    ...     "mu*u1_dot**2/2 + u2_dot**2/2", "u2**2/2 + sigma*(u1 - u2)**2/2", ["u1", "u2"],
    ...     gaps=[("u1 - u2", -1, 1)], parameters={"mu": 0.1, "sigma": 0.1})
    >>> parts["stiffness"].tolist(), parts["stops"]
    ([[0.1, -0.1], [-0.1, 1.1]], [((1.0, -1.0), -1.0, 1.0, 1.0)])
    """
    names = _Names(coordinates, velocities, time, parameters)
    mass = _form(names, kinetic, "the kinetic energy", "velocities")
    quadratic, others = _split(names, potential, "the potential energy")
    stiffness = _form(names, quadratic, "the potential energy", "coordinates")
    damping = _form(names, dissipation, "the dissipation", "velocities")
    stops = []
    for k, gap in enumerate(_listed(gaps, "gaps is a list of (expression, lower, upper, restitution)")):
        what = f"gap {k + 1}"
        gap = _listed(gap, f"{what} is (expression, lower, upper), with a restitution if it is not 1", (3, 4))
        row, constant = [0.0] * len(names.coordinates), 0
        for powers, coefficient in _coefficients(names, gap[0], what, "coordinates", "linear"):
            if any(powers):
                row[powers.index(1)] = float(coefficient)
            else:
                constant = coefficient
        if not any(row):
            raise LagrangianError(f"{what} ({gap[0]}) contains no coordinate, expected one that moves towards a stop")
        lower = -math.inf if gap[1] is None else _value(names, gap[1], f"the lower bound of {what}")
        upper = math.inf if gap[2] is None else _value(names, gap[2], f"the upper bound of {what}")
        restitution = float(_value(names, gap[3], f"the restitution of {what}")) if len(gap) == 4 else 1.0
        stops.append((tuple(row), float(lower - constant), float(upper - constant), restitution))
    return {
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "stops": stops,
        "coordinates": names.coordinates,
        "absorber": absorber,
        "primary": primary,
        **({"springs": (_spring(names, others),)} if others else {}),
    }


def _listed(value: Any, expected: str, lengths: Sequence[int] = ()) -> Sequence[Any]:
    """A list, of one of the lengths if any are given."""
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence) or (lengths and len(value) not in lengths):
        raise LagrangianError(f"{expected}; received {shown(value)}")
    return value


class _Names:
    """The meaning of the symbols in the expressions: coordinates, velocities, parameters with exact values."""

    def __init__(self, coordinates: Any, velocities: Any, time: Any, parameters: Mapping[Any, Any] | None):
        import sympy
        from sympy.core.function import AppliedUndef

        if not _listed(coordinates, "coordinates is a list of at least one name or symbol"):
            raise LagrangianError("coordinates is a list of at least one name or symbol; received none")
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
        _listed(velocities, f"velocities is a list of {len(dotted)} names or symbols", (len(dotted),))
        derivatives = {item: name for item, name in zip(velocities, dotted, strict=True) if isinstance(item, sympy.Derivative)}
        self.velocities = tuple(derivatives[item] if item in derivatives else _name(item, "velocity") for item in velocities)
        # derivatives first: replacing the functions inside them would leave derivatives of symbols
        self.replacements = (
            {item: sympy.Symbol(name) for item, name in derivatives.items()},
            {item: sympy.Symbol(item.func.__name__) for item in functions},
        )
        self.values = {_name(key, "parameter"): _exact(value, f"parameter {key}") for key, value in (parameters or {}).items()}
        self.symbol_values = {sympy.Symbol(name): value for name, value in self.values.items()}
        known = [*self.coordinates, *self.velocities, *self.values]
        double = sorted({name for name in known if known.count(name) > 1})
        if double:
            raise LagrangianError(f"the name {double[0]} is given twice among coordinates, velocities and parameters")

    def read(self, expression: Any, what: str, allowed: Sequence[str], *, as_written: bool = False) -> Any:
        """The expression in plain symbols, each of which is among the allowed names or a parameter with a value; multiplied out, if it is
        not wanted as it is written."""
        import sympy
        from sympy.core.function import AppliedUndef

        if isinstance(expression, str):
            expression = parsed(expression, what, self.symbol_values)
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
        described = ", ".join([*self.coordinates, *self.velocities])
        unknown = sorted(map(str, expression.atoms(sympy.Derivative) or expression.atoms(AppliedUndef)))
        if unknown:
            raise LagrangianError(f"{what} has {unknown[0]}, which is neither a coordinate nor a velocity ({described})")
        expression = expression.xreplace({symbol: sympy.Symbol(symbol.name) for symbol in expression.free_symbols})
        require_small(expression, what, self.symbol_values)
        written, expression = expression, sympy.expand(expression)
        for name in sorted({symbol.name for symbol in expression.free_symbols} - {*self.values, *allowed}):
            if name in self.coordinates or name in self.velocities:
                kind = "coordinate" if name in self.coordinates else "velocity"
                term = next(term for term in sympy.Add.make_args(expression) if sympy.Symbol(name) in term.free_symbols)
                only = ", ".join(allowed) or "numbers"
                raise LagrangianError(f"{what} has the {kind} {name} in the term {term}, expected {only} and parameters only")
            if name == self.time:
                raise LagrangianError(f"{what} depends on the time {name}, expected constant coefficients")
            close = get_close_matches(name, [*allowed, *self.values], n=1)
            raise LagrangianError(
                f"{what} has the symbol {name}, which is neither a coordinate nor a velocity ({described}) "
                f"and has no value in parameters{f'; the nearest known is {close[0]}' if close else ''}"
            )
        return written if as_written else expression

    def substitute(self, expression: Any) -> Any:
        """The expression with the parameters' exact values and exact rationals for its decimal numbers."""
        import sympy

        expression = expression.xreplace(self.symbol_values)
        return expression.xreplace({number: sympy.Rational(number) for number in expression.atoms(sympy.Float)})


def _split(names: _Names, expression: Any, what: str) -> tuple[Any, list[Any]]:
    """The terms of a potential that are polynomials up to the second degree, and the others, as they are written."""
    import sympy

    from bvp.smooth_forces import why_not_smooth

    symbols = [sympy.Symbol(name) for name in names.coordinates]
    at_rest = dict.fromkeys(symbols, sympy.Integer(0))
    low: list[tuple[Any, bool]] = []
    others: list[Any] = []
    for term in sympy.Add.make_args(names.read(expression, what, names.coordinates, as_written=True)):
        valued = sympy.expand(names.substitute(term))
        degrees = {sum(powers) for powers in sympy.Poly(valued, *symbols).monoms()} if valued.is_polynomial(*symbols) else {3}
        if max(degrees) <= 2:
            low.append((term, 1 in degrees))
            continue
        part = why_not_smooth(valued.xreplace({symbol: sympy.Symbol(symbol.name, real=True) for symbol in symbols}))
        if part is not None:
            raise LagrangianError(f"{what} has the term {term}, which is not smooth in {part}; expected a smooth potential and gaps")
        rest = [valued.diff(symbol).xreplace(at_rest) for symbol in symbols]
        if any(value.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo, sympy.I) for value in rest):
            raise LagrangianError(f"{what} has the term {term}, whose force is not finite where all coordinates are 0")
        others.append(term)
    forces = [sum(sympy.expand(names.substitute(term)).diff(symbol).xreplace(at_rest) for term, _ in low) for symbol in symbols]
    if others or any(force != 0 for force in forces):  # a linear term can balance others at rest, or is a constant load
        others += [term for term, pulls in low if pulls]
        low = [(term, pulls) for term, pulls in low if not pulls]
    return sympy.Add(*(term for term, _ in low)), others


def _spring(names: _Names, terms: Sequence[Any]) -> Spring:
    """The spring of all coordinates with terms of the potential. Its text has the parameters by their names."""
    import sympy

    potential = sympy.Add(*terms)
    # The shortest decimals are the same floats.
    numbers = {number: sympy.Rational(repr(float(number))) for number in potential.atoms(sympy.Float)}
    used = {symbol.name for symbol in potential.free_symbols}
    for name in sorted(used):
        if not is_plain(name):
            raise LagrangianError(f"{name} cannot be named in a potential that is not quadratic; expected letters, digits and _")
    values = {name: float(value) for name, value in names.values.items() if name in used}
    return Spring(potential=str(potential.xreplace(numbers)), parameters=values)


def _form(names: _Names, expression: Any, what: str, kind: str) -> Any:
    """The matrix A of a form x A x/2; x the coordinates or velocities, all terms but constants quadratic."""
    import numpy as np

    size = len(names.coordinates)
    matrix = np.zeros((size, size))
    for powers, coefficient in _coefficients(names, expression, what, kind, "quadratic"):
        if any(powers):
            i, j = [k for k, power in enumerate(powers) for _ in range(power)]
            matrix[i, j] = matrix[j, i] = _exact(coefficient * (2 if i == j else 1), f"a coefficient of {what}")
    return matrix


def _coefficients(names: _Names, expression: Any, what: str, kind: str, degree: str) -> list[tuple[tuple[int, ...], Any]]:
    """Powers and exact coefficient (not zero) of each monomial of an expression that is linear or quadratic."""
    import sympy

    variables = getattr(names, kind)
    symbols = [sympy.Symbol(name) for name in variables]
    collected: dict[tuple[int, ...], list[Any]] = {}
    for term in sympy.Add.make_args(names.read(expression, what, variables)):
        valued = term
        if not term.is_polynomial(*symbols):
            valued = sympy.expand(names.substitute(term))  # a power may be a parameter, a coefficient may be zero
        if not valued.is_polynomial(*symbols):
            raise LagrangianError(f"{what} has the term {term}, which is not {degree} in the {kind}")
        for powers, coefficient in sympy.Poly(valued, *symbols).terms():
            collected.setdefault(powers, []).append(coefficient)
    found = []
    for powers, coefficients in collected.items():
        coefficient = sympy.Add(*coefficients)
        value = _exact(names.substitute(coefficient), f"the coefficient {shown(coefficient)} of {what}")
        if value == 0:
            continue
        if sum(powers) not in ((0, 1) if degree == "linear" else (0, 2)):
            term = coefficient * sympy.Mul(*(symbol**power for symbol, power in zip(symbols, powers, strict=True)))
            raise LagrangianError(f"{what} has the term {term}, which is not {degree} in the {kind}")
        found.append((powers, value))
    return found


def _value(names: _Names, expression: Any, what: str) -> Any:
    """A bound or restitution as an exact number, or as a float where it is infinite."""
    import sympy

    if expression in (math.inf, -math.inf, sympy.oo, -sympy.oo):
        return float(expression)
    return _exact(names.substitute(names.read(expression, what, ())), what)


def _name(item: Any, what: str) -> str:
    """The name of a coordinate, velocity or parameter given as text or symbol."""
    import sympy

    name = item.name if isinstance(item, sympy.Symbol) else item
    if not isinstance(name, str) or (isinstance(item, str) and not is_plain(name)):
        raise LagrangianError(f"{what} {shown(item)} is neither a name nor a symbol")
    return normalised(name) if isinstance(item, str) else name


def _exact(value: Any, what: str) -> Any:
    """A finite real number as an exact rational."""
    import sympy

    if not is_finite(value):
        raise LagrangianError(f"{what} is a finite real number; received {shown(value)}")
    return sympy.Rational(value if isinstance(value, (int, sympy.Rational)) else real(value))
