"""Order that rounding does not decide."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

__all__ = ["in_tied_order"]

Item = TypeVar("Item")


def in_tied_order(items: Iterable[Item], value: Callable[[Item], float], key: Callable[[Item], Any], tie: float = 1e-9) -> list[Item]:
    """Items by a value. Those that are tied, each within `tie` of the one before, relative to it, are by the key alone."""
    tied: list[list[Item]] = []
    for item in sorted(items, key=value):
        if not tied or value(item) - value(tied[-1][-1]) > tie * abs(value(item)):
            tied.append([])
        tied[-1].append(item)
    return [item for group in tied for item in sorted(group, key=key)]
