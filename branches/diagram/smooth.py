"""Curves through the points of a branch, finer than the points where these stand far apart in the picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_SPACING = 3.0  # points (1/72 inch) between the places that are drawn
_MOST = 64  # places added between two points


class Curve(NamedTuple):
    """A curve as it is drawn: x, y (N,), stability codes (N,), and where it must not be joined (N-1,)."""

    x: np.ndarray
    y: np.ndarray
    stable: np.ndarray
    breaks: np.ndarray


def segment_kinds(stable: np.ndarray) -> np.ndarray:
    """Stability (N-1,) of the pieces between N points: stable only where both ends are; a single undecided point between
    decided ones (an event, where the multiplier sits on the limit) takes the side of each neighbour."""
    stable = np.asarray(stable).astype(int)
    padded = np.concatenate([[0], stable, [0]])
    lone = (stable == -1) & (padded[:-2] != -1) & (padded[2:] != -1)
    a, b = stable[:-1], stable[1:]
    mixed = np.where((a == -1) | (b == -1), -1, 0)
    return np.where(a == b, a, np.where(lone[:-1], b, np.where(lone[1:], a, mixed)))


def smooth(curve: Curve, arclength: np.ndarray, size: tuple[float, float]) -> Curve:
    """The curve with places between its points, on a cubic of the arclength that passes through every point and stays between
    neighbours (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238), so it has no bend that the points do not have.

    Parameters
    ----------
    curve : Curve
        x positive: it is interpolated by its logarithm.
    arclength : (N,) not falling
    size : (width, height) of the panel in points

    Returns
    -------
    Curve
        All points of `curve` in their order, with places between those that stand far apart; nothing before the first point of
        a piece and nothing behind its last.
    """
    count = len(curve.x)
    kinds = segment_kinds(curve.stable)
    level = np.log(curve.x)
    finite = np.isfinite(curve.y) & np.isfinite(level)
    joined = ~curve.breaks & finite[:-1] & finite[1:] & (np.diff(arclength) > 0.0)
    columns = np.stack([level, curve.y], axis=1)
    extent = np.array([np.ptp(column[finite]) if finite.any() else 0.0 for column in columns.T])
    scale = np.array(size) / np.where(extent > 0.0, extent, np.inf)
    steps = np.hypot(*(np.diff(columns, axis=0) * scale).T)
    added = np.where(joined, np.clip(np.ceil(np.where(joined, steps, 0.0) / _SPACING) - 1, 0, _MOST), 0).astype(int)
    pieces = np.split(np.arange(count), np.flatnonzero(~joined) + 1)
    for piece in pieces:
        if len(piece) == 2:
            added[piece[0]] = 0  # a straight line needs no places
    if not added.any():
        return curve
    parts: list[np.ndarray] = []
    stable: list[np.ndarray] = []
    for piece in pieces:
        parts.append(_places(piece, columns, arclength, added))
        codes = [curve.stable[piece[:1]]]
        for i in piece[:-1]:
            codes += [np.full(added[i], kinds[i]), curve.stable[i + 1 : i + 2]]
        stable.append(np.concatenate(codes))
    breaks = np.concatenate([np.append(np.zeros(len(part) - 1, dtype=bool), True) for part in parts])[:-1]
    whole = np.concatenate(parts)
    given = np.cumsum(np.concatenate([[0], 1 + added]))
    x = np.exp(whole[:, 0])
    x[given] = curve.x  # to the bit
    return Curve(x, whole[:, 1], np.concatenate(stable), breaks)


def _places(piece: np.ndarray, columns: np.ndarray, arclength: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Rows (log x, y) of one piece, with the places added between its points."""
    if not added[piece[:-1]].any():
        return columns[piece]
    from scipy.interpolate import PchipInterpolator

    s = arclength[piece]
    at = [s[:1]]
    for i, j in zip(piece, piece[1:], strict=False):
        at.append(np.linspace(arclength[i], arclength[j], added[i] + 2)[1:])
    places = PchipInterpolator(s, columns[piece])(np.concatenate(at))
    places[np.cumsum(np.concatenate([[0], 1 + added[piece[:-1]]]))] = columns[piece]
    return places
