"""Plain numpy and mpmath twins of the compiled kernels: the slow, obvious way to the same numbers, and the systems they are
tried on."""

import mpmath
import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from bvp.system import ImpactSystem, Stop


def first_order(system):
    """The 2n x 2n matrix of (u, v)' from M, C and K."""
    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ system.stiffness, -inverse @ system.damping]])


def flow(system, u, v, t):
    """(u, v) after a free flight of duration t, by scipy's expm of the first-order matrix."""
    return expm(first_order(system) * t) @ np.concatenate([u, v])


def exact_flow_matrix(system, t, digits=50):
    """exp(A t) of (u, v) by mpmath from the exact values of the floats M, C, K: scaling, 60 terms of Taylor's series,
    squaring."""
    with mpmath.workdps(digits + 20):
        n = system.degrees_of_freedom
        inverse = mpmath.matrix(system.mass.tolist()) ** -1
        low = -inverse * mpmath.matrix(system.stiffness.tolist())
        damp = -inverse * mpmath.matrix(system.damping.tolist())
        a = mpmath.zeros(2 * n)
        for i in range(n):
            a[i, n + i] = mpmath.mpf(1)
            for j in range(n):
                a[n + i, j] = low[i, j]
                a[n + i, n + j] = damp[i, j]
        a *= mpmath.mpf(t)
        halvings = max(0, int(mpmath.ceil(mpmath.log(mpmath.mnorm(a, 1) + 1, 2))) + 2)
        with mpmath.workdps(digits + 20 + halvings):
            a /= mpmath.mpf(2) ** halvings
            term = total = mpmath.eye(2 * n)
            for k in range(1, 61):
                term = term * a / k
                total = total + term
            for _ in range(halvings):
                total = total * total
        return np.array(total.tolist(), dtype=float)


def amplitude_samples(matrix, row, z, horizon, order, points=400):
    """|row . B^order exp(B t) z| at many times."""
    step = expm(matrix * horizon / points)
    functional = row @ np.linalg.matrix_power(matrix, order)
    values = []
    for _ in range(points + 1):
        values.append(abs(functional @ z))
        z = step @ z
    return np.array(values)


def restitute(system, index, v, sign=1.0, factor=1.0):
    """Velocities after an impact on stop `index` from M and c alone; sign and factor are 1 unless a mutation is tried."""
    stop = system.stops[index]
    c = np.array(stop.gap)
    direction = np.linalg.solve(system.mass, c)
    return v - sign * (1.0 + factor * stop.restitution) * direction * (c @ v) / (c @ direction)


def distances(system, states):
    """Signed distance of each contact, lower before upper, from (u, v) alone; (..., contacts) for states (..., 2n)."""
    n = system.degrees_of_freedom
    out = []
    for stop in system.stops:
        w = states[..., :n] @ np.array(stop.gap)
        out += [w - stop.lower] if np.isfinite(stop.lower) else []
        out += [stop.upper - w] if np.isfinite(stop.upper) else []
    return np.stack(out, axis=-1)


def rates(system, states):
    """Rate of each distance, d', in the order of `distances`."""
    n = system.degrees_of_freedom
    out = []
    for stop in system.stops:
        w = states[..., n:] @ np.array(stop.gap)
        out += [w] if np.isfinite(stop.lower) else []
        out += [-w] if np.isfinite(stop.upper) else []
    return np.stack(out, axis=-1)


def next_impact(system, u, v, horizon, step, skip_start=0.0):
    """(contact, time) of the first crossing by dense sampling, Brent's method on crossings and on minima between samples; or
    None.

    Distances at times up to `skip_start` are not looked at; where that is not 0, the first step is sampled a hundred times
    finer.
    """
    soon = first_crossing(system, u, v, step, step / 100, skip_start) if skip_start > 0.0 else None
    return soon or first_crossing(system, u, v, horizon, step, skip_start)


def first_crossing(system, u, v, horizon, step, skip_start):
    """What `next_impact` does, with one step for all."""
    a = first_order(system)
    move = expm(a * step)
    samples = [np.concatenate([u, v])]
    for _ in range(int(np.ceil(horizon / step))):
        samples.append(move @ samples[-1])
    samples = np.array(samples)
    far, slope = distances(system, samples), rates(system, samples)
    crossing = far[1:] < 0.0
    low_enough = far[:-1] < 4.0 * step * (np.abs(slope[:-1]) + np.abs(slope[1:]))
    turning = (slope[:-1] < 0.0) & (slope[1:] > 0.0) & low_enough
    for k in np.flatnonzero(np.any(crossing | turning, axis=1)):
        found = []
        for c in np.flatnonzero(crossing[k] | turning[k]):

            def distance(s, k=k, c=c):
                return distances(system, expm(a * s) @ samples[k])[c]

            start = min(max(0.0, skip_start - k * step), step)
            if distance(start) <= 0.0:
                continue
            end = step if crossing[k, c] else None
            if end is None:
                low = minimize_scalar(distance, bounds=(start, step), method="bounded", options={"xatol": 1e-12})
                end = low.x if low.fun < 0.0 else None
            if end is not None:
                found.append((k * step + brentq(distance, start, end, xtol=1e-15), int(c)))
        if found:
            time, c = min(found)
            return (c, time) if time <= horizon else None
    return None


def chain(masses, springs, ground=0.0, damping=0.0, stops=None):
    """Masses in a row joined by springs, free at both ends where ground is 0; damping is proportional to the springs'
    stiffness."""
    n = len(masses)
    stiffness = np.zeros((n, n))
    for k, spring in enumerate(springs):
        stiffness[k : k + 2, k : k + 2] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness[0, 0] += ground
    if stops is None:
        row = np.zeros(n)
        row[0], row[-1] = 1.0, -1.0 if n > 1 else 1.0
        stops = (Stop(tuple(row), -1.0, 1.0),)
    return ImpactSystem(np.diag(masses), damping * stiffness, stiffness, stops)


def force_at(forcing, time):
    """f (n,) of loads at a time, from the states of the small systems that make them."""
    k = max(int(np.searchsorted(forcing.breaks, time, side="right")) - 1, 0)
    y = forcing.levels[k].copy()
    y[:, 0] += y[:, 1] * (time - forcing.breaks[k])
    moving = forcing.frequency > 0.0
    y[moving] = np.stack([np.cos(forcing.frequency * time), np.sin(forcing.frequency * time)], axis=1)[moving]
    return np.einsum("gnk,gk->n", forcing.loads, y)
