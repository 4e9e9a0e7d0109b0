"""Elementary functions by the compiled core: the same bits on every machine, where those of numpy and of the system's library differ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import saltus_core as core

__all__ = ["asin", "asinh", "cos", "exp", "hypot", "log", "sin"]


def _of_any_shape(function: Callable[..., np.ndarray]) -> Callable[..., Any]:
    """A function of lists, for numbers and arrays of any shape."""

    def applied(*given: Any) -> Any:
        arrays = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in given))
        found = function(*(np.ascontiguousarray(x).ravel() for x in arrays)).reshape(arrays[0].shape)
        return found if found.ndim else float(found)

    return applied


asin = _of_any_shape(core.asin)
asinh = _of_any_shape(core.asinh)
cos = _of_any_shape(core.cos)
exp = _of_any_shape(core.exp)
hypot = _of_any_shape(core.hypot)
log = _of_any_shape(core.log)
sin = _of_any_shape(core.sin)
