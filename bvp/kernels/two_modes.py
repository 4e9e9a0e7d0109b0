"""A system of two oscillating modes as one row of numbers: rotations, and the dissipation over a flight.

What is dissipated are integrals of squares of sums of two decaying oscillations: of exponentials of the sums of two rates, in closed form.
"""

import math

from bvp.kernels.compiled import inlined, kernel

MEAN, FREQUENCY, STEP, LOWER, UPPER, RESTITUTION, MASS, PUSH, PUSH_REST = 0, 2, 4, 5, 6, 7, 8, 9, 13
INTO, OUT, ROTATIONS, FORM, TERMS = 17, 33, 49, 97, 105
"""Where the numbers of a system stand: m and w of the modes; h; the bounds; restitution; mass across the gap; (p, q) of a unit of speed
across the gap, as the nearest doubles and what these leave; (p, q) of (u, v), 4 x 4, and back; e^{mt} (cos wt, sin wt) of both modes for
h, h/2, .. h/2^11; mass and stiffness; then for each damper its part, weight and b . v as a row over (p, q)."""

LEVELS = 12

PARTS = 3
"""Parts of the dissipation that are counted apart."""

AT = 6
"""Numbers of a damper."""

RECIPROCAL = tuple(1.0 / k for k in range(10, 1, -1))

SERIES = 0.1
"""|x t| below which (e^{xt} - 1)/x is a series."""


@inlined
def numbers(array, at):
    """Four numbers of an array from `at` on."""
    return array[at], array[at + 1], array[at + 2], array[at + 3]


@inlined
def product(row, state):
    """a_1 p_1 + b_1 q_1 + a_2 p_2 + b_2 q_2 for row = (a_1, b_1, a_2, b_2) and state = (p_1, q_1, p_2, q_2)."""
    return row[0] * state[0] + row[1] * state[1] + row[2] * state[2] + row[3] * state[3]


@inlined
def radii(state):
    """Amplitudes of both modes."""
    p1, q1, p2, q2 = state
    return math.sqrt(p1 * p1 + q1 * q1), math.sqrt(p2 * p2 + q2 * q2)


@inlined
def rotated(m, w, t):
    """e^{mt} (cos wt, sin wt)."""
    e = math.exp(m * t)
    return e * math.cos(w * t), e * math.sin(w * t)


@inlined
def mode_rotations(rates, t):
    """e^{mt} (cos wt, sin wt) of both modes. rates: (m_1, w_1, m_2, w_2)."""
    c1, s1 = rotated(rates[0], rates[1], t)
    c2, s2 = rotated(rates[2], rates[3], t)
    return c1, s1, c2, s2


@inlined
def turned(state, rotations):
    """The state after the flight whose `rotations` are given."""
    p1, q1, p2, q2 = state
    c1, s1, c2, s2 = rotations
    return p1 * c1 + q1 * s1, q1 * c1 - p1 * s1, p2 * c2 + q2 * s2, q2 * c2 - p2 * s2


@inlined
def changing(rates, state):
    """The derivative of a state by time."""
    m1, w1, m2, w2 = rates
    p1, q1, p2, q2 = state
    return m1 * p1 + w1 * q1, m1 * q1 - w1 * p1, m2 * p2 + w2 * q2, m2 * q2 - w2 * p2


@inlined
def rotated_slightly(m, w, t, c, s):
    """(c, s) rotated by e^{(m + iw)t}, for |t| so small that five terms of the series are exact to rounding.

    The change is added to (c, s). A product with the cosine of a small angle would be rounded to the same side at each impact of a
    nearly steady motion."""
    x = m * t
    y = w * t
    real = 1.0
    imaginary = 0.0
    for factor in (1.0 / 5.0, 1.0 / 4.0, 1.0 / 3.0, 1.0 / 2.0):
        real, imaginary = 1.0 + (real * x - imaginary * y) * factor, (real * y + imaginary * x) * factor
    real, imaginary = real * x - imaginary * y, real * y + imaginary * x
    return c + (c * real - s * imaginary), s + (c * imaginary + s * real)


@inlined
def mean_decay(rate, end, t):
    """Integral of exp(rate s) over 0 <= s <= t, given its value at the end."""
    # Equation (29) for a real rate; a series where the quotient would cancel.
    x = rate * t
    if not abs(x) <= SERIES:
        value = (end - 1.0) / rate
    elif abs(x) <= 0.01:
        value = 1.0 + x * (1.0 / 4.0) * (1.0 + x * (1.0 / 5.0) * (1.0 + x * (1.0 / 6.0)))
        value = t * (1.0 + x * (1.0 / 2.0) * (1.0 + x * (1.0 / 3.0) * value))
    else:
        value = 1.0
        for k in range(9):
            value = 1.0 + value * x * RECIPROCAL[k]
        value *= t
    return value


