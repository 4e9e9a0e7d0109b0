"""Walls a . x = b in a rectangular frame of the plane: the piece of the line inside, and the part of the frame behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def beyond(normal: Sequence[float], bound: float, side: float, frame: Sequence[float]) -> np.ndarray:
    """The part of `frame` (left, bottom, right, top) with side * (normal . x - bound) >= 0: corners (k, 2), k = 0 if none.

    Examples
    --------
    >>> beyond((1.0, 0.0), 1.0, 1.0, (0.0, 0.0, 2.0, 1.0)).tolist()
    [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]]
    """
    left, bottom, right, top = frame
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]], dtype=float)
    height = side * (corners @ np.asarray(normal, dtype=float) - bound)
    kept: list[np.ndarray] = []
    for k in range(4):
        after = (k + 1) % 4
        if height[k] >= 0:
            kept.append(corners[k])
        if (height[k] > 0 > height[after]) or (height[k] < 0 < height[after]):
            kept.append(corners[k] + height[k] / (height[k] - height[after]) * (corners[after] - corners[k]))
    return np.array(kept).reshape(-1, 2)


def segment_within(normal: Sequence[float], bound: float, frame: Sequence[float]) -> np.ndarray | None:
    """The piece (2, 2) of the line normal . x = bound inside `frame` (left, bottom, right, top), None where there is none.

    Examples
    --------
    >>> segment_within((1.0, -1.0), 1.0, (-2.0, -2.0, 2.0, 2.0)).tolist()
    [[-1.0, -2.0], [2.0, 1.0]]
    >>> segment_within((1.0, -1.0), 5.0, (-2.0, -2.0, 2.0, 2.0)) is None
    True
    """
    a = np.asarray(normal, dtype=float)
    if not np.isfinite(bound) or not a.any():
        return None
    foot, along = a * bound / (a @ a), np.array([-a[1], a[0]])
    moving = np.abs(along) > 1e-12 * np.abs(a).max()
    low, high = np.array(frame[:2], dtype=float), np.array(frame[2:], dtype=float)
    if np.any(~moving & ((foot < low) | (foot > high))):
        return None
    to_low, to_high = (low - foot)[moving] / along[moving], (high - foot)[moving] / along[moving]
    enter, leave = np.minimum(to_low, to_high).max(), np.maximum(to_low, to_high).min()
    if enter >= leave:
        return None
    return np.array([foot + enter * along, foot + leave * along])
