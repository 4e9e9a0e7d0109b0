"""Extrema and sign changes of a linear functional f = c . z along an exact flight, by bounds, never by sampling.

With |f''| <= W over the flight, f keeps its sign over the step (|f'| + sqrt(f'^2 + 2 W |f|))/W away from zero (with f' counted
against it where it points to zero), and f is monotone over |f'|/W. With |f'''| <= V, f' keeps its sign, and f is monotone, over the
step of the same form for f' and f''. Steps take the longest of these, so each holds at most one zero, and that one changes the sign.

Where no mode damps or grows, f(t) is a sum over the modes of alpha C(t) + beta S(t): its parts (alpha, beta) are found once a flight, and
give f, f' and f'' from one sine and cosine of each mode.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.bounds import block_growth, envelope
from bvp.kernels.compiled import inlined, kernel, part
from bvp.kernels.flight import circular, flow_state

__all__ = ["Observed", "amplitude_bound", "clearance", "look", "refine", "safe_step", "separate", "sign_changes"]

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


@inlined
def separate(pairs, mean, delta, matrix, value, second, z, horizon, parts):
    """(pure, bound of |f|, of |f''|, of |f'''|) for f = value . z(t), 0 <= t <= horizon, f'' = second . z(t).

    `pure`: every block is a pair that neither damps nor grows; then parts (N,) are alpha, beta of each mode in turn, else they are
    not set, and there is no bound of |f'''| (given as 0)."""
    level = 0.0
    curvature = 0.0
    jerk = 0.0
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j < 0 or mean[k] != 0.0 or delta[k] > 0.0:
            level = amplitude_bound(pairs, mean, delta, matrix, value, z, horizon)
            curvature = amplitude_bound(pairs, mean, delta, matrix, second, z, horizon)
            return False, level, curvature * (1.0 + 1e-12), 0.0
        alpha = value[i] * z[i] + value[j] * z[j]
        beta = value[i] * (matrix[i, i] * z[i] + matrix[i, j] * z[j]) + value[j] * (matrix[j, i] * z[i] + matrix[j, j] * z[j])
        parts[2 * k] = alpha
        parts[2 * k + 1] = beta
        square = -delta[k]
        slope = math.sqrt(square * alpha * alpha + beta * beta)  # amplitude of f'
        frequency = math.sqrt(square)
        level += min(slope / frequency if frequency > 0.0 else math.inf, abs(alpha) + abs(beta) * horizon)
        curvature += frequency * slope
        jerk += square * slope
    return True, level, curvature * (1.0 + 1e-12), jerk * (1.0 + 1e-12)


@part
def look(pairs, mean, delta, matrix, pure, parts, value, rate, second, z, t):
    """f, f' and f'' at t; `parts` is scratch where the flight is not pure."""
    f = 0.0
    slope = 0.0
    bend = 0.0
    if pure:
        for k in range(delta.shape[0]):
            c, s = circular(delta[k], t)
            here = parts[2 * k] * c + parts[2 * k + 1] * s
            f += here
            slope += parts[2 * k + 1] * c + delta[k] * parts[2 * k] * s
            bend += delta[k] * here
    else:
        flow_state(pairs, mean, delta, matrix, z, t, parts)
        f = dot(value, parts)
        slope = dot(rate, parts)
        bend = dot(second, parts)
    return f, slope, bend


@part
def free(f, slope, bound):
    """Longest step over which f has no zero, its second derivative being bounded."""
    root = math.sqrt(slope * slope + 2.0 * bound * abs(f))
    away = slope if f >= 0.0 else -slope
    if away >= 0.0:
        step = (away + root) / bound
    else:
        step = 2.0 * abs(f) / (root - away)
    return step


@part
def safe_step(f, slope, bend, curvature, jerk):
    """Longest step over which f has no zero, or is monotone; `curvature`, `jerk`: bounds of |f''| and |f'''| (0: none known)."""
    step = math.inf
    if curvature > 0.0:
        step = max(abs(slope) / curvature, free(f, slope, curvature))
        if jerk > 0.0:
            step = max(step, free(slope, bend, jerk))
    return step


@inlined
def sign_changes(pairs, mean, delta, matrix, value, rate, second, z, duration, sign, work):
    """Sign changes of value . z(t) for 0 < t < duration after an earlier `sign` (0: none yet). Returns (changes, last sign),
    changes < 0 when the search gave up. Values within rounding of zero have no sign."""
    pure, level, curvature, jerk = separate(pairs, mean, delta, matrix, value, second, z, duration, work)
    level = 1e-13 * (level + 1e-300)
    changes = 0
    t = 0.0
    floor = 1e-13 * duration
    for _ in range(STEP_LIMIT):
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, value, rate, second, z, t)
        if abs(f) > level:
            now = 1 if f > 0.0 else -1
            if sign != 0 and now != sign:
                changes += 1
            sign = now
        if t >= duration:
            return changes, sign
        t = min(duration, t + max(safe_step(f, slope, bend, curvature, jerk), floor))
    return -1, sign


