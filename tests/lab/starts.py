"""Starts that are followed through their impacts with their derivatives, verdicts on intervals of them, and arcs; for n = 2."""

import math
from typing import NamedTuple

import numpy as np

from bvp.closures import KINDS
from bvp.kernels import arc_pairs, intervals, shooting, verdict
from bvp.kernels import arcs as at
from bvp.kernels import shooting as column
from bvp.kernels.meetings import follow_arc
from bvp.kernels.shooting import AHEAD, FREE, STUCK
from bvp.kernels.verdict import CLOSED, MARGIN, SKIMS

__all__ = [
    "AHEAD", "Arc", "ArcPoint", "CLOSED", "FREE", "MARGIN", "Places", "SKIMS", "STUCK", "StartFlight", "amplitude", "are_apart",
    "boxes_apart", "crossing", "flight_verdict", "follow", "hull", "positive_between", "turn_between",
]  # fmt: skip


class _Entry:
    """An entry of a row: a number, or an array where it has a shape."""

    def __init__(self, place, *shape):
        self._place, self._shape = place, shape

    def __get__(self, owner, kind=None):
        size = math.prod(self._shape)
        part = owner.row[self._place : self._place + size]
        return part.reshape(self._shape) if self._shape else float(part[0])

    def __set__(self, owner, value):
        owner.row[self._place : self._place + math.prod(self._shape)] = value


class StartFlight:
    """One flight of a start that is followed. The derivatives are by the parameter of the start."""

    state, state_rate = _Entry(column.STATE, 4), _Entry(column.DERIVATIVE, 4)  # modal, at the begin
    time, time_rate = _Entry(column.TIME), _Entry(column.TIME + 1)  # of the begin
    duration, duration_rate = _Entry(column.DURATION), _Entry(column.DURATION + 1)
    contact = _Entry(column.CONTACT)  # hit at its end, or FREE, STUCK or AHEAD
    speed, speed_rate = _Entry(column.SPEED), _Entry(column.SPEED + 1)  # of approach there
    residual, residual_rate = _Entry(column.RESIDUAL), _Entry(column.RESIDUAL + 1)  # velocity along the stop there
    acceleration = _Entry(column.ACCELERATION)  # towards the stop there
    clearance, clearance_rate = _Entry(column.CLEARANCE), _Entry(column.CLEARANCE + 1)  # least distance at a turning point inside
    second = _Entry(column.SECOND)  # the second least one
    turning_points = _Entry(column.TURNING_POINTS)

    def __init__(self, **entries):
        self.row = np.zeros(column.COLUMNS)
        for name, value in entries.items():
            setattr(self, name, value)

    @property
    def has_impact(self):
        return self.contact >= 0.0

    def with_clearance(self, curve, longest):
        """Return the flight with the turning points inside it, of starts that are followed for so long."""
        found = StartFlight()
        found.row[:] = self.row
        shooting.find_clearance(curve.flow, found.row, longest, np.zeros((16, 16)))
        return found


def follow(curve, parameter, longest, most, latest=math.inf):
    """Return the flights of a start on a curve (`branches.search.starts.curves`): for a time, through so many impacts, those that begin up
    to `latest`."""
    record = np.full((most + 2, column.COLUMNS), np.nan)
    flights = []
    for k in range(shooting.follow_impacts(curve.flow, float(parameter), longest, latest, most, record, np.zeros((16, 16)))):
        flights.append(StartFlight())
        flights[-1].row = record[k]
    return flights


def amplitude(square, q, p, horizon, order):
    """Return a bound of |q(t)| (order 0), |q'(t)| (1) or |q''(t)| (2) of one mode over a flight."""
    return shooting.amplitude(square, q, p, horizon, order)


class Places(NamedTuple):
    """A map of x in [0, 1] to the parameter of starts; kind: 0 linear, 1 quadratic at the low end, 2 at the high end, 3 at both."""

    low: float
    high: float
    kind: int

    def place(self, x):
        """Return the parameter at x, and its derivative."""
        return intervals.place(intervals.StartMap(*self), x)

    def unplace(self, parameter):
        """Return the x of a parameter."""
        return intervals.unplace(intervals.StartMap(*self), parameter)


def positive_between(values, rates, r, noise=0.0):
    """Whether a quantity is known to stay positive over an interval of half width r, from its values and derivatives at the low end, the
    middle and the high end."""
    (a, m, b), (of_a, of_m, of_b) = values, rates
    return verdict.positive_between(a, of_a, m, of_m, b, of_b, r, noise)


