"""The text and style that all figures share: titles, sizes, colours, markers, axes, legends and files."""

from __future__ import annotations

import io
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.files import figure_format, replacing
from branches.sequences import PERIODIC

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

PAGE_WIDTH = 7.2  # inches: both columns of a journal page
SMALL, NORMAL = 7.0, 8.0  # font sizes in points; nothing is smaller in print

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#7F7F7F", "#DDDDDD"
LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)


EVENT_LOOKS: dict[str, dict[str, Any]] = {
    kind: {
        "label": f"{kind} {name}", "marker": marker, "markersize": size, "markerfacecolor": colour, "markeredgecolor": BLACK,
        "markeredgewidth": 0.6, "linestyle": "none",
    }
    for kind, name, marker, size, colour in (
        ("SN", "saddle-node", "s", 5.0, ORANGE),
        ("BP", "branch point", "D", 4.8, BLUE),
        ("SB", "symmetry breaking", "^", 6.0, GREEN),
        ("PD", "period doubling", "v", 6.0, PURPLE),
        ("RT", "resonance", "p", 6.0, SKY),
        ("NS", "Krein collision", "h", 6.0, VERMILION),
        ("GR", "grazing", "o", 5.0, "#FFFFFF"),
        ("IO", "impulsive orbit", "*", 8.5, YELLOW),
        ("LB", "label changes", "d", 5.0, GREY),
        ("UZ", "value asked for", "P", 5.0, PALE),
        ("EP", "end", "X", 5.6, BLACK),
    )
}  # fmt: skip
"""The markers of the types of special points for matplotlib, with their texts in the legend."""

_SETTINGS: dict[str, Any] = {
    "font.family": "STIXGeneral",  # comes with matplotlib: the same letters on every machine
    "mathtext.fontset": "stix",
    "font.size": NORMAL,
    "axes.labelsize": NORMAL,
    "axes.titlesize": NORMAL,
    "figure.titlesize": 9.0,
    "xtick.labelsize": SMALL + 0.5,
    "ytick.labelsize": SMALL + 0.5,
    "legend.fontsize": SMALL + 0.5,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "hatch.linewidth": 0.4,
    "savefig.dpi": "figure",
    "text.hinting": "none",  # text has the same size at every resolution, so what was placed apart stays apart
    "pdf.fonttype": 42,  # complete fonts, as journals ask
    "svg.hashsalt": "saltus",
    "svg.fonttype": "path",
}


def figure_settings() -> AbstractContextManager[Any]:
    """Settings for making and saving a figure. The user's own matplotlib settings have no effect and are restored afterwards."""
    from matplotlib import style

    return style.context(_SETTINGS, after_reset=True)


def new_figure(height: float) -> Figure:
    """Make an empty figure of the page's width and `height` inches at 200 dots an inch, without pyplot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH, height), dpi=200, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def legend_below(figure: Figure, entries: Sequence[Any], most: int, *, height: float | None = None, **look: Any) -> Legend:
    """Draw the legend below the panels, then compute the layout and keep it: what is placed by measure afterwards stays in place.

    Parameters
    ----------
    figure : Figure
    entries : sequence of artists
    most : int
        Largest number of columns. There are fewer if the legend would be wider than the figure.
    height : float, optional
        Height of the figure without the legend, in inches, so that the panels keep their size; by default the figure keeps its height.
    **look
        As for `matplotlib.figure.Figure.legend`.
    """
    for columns in range(max(1, min(most, len(entries))), 0, -1):
        legend = figure.legend(handles=list(entries), loc="outside lower center", ncols=columns, frameon=False, **look)
        box = legend.get_window_extent()
        if columns == 1 or box.width <= figure.bbox.width:
            break
        legend.remove()
    if height is not None:
        figure.set_figheight(height + box.height / figure.dpi)
    engine = figure.get_layout_engine()
    if figure.axes and engine is not None:
        engine.execute(figure)
    figure.set_layout_engine(None)  # "none" is an engine, too, for which matplotlib draws a figure before it saves it
    return legend


_SINGLE = 1e-9  # a range relatively narrower than this is drawn as one value


def limits_of(values: np.ndarray, margin: float = 0.06, *, log: bool = False) -> tuple[float, float]:
    """Limits of an axis around the finite values, with a margin on both sides.

    Parameters
    ----------
    values : array of float, any shape
    margin : part of the range, of its logarithm for a logarithmic axis
    log : whether the axis is logarithmic

    Raises
    ------
    ValueError
        For a value that is not positive on a logarithmic axis.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if log and (not finite.size or finite.min() <= 0.0):
        what = f"the lowest is {finite.min():.6g}" if finite.size else "there is none"
        raise ValueError(f"a logarithmic axis needs positive values: {what}")
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if high - low <= _SINGLE * size:
        half = 0.05 * size if size else 1.0
        return low - half, high + half
    if log:
        factor = (high / low) ** margin
        return low / factor, high * factor
    return low - margin * (high - low), high + margin * (high - low)


