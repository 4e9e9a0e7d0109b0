"""The picture of a branch: its frequency-energy plot, and two start velocities (or displacements) against energy."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.figures.curves import DrawnCurve, curve_runs, draw_curve, draw_events, legend_entries, smooth, visible_codes
from branches.figures.room import Room
from branches.figures.style import event_look, legend_below, limits_of, new_figure, picture_settings, set_axis, settle_layout
from branches.figures.titles import family_text, symbol_of, system_text
from bvp.texts import shown as in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREQUENCIES = ("index", "fundamental")
_WIDE, _NARROW = (470.0, 170.0), (210.0, 130.0)  # panels in points (1/72 inch), nearly
_MANY_FOLD = 20.0  # frequencies that rise by more than this get a logarithmic axis too: the low ones would be one line
_FAR, _BESIDE = 150.0, 4.5  # distances of names from their markers, in points: largest, and without a leader
_CROWD, _CROWD_STEP = 5, 2.5  # this many points, each this near to the one before (points), share one text
_LETTERS = 24  # in a line of a text for several points


class _Panel(NamedTuple):
    """One panel's data: values (N,) over the points and (E,) over the events, where the curve breaks, and the axis text."""

    name: str
    values: np.ndarray
    event_values: np.ndarray
    breaks: np.ndarray
    words: str
    symbol: str
    note: str = ""


def branch_figure(branch: Any, *, frequency: str = "index") -> Figure:
    """The figure of a branch (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 6 and 8).

    Parameters
    ----------
    branch : Branch
    frequency : "index" (m 2 pi/T) or "fundamental" (2 pi/T)

    Returns
    -------
    matplotlib.figure.Figure
        With a frequency-energy plot (its frequency axis is logarithmic as well where frequencies rise more than
        twentyfold) and, for each of two coordinates (one, if the system has one), its start velocity
        against energy - the start displacement where no start of the branch has zero displacement.

    Raises
    ------
    ValueError
        For another frequency, a branch without points, and energies that a logarithmic axis cannot show.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {in_words(frequency)}: expected index or fundamental")
    energies = np.asarray(branch.points["h"], dtype=float)
    if not len(energies):
        raise ValueError("the branch has no points to draw")
    if not energies.min() > 0:
        raise ValueError(f"the logarithmic energy axis needs positive energies: the lowest is {energies.min():.6g}")
    panels = [frequency_panel(branch, frequency), *_start_panels(branch)]
    event_energies = np.array([event.h for event in branch.events], dtype=float)
    names, kinds = [event.id for event in branch.events], [event.type for event in branch.events]
    with picture_settings():
        figure = new_figure(5.4)
        figure.suptitle(f"{family_text(branch.label, branch.ends, branch.sequence)}   ({system_text(branch.system)})")
        layout: list[Any] = [["frequency"] * (len(panels) - 1), [panel.name for panel in panels[1:]]]
        axes = figure.subplot_mosaic(layout, height_ratios=[1.25, 1.0])
        drawn = []
        for panel in panels:
            wide = panel.name == "frequency" or len(panels) == 2
            set_axis(axes[panel.name], "x", limits_of(energies, log=True), 14 if wide else 7, "energy", "h", log=True)
            margin = (0.18 if wide else 0.22) if kinds else 0.08  # room for a name above and below
            shown = np.concatenate([panel.values, panel.event_values])
            log = bool(panel.name == "frequency" and np.nanmax(shown) > _MANY_FOLD * np.nanmin(shown) > 0)
            set_axis(axes[panel.name], "y", limits_of(shown, margin, log=log), 5, panel.words, panel.symbol, log=log)
            if panel.note:
                axes[panel.name].set_ylabel(axes[panel.name].get_ylabel() + panel.note)
            curve = panel_curve(branch, panel, wide=wide)
            drawn.append((axes[panel.name], panel, curve, curve_runs(curve.stable, curve.x, curve.y, curve.breaks)))
        entries = legend_entries(visible_codes((axes, runs) for axes, _, _, runs in drawn), kinds)
        columns = -(-len(entries) // -(-len(entries) // 6))
        legend = legend_below(figure, entries, columns, title=" " if kinds else None)  # space for the words below
        settle_layout(figure)
        left_out = names_in_all = 0
        for panel_axes, panel, curve, runs in drawn:
            draw_curve(panel_axes, runs, panel.name)
            places = np.stack([event_energies, panel.event_values], axis=1)
            draw_events(panel_axes, kinds, places, panel.name, clip_on=False)
            path = np.insert(np.stack([curve.x, curve.y], axis=1), np.flatnonzero(curve.breaks) + 1, np.nan, axis=0)
            missing, count = write_events(Room(panel_axes, [path]), names, kinds, places)
            left_out, names_in_all = left_out + missing, names_in_all + count
        if left_out:
            legend.set_title(f"{left_out} of {names_in_all} names have no room")
    return figure


def write_events(room: Room, names: Sequence[str], kinds: Sequence[str], places: np.ndarray) -> tuple[int, int]:
    """Write the names of special points at places (E, 2); those that are not finite are left out. Returns how many names have no room, and
    how many there are."""
    shown = np.flatnonzero(np.isfinite(places).all(axis=1)).tolist()
    radii = np.array([0.5 * event_look(kinds[i])["markersize"] + 0.5 for i in shown])
    room.take_around(places[shown], radii)
    texts = crowds([names[i] for i in shown], [kinds[i] for i in shown], room.to_page(places[shown]))
    rows = [row for row, _ in texts]
    at, radii = room.to_page(places[shown])[rows], radii[rows]
    waiting = list(range(len(texts)))
    for over_curves in (False, True):
        some = [texts[i][1] for i in waiting]
        done = room.write(some, at[waiting], radii[waiting], far=_FAR, beside=_BESIDE, over_curves=over_curves)
        waiting = [i for i, text in zip(waiting, done, strict=True) if text is None]
    return len(waiting), len(texts)


def crowds(names: Sequence[str], kinds: Sequence[str], at: np.ndarray) -> list[tuple[int, str]]:
    """The texts to write: (row of the point that it belongs to, text), for points at places (E, 2) of the page.

    Each point has its own name. But `_CROWD` or more successive points of one type, each within `_CROWD_STEP` points of the one before,
    share one text such as GR1-12. So do points of several types in one place, whose markers hide each other.
    """
    places: list[tuple[int, list[str]]] = []
    for kind in dict.fromkeys(kinds):
        rows = np.array([row for row, k in enumerate(kinds) if k == kind])
        far = np.flatnonzero(np.hypot(*np.diff(at[rows], axis=0).T) > _CROWD_STEP) + 1
        for crowd in np.split(rows, far):
            texts = [(int(row), names[row]) for row in crowd]
            if len(crowd) >= _CROWD:
                texts = [(int(crowd[len(crowd) // 2]), f"{names[crowd[0]]}\N{EN DASH}{names[crowd[-1]].removeprefix(kind)}")]
            for row, text in texts:
                same = next((found for other, found in places if np.hypot(*(at[other] - at[row])) <= _CROWD_STEP), None)
                if same is None:
                    places.append((row, [text]))
                else:
                    same.append(text)
    return [(row, textwrap.fill(", ".join(found), _LETTERS)) for row, found in places]


def panel_curve(branch: Any, panel: _Panel, *, wide: bool) -> DrawnCurve:
    """The curve of a panel as it is drawn: smooth, and after a break from where the piece before it ended."""
    points = branch.points
    x, arclength = np.asarray(points["h"], dtype=float), np.asarray(points["arclength"], dtype=float)
    stable, y, at = np.asarray(points["stable"]).astype(int), panel.values, np.flatnonzero(panel.breaks)
    breaks = panel.breaks
    if at.size:
        # The index jumps at the point before the break, whose frequency the next piece has with its own m.
        turned = y[at] * points["half_waves"][at + 1] / points["half_waves"][at]
        x, stable, arclength = (np.insert(column, at + 1, column[at]) for column in (x, stable, arclength))
        y = np.insert(y, at + 1, turned)
        breaks = np.insert(breaks, at + 1, False)
    return smooth(DrawnCurve(x, y, stable, breaks), arclength, _WIDE if wide else _NARROW)


def _at_events(branch: Any, values: np.ndarray) -> np.ndarray:
    """The values (N,) of a quantity at the branch's events: linear in arclength, so a marker is on the drawn curve."""
    arclength = np.asarray(branch.points["arclength"], dtype=float)
    at = np.array([event.arclength for event in branch.events], dtype=float)
    nearest = np.array([event.point for event in branch.events], dtype=int)
    finite = np.isfinite(values)
    if not len(at) or not finite.any():
        return np.full(len(at), np.nan)
    between = np.interp(at, arclength[finite], values[finite])
    exact = np.abs(arclength[nearest] - at) <= 1e-12 * np.maximum(1.0, np.abs(at))
    return np.where(exact & finite[nearest], values[nearest], between)


