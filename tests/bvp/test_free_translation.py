"""Systems that can move as a whole, and the ends that do not hold their place.

Oracles: the definition (no spring, no stop resists); the rank of the Jacobian by numpy's singular values; the closed form of one impact a
half period and the half map, both in 50 digits.
"""

from functools import partial

import mpmath as mp
import numpy as np
import pytest

from benchmarks.saltation import saltation_multipliers
from branches.tracing import follow_family
from bvp.checks import EPSILON
from bvp.closures import EndsError, free_motions, free_translation, held_motions
from bvp.many_digits import orbit_in_digits
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import MultipointProblem
from bvp.stability import stability
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import backbone_segment
from tests.bvp.twins import chain
from tests.hard.digits import Closed

MASSES, SPRINGS = [1.0, 2.0, 1.5], [3.0, 1.0]
ENDS = [("rest", "rest"), ("rest", "stop+"), ("stop-", "rest"), ("stop+", "stop-"), ("periodic", "periodic")]


def test_a_free_translation_is_resisted_by_nothing():
    """Oracle: K d = 0 and c . d = 0, on springs and gap rows that are scaled at random."""
    random = np.random.default_rng(4)
    for n in (2, 3, 5):
        scale = np.exp(random.normal(size=n))
        free = chain(np.exp(random.normal(size=n)), np.exp(random.normal(size=n - 1)))
        stiffness = free.stiffness / np.outer(scale, scale)
        row = np.array(free.stops[0].gap) / scale
        system = ImpactSystem(free.mass, np.zeros((n, n)), stiffness, (Stop(tuple(row), -1.0, 1.0),))
        direction = free_translation(system)
        assert np.allclose(direction, scale / scale.max())
        assert np.max(np.abs(stiffness @ direction)) < 1e-12 * np.max(np.abs(stiffness)) and abs(row @ direction) < 1e-9


def test_of_equal_entries_of_a_free_translation_the_first_is_1():
    """Oracle: a spring that resists u1 + u2 lets (1, -1) pass. Rounding makes either entry the largest."""
    for mass in np.random.default_rng(3).uniform(0.1, 3.0, 40):
        system = ImpactSystem(np.diag([mass, 1.0]), np.zeros((2, 2)), 0.7 * np.ones((2, 2)), (Stop((1.0, 1.0), -1.0, 1.0),))
        np.testing.assert_allclose(free_translation(system), [1.0, -1.0], rtol=1e-12)


def test_what_is_held_has_none():
    """Oracle: a spring to the ground, a stop to the ground; the free flight of a mass in a cavity is felt by its stop."""
    assert free_translation(chain(MASSES, SPRINGS, ground=0.1)) is None
    assert free_translation(chain(MASSES, SPRINGS, stops=(Stop((1.0, 0.0, 0.0), -1.0, 1.0),))) is None
    assert free_translation(vibro_impact_nes(sigma=0.0)) is None


@pytest.mark.parametrize("ends", ENDS)
def test_ends_that_do_not_hold_the_place_are_refused(ends):
    """Oracle: the text names the motion and what holds it; a grounded chain has these ends."""
    sequence = ("+", "-")
    with pytest.raises(EndsError, match="u1 by 1, u2 by 1, u3 by 1; expected an origin end, or a spring to the ground") as caught:
        MultipointProblem(chain(MASSES, SPRINGS), ends, sequence).refuse_drift()
    assert "\n" not in str(caught.value)
    MultipointProblem(chain(MASSES, SPRINGS, ground=0.2), ends, sequence).refuse_drift()
    problem = MultipointProblem(chain(MASSES, SPRINGS), ends, sequence)
    for use in (problem.solve, partial(follow_family, problem)):
        with pytest.raises(EndsError, match="free to drift"):
            use(np.ones(problem.unknowns))


@pytest.mark.parametrize("ends", [*ENDS[:-1], ("origin", "rest"), ("origin", "origin"), ("origin", "stop+")])
def test_the_rank_is_missing_where_they_are_refused(ends):
    """Oracle: singular values of the dense Jacobian at random unknowns: the last one vanishes just where the ends are refused."""
    random = np.random.default_rng(1)
    problem = MultipointProblem(chain(MASSES, SPRINGS), ends, ("+", "-"))
    singular = np.linalg.svd(problem.jacobian(random.uniform(0.2, 1.5, problem.unknowns)), compute_uv=False)
    assert bool(singular[-1] < 1e-12 * singular[0]) is ("origin" not in ends)


def test_one_sided_systems_are_told_to_use_the_ground():
    """Oracle: an origin end is not offered where there is none."""
    with pytest.raises(EndsError, match="expected a spring to the ground$"):
        MultipointProblem(chain(MASSES, SPRINGS, stops=(Stop((1.0, -1.0, 0.0), upper=1.0),)), ("rest", "rest"), ("+",)).refuse_drift()