def set_axis(
    axes: Axes, which: str, limits: tuple[float, float], count: int, name: str, symbol: str, *, log: bool = False
) -> None:
    """Set the limits of an axis, at most about `count` ticks, and its text.

    Ticks of a logarithmic axis are at decades, at 1, 2 and 5 if there are few decades, and as on a linear axis if there are none.

    Parameters
    ----------
    axes : Axes
    which : "x" or "y"
    limits, count : as they are
    name, symbol : text of the axis, and its symbol in mathematics; either may be empty
    log : whether the axis is logarithmic
    """
    from matplotlib import ticker

    label = f"{name} ${symbol}$".strip() if symbol else name
    axes.set(**{f"{which}scale": "log" if log else "linear", f"{which}lim": limits, f"{which}label": label})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_minor_formatter(ticker.NullFormatter())
    few: np.ndarray = np.zeros(0)
    if log:
        few = np.outer(10.0 ** np.arange(np.floor(np.log10(limits[0])), np.log10(limits[1]) + 1.0), (1.0, 2.0, 5.0))
        few = few[(few >= limits[0]) & (few <= limits[1])]
    if len(few) < 3:
        texts = ticker.ScalarFormatter(useMathText=True)
        texts.set_powerlimits((-3, 4))
        axis.set_major_formatter(texts)
        axis.set_major_locator(ticker.MaxNLocator(count, steps=[1, 2, 5, 10], min_n_ticks=min(count, 3)))
        axis.set_minor_locator(ticker.NullLocator())
        return
    plain = limits[0] > 1e-5 and limits[1] < 1e6
    axis.set_major_formatter(
        ticker.StrMethodFormatter("{x:g}") if plain else ticker.LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))
    )
    axis.set_major_locator(ticker.LogLocator(subs=(1.0,) if len(few) > min(2 * count, 8) else (1.0, 2.0, 5.0), numticks=count + 1))
    axis.set_minor_locator(ticker.LogLocator(subs=range(2, 10), numticks=count + 1))


_UNDATED: dict[str, Any] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def write_figure(
    make: Callable[..., Figure], path: str | os.PathLike[str] | IO[bytes], *arguments: Any, format: str | None = None, **options: Any
) -> None:
    """Make a figure and write it to a png, pdf or svg file, without a date. The format is checked first.

    Parameters
    ----------
    make : callable
        Returns the figure for `arguments` and `options`.
    path : path, or binary file open for writing
    format : "png", "pdf" or "svg"; by default the suffix of the file

    Raises
    ------
    ValueError
        For an unknown format.
    WriteFailure
        If the file cannot be written. An old file is then unchanged.
    """
    kind = figure_format(path, format)
    image = io.BytesIO()
    with figure_settings():
        make(*arguments, **options).savefig(image, format=kind, metadata=_UNDATED[kind])
    if hasattr(path, "write"):
        path.write(image.getvalue())
        return
    with replacing(path) as beside:
        beside.write_bytes(image.getvalue())


_GREEK = {"mu": r"\mu", "sigma": r"\sigma", "lam": r"\lambda", "rho": r"\rho", "alpha": r"\alpha"}


