"""Extrema and sign changes of a linear functional f = c . z along an exact flight, by bounds, never by sampling.

With |f''| <= W over the flight, f keeps its sign over the step (|f'| + sqrt(f'^2 + 2 W |f|))/W away from zero (with f' counted
against it where it points to zero), and f is monotone over |f'|/W. Steps take the longer of both, so each step holds at most one zero,
and that one changes the sign.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.bounds import block_growth, envelope
from bvp.kernels.compiled import kernel, part
from bvp.kernels.flight import flow_state

__all__ = ["Observed", "amplitude_bound", "clearance", "refine", "safe_step", "sign_changes"]

STEP_LIMIT = 100000
"""Steps after which a search gives up and says so; a flight of a thousand periods takes some ten thousand."""


class Observed(NamedTuple):
    """Functionals watched along each flight. S stops, N entries a state."""

    gap: np.ndarray  # (S, N) w
    gap_rate: np.ndarray  # (S, N) w'
    gap_second: np.ndarray  # (S, N) w''
    gap_third: np.ndarray  # (S, N) w'''
    lower: np.ndarray  # (S,)
    upper: np.ndarray  # (S,)
    velocity: np.ndarray  # (2, N) velocities of absorber and primary
    velocity_rate: np.ndarray  # (2, N)
    velocity_second: np.ndarray  # (2, N)


@kernel
def dot(a, b):
    """a . b"""
    total = 0.0
    for r in range(a.shape[0]):
        total += a[r] * b[r]
    return total


@kernel
def amplitude_bound(pairs, mean, delta, matrix, row, z, horizon):
    """Bound of |row . z(t)| for 0 <= t <= horizon; attained in the limit for undamped modes with incommensurate frequencies."""
    total = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j < -1:
            growth = block_growth(matrix, i, -j)
            weight = 0.0
            norm = 0.0
            for r in range(i, i - j):
                weight += row[r] * row[r]
                norm += z[r] * z[r]
            total += (math.exp(growth * horizon) if growth > 0.0 else 1.0) * math.sqrt(weight * norm)
            continue
        growth = math.exp(mean[k] * horizon) if mean[k] > 0.0 else 1.0
        if j < 0:
            total += growth * abs(row[i] * z[i])
            continue
        first = row[i] * z[i] + row[j] * z[j]
        second = row[i] * ((matrix[i, i] - mean[k]) * z[i] + matrix[i, j] * z[j])
        second += row[j] * (matrix[j, i] * z[i] + (matrix[j, j] - mean[k]) * z[j])
        if delta[k] < 0.0:
            total += growth * math.sqrt(first * first + second * second / -delta[k])
        else:
            c, s = envelope(mean[k], delta[k], horizon)
            total += abs(first) * c + abs(second) * s
    return total


@part
def safe_step(f, slope, bound):
    """Longest step over which f has no zero, or is monotone."""
    if bound <= 0.0:
        return math.inf
    monotone = abs(slope) / bound
    root = math.sqrt(slope * slope + 2.0 * bound * abs(f))
    away = slope if f >= 0.0 else -slope
    if away >= 0.0:
        free = (away + root) / bound
    else:
        free = 2.0 * abs(f) / (root - away)
    return max(monotone, free)


@kernel
def sign_changes(pairs, mean, delta, matrix, value, rate, second, z, duration, sign, work):
    """Sign changes of value . z(t) for 0 < t < duration after an earlier `sign` (0: none yet). Returns (changes, last sign),
    changes < 0 when the search gave up. Values within rounding of zero have no sign."""
    bound = amplitude_bound(pairs, mean, delta, matrix, second, z, duration) * (1.0 + 1e-12)
    level = 1e-13 * (amplitude_bound(pairs, mean, delta, matrix, value, z, duration) + 1e-300)
    changes = 0
    t = 0.0
    floor = 1e-13 * duration
    f = dot(value, z)
    slope = dot(rate, z)
    for _ in range(STEP_LIMIT):
        if abs(f) > level:
            now = 1 if f > 0.0 else -1
            if sign != 0 and now != sign:
                changes += 1
            sign = now
        if t >= duration:
            return changes, sign
        t = min(duration, t + max(safe_step(f, slope, bound), floor))
        flow_state(pairs, mean, delta, matrix, z, t, work)
        f = dot(value, work)
        slope = dot(rate, work)
    return -1, sign


@kernel
def refine(pairs, mean, delta, matrix, value, rate, z, low, high, positive, tolerance, work):
    """The zero of value . z(t) between low and high, where it changes sign once; `positive`: its sign at low."""
    root = 0.5 * (low + high)
    for _ in range(100):
        flow_state(pairs, mean, delta, matrix, z, root, work)
        f = dot(value, work)
        if (f > 0.0) == positive:
            low = root
        else:
            high = root
        slope = dot(rate, work)
        newton = root - f / slope if slope != 0.0 else 0.5 * (low + high)
        if not (low <= newton <= high):
            newton = 0.5 * (low + high)
        if abs(newton - root) <= tolerance:
            return newton
        root = newton
    return root


@part
def clearance(pairs, mean, delta, matrix, observed, stop, z, duration, work):
    """Least distance to the bounds of one stop at the turning points of w inside a flight: (distance, side, time); distance
    is infinite where w does not turn, NaN when the search gave up."""
    rate = observed.gap_rate[stop]
    second = observed.gap_second[stop]
    bound = amplitude_bound(pairs, mean, delta, matrix, observed.gap_third[stop], z, duration) * (1.0 + 1e-12)
    best = math.inf
    best_side = 0.0
    best_time = 0.0
    t = 0.0
    floor = 1e-13 * duration
    f = dot(rate, z)
    slope = dot(second, z)
    sign = 1 if f > 0.0 else -1 if f < 0.0 else 0
    for _ in range(STEP_LIMIT):
        if t >= duration:
            return best, best_side, best_time
        after = min(duration, t + max(safe_step(f, slope, bound), floor))
        flow_state(pairs, mean, delta, matrix, z, after, work)
        f_after = dot(rate, work)
        now = 1 if f_after > 0.0 else -1 if f_after < 0.0 else sign
        if sign * now < 0:
            turn = refine(pairs, mean, delta, matrix, rate, second, z, t, after, sign > 0, 1e-10 * duration, work)
            flow_state(pairs, mean, delta, matrix, z, turn, work)
            w = dot(observed.gap[stop], work)
            if sign > 0:
                distance = observed.upper[stop] - w
                side = 1.0
            else:
                distance = w - observed.lower[stop]
                side = -1.0
            if distance < best:
                best = distance
                best_side = side
                best_time = turn
            flow_state(pairs, mean, delta, matrix, z, after, work)
        t = after
        f = f_after
        sign = now
        slope = dot(second, work)
    return math.nan, 0.0, 0.0
