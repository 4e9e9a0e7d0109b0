"""Details of a picture shown larger: inside it where they cover no curve, else beside its axes."""

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

__all__ = ["Detail", "Inset", "Place", "draw_insets", "parse_inset", "place_insets"]

_SIZES = ((0.40, 0.36), (0.34, 0.32), (0.30, 0.28))  # parts of the frame, the largest that finds an empty place
_STEPS = 24
_CLEAR = 3.0  # points between a detail and a curve: half a marker on the curve, and some air
_BESIDE, _MOST_BESIDE = 0.34, 0.5  # part of the width that details beside the axes take, and the most that they may
_APART = 14.0  # points between the axes and the details beside them
_LOWEST = 88.0  # points that a detail beside the axes is high at least
_LOW = 70.0  # points: a lower detail has fewer ticks
_MARGIN = (31.0, 24.0, 6.0, 6.0)  # room for its own ticks and labels: left, bottom, right, top, in points
_EDGE = 1.5  # half the width of the room of a frame's edge, in points
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
    the frame (5, 2) around what it shows, in data coordinates, and in points a box around each of its edges."""

    axes: Axes
    box: Box
    letter_box: Box
    inner_letter_box: Box
    frame: np.ndarray
    edges: list[Box]


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


@dataclass(frozen=True, eq=False)
class Place:
    """Where a detail goes: what it shows, its ranges of x and y, the box (4,) in points that it takes with its ticks, and the box of the
    letter beside the frame around what it shows."""

    inset: Inset
    x: tuple[float, float]
    y: tuple[float, float]
    box: np.ndarray
    letter_box: np.ndarray


def place_insets(
    axes: Axes, insets: Sequence[Inset], curves: Sequence[np.ndarray], keep_off: Callable[[], Sequence[Sequence[float]]]
) -> list[Place]:
    """Find a place for each detail: in `axes` where it covers no curve, else beside `axes`, which become narrower for it.

    Parameters
    ----------
    axes : with its final limits and place in the figure, before anything is drawn that depends on that place
    insets : sequence of Inset
    curves : polylines (n, 2) in data coordinates; all that is drawn as a line
    keep_off : callable
        Returns boxes in points that no detail covers, for the present place of `axes`.

    Returns
    -------
    list of Place

    Raises
    ------
    ValueError
        For a detail in which there is nothing, or for which there is no place.
    """
    if not insets:
        return []
    ranges = [_ranges(inset, curves, axes.get_yscale() == "log") for inset in insets]
    to_points = 72 / axes.figure.dpi
    whole = np.array(axes.bbox.extents) * to_points
    beside: list[int] = []
    while True:
        frame = np.array(axes.bbox.extents) * to_points
        cover = Cover(frame.tolist(), [axes.transData.transform(curve) * to_points for curve in curves])
        corners = [axes.transData.transform([(left, low), (right, high)]).ravel() * to_points for (left, right), (low, high) in ranges]
        for inset, shown in zip(insets, corners, strict=True):
            if not cover.within(np.array([shown]))[0]:
                raise ValueError(f"{inset}: nothing is drawn there")
        boxes = dict(zip(beside, _column(insets, beside, corners, frame, whole), strict=True))
        letters = [_beside_frame(shown, cover) for shown in corners]
        taken = [np.array(box) for box in keep_off()] + corners + letters
        for k in range(len(insets)):
            if k in boxes:
                continue
            box = _inside(frame, cover, np.array(taken), _LARGER * (corners[k][2:] - corners[k][:2]))
            if box is None:
                break
            boxes[k] = box
            taken.append(box)
        else:
            return [Place(insets[k], *ranges[k], boxes[k], letters[k]) for k in range(len(insets))]
        # Narrower axes have other empty places: all that are inside are placed anew.
        beside = sorted([*beside, k])
        _narrow(axes, insets, beside, corners, whole)


def _beside_frame(shown: np.ndarray, cover: Cover) -> np.ndarray:
    """The box (4,) of a letter beside an upper corner of what is shown (4,): the right one, unless it hides less at the left one."""
    boxes = np.array([[x, shown[3] - 8.0, x + 8.0, shown[3] + 2.0] for x in (shown[2], shown[0] - 8.0)])
    return np.asarray(boxes[int(np.argmin(cover.within(boxes)))])


def _narrow(axes: Axes, insets: Sequence[Inset], beside: Sequence[int], corners: Sequence[np.ndarray], whole: np.ndarray) -> None:
    """Make room beside the axes, which were `whole` (4,) at first, for the widest of the details, larger than what it shows."""
    width = axes.bbox.width * 72 / axes.figure.dpi
    share, widest = max(((corners[k][2] - corners[k][0]) / width, k) for k in beside)
    full = whole[2] - whole[0]
    margins = _MARGIN[0] + _MARGIN[2] + _APART
    # share of the narrower axes, larger, and the margins fit into what they leave
    part = max(_BESIDE, (_LARGER * share + margins / full) / (1.0 + _LARGER * share))
    if part > _MOST_BESIDE:
        raise ValueError(f"{insets[widest]}: there is no place beside what it shows; expected a smaller part, LO:HI,FLO:FHI")
    place = axes.get_position()
    axes.set_position((place.x0, place.y0, place.width * (1.0 - part) * full / width, place.height))


def _column(
    insets: Sequence[Inset], beside: Sequence[int], corners: Sequence[np.ndarray], frame: np.ndarray, whole: np.ndarray
) -> list[np.ndarray]:
    """The boxes of the details beside the axes, one below the other from the top."""
    if not beside:
        return []
    height = (frame[3] - frame[1]) / len(beside)
    if height < _LOWEST:
        raise ValueError(f"{insets[beside[-1]]}: there is no place beside the others; expected fewer insets or smaller parts")
    out = []
    for row, k in enumerate(beside):
        shown = corners[k][3] - corners[k][1] + _MARGIN[1] + _MARGIN[3]
        high = min(height, max(_LARGER * shown, whole[2] - frame[2] - _APART))
        top = frame[3] - row * height
        out.append(np.array([frame[2] + _APART, top - high, whole[2], top]))
    return out


def draw_insets(axes: Axes, places: Sequence[Place], curves: Sequence[np.ndarray], content: Callable[[Axes, str], None]) -> list[Detail]:
    """Draw each detail in its place, and a frame with the same letter around what it shows.

    Parameters
    ----------
    axes : as `place_insets` left it
    places : as `place_insets` gives them
    curves : polylines (n, 2) in data coordinates, that the letters keep off
    content : draws what `axes` shows into other axes; called with them and a name

    Returns
    -------
    list of Detail
    """
    from matplotlib.patches import Rectangle

    figure = axes.figure
    to_points = 72 / figure.dpi
    size = np.array(figure.bbox.size) * to_points
    logarithmic = axes.get_yscale() == "log"
    out: list[Detail] = []
    for k, place in enumerate(places):
        (left, right), (low, high), box = place.x, place.y, place.box
        letter = "abcdefghijklmnopqrstuvwxyz"[k % 26]
        inner = box + np.array([_MARGIN[0], _MARGIN[1], -_MARGIN[2], -_MARGIN[3]])
        ground = figure.add_axes((box[0] / size[0], box[1] / size[1], (box[2] - box[0]) / size[0], (box[3] - box[1]) / size[1]), zorder=7)
        ground.set_axis_off()
        ground.patch.set_visible(False)
        ground.add_patch(Rectangle((0, 0), 1, 1, transform=ground.transAxes, facecolor="white", edgecolor="none", alpha=0.94))
        panel = figure.add_axes(
            (inner[0] / size[0], inner[1] / size[1], (inner[2] - inner[0]) / size[0], (inner[3] - inner[1]) / size[1]), zorder=8
        )
        panel.set_label(f"inset-{letter}")
        logarithmic_axis(panel, "x", (left, right), 4, "", "")
        ticks = 4 if inner[3] - inner[1] > _LOW else 3
        (logarithmic_axis if logarithmic else linear_axis)(panel, "y", (low, high), ticks, "", "")
        panel.set_xlabel(_symbol(axes.get_xlabel()), fontsize=SMALL, labelpad=0.0)
        panel.set_ylabel(_symbol(axes.get_ylabel()), fontsize=SMALL, labelpad=0.0)
        panel.tick_params(pad=1.5, labelsize=SMALL)
        panel.tick_params(axis="x", pad=5.5)  # below the text of a tick of the other axis in the corner
        content(panel, f"inset-{letter}")
        style: dict[str, Any] = {"ha": "left", "va": "top", "fontsize": NORMAL, "weight": "bold", "zorder": 6}
        style["textcoords"] = "offset points"
        inner_letter_box = _letter(panel, letter, curves, style)
        (border,) = axes.plot([left, right, right, left, left], [low, low, high, high, low], color=BLACK, linewidth=0.7, zorder=5.5)
        border.set_gid(f"inset-{letter}-frame")
        corner = axes.transData.transform((right, high)) * to_points
        shift = (place.letter_box[0] + 1.5 - corner[0], 1.0)
        axes.annotate(letter, (right, high), shift, **style)
        out.append(
            Detail(
                panel,
                (float(box[0]), float(box[1]), float(box[2]), float(box[3])),
                (*place.letter_box.tolist(),),
                inner_letter_box,
                np.array([[left, low], [right, low], [right, high], [left, high], [left, low]]),
                _edges(*(axes.transData.transform([(left, low), (right, high)]).ravel() * to_points)),
            )
        )
    return out


def _symbol(label: str) -> str:
    """The symbol at the end of the label of an axis, which has less room in a detail."""
    return label[label.index("$") :]


def _edges(left: float, bottom: float, right: float, top: float) -> list[Box]:
    """A box around each edge of a frame."""
    corners = ((left, bottom, right, bottom), (left, top, right, top), (left, bottom, left, top), (right, bottom, right, top))
    return [(float(a - _EDGE), float(b - _EDGE), float(c + _EDGE), float(d + _EDGE)) for a, b, c, d in corners]


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


def _inside(frame: np.ndarray, cover: Cover, taken: np.ndarray, inside: np.ndarray) -> np.ndarray | None:
    """The largest box (4,) in the frame that covers no curve and nothing that is taken, with room for `inside` (2,) between its margins;
    None where there is none."""
    whole = frame[2:] - frame[:2]
    least_size = inside + np.array([_MARGIN[0] + _MARGIN[2], _MARGIN[1] + _MARGIN[3]])
    if (least_size > np.array([_WIDEST, _HIGHEST]) * whole).any():
        return None
    for part in _SIZES:
        size = np.maximum(np.array(part) * whole, least_size)
        x = np.linspace(frame[0] + 3.0, frame[2] - 3.0 - size[0], _STEPS)
        y = np.linspace(frame[1] + 3.0, frame[3] - 3.0 - size[1], _STEPS)
        corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([corners, corners + size], axis=1)
        boxes = boxes[~overlapping(boxes, taken).any(axis=1)]
        empty = boxes[cover.within(boxes + np.array([-_CLEAR, -_CLEAR, _CLEAR, _CLEAR])) == 0]
        if len(empty):
            return empty[0]
    return None
