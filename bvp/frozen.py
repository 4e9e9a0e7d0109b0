"""Data that cannot be changed by mistake: what an object hands out is what it goes on computing with."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np

__all__ = ["Frozen", "changeable", "read_only"]


def read_only(array: np.ndarray) -> np.ndarray:
    """The same numbers as an array that cannot be written to, nor be made so: not a copy, its memory is lent by a read-only buffer.

    Examples
    --------
    >>> read_only(np.zeros(2))[0] = 1.0
    Traceback (most recent call last):
    ValueError: assignment destination is read-only
    >>> read_only(np.zeros(2)).setflags(write=True)
    Traceback (most recent call last):
    ValueError: cannot set WRITEABLE flag to True of this array
    """
    if isinstance(array.base, memoryview) and not array.flags.writeable:
        return array
    return np.asarray(memoryview(array).toreadonly())  # type: ignore[arg-type]


def changeable(array: np.ndarray) -> np.ndarray:
    """The array, contiguous, as kernels are compiled for: a copy where it cannot be written to.

    Examples
    --------
    >>> changeable(read_only(np.zeros(2))).flags.writeable
    True
    """
    array = np.ascontiguousarray(array)
    return array if array.flags.writeable else array.copy()


class Frozen(dict[str, Any]):
    """A dict that cannot be changed; its arrays cannot either. `dict(frozen)` and `frozen | other` are ordinary dicts.

    Examples
    --------
    >>> frozen = Frozen({"h": np.ones(3)})
    >>> frozen["h"] = 2.0
    Traceback (most recent call last):
    TypeError: these data cannot be changed; expected a change of a copy, dict(data)
    >>> frozen["h"].flags.writeable, dict(frozen | {"h": 2.0})
    (False, {'h': 2.0})
    """

    def __init__(self, *content: Any) -> None:
        super().__init__({key: read_only(value) if isinstance(value, np.ndarray) else value for key, value in dict(*content).items()})

    def __reduce__(self) -> tuple[type[Frozen], tuple[dict[str, Any]]]:
        return Frozen, (dict(self),)

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("these data cannot be changed; expected a change of a copy, dict(data)")

    __setitem__ = __delitem__ = clear = pop = popitem = setdefault = update = __ior__ = _refuse
