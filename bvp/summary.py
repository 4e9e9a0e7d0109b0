"""The short text of an object, and the same as a table for notebooks: a title and a few rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from html import escape
from typing import Any, TypeVar

__all__ = ["brief", "listed", "span"]

_MOST = 60
"""Letters of a value in a row."""

Class = TypeVar("Class", bound=type)


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
    title, rows = _summary(self)
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
    return f"<table><caption>{escape(title)}</caption>{cells}</table>"


def _summary(data: Any) -> tuple[str, Sequence[tuple[str, str]]]:
    if hasattr(data, "_summary"):
        return data._summary()
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