@inlined
def mean_turn(real, imaginary, end_real, end_imaginary, t):
    """Integral of exp((real + i imaginary) s) over 0 <= s <= t, given its value at the end; imaginary is not 0."""
    # Equation (29) for a complex rate.
    x = real * t
    y = imaginary * t
    if not abs(x) + abs(y) <= SERIES:
        below = 1.0 / (real * real + imaginary * imaginary)
        a = end_real - 1.0
        first = (a * real + end_imaginary * imaginary) * below
        second = (end_imaginary * real - a * imaginary) * below
    else:
        total = 1.0
        other = 0.0
        for k in range(9):
            total, other = (total * x - other * y) * RECIPROCAL[k] + 1.0, (total * y + other * x) * RECIPROCAL[k]
        first = total * t
        second = other * t
    return first, second


@kernel
def spend(system, terms, state, t, rotations, taken):
    """Dissipation of each part over a flight of t (may be infinite) from the given state, into taken (PARTS,). Returns the total.

    state: (p_1, q_1, p_2, q_2). rotations: e^{mt} (cos wt, sin wt) of both modes at the end of the flight."""
    p1, q1, p2, q2 = state
    c1, s1, c2, s2 = rotations
    m1 = system[MEAN]
    m2 = system[MEAN + 1]
    w1 = system[FREQUENCY]
    w2 = system[FREQUENCY + 1]
    for k in range(PARTS):
        taken[k] = 0.0
    if terms == 0:
        return 0.0
    a1 = mean_decay(2.0 * m1, c1 * c1 + s1 * s1, t)
    a2 = mean_decay(2.0 * m2, c2 * c2 + s2 * s2, t)
    c11, s11 = mean_turn(2.0 * m1, 2.0 * w1, c1 * c1 - s1 * s1, 2.0 * c1 * s1, t)
    c22, s22 = mean_turn(2.0 * m2, 2.0 * w2, c2 * c2 - s2 * s2, 2.0 * c2 * s2, t)
    cs, ss = mean_turn(m1 + m2, w1 + w2, c1 * c2 - s1 * s2, c1 * s2 + s1 * c2, t)
    cd, sd = mean_turn(m1 + m2, w1 - w2, c1 * c2 + s1 * s2, s1 * c2 - c1 * s2, t)
    total = 0.0
    for k in range(terms):
        at = TERMS + AT * k
        x1 = system[at + 2] * p1 + system[at + 3] * q1
        y1 = system[at + 2] * q1 - system[at + 3] * p1
        x2 = system[at + 4] * p2 + system[at + 5] * q2
        y2 = system[at + 4] * q2 - system[at + 5] * p2
        # The integral of the square of a sum of two decaying oscillations.
        own = 0.5 * ((x1 * x1 + y1 * y1) * a1 + (x1 * x1 - y1 * y1) * c11) + x1 * y1 * s11
        own += 0.5 * ((x2 * x2 + y2 * y2) * a2 + (x2 * x2 - y2 * y2) * c22) + x2 * y2 * s22
        own += (x1 * x2 + y1 * y2) * cd + (y1 * x2 - x1 * y2) * sd + (x1 * x2 - y1 * y2) * cs + (x1 * y2 + y1 * x2) * ss
        own *= system[at + 1]
        taken[int(system[at])] += own
        total += own
    return total


@kernel
def taken_after(system, terms, state, t, parts):
    """(energy dissipated by the dampers until t, their power at t)."""
    way = mode_rotations((system[MEAN], system[FREQUENCY], system[MEAN + 1], system[FREQUENCY + 1]), t)
    taken = spend(system, terms, state, t, way, parts)
    later = turned(state, way)
    power = 0.0
    for k in range(terms):
        at = TERMS + AT * k
        rate = product(numbers(system, at + 2), later)
        power += system[at + 1] * rate * rate
    return taken, power


@kernel
def fraction_time(system, terms, state, length, total, wanted, parts):
    """The time after which the dampers have dissipated `wanted`, on a flight that dissipates `total`; `length` may be infinite."""
    low = 0.0
    high = length
    left = total - wanted
    t = length * wanted / total if length < math.inf else math.log(total / left) / (-system[MEAN] - system[MEAN + 1]) if left > 0.0 else 0.0
    for _ in range(200):
        taken, power = taken_after(system, terms, state, t, parts)
        residual = taken - wanted
        if residual > 0.0:
            high = t
        else:
            low = t
        # What is left decays, by and large, as an exponential.
        change = -residual / power if power > 0.0 else math.inf
        if high == math.inf or length == math.inf:
            present = total - taken
            if present > 0.0 < left and power > 0.0:
                change = math.log(present / left) * present / power
        better = t + change
        if not low <= better <= high:
            better = 0.5 * (low + high) if high < math.inf else 2.0 * t + 1.0
        if abs(better - t) <= 1e-14 * t or abs(residual) <= 4e-16 * total:
            break
        t = better
    return t


