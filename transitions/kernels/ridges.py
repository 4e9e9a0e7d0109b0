"""Linking maxima of a spectrum from one time to the next, and the chains that they make."""

import math

from bvp.kernels.compiled import kernel

__all__ = ["chains", "link"]


@kernel
def link(columns, level, bounds, reach, spacing, drift, step, following, followed, opened):
    """Index of the maximum that follows each, following (M,), -1 where none does.

    columns (M,) do not fall; level (M,): frequencies in octaves, rising in each column; bounds (n + 1,): first maximum of each column;
    reach (M,): octaves to the next column; spacing, drift: octaves across a gap at least, and per period of it; step between columns;
    followed (M,), opened (M,) are scratch.

    First those of neighbouring columns that are each other's nearest, then across gaps of less than a period: of those that nothing leads
    to, the first in time, and the nearest of these."""
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
    # Those that nothing leads to, in order of time; only these can be reached across a gap.
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
    """Number the chains of maxima: number (M,) gets that of the chain that each is in, in the order in which they begin; `following` is
    as of `link`, and what follows comes later. Returns how many there are."""
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
