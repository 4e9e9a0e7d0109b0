"""Insets, which show parts of a figure larger: inside it where they cover no curve, else beside its axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.figures.room import Room, overlapping
from branches.figures.style import BLACK, GREY, SMALL, limits_of, set_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Inset", "Place", "draw_inset", "parse_inset", "place_insets"]

_SIZES = ((0.40, 0.36), (0.34, 0.32), (0.30, 0.28))  # parts of the frame; the largest that finds an empty place is taken
_STEPS = 24
_CLEAR = 3.0  # points between an inset and a curve: half a marker on the curve, and some air
_BESIDE, _MOST_BESIDE = 0.34, 0.5  # part of the width that insets beside the axes take, and the largest that they may take
_APART = 14.0  # points between the axes and the insets beside them
_LOWEST = 88.0  # least height of an inset beside the axes, in points
_TICK = np.array([38.0, 20.0])  # points for each tick
_MARGIN = np.array([31.0, 24.0, -6.0, -6.0])  # room for the ticks and labels of an inset: left, bottom, right, top, in points
_SPACE = _MARGIN[:2] - _MARGIN[2:]
_LARGER = 1.1  # an inset is larger than what it shows by this factor, in both directions where the frame has room
_WIDEST, _HIGHEST = 0.6, 0.8  # largest parts of the frame that an inset takes


@dataclass(frozen=True)
class Inset:
    """A part of the frequency-energy plane: energies, and frequencies (None: those of the curves there)."""

    energy: tuple[float, float]
    frequency: tuple[float, float] | None = None

    def __str__(self) -> str:
        """Its name in a message: what `parse_inset` reads, after the word."""
        ranges = [self.energy] if self.frequency is None else [self.energy, self.frequency]
        return "inset " + ",".join(f"{low:g}:{high:g}" for low, high in ranges)


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
    try:
        ranges = [tuple(float(number) for number in part.split(":")) for part in text.split(",")]
    except ValueError:
        ranges = []
    if not 1 <= len(ranges) <= 2 or not all(len(pair) == 2 and 0.0 < pair[0] < pair[1] < math.inf for pair in ranges):
        raise ValueError(f"inset {text!r}: expected LO:HI in energy or LO:HI,FLO:FHI with the frequencies too, 0 < LO < HI")
    (low, high), *more = ranges
    return Inset((low, high), (more[0][0], more[0][1]) if more else None)


@dataclass(frozen=True, eq=False)
class Place:
    """An inset with the ranges of x and y that it shows, and the box (4,) that it takes with its ticks, in points of the page."""

    inset: Inset
    x: tuple[float, float]
    y: tuple[float, float]
    box: np.ndarray


def place_insets(axes: Axes, insets: Sequence[Inset], curves: Sequence[np.ndarray], room_now: Callable[[], Room]) -> list[Place]:
    """Find a place for each inset: in `axes` where it covers no curve, else beside `axes`, which become narrower for it.

    The axes have their final limits and their place in the figure, and nothing that depends on that place is drawn. The insets show parts
    of the curves (n, 2), in data coordinates. `room_now` returns the room of `axes` in its present place.

    Raises
    ------
    ValueError
        For an inset that shows nothing, and for one without a place.
    """
    if not insets:
        return []
    ranges = [(inset.energy, _frequencies(inset, curves, axes.get_yscale() == "log")) for inset in insets]
    room = room_now()
    whole = room.frame
    beside: list[int] = []
    while True:
        shown = [room.to_page(np.array(part).T).ravel() for part in ranges]
        for inset, box in zip(insets, shown, strict=True):
            if not room.ink_in(box[None])[0]:
                raise ValueError(f"{inset}: nothing is drawn there")
        boxes = dict(zip(beside, _column(insets, beside, shown, room.frame, whole), strict=True))
        for k in range(len(insets)):
            if k in boxes:
                continue
            found = _inside(room, np.array([*shown, *boxes.values()]), _LARGER * (shown[k][2:] - shown[k][:2]) + _SPACE)
            if found is None:
                break
            boxes[k] = found
        else:
            return [Place(insets[k], *ranges[k], boxes[k]) for k in range(len(insets))]
        # Narrower axes have other empty places: all insets inside are placed anew.
        beside = sorted([*beside, k])
        _narrow(axes, insets, beside, shown, whole)
        room = room_now()


def _frequencies(inset: Inset, curves: Sequence[np.ndarray], log: bool) -> tuple[float, float]:
    if inset.frequency is not None:
        return inset.frequency
    points = np.concatenate([*curves, np.empty((0, 2))])
    heights = points[(points[:, 0] >= inset.energy[0]) & (points[:, 0] <= inset.energy[1]), 1]
    if not np.isfinite(heights).any():
        raise ValueError(f"{inset}: no family has a point at these energies")
    return limits_of(heights, log=log)


def _inside(room: Room, taken: np.ndarray, least: np.ndarray) -> np.ndarray | None:
    """The largest box (4,) in the frame that covers neither a curve nor a box that is taken (a, 4), of this size (2,) at least."""
    frame = room.frame
    whole = frame[2:] - frame[:2]
    if (least > np.array([_WIDEST, _HIGHEST]) * whole).any():
        return None
    for part in _SIZES:
        size = np.maximum(np.array(part) * whole, least)
        steps = [np.linspace(frame[i] + 3.0, frame[2 + i] - 3.0 - size[i], _STEPS) for i in range(2)]
        corners = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([corners, corners + size], axis=1)
        boxes = boxes[~overlapping(boxes, taken).any(axis=1) & ~room.taken(boxes)]
        boxes = boxes[room.ink_in(boxes + np.array([-_CLEAR, -_CLEAR, _CLEAR, _CLEAR])) == 0]
        if len(boxes):
            return np.asarray(boxes[0])
    return None


def _narrow(axes: Axes, insets: Sequence[Inset], beside: Sequence[int], shown: Sequence[np.ndarray], whole: np.ndarray) -> None:
    """Make room beside the axes, which were `whole` (4,) at first, for the widest of the insets."""
    width, full = axes.bbox.width * 72 / axes.figure.dpi, whole[2] - whole[0]
    share, widest = max(((shown[k][2] - shown[k][0]) / width, k) for k in beside)
    # The narrower axes leave room for the share of them that is shown, enlarged, and for the margins.
    part = max(_BESIDE, (_LARGER * share + (_SPACE[0] + _APART) / full) / (1.0 + _LARGER * share))
    if part > _MOST_BESIDE:
        raise ValueError(f"{insets[widest]}: there is no place beside what it shows; expected a smaller part, LO:HI,FLO:FHI")
    place = axes.get_position()
    axes.set_position((place.x0, place.y0, place.width * (1.0 - part) * full / width, place.height))


def _column(
    insets: Sequence[Inset], beside: Sequence[int], shown: Sequence[np.ndarray], frame: np.ndarray, whole: np.ndarray
) -> list[np.ndarray]:
    """The boxes of the insets beside the axes, one below the other."""
    if not beside:
        return []
    height = (frame[3] - frame[1]) / len(beside)
    if height < _LOWEST:
        raise ValueError(f"{insets[beside[-1]]}: there is no place beside the others; expected fewer insets or smaller parts")
    out = []
    for row, k in enumerate(beside):
        high = min(height, max(_LARGER * (shown[k][3] - shown[k][1]) + _SPACE[1], whole[2] - frame[2] - _APART))
        top = frame[3] - row * height
        out.append(np.array([frame[2] + _APART, top - high, whole[2], top]))
    return out


def draw_inset(room: Room, place: Place, name: str) -> Axes:
    """Make the axes of an inset. A frame and two lines indicate what it shows; names keep off all of them."""
    axes = room.axes
    left, bottom, right, top = (place.box + _MARGIN) / 72
    panel = axes.inset_axes((left, bottom, right - left, top - bottom), transform=axes.figure.dpi_scale_trans, zorder=7, label=name)
    across, up = np.maximum(2, 72 * np.array([right - left, top - bottom]) // _TICK).astype(int).tolist()
    set_axis(panel, "x", place.x, min(across, 4), "", _symbol(axes.get_xlabel()), log=True)
    set_axis(panel, "y", place.y, min(up, 4), "", _symbol(axes.get_ylabel()), log=axes.get_yscale() == "log")
    for axis in (panel.xaxis, panel.yaxis):
        axis.label.set_fontsize(SMALL)
        axis.labelpad = 0.0
    panel.tick_params(pad=1.5, labelsize=SMALL)
    panel.tick_params(axis="x", pad=5.5)  # below the text of a tick of the other axis in the corner
    indicated = axes.indicate_inset_zoom(panel, edgecolor=BLACK, linewidth=0.7, alpha=1.0, zorder=2.9)
    indicated.rectangle.set_gid(f"{name}-frame")
    lines = [line for line in indicated.connectors or () if line.get_visible()]
    for part in (indicated.rectangle, *lines):
        on_screen = part.get_transform().transform_path(part.get_path()).vertices
        room.take_path(axes.transData.inverted().transform(on_screen))
    for line in lines:
        line.set(linewidth=0.4, edgecolor=GREY)
    room.take(place.box)
    return panel


def _symbol(label: str) -> str:
    """The symbol at the end of the label of an axis, which has less room in an inset."""
    return label[label.index("$") + 1 : -1]
