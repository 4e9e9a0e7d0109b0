"""Chains of maxima of a spectrum: links from one time to the next, and the number of each chain."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel

__all__ = ["Maxima", "chains", "link"]


class Maxima(NamedTuple):
    """The maxima of a spectrum over frequency, column by column."""

    columns: np.ndarray  # (M,) int64, sorted
    level: np.ndarray  # (M,) frequencies in octaves, rising in each column
    bounds: np.ndarray  # (n + 1,) int64 first maximum of each column
    reach: np.ndarray  # (M,) largest change in octaves to the next column


@kernel
def link(maxima, spacing, drift, step, following, followed, opened):
    """Link each maximum to the one that follows it: following (M,) gets the index, -1 for none.

    step: time between columns. Across a gap the largest change is `spacing`
    octaves, or `drift` octaves for each period of it, if that is more. followed (M,), opened (M,): arrays to write into.

    The first pass links maxima of neighbouring columns that are each other's nearest. The second one links across gaps of less than a
    period, to maxima without a predecessor: to the first in time, and of these to the nearest."""
    columns, level, bounds, reach = maxima
    count = bounds.shape[0] - 1
    for i in range(columns.shape[0]):
        following[i] = -1
        followed[i] = False
    for column in range(count - 1):
        j = bounds[column + 1]
        stop = bounds[column + 2]
        back = -1  # the maximum of this column that is nearest to j
        for i in range(bounds[column], bounds[column + 1]):
            while j + 1 < stop and abs(level[j + 1] - level[i]) < abs(level[j] - level[i]):
                j += 1
            if j >= stop:
                break
            # The nearest of this column to j: levels rise, so the distances fall and rise once.
            back = i
            while back + 1 < bounds[column + 1] and abs(level[back + 1] - level[j]) < abs(level[back] - level[j]):
                back += 1
            if back == i and (i == bounds[column] or abs(level[i] - level[j]) < abs(level[i - 1] - level[j])):
                if abs(level[i] - level[j]) <= reach[i]:
                    following[i] = j
                    followed[j] = True
    # Maxima without a predecessor, in order of time. Only these can be linked across a gap.
    free = 0
    for i in range(columns.shape[0]):
        if not followed[i]:
            opened[free] = i
            free += 1
    begin = 0
    for end in range(columns.shape[0]):
        if following[end] >= 0:
            continue
        while begin < free and columns[opened[begin]] <= columns[end]:
            begin += 1
        period = 2.0 * math.pi / 2.0 ** level[end]
        chosen = -1
        apart = 0.0
        for k in range(begin, free):
            i = opened[k]
            gap = (columns[i] - columns[end]) * step
            if columns[i] > columns[end] + int(period / step) or (chosen >= 0 and columns[i] > columns[chosen]):
                break
            away = abs(level[i] - level[end])
            if not followed[i] and away <= max(spacing, drift * gap / period) and (chosen < 0 or away < apart):
                chosen = i
                apart = away
        if chosen >= 0:
            following[end] = chosen
            followed[chosen] = True


@kernel
def chains(following, number):
    """Number the chains of maxima in the order of their first ones: number (M,) gets the chain of each. `following` is the result of
    `link`. Returns the number of chains."""
    for i in range(number.shape[0]):
        number[i] = -1
    count = 0
    for i in range(number.shape[0]):
        if number[i] < 0:
            number[i] = count
            count += 1
        if following[i] >= 0:
            number[following[i]] = number[i]
    return count
