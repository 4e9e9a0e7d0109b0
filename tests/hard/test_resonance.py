"""Hard cases of the modes: resonant periods, nearly equal and zero frequencies, extreme masses and stiffnesses, critical damping."""

import math

import mpmath as mp
import numpy as np
import pytest

from benchmarks import backbone
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import backbone_segment
from tests.hard.cases import hard, largest
from tests.hard.digits import Closed, relative
from tests.lab.paths import ImpactStatus, next_impact

CLOSED_FORM = "closed form in 50 digits, modes and all"
WHAT = "velocities at the origin, energy, trace of the multipliers, relative"


def orbit_error(system, alpha, shake=1e-6):
    """Largest relative error of an orbit solved from a shaken start, at its quarter period: velocities, energy, and sum of multipliers."""
    exact = Closed(system, alpha)
    problem, y = backbone_segment(system, float(alpha))
    solution = problem.solve(y * (1.0 + shake * np.cos(np.arange(len(y)))), quarter_period=float(alpha))
    assert solution["clearance"] > 0.0 and solution["speed"] > 0.0
    n = system.degrees_of_freedom
    velocities = (system.modes.to_state @ problem.start(solution.y))[n:]
    multipliers = saddle_point_multipliers(cycle_of(problem, solution.y))
    assert multipliers.reliable
    values = sorted(exact.multipliers(), key=lambda value: abs(value - 1.0))
    values = values[len(values) - len(multipliers.values) :]  # without the pair of a translation that nothing resists
    return largest(
        relative(velocities, exact.origin),
        float(abs(mp.mpf(solution["energy"]) / exact.energy - 1)),
        abs(multipliers.trace - np.sum(values)) / np.max(np.abs(values)),
    )


def resonant(system, mode, n):
    """Quarter period of T = 2 pi n/w of a mode, from a double."""
    return float(math.pi * n / 2.0 / system.modes.frequencies[mode])


@hard(
    "T = 4 pi/w of a linear mode, exactly and beside it by 1e-6, 1e-9, 1e-12 (sin(w T/2) = 0, where Green's functions are singular)",
    source=CLOSED_FORM,
    limit=1e-12,
    what=WHAT,
)
def test_period_at_a_multiple_of_a_linear_one():
    """The mode takes part in the impact; systems are those of a grid where the orbit is physical at its resonance."""
    worst, count = 0.0, 0
    for mu in (0.05, 0.3, 1.0, 3.0):
        for sigma in (0.05, 0.5, 2.0, 8.0):
            system = vibro_impact_nes(mu, sigma)
            for mode in (0, 1):
                alpha = resonant(system, mode, 2)
                if backbone.half_period_sum(system, alpha) < 0.02 or not backbone.is_physical(system, alpha, 1000):
                    continue
                count += 1
                for beside in (0.0, 1e-12, -1e-12, 1e-9, 1e-6, -1e-6):
                    worst = largest(worst, orbit_error(system, alpha * (1.0 + beside)))
    assert count >= 4
    return worst


def symmetric(coupling=0.8, mass=0.5, ground=0.3):
    """A mass with a stop, and two equal ones that hang on it: their motion against each other has no part in the impact."""
    k = coupling
    stiffness = [[1.0 + 2.0 * k, -k, -k], [-k, k + ground, 0.0], [-k, 0.0, k + ground]]
    return ImpactSystem(np.diag([1.0, mass, mass]), np.zeros((3, 3)), stiffness, (Stop((1.0, 0.0, 0.0), -1.0, 1.0),))


@hard(
    "T = 2 pi/w of a mode that has no part in the impact (two equal masses on a third): beside it by 1e-3 ... 1e-9",
    source=CLOSED_FORM,
    limit=1e-15,
    what=WHAT + ", times the distance",
)
def test_beside_the_resonance_of_a_mode_without_impact():
    """On it the equations are singular, for any amount of that mode may be added: beside it this amount is known to rounding over the
    distance. The branch point is reported by the family, see Branching."""
    worst = 0.0
    for distance in (1e-3, 1e-6, 1e-9):
        for side in (-1.0, 1.0):
            alpha = math.pi / 2.0 / math.sqrt((0.8 + 0.3) / 0.5) * (1.0 + side * distance)
            assert backbone.is_physical(symmetric(), alpha)
            worst = largest(worst, distance * orbit_error(symmetric(), alpha))
    return worst


