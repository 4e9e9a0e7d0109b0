"""The figure of a motion: its time series, its energy, its spectrum, and the spectrum against energy over the families."""

from __future__ import annotations

import os
import string
import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from branches.figures.atlas import draw_modes, frequency_curve, mode_names, runs_of
from branches.figures.curves import FREQUENCIES, draw_curve, legend_entries
from branches.figures.room import Named, Room, names_of, write_names
from transitions.frequencies import SHARE
from transitions.spectrum import Spectrum, TooCoarse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from branches.figures.atlas_data import Atlas
    from transitions.frequencies import IntrinsicModes
    from transitions.record import SampledMotion
    from transitions.stage import Stage, StartFamily
    from transitions.transition import Transition

__all__ = ["band", "draw_transition", "gradual_energy", "over_energy", "shown_spectrum", "transition_figure"]

_POWER = 1e-3  # part of the power above the highest frequency of the first and last parts of a record


def shown_spectrum(transition: Transition) -> Spectrum:
    """The spectrum of a motion, which includes fast oscillations near the ends of its record.

    By default a spectrum covers the band of the record under a window that vanishes at both ends. A damped motion is fastest where it
    begins, so the band of the record with mirror images before and behind it may reach higher.
    """
    spectrum, record = transition.spectrum, transition.record
    if transition.frequencies is not None:
        return spectrum
    w, _ = record.along(transition.gap)
    padded = np.pad(w - w.mean(), len(w) // 2, mode="reflect")
    power = np.abs(np.fft.rfft(padded * np.hanning(len(padded)))) ** 2
    if not power.sum() > 0.0:
        return spectrum
    shares = np.cumsum(power) / power.sum()
    high = 4.0 * np.pi * float(np.fft.rfftfreq(len(padded), record.step)[np.searchsorted(shares, 1.0 - _POWER)])
    if high <= spectrum.frequencies[-1]:
        return spectrum
    try:
        return replace(transition, frequencies=(float(spectrum.frequencies[0]), high)).spectrum
    except TooCoarse:
        return spectrum


def band(spectrum: Spectrum) -> tuple[float, float]:
    """Lowest and highest frequency with a fifth of the largest amplitude at any time, with room for names below and a third of an octave
    above. Low frequencies do not count where the edges of the record are felt: what begins there is no slow motion."""
    clear = spectrum.frequencies[:, None] > spectrum.cone[None, :]
    inside = np.where(clear, spectrum.amplitudes, 0.0) if clear.any() else spectrum.amplitudes
    last = len(spectrum.frequencies) - 1
    slow = np.flatnonzero(inside.max(axis=1) >= SHARE * inside.max())
    fast = np.flatnonzero(spectrum.amplitudes.max(axis=1) >= SHARE * inside.max())
    if not len(slow):
        return float(spectrum.frequencies[0]), float(spectrum.frequencies[last])
    high = float(spectrum.frequencies[min(last, int(fast[-1]) + max(1, round(1.0 / (3.0 * spectrum.octaves))))])
    low = float(spectrum.frequencies[max(0, int(slow[0]) - 1)])
    return max(float(spectrum.frequencies[0]), low - 0.1 * (high - low)), high


def gradual_energy(record: SampledMotion, times: np.ndarray) -> np.ndarray:
    """The energy at some times (m,) with its jumps at impacts smoothed. Each jump of its logarithm is spread over the time before and after
    the impact, half of the shorter neighbouring flight on each side.

    In an undamped system the energy is constant between impacts. Amplitudes drawn over it would fill a few columns only. A wavelet
    averages over several flights anyway.
    """
    level = np.log(np.maximum(record.energy, 1e-300))
    out = np.interp(times, record.times, level)
    if not len(record.impacts):
        return np.exp(out)
    edges = np.concatenate([record.times[:1], record.impacts, record.times[-1:]])
    reach = 0.5 * np.minimum(np.diff(edges)[:-1], np.diff(edges)[1:])
    for time, half in zip(record.impacts, reach, strict=True):
        # The record holds the impact between two samples.
        k = int(np.clip(np.searchsorted(record.times, time), 1, len(level) - 1))
        jump = level[k] - level[k - 1]
        near = slice(*np.searchsorted(times, (min(time - half, record.times[k - 1]), max(time + half, record.times[k]))))
        at = times[near]
        step = np.interp(at, record.times[[k - 1, k]], (0.0, 1.0))
        ramp = np.clip(0.5 + 0.5 * (at - time) / half, 0.0, 1.0) if half > 0.0 else step
        out[near] += jump * (ramp - step)
    return np.exp(out)


def over_energy(energies: np.ndarray, amplitudes: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Amplitudes (k, m) of a motion with energies (m,) at successive times, at each frequency in intervals of the energy: (k, j).

    Each is the largest amplitude that the motion has while its energy is between two of the edges (j + 1,); NaN where it never is. An
    impact takes energy at once: the intervals that are passed then have amplitudes between those at the times before and after it, in the
    logarithm of the energy.
    """
    level, bounds = np.log(energies), np.log(edges)
    out = np.full((len(amplitudes), len(edges) - 1), -np.inf)
    middles = 0.5 * (bounds[1:] + bounds[:-1])
    place = np.clip(np.searchsorted(bounds, level, side="right") - 1, 0, len(middles) - 1)
    inside = (level >= bounds[0]) & (level <= bounds[-1])
    for column in np.flatnonzero(inside):
        np.maximum(out[:, place[column]], amplitudes[:, column], out=out[:, place[column]])
    for column in np.flatnonzero(np.abs(np.diff(place)) > 1):
        low, high = sorted((place[column], place[column + 1]))
        between = np.arange(low + 1, high)
        part = (middles[between] - level[column]) / (level[column + 1] - level[column])
        passed = amplitudes[:, column, None] * (1.0 - part) + amplitudes[:, column + 1, None] * part
        out[:, between] = np.maximum(out[:, between], passed)
    return np.where(np.isfinite(out), out, np.nan)


_COLUMNS, _INTERVALS = 1400, 600  # times, and intervals of energy, that a spectrum is drawn at
_DARK = 0.65  # of the way to black that the largest amplitude goes: lines and names on it stay in sight
_MANY_FOLD = 10.0  # a range of frequencies that rises by more gets a logarithmic axis
_FINE = 0.55  # families, thinner than in a figure of their own
_LETTER_HIGH, _LETTER_FAR = 12.0, 30.0  # points from the upper edge to the place of a letter, and from there to the letter
_MOST_LETTERS = 12
_HEIGHT, _ROW = 6.6, 1.1  # of the panels, and of a row of an empirical mode, in inches; what is written below comes in addition
_MOST_MODES, _FAINT_MODE = 4, 0.1  # empirical modes that are drawn; frequencies count from this part of their largest amplitude on
_CAPTION = 150  # letters in a line of the caption
_MOST_NAMES = 12
_RADIUS = 3.0  # of the bullets of linear modes, in points
_ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "frameon": False, "borderaxespad": 0.1}
_DEEP = 1e-8  # of the largest energy: what is below is not shown


def draw_transition(
    transition: Transition,
    atlas: Atlas | None,
    path_or_file: str | os.PathLike[str] | IO[bytes],
    *,
    caption: str = "",
    window: tuple[float, float] | None = None,
    modes: IntrinsicModes | None = None,
    format: str | None = None,
) -> None:
    """Write the figure of a motion to a png, pdf or svg file.

    Parameters
    ----------
    transition : Transition
    atlas : Atlas or None
        The families that the spectrum is laid over; see `transitions.transition.atlas_behind`.
    path_or_file : path, or binary file open for writing
    caption, window, modes
        As for `transition_figure`.
    format : "png", "pdf" or "svg"; by default what the file's name ends with

    Notes
    -----
    The panels are those of Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 11 to 20.
    """
    options: dict[str, Any] = {"window": window, "modes": modes}
    style.write_figure(transition_figure, path_or_file, transition, atlas, caption, format=format, **options)


def transition_figure(
    transition: Transition,
    atlas: Atlas | None = None,
    caption: str = "",
    *,
    window: tuple[float, float] | None = None,
    modes: IntrinsicModes | None = None,
) -> Figure:
    """The figure of a motion as a matplotlib figure.

    Parameters
    ----------
    transition : Transition
    atlas : Atlas, optional
    caption : str
        A text under the panels.
    window : (float, float), optional
        The times that are shown, and the energies at them. The spectrum is that of the full motion.
    modes : IntrinsicModes, optional
        Empirical modes of the relative displacement; the strongest have panels of their own.

    Returns
    -------
    matplotlib.figure.Figure
        (a) displacements; (b) shares of the sink and the oscillator in the energy of the moment, or, of a system without a sink, the energy
        in parts of that at the start; (c) the total energy, and what the sink, the oscillator and both have dissipated, in parts of the
        energy at the start; without a sink the stops and the rest; (d) wavelet spectrum of the relative displacement, hatched where the
        edges of the record are felt; (e) the same with the energy of the moment as abscissa (`gradual_energy`), over the families; (f),
        (g), ... an empirical mode and its instantaneous
        frequency, where its amplitude is a tenth of the largest. The stages are lettered, and what each follows is said below.

    Raises
    ------
    ValueError
        For an atlas in other units or of another system, a motion without energy, or a window without two of its times.
    """
    record = transition.record
    if not record.energy.max() > 0.0:
        raise ValueError("the motion has no energy: there is nothing to draw")
    if atlas is not None:
        from transitions.transition import require_same

        require_same(atlas.system, transition.system)
        if (atlas.clearance, atlas.natural_frequency) != (1.0, 1.0):
            raise ValueError(f"a motion is in natural units; the families have a clearance of {atlas.clearance:g}")
        atlas = _with_name(atlas, transition.start)
    times = window or (float(record.times[0]), float(record.times[-1]))
    inside = (record.times >= times[0]) & (record.times <= times[1])
    spectrum = _within(shown_spectrum(transition), times)
    if np.count_nonzero(inside) < 2 or len(spectrum.times) < 2:
        lasts = f"the motion lasts from {record.times[0]:g} to {record.times[-1]:g}"
        raise ValueError(f"{lasts}: too little of it is between {times[0]:g} and {times[1]:g}")
    stages = [
        (letter, stage)
        for letter, stage in zip(_letters(len(transition.stages)), transition.stages, strict=True)
        if stage.end > times[0] and stage.start < times[1]
    ]
    strength = np.zeros(0) if modes is None else np.sum(modes.functions**2, axis=1)
    chosen = sorted(np.argsort(-strength, kind="stable")[:_MOST_MODES].tolist())  # the numbers of the strongest, the fastest first
    height = _HEIGHT + _ROW * len(chosen)
    with style.figure_settings():
        figure = style.new_figure(height)
        begin = "rest" if record.from_rest else rf"energy $h = {record.energy[0]:.6g}$"
        figure.suptitle(f"Motion from {begin}   ({style.system_text(transition.system)})")
        below: list[Any] = [[f"mode{k}", f"rate{k}"] for k in chosen]
        axes = figure.subplot_mosaic(
            [["series", "series"], ["share", "lost"], ["spectrum", "families"], *below],
            height_ratios=[0.72, 0.8, 1.25, *(0.5 for _ in chosen)], width_ratios=[1.0, 1.0],
        )  # fmt: skip
        _draw_series(axes["series"], transition, inside)
        _draw_share(axes["share"], transition)
        _draw_lost(axes["lost"], transition)
        limits = band(spectrum)
        gap = style.gap_symbol(transition.gap, transition.system.coordinates)
        for name, words, symbol in (("spectrum", f"frequency in ${gap}$", r"\omega"), ("families", *FREQUENCIES["index"])):
            style.set_axis(axes[name], "y", limits, 7, words, symbol, log=limits[1] > _MANY_FOLD * limits[0])
        mesh = _draw_spectrum(axes["spectrum"], spectrum)
        _draw_over_energy(axes["families"], transition, spectrum)
        over_time = [name for name in axes if name != "families"]
        if modes is not None:
            _draw_modes(axes, modes, chosen, times, gap)
        for name in over_time:
            style.set_axis(axes[name], "x", times, 10 if name == "series" else 5, "time", "t")
            if window is not None:
                axes[name].tick_params(axis="x", pad=6.0)  # below the text of a tick of the other axis in the corner
        figure.colorbar(mesh, ax=[axes["spectrum"], axes["families"]], location="right", fraction=0.03, pad=0.01, label="amplitude")
        for name, letter in zip(axes, string.ascii_lowercase, strict=False):
            axes[name].set_title(f"({letter})", loc="left", fontsize=style.NORMAL, pad=3)
        curves = [] if atlas is None else [frequency_curve(curve, "index") for curve in atlas.curves]
        if curves:
            axes["families"].legend(handles=legend_entries(runs_of(curves), []), **_ABOVE, ncols=3, handlelength=1.6)
        drawn = [] if atlas is None else [curve.family for curve in atlas.curves]
        short = style.short_ids(dict.fromkeys([*drawn, *_followed(transition)]))
        _below(figure, transition, stages, caption, short, height, times[0])
        for name in over_time:
            _mark_stages(axes[name], stages, times, letters=name in ("series", "spectrum"))
        if atlas is not None:
            _draw_families(axes["families"], atlas, curves, _followed(transition))
    return figure


def _within(spectrum: Spectrum, window: tuple[float, float]) -> Spectrum:
    """The columns of a spectrum at the times of a window."""
    inside = (spectrum.times >= window[0]) & (spectrum.times <= window[1])
    if inside.all():
        return spectrum
    part = replace(spectrum, times=spectrum.times[inside])
    vars(part)["amplitudes"] = spectrum.amplitudes[:, inside]  # its rows would be computed for the full record
    return part


def _draw_modes(axes: Mapping[str, Axes], modes: IntrinsicModes, chosen: Sequence[int], times: tuple[float, float], gap: str) -> None:
    """Draw the empirical modes of the gap coordinate, and their instantaneous frequencies."""
    inside = (modes.times >= times[0]) & (modes.times <= times[1])
    for k in chosen:
        left, right = axes[f"mode{k}"], axes[f"rate{k}"]
        left.plot(modes.times, modes.functions[k], color=style.LINES[0], linewidth=0.6, gid=f"emd-{k}")
        style.set_axis(left, "y", style.limits_of(modes.functions[:, inside], 0.06), 3, f"mode {k + 1} of", gap)
        strong = modes.amplitudes[k] >= _FAINT_MODE * modes.amplitudes[k].max()
        rate = np.where(strong, modes.frequencies[k], np.nan)
        right.plot(modes.times, rate, color=style.LINES[1], linewidth=0.6, gid=f"emd-rate-{k}")
        seen = rate[inside & strong]
        low, high = np.quantile(seen, (0.02, 0.98)) if len(seen) else (0.0, 1.0)
        style.set_axis(right, "y", style.limits_of(np.array([low, high]), 0.25), 3, f"frequency of {k + 1}", r"\omega")


def _draw_series(axes: Axes, transition: Transition, inside: np.ndarray) -> None:
    record = transition.record
    order = sorted(range(record.degrees_of_freedom), key=lambda i: -float(np.ptp(record.displacements[:, i])))
    for i in order:
        name = transition.system.coordinates[i]
        look: dict[str, Any] = {"color": style.LINES[i % len(style.LINES)], "linewidth": 0.6, "gid": f"series-{name}"}
        axes.plot(record.times, record.displacements[:, i], label=f"${style.symbol_of(name)}$", **look)
    style.set_axis(axes, "y", style.limits_of(record.displacements[inside], 0.06), 5, "displacement", "u")
    axes.legend(**_ABOVE, ncols=len(order))


def _draw_share(axes: Axes, transition: Transition) -> None:
    record = transition.record
    if record.nes_energy.any():
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = [np.where(record.energy > 0.0, 100.0 * part / record.energy, np.nan) for part in (record.nes_energy, record.lo_energy)]
        for name, share, colour in zip(("sink", "oscillator"), shares, style.LINES, strict=False):
            axes.plot(record.times, share, color=colour, linewidth=0.5, label=name, gid=f"share-{name}")
        axes.legend(**_ABOVE, ncols=2, handlelength=1.4)
        style.set_axis(axes, "y", (0.0, 100.0), 5, "energy, of the present", r"\%")
    else:
        axes.plot(record.times, 100.0 * record.energy / record.energy.max(), color=style.LINES[0], linewidth=0.8, gid="share-energy")
        style.set_axis(axes, "y", (0.0, 100.0), 5, "energy, of the largest", r"\%")


def _draw_lost(axes: Axes, transition: Transition) -> None:
    record = transition.record
    nes, lo = record.dissipated_nes, record.dissipated_lo
    total = float(record.energy[-1] + nes[-1] + lo[-1]) if record.from_rest else float(record.energy[0])
    # The sum lies below and is wider: one that is all of it does not hide it.
    sink = transition.system.absorber is not None or record.nes_energy.any()
    first, second = ("sink", "oscillator") if sink else ("stops", "rest")
    lines = (("both", nes + lo, style.BLACK, 2.4), (first, nes, style.LINES[0], 1.0), (second, lo, style.LINES[1], 1.0))
    for name, values, colour, width in (*lines, ("total energy", record.energy, style.GREEN, 1.0)):
        gid = f"lost-{name}" if values is not record.energy else "total-energy"
        axes.plot(record.times, 100.0 * values / total, color=colour, linewidth=width, label=name, gid=gid)
    top = max(100.0, 105.0 * float(np.max(nes + lo)) / total if np.max(nes + lo) > total * (1.0 + 1e-9) else 0.0)
    style.set_axis(axes, "y", (0.0, top), 5, f"lost and left, of {'what came in' if record.from_rest else 'the start'}", r"\%")
    axes.legend(**_ABOVE, ncols=4, handlelength=1.2, columnspacing=1.2)


def _shade(axes: Axes, edges: np.ndarray, spectrum: Spectrum, amplitudes: np.ndarray, name: str) -> Any:
    """Draw amplitudes at the frequencies of a spectrum, in columns with these edges."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    half = 2.0 ** (0.5 * spectrum.octaves)
    rows = np.append(spectrum.frequencies / half, spectrum.frequencies[-1] * half)
    shades = ListedColormap(colormaps["Greys"](np.linspace(0.0, _DARK, 256)))
    look: dict[str, Any] = {"cmap": shades, "vmin": 0.0, "vmax": float(spectrum.amplitudes.max()) or 1.0, "rasterized": True}
    return axes.pcolormesh(edges, rows, np.ma.masked_invalid(amplitudes), zorder=1, gid=name, **look)


def _draw_spectrum(axes: Axes, spectrum: Spectrum) -> Any:
    few = slice(None, None, max(1, len(spectrum.times) // _COLUMNS))
    times, lowest, highest = spectrum.times[few], *axes.get_ylim()
    edges = np.concatenate([[times[0]], 0.5 * (times[1:] + times[:-1]), [times[-1]]])
    mesh = _shade(axes, edges, spectrum, spectrum.amplitudes[:, few], "spectrum")
    cone = np.minimum(spectrum.cone[few], 10.0 * highest)
    hatched: dict[str, Any] = {"facecolor": "none", "edgecolor": style.GREY, "hatch": "////", "linewidth": 0.5, "zorder": 2}
    axes.fill_between(times, lowest, np.maximum(cone, lowest), gid="spectrum-cone", **hatched)
    axes.plot(times, np.where(cone > lowest, cone, np.nan), color=style.GREY, linewidth=0.8, zorder=2.1)
    return mesh


def _draw_over_energy(axes: Axes, transition: Transition, spectrum: Spectrum) -> None:
    energies = gradual_energy(transition.record, spectrum.times)
    kept = energies > _DEEP * energies.max()
    limits = style.limits_of(energies[kept], 0.04, log=True)
    edges = np.geomspace(*limits, _INTERVALS + 1)
    _shade(axes, edges, spectrum, over_energy(energies[kept], spectrum.amplitudes[:, kept], edges), "families-spectrum")
    style.set_axis(axes, "x", limits, 5, "energy now", "h", log=True)


def _draw_families(axes: Axes, atlas: Atlas, curves: Sequence[Named], followed: Collection[str]) -> None:
    modes = [mode for mode in atlas.thresholds if mode.h > axes.get_xlim()[0]]
    limits = axes.get_xlim(), axes.get_ylim()
    draw_curve(axes, runs_of(curves), "families", _FINE)
    draw_modes(axes, modes)
    axes.set(xlim=limits[0], ylim=limits[1])
    of_modes = mode_names(limits[0][0], modes)
    room = Room(axes, [curve.path for curve in (*curves, *of_modes)])
    room.take(room.to_page(np.array([[mode.h, mode.frequency] for mode in modes]).reshape(-1, 2)), _RADIUS)
    names = [name for name in names_of(curves, room) if name.text or name.key in followed]
    names.sort(key=lambda name: name.key not in followed)
    write_names(room, names, most=_MOST_NAMES, always=of_modes)


def _letters(count: int) -> list[str]:
    """A, B, ... for the stages, A1, B1, ... beyond the alphabet."""
    return [chr(65 + i % 26) + (str(i // 26) if i >= 26 else "") for i in range(count)]


def _mark_stages(axes: Axes, stages: Sequence[tuple[str, Stage]], shown: tuple[float, float], letters: bool) -> None:
    """Draw lines at the ends of a stage, and its letter near the middle of the upper edge of what is shown of it."""
    for time in sorted({time for _, stage in stages for time in (stage.start, stage.end) if shown[0] <= time <= shown[1]}):
        axes.axvline(time, color=style.GREEN, linewidth=0.6, linestyle=(0, (4, 2)), zorder=3)
    if letters:
        room = Room(axes, [])
        spans = [(max(stage.start, shown[0]), min(stage.end, shown[1])) for _, stage in stages]
        middles = room.to_page(np.array([(0.5 * (begin + end), axes.get_ylim()[1]) for begin, end in spans]).reshape(-1, 2))
        for text in room.write([letter for letter, _ in stages], middles - (0.0, _LETTER_HIGH), beside=_LETTER_FAR, far=_LETTER_FAR):
            if text is not None:
                text.set_bbox({"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.8})


def _followed(transition: Transition) -> list[str]:
    """The families that the motion starts on and follows."""
    start = [] if transition.start is None else [transition.start.family]
    return [*start, *(stage.follows.family for stage in transition.stages if stage.follows is not None)]


def _with_name(atlas: Atlas, start: StartFamily | None) -> Atlas:
    """The atlas with the family of the start by its one name."""
    if start is None or not start.name:
        return atlas
    named = [
        replace(curve, names=np.full(len(curve.h), start.name), cited=np.ones(len(curve.h), dtype=bool))
        if curve.family == start.family
        else curve
        for curve in atlas.curves
    ]
    return replace(atlas, curves=tuple(named))


def _below(
    figure: Figure,
    transition: Transition,
    stages: Sequence[tuple[str, Stage]],
    caption: str,
    short: Mapping[str, str],
    height: float,
    begins: float,
) -> None:
    """Below the figure: its caption, the family of the start, and what each stage follows."""
    from matplotlib.lines import Line2D

    start = transition.start
    begin = ""
    if start is not None and start.end >= begins:
        begin = f"start  0\N{EN DASH}{start.end:.4g}  {_called(start.family, start.name, short)}, {start.kept}"
    texts = [f"{letter}  {stage.start:.4g}\N{EN DASH}{stage.end:.4g}  {_follows(stage, start, short)}" for letter, stage in stages]
    if len(texts) > _MOST_LETTERS:
        texts = [*texts[: _MOST_LETTERS - 1], f"and {len(texts) - _MOST_LETTERS + 1} more stages"]
    texts = [*filter(None, [begin]), *texts]
    entries = [Line2D([], [], linestyle="none", label=text) for text in texts]
    look: dict[str, Any] = {"title_fontsize": style.SMALL, "handlelength": 0.0, "handletextpad": 0.0}
    style.legend_below(figure, entries, 2, height=height, title=textwrap.fill(caption, _CAPTION), **look)


def _called(family: str, label: str, short: Mapping[str, str]) -> str:
    """A family as it is written below the figure."""
    from branches.naming.labels import latex, parse

    if not label:
        return f"{family.partition(':')[0]} {short[family]}"
    try:
        return latex(parse(label), short=True)
    except ValueError:
        return label


def _follows(stage: Stage, start: StartFamily | None, short: Mapping[str, str]) -> str:
    why = f": {stage.why}" if stage.why else ""
    if start is not None and start.name:
        why = why.replace(start.called, _called(start.family, start.name, short))
    if stage.follows is None:
        return rf"$\omega$ = {stage.frequency:.3g}, no family{why}"
    follows = stage.follows
    name = _called(follows.family, follows.name or follows.label, short)
    counted = f" (counted {_called(follows.family, follows.counted, short)} here)" if follows.counted else ""
    ordinal = "" if follows.harmonics == (1,) else f"harmonic {follows.harmonic} of "
    more = f" (+{len(follows.others)})" if follows.others else ""
    return rf"$\omega$ = {stage.frequency:.3g}, {ordinal}{name}{counted}{follows.beside}{more}{why}"