def symbol_of(name: str, *, velocity: bool = False) -> str:
    """Math symbol of a coordinate, of its velocity, or of a parameter. A letter or Greek name with a number becomes an index.

    Examples
    --------
    >>> symbol_of("u12"), symbol_of("sigma"), symbol_of("hull_x")
    ('u_{12}', '\\\\sigma', '\\\\mathrm{hull\\\\_x}')
    >>> symbol_of("u1", velocity=True), symbol_of("hull", velocity=True)
    ('\\\\dot{u}_{1}', "\\\\mathrm{hull}'")
    """
    parts = re.fullmatch(r"([A-Za-z]|mu|sigma|lam|rho|alpha)_?(\d*)", name)
    if not parts:
        return r"\mathrm{" + re.sub(r"[\\^~]|([$#%&_{} ])", lambda m: "\\" + m[1] if m[1] else "", name) + "}" + "'" * velocity
    letter = _GREEK.get(parts[1], parts[1])
    return (rf"\dot{{{letter}}}" if velocity else letter) + (f"_{{{parts[2]}}}" if parts[2] else "")


def system_text(system: Any) -> str:
    """The system in a title: the parameters of its model, or its size where it is given by matrices."""
    described = system.describe()
    numbers = {k: v for k, v in described.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
    if numbers:
        return ", ".join(rf"${symbol_of(k)} = {v:.6g}$" for k, v in numbers.items())
    n, stops = len(system.coordinates), len(system.stops)
    return f"{n} degree{'s' * (n != 1)} of freedom, {stops} stop{'s' * (stops != 1)}"


_SHORTEST = 4  # digits of a hash


def short_ids(ids: Iterable[str]) -> dict[str, str]:
    """Short texts for the ids of families in one figure: the first digits of the hash, as many as are needed to distinguish them.

    Examples
    --------
    >>> short_ids(["rest-stop+::2c49f5ff", "rest-stop+::87c63b1c", "stop+-stop+:-:2c49a000"])
    {'rest-stop+::2c49f5ff': '#2c49f', 'rest-stop+::87c63b1c': '#87c6', 'stop+-stop+:-:2c49a000': '#2c49a'}
    """
    hashes = {id: id.rpartition(":")[2] for id in ids}
    counts = Counter(text[:n] for text in set(hashes.values()) for n in range(_SHORTEST, len(text) + 1))
    out = {}
    for id, text in hashes.items():
        n = next((n for n in range(_SHORTEST, len(text)) if counts[text[:n]] == 1), len(text))
        out[id] = f"#{text[:n]}"
    return out


def family_text(label: str, ends: tuple[str, str], sequence: str) -> str:
    """Name of a family in a title: its label as LaTeX, or its ends and impact sequence where it has no label.

    Examples
    --------
    >>> family_text("", ("rest", "stop"), "++"), family_text("", ("periodic", "periodic"), "++")
    ('rest to stop, sequence ++', 'orbits without a reversal, sequence ++')
    """
    if label:
        from branches.naming.labels import latex, parse_printed

        return latex(parse_printed(label))
    shown = sequence if len(sequence) <= 24 else f"{sequence[:18]}\N{HORIZONTAL ELLIPSIS} ({len(sequence)} letters)"
    if ends == PERIODIC:
        return f"orbits without a reversal, sequence {shown}".replace("-", "\N{MINUS SIGN}")
    return f"{ends[0]} to {ends[1]}" + (f", sequence {shown}" if shown else "").replace("-", "\N{MINUS SIGN}")


def gap_symbol(gap: tuple[float, ...], coordinates: tuple[str, ...]) -> str:
    """Math symbol of a gap coordinate c . u; one of more than three terms is called w.

    Examples
    --------
    >>> gap_symbol((1.0, -1.0), ("u1", "u2")), gap_symbol((0.0, 2.5), ("u1", "u2"))
    ('u_{1} - u_{2}', '2.5\\\\,u_{2}')
    """
    terms = [(c, symbol_of(name)) for c, name in zip(gap, coordinates, strict=True) if c]
    if len(terms) > 3:
        return "w"
    text = ""
    for c, symbol in terms:
        size = "" if abs(c) == 1 else rf"{abs(c):.4g}\,"
        sign = ("-" if c < 0 else "") if not text else (" - " if c < 0 else " + ")
        text += f"{sign}{size}{symbol}"
    return text
