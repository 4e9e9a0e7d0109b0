"""Bounces at several contacts that act on each other, to the instant where all of them end. Oracles: each alone where they do not act on
each other; event by event in fifty digits; momentum, where inelastic bodies collapse; the balance of energies; the bounds of the gaps."""

import math

import mpmath
import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic
from bvp.motion import EventKind, MotionStatus
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop
from tests.bvp.twins import chain

REST = mpmath.mpf(10) ** -25


def shared(inverse, rows, target, v):
    """Velocities v after impulses at the contacts of `rows` that give these the rates `target`, and the impulses; inverse: of the mass."""
    if not rows:
        return v, []
    k = len(rows)
    compliance = mpmath.matrix(k, k)
    for i, a in enumerate(rows):
        for j, b in enumerate(rows):
            compliance[i, j] = inverse[a, b]
    impulses = mpmath.lu_solve(compliance, mpmath.matrix([target[i] - v[a] for i, a in enumerate(rows)]))
    out = v.copy()
    for j, b in enumerate(rows):
        out += inverse[:, b] * impulses[j]
    return out, list(impulses)


def pressed(inverse, candidates, free):
    """The candidates that press where the accelerations without contact are `free`, and the accelerations then."""
    for held in sorted((tuple(c for i, c in enumerate(candidates) if bits >> i & 1) for bits in range(1 << len(candidates))), key=len):
        after, forces = shared(inverse, held, [mpmath.mpf(0)] * len(held), free)
        if all(force >= 0 for force in forces) and all(after[c] >= 0 for c in candidates if c not in held):
            return held, after
    raise AssertionError("no set")


def bounce_by_bounce(mass, force, restitution, u, v, end):
    """u_0 >= 0 and u_1 >= 0 of M u'' = f, event by event in fifty digits down to speeds of 1e-25: (u, v) at `end`, impacts, time of the
    last one, contacts held."""
    with mpmath.workdps(50):
        inverse, u, v = mpmath.matrix(mass.tolist()) ** -1, mpmath.matrix(list(u)), mpmath.matrix(list(v))
        free = inverse * mpmath.matrix(list(force))
        held: tuple[int, ...] = ()
        time, impacts, last = mpmath.mpf(0), 0, None
        while True:
            held, a = pressed(inverse, held, free)
            waits = {}
            for c in {0, 1} - set(held):
                root = v[c] ** 2 - 2 * a[c] * u[c]
                if a[c] < 0:
                    waits[c] = (-v[c] - mpmath.sqrt(root)) / a[c]
                elif v[c] < 0 and root >= 0:
                    waits[c] = 2 * u[c] / (-v[c] + mpmath.sqrt(root))
            c = min(waits, key=waits.get, default=None)
            wait = min(end - time, waits[c]) if c is not None else end - time
            u, v, time = u + v * wait + a * wait**2 / 2, v + a * wait, time + wait
            if time >= end:
                return np.array(u.tolist(), float)[:, 0], np.array(v.tolist(), float)[:, 0], impacts, float(last), held
            u[c] = mpmath.mpf(0)
            impacts, last = impacts + 1, time
            stay = held
            while True:
                after, impulses = shared(inverse, (*stay, c), [*[mpmath.mpf(0)] * len(stay), -restitution[c] * v[c]], v)
                pulled = [k for k, impulse in zip(stay, impulses, strict=False) if impulse < 0]
                if not pulled:
                    break
                stay = tuple(k for k in stay if k not in pulled)
            v, held = after, stay
            if v[c] < REST:
                near = [k for k in (0, 1) if k not in (*held, c) and u[k] < REST and abs(v[k]) < REST]
                held = (*held, c, *near)
                v, _ = shared(inverse, held, [mpmath.mpf(0)] * len(held), v)