def frequency_panel(branch: Any, frequency: str) -> _Panel:
    """The data of the frequency-energy plot."""
    half_waves = np.asarray(branch.points["half_waves"])
    values = np.asarray(branch.points["frequency"], dtype=float)
    at_events = _at_events(branch, values)
    if frequency == "fundamental":
        return _Panel("frequency", values, at_events, np.zeros(len(half_waves) - 1, dtype=bool), "frequency", r"2\pi/T")
    index = np.asarray(branch.points["frequency_index"], dtype=float)
    at_events = half_waves[np.array([event.point for event in branch.events], dtype=int)] * at_events
    return _Panel("frequency", index, at_events, np.diff(half_waves) != 0, "frequency index", r"m\,2\pi/T")


def _start_panels(branch: Any) -> list[_Panel]:
    """The data of the start velocities of absorber and primary; of their start displacements if no start is at u = 0."""
    points, system = branch.points, branch.system
    chosen = [system.absorber, system.primary]
    if None in chosen:
        chosen = list(range(min(2, len(system.coordinates))))
    values, words, note = np.asarray(points["velocities"], dtype=float), "start velocity", ""
    moving = bool(np.isfinite(values).any())
    if not moving:
        values, words, note = np.asarray(points["start_u"], dtype=float), "start displacement", "\n(no start has zero displacement)"
    panels = []
    for k in chosen:
        symbol = f"{symbol_of(system.coordinates[k], velocity=moving)}(0)"
        unbroken = np.zeros(len(values) - 1, dtype=bool)
        panels.append(_Panel(f"start{k}", values[:, k], _at_events(branch, values[:, k]), unbroken, words, symbol, note))
    return panels