@kernel
def refine(pairs, mean, delta, matrix, pure, value, rate, second, z, low, high, root, positive, tolerance, work):
    """The zero of f = value . z(t) between low and high, where it changes sign once, from a guess `root`; `positive`: its sign at low."""
    for _ in range(100):
        if not (low <= root <= high):
            root = 0.5 * (low + high)
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, value, rate, second, z, root)
        if (f > 0.0) == positive:
            low = root
        else:
            high = root
        divisor = slope * slope - 0.5 * f * bend
        better = root - f * slope / divisor if divisor != 0.0 else 0.5 * (low + high)  # Halley
        if not (low <= better <= high):
            better = 0.5 * (low + high)
        if abs(better - root) <= tolerance:
            return better
        root = better
    return root


@kernel
def value_at(pairs, mean, delta, matrix, pure, row, z, t, work):
    """row . z(t); `work` is used where the flight is not pure only."""
    total = 0.0
    if pure:
        for k in range(delta.shape[0]):
            i = pairs[k, 0]
            j = pairs[k, 1]
            c, s = circular(delta[k], t)
            total += row[i] * (c * z[i] + s * (matrix[i, i] * z[i] + matrix[i, j] * z[j]))
            total += row[j] * (c * z[j] + s * (matrix[j, i] * z[i] + matrix[j, j] * z[j]))
    else:
        flow_state(pairs, mean, delta, matrix, z, t, work)
        total = dot(row, work)
    return total


@part
def clearance(pairs, mean, delta, matrix, observed, stop, z, duration, work):
    """Least distance to the bounds of one stop at the turning points of w inside a flight: (distance, side, time); distance
    is infinite where w does not turn, NaN when the search gave up."""
    rate = observed.gap_rate[stop]
    second = observed.gap_second[stop]
    third = observed.gap_third[stop]
    pure, _level, curvature, jerk = separate(pairs, mean, delta, matrix, rate, third, z, duration, work)
    best = math.inf
    best_side = 0.0
    best_time = 0.0
    floor = 1e-13 * duration
    before = 0.0
    f_before = 0.0
    sign = 0
    t = 0.0
    for _ in range(STEP_LIMIT):
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, rate, second, third, z, t)
        now = 1 if f > 0.0 else -1 if f < 0.0 else sign
        if sign * now < 0:
            guess = before + f_before / (f_before - f) * (t - before)
            turn = refine(
                pairs, mean, delta, matrix, pure, rate, second, third, z, before, t, guess, sign > 0, 1e-9 * duration, work
            )
            w = value_at(pairs, mean, delta, matrix, pure, observed.gap[stop], z, turn, work)
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
        sign = now
        if t >= duration:
            return best, best_side, best_time
        before = t
        f_before = f
        t = min(duration, t + max(safe_step(f, slope, bend, curvature, jerk), floor))
    return math.nan, 0.0, 0.0
