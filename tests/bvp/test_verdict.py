"""Verdicts on an interval of starts. Oracles: dense samples of the interval; straight lines past the origin; counts of impacts."""

import numpy as np
import pytest

import saltus
from branches.discovery import scan as scanning
from branches.discovery.starts import curves
from bvp.kernels.follow import COLUMNS, CONTACT, DURATION, TIME, follow
from bvp.kernels.passages import passage
from bvp.kernels.segment import ORIGIN
from bvp.kernels.verdict import CLOSED, ENDLESS, flight_verdict

LONGEST, MOST = 6.0, 5


def record_of(curve, parameter):
    record = np.full((MOST + 2, COLUMNS), np.nan)
    return record, follow(curve.flow, parameter, LONGEST, MOST, record, np.zeros((16, 16)))


@pytest.mark.parametrize("system", [saltus.vibro_impact_nes(), saltus.vibro_impact_nes(0.37, 0.81)])
def test_starts_inside_a_closed_interval_have_the_same_impacts(system):
    """Random intervals, as wide as can just be closed: whatever flight is closed, every start between has it with the same contact,
    or none in the time searched."""
    rng = np.random.default_rng(2)
    times, impacts = np.full(3, LONGEST), np.full(3, MOST)
    closed = 0
    for end, energy in (("origin", 1.3), ("origin", 0.2), ("rest", 1.0), ("stop", 0.7)):
        (curve,) = curves(system, end, energy)
        for place, width in zip(rng.uniform(0.02, 0.93, 400), 10.0 ** rng.uniform(-3.5, -1.3, 400), strict=True):
            low, high = curve.low + np.array([place, place + width]) * (curve.high - curve.low)
            middle, r = 0.5 * (low + high), 0.5 * (high - low)
            (a, of_a), (b, of_b), (m, of_m) = (record_of(curve, x) for x in (low, high, middle))
            inside = [record_of(curve, x) for x in np.linspace(low, high, 24)[1:-1]]
            for k in range(MOST):
                verdict = flight_verdict(
                    curve.flow, k, a, b, m, of_a, of_b, of_m, 1.0, 1.0, 1.0, r, 4.5e-16, times, impacts, LONGEST, MOST, np.empty((3, 8)),
                    np.zeros(3, np.int64), np.zeros((16, 16)),
                )  # fmt: skip
                if verdict != CLOSED:
                    break
                horizon = LONGEST - min(x[k, TIME] for x in (a, b, m))
                hits = {x[k, CONTACT] for x in (a, b, m) if x[k, DURATION] <= horizon} or {None}
                assert len(hits) == 1
                for record, rows in inside:
                    assert rows > k
                    assert hits == {record[k, CONTACT]} or (record[k, DURATION] > horizon - 1e-9 and None in hits)
                closed += 1
    assert closed > 300


@pytest.mark.parametrize("angle", [0.1, 0.8, 2.5, 4.0])
@pytest.mark.parametrize(("distance", "tube", "expected"), [(0.05, 0.0, 0), (0.011, 0.0, 1), (0.0, 0.0, 1), (0.011, 1.0, -1)])
def test_a_straight_path_past_the_origin(angle, distance, tube, expected):
    """Free motion u = d n + v (t - 1), moved by n x over |x| <= r = 0.01: it can meet the origin only where d is below r, a margin of 1.2
    added; a tube as wide as the derivative itself decides nothing."""
    (curve,) = curves(saltus.vibro_impact_nes(), "origin", 1.0)
    flow = curve.flow._replace(squares=np.zeros(2))
    speed = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-speed[1], speed[0]])
    row = np.zeros(COLUMNS)
    row[:4] = np.concatenate([distance * normal - speed, speed])
    along = np.concatenate([normal, np.zeros(2)])
    verdict, time = passage(flow, ORIGIN, row, along, 0.01, tube, 0.5, 1.5, 0.9, np.empty(4), np.empty(4))
    assert verdict == expected and abs(time - 1.0) < 1e-12


def test_more_impacts_than_are_followed_leave_the_interval_open(monkeypatch):
    """Without a bound of impacts a motion is followed through so many; one that has more in its time is not decided."""
    (curve,) = curves(saltus.vibro_impact_nes(), "origin", 20.0)
    monkeypatch.setattr(scanning, "MOST_IMPACTS", 3)
    passages, openings, counts = scanning.scan(curve, {"origin": (4.0, None)}, 100_000)
    assert counts["open"] == len(openings) > 0 and {opening.reason for opening in openings} == {ENDLESS}
    assert max(passage.impacts for passage in passages) <= 3
    _, openings, counts = scanning.scan(curve, {"origin": (4.0, 3)}, 100_000)
    assert not openings and counts["open"] == 0