def crossing(curve, end, state, along, r, width, near):
    """Return whether one crossing by an end "origin" or "rest" can hold an orbit (0 no, 1 one at most, -1 undecided) and the time of the
    least distance, for free motion without springs.

    state, along (4,) : of the middle start, and its derivative; r, width : of the tube; near : first, last and guessed time
    """
    flow = curve.flow._replace(squares=np.zeros(2))
    row = StartFlight(state=state).row
    return verdict.crossing(flow, KINDS[end], verdict.Tube(row, along, r, width), verdict.Visit(*near), np.empty(4), np.empty(4))


def flight_verdict(curve, k, low, high, middle, r, times, impacts, longest, most):
    """Return the verdict on flight k of an interval of starts.

    low, high, middle : flights of both ends and of the middle, r : half the width
    times (4,), impacts : the longest time and the most impacts for each kind of far end
    """
    search = verdict.StartSearch(
        curve.flow, times, impacts, False, longest, math.inf, most,
        np.empty((0, 0, column.COLUMNS)), np.empty(0, np.int64), np.zeros((16, 16)),
    )  # fmt: skip
    beyond = np.full((1, column.COLUMNS), np.nan)
    samples = (
        verdict.Sample(np.vstack([*(flight.row for flight in flights), beyond]), len(flights), 1.0) for flights in (low, high, middle)
    )
    return verdict.flight_verdict(search, k, *samples, r, 4.5e-16, np.empty((3, 8)), np.zeros(3, np.int64))


class ArcPoint(NamedTuple):
    """Position s along the stop, velocity v along it and speed n, at a place of an arc (3,), and their derivatives by u (3,).

    is_inside : whether the start that was followed arrives in the arc's box; last : the flight that arrives, None for none
    """

    values: np.ndarray
    rates: np.ndarray
    is_inside: bool = True
    last: StartFlight | None = None


class Arc:
    """The image of an interval of starts on the section of the impacts: s, v and n as functions of u from -1 to 1."""

    impacts, curve = _Entry(at.IMPACTS), _Entry(at.CURVE)
    values, rates = _Entry(at.VALUE, 3, 3), _Entry(at.RATE, 3, 3)  # s, v, n at the low end, in the middle, at the high end
    arrived, left = _Entry(at.ARRIVED, 2), _Entry(at.LEFT, 2)  # first and last time of arrival, and of the start of that flight
    error, miss = _Entry(at.ERROR, 3), _Entry(at.MISS, 3)  # bounds of what the parabola and the cubics are wrong by
    box = _Entry(at.BOX, 3, 2)

    def __init__(self, row):
        self.row = row

    @classmethod
    def of_cubics(cls, polynomials):
        """The arc whose coordinates are cubics of u, (3, 4) coefficients."""
        arc, u = cls(np.zeros(at.ARC)), np.array([-1.0, 0.0, 1.0])
        for c, p in enumerate(polynomials):
            arc.values[c], arc.rates[c] = np.polyval(p, u), np.polyval(np.polyder(p), u)
        arc.row[[at.BEFORE, at.AFTER]] = at.NEAREST
        at.bound_arc(arc.row)
        return arc

    def impacts_of_image(self, search):
        """Number of impacts before its curve of starts begins."""
        return search.gone[int(self.curve)]

    def follow(self, search, u):
        """Return the `ArcPoint` at u by following its start."""
        out = Arc(np.zeros(at.ARC))
        arrives, _, _ = follow_arc(search, self.row, u, search.records[0], out.row, 0)
        last = None
        if self.impacts > 0:
            last = StartFlight()
            last.row[:] = search.records[0][int(self.impacts) - 1]
        return ArcPoint(out.values[:, 0], out.rates[:, 0], bool(arrives), last)

    def model(self, u):
        """Return the `ArcPoint` at u by the cubics through both halves."""
        out = Arc(np.zeros(at.ARC))
        arc_pairs.model(self.row, u, out.row, 1)
        return ArcPoint(out.values[:, 1], out.rates[:, 1])


def hull(arc, chart, is_mirrored):
    """Return the hull (4, 2) of all directions of an arc in two of its coordinates."""
    out = np.zeros((4, 2))
    arc_pairs.hull(arc.row, chart, is_mirrored, out)
    return out


def turn_between(hull, other):
    """Return the sign of the cross products of all directions of two hulls, 0 where it is not certain."""
    return arc_pairs.turn_between(hull, other)


def are_apart(arc, other, chart):
    """Whether an arc and the mirror image of another one are known not to meet in two of their coordinates."""
    return arc_pairs.are_apart(arc.row, other.row, chart)


def boxes_apart(arc, other):
    """Whether the boxes of an arc and of the mirror image of another one are disjoint."""
    return arc_pairs.boxes_apart(arc.row, other.row)
