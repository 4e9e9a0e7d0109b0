"""Expressions given as text: arithmetic of numbers, names and known functions, and nothing else.

A text is checked before sympy, which evaluates what it reads, sees it. An expression on which sympy could spend hours is refused.
"""

from __future__ import annotations

import ast
import math
import re
import sys
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

__all__ = ["FUNCTIONS", "ExpressionError", "is_plain", "normalised", "not_too_deep", "parsed", "require_small"]

FUNCTIONS = ("sqrt", "exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh", "Abs", "abs")
"""Functions that an expression given as text may use (of parameters: they are nonlinear in a coordinate)."""

LARGEST_POWER = 20
"""Largest number in an exponent given as text: what is above can only be a slip, or take for ever to multiply out."""

MOST_TERMS = 20_000
"""Terms of an expression that is multiplied out: springs between all pairs of 100 coordinates give 14,850."""

MOST_BITS = 4096
"""Bits of a number in an expression: no float has more than 1,024 before or 1,074 behind its point."""

ARITHMETIC = (
    (ast.Expression, ast.BinOp, ast.UnaryOp, ast.Load) + (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow) + (ast.UAdd, ast.USub)
)
"""What else a text's syntax tree may consist of."""


class ExpressionError(ValueError):
    """Text or an expression that cannot be used; the message is one line."""


@contextmanager
def not_too_deep(what: str) -> Iterator[None]:
    """Within it, expressions that sympy cannot follow to their innermost part are refused."""
    try:
        yield
    except RecursionError:
        raise ExpressionError(f"{what} is nested too deeply to be read") from None


def is_plain(name: str) -> bool:
    """Whether text may be the name of a symbol: letters, digits and _."""
    return name.isidentifier() and "__" not in name and re.fullmatch(r"\w+", normalised(name)) is not None


def normalised(text: str) -> str:
    """Return text in the one form that equal letters have (NFKC). Systems type a letter with an accent as one character or as two.
    Text with a raised or lowered digit stays as it is: x\u00b2 is not x2.

    Examples
    --------
    >>> normalised("u\u0301") == "\u00fa", normalised("\u00b5") == "\u03bc", normalised("x\u00b2") == "x2"
    (True, True, False)
    """
    return text if any(unicodedata.category(letter) == "No" for letter in text) else unicodedata.normalize("NFKC", text)


def parsed(
    text: str, what: str, values: Mapping[Any, Any] | None = None, *, exact: bool = False, largest_power: int = LARGEST_POWER
) -> Any:
    """Text as a sympy expression.

    Parameters
    ----------
    text : str
    what : str
        Beginning of messages: what the text gives.
    values : mapping of sympy symbol to number, optional
        Values of symbols. The size of a power depends on them.
    exact : bool
        A decimal number is the rational number that it spells, not the nearest float.
    largest_power : int
        Largest number in an exponent.

    Raises
    ------
    ExpressionError
        For text that is not plain arithmetic, or too large.

    Examples
    --------
    >>> parsed("0.1*k + sqrt(m)", "stiffness", exact=True)
    k/10 + sqrt(m)
    >>> parsed("k.real", "stiffness")
    Traceback (most recent call last):
    bvp.expressions.ExpressionError: stiffness "k.real" cannot be read: attributes such as .real are not allowed
    """
    import sympy

    with sympy.evaluate(False):
        unevaluated = _parsed(text, what, exact, largest_power)
    require_small(unevaluated, what, values or {})
    return _parsed(text, what, exact, largest_power)


def _parsed(text: str, what: str, exact: bool, largest_power: int) -> Any:
    import sympy
    from sympy.parsing.sympy_parser import auto_number, parse_expr

    text = " ".join(text.split())
    unread = f'{what} "{text if len(text) <= 60 else text[:57] + "..."}" cannot be read'
    try:
        parts = list(ast.walk(ast.parse(text, mode="eval")))
    except SyntaxError as error:
        raise ExpressionError(f"{unread}: not an expression at character {error.offset or 1}") from None
    except (ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"{unread}: too long, or no text") from None
    text = normalised(text)  # as the names of the syntax tree
    for node in parts:
        refused = _refused(node, largest_power)
        if refused:
            raise ExpressionError(f"{unread}: {refused}")
    names = {node.id: sympy.Symbol(node.id) for node in parts if isinstance(node, ast.Name)}
    functions = [node.func for node in parts if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    called = {node.id for node in functions}
    alone = [node.id for node in parts if isinstance(node, ast.Name) and node.id in called and node not in functions]
    if alone:
        raise ExpressionError(f"{unread}: {alone[0]} is a function, expected {alone[0]}(...)")
    names |= {name: getattr(sympy, "Abs" if name == "abs" else name) for name in called}
    numbers = {"Integer": sympy.Integer, "Float": sympy.Rational if exact else sympy.Float, "__builtins__": {}}
    try:
        return parse_expr(text, local_dict=names, global_dict=numbers, transformations=(auto_number,))
    except (TypeError, ValueError, ArithmeticError) as error:
        raise ExpressionError(f"{unread}: {error}") from None


def _refused(node: ast.AST, largest_power: int) -> str | None:
    """Why a part of a text's syntax tree is not plain arithmetic, None where it is."""
    if isinstance(node, ast.Name):
        return None if is_plain(node.id) else f"the name {node.id} is not allowed"
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
        good = plain and max(numbers, default=0) <= largest_power
        return None if good else f"a power is at most {largest_power}, without powers in it"
    return None if isinstance(node, ARITHMETIC) else "only + - * / **, numbers, names and functions are allowed"


def require_small(expression: Any, what: str, values: Mapping[Any, Any]) -> None:
    """Refuse an expression, evaluated or not, on which sympy could spend hours: multiplied out, or as a number.

    values : mapping of sympy symbol to number. The size of a power depends on them."""
    parts = [expression]
    for part in parts:
        parts.extend(part.args)
    sizes: dict[int, tuple[int, float]] = {}
    for part in reversed(parts):
        terms, bits = sizes[id(part)] = _size(part, [sizes[id(argument)] for argument in part.args], values)
        if terms > MOST_TERMS or bits > MOST_BITS:
            raise ExpressionError(
                f"{what} is too large, expected at most {MOST_TERMS} terms when multiplied out, and numbers that floats can hold, "
                f"of at most {MOST_BITS} bits"
            )


def _size(part: Any, inner: Sequence[tuple[int, float]], values: Mapping[Any, Any]) -> tuple[int, float]:
    """At most so many terms of an expression that is multiplied out, and bits of its numbers, from those of its arguments."""
    terms, bits = [size[0] for size in inner], [size[1] for size in inner]
    if part.is_Rational:
        return 1, part.p.bit_length() + part.q.bit_length()
    if part.is_Add:
        return sum(terms), max(bits) + len(bits)
    if part.is_Mul:
        return math.prod(terms), sum(bits)
    if part.is_Pow:
        exponent = part.exp.xreplace(values).doit()
        if exponent.is_Rational or exponent.is_Float:
            k, count = math.ceil(abs(exponent)), terms[0]
            # where there are too many terms, their exact number takes long itself
            return math.comb(count + k - 1, k) if count == 1 or k * count <= MOST_TERMS else k * count, k * bits[0]
    if part.is_Function:
        number = part.xreplace(values)
        value = number if number.free_symbols else number.evalf()
        if value.is_Float and abs(value) > sys.float_info.max:
            return 1, math.inf
    return 1, 1 if part.is_Symbol and part not in values else 64
