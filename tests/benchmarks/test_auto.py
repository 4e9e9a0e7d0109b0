"""AUTO-07p as a peer: what it is asked, how its answers are read, and, where the program is there, that the answers are right."""

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.backbone import Backbone
from benchmarks.forced import chain, one_impact, repeated
from benchmarks.peers import auto
from benchmarks.peers.auto import Auto, missing
from benchmarks.peers.auto_files import AutoError, AutoRun, AutoSettings, constants_text, read_run, start_text
from bvp.forced import ForcedProblem
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import backbone_segment, collection

STORED = Path(__file__).parent / "auto_output"
"""What a run of AUTO-07p on S11O00- from alpha = 1.2 down, with two intervals of five points, said and wrote."""

needs_auto = pytest.mark.skipif(missing() is not None, reason=f"AUTO-07p cannot be used: {missing()}")


def stored():
    """Standard output, table, points."""
    return [(STORED / name).read_text(encoding="utf-8") for name in ("standard_output.txt", "b.flights", "flights.points")]


def fold():
    """Quarter period and energy of the fold of S11O00-: where differences of the closed form over 1e-12 are zero, in forty digits."""
    exact = Backbone()
    with mp.workdps(40):
        step = mp.mpf(10) ** -12

        def slope(alpha):
            return (exact.energy(alpha + step) - exact.energy(alpha - step)) / step

        alpha = mp.findroot(slope, (mp.mpf("1.1"), mp.mpf("1.2")), solver="anderson", tol=mp.mpf(10) ** -30)
        return float(alpha), float(exact.energy(alpha))


def closed_form_error(system, point):
    """Of energy and velocities, relative, at the point's own quarter period, for an orbit of one flight."""
    alpha = float(point.flight_times[0])
    exact = backbone.origin_velocity(system, alpha)
    off = np.max(np.abs(point.velocities - exact)) / np.max(np.abs(exact))
    return max(abs(point.h / backbone.energy(system, alpha) - 1.0), off)


def test_a_stored_run_is_read():
    """Oracle: closed form at each point's own quarter period, to what two intervals give; the fold in forty digits; the time that it
    said."""
    run = read_run(*stored(), 1)
    assert run.count == len(run.points) == 12 and run.seconds == 3.24
    assert [point.type for point in run.points] == ["EP", "", "LP", *[""] * 8, "EP"]
    assert all(closed_form_error(vibro_impact_nes(), point) < 1e-7 for point in run.points)
    alpha, h = fold()
    (found,) = run.folds
    assert math.isclose(found.h, h, rel_tol=1e-11) and math.isclose(found.flight_times[0], alpha, rel_tol=1e-9)
    assert read_run(*stored()[:2], "", 1).points == []


@pytest.mark.parametrize(
    ("part", "change", "words"),
    [
        (0, lambda said: said.replace("Total Time", "Total"), "printed no time: .*done"),
        (1, lambda table: table.replace("12   9    3", "12  -9    3"), "did not converge after 11 points"),
        (1, lambda table: table[: table.index("   1     1   9")], "did not converge after 0 points"),
        (1, lambda table: table.replace("PAR(21)", "PAR(2)"), "lacks the energy"),
        (2, lambda points: points.replace("8.8726748", "8.8726749"), "h = 0.08872674874 of AUTO's table"),
    ],
)
def test_a_run_that_failed_is_reported(part, change, words):
    """Oracle: the stored run, with what failed in it."""
    parts = stored()
    parts[part] = change(parts[part])
    with pytest.raises(AutoError, match=words):
        read_run(*parts, 1)


def test_unknowns_and_conditions_are_as_many():
    """Oracle: AUTO's count for boundary-value problems: free parameters = conditions - dimension + 1; one side, one
    state and one time a flight."""
    system = vibro_impact_nes()
    for inner in (0, 1, 8):
        problem, y = backbone_segment(system, 1.65, inner)
        said = dict(word.split("=") for word in constants_text(problem, AutoSettings()).replace("\n", ", ").split(", ") if "=" in word)
        free = constants_text(problem, AutoSettings()).split("[")[1].split("]")[0].split(",")
        assert len(free) == int(said["NBC"]) - int(said["NDIM"]) + 1 == problem.inner + 2
        first, times, sides, states = [[float(x) for x in line.split()] for line in start_text(problem, y, True).splitlines()]
        assert np.allclose(first, [backbone.energy(system, 1.65), 0.1, 0.1, 0.0 if inner == 0 else 1.0, 1.0], rtol=1e-12)
        assert len(times) == len(sides) == problem.inner + 1 == int(said["NDIM"]) // 4 and len(states) == int(said["NDIM"])
        assert np.allclose(states[2:4], backbone.origin_velocity(system, 1.65))


def test_other_problems_are_refused():
    """Oracle: what the equations are written for."""
    found = next(x for x in collection() if x.problem.ends[0] == "rest")
    with pytest.raises(ValueError, match="begin at an origin; received the ends rest"):
        start_text(found.problem, found.solution.y, True)
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), (Stop((1.0, -1.0), -1.0, 1.0),))
    with pytest.raises(ValueError, match="received another system"):
        start_text(MultipointProblem(system, ("origin", "stop+"), ()), np.ones(3), True)


