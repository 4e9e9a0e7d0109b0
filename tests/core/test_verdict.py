"""Verdicts on an interval of starts. Oracles: dense samples of the interval; straight lines past the origin; counts of impacts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from saltus_core import TUBE_MARGIN, FarEnd, FlightRecord, IntervalScan, Verdict, crossing

import saltus
from branches.search import intervals as scanning
from branches.search.starts import curves

LONGEST, MOST = 6.0, 5


def flights_of(curve, parameter):
    return curve.starts.follow(parameter, LONGEST, math.inf, MOST)


@pytest.mark.parametrize("system", [saltus.vibro_impact_nes(), saltus.vibro_impact_nes(0.37, 0.81)])
def test_starts_inside_a_closed_interval_have_the_same_impacts(system):
    """Random intervals, as wide as can just be closed: whatever flight is closed, every start between has it with the same contact,
    or none in the time searched."""
    rng = np.random.default_rng(2)
    closed = 0
    for end, energy in (("origin", 1.3), ("origin", 0.2), ("rest", 1.0), ("stop", 0.7)):
        (curve,) = curves(system, end, energy)
        for place, width in zip(rng.uniform(0.02, 0.93, 100), 10.0 ** rng.uniform(-3.5, -1.3, 100), strict=True):
            low, high = curve.low + np.array([place, place + width]) * (curve.high - curve.low)
            middle, r = 0.5 * (low + high), 0.5 * (high - low)
            a, b, m = (flights_of(curve, x) for x in (low, high, middle))
            inside = [flights_of(curve, x) for x in np.linspace(low, high, 24)[1:-1]]
            scan = IntervalScan(curve.starts, [LONGEST] * 4, [MOST, MOST, MOST, -1], False, LONGEST, math.inf, MOST)
            for k in range(MOST):
                if scan.verdict(k, a, m, b, r, 4.5e-16) != Verdict.CLOSED:
                    break
                horizon = LONGEST - min(x[k].time for x in (a, b, m))
                hits = {x[k].contact for x in (a, b, m) if x[k].duration <= horizon} or {None}
                assert len(hits) == 1
                for flights in inside:
                    assert len(flights) > k
                    assert hits == {flights[k].contact} or (flights[k].duration > horizon - 1e-9 and None in hits)
                closed += 1
    assert closed > 75


@pytest.mark.parametrize("angle", [0.1, 0.8, 2.5, 4.0])
@pytest.mark.parametrize(("distance", "tube", "expected"), [(0.05, 0.0, 0), (0.011, 0.0, 1), (0.0, 0.0, 1), (0.011, 1.0, -1)])
def test_a_straight_path_past_the_origin(angle, distance, tube, expected):
    """Free motion u = d n + v (t - 1), moved by n x over |x| <= r = 0.01: it can meet the origin only where d is below r, a margin of 1.2
    added; a tube as wide as the derivative itself decides nothing."""
    speed = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-speed[1], speed[0]])
    state, along = np.concatenate([distance * normal - speed, speed]), np.concatenate([normal, np.zeros(2)])
    verdict, time = crossing([0.0, 0.0], FarEnd.ORIGIN, state.tolist(), along.tolist(), 0.01, tube, [0.5, 1.5, 0.9])
    assert verdict == expected and abs(time - 1.0) < 1e-12


def width_of(curve, along, window, r=1e-3, acceleration=2.0):
    """The width of the tube of the gap coordinate that the verdict reckons with, for starts whose states after an impact differ by
    `along` (4,): from the slowest speed of the next impact, against an acceleration, that it does not take for one that may be skimmed."""

    def verdict(speed):
        flights = [FlightRecord(), FlightRecord()]
        flight = flights[1]
        flight.state, flight.derivative = [0.3, -0.2, 0.9, 0.4], along.tolist()
        flight.time, flight.duration, flight.contact, flight.clearance = 1.0, window, 0, math.inf
        flight.speed, flight.acceleration, flight.residual = speed, acceleration, 1e6
        times = [-1.0, -1.0, 2.0 + window, -1.0]
        scan = IntervalScan(curve.starts, times, [1, 1, 1, -1], False, 2.0 + window, math.inf, 1)
        return scan.verdict(1, flights, flights, flights, r, 4.5e-16)

    low, high = 1e-12, 10.0
    assert verdict(low) == Verdict.SKIMS and verdict(high) == Verdict.CLOSED
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if verdict(middle) == Verdict.SKIMS else (low, middle)
    return high**2 / (2.0 * acceleration) / r


@pytest.mark.parametrize("window", [0.01, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("system", [saltus.vibro_impact_nes(), saltus.vibro_impact_nes(0.01, 1.0)])
def test_the_tube_holds_the_gap_and_grows_from_the_impact_on(system, window):
    """Oracle: the modes' cosines and sines: how far the gap coordinate of neighbours parts within the flight. From an impact, where all
    are at the stop, it parts with the time, or with its square where the speeds along the gap are equal."""
    (curve,) = curves(system, "origin", 1.0)
    gap, squares = system.modes.contacts.gap[0, :2], system.modes.squares
    across = np.array([-gap[1], gap[0]]) / np.hypot(*gap)
    t = np.linspace(0.0, window, 400)
    w = np.sqrt(squares)
    rng = np.random.default_rng(4)
    for _ in range(40):
        place, speed, slip = rng.normal(size=3)
        same = np.concatenate([place * across, slip * across])
        parting = same + np.concatenate([np.zeros(2), speed * gap / (gap @ gap)])
        wide = [width_of(curve, along, window) for along in (same, parting)]
        for along, width in zip((same, parting), wide, strict=True):
            apart = sum(gap[c] * (along[c] * np.cos(w[c] * t) + along[c + 2] * np.sin(w[c] * t) / w[c]) for c in range(2))
            assert width >= TUBE_MARGIN * np.max(np.abs(apart)) * (1.0 - 1e-9)
        force = sum(abs(gap[c]) * squares[c] * np.hypot(same[c], same[c + 2] / w[c]) for c in range(2))
        assert wide[0] <= TUBE_MARGIN * 0.5 * force * window**2 * (1.0 + 1e-9)
        whole = sum(abs(gap[c]) * np.hypot(parting[c], parting[c + 2] / w[c]) for c in range(2))
        assert wide[1] <= TUBE_MARGIN * whole * (1.0 + 1e-9)
        if window < 0.05:
            assert wide[1] == pytest.approx(TUBE_MARGIN * abs(speed) * window, rel=0.02 * (1.0 + force / abs(speed)))


def test_more_impacts_than_are_followed_leave_the_interval_open():
    """Without a bound of impacts a motion is followed through so many; one that has more in its time is not decided."""
    (curve,) = curves(saltus.vibro_impact_nes(), "origin", 20.0)
    curve = replace(curve, most_impacts=3)
    passages, openings, counts = scanning.scan(curve, {"origin": (4.0, None)}, 100_000)
    assert counts["open"] == len(openings) > 0 and {opening.reason for opening in openings} == {Verdict.ENDLESS}
    assert max(passage.impacts for passage in passages) <= 3
    _, openings, counts = scanning.scan(curve, {"origin": (4.0, 3)}, 100_000)
    assert not openings and counts["open"] == 0
