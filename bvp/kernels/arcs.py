"""Arcs: the images of intervals of starts on the section of the impacts.

A state after an impact is given by its position s along the stop, its velocity v along the stop, and the speed n at which it leaves the
stop. At one energy, two of them give the size of the third one. Starts of an interval whose flights are decided arrive on a smooth arc
(s, v, n). It is known from both ends and the middle of the interval, as the flights are (`bvp.kernels.verdict`). Each arc is a function of
u, from -1 to 1 over its interval. With odd symmetry the mirror image of an impact at the lower stop stands for it.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels import shooting as column
from bvp.kernels.compiled import kernel
from bvp.kernels.shooting import start_at
from bvp.kernels.verdict import SLACK, deviation

IMPACTS, SIDE, LOW, HIGH, KIND, FIRST, LAST, BEFORE, AFTER, VALUE, RATE, ARRIVED, LEFT, ERROR, MISS, BOX, CURVE, MODELLED, GRAIN, ARC = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 18, 27, 29, 31, 34, 37, 43, 44, 45, 46,
)  # fmt: skip
"""Columns of an arc: impacts on the way to it; side of the stop; the map of x to the parameter of starts
(`bvp.kernels.intervals.StartMap`); ends of the interval in x; how far the interval goes on beyond each end, in u; s, v and n at both ends
and in the middle (9), and their derivatives by u (9); first and last time of arrival, and of the start of the flight that arrives (2 each);
for s, v and n a bound of the differences of the derivatives from the parabola through theirs (3), and one of the differences from the
cubics through both halves (3); box around the arc: lowest and highest s, v and n (6); number of the curve; whether the samples are those of
a longer arc's cubics; rounding of the starts, in u."""

NEAREST = 1e-9
"""How far an arc goes on beyond its ends at least, in u."""


class ArcRange(NamedTuple):
    """The interval of an arc in x, how far it goes on beyond its ends, and the rounding of its starts."""

    first: float
    last: float
    before: float
    after: float
    grain: float  # rounding of the starts


@kernel
def has_arc(k, sample_a, sample_m, sample_b):
    """Whether all three starts of an interval have the impact that ends flight k, and are followed beyond it."""
    contact = sample_m.record[k, column.CONTACT]
    if contact < 0.0 or sample_a.record[k, column.CONTACT] != contact or sample_b.record[k, column.CONTACT] != contact:
        return False
    return k + 1 < sample_a.rows and k + 1 < sample_m.rows and k + 1 < sample_b.rows


@kernel
def set_sample(flow, side, fold, z, dz, rate, arc, i):
    """Fill sample i of an arc from the state (4,) after an impact, and from its derivative by the parameter. rate: the parameter's by u."""
    gap = flow.contacts.gap
    size = math.hypot(gap[0, 0], gap[0, 1])
    sign = side if fold else 1.0
    arc[VALUE + i] = sign * (flow.across[0] * z[0] + flow.across[1] * z[1])
    arc[VALUE + 3 + i] = sign * (flow.across[0] * z[2] + flow.across[1] * z[3])
    arc[VALUE + 6 + i] = -side * (gap[0, 0] * z[2] + gap[0, 1] * z[3]) / size
    arc[RATE + i] = sign * rate * (flow.across[0] * dz[0] + flow.across[1] * dz[1])
    arc[RATE + 3 + i] = sign * rate * (flow.across[0] * dz[2] + flow.across[1] * dz[3])
    arc[RATE + 6 + i] = -side * rate * (gap[0, 0] * dz[2] + gap[0, 1] * dz[3]) / size


