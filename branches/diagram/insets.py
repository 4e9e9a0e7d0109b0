"""Details of a picture shown larger inside it: which part, and where the least is covered."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.placement import Cover, overlapping
from branches.diagram.scales import linear_axis, linear_limits, logarithmic_axis, logarithmic_limits
from branches.diagram.style import BLACK, NORMAL, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Detail", "Inset", "draw_insets", "parse_inset"]

_SIZES = ((0.40, 0.36), (0.34, 0.32), (0.30, 0.28), (0.26, 0.24))  # parts of the frame, the largest that finds an empty place
_EMPTY = 5e-4  # a place with a smaller part of its cells occupied counts as empty
_STEPS = 24
_MARGIN = (24.0, 20.0, 6.0, 6.0)  # room for its own ticks: left, bottom, right, top, in points
_LETTER = (10.0, 12.0)  # room of its letter, in points
_LARGER = 1.1  # times that a detail is larger than what it shows, in both directions where the frame has room
_WIDEST, _HIGHEST = 0.6, 0.8  # parts of the frame that a detail takes at most


@dataclass(frozen=True)
class Inset:
    """A part of the frequency-energy plane: energies, and frequencies (None: those of the curves there)."""

    energy: tuple[float, float]
    frequency: tuple[float, float] | None = None

    def __str__(self) -> str:
        """Its name in a message: what `parse_inset` reads, after the word."""
        ranges = [self.energy] if self.frequency is None else [self.energy, self.frequency]
        return "inset " + ",".join(f"{low:g}:{high:g}" for low, high in ranges)


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
        For a detail in which there is nothing, or for which there is no place.
    """
    if not insets:
        return []
    figure = axes.figure
    to_points = 72 / figure.dpi
    frame = np.array(axes.bbox.extents) * to_points
    paths = [axes.transData.transform(curve) * to_points for curve in curves]
    cover = Cover(frame.tolist(), paths)
    logarithmic = axes.get_yscale() == "log"
    ranges = [_ranges(inset, curves, logarithmic) for inset in insets]
    corners = [axes.transData.transform([(left, low), (right, high)]).ravel() * to_points for (left, right), (low, high) in ranges]
    for inset, shown in zip(insets, corners, strict=True):
        if not cover.within(np.array([shown]))[0]:
            raise ValueError(f"{inset}: nothing is drawn there")
    taken = [np.array(box) for box in keep_off] + corners
    out: list[Detail] = []
    for k, ((left, right), (low, high)) in enumerate(ranges):
        letter = "abcdefghijklmnopqrstuvwxyz"[k % 26]
        box = _place(frame, cover, np.array(taken), _LARGER * (corners[k][2:] - corners[k][:2]))
        if box is None:
            raise ValueError(f"{insets[k]}: there is no place beside what it shows; expected a smaller part, LO:HI,FLO:FHI")
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
        (logarithmic_axis if logarithmic else linear_axis)(panel, "y", (low, high), 4, "", "")
        panel.set_xlabel("")
        panel.set_ylabel("")
        panel.tick_params(pad=1.5, labelsize=SMALL)
        panel.tick_params(axis="x", pad=5.5)  # below the text of a tick of the other axis in the corner
        content(panel, f"inset-{letter}")
        style: dict[str, Any] = {"ha": "left", "va": "top", "fontsize": NORMAL, "weight": "bold", "zorder": 6}
        style["textcoords"] = "offset points"
        inner_letter_box = _letter(panel, letter, curves, style)
        (border,) = axes.plot([left, right, right, left, left], [low, low, high, high, low], color=BLACK, linewidth=0.7, zorder=5.5)
        border.set_gid(f"inset-{letter}-frame")
        axes.annotate(letter, (right, high), (1.5, 1.0), **style)
        corner = axes.transData.transform((right, high)) * to_points
        out.append(
            Detail(
                panel,
                (float(box[0]), float(box[1]), float(box[2]), float(box[3])),
                (corner[0], corner[1] - 8.0, corner[0] + 8.0, corner[1] + 2.0),
                inner_letter_box,
                np.array([[left, low], [right, low], [right, high], [left, high], [left, low]]),
            )
        )
    return out


def _letter(panel: Axes, letter: str, curves: Sequence[np.ndarray], style: dict[str, Any]) -> Box:
    """Write the letter into the corner of a detail where it hides least, the upper left one if it can; its box in points."""
    to_points = 72 / panel.figure.dpi
    left, bottom, right, top = (float(edge) for edge in np.array(panel.bbox.extents) * to_points)
    cover = Cover((left, bottom, right, top), [panel.transData.transform(curve) * to_points for curve in curves])
    wide, high = _LETTER
    boxes = [(x, y, x + wide, y + high) for y in (top - high, bottom) for x in (left, right - wide)]
    k = int(np.argmin(cover.within(np.array(boxes))))
    shift = (3.0 if k % 2 == 0 else 3.0 - wide, -2.0 if k < 2 else high - 2.0)
    panel.annotate(letter, (k % 2, 1 - k // 2), shift, xycoords="axes fraction", **style)
    return boxes[k]


def _ranges(inset: Inset, curves: Sequence[np.ndarray], logarithmic: bool) -> tuple[tuple[float, float], tuple[float, float]]:
    left, right = inset.energy
    if inset.frequency is not None:
        return inset.energy, inset.frequency
    points = np.concatenate(curves) if curves else np.zeros((0, 2))
    heights = points[(points[:, 0] >= left) & (points[:, 0] <= right), 1]
    heights = heights[np.isfinite(heights)]
    if not len(heights):
        raise ValueError(f"{inset}: no family has a point at these energies")
    return inset.energy, logarithmic_limits(heights, 0.06) if logarithmic else linear_limits(heights, 0.06)


def _place(frame: np.ndarray, cover: Cover, taken: np.ndarray, inside: np.ndarray) -> np.ndarray | None:
    """The box (4,) that covers least of the curves and nothing that is taken: the largest size for which there is an empty one.

    It has room for `inside` (2,) between its margins, if need be in its width only, or as much as there is; None where it has no place."""
    whole = frame[2:] - frame[:2]
    room = inside + np.array([_MARGIN[0] + _MARGIN[2], _MARGIN[1] + _MARGIN[3]])
    for least_size in (room, np.array([room[0], 0.0]), np.zeros(2)):
        if (least_size > np.array([_WIDEST, _HIGHEST]) * whole).any():
            continue
        best, least = None, math.inf
        for part in _SIZES:
            size = np.maximum(np.array(part) * whole, least_size)
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
        if best is not None:
            return best
    return None
