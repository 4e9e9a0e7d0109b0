"""The compiled advance of a family, and the compiled search for its events. Oracle: the engine's run step by step in Python: the same
points to rounding, the same events, the same ends."""

import numpy as np
import pytest

from branches.family import Family
from branches.switching import embed
from branches.tracing import SETTINGS
from bvp.multipoint import MultipointProblem
from continuation import Settings
from continuation.control import NEAR_GOAL, control_of, distance, height
from continuation.problem import Goal, Recent
from continuation.run import follow_both_ways
from tests.branches.traced import traced
from tests.bvp.orbits import chains


class OneByOne(Family):
    """A family that does not advance: the engine takes each step, and looks for events by itself."""

    advance = None
    scan = None


def problem_and_start(name, windows=None):
    branch = traced(name)
    i = len(branch) // 2
    if windows is None:
        return branch.problem, branch.unknowns(i)
    presentation = embed(branch.problem, branch.orbit(i).solution.y, windows)
    problem = MultipointProblem(branch.system, presentation.ends, presentation.sequence)
    return problem, presentation.unknowns(problem)


KINDS = {
    "quarter to a stop": ("S13O00+", None),
    "quarter, three impacts": ("S73O33-", None),
    "quarter to a rest": ("S11E11+@h=3.0", None),
    "half": ("U8353-", None),
    "half, of a symmetric orbit": ("S13O00+", (0, 2)),
    "half between stops": ("S13O00+", (1, 3)),
    "periodic": ("S13O00+", 1),
}


def compare(problem, y, settings=SETTINGS, **options):
    energy = (0.05, 1e4)
    alone = follow_both_ways(OneByOne(problem, energy), y, settings, **options)
    family = Family(problem, energy)
    together = follow_both_ways(family, y, settings, **options)
    assert [event.code for event in alone.events] == [event.code for event in together.events]
    assert [end.reason for end in alone.ends] == [end.reason for end in together.ends]
    assert [end.tally for end in alone.ends] == [end.tally for end in together.ends]
    assert len(alone.points) == len(together.points) and alone.start == together.start
    for a, b in zip(alone.points, together.points, strict=True):
        assert abs(a.arclength - b.arclength) < 1e-11 and a.step_size == pytest.approx(b.step_size, rel=1e-9)
        assert np.max(np.abs(a.step.y - b.step.y)) < 1e-11 * (1.0 + np.max(np.abs(a.step.y)))
        assert a.step.iterations == b.step.iterations and (a.event is None) is (b.event is None)
        np.testing.assert_allclose(b.step.tests, a.step.tests, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(b.step.position, a.step.position, rtol=1e-11, atol=1e-12)
        assert np.array_equal(np.isnan(a.step.extra.result), np.isnan(b.step.extra.result))
    return alone


@pytest.mark.parametrize("kind", KINDS)
def test_a_block_is_the_run_step_by_step(kind):
    """Near events, folds and grazing ends, over every kind of segment."""
    run = compare(*problem_and_start(*KINDS[kind]), Settings(**{**vars(SETTINGS), "maximum_points": 250}))
    assert len(run.events) > 0


@pytest.mark.parametrize("points", [1, 2, 3, 65, 66, 67, 130])
def test_the_number_of_points_is_kept(points):
    run = compare(*problem_and_start("S11O00-"), Settings(**{**vars(SETTINGS), "maximum_points": points}))
    assert len(run.points) == points


@pytest.mark.parametrize("direction", [1, -1])
def test_a_condition_ends_a_block(direction):
    problem, y = problem_and_start("S11O00-")
    run = compare(problem, y, both=False, direction=direction, stop_when=lambda point: point.index > 40 and point.event is None)
    assert run.points[-1].index > 40


@pytest.mark.parametrize(("n", "grounded"), [(3, True), (4, False), (6, True)])
def test_a_block_of_any_number_of_degrees_of_freedom(n, grounded):
    """More than two, with and without a rigid-body mode; the fold as the only test function."""
    for orbit in [orbit for orbit in chains() if orbit.problem.half == n and (orbit.problem.pairs == n - 1) is grounded][:3]:
        settings = Settings(**{**vars(SETTINGS), "maximum_points": 120})
        run = compare(orbit.problem, orbit.solution.y, settings)
        assert len(run.events) > 0
        ends = follow_both_ways(Family(orbit.problem, ends_only=True), orbit.solution.y, settings)
        assert {event.code for event in ends.events} <= {"SN", "BP", "GR", "EP"}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_block_comes_back_where_it_passes_its_goal(side):
    """Oracle: each point's distance from the goal, and the side of the plane there that it is on, measured from outside; a goal that is
    passed the other way is none."""
    problem, y = problem_and_start("S11O00-")
    family = Family(problem)
    points = follow_both_ways(OneByOne(problem), y, Settings(**{**vars(SETTINGS), "maximum_points": 30}), both=False).points
    oldest, older, start, goal = points[1], points[2], points[3], points[20]
    first, before = older.arclength - oldest.arclength, start.arclength - older.arclength
    aim, direction = np.array(goal.step.position), side * (np.array(goal.step.position) - np.array(points[19].step.position))
    tests = start.step.tests, older.step.tests, oldest.step.tests
    recent = Recent(start.step, *tests, before, first)
    found = family.advance(recent, points[4].step_size, Goal(goal.step, direction), 25, control_of(SETTINGS))
    path = [start.step.position, *(step.position for step in found.steps)]
    if side < 0.0:
        assert len(found.steps) == 25 and found.trial is None
        return
    assert len(path) > 10 and all(height(place, aim, direction) < 0.0 for place in path)
    assert found.trial is not None and height(found.trial.position, aim, direction) >= 0.0
    assert distance(found.trial.position, aim) <= NEAR_GOAL * distance(path[-1], found.trial.position)


def test_a_short_piece_keeps_no_whole_block():
    """Oracle: the bytes of the array that a point's unknowns are a view of."""
    problem, y = problem_and_start("S11O00-")
    run = follow_both_ways(Family(problem), y, Settings(**{**vars(SETTINGS), "maximum_points": 200}))
    kept = {}
    for point in run.points:
        owner = point.step.y
        while owner.base is not None:
            owner = owner.base
        kept[id(owner)] = owner
    assert sum(owner.nbytes for owner in kept.values()) < 3 * len(run.points) * problem.unknowns * 8


def test_the_test_functions_of_an_orbit_are_its_own():
    """Whatever orbit was observed before. Oracle: the entries of its half map times the speeds of its impacts."""
    branch = traced("S13O00+")
    steps = Family(branch.problem)._steps
    orbits = [branch.problem.step(branch.unknowns(place), np.zeros(2 * branch.problem.unknowns), 0.0) for place in (3, 30)]
    for orbit in (*orbits, *orbits):
        assert steps.values(orbit)[11:14] == [orbit["speeds"] * orbit[entry] for entry in ("b", "a", "d")]