@kernel
def fill_arc(flow, k, sample_a, sample_m, sample_b, coordinate, reach, fold, arc):
    """Fill the row `arc` with the image of an interval after the impact that ends flight k. fold: whether a mirror image stands for it."""
    side = flow.contacts.side[np.int64(sample_m.record[k, column.CONTACT])]
    arc[IMPACTS] = k + 1
    arc[SIDE] = 1.0 if fold else side
    arc[LOW] = coordinate.low
    arc[HIGH] = coordinate.high
    arc[KIND] = coordinate.kind
    r = 0.5 * (reach.last - reach.first)
    arc[FIRST] = reach.first
    arc[LAST] = reach.last
    arc[BEFORE] = min(max(reach.before / r, NEAREST), 0.5)
    arc[AFTER] = min(max(reach.after / r, NEAREST), 0.5)
    arc[MODELLED] = 0.0
    arc[GRAIN] = reach.grain / r
    for i in range(3):
        sample = sample_a if i == 0 else (sample_m if i == 1 else sample_b)
        row = sample.record[k + 1]
        set_sample(flow, side, fold, row[:4], row[4:8], r * sample.jacobian, arc, i)
    for j in range(2):
        low = math.inf
        high = -math.inf
        for i in range(3):
            sample = sample_a if i == 0 else (sample_m if i == 1 else sample_b)
            row = sample.record[k + 1 - j]
            third = r * sample.jacobian * abs(row[column.TIME + 1]) / 3.0
            low = min(low, row[column.TIME] - third)
            high = max(high, row[column.TIME] + third)
        at = ARRIVED if j == 0 else LEFT
        more = 0.1 * (high - low) + SLACK
        arc[at] = low - more
        arc[at + 1] = high + more
    bound_arc(arc)


@kernel
def fill_stop_arc(flow, low, high, fold, work, arc):
    """Fill the row `arc` with starts at a stop, between two parameters: they are states after an impact, without a velocity along the stop.
    The other columns are 0."""
    side = flow.contacts.side[flow.shape[1]]
    arc[SIDE] = 1.0 if fold else side
    arc[LOW] = low
    arc[HIGH] = high
    arc[LAST] = 1.0
    arc[BEFORE] = NEAREST
    arc[AFTER] = NEAREST
    for i in range(3):
        start_at(flow, low + 0.5 * i * (high - low), work[0, :4], work[1, :4])
        set_sample(flow, side, fold, work[0, :4], work[1, :4], 0.5 * (high - low), arc, i)
    bound_arc(arc)


@kernel
def bound_arc(arc):
    """Fill the bounds of an arc from its samples.

    The integrals of the parabola through the derivatives are wrong by e and f over both halves. If the derivative were of fourth degree, it
    would differ from the parabola by less than 0.8 |e - f| + |e + f|. The cubics would be wrong by an eighth of the bound of that. Three
    times as much is taken, and twice the rounding: one sample in 5000 is beyond the single ones, one in 100,000 beyond these."""
    for c in range(3):
        at = VALUE + 3 * c
        a = arc[RATE + 3 * c]
        m = arc[RATE + 3 * c + 1]
        b = arc[RATE + 3 * c + 2]
        e = arc[at + 1] - arc[at] - (5.0 * a + 8.0 * m - b) / 12.0
        f = arc[at + 2] - arc[at + 1] - (5.0 * b + 8.0 * m - a) / 12.0
        arc[ERROR + c] = 4.0 * (abs(e) + abs(f)) + 0.05 * deviation(a, m, b)
        arc[MISS + c] = 0.4 * arc[ERROR + c] + SLACK * (1.0 + abs(arc[at + 1])) + 2.0 * arc[GRAIN] * max(abs(a), abs(m), abs(b))
    box_arc(arc)


@kernel
def box_arc(arc):
    """Fill the box of an arc."""
    for c in range(3):
        low, high = extent(arc, c)
        arc[BOX + 2 * c] = low
        arc[BOX + 2 * c + 1] = high


@kernel
def extent(arc, c):
    """Least and greatest value of a coordinate on an arc, by the Bezier points of the cubics through both halves."""
    value = arc[VALUE + 3 * c : VALUE + 3 * c + 3]
    rate = arc[RATE + 3 * c : RATE + 3 * c + 3]
    low = min(value[0], value[1], value[2])
    high = max(value[0], value[1], value[2])
    for i in range(2):
        one = value[i] + rate[i] / 3.0
        two = value[i + 1] - rate[i + 1] / 3.0
        low = min(low, one, two)
        high = max(high, one, two)
    more = arc[MISS + c] + max(abs(rate[0]) * arc[BEFORE], abs(rate[2]) * arc[AFTER])
    return low - more, high + more