@inlined
def moves_away(slope, bend, jerk, fourth, h):
    """Whether a distance that is 0 stays positive over a step of h, by its three derivatives at the begin and a bound of the fourth: the
    Bezier coefficients of the distance over the time, a cubic, are positive."""
    return (
        slope > 0.0 and slope + bend * h / 6.0 > 0.0 and slope + bend * h / 3.0 + jerk * h * h / 18.0 > 0.0
        and slope + bend * h / 2.0 + jerk * h * h / 6.0 - fourth * h * h * h / 24.0 > 0.0
    )  # fmt: skip


@inlined
def zero_in_step(w, v, wn, vn, h, bound):
    """The part of a step of h at which the cubic with the values and slopes (w, v) and (wn, vn) of its ends passes a bound, by Newton's
    method from the secant."""
    s = (bound - w) / (wn - w)
    ca = v * h
    cc = vn * h
    rise = wn - w
    for _ in range(3):
        value = w + s * (ca + s * ((3.0 * rise - 2.0 * ca - cc) + s * (ca + cc - 2.0 * rise))) - bound
        slope = ca + s * (2.0 * (3.0 * rise - 2.0 * ca - cc) + 3.0 * s * (ca + cc - 2.0 * rise))
        s = min(max(s - value / slope, 0.0), 1.0) if slope != 0.0 else s
    return s


@inlined
def derivatives(rates, row, state):
    """f, f' and f'' of f = `product` of row and state."""
    rate = changing(rates, state)
    return product(row, state), product(row, rate), product(row, changing(rates, rate))


@kernel
def climb(rates, row, third, fourth, state, length, peak):
    """The larger of `peak` and of max |f| over a time `length` from the given state, where f = `product` of row and state.

    third, fourth: bounds of the third and fourth derivative of f. The time is split into parts. On each part f stays below the peak, or f'
    keeps its sign, or f'' keeps its sign and f' has one zero, which Newton's method finds."""
    t = 0.0
    size = length
    f0, g0, h0 = derivatives(rates, row, state)
    for _ in range(10000):
        size = min(size, length - t)
        later = turned(state, mode_rotations(rates, size))
        f1, g1, h1 = derivatives(rates, row, later)
        ends = max(abs(f0), abs(f1))
        # Equation (11): the Bezier coefficients of the cubic through both ends, widened by its error.
        hull = max(ends, max(abs(f0 + size * g0 / 3.0), abs(f1 - size * g1 / 3.0))) + fourth * size * size * size * size / 384.0
        square = size * size / 8.0
        convex = h0 * h1 > 0.0 and min(abs(h0), abs(h1)) > fourth * square
        if hull > peak:
            if convex and g0 * g1 < 0.0:
                # Newton for the one turning point, kept between the ends.
                s = size * g0 / (g0 - g1)
                low = 0.0
                high = size
                for _ in range(50):
                    f, g, h = derivatives(rates, row, turned(state, mode_rotations(rates, s)))
                    ends = max(ends, abs(f))
                    if g * g0 > 0.0:
                        low = s
                    else:
                        high = s
                    better = s - g / h if h != 0.0 else 0.5 * (low + high)
                    if not low <= better <= high:
                        better = 0.5 * (low + high)
                    if abs(h) * (better - s) * (better - s) <= 1e-15 * abs(f):
                        break
                    s = better
            elif not (
                (convex or min(abs(g0), abs(g1)) > third * square) and g0 * g1 >= 0.0
                or hull - ends <= 1e-15 * hull or size <= 1e-9 * length
            ):  # fmt: skip
                size *= 0.5
                continue
            peak = max(peak, ends)
        state = later
        f0, g0, h0 = f1, g1, h1
        t += size
        if t >= length:
            break
        size *= 2.0
    return peak


@kernel
def raised(rates, row, third, fourth, state, later, length, h, peak):
    """The larger of `peak` and max |f| over the first `length` of a step of h between two known states."""
    f0 = product(row, state)
    g0 = product(row, changing(rates, state))
    f1 = product(row, later)
    g1 = product(row, changing(rates, later))
    hull = max(max(abs(f0), abs(f0 + h * g0 * (1.0 / 3.0))), max(abs(f1 - h * g1 * (1.0 / 3.0)), abs(f1)))
    hull += fourth * h * h * h * h * (1.0 / 384.0)
    if hull <= peak:
        return peak
    if length == h and g0 * g1 > 0.0 and min(abs(g0), abs(g1)) > third * h * h * 0.125:
        return max(peak, max(abs(f0), abs(f1)))
    return climb(rates, row, third, fourth, state, length, peak)
