"""Whether an arc and the mirror image of another one are apart, or meet once at most (`bvp.kernels.arcs`).

A motion reversed in time leaves an impact with the opposite velocity along the stop: the mirror image of (s, v, n) is (s, -v, n). Arcs are
compared in two of the three coordinates, a chart: the two in which their directions differ most. Slow impacts, for example, differ in n.
In s and v they are all next to the curve n = 0 and have its direction.
"""

import math

from numpy import int64

from bvp.kernels import arcs as at
from bvp.kernels.compiled import inlined, kernel


@inlined
def cross_product(a0, a1, b0, b1):
    """Cross product of two plane vectors."""
    return a0 * b1 - a1 * b0


@inlined
def mirrored(c):
    """The sign of coordinate c in a reversed motion."""
    return -1.0 if c == 1 else 1.0


@kernel
def choose_chart(a, b):
    """The two coordinates in which the directions of two arcs in their middles differ most."""
    best = -1.0
    first = int64(0)
    second = int64(1)
    for c in range(3):
        d = (c + 1) % 3
        low = int64(min(c, d))
        high = int64(max(c, d))
        size = abs(
            cross_product(
                a[at.RATE + 3 * low + 1], a[at.RATE + 3 * high + 1],
                mirrored(low) * b[at.RATE + 3 * low + 1], mirrored(high) * b[at.RATE + 3 * high + 1],
            )
        )  # fmt: skip
        if size > best:
            best = size
            first = low
            second = high
    return first, second


@kernel
def hull(arc, chart, is_mirrored, out):
    """The Bezier points of the parabola through the derivatives of an arc (3, 2), and then their errors. They are a hull of all its
    directions."""
    low = -1.0 - arc[at.BEFORE]
    high = 1.0 + arc[at.AFTER]
    for i in range(2):
        c = chart[i]
        sign = mirrored(c) if is_mirrored else 1.0
        middle = sign * arc[at.RATE + 3 * c + 1]
        slope = sign * 0.5 * (arc[at.RATE + 3 * c + 2] - arc[at.RATE + 3 * c])
        bend = sign * 0.5 * (arc[at.RATE + 3 * c + 2] + arc[at.RATE + 3 * c]) - middle
        out[0, i] = middle + low * (slope + low * bend)
        out[1, i] = middle + 0.5 * (low + high) * slope + low * high * bend
        out[2, i] = middle + high * (slope + high * bend)
        out[3, i] = arc[at.ERROR + c]


@kernel
def turn_between(a, b):
    """The sign of the cross products of all directions of two hulls, 0 if it is not certain."""
    # Where it is certain, equation (36) has one solution at most.
    sign = 0.0
    for i in range(3):
        for j in range(3):
            value = cross_product(a[i, 0], a[i, 1], b[j, 0], b[j, 1])
            error = abs(a[i, 0]) * b[3, 1] + abs(a[i, 1]) * b[3, 0] + abs(b[j, 0]) * a[3, 1] + abs(b[j, 1]) * a[3, 0]
            error += a[3, 0] * b[3, 1] + a[3, 1] * b[3, 0]
            if not abs(value) > error or value * sign < 0.0:
                return 0.0
            sign = 1.0 if value > 0.0 else -1.0
    return sign


@kernel
def side_of(f0, f1, noise0, noise1, b):
    """The sign of the cross products of a vector, known up to noise, with all directions of a hull; 0 if it is not certain."""
    sign = 0.0
    for j in range(3):
        value = cross_product(f0, f1, b[j, 0], b[j, 1])
        bound = abs(f0) * b[3, 1] + abs(f1) * b[3, 0] + noise0 * (abs(b[j, 1]) + b[3, 1]) + noise1 * (abs(b[j, 0]) + b[3, 0])
        if not abs(value) > bound or value * sign < 0.0:
            return 0.0
        sign = 1.0 if value > 0.0 else -1.0
    return sign


@kernel
def model(arc, u, out, slot):
    """Fill sample `slot` of `out` with the point of an arc at u by its samples: Hermite's cubics on both halves."""
    i = 0 if u < 0.0 else 1
    t = u + 1.0 if u < 0.0 else u
    for c in range(3):
        here = at.VALUE + 3 * c + i
        rate = at.RATE + 3 * c + i
        d = arc[here + 1] - arc[here]
        e = arc[rate] - d
        f = d - arc[rate + 1]
        g = e * (1.0 - t) + f * t
        out[at.VALUE + 3 * c + slot] = arc[here] + t * d + t * (1.0 - t) * g
        out[at.RATE + 3 * c + slot] = d + (1.0 - 2.0 * t) * g + t * (1.0 - t) * (f - e)


@kernel
def copy_sample(arc, i, out, j):
    """Sample i of an arc as sample j of one of its halves."""
    for c in range(3):
        out[at.VALUE + 3 * c + j] = arc[at.VALUE + 3 * c + i]
        out[at.RATE + 3 * c + j] = 0.5 * arc[at.RATE + 3 * c + i]


@inlined
def boxes_apart(a, b):
    """Whether the box of an arc and the mirror image of another's are apart."""
    return (
        a[at.BOX] > b[at.BOX + 1] or a[at.BOX + 1] < b[at.BOX] or a[at.BOX + 2] > -b[at.BOX + 2] or a[at.BOX + 3] < -b[at.BOX + 3]
        or a[at.BOX + 4] > b[at.BOX + 5] or a[at.BOX + 5] < b[at.BOX + 4]
    )  # fmt: skip


@kernel
def extent_along(arc, chart, n0, n1):
    """Least and greatest value of n0 and n1 times two coordinates on an arc."""
    low = math.inf
    high = -math.inf
    first = at.VALUE + 3 * chart[0]
    second = at.VALUE + 3 * chart[1]
    to_rate = at.RATE - at.VALUE
    for i in range(3):
        here = n0 * arc[first + i] + n1 * arc[second + i]
        rate = (n0 * arc[first + to_rate + i] + n1 * arc[second + to_rate + i]) / 3.0
        low = min(low, here)
        high = max(high, here)
        if i > 0:
            low = min(low, here - rate)
            high = max(high, here - rate)
        if i < 2:
            low = min(low, here + rate)
            high = max(high, here + rate)
    more = 0.0
    for i in range(2):
        rates = at.RATE + 3 * chart[i]
        beyond = max(abs(arc[rates]) * arc[at.BEFORE], abs(arc[rates + 2]) * arc[at.AFTER])
        more += abs(n0 if i == 0 else n1) * (arc[at.MISS + chart[i]] + beyond)
    return low - more, high + more


@kernel
def are_apart(a, b, chart):
    """Whether the Bezier points of an arc and of the mirror image of another are apart, seen along the chord of either."""
    sign0 = mirrored(chart[0])
    sign1 = mirrored(chart[1])
    first = at.VALUE + 3 * chart[0]
    second = at.VALUE + 3 * chart[1]
    for which in range(2):
        if which == 0:
            n0, n1 = a[second] - a[second + 2], a[first + 2] - a[first]
        else:
            n0, n1 = sign1 * (b[second] - b[second + 2]), sign0 * (b[first + 2] - b[first])
        low_a, high_a = extent_along(a, chart, n0, n1)
        low_b, high_b = extent_along(b, chart, sign0 * n0, sign1 * n1)
        if low_a > high_b or high_a < low_b:
            return True
    return False


@kernel
def bend_of(hulls):
    """How much the derivative changes along the arc of a hull."""
    return math.hypot(hulls[2, 0] - hulls[0, 0], hulls[2, 1] - hulls[0, 1]) + hulls[3, 0] + hulls[3, 1]
