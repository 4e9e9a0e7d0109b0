"""Details of a picture shown larger inside it: which part, and where the least is covered."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.placement import Cover, overlapping
from branches.diagram.scales import linear_axis, linear_limits, logarithmic_axis
from branches.diagram.style import BLACK, NORMAL, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Detail", "Inset", "draw_insets", "parse_inset"]

_SIZES = ((0.40, 0.36), (0.34, 0.32), (0.30, 0.28), (0.26, 0.24))  # parts of the frame, the largest that finds an empty place
_EMPTY = 5e-4  # a place with a smaller part of its cells occupied counts as empty
_STEPS = 24
_MARGIN = (24.0, 16.0, 6.0, 6.0)  # room for its own ticks: left, bottom, right, top, in points


@dataclass(frozen=True)
class Inset:
    """A part of the frequency-energy plane: energies, and frequencies (None: those of the curves there)."""

    energy: tuple[float, float]
    frequency: tuple[float, float] | None = None


Box = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Detail:
    """A detail that was drawn: its axes, and in points the box that it takes with its ticks, and those of its letter outside and inside;
    the frame (5, 2) around what it shows, in data coordinates."""

    axes: Axes
    box: Box
    letter_box: Box
    inner_letter_box: Box
    frame: np.ndarray


def parse_inset(text: str) -> Inset:
    """Read ``LO:HI`` or ``LO:HI,FLO:FHI``.

    Raises
    ------
    ValueError
        In one line, with what was received and expected.

    Examples
    --------
    >>> parse_inset("1:3,2:5")
    Inset(energy=(1.0, 3.0), frequency=(2.0, 5.0))
    """
    parts = text.split(",")
    ranges: list[tuple[float, float]] = []
    for part in parts:
        try:
            low, high = (float(number) for number in part.split(":"))
        except ValueError:
            low, high = 0.0, 0.0
        if not 0.0 < low < high < math.inf:
            ranges = []
            break
        ranges.append((low, high))
    if not 1 <= len(ranges) <= 2:
        raise ValueError(f"inset {text!r}: expected LO:HI in energy or LO:HI,FLO:FHI with the frequencies too, 0 < LO < HI")
    return Inset(ranges[0], ranges[1] if len(ranges) == 2 else None)


def draw_insets(
    axes: Axes,
    insets: Sequence[Inset],
    curves: Sequence[np.ndarray],
    content: Callable[[Axes, str], None],
    keep_off: Sequence[Sequence[float]] = (),
) -> list[Detail]:
    """Draw each detail in the place of `axes` where it covers least, and a frame with the same letter around what it shows.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    insets : sequence of Inset
    curves : polylines (n, 2) in data coordinates
    content : draws what `axes` shows into other axes; called with them and a name
    keep_off : boxes in points that no detail covers

    Returns
    -------
    list of Detail

    Raises
    ------
    ValueError
        For a detail in which there is nothing.
    """
    if not insets:
        return []
    figure = axes.figure
    to_points = 72 / figure.dpi
    frame = np.array(axes.bbox.extents) * to_points
    paths = [axes.transData.transform(curve) * to_points for curve in curves]
    cover = Cover(frame.tolist(), paths)
    ranges = [_ranges(inset, curves) for inset in insets]
    taken = [np.array(box) for box in keep_off]
    for (left, right), (low, high) in ranges:
        corners = axes.transData.transform([(left, low), (right, high)]) * to_points
        taken.append(np.array([*corners[0], *corners[1]]))
    out: list[Detail] = []
    for k, ((left, right), (low, high)) in enumerate(ranges):
        letter = "abcdefghijklmnopqrstuvwxyz"[k % 26]
        box = _place(frame, cover, np.array(taken))
        taken.append(box)
        inner = box + np.array([_MARGIN[0], _MARGIN[1], -_MARGIN[2], -_MARGIN[3]])
        size = np.array(figure.bbox.size) * to_points
        ground = figure.add_axes((box[0] / size[0], box[1] / size[1], (box[2] - box[0]) / size[0], (box[3] - box[1]) / size[1]), zorder=7)
        ground.set_axis_off()
        ground.patch.set_visible(False)
        from matplotlib.patches import Rectangle

        ground.add_patch(Rectangle((0, 0), 1, 1, transform=ground.transAxes, facecolor="white", edgecolor="none", alpha=0.94))
        panel = figure.add_axes(
            (inner[0] / size[0], inner[1] / size[1], (inner[2] - inner[0]) / size[0], (inner[3] - inner[1]) / size[1]), zorder=8
        )
        panel.set_label(f"inset-{letter}")
        logarithmic_axis(panel, "x", (left, right), 4, "", "")
        linear_axis(panel, "y", (low, high), 4, "", "")
        panel.set_xlabel("")
        panel.set_ylabel("")
        panel.tick_params(pad=1.5, labelsize=SMALL)
        content(panel, f"inset-{letter}")
        style: dict[str, Any] = {"ha": "left", "va": "top", "fontsize": NORMAL, "weight": "bold", "zorder": 6}
        style["textcoords"] = "offset points"
        panel.annotate(letter, (0, 1), (3, -2), xycoords="axes fraction", **style)
        (border,) = axes.plot([left, right, right, left, left], [low, low, high, high, low], color=BLACK, linewidth=0.7, zorder=5.5)
        border.set_gid(f"inset-{letter}-frame")
        axes.annotate(letter, (right, high), (1.5, 1.0), **style)
        corner = axes.transData.transform((right, high)) * to_points
        out.append(
            Detail(
                panel,
                (float(box[0]), float(box[1]), float(box[2]), float(box[3])),
                (corner[0], corner[1] - 8.0, corner[0] + 8.0, corner[1] + 2.0),
                (inner[0], inner[3] - 12.0, inner[0] + 10.0, inner[3]),
                np.array([[left, low], [right, low], [right, high], [left, high], [left, low]]),
            )
        )
    return out


def _ranges(inset: Inset, curves: Sequence[np.ndarray]) -> tuple[tuple[float, float], tuple[float, float]]:
    left, right = inset.energy
    if inset.frequency is not None:
        return inset.energy, inset.frequency
    points = np.concatenate(curves) if curves else np.zeros((0, 2))
    heights = points[(points[:, 0] >= left) & (points[:, 0] <= right), 1]
    heights = heights[np.isfinite(heights)]
    if not len(heights):
        raise ValueError(f"inset {left:g}:{right:g}: no family has a point at these energies")
    return inset.energy, linear_limits(heights, 0.06)


def _place(frame: np.ndarray, cover: Cover, taken: np.ndarray) -> np.ndarray:
    """The box (4,) that covers least of the curves and nothing that is taken: the largest size for which there is an empty one."""
    width, height = frame[2] - frame[0], frame[3] - frame[1]
    best, least = np.array([frame[0], frame[1], frame[0] + 0.24 * width, frame[1] + 0.24 * height]), math.inf
    for part in _SIZES:
        size = np.array([part[0] * width, part[1] * height])
        x = np.linspace(frame[0] + 3.0, frame[2] - 3.0 - size[0], _STEPS)
        y = np.linspace(frame[1] + 3.0, frame[3] - 3.0 - size[1], _STEPS)
        corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([corners, corners + size], axis=1)
        boxes = boxes[~overlapping(boxes, taken).any(axis=1)]
        if not len(boxes):
            continue
        share = cover.within(boxes) / (size[0] * size[1])
        k = int(np.argmin(share))
        if share[k] < least:
            best, least = boxes[k], float(share[k])
        if share[k] <= _EMPTY:
            break
    return best
