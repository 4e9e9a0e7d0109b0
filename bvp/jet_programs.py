"""Programs that compute the Taylor coefficients of smooth forces along a motion (`bvp.kernels.jets`), from expressions of their inputs.

The forces, their derivatives by the inputs, and those by parameters are written into one program. What several of them share is computed
once: common subexpressions, and the products of integer powers, of which a lower one is a step on the way to a higher one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from bvp.expressions import FUNCTIONS, ExpressionError, not_too_deep
from bvp.kernels import jets as kernels
from bvp.kernels.expressions import Program
from bvp.kernels.jets import JetProgram
from bvp.programs import derivative, evaluate_program, program_of

__all__ = ["even_power", "jet_program", "plain_jet_program", "plain_powers", "signed_power"]

TINY = 1e-300
"""Added to a power, or to a modulus, before its logarithm is taken: a power that is left out as too small is 0."""

"""What a program has that calls no Python function."""


def jet_program(
    forces: Sequence[Any],
    inputs: Sequence[Any],
    parameters: Sequence[Any] = (),
    values: Sequence[float] = (),
    *,
    changes: bool = True,
) -> tuple[JetProgram, Program]:
    """The program that computes the jets of forces, of their derivatives by the inputs, and of those by parameters.

    Parameters
    ----------
    forces : sequence of F sympy expressions
        Of sums, products, powers, `signed_power`, `even_power`, exp, log, sin, cos, tan, sinh, cosh and tanh.
    inputs : sequence of I sympy symbols
        At least one.
    parameters : sequence of P sympy symbols
        Released parameters. A coefficient, and the exponent of a power, can depend on them.
    values : sequence of P floats
        Values of the parameters, for the numbers of the program.
    changes : bool
        Whether derivatives by the parameters are computed.

    Returns
    -------
    program : JetProgram
        Its `numbers` (S,) are those at the values.
    numbers : Program
        Computes `numbers` from other values of the parameters: the program with them needs no compilation.

    Raises
    ------
    ExpressionError
        For a symbol that is neither input nor parameter, and for a function that is none of these.

    Examples
    --------
    >>> import sympy
    >>> w, k = sympy.symbols("w k", real=True)
    >>> program, numbers = jet_program([k * w**21], [w], [k], [2.0])
    >>> len(program.code), program.registers, program.numbers.tolist(), program.slopes[:, :2].tolist()
    (8, 9, [2.0, 42.0], [[0, 0]])
    >>> evaluate_program(numbers, [3.0]).tolist()
    [3.0, 63.0]
    """
    import sympy

    if not inputs:
        raise ExpressionError("smooth forces have at least one input; received none")
    forces = [sympy.sympify(force) for force in forces]
    for k, force in enumerate(forces, 1):
        unknown = sorted(map(str, force.free_symbols - {*inputs, *parameters}))
        if unknown:
            known = ", ".join(map(str, [*inputs, *parameters]))
            raise ExpressionError(f"force {k} has the symbol {unknown[0]}, which is neither an input nor a parameter ({known})")
    with not_too_deep("a force"):
        slopes = _derivatives(forces, inputs)
        moved = _derivatives(forces, parameters) if changes else []
        wanted = [*forces, *(slope for _, _, slope in slopes), *(change for _, _, change in moved)]
        writer = _Writer(inputs)
        registers = writer.write(wanted)
    numbers = program_of(list(writer.numbers), parameters)
    kept = [(row, column, register) for (row, column, _), register in zip([*slopes, *moved], registers[len(forces) :], strict=True)]
    program = JetProgram(
        np.array(writer.code, dtype=np.int64).reshape(-1, 4),
        evaluate_program(numbers, values),
        np.array(registers[: len(forces)], dtype=np.int64),
        np.array(kept[: len(slopes)], dtype=np.int64).reshape(-1, 3),
        np.array(kept[len(slopes) :], dtype=np.int64).reshape(-1, 3),
        writer.registers,
    )
    return program, numbers


def plain_jet_program(
    forces: tuple[Any, ...], inputs: tuple[Any, ...], parameters: tuple[Any, ...] = (), values: tuple[float, ...] = ()
) -> JetProgram:
    """The program of forces at values of their parameters, without derivatives by these.

    Forces that differ in the exponents of `signed_power` and `even_power`, or in the values, have one program with other numbers, which is
    made once.

    Examples
    --------
    >>> import sympy
    >>> w = sympy.Symbol("w", real=True)
    >>> first, second = (plain_jet_program((signed_power(w, p),), (w,)) for p in (2.5, 4.25))
    >>> first.code is second.code, first.numbers.tolist(), second.numbers.tolist()
    (True, [1.5, 2.5], [3.25, 4.25])
    """
    named, exponents = _with_named_exponents(forces)
    program, numbers = _made_once(named, inputs, (*_exponents(len(exponents)), *parameters))
    return program._replace(numbers=evaluate_program(numbers, [*exponents, *values]))


@lru_cache(maxsize=64)
def _with_named_exponents(forces: tuple[Any, ...]) -> tuple[tuple[Any, ...], list[float]]:
    """Forces with symbols for the numbers in the exponents of `signed_power` and `even_power`, and these numbers."""
    powers = {power for force in forces for power in force.atoms(*_powers()[:2]) if power.args[1].is_number}
    values = sorted({power.args[1] for power in powers}, key=float)
    symbols = dict(zip(values, _exponents(len(values)), strict=True))
    named = {power: power.func(power.args[0], symbols[power.args[1]]) for power in powers}
    return tuple(force.xreplace(named) for force in forces), [float(value) for value in values]


@cache
def _exponents(count: int) -> tuple[Any, ...]:
    """Symbols that stand for exponents. No input and no parameter has such a name."""
    import sympy

    return tuple(sympy.Symbol(f"^{k}", real=True) for k in range(count))


@lru_cache(maxsize=64)
def _made_once(forces: tuple[Any, ...], inputs: tuple[Any, ...], symbols: tuple[Any, ...]) -> tuple[JetProgram, Program]:
    return jet_program(forces, inputs, symbols, [2.5] * len(symbols), changes=False)


def signed_power(base: Any, exponent: Any) -> Any:
    """The expression |w|^p sign w. For an odd integer p it is w^p.

    Examples
    --------
    >>> import sympy
    >>> w, p = sympy.symbols("w p", real=True)
    >>> signed_power(w, 3), signed_power(w, p).diff(w), signed_power(-w, p)
    (w**3, p*EvenPower(w, p - 1), -SignedPower(w, p))
    """
    return _powers()[0](base, exponent)


def even_power(base: Any, exponent: Any) -> Any:
    """The expression |w|^p. For an even integer p it is w^p."""
    return _powers()[1](base, exponent)


def plain_powers(expression: Any) -> Any:
    """An expression with powers of moduli in place of `signed_power` and `even_power`: what computes values, not jets, knows these.

    Examples
    --------
    >>> import sympy
    >>> w = sympy.Symbol("w", real=True)
    >>> plain_powers(signed_power(w, 2.5))
    Abs(w)**2.5*sign(w)
    """
    import sympy

    signed, even, signed_log, even_log = _powers()
    expression = expression.replace(signed, lambda w, p: sympy.sign(w) * sympy.Abs(w) ** p).replace(even, lambda w, p: sympy.Abs(w) ** p)
    expression = expression.replace(signed_log, lambda w, p, k: sympy.sign(w) * sympy.Abs(w) ** p * sympy.log(sympy.Abs(w) + TINY) ** k)
    return expression.replace(even_log, lambda w, p, k: sympy.Abs(w) ** p * sympy.log(sympy.Abs(w) + TINY) ** k)


@cache
def _powers() -> tuple[Any, Any, Any, Any]:
    """The functions |w|^p sign w, |w|^p, and both times (log |w|)^k."""
    import sympy

    class SignedPower(sympy.Function):
        @classmethod
        def eval(cls, base: Any, exponent: Any) -> Any:
            p = _integer(exponent)
            if p is not None and p % 2 == 1:
                return base**p
            return -cls(-base, exponent) if (-base).is_Symbol else None

        def fdiff(self, argindex: int = 1) -> Any:
            base, exponent = _arguments(self)
            return exponent * EvenPower(base, exponent - 1) if argindex == 1 else SignedLogarithm(base, exponent, 1)

    class EvenPower(sympy.Function):
        @classmethod
        def eval(cls, base: Any, exponent: Any) -> Any:
            p = _integer(exponent)
            if p is not None and p % 2 == 0:
                return base**p
            return cls(-base, exponent) if (-base).is_Symbol else None

        def fdiff(self, argindex: int = 1) -> Any:
            base, exponent = _arguments(self)
            return exponent * SignedPower(base, exponent - 1) if argindex == 1 else EvenLogarithm(base, exponent, 1)

    class Logarithm(sympy.Function):
        """A power times (log |w|)^k. plain: the power; other: the class of its derivative by w."""

        plain: Any
        other: Any

        @classmethod
        def eval(cls, base: Any, exponent: Any, power: Any) -> Any:
            return cls.plain(base, exponent) if power == 0 else None

        def fdiff(self, argindex: int = 1) -> Any:
            base, exponent, power = _arguments(self)
            if argindex == 2:
                return type(self)(base, exponent, power + 1)
            return exponent * self.other(base, exponent - 1, power) + power * self.other(base, exponent - 1, power - 1)

    class SignedLogarithm(Logarithm):
        plain = SignedPower

    class EvenLogarithm(Logarithm):
        plain = EvenPower

    SignedLogarithm.other, EvenLogarithm.other = EvenLogarithm, SignedLogarithm
    return SignedPower, EvenPower, SignedLogarithm, EvenLogarithm


def _arguments(function: Any) -> tuple[Any, ...]:
    """The arguments of a function of sympy, without the types that one version of sympy gives them."""
    return tuple(function.args)


def _integer(exponent: Any) -> int | None:
    """An exponent as an integer, if it is one; a float such as 3.0 too."""
    return int(exponent) if exponent.is_number and exponent.is_finite and float(exponent).is_integer() else None


def _derivatives(forces: Sequence[Any], symbols: Sequence[Any]) -> list[tuple[int, int, Any]]:
    """Force, symbol and derivative of one by the other, where it is not zero."""
    found = []
    for row, force in enumerate(forces):
        for column, symbol in enumerate(symbols):
            if symbol in force.free_symbols:
                slope = derivative(force, symbol)
                if slope != 0:
                    found.append((row, column, slope))
    return found


class _Writer:
    """Writes the operations of a program."""

    def __init__(self, inputs: Sequence[Any]):
        self.known: dict[Any, int] = {symbol: k for k, symbol in enumerate(inputs)}
        self.registers = len(inputs)
        self.code: list[tuple[int, int, int, int]] = []
        self.numbers: dict[Any, int] = {}
        self.written: dict[tuple[int, int, int], int] = {}
        self.exponents: dict[Any, set[Any]] = {}
        self.chains: dict[int, dict[int, int]] = {}
        self.moving: set[Any] = set()

    def write(self, wanted: Sequence[Any]) -> list[int]:
        """Write the program of expressions; their registers."""
        import sympy

        shared, reduced = sympy.cse(wanted, sympy.numbered_symbols(cls=sympy.Dummy))
        # A shared part without inputs is a number, or a part of one.
        constant: dict[Any, Any] = {}
        varying: list[tuple[Any, Any]] = []
        moving = set(self.known)
        for symbol, expression in shared:
            expression = expression.xreplace(constant)
            if expression.free_symbols & moving:
                moving.add(symbol)
                varying.append((symbol, expression))
            else:
                constant[symbol] = expression
        reduced = [expression.xreplace(constant) for expression in reduced]
        self.moving = moving
        for expression in [*(expression for _, expression in varying), *reduced]:
            for power in expression.atoms(sympy.Pow):
                self.exponents.setdefault(power.base, set()).add(power.exp)
        for symbol, expression in varying:
            self.known[symbol] = self.register(expression)
        return [self.register(expression) for expression in reduced]

    def operation(self, code: int, first: int, second: int = 0) -> int:
        """The register of the result of an operation."""
        key = (code, first, second)
        if key not in self.written:
            self.written[key] = self.registers
            self.code.append((code, self.registers, first, second))
            self.registers += 2 if code in (kernels.SIN, kernels.SINH) else 1
        return self.written[key]

    def with_number(self, code: int, first: int, number: Any) -> int:
        """The register of the result of an operation with a number, which may depend on parameters."""
        import sympy

        return self.operation(code, first, self.numbers.setdefault(sympy.sympify(number), len(self.numbers)))

    def register(self, expression: Any) -> int:
        """The register of an expression."""
        if expression not in self.known:
            self.known[expression] = self._compute(expression)
        return self.known[expression]

    def varies(self, expression: Any) -> bool:
        """Whether an expression depends on the inputs."""
        return bool(expression.free_symbols & self.moving)

    def _compute(self, expression: Any) -> int:
        import sympy

        if not self.varies(expression):
            zero = self.with_number(kernels.SCALE, 0, 0)
            return self.with_number(kernels.SHIFT, zero, expression) if expression != 0 else zero
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow and not self.varies(expression.exp):
            return self._power(expression.base, expression.exp)
        if expression.is_Pow:  # a^b = exp(b log a)
            return self.register(sympy.exp(expression.exp * sympy.log(expression.base), evaluate=False))
        function, inner = expression.func, expression.args[0]
        if function in (sympy.exp, sympy.log):
            return self.operation(kernels.EXP if function is sympy.exp else kernels.LOG, self.register(inner))
        for sine, cosine, tangent, code in (
            (sympy.sin, sympy.cos, sympy.tan, kernels.SIN),
            (sympy.sinh, sympy.cosh, sympy.tanh, kernels.SINH),
        ):
            if function in (sine, cosine, tangent):
                first = self.operation(code, self.register(inner))
                return first if function is sine else first + 1 if function is cosine else self.operation(kernels.DIVIDE, first, first + 1)
        if function in _powers() and not self.varies(expression.args[1]):
            return self._modulus(function, self.register(inner), *expression.args[1:])
        raise ExpressionError(f"{expression} has no Taylor series here, expected sums, products, powers and {', '.join(FUNCTIONS[:-2])}")

    def _modulus(self, function: Any, base: int, exponent: Any, power: int = 0) -> int:
        """|w|^p sign w is w |w|^(p - 1), so that a force and its derivative are left out together where they are too small."""
        signed, even, signed_log, even_log = _powers()
        if function in (signed_log, even_log):
            # Of the power of the force itself, also for its derivatives: their power is 0 for a force of power 1.
            raised = exponent + int(function is even_log)
            modulus = self.with_number(kernels.SHIFT, self._modulus(even, base, raised), TINY)
            logarithm = self.with_number(kernels.SCALE, self.operation(kernels.LOG, modulus), 1 / raised)
            found = self._modulus(signed if function is signed_log else even, base, exponent)
            for _ in range(int(power)):
                found = self._times(found, logarithm)
            return found
        if function is signed:
            return self.operation(kernels.MULTIPLY, self._modulus(even, base, exponent - 1), base)
        return self.with_number(kernels.EVEN_POWER, base, exponent)

    def _split(self, expression: Any) -> tuple[Any, list[Any]]:
        """The factors of an expression without inputs, as one number, and the others."""
        import sympy

        factors = sympy.Mul.make_args(expression)
        return sympy.Mul(*(f for f in factors if not self.varies(f))), [f for f in factors if self.varies(f)]

    def _sum(self, expression: Any) -> int:
        import sympy

        constant = sympy.Add(*(term for term in expression.args if not self.varies(term)))
        parts = [term for term in expression.args if self.varies(term)]
        terms = [(-term, True) if self._split(term)[0].could_extract_minus_sign() else (term, False) for term in parts]
        terms.sort(key=lambda part: part[1])  # a term without a minus sign first
        total = self.register(-terms[0][0] if terms[0][1] else terms[0][0])
        for term, negative in terms[1:]:
            total = self.operation(kernels.SUBTRACT if negative else kernels.ADD, total, self.register(term))
        return self.with_number(kernels.SHIFT, total, constant) if constant != 0 else total

    def _product(self, expression: Any) -> int:
        number, factors = self._split(expression)
        below = [factor for factor in factors if factor.is_Pow and factor.exp == -1]
        above = [factor for factor in factors if factor not in below]
        product = None
        for factor in above or below[:1]:
            register = self.register(factor)
            product = register if product is None else self._times(product, register)
        assert product is not None
        for factor in below if above else below[1:]:
            product = self.operation(kernels.DIVIDE, product, self.register(factor.base))
        return self.with_number(kernels.SCALE, product, number) if number != 1 else product

    def _times(self, first: int, second: int) -> int:
        if first == second:
            return self.operation(kernels.SQUARE, first)
        return self.operation(kernels.MULTIPLY, max(first, second), min(first, second))

    def _power(self, base: Any, exponent: Any) -> int:
        needed = self.exponents.get(base, set())
        p = _integer(exponent)
        if p is None or p < 0:
            if exponent - 1 in needed:  # with its derivative
                return self._times(self.register(base ** (exponent - 1)), self.register(base))
            return self.with_number(kernels.POWER, self.register(base), exponent)
        # Lower powers that are needed come first: they are steps on the way to this one.
        for lower in sorted(q for q in map(_integer, needed) if q is not None and 1 < q < p):
            self._chain(self.register(base), lower)
        return self._chain(self.register(base), p)

    def _chain(self, base: int, p: int) -> int:
        """An integer power by products: the square of its half, or the next lower power times the base."""
        known = self.chains.setdefault(base, {1: base})
        if p not in known:
            if p % 2 == 1 or (p // 2 not in known and p - 1 in known):
                known[p] = self._times(self._chain(base, p - 1), base)
            else:
                known[p] = self._times(self._chain(base, p // 2), self._chain(base, p // 2))
        return known[p]
