"""Families that the tests share, traced once, and what the tests measure on their orbits with numpy alone."""

from functools import cache

import numpy as np

import saltus
from tests.bvp.flow_twin import Twin

EPS = np.finfo(float).eps


@cache
def traced(name, mu=0.1, sigma=0.1, low=0.05, high=1e4):
    """The family of a name."""
    return saltus.trace(name, saltus.vibro_impact_nes(mu=mu, sigma=sigma), energy=(low, high))


def spread(branch, count):
    """Indices of about `count` points along a branch, not those at its two ends, where impacts graze."""
    return sorted({int(i) for i in np.linspace(1, len(branch) - 2, count)})


def monodromy(orbit):
    """Product of exact flights and saltation matrices over a period, (2n, 2n), in physical coordinates, by numpy alone."""
    system = orbit.system
    twin = Twin(system)
    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)
    times = np.array([impact.time for impact in orbit.impacts])
    u, v = orbit.sample(np.zeros(1))
    state, now = np.concatenate([u[0], v[0]]), 0.0
    product = np.eye(2 * n)
    for time, impact in zip(times, orbit.impacts, strict=True):
        product = _columns(twin, product, time - now)
        state, now = twin.flow(state, time - now), time
        contact = [letter for *_, letter in twin.contacts].index(impact.stop)
        product = saltation(twin, state, contact, inverse) @ product
        state = twin.impact(state, contact)
    return _columns(twin, product, orbit.period - now)


def _columns(twin, matrix, time):
    return np.column_stack([twin.flow(column, time) for column in matrix.T])


def saltation(twin, state, contact, inverse):
    """R + (f+ - R f-) g / (g f-) at an elastic impact."""
    n = twin.n
    c, _, _, restitution, _ = twin.contacts[contact]
    direction = inverse @ c
    turn = np.eye(2 * n)
    turn[n:, n:] -= (1.0 + restitution) * np.outer(direction, c) / (c @ direction)
    after = twin.impact(state, contact)
    coming, going = twin.matrix @ state, twin.matrix @ after
    row = np.concatenate([c, np.zeros(n)])
    return turn + np.outer(going - turn @ coming, row) / (row @ coming)


def count_label(orbit, samples=20000):
    """(m, n, impacts in the first quarter, in the second, at the quarter) counted on dense samples of the first half period."""
    half = 0.5 * orbit.period
    times = (np.arange(samples) + 0.5) * half / samples
    _, v = orbit.sample(times)
    waves = [int(np.sum(np.diff(np.sign(v[:, i])) != 0)) for i in (0, 1)]
    hits = np.array([impact.time for impact in orbit.impacts if impact.time < half])
    quarter = np.abs(hits - 0.5 * half) < 1e-9 * half
    first, second = np.sum((hits < 0.5 * half) & ~quarter), np.sum((hits > 0.5 * half) & ~quarter)
    return (*waves, int(first), int(second), int(np.sum(quarter)))
