"""Text for users: values in messages, the short repr of objects, and the options in a function's help.

This file loads no other library, so that a message costs nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

__all__ = ["at_values", "brief", "listed", "nearest_known", "shown", "span", "takes_options_of"]

_MOST = 60
"""Letters of a value in a row."""

Class = TypeVar("Class", bound=type)


def shown(value: Any) -> str:
    """A value as messages show it: in one line, the middle left out where it is long.

    Examples
    --------
    >>> shown(10**400), shown([0.1])
    ('an integer of 1329 bits, beyond all floats', '[0.1]')
    """
    if isinstance(value, int) and value.bit_length() > 1024:
        return f"an integer of {value.bit_length()} bits, beyond all floats"
    try:
        text = " ".join(repr(value).split())
    except ValueError:
        # Python writes no integer of more than some thousand digits, nor a list with one.
        return f"a {type(value).__name__} with an integer beyond all floats"
    return text if len(text) <= 200 else f"{text[:120]} ... {text[-40:]}"


def brief(cls: Class) -> Class:
    """Give a class a short ``repr``, and the same as a small HTML table for notebooks.

    The class returns its title and rows of two texts from ``_summary``. Without that method, a dataclass has a row for each field.
    """
    cls.__repr__ = _text  # type: ignore[assignment]
    cls._repr_html_ = _html  # type: ignore[attr-defined]
    return cls


def _text(self: Any) -> str:
    title, rows = _summary(self)
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {text}" for name, text in rows)])


def _html(self: Any) -> str:
    from html import escape

    title, rows = _summary(self)
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
    return f"<table><caption>{escape(title)}</caption>{cells}</table>"


def _summary(data: Any) -> tuple[str, Sequence[tuple[str, str]]]:
    if hasattr(data, "_summary"):
        return data._summary()
    from dataclasses import fields

    values = [(field.name, getattr(data, field.name)) for field in fields(data) if field.repr]
    return type(data).__name__, [(name, _value(value)) for name, value in values]


def _value(value: Any) -> str:
    """A value in one line: arrays and long lists by their size, objects by their title."""
    if getattr(value, "size", 0) > 4:
        return f"array {'x'.join(map(str, value.shape))}"
    if isinstance(value, list | tuple | dict) and len(value) > 4:
        return f"{type(value).__name__} of {len(value)}"
    if hasattr(value, "_repr_html_"):
        return _summary(value)[0]
    text = " ".join(f"{value:.10g}".split() if isinstance(value, float) else repr(value).split())
    return text if len(text) <= _MOST else f"{text[: _MOST - 3]}..."


def span(name: str, values: Iterable[float]) -> str:
    """The range of numbers in words; NaN is left out.

    Examples
    --------
    >>> span("h", [2.0, 0.5, float("nan")]), span("h", [1.0]), span("h", [])
    ('h = 0.5 to 2', 'h = 1', 'no h')
    """
    finite = [float(value) for value in values if value == value]
    if not finite:
        return f"no {name}"
    low, high = min(finite), max(finite)
    return f"{name} = {low:.6g}" + (f" to {high:.6g}" if high > low else "")


def listed(texts: Sequence[str], most: int = 8) -> str:
    """The first texts with commas between them, and how many there are where some are left out.

    Examples
    --------
    >>> listed(["SN1", "GR1"]), listed("abcde", 3), listed([])
    ('SN1, GR1', 'a, b, c, .. (5)', 'none')
    """
    if len(texts) <= most:
        return ", ".join(texts) or "none"
    return f"{', '.join(texts[:most])}, .. ({len(texts)})"


def takes_options_of(inner: Callable[..., Any], function: Any = None) -> Any:
    """Decorate a function that passes ``**options`` to `inner`: ``help`` shows the keywords of `inner` in their place.

    Examples
    --------
    >>> def inner(*, most=3):
    ...     '''Parameters
    ...     ----------
    ...     most : int
    ...         Largest number.
    ...     '''
    >>> @takes_options_of(inner)
    ... def outer(x, **options):
    ...     '''Parameters
    ...     ----------
    ...     x : float
    ...     **options
    ...         As for `inner`.
    ...     '''
    >>> from inspect import signature
    >>> str(signature(outer)), "most : int" in outer.__doc__, "**options" in outer.__doc__
    ('(x, *, most=3)', True, False)
    """
    import inspect

    if function is None:
        return partial(takes_options_of, inner)
    own = inspect.signature(function)
    kept = [item for item in own.parameters.values() if item.kind is not item.VAR_KEYWORD]
    theirs = inspect.signature(inner).parameters.values()
    passed = {item.name: item for item in theirs if item.kind is item.KEYWORD_ONLY and item.name not in own.parameters}
    function.__signature__ = own.replace(parameters=[*kept, *passed.values()])
    # an entry of the section Parameters: a line that begins at the margin, and the indented lines below it
    entries = re.findall(r"^[\w, ]+ : .*(?:\n +.*)*", inspect.cleandoc(inner.__doc__ or ""), re.MULTILINE)
    described = "\n".join(text for text in entries if passed.keys() & set(text.partition(" :")[0].split(", ")))
    function.__doc__ = re.sub(r"^\*\*.*(?:\n +.*)*", lambda _: described, inspect.cleandoc(function.__doc__ or ""), flags=re.MULTILINE)
    return function


def nearest_known(name: Any, known: Sequence[str]) -> str:
    """The end of a message on an unknown name: the nearest known one, else all."""
    from difflib import get_close_matches

    close = get_close_matches(str(name), known, 1, 0.5)
    return f"; nearest: {close[0]}" if close else f"; known: {listed(known)}"


def at_values(values: Mapping[str, float]) -> str:
    """The end of a message: the values of parameters."""
    return f" (at {listed([f'{name} = {value:g}' for name, value in values.items()])})" if values else ""
