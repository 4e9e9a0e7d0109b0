"""Compiled calls return often, and go on exactly where they returned: results do not depend on how much one call does."""

from __future__ import annotations

import numpy as np
import pytest
import saltus_core
from saltus_core import IntervalScan

import branches.search.intervals
import bvp.interrupts
from branches.search.discovery import discover_orbits
from bvp.forcing import Constant, Harmonic
from bvp.interrupts import Pace
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from transitions.record import extents
from transitions.section.section import section

BALL = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)])
SYSTEMS = {
    "elastic": (vibro_impact_nes(), [0.0, 0.0], [0.0, 1.0], None),
    "damped": (vibro_impact_nes(rho=0.7, lam=0.01), [0.0, 0.0], [0.0, 3.0], None),
    "sticking": (BALL, [0.5], [0.0], [Constant([-1.0]), Harmonic(0.7, [1.4])]),
    "plastic": (vibro_impact_nes(rho=0.0, lam=0.01), [0.0, 0.0], [0.0, 3.0], None),
}
MOTION = ("kinds", "times", "contacts", "speeds", "losses", "before", "sums", "totals", "final", "states", "peaks", "sticking_time")
BATCH = ("duration", "impacts", "touches", "sticking_time", "energy", "totals", "marks", "peaks", "final")
SECTION = ("times", "points", "energies", "growths", "tangents", "counts", "impacts", "sticking_times")


@pytest.fixture
def slow(monkeypatch):
    """As little as can be in each call."""

    def slow_down(passes=1):
        monkeypatch.setattr(bvp.interrupts, "FIRST", passes)
        monkeypatch.setattr(bvp.interrupts, "MOST", passes)

    return slow_down


def same(one, other, names):
    for name in names:
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name


@pytest.mark.parametrize("kind", SYSTEMS)
def test_a_motion_does_not_depend_on_the_calls_that_it_takes(kind, slow):
    """Oracle: the same motion in few calls, bit for bit; dissipation and extents too."""
    system, u, v, forces = SYSTEMS[kind]
    times = np.linspace(0.0, 40.0, 101)
    motions, results = [], []
    for _ in range(2):
        motion = simulate(system, u, v, 40.0, forces=forces)
        found = extents(motion)
        motions.append(motion)
        results.append((motion.peaks, *motion.sample(times), motion.spent(times), found.peaks, found.times, found.rms))
        slow()
    same(*motions, MOTION)
    assert motions[0].status is motions[1].status
    for one, other in zip(*results, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("kind", SYSTEMS)
def test_many_motions_do_not_depend_on_the_calls_that_they_take(kind, slow, monkeypatch):
    """Oracle: the same motions in few calls, bit for bit."""
    system, u, v, forces = SYSTEMS[kind]
    starts = np.concatenate([u, v]) * np.linspace(0.2, 1.0, 7)[:, None]
    batches = []
    for _ in range(2):
        batches.append(Simulator(system, forces).run_many(starts, 30.0, with_peaks=True))
        monkeypatch.setattr("bvp.simulate.PASSES", 3)
    same(*batches, BATCH)


@pytest.mark.parametrize("rho", [1.0, 0.4])
def test_a_section_does_not_depend_on_the_calls_that_it_takes(rho, slow):
    """Oracle: the same section in few calls, bit for bit."""
    found = []
    for _ in range(2):
        found.append(section(vibro_impact_nes(rho=rho), 0.6, orbits=4, crossings=30))
        slow()
    same(*found, SECTION)
    assert found[0].ends == found[1].ends


@pytest.mark.parametrize("bounds", [{"quarter_period": 5.0}, {"quarter_period": 3.0, "ends": ("stop-stop", "rest-rest"), "budget": 40}])
def test_a_search_does_not_depend_on_the_calls_that_it_takes(bounds, slow, monkeypatch):
    """Oracle: the same search in few calls, bit for bit. The calls that take least end inside an interval, between two of its flights."""
    calls, found = [], []

    class Counted(IntervalScan):
        def go(self, passes):
            calls[-1] += 1
            return super().go(passes)

    monkeypatch.setattr(branches.search.intervals, "IntervalScan", Counted)
    for _ in range(2):
        calls.append(0)
        found.append(discover_orbits(vibro_impact_nes(), 0.6, **bounds))
        slow()
    one, other = found
    assert one.counts == other.counts and one.open == other.open and calls[1] > one.counts["starts"] / 2 > calls[0]
    assert [(o.label, o.sequence, o.alpha, o.tau) for o in one.orbits] == [(o.label, o.sequence, o.alpha, o.tau) for o in other.orbits]


def test_a_call_follows_as_many_flights_as_it_may(slow, monkeypatch):
    """Oracle: the starts that each call follows: each has a flight at least. What is begun is ended: one start, its orbits, one grazing."""
    starts = []

    class Counted(IntervalScan):
        def go(self, passes):
            before = self.counts["starts"]
            done = super().go(passes)
            starts.append(self.counts["starts"] - before)
            return done

    monkeypatch.setattr(branches.search.intervals, "IntervalScan", Counted)
    slow(50)
    discover_orbits(vibro_impact_nes(), 20.0, quarter_period=10.0, impacts=60, budget=20_000)
    assert sum(starts) > 10_000 and max(starts) <= 50 + 300


def test_a_call_passes_as_many_events_as_it_may(slow, monkeypatch):
    """Oracle: the events that each call records: its passes at most, an impact and the contact that it makes are two."""
    events = []

    class Counted(saltus_core.Motion):
        def record(self):
            found = super().record()
            events.append(len(found["kinds"]))
            return found

    monkeypatch.setattr(saltus_core, "Motion", Counted)
    slow(5)
    motion = simulate(vibro_impact_nes(), [0.0, 0.0], [0.0, 1e6], 0.02)
    assert motion.impacts > 1000 and max(events) <= 2 * 5 and len(events) > motion.impacts / 10


def test_the_work_of_a_call_follows_the_time_that_it_takes(monkeypatch):
    """Oracle: a clock that is set by hand."""
    now = [0.0]
    monkeypatch.setattr(bvp.interrupts.time, "perf_counter", lambda: now[0])
    pace = Pace()
    first = pace.passes
    for took, factor in ((0.01, 2.0), (0.1, 1.0), (1.0, 0.25)):
        before = pace.passes
        with pace:
            now[0] += took
        assert pace.passes == factor * before
    for _ in range(20):
        with pace:
            now[0] += 10.0
    assert pace.passes == 1 and first > 1
