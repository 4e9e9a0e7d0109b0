"""The look that all pictures share: sizes in print, fonts, Okabe and Ito's colours (safe for the colour-blind), markers."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_WIDTH = 7.2  # inches: both columns of a journal page
SMALL, NORMAL = 7.0, 8.0  # font sizes in points; nothing is smaller in print

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#7F7F7F", "#DDDDDD"
LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)


@dataclass(frozen=True)
class EventStyle:
    """How one type of special point is marked: matplotlib marker, size in points, fill colour, and its name in the legend."""

    marker: str
    size: float
    colour: str
    name: str


EVENT_STYLES = {
    "SN": EventStyle("s", 5.0, ORANGE, "saddle-node"),
    "BP": EventStyle("D", 4.8, BLUE, "branch point"),
    "SB": EventStyle("^", 6.0, GREEN, "symmetry breaking"),
    "PD": EventStyle("v", 6.0, PURPLE, "period doubling"),
    "RT": EventStyle("p", 6.0, SKY, "q-tupling"),
    "NS": EventStyle("h", 6.0, VERMILION, "Krein collision"),
    "GR": EventStyle("o", 5.0, "#FFFFFF", "grazing"),
    "IO": EventStyle("*", 8.5, YELLOW, "impulsive orbit"),
    "LB": EventStyle("d", 5.0, GREY, "label changes"),
    "EP": EventStyle("X", 5.6, BLACK, "end"),
}


def event_style(kind: str) -> EventStyle:
    """The style of an event type; a type that is not in the table gets a plain marker and its own code as name."""
    return EVENT_STYLES.get(kind, EventStyle("P", 5.6, GREY, kind))


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
    "pdf.fonttype": 42,  # whole fonts, as journals ask
    "svg.hashsalt": "saltus",
    "svg.fonttype": "path",
}


def picture_settings() -> AbstractContextManager[Any]:
    """Settings for making and saving a picture; the user's own matplotlib settings neither enter nor are changed for good."""
    from matplotlib import style

    return style.context(_SETTINGS, after_reset=True)


def new_figure(height: float) -> Figure:
    """An empty figure of the page's width and `height` inches, on a canvas of its own (no pyplot), 200 dots an inch."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH, height), dpi=200, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def settle_layout(figure: Figure) -> None:
    """Let the layout find its place once and keep it, so that what is placed by the renderer's measure stays true."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
