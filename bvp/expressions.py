"""Expressions given as text, with limits on their size and on the time that sympy may take."""

from __future__ import annotations

import ast
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

__all__ = [
    "FUNCTIONS", "LagrangianError", "MOST_BITS", "MOST_TERMS", "SECONDS", "Size", "TooLarge", "is_plain_name", "limited",
    "parse_expression", "require_small", "size_of_text",
]  # fmt: skip

MOST_TERMS = 20_000
"""Terms of an expression that is multiplied out: a chain of 100 coordinates that are all coupled has 5,050."""

MOST_BITS = 4096
"""Bits of an exact number in an expression: no float holds more than 1,024 before or 1,074 behind its point."""

SECONDS = 20.0
"""Time that sympy may take to read one system."""

FUNCTIONS = ("sqrt", "exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh", "Abs")
"""Functions that an expression given as text may use (of parameters: they are nonlinear in a coordinate)."""

LARGEST_POWER = 20
"""Largest number in an exponent given as text: what is above can only be a slip, or take for ever to multiply out."""


ARITHMETIC = (
    (ast.Expression, ast.BinOp, ast.UnaryOp, ast.Load) + (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow) + (ast.UAdd, ast.USub)
)
"""What else a text's syntax tree may consist of."""


class LagrangianError(ValueError):
    """Energies, gaps or parameters that make no linear impacting system; the message is one line that names the term."""


class TooLarge(LagrangianError):
    """An expression that is too large, or takes too long; the message says in what."""


class Size(NamedTuple):
    """What an expression becomes at most: terms when multiplied out, bits of the largest number."""

    terms: int = 1
    bits: int = 1

    def plus(self, other: Size) -> Size:
        """Of a sum."""
        return Size(self.terms + other.terms, max(self.bits, other.bits) + 1)

    def times(self, other: Size) -> Size:
        """Of a product."""
        return Size(self.terms * other.terms, self.bits + other.bits)

    def power(self, exponent: int) -> Size:
        """Of a power with an integer exponent."""
        k = abs(exponent)
        # Beyond the limit the number itself says nothing, and takes long to compute.
        terms = math.comb(self.terms + k - 1, k) if k * self.terms < MOST_TERMS else MOST_TERMS + 1
        return Size(terms if self.terms > 1 else 1, k * self.bits)

    def checked(self) -> Size:
        """Itself.

        Raises
        ------
        TooLarge
        """
        if self.terms > MOST_TERMS:
            raise TooLarge(f"multiplied out it could have more than {MOST_TERMS} terms")
        if self.bits > MOST_BITS:
            raise TooLarge(f"its numbers could have more than {MOST_BITS} bits")
        return self


