"""Limits and tick marks of axes, for ranges from one value to many decades."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

_SINGLE = 1e-9  # a range relatively narrower than this is drawn as one value
_OFFSET = 2e-3  # a range relatively narrower than this is marked by differences from a round reference


@dataclass(frozen=True)
class Ticks:
    """Tick positions with their texts; the texts show (position - reference)/scale."""

    positions: tuple[float, ...]
    texts: tuple[str, ...]
    reference: float = 0.0
    scale: float = 1.0
    minor: tuple[float, ...] = ()

    def axis_text(self, words: str, symbol: str) -> str:
        """Axis text: `words` and the math `symbol`, with the reference and the scale where there are any."""
        shown = symbol
        if self.reference:
            sign = "-" if self.reference > 0 else "+"
            shown = rf"({symbol} {sign} {abs(self.reference):.15g})"
        if self.scale != 1.0:
            shown = rf"{shown}\,/\,10^{{{round(math.log10(self.scale))}}}"
        return f"{words}{' ' if words and not words.endswith(chr(10)) else ''}${shown}$"


def linear_limits(values: np.ndarray, margin: float = 0.08) -> tuple[float, float]:
    """Limits around the finite `values` (any shape) with a margin on both sides, never of zero width."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if high - low <= _SINGLE * size:
        half = 0.05 * size if size else 1.0
        middle = (low + high) / 2
        return middle - half, middle + half
    width = high - low
    return low - margin * width, high + margin * width


def logarithmic_limits(values: np.ndarray, margin: float = 0.05) -> tuple[float, float]:
    """Limits around the finite `values` with a margin in the logarithm.

    Raises
    ------
    ValueError
        When a value is not positive: a logarithmic axis has no place for it.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if not finite.size or finite.min() <= 0:
        what = f"the lowest is {finite.min():.6g}" if finite.size else "there is none"
        raise ValueError(f"a logarithmic axis needs positive values: {what}")
    low, high = float(finite.min()), float(finite.max())
    if high / low - 1 <= _SINGLE:
        return low / 1.05, high * 1.05
    width = margin * math.log(high / low)
    return low * math.exp(-width), high * math.exp(width)


def linear_ticks(low: float, high: float, count: int) -> Ticks:
    """About `count` round ticks between `low` and `high`; narrow ranges get a reference, huge or tiny values a scale."""
    from matplotlib.ticker import MaxNLocator

    for bins in (count, count + 2, count + 5):
        values = np.asarray(MaxNLocator(nbins=bins, steps=[1, 2, 5, 10]).tick_values(low, high), dtype=float)
        values = values[(values >= low) & (values <= high)]
        if len(values) > 2:
            break
    size, width = max(abs(low), abs(high)), high - low
    reference = 0.0
    if width < _OFFSET * size:
        digits = math.floor(math.log10(np.diff(values).min()) + 1e-6) if len(values) > 1 else math.floor(math.log10(width)) - 1
        middle = min(values, key=lambda v: abs(v - (low + high) / 2), default=(low + high) / 2)
        reference = float(f"{round(middle / 10.0**digits)}e{digits}")
    shown = values - reference
    largest = float(np.abs(shown).max(initial=0.0))
    power = math.floor(math.log10(largest)) if largest > 0 else 0
    scale = 1.0 if -3 < power < 4 and not reference else 10.0**power
    shown = shown / scale
    step = float(np.diff(shown).min()) if len(shown) > 1 else max(float(np.abs(shown).max(initial=1.0)), 1e-3)
    places = min(max(0, -math.floor(math.log10(step) + 1e-6)), 12)
    texts = tuple(f"{0.0 if abs(v) < step / 1e6 else v:.{places}f}".replace("-", "\N{MINUS SIGN}") for v in shown)
    return Ticks(tuple(map(float, values)), texts, reference, scale)


def _power_text(value: float, plain: bool) -> str:
    power = math.floor(math.log10(value) + 1e-9)
    front = round(value / 10.0**power)
    if plain:
        return f"{value:.6g}"
    return rf"$10^{{{power}}}$" if front == 1 else rf"${front}\times10^{{{power}}}$"


def logarithmic_ticks(low: float, high: float, count: int) -> Ticks:
    """About `count` ticks for a logarithmic axis: decades, else 1-2-5, else round values as on a linear axis."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = range(first, last + 1)
    minor = tuple(d * 10.0**k for k in decades for d in range(1, 10) if low <= d * 10.0**k <= high)

    def ticks(values: list[float], small: tuple[float, ...]) -> Ticks:
        plain = min(values) >= 0.999e-3 and max(values) < 1.001e4
        texts = tuple(_power_text(v, plain) for v in values)
        return Ticks(tuple(values), texts, minor=tuple(v for v in small if v not in values))

    inside = [10.0**k for k in decades if low <= 10.0**k <= high]
    if len(inside) > 2:
        stride = math.ceil(len(inside) / (count + 1))
        shown = [v for v in inside if round(math.log10(v)) % stride == 0]
        return ticks(shown, minor if stride == 1 else tuple(inside))
    finer = [d * 10.0**k for k in decades for d in (1, 2, 5) if low <= d * 10.0**k <= high]
    if len(inside) == 2 and len(finer) > 2 * count:
        return ticks(inside, minor)
    if len(finer) > 2:
        return ticks(finer, minor)
    return linear_ticks(low, high, count)


def mark_axis(axis: Axis, ticks: Ticks) -> None:
    """Put `ticks` on a matplotlib axis."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

    axis.set_major_locator(FixedLocator(ticks.positions))
    axis.set_major_formatter(FixedFormatter(ticks.texts))
    axis.set_minor_locator(FixedLocator(ticks.minor))
    axis.set_minor_formatter(NullFormatter())


def logarithmic_axis(axes: Axes, which: str, limits: tuple[float, float], count: int, words: str, symbol: str) -> None:
    """Make the `which` ("x" or "y") axis logarithmic within `limits`, with its ticks and its text."""
    ticks = logarithmic_ticks(*limits, count)
    if which == "x":
        axes.set_xscale("log")
        axes.set_xlim(*limits)
        mark_axis(axes.xaxis, ticks)
        axes.set_xlabel(ticks.axis_text(words, symbol))
    else:
        axes.set_yscale("log")
        axes.set_ylim(*limits)
        mark_axis(axes.yaxis, ticks)
        axes.set_ylabel(ticks.axis_text(words, symbol))


def linear_axis(axes: Axes, which: str, limits: tuple[float, float], count: int, words: str, symbol: str) -> None:
    """Give the `which` ("x" or "y") axis linear ticks within `limits` and its text."""
    ticks = linear_ticks(*limits, count)
    if which == "x":
        axes.set_xlim(*limits)
        mark_axis(axes.xaxis, ticks)
        axes.set_xlabel(ticks.axis_text(words, symbol))
    else:
        axes.set_ylim(*limits)
        mark_axis(axes.yaxis, ticks)
        axes.set_ylabel(ticks.axis_text(words, symbol))