def test_what_is_missing_is_named(monkeypatch, tmp_path):
    """Oracle: an empty path; a path with the program and no compiler."""
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "auto or auto-07p" in missing() and "Debian package auto-07p" in missing()
    with pytest.raises(AutoError, match="auto-07p"):
        Auto()
    program = tmp_path / "auto-07p"
    program.write_text("#!/bin/sh\n", encoding="ascii")
    program.chmod(0o755)
    assert "gfortran" in missing()


def test_a_program_that_does_nothing_is_reported(monkeypatch, tmp_path):
    """Oracle: a program of that name which says something and writes no table; one that hangs."""
    for name, text in (("gfortran", ":"), ("auto", "echo no equations; exit 3")):
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n", encoding="ascii")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    problem, y = backbone_segment(vibro_impact_nes(), 1.65)
    with Auto() as there:
        folder = there._folder
        with pytest.raises(AutoError, match="AUTO failed: no equations"):
            there.follow(problem, y, AutoSettings())
        monkeypatch.setattr(auto, "SECONDS", 0.2)
        (tmp_path / "auto").write_text("#!/bin/sh\nexec sleep 5\n", encoding="ascii")
        with pytest.raises(AutoError, match="not done in 0.2 s"):
            there.follow(problem, y, AutoSettings())
    assert not folder.exists()


@needs_auto
def test_the_backbones():
    """Oracle: closed form at each point's own quarter period; the fold in forty digits; more intervals take the error off."""
    system = vibro_impact_nes()
    with Auto() as there:
        problem, y = backbone_segment(system, 1.65)
        errors = []
        for intervals in (2, 4):
            run = there.follow(problem, y, AutoSettings(intervals, 5, points=10))
            assert run.count == 10 and run.points[-1].h > run.points[0].h
            errors.append(max(closed_form_error(system, point) for point in run.points))
        assert errors[1] < 0.01 * errors[0] and errors[1] < 1e-10
        problem, y = backbone_segment(system, 1.2)
        run = there.follow(problem, y, AutoSettings(step=-0.05, points=8, folds=True))
        alpha, h = fold()
        assert len(run.folds) == 1
        assert math.isclose(run.folds[0].h, h, rel_tol=1e-13) and math.isclose(run.folds[0].quarter_period(problem), alpha, rel_tol=1e-9)


def orbits():
    """Orbits from the origin to each kind of end: those of the collection, and S11E11+ at h = 3."""
    for orbit in collection():
        if orbit.problem.ends[0] == "origin":
            yield orbit.problem, orbit.solution.y
    system = vibro_impact_nes()
    problem = MultipointProblem(system, ("origin", "rest"), ("+",))
    guess = problem.pack(system.modes.from_state @ [0.0, 0.0, 3.450377, 2.193055], None, [0.75398, 0.913467])
    yield problem, problem.solve(guess, energy=3.0).y


@needs_auto
@pytest.mark.parametrize("times", [1])
def test_forced_orbits(times):
    """Oracle: see `require_forced_orbits`."""
    require_forced_orbits(times)


def require_forced_orbits(times):
    """Oracle: saltus's own solution at each point's frequency, from the unknowns that AUTO found: they hardly change."""
    problem, y = repeated(*one_impact(chain(1)), times)
    with Auto() as there:
        run = there.follow(problem, y, AutoSettings(intervals=6, step=0.01, points=4))
    assert run.count == 4 and abs(run.points[-1].h - run.points[0].h) > 1e-3
    for point in run.points:
        found = point.unknowns(problem)
        exact = problem.solve(found).y
        assert np.max(np.abs(found - exact)) < 1e-12 * np.max(np.abs(exact))


@pytest.mark.parametrize(("sequence", "released"), [(("+",), "F"), ((), "w")])
def test_other_forced_problems_are_refused(sequence, released):
    """Oracle: a parameter that is not w; no impact."""
    problem = ForcedProblem(chain(1), sequence, [released])
    with pytest.raises(ValueError, match="orbits with impacts over a full period, of one harmonic load, in w"):
        start_text(problem, np.ones(problem.unknowns), True)


def test_the_time_of_a_point_is_the_difference_of_least_times(monkeypatch):
    """Oracle: by hand, for runs that take 3 s and 1/4 s a point, by the processor 2 s and 1/8 s, each run a second longer than the last, so
    that the median of three is a second above the least. A family that ends before the longer run is reported."""
    runs = []

    def follow(self, problem, y, settings, *, keep):
        late, count = runs.count(settings.points), min(settings.points, 50)
        runs.append(settings.points)
        return AutoRun(3.0 + late + 0.25 * count, count, [], 2.0 + late + 0.125 * count)

    monkeypatch.setattr(Auto, "follow", follow)
    there = Auto.__new__(Auto)
    assert there.time_a_point(None, None, AutoSettings(), short=20, long=40, repeats=3) == ((0.25, 0.1), (0.125, 0.1))
    assert runs == [2, 20, 20, 20, 40, 40, 40]
    with pytest.raises(AutoError, match="ended after 50 points: expected a shorter run"):
        there.time_a_point(None, None, AutoSettings(), short=60, long=80, repeats=2)
