"""Closed forms of orbits with one impact a half period, and of one impact a period on a one-sided stop.

A linear undamped system with modes w_k, mass-normalised shapes and b_k = c . phi_k moves under impulses of alternating sign
along the gap w = c . u, half a period 2 alpha apart: an antiperiodic train of impulses, summed mode by mode.
"""

import numpy as np


def modes_of(system):
    """Frequencies (n,) and participations b_k (n,) by numpy alone, ascending; the shapes are mass-normalised."""
    lower = np.linalg.cholesky(system.mass)
    inverse = np.linalg.inv(lower)
    squares, vectors = np.linalg.eigh(inverse @ system.stiffness @ inverse.T)
    shapes = inverse.T @ vectors
    squares[np.abs(squares) < 1e-13 * np.max(squares)] = 0.0
    return np.sqrt(squares), shapes


def _tan_over(w, t):
    """tan(w t)/w, continued to w = 0."""
    return np.where(w > 0.0, np.tan(w * t) / np.where(w > 0.0, w, 1.0), t)


def participation(system, stop=0):
    """Frequencies, shapes and b_k = c . phi_k of a stop."""
    frequencies, shapes = modes_of(system)
    return frequencies, shapes, shapes.T @ np.array(system.stops[stop].gap)


def half_period_sum(system, alpha):
    """G(alpha) = sum b_k^2 tan(w_k alpha)/w_k."""
    w, _, b = participation(system)
    return float(np.sum(b * b * _tan_over(w, alpha)))


def energy(system, alpha):
    """h = sum b_k^2 sec^2(w_k alpha) / (2 G^2), for a gap in [-1, 1]."""
    w, _, b = participation(system)
    return float(np.sum((b / np.cos(w * alpha)) ** 2) / (2.0 * half_period_sum(system, alpha) ** 2))


def origin_velocity(system, alpha):
    """Velocities u' (n,) as the orbit passes u = 0, a quarter period before it hits the upper side."""
    w, shapes, b = participation(system)
    return shapes @ (b / (half_period_sum(system, alpha) * np.cos(w * alpha)))


def motion(system, alpha, t):
    """Displacements (m, n) and velocities (m, n) at times t (m,) from the passage of u = 0, for |t| < alpha."""
    w, shapes, b = participation(system)
    t = np.asarray(t)[:, None]
    amplitude = b / (half_period_sum(system, alpha) * np.cos(w * alpha))
    sine = np.where(w > 0.0, np.sin(w * t) / np.where(w > 0.0, w, 1.0), t)
    return (amplitude * sine) @ shapes.T, (amplitude * np.cos(w * t)) @ shapes.T


def is_physical(system, alpha, samples=4000):
    """G > 0 and |w| <= 1 on a dense grid: the closed form is an orbit."""
    if half_period_sum(system, alpha) <= 0.0:
        return False
    u, _ = motion(system, alpha, np.linspace(-alpha, alpha, samples)[1:-1])
    return bool(np.max(np.abs(u @ np.array(system.stops[0].gap))) <= 1.0)


def one_sided(system, period):
    """Impact of one orbit a period on the one-sided stop w <= d: displacements u (n,) there and velocities (n,) just before.

    q_k = A_k cos(w_k (t - T/2)) with w = d at the impact and the impulse P along c: A_k = P b_k / (2 w_k sin(w_k T/2)).
    """
    w, shapes, b = participation(system)
    d = system.stops[0].upper
    cot = b * b / np.tan(w * period / 2.0) / w
    impulse = 2.0 * d / np.sum(cot)
    amplitude = impulse * b / (2.0 * w * np.sin(w * period / 2.0))
    return shapes @ (amplitude * np.cos(w * period / 2.0)), shapes @ (-amplitude * w * np.sin(w * period / 2.0)), impulse