@pytest.mark.parametrize("distance", [1e-6, 1e-10, 1e-14])
@hard("two modes whose frequencies differ by 1e-6, 1e-10, 1e-14", source=CLOSED_FORM, limit=1e-12, what=WHAT)
def test_nearly_equal_modes(distance):
    """Turned by an angle, so that neither mode is a coordinate."""
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    stiffness = turn @ np.diag([1.0, (1.0 + distance) ** 2]) @ turn.T
    stiffness[0, 1] = stiffness[1, 0]
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), stiffness, (Stop((1.0, 0.4), -1.0, 1.0),))
    return largest(*(orbit_error(system, alpha) for alpha in (0.3, 0.9, 1.4)))


@hard("zero modes: an absorber that flies free, chains of 2 to 5 masses that nothing holds", source=CLOSED_FORM, limit=1e-12, what=WHAT)
def test_zero_modes():
    from tests.bvp.orbits import chain

    rng = np.random.default_rng(5)
    worst, count = largest(*(orbit_error(vibro_impact_nes(0.1, 0.0), alpha) for alpha in (0.01, 0.3, 1.2))), 0
    while count < 12:
        system = chain(rng, int(rng.integers(2, 6)))
        alpha = rng.uniform(0.05, 1.5)
        if backbone.half_period_sum(system, alpha) > 0.05 and backbone.is_physical(system, alpha, 1000):
            worst = largest(worst, orbit_error(system, alpha))
            count += 1
    return worst


@pytest.mark.parametrize("mu", [1e-8, 1e8])
@hard("mass ratios 1e-8 and 1e8, couplings 0.1, 1e-12 and 0", source=CLOSED_FORM, limit=1e-11, what=WHAT)
def test_extreme_mass_ratios(mu):
    """At quarter periods where the orbit is physical: with a light absorber on a spring below a quarter of its own short period."""
    worst, count = 0.0, 0
    for sigma in (0.1, 1e-12, 0.0):
        system = vibro_impact_nes(mu, sigma)
        for alpha in (1.2, 0.3, 3e-4):
            if backbone.half_period_sum(system, alpha) > 0.0 and backbone.is_physical(system, alpha):
                worst = largest(worst, orbit_error(system, alpha))
                count += 1
    assert count >= 6
    return worst


@hard("stiffness 1e-12: of the coupling, of the ground, and of both", source=CLOSED_FORM, limit=1e-12, what=WHAT)
def test_tiny_stiffness():
    stop = (Stop((1.0, -1.0), -1.0, 1.0),)
    systems = [
        vibro_impact_nes(0.1, 1e-12),
        ImpactSystem(np.diag([0.1, 1.0]), np.zeros((2, 2)), [[0.1, -0.1], [-0.1, 0.1 + 1e-12]], stop),
        ImpactSystem(np.diag([0.1, 1.0]), np.zeros((2, 2)), [[1e-12, -1e-12], [-1e-12, 2e-12]], stop),
    ]
    return largest(*(orbit_error(system, alpha) for system in systems for alpha in (0.01, 0.4, 1.2)))


@pytest.mark.parametrize("offset", [0.0, 1e-15, 1e-8, 1e-4, -1e-15, -1e-8, -1e-4])
@hard(
    "critical damping: on it, and above and below by 1e-15, 1e-8, 1e-4",
    source="50-digit solution of the same equations, impact by impact",
    limit=1e-13,
    what="times of ten impacts, relative",
)
def test_critical_damping(offset):
    """A mass on a spring, critically damped, thrown at a stop again and again: the velocity after each impact is chosen anew, away from it,
    so that the motion turns round and comes back through the middle to the stop on the other side of rest."""
    c = 2.0 * (1.0 + offset)
    system = ImpactSystem([[1.0]], [[c]], [[1.0]], (Stop((1.0,), upper=0.02),))
    worst = 0.0
    for k in range(10):
        start, speed = -0.5 + 0.03 * k, 2.0 + 0.5 * k
        found = next_impact(system, [start], [speed], 50.0)
        assert found.status is ImpactStatus.HIT
        with mp.workdps(50):
            half = mp.mpf(c) / 2
            delta = half * half - 1
            root = mp.sqrt(abs(delta))

            def gap(t, half=half, delta=delta, root=root, start=start, speed=speed):
                even = mp.cosh(root * t) if delta > 0 else mp.cos(root * t)
                odd = t if not delta else (mp.sinh(root * t) if delta > 0 else mp.sin(root * t)) / root
                return mp.exp(-half * t) * (start * even + (speed + half * start) * odd) - mp.mpf(0.02)

            around = [mp.mpf(found.time) * (1 + sign * mp.mpf(10) ** -6) for sign in (-1, 1)]
            exact = mp.findroot(gap, around, solver="anderson")
            worst = largest(worst, float(abs(found.time / exact - 1)))
    return worst
