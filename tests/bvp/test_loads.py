"""Flights under periodic loads against forty digits.

Oracle: the exponential of the system enlarged by its loads' states, in mpmath, and its derivatives by differences in those digits.
"""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from bvp.system import ImpactSystem, Stop
from tests.lab.flights import LoadedFlight

DIGITS = 60


def exact(system, flight, z, t, changes, exponentials):
    """The end of a flight in many digits, for a start, a time and parameters that are changed by `changes`: (N + 1,). exponentials: those
    that are known, by the time and the changes of parameters."""
    n, loads = system.degrees_of_freedom, flight.loads
    size, m = 2 * n, len(loads.clock) - 1
    start = [mp.mpf(float(value)) + change for value, change in zip(z, changes, strict=False)]
    t = mp.mpf(t) + changes[len(z)]
    moved = [changes[size + 1 + j] for j in range(m)]
    w = mp.mpf(loads.clock[0]) + mp.fsum(mp.mpf(loads.clock[1 + j]) * moved[j] for j in range(m))
    load_periods = 2 * mp.pi * mp.mpf(loads.load_periods)
    count = len(loads.harmonics)
    inverse = mp.matrix(system.mass.tolist()) ** -1
    leave = flight.to_state[n:]
    whole = mp.zeros(size + 2 * count)
    pulled = -inverse * mp.matrix(system.stiffness.tolist())
    damped = -inverse * mp.matrix(system.damping.tolist())
    for r in range(n):
        whole[r, n + r] = 1
        for c in range(n):
            whole[n + r, c], whole[n + r, n + c] = pulled[r, c], damped[r, c]
    x = mp.matrix(start[:size] + [0] * (2 * count))
    for h in range(count):
        k, at = mp.mpf(loads.harmonics[h]), size + 2 * h
        force = []
        for part in range(2):
            rates = (leave @ loads.modal[:, h, part].T).tolist()
            force.append(mp.matrix([mp.mpf(row[0]) + mp.fsum(mp.mpf(row[1 + j]) * moved[j] for j in range(m)) for row in rates]))
        for r in range(n):
            whole[n + r, at], whole[n + r, at + 1] = force[0][r], force[1][r]
        whole[at, at + 1], whole[at + 1, at] = -k * w, k * w
        angle = k * load_periods * start[size]
        x[at], x[at + 1] = mp.cos(angle), mp.sin(angle)
    if (t, *moved) not in exponentials:
        exponentials[t, *moved] = mp.expm(whole * t)
    end = exponentials[t, *moved] * x
    return [*[end[r] for r in range(size)], start[size] + t * w / load_periods, *start[size + 1 :]]


def judged(system, flight, z, t):
    """Largest error of end, derivatives and rate, relative to their sizes."""
    count = len(z)
    out, jacobian, rate = flight.end(z, t)
    errors = []
    with mp.workdps(DIGITS):
        none, known = [mp.mpf(0)] * (count + 1), {}
        plain = exact(system, flight, z, t, none, known)
        errors.append((out, np.array([float(value) for value in plain])))
        step = mp.mpf(10) ** -20
        for c in range(count + 1):
            ahead, behind = ([*none[:c], sign * step, *none[c + 1 :]] for sign in (1, -1))
            pair = (exact(system, flight, z, t, changed, known) for changed in (ahead, behind))
            slope = np.array([float((a - b) / (2 * step)) for a, b in zip(*pair, strict=True)])
            errors.append((jacobian[:, c] if c < count else rate, slope))
    return max(np.abs(ours - theirs).max() / max(1.0, np.abs(theirs).max()) for ours, theirs in errors)


def oscillator(damping=0.0, stiffness=1.0):
    return ImpactSystem([[1.0]], [[damping]], [[stiffness]], [Stop((1.0,), upper=1.0)])


def chain(n, damping, seed=3):
    random = np.random.RandomState(seed)
    stiffness = 3.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    shape = random.uniform(-1.0, 1.0, (n, n))
    mass = np.diag(random.uniform(0.5, 2.0, n))
    return ImpactSystem(mass, damping * (shape @ shape.T + 0.1 * np.eye(n)), stiffness, [Stop((1.0,) + (0.0,) * (n - 1), upper=1.0)])


FREE = ImpactSystem([[1.0, 0.0], [0.0, 2.0]], np.zeros((2, 2)), [[3.0, -3.0], [-3.0, 3.0]], [Stop((1.0, -1.0), -1.0, 1.0)])


@pytest.mark.parametrize(
    ("system", "w", "t"),
    [
        pytest.param(oscillator(), 2.8, 2.2, id="undamped"),
        pytest.param(oscillator(), 1.0 + 1e-9, 20.0, id="beside resonance"),
        pytest.param(oscillator(1e-6), 1.01, 12.0, id="hardly damped"),
        pytest.param(oscillator(0.3, 0.0), 3.0, 2.0, id="a free damped mass"),
        pytest.param(chain(3, 0.2), 1.7, 3.0, id="three, coupled damping"),
    ],
)
def test_flights_agree_with_forty_digits(system, w, t):
    """Oracle: see `require_flights_agree_with_forty_digits`."""
    require_flights_agree_with_forty_digits(system, w, t)


def require_flights_agree_with_forty_digits(system, w, t):
    """End, derivatives by the state, the phase, the frequency and an amplitude, and the rate."""
    n = system.degrees_of_freedom
    random = np.random.RandomState(5)
    cosine, sine = random.uniform(-1.0, 1.0, (2, 3, n))
    slopes = random.uniform(-1.0, 1.0, (2, 2, 3, n))
    flight = LoadedFlight(system, [0, 1, 3], cosine, sine, [w, 1.0, 0.2], 2, *slopes)
    z = [*random.uniform(-1.0, 1.0, 2 * n), 0.37, w, 0.4]
    assert judged(system, flight, z, t) < 2e-14 * (1.0 + abs(t)) * (1.0 + w)


def test_larger_blocks_take_part():
    """All modes as one block, as where it cannot be cut."""
    matrix = np.array([[2.0, -1.0, 0.3], [-1.0, 2.0, -0.7], [0.3, -0.7, 1.5]])
    damping = 0.7 * matrix @ np.diag([1.0, 0.6, 1.4]) @ matrix.T
    system = ImpactSystem(np.eye(3), damping, matrix, [Stop((1.0, 0.0, 0.0), upper=1.0)])
    flight = LoadedFlight(system, [0, 1], np.ones((2, 3)), np.ones((2, 3)), [1.3, 1.0], 1, one_block=True)
    z = [*np.linspace(-1.0, 1.0, 6), 0.2, 1.3]
    assert judged(system, flight, z, 2.0) < 2e-13


def test_a_flight_of_a_correction_that_diverges_ends_at_once():
    """At resonance the work grows with the duration. Oracle: so does the motion, and no end that an orbit could have is made up."""
    flight = LoadedFlight(oscillator(), [1], np.ones((1, 1)), np.ones((1, 1)), [1.0, 1.0], 1)
    out, _, _ = flight.end([0.1, 0.2, 0.3, 1.0], 1e300)
    assert not np.linalg.norm(out[:2]) < 1e299
