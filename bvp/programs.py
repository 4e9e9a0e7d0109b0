"""Programs that compute expressions of parameters, and their exact derivatives: lists of operations (`bvp.kernels.expressions`), in which
common subexpressions are computed once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from bvp.expressions import FUNCTIONS, ExpressionError, not_too_deep
from bvp.kernels import expressions as kernels
from bvp.kernels.expressions import Program

__all__ = ["derivative", "derivatives_of", "evaluate_program", "program_of", "scratch_size", "with_numbers"]


@cache
def _real_functions() -> tuple[Any, Any]:
    """abs, with the derivative sign also where its argument may be complex for sympy, and sign, with the derivative 0: all values are real
    here."""
    import sympy

    class Sign(sympy.Function):
        def fdiff(self, argindex: int = 1) -> Any:
            return sympy.Integer(0)

    class Modulus(sympy.Function):
        def fdiff(self, argindex: int = 1) -> Any:
            return Sign(self.args[0])

    return Modulus, Sign


def derivative(expression: Any, symbol: Any) -> Any:
    """Exact derivative of an expression, in real numbers.

    Examples
    --------
    >>> import sympy
    >>> a = sympy.Symbol("a")
    >>> derivative(sympy.Abs(a**2 - 1), a)
    2*a*sign(a**2 - 1)
    """
    import sympy

    modulus, sign = _real_functions()
    real = expression.replace(sympy.Abs, modulus).replace(sympy.sign, sign).diff(symbol)
    return real.replace(modulus, sympy.Abs).replace(sign, sympy.sign)


def derivatives_of(expressions: Sequence[Any], symbols: Sequence[Any], order: int) -> list[Any]:
    """Expressions, then their derivatives by symbols, then second ones and so on up to an order. Those of one order are expression by
    expression, and the last symbol changes fastest.

    Examples
    --------
    >>> import sympy
    >>> a, b = sympy.symbols("a b")
    >>> derivatives_of([a**2 * b], [a, b], 2)
    [a**2*b, 2*a*b, a**2, 2*b, 2*a, 2*a, 0]
    """
    found = last = list(expressions)
    for _ in range(order):
        last = [derivative(expression, symbol) for expression in last for symbol in symbols]
        found = [*found, *last]
    return found


def program_of(expressions: Sequence[Any], symbols: Sequence[Any]) -> Program:
    """The program that computes expressions of symbols.

    Parameters
    ----------
    expressions : sequence of O sympy expressions
        Of rational powers and products, sums, and `FUNCTIONS`, besides sign.
    symbols : sequence of N sympy symbols
        The parameters, in the order in which `bvp.kernels.expressions.run` receives their values.

    Returns
    -------
    Program

    Raises
    ------
    ExpressionError
        For a part that is none of these.

    Examples
    --------
    >>> import sympy
    >>> from bvp.kernels.expressions import run
    >>> a, b = sympy.symbols("a b")
    >>> program, out = program_of([(a + b) ** 2, sympy.sqrt(a + b), a / 3], [a, b]), np.zeros(3)
    >>> len(program.code), run(program, np.array([1.0, 3.0]), np.zeros(scratch_size(program, 2)), out), out.round(6).tolist()
    (4, True, [16.0, 2.0, 0.333333])
    """
    if not expressions:
        return Program(np.zeros((0, 3), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=np.int64))
    import sympy

    writer = _Writer(symbols)
    with not_too_deep("an expression"):
        shared, reduced = sympy.cse([sympy.sympify(expression) for expression in expressions], sympy.numbered_symbols(cls=sympy.Dummy))
        for symbol, expression in shared:
            writer.registers[symbol] = writer.register(expression)
        outputs = [writer.register(expression) for expression in reduced]
    return writer.program(outputs)


def with_numbers(program: Program, numbers: Sequence[float]) -> Program:
    """The program of the first parameters of another one, where the last ones are numbers.

    Examples
    --------
    >>> import sympy
    >>> a, b = sympy.symbols("a b")
    >>> evaluate_program(with_numbers(program_of([a + 2 * b], [a, b]), [3.0]), [1.0])
    array([7.])
    """
    return program._replace(constants=np.concatenate([np.array(numbers, dtype=float), program.constants]))


def scratch_size(program: Program, parameters: int) -> int:
    """Length of the scratch of `bvp.kernels.expressions.run`."""
    return parameters + len(program.constants) + len(program.code)


def evaluate_program(program: Program, parameters: Sequence[float]) -> np.ndarray:
    """The values (O,) of the expressions at parameters (N,), by the same operations without compiled code: for a scene, which needs them
    once, nothing is compiled. All are NaN if a function has no value.

    Examples
    --------
    >>> import sympy
    >>> a = sympy.Symbol("a")
    >>> evaluate_program(program_of([a**2, a / 2], [a]), [3.0]), evaluate_program(program_of([sympy.log(a)], [a]), [-1.0])
    (array([9. , 1.5]), array([nan]))
    """
    out = np.zeros(len(program.outputs))
    scratch = [0.0] * scratch_size(program, len(parameters))
    try:
        with np.errstate(all="ignore"):
            kernels.run.function(program, np.array(parameters, dtype=float), scratch, out)
    except (ValueError, ArithmeticError):
        out[:] = np.nan
    return out


class _Writer:
    """Writes the operations of a program. A register is a pair: "parameter", "constant" or "result", and its index there."""

    def __init__(self, symbols: Sequence[Any]):
        import sympy

        self.registers: dict[Any, tuple[str, int]] = {symbol: ("parameter", k) for k, symbol in enumerate(symbols)}
        self.constants: dict[float, int] = {}
        self.code: dict[tuple[Any, ...], int] = {}
        one_operand = [sympy.exp, sympy.log, sympy.sin, sympy.cos, sympy.tan, sympy.sinh, sympy.cosh, sympy.tanh, sympy.Abs, sympy.sign]
        self.functions = dict(zip(one_operand, range(kernels.EXP, kernels.SIGN + 1), strict=True))

    def program(self, outputs: Sequence[tuple[str, int]]) -> Program:
        """The program with the registers of its expressions."""
        parameters = sum(kind == "parameter" for kind, _ in self.registers.values())
        first = {"parameter": 0, "constant": parameters, "result": parameters + len(self.constants)}

        def index(operand: Any) -> int:
            return first[operand[0]] + operand[1] if isinstance(operand, tuple) else operand

        code = [[operation, *map(index, operands)] for operation, *operands in self.code]
        return Program(
            np.array(code, dtype=np.int64).reshape(-1, 3),
            np.array(list(self.constants), dtype=float),
            np.array([index(output) for output in outputs], dtype=np.int64),
        )

    def constant(self, value: Any) -> tuple[str, int]:
        """The register of a number, rounded once."""
        try:
            number = float(value)
        except (TypeError, OverflowError):
            raise ExpressionError(f"{value} is no real number that a float can hold") from None
        return "constant", self.constants.setdefault(number, len(self.constants))

    def operation(self, code: int, first: tuple[str, int], second: Any = 0) -> tuple[str, int]:
        """The register of the result of an operation."""
        return "result", self.code.setdefault((code, first, second), len(self.code))

    def register(self, expression: Any) -> tuple[str, int]:
        """The register of an expression."""
        if expression not in self.registers:
            # A number too, such as log(2), is one constant.
            self.registers[expression] = self.constant(expression) if expression.is_number else self._compute(expression)
        return self.registers[expression]

    def _compute(self, expression: Any) -> tuple[str, int]:
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            return self._power(expression.base, expression.exp)
        if expression.func in self.functions:
            return self.operation(self.functions[expression.func], self.register(expression.args[0]))
        raise ExpressionError(f"{expression} cannot be computed, expected sums, products, powers and {', '.join(FUNCTIONS)}")

    def _sum(self, expression: Any) -> tuple[str, int]:
        parts = [(term, False) if not term.could_extract_minus_sign() else (-term, True) for term in expression.args]
        parts.sort(key=lambda part: part[1])  # a term without a minus sign first
        total = self.register(-parts[0][0] if parts[0][1] else parts[0][0])
        for term, negative in parts[1:]:
            total = self.operation(kernels.SUBTRACT if negative else kernels.ADD, total, self.register(term))
        return total

    def _product(self, expression: Any) -> tuple[str, int]:
        """Numerator over denominator: x/3 is a division, which is rounded once."""
        above: list[Any] = []
        below: list[Any] = []
        for factor in expression.args:
            if factor.is_Rational:
                above += [factor.p] if factor.p != 1 else []
                below += [factor.q] if factor.q != 1 else []
            elif factor.is_Pow and factor.exp.is_Rational and factor.exp < 0:
                below.append(factor.base**-factor.exp)
            else:
                above.append(factor)
        result, *others = [self._factors(part) for part in (above, below) if part]
        if not above:
            return self.operation(kernels.DIVIDE, self.constant(1), result)
        return self.operation(kernels.DIVIDE, result, others[0]) if others else result

    def _factors(self, factors: Sequence[Any]) -> tuple[str, int]:
        import sympy

        product, *others = [self.register(sympy.sympify(factor)) for factor in factors]
        for other in others:
            product = self.operation(kernels.MULTIPLY, product, other)
        return product

    def _power(self, base: Any, exponent: Any) -> tuple[str, int]:
        import sympy

        if exponent == sympy.S.Half:
            return self.operation(kernels.SQRT, self.register(base))
        if exponent.is_Rational and exponent < 0:
            return self.operation(kernels.DIVIDE, self.constant(1), self.register(base**-exponent))
        if exponent.is_Integer:
            return self.operation(kernels.INTEGER_POWER, self.register(base), int(exponent))
        return self.operation(kernels.POWER, self.register(base), self.register(exponent))