def test_two_masses_that_drift_are_stable():
    """Oracle: their motion against each other has one degree of freedom, and no multiplier but the trivial ones."""
    system = chain(MASSES[:2], SPRINGS[:1], stops=(Stop((1.0, -1.0), -1.0, 1.0),))
    problem, y = backbone_segment(system, 0.3)
    branch = follow_family(problem, y, energy=(0.05, 1e3))
    events = {event.point for event in branch.events}
    assert all(branch.points["stable"][i] == 1 for i in range(len(branch)) if i not in events)
    assert branch.orbit(len(branch) // 2).stable and stability(problem, branch.orbit(5).solution).stable
    assert np.max(np.abs(branch.points["multipliers"][5] - 1.0)) < 1e-6


TRAINS = {"one rigid body": [3.0, 1.0], "two, held together by backlash": [0.0, 1.0]}


@pytest.mark.parametrize("springs", TRAINS.values(), ids=TRAINS)
def test_motions_that_are_held(springs):
    """Oracle: an orthonormal frame with the free translation; a stop feels nothing but what is held."""
    system = chain(MASSES, springs, stops=(Stop((1.0, -1.0, 0.0), -1.0, 1.0),))
    free, held = free_motions(system), held_motions(system)
    rounding = 3 * 4 * EPSILON  # of a reflection and of the product: a few for each of three entries
    frame = np.vstack([free, held])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0, atol=rounding)
    direction = system.modes.shapes @ free[0]
    np.testing.assert_allclose(direction / direction[0], np.ones(3), rtol=1e-12)
    gap = system.modes.contacts.gap[:, :3]
    np.testing.assert_allclose(gap @ free.T, 0.0, rtol=0, atol=rounding * np.abs(gap).max())


@pytest.mark.parametrize("springs", TRAINS.values(), ids=TRAINS)
def test_a_gear_train_with_backlash_is_stable_or_not(springs):
    """Oracle: multipliers and stability from the closed form in 50 digits, and from the half map of the orbit in 50 digits."""
    system = chain(MASSES, springs, stops=(Stop((1.0, -1.0, 0.0), -1.0, 1.0),))
    problem, y = backbone_segment(system, 0.3)
    branch = follow_family(problem, y, energy=(0.05, 1e3))
    stable, events = branch.points["stable"], {event.point for event in branch.events}
    assert branch.points["multipliers"].shape == (len(branch), 2)
    assert all(stable[i] >= 0 for i in range(len(branch)) if i not in events)
    for i in range(5, len(branch), len(branch) // 8):
        if i in events:
            continue
        exact = Closed(system, branch.points["alpha"][i]).multipliers()
        rest = sorted(exact, key=lambda value: abs(value - 1.0))[2:]  # without the pair of the translation
        found = branch.points["multipliers"][i]
        assert abs(np.sum(found) - np.sum(rest)) < 1e-10 * max(np.abs(rest))
        assert bool(np.max(np.abs(rest)) < 1.0 + 1e-9) is bool(stable[i])
        digits = orbit_in_digits(problem, branch.unknowns(i))
        assert digits.stable is bool(stable[i])
        with mp.workdps(50):
            assert abs(mp.det(digits.half_map) - 1) < mp.mpf(10) ** -35 * max(abs(x) for x in digits.half_map) ** 2
    assert 1 in stable


def test_a_body_that_an_orbit_does_not_touch_hides_nothing():
    """Oracle: the same gear train without its last body, which rests inside its backlash; multipliers from the monodromy."""
    backlash, last = Stop((1.0, -1.0, 0.0, 0.0), -1.0, 1.0), Stop((0.0, 0.0, 1.0, -1.0), -1.0, 1.0)
    whole = chain([1.0, 2.0, 1.5, 0.2], [3.0, 1.0, 0.0], stops=(backlash, last))
    without = chain(MASSES, SPRINGS, stops=(Stop((1.0, -1.0, 0.0), -1.0, 1.0),))
    found = []
    for system, ends in ((whole, ("origin", "stopa+")), (without, ("origin", "stop+"))):
        problem = MultipointProblem(system, ends, ())
        y = backbone_segment(without, 0.3)[1]
        state = without.modes.to_state @ backbone_segment(without, 0.3)[0].start(y)
        padded = np.concatenate([np.pad(part, (0, system.degrees_of_freedom - 3)) for part in np.split(state, 2)])
        point = problem.solve(problem.pack(system.modes.from_state @ padded, [], [0.3]), quarter_period=0.3)
        found.append(follow_family(problem, point.y, energy=(0.3, 1e3)))
    branch, other = found
    ours, theirs = ([(event.type, event.h, event.stable) for event in one.events] for one in found)
    assert [(kind, stable) for kind, _, stable in ours] == [(kind, stable) for kind, _, stable in theirs] and len(ours) > 3
    np.testing.assert_allclose([h for _, h, _ in ours], [h for _, h, _ in theirs], rtol=1e-9)
    assert branch.points["multipliers"].shape[1] == other.points["multipliers"].shape[1] == 2
    middle = branch.orbit(len(branch) // 2)
    np.testing.assert_allclose(saddle_point_multipliers(middle.cycle).values, saltation_multipliers(middle.cycle), atol=1e-9)
    assert orbit_in_digits(middle.problem, middle.solution.y).stable is middle.stable is not None
    with pytest.raises(EndsError, match="no spring or stop that is hit resists a motion of u4 by 1"):
        MultipointProblem(whole, ("rest", "stopa+"), ()).refuse_drift()
