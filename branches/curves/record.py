"""A followed curve of bifurcations or grazings, as data: its points, events and ends. Nothing here follows a curve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from branches.curves.free import FreeKind
from branches.curves.grazing import Grazing
from branches.curves.plane import ParameterPlane
from branches.events import Ended
from bvp.texts import brief

__all__ = ["WORDS", "BifurcationCurve", "CurveEvent"]

WORDS = {
    "SN": "saddle-node (fold)",
    "PD": "period doubling",
    "SB": "symmetry breaking",
    "NS": "Neimark-Sacker bifurcation",
    "BP": "branch point",
    "GR": "grazing",
}
"""Kinds of curves."""


class CurveEvent(NamedTuple):
    """A point of codimension two, or another event of a curve, with its error bar.

    id: type and count along the curve, "CP1". point: index of its point. values: of all parameters. bracket: arclengths between which it
    certainly is. residual: of its test function.
    """

    id: str
    type: str
    point: int
    values: Mapping[str, float]
    arclength: float
    status: str
    bracket: tuple[float, float]
    residual: float
    stop: str | None
    note: str | None


@brief
@dataclass(frozen=True, eq=False)
class BifurcationCurve:
    """A curve in the plane of two parameters, N points in order of arclength.

    Attributes
    ----------
    plane : ParameterPlane
        The problem of its orbits, and the names of the two parameters.
    code : str
        A key of `WORDS`.
    grazing : Grazing or None
        What grazes, on a curve of grazings.
    unknowns : (N, u + e) ndarray
        Of the problem; then, on a curve of pairs, the cosine of their angle.
    tangents : (N, u + e) ndarray
        Unit tangents, along growing arclength.
    parameters : (N, 2) ndarray
    arclength, residual : (N,) ndarray
    multipliers : (N, 2n) ndarray
        Complex; NaN on a curve of grazings.
    coefficient : (N,) ndarray
        Of the normal form; NaN where it is not known.
    events : tuple of CurveEvent
    ended : (Ended, Ended)
        At the first point and at the last.
    start : int
        Index of the point that it was started from.
    closed : bool
    window : ((float, float), (float, float))
        Ranges of the two parameters in which it was followed.
    origin : str
        Where it was started, in words.
    free : FreeKind or None
        What is critical on a curve of bifurcations of free orbits.
    axes : tuple of str
        The two parameters in the order in which tables and figures show them; empty for that of the plane.
    """

    plane: ParameterPlane
    code: str
    grazing: Grazing | None
    unknowns: np.ndarray
    tangents: np.ndarray
    parameters: np.ndarray
    arclength: np.ndarray
    residual: np.ndarray
    multipliers: np.ndarray
    coefficient: np.ndarray
    events: tuple[CurveEvent, ...]
    ended: tuple[Ended, Ended]
    start: int
    closed: bool
    window: tuple[tuple[float, float], tuple[float, float]]
    origin: str = ""
    free: FreeKind | None = None
    axes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.unknowns)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        spans = [f"{name} = {low:.8g} to {high:.8g}" for name, low, high in zip(self.names, *self.span, strict=True)]
        title = f"BifurcationCurve of {len(self)} points, {WORDS[self.code]}, {', '.join(spans)}"
        places = (self.parameters[event.point] for event in self.events)
        return title, [(event.id, f"({a:.12g}, {b:.12g})") for event, (a, b) in zip(self.events, places, strict=True)]

    @property
    def names(self) -> tuple[str, str]:
        """The two parameters."""
        return self.plane.names

    @property
    def shown(self) -> tuple[tuple[str, str], np.ndarray]:
        """The two parameters in the order in which they are shown, and their values (N, 2)."""
        if self.axes != self.names[::-1]:
            return self.names, self.parameters
        return (self.names[1], self.names[0]), self.parameters[:, ::-1]

    @property
    def span(self) -> tuple[list[float], list[float]]:
        """The least and the largest value of each parameter."""
        return self.parameters.min(axis=0).tolist(), self.parameters.max(axis=0).tolist()

    @cached_property
    def cosine(self) -> np.ndarray:
        """Cosine of the angle of the pair on a curve NS, (N,); else NaN."""
        own = self.unknowns[:, self.plane.size :]
        return own[:, 0].copy() if own.shape[1] else np.full(len(self), np.nan)

    @property
    def criticality(self) -> list[str]:
        """At each point "supercritical", "subcritical" or "" where it is not known."""
        if self.code not in ("PD", "SB", "NS"):
            return [""] * len(self)
        above, below = ("subcritical", "supercritical") if self.code == "NS" else ("supercritical", "subcritical")
        return [above if value > 0.0 else below if value < 0.0 else "" for value in self.coefficient.tolist()]