def coupled(seed, share):
    """Three coordinates that share inertia, by `share` of it, two of them pressed on stops: mass, force, restitutions, start."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(3, 3))
    root /= np.linalg.norm(root, axis=1)[:, None]
    mass = np.eye(3) + share * (root @ root.T - np.eye(3))
    force = mass @ [-random.uniform(0.5, 2.0), -random.uniform(0.5, 2.0), random.uniform(-0.5, 0.5)]
    return mass, force, random.uniform(0.1, 0.7, 2), [*random.uniform(0.1, 0.5, 2), 0.0], [0.0, 0.0, random.uniform(-1.0, 1.0)]


def run_coupled(mass, force, restitution, u, v, end):
    stops = [Stop(tuple(np.eye(3)[k]), lower=0.0, restitution=float(restitution[k])) for k in range(2)]
    return simulate(ImpactSystem(mass, np.zeros((3, 3)), np.zeros((3, 3)), tuple(stops)), u, v, end, forces=Constant(list(force)))


@pytest.mark.parametrize("share", [0.02, 0.5, 0.9])
@pytest.mark.parametrize("seed", range(2))
def test_two_contacts_come_to_rest_as_event_by_event_in_fifty_digits(seed, share):
    """Final state within 1e-11, though what is left below the contact tolerance is taken at once; the balance closes."""
    check_two_contacts(coupled(seed, share))


def check_two_contacts(case):
    motion = run_coupled(*case, 20.0)
    u, v, impacts, last, held = bounce_by_bounce(*case, 20.0)
    assert motion.status is MotionStatus.DURATION_REACHED and motion.impacts <= impacts
    assert motion.contact_intervals[-1].sticking == tuple("ab"[c] + "-" for c in sorted(held))
    assert len(held) < 2 or motion.contact_intervals[-1].begin == pytest.approx(last, abs=motion.switch_error + 1e-12)
    np.testing.assert_allclose(motion.final, [*u, *v], atol=1e-11)
    assert abs(motion.balance) < 1e-13 * (motion.initial_energy + abs(motion.work) + motion.totals[:-1].sum())


def test_contacts_that_do_not_act_on_each_other_rest_as_each_alone():
    """Two balls as one system, bounces interleaved: 2 v r/(g (1 - r)) after the first impact each."""
    heights, gravity, restitution = [0.5, 0.4], [1.0, 1.7], [0.6, 0.7]
    stops = (Stop((1.0, 0.0), lower=0.0, restitution=0.6), Stop((0.0, 1.0), lower=0.0, restitution=0.7))
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), stops)
    motion = simulate(system, heights, [0.0, 0.0], 20.0, forces=Constant([-g for g in gravity]))
    rests = []
    for h, g, r in zip(heights, gravity, restitution, strict=True):
        speed = math.sqrt(2.0 * g * h)
        rests.append(speed / g * (1.0 + 2.0 * r / (1.0 - r)))
    sticks = np.flatnonzero(motion.kinds == EventKind.STICK.value)
    assert [motion.contact_intervals[-1].sticking, motion.contact_intervals[-2].sticking] == [("a-", "b-"), ("b-",)]
    np.testing.assert_allclose(motion.times[sticks], sorted(rests), atol=1e-10)


def test_bodies_that_collapse_go_on_with_their_momentum():
    """Three equal free bodies in a row, restitution 1/20 < 7 - 4 sqrt(3): infinitely many impacts of the middle one in a finite time, after
    which all have the velocity of their centre and keep touching."""
    stops = tuple(Stop(row, lower=0.0, restitution=0.05) for row in ((-1.0, 1.0, 0.0), (0.0, -1.0, 1.0)))
    system = ImpactSystem(np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)), stops)
    motion = simulate(system, [-1.0, 0.0, 1.1], [1.0, 0.05, -0.8], 5.0)
    assert motion.status is MotionStatus.DURATION_REACHED
    mean = 0.25 / 3.0
    np.testing.assert_allclose(motion.final[3:], mean, atol=1e-14)
    np.testing.assert_allclose(np.diff(motion.final[:3]), 0.0, atol=1e-13)
    assert motion.final[:3].sum() == pytest.approx(0.1 + 0.25 * 5.0, rel=1e-14)
    lost = 0.5 * (1.0 + 0.0025 + 0.64 - 3.0 * mean**2)
    assert motion.dissipated["stop a"] + motion.dissipated["stop b"] == pytest.approx(lost, rel=1e-14)


def random_chain(seed):
    """A loaded chain of two to four masses with two or more stops between its masses and to the ground, and velocities to start with."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    rows = [np.eye(n)[k] - np.eye(n)[k - 1] for k in range(1, n)] + [np.eye(n)[k] for k in range(n)]
    stops = []
    for k in random.permutation(len(rows))[: int(random.integers(2, len(rows) + 1))]:
        lower = -math.inf if random.random() < 0.5 else -random.uniform(0.02, 0.5)
        stops.append(Stop(tuple(rows[k]), lower, random.uniform(0.02, 0.5), restitution=random.uniform(0.0, 0.9)))
    damping = float(random.choice([0.0, 0.05]))
    system = chain(random.uniform(0.2, 2.0, n), random.uniform(0.2, 2.0, n - 1), ground=1.0, damping=damping, stops=tuple(stops))
    forces = [Constant(random.normal(size=n))]
    if random.random() < 0.5:
        forces.append(Harmonic(random.uniform(0.3, 2.0), cosine=random.normal(size=n)))
    return system, forces, 2.0 * random.normal(size=n)


def test_chains_with_many_stops_run_to_the_end():
    """Every motion reaches its duration, no stop is pierced, and the balance closes to 1e-12 of what the motion turns over."""
    check_chains(range(30))


def check_chains(seeds):
    for seed in seeds:
        system, forces, v = random_chain(seed)
        motion = simulate(system, np.zeros(len(v)), v, 60.0, forces=forces)
        assert motion.status is MotionStatus.DURATION_REACHED, seed
        assert abs(motion.balance) <= 1e-12 * (motion.initial_energy + abs(motion.work) + motion.totals[:-1].sum())
        assert np.all(motion.losses >= 0.0)
        u, _ = motion.sample(np.linspace(0.0, 60.0, 2000))
        for stop in system.stops:
            w = u @ np.array(stop.gap)
            assert stop.lower - 1e-12 <= w.min() and w.max() <= stop.upper + 1e-12