def size_of_text(node: ast.AST) -> Size:
    """The size of the syntax tree of plain arithmetic.

    Raises
    ------
    TooLarge
        For a part of it, before the rest is looked at.

    Examples
    --------
    >>> size_of_text(ast.parse("(x + y + 1)**20", mode="eval")).terms
    231
    """
    if isinstance(node, ast.Expression):
        return size_of_text(node.body)
    if isinstance(node, ast.Constant):
        return Size(1, node.value.bit_length() + 1 if isinstance(node.value, int) else 64).checked()
    if isinstance(node, ast.UnaryOp):
        return size_of_text(node.operand)
    if isinstance(node, ast.Call):
        for argument in node.args:
            size_of_text(argument)
        return Size(1, 64)
    if isinstance(node, ast.BinOp):
        left, right = size_of_text(node.left), size_of_text(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            return left.plus(right).checked()
        if isinstance(node.op, ast.Pow):
            exponent = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
            is_integer = isinstance(exponent, ast.Constant) and isinstance(exponent.value, int)
            return (left.power(exponent.value) if is_integer else left).checked()  # type: ignore[attr-defined]
        return left.times(right).checked()
    return Size()


def require_small(expression: Any, values: Mapping[str, Any]) -> None:
    """Refuse an expression of sympy that is too large, or has a part with a value beyond floats.

    Parameters
    ----------
    expression : sympy.Expr
    values : mapping of str to sympy.Rational
        Of its parameters.

    Raises
    ------
    TooLarge
    """
    part = _beyond_floats(expression, values)
    if part is not None:
        text = str(part)
        raise TooLarge(f"{text if len(text) <= 60 else text[:57] + '...'} is beyond all floats")
    _size(expression, values)


def _size(expression: Any, values: Mapping[str, Any]) -> Size:
    """The size of an expression of sympy."""
    parts = [_size(part, values) for part in expression.args]
    if expression.is_Rational:
        return Size(1, int(expression.p).bit_length() + int(expression.q).bit_length()).checked()
    if expression.is_Pow:
        exponent = expression.exp.subs(values)
        return parts[0].power(int(exponent)).checked() if exponent.is_Integer else Size(1, 64)
    if expression.is_Add or expression.is_Mul:
        total = parts[0]
        for part in parts[1:]:
            total = (total.plus(part) if expression.is_Add else total.times(part)).checked()
        return total
    return Size(1, 64)


def _beyond_floats(expression: Any, values: Mapping[str, Any]) -> Any:
    """The first part of an expression whose value is beyond floats; None where there is none. What holds another symbol has no value."""
    found: list[Any] = []

    def value(part: Any) -> float | None:
        numbers = [value(argument) for argument in part.args]
        if found or None in numbers:
            return None
        try:
            if part.is_Symbol:
                result = float(values[part.name])
            elif part.is_Number or part.is_NumberSymbol:
                result = float(part)
            else:
                result = float(_OF[part.func.__name__](*numbers))
        except (KeyError, ValueError, ZeroDivisionError, TypeError):
            return None
        except OverflowError:
            result = math.inf
        if math.isinf(result):
            found.append(part)
        return result

    value(expression)
    return found[0] if found else None


_OF: dict[str, Callable[..., float]] = {
    "Add": lambda *parts: math.fsum(parts),
    "Mul": lambda *parts: math.prod(parts),
    "Pow": lambda base, exponent: base**exponent,
    "Abs": abs,
    **{name: getattr(math, name) for name in ("exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
}
"""Functions of floats, by the names of sympy's."""


class _OutOfTime(BaseException):
    """No `Exception`, for sympy tries other ways after some of those."""


@contextmanager
def limited(what: str) -> Iterator[None]:
    """Bound the time of the Python code in the block, and say in one line what is too large for it.

    Where a profiler is at work already the time is not bounded.

    Raises
    ------
    TooLarge
    """
    end = time.monotonic() + SECONDS

    def look(frame: object, event: str, argument: object) -> None:
        if time.monotonic() > end:
            raise _OutOfTime

    free = sys.getprofile() is None
    if free:
        sys.setprofile(look)
    try:
        yield
    except _OutOfTime:
        raise TooLarge(f"{what}: sympy has not read it within {SECONDS:g} seconds") from None
    except (OverflowError, MemoryError, RecursionError):
        raise TooLarge(f"{what} is too large to be read") from None
    finally:
        if free:
            sys.setprofile(None)


def is_plain_name(name: str) -> bool:
    """Whether text may be the name of a symbol."""
    return name.isidentifier() and "__" not in name


def parse_expression(text: str, what: str) -> Any:
    """Text as a sympy expression: checked to be plain arithmetic before sympy, which evaluates what it reads, sees it."""
    import sympy
    from sympy.parsing.sympy_parser import auto_number, parse_expr

    text = " ".join(text.split())
    shown = text if len(text) <= 60 else text[:57] + "..."
    try:
        tree = ast.parse(text, mode="eval")
    except SyntaxError as error:
        raise LagrangianError(f'{what} "{shown}" cannot be read: not an expression at character {error.offset}') from None
    except (ValueError, RecursionError, MemoryError):
        raise LagrangianError(f'{what} "{shown}" cannot be read: too long, or no text') from None
    parts = list(ast.walk(tree))
    for node in parts:
        refused = _refused(node)
        if refused:
            raise LagrangianError(f'{what} "{shown}" cannot be read: {refused}')
    try:
        size_of_text(tree)
    except TooLarge as error:
        raise LagrangianError(f'{what} "{shown}" is too large: {error}') from None
    called = {node.func.id for node in parts if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    names = {node.id: sympy.Symbol(node.id) for node in parts if isinstance(node, ast.Name)}
    names |= {name: getattr(sympy, name) for name in called}
    numbers = {"Integer": sympy.Integer, "Float": sympy.Float, "__builtins__": {}}
    try:
        return parse_expr(text, local_dict=names, global_dict=numbers, transformations=(auto_number,))
    except (TypeError, ValueError, ArithmeticError) as error:
        raise LagrangianError(f'{what} "{shown}" cannot be read: {error}') from None


def _refused(node: ast.AST) -> str | None:
    """Why a part of a text's syntax tree is not plain arithmetic, None where it is."""
    if isinstance(node, ast.Name):
        return None if is_plain_name(node.id) else f"the name {node.id} is not allowed"
    if isinstance(node, ast.Constant):
        good = isinstance(node.value, (int, float)) and not isinstance(node.value, bool) and math.isfinite(node.value)
        return None if good else f"{node.value!r} is not a finite real number"
    if isinstance(node, ast.Attribute):
        return f"attributes such as .{node.attr} are not allowed"
    if isinstance(node, ast.Call):
        allowed = isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS and len(node.args) == 1 and not node.keywords
        return None if allowed else f"the functions known, of one argument, are {', '.join(FUNCTIONS)}"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
        return "a power is written **"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        parts = list(ast.walk(node.right))
        numbers = [abs(part.value) for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, (int, float))]
        plain = len(numbers) <= 2 and not any(isinstance(part, ast.Pow) for part in parts)
        good = plain and max(numbers, default=0) <= LARGEST_POWER
        return None if good else f"a power is at most {LARGEST_POWER}, without powers in it"
    return None if isinstance(node, ARITHMETIC) else "only + - * / **, numbers, names and functions are allowed"
