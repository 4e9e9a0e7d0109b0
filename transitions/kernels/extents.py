"""How far a linear functional of a motion goes: its largest absolute value, found by bounds as its turning points are, and the integral of
its square."""

import math

from bvp.kernels.bounds import growth_rate
from bvp.kernels.compiled import kernel
from bvp.kernels.extrema import STEP_LIMIT, amplitude_bound, look, refine, safe_step, separate, value_at
from bvp.kernels.flight import flow_state
from bvp.kernels.integral import integrals

__all__ = ["largest_of_flight", "largest_of_motion"]

SLACK = 1e-14
"""Part of the amplitudes by which a peak may be missed."""


@kernel
def largest_of_flight(pairs, mean, delta, matrix, value, rate, second, third, z, duration, best, work):
    """(largest, time): of |value . z(t)| over 0 <= t <= duration where that is above `best`, else (best, -1); NaN where the search gave up.

    rate, second and third are the rows of the derivatives. Turning points are looked for in steps that hold one at most, but for times at
    which |f| + |f'| s + |f''| s^2/2 does not pass what was reached before; a flight whose amplitudes cannot is not looked at."""
    level = amplitude_bound(pairs, mean, delta, matrix, value, z, duration)
    if level <= best:
        return best, -1.0
    bound = amplitude_bound(pairs, mean, delta, matrix, second, z, duration) * (1.0 + 1e-12)
    when = -1.0
    for t in (0.0, duration):
        size = abs(value_at(pairs, mean, delta, matrix, False, value, z, t, work))
        if size > best:
            best = size
            when = t
    pure, _, curvature, jerk = separate(pairs, mean, delta, matrix, rate, third, z, duration, work)
    floor = 1e-13 * duration
    before = 0.0
    f_before = 0.0
    sign = 0
    low = False
    t = 0.0
    for _ in range(STEP_LIMIT):
        f, slope, bend = look(pairs, mean, delta, matrix, pure, work, rate, second, third, z, t)
        now = 1 if f > 0.0 else -1 if f < 0.0 else sign
        if sign * now < 0 and not low:
            guess = before + f_before / (f_before - f) * (t - before)
            turn = refine(pairs, mean, delta, matrix, pure, rate, second, third, z, before, t, guess, sign > 0, 1e-9 * duration, work)
            size = abs(value_at(pairs, mean, delta, matrix, pure, value, z, turn, work))
            if size > best:
                best = size
                when = turn
        sign = now
        if t >= duration:
            return best, when
        before = t
        f_before = f
        step = safe_step(f, slope, bend, curvature, jerk)
        room = best + SLACK * level - abs(value_at(pairs, mean, delta, matrix, pure, value, z, t, work))
        below = 2.0 * room / (abs(f) + math.sqrt(f * f + 2.0 * bound * room)) if room > 0.0 and bound > 0.0 else 0.0
        low = below > step
        t = min(duration, t + max(step, below, floor))
    return math.nan, -1.0


@kernel
def largest_of_motion(phases, begins, numbers, states, end, rows, weight, work, z, integral_work, squares, best, when, total):
    """Largest values best (R,) and their times when (R,), and the integrals total (R,) of the squares, over flights as in `motion.sample`.

    rows (4, F, R, N): the functionals in each phase and their three derivatives; weight (R,) of ones; work (N,), z (N,), squares (R,):
    scratch. A bound that grows over a flight would not be worth much at its end: the flight is taken in pieces over which it does not."""
    for k in range(begins.shape[0]):
        f = numbers[k, 2]
        duration = (begins[k + 1] if k + 1 < begins.shape[0] else end) - begins[k]
        pairs = phases.pairs[f]
        mean = phases.mean[f]
        delta = phases.delta[f]
        matrix = phases.matrix[f]
        pieces = 1 + int(growth_rate(pairs, mean, delta, matrix)[1] * duration)
        span = duration / pieces
        for piece in range(pieces):
            flow_state(pairs, mean, delta, matrix, states[k], piece * span, z)
            for c in range(best.shape[0]):
                size, t = largest_of_flight(
                    pairs, mean, delta, matrix, rows[0, f, c], rows[1, f, c], rows[2, f, c], rows[3, f, c], z, span, best[c], work
                )
                if not size == size:
                    return False
                if t >= 0.0:
                    best[c] = size
                    when[c] = begins[k] + piece * span + t
        integrals(pairs, mean, delta, matrix, rows[0, f], rows[0, f], weight, states[k], duration, integral_work, squares)
        for c in range(best.shape[0]):
            total[c] += squares[c]
    return True
