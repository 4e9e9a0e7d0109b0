"""Statistics of a study: medians and quartiles along one parameter, and medians over two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from transitions.study.plan import Axis
from transitions.study.study import Study

__all__ = ["Bins", "Map", "along", "bins_of", "numeric_axes", "over"]

FEWEST = 20
"""Least mean number of a hypercube's runs in a bin."""

MOST = 40
"""Largest number of bins on an axis."""

_SINGLE = 0.05


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of an axis.

    Attributes
    ----------
    edges : (k + 1,) ndarray
        Edges of the bins, ascending. In a grid they lie half-way between the values, and as far beyond the first and the last value, so
        that a map has cells of full size at its borders. A single value has a twentieth of itself on each side.
    centres : (k,) ndarray
        The values of a grid; else the middles of the bins.
    which : (N,) int64 ndarray
        The bin of each run.
    """

    edges: np.ndarray
    centres: np.ndarray
    which: np.ndarray


@dataclass(frozen=True, eq=False)
class Map:
    """A result over two parameters: the medians (k, j), NaN if no run has it, and the number of runs in each bin."""

    x: Bins
    y: Bins
    medians: np.ndarray
    counts: np.ndarray


def numeric_axes(study: Study) -> tuple[Axis, ...]:
    """The varied parameters except the family."""
    return tuple(axis for axis in study.plan.axes if not axis.is_family)


def bins_of(study: Study, axis: Axis, most: int) -> Bins:
    """The bins of an axis: one for each value of a grid or a list; else `most` bins of equal width on the axis's scale."""
    values = study.given[axis.name]
    logarithmic = axis.scale == "log"
    if study.plan.design == "grid" or axis.values:
        centres = np.unique(np.array(axis.grid(), dtype=float))
        which = np.searchsorted(centres, values)
        if len(centres) == 1:
            half = _SINGLE * abs(centres[0]) or 1.0
            return Bins(np.array([centres[0] - half, centres[0] + half]), centres, which)
        places = np.log(centres) if logarithmic else centres
        between = 0.5 * (places[1:] + places[:-1])
        edges = np.concatenate([[2.0 * places[0] - between[0]], between, [2.0 * places[-1] - between[-1]]])
        return Bins(np.exp(edges) if logarithmic else edges, centres, which)
    low, high = (np.log([axis.low, axis.high]) if logarithmic else (axis.low, axis.high))
    places = np.log(values) if logarithmic else values
    edges = np.linspace(low, high, most + 1)
    which = np.clip(np.searchsorted(edges, places, side="right") - 1, 0, most - 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    ends = np.concatenate([[axis.low], np.exp(edges[1:-1]) if logarithmic else edges[1:-1], [axis.high]])  # the very ends, unrounded
    return Bins(ends, np.exp(middles) if logarithmic else middles, which)


def along(study: Study, axis: Axis, values: np.ndarray, some: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Centres of an axis's bins, (k,), and the quartiles and median of the values in each, (k, 3); NaN if no run has a value.

    Parameters
    ----------
    study : Study
    axis : Axis
    values : (N,) ndarray
    some : (N,) bool ndarray, optional
        The runs to use.
    """
    chosen = np.isfinite(values) if some is None else np.isfinite(values) & some
    bins = bins_of(study, axis, int(np.clip(chosen.sum() // FEWEST, 1, MOST)))
    out = np.full((len(bins.centres), 3), np.nan)
    for k in range(len(out)):
        here = values[chosen & (bins.which == k)]
        if len(here):
            out[k] = np.quantile(here, [0.25, 0.5, 0.75])
    return bins.centres, out


def over(study: Study, x: Axis, y: Axis, values: np.ndarray) -> Map:
    """Medians of the values over two axes."""
    chosen = np.isfinite(values)
    most = int(np.clip(np.sqrt(chosen.sum() / FEWEST), 1, MOST))
    first, second = bins_of(study, x, most), bins_of(study, y, most)
    shape = (len(first.centres), len(second.centres))
    cell = np.ravel_multi_index((first.which[chosen], second.which[chosen]), shape)
    order = np.argsort(cell, kind="stable")
    counts = np.bincount(cell, minlength=shape[0] * shape[1])
    medians = np.full(len(counts), np.nan)
    for k, part in enumerate(np.split(values[chosen][order], np.cumsum(counts)[:-1])):
        if len(part):
            medians[k] = np.median(part)
    return Map(first, second, medians.reshape(shape), counts.reshape(shape))
