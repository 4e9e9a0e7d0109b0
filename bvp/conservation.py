"""Numbers of a motion that agree with each other beyond double precision, so that its energy does not drift by a rounding at each impact.

A flight that is computed with rounded rates conserves, or loses, an energy of its own, which differs from the true one by rounding, but
for ever. An impact must change that same energy by what it dissipates. With E = a.G a/2 for the amplitudes a of the flight, and the speed
across the gap r.a, it does so if its impulse acts along G^-1 r/(r.G^-1 r), whatever the last digits of r are. In double precision this
direction would be off by a rounding, always to one side, and so would be the energy after each impact.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.blocks import Dynamics
    from bvp.modes import Modes

__all__ = ["decay_rates", "energy_form", "impulse_direction", "modal_impulse", "two_parts"]

REFINEMENTS = 3
"""Steps of iterative refinement with exact residuals, each of which adds nearly sixteen digits."""


def decay_rates(system: Dynamics, shapes: np.ndarray) -> np.ndarray:
    """Real parts of the rates of oscillating modes, from the power and the energy of each. Where damping is light, those of an
    eigenvalue solver have few digits.

    Parameters
    ----------
    system : Dynamics
    shapes : (2n, k) complex ndarray
        (u, v) of each mode.

    Returns
    -------
    (k,) ndarray
    """
    u, v = np.split(shapes, 2)
    power = np.einsum("ik,ij,jk->k", v.conj(), system.damping, v).real
    energy = np.einsum("ik,ij,jk->k", v.conj(), system.mass, v).real + np.einsum("ik,ij,jk->k", u.conj(), system.stiffness, u).real
    return 0.0 - power / energy


def energy_form(system: Dynamics, rates: np.ndarray, shapes: np.ndarray) -> list[list[Fraction]]:
    """G of the energy a.G a/2 of oscillating modes, a = (p_1, q_1, p_2, ..), (u, v) = Re(sum of (p - i q) shape).

    The entries that turn in flight are those that the power of the dampers requires, and vanish without damping: the energy changes in
    flight by what the dampers take, to the last digit of that. Lyapunov's equation gives them. Beside the entries that last they would be
    rounded away.

    Parameters
    ----------
    system : Dynamics
    rates : (k,) complex ndarray
        As the flight is computed with.
    shapes : (2n, k) complex ndarray

    Returns
    -------
    (2k, 2k) list of list of Fraction
    """
    u, v = np.split(shapes, 2)
    damping = 0.5 * (system.damping + system.damping.T)
    energy = (v.conj().T @ system.mass @ v + u.conj().T @ system.stiffness @ u).real
    apart = rates.conj()[:, None] + rates
    np.fill_diagonal(apart, 1.0)
    steady = -2.0 * (v.conj().T @ damping @ v) / apart
    np.fill_diagonal(steady, energy.diagonal())
    turning = -2.0 * (v.T @ damping @ v) / (rates[:, None] + rates)
    amplitudes = np.kron(np.eye(len(rates)), [1.0, -1.0j])
    lasting = (amplitudes.conj().T @ (0.25 * (steady + steady.conj().T)) @ amplitudes).real
    other = (amplitudes.T @ (0.25 * (turning + turning.T)) @ amplitudes).real
    return [[Fraction(float(x)) + Fraction(float(y)) for x, y in zip(*rows, strict=True)] for rows in zip(lasting, other, strict=True)]


def impulse_direction(form: list[list[Fraction]], rate: Sequence[Fraction]) -> list[Fraction]:
    """G^-1 r/(r.G^-1 r) to more than thirty digits.

    Parameters
    ----------
    form : (N, N) list of list of Fraction
        G.
    rate : sequence of N Fraction

    Examples
    --------
    >>> found = impulse_direction([[Fraction(3), Fraction(0)], [Fraction(0), Fraction(7)]], [Fraction(1), Fraction(1)])
    >>> [float(abs(value - exact)) < 1e-30 for value, exact in zip(found, (Fraction(7, 10), Fraction(3, 10)))]
    [True, True]
    """
    rounded = np.array([[float(entry) for entry in row] for row in form])
    found = [Fraction(0)] * len(rate)
    for _ in range(REFINEMENTS):
        residual = [float(value - _dot(row, found)) for row, value in zip(form, rate, strict=True)]
        found = [value + Fraction(float(change)) for value, change in zip(found, np.linalg.solve(rounded, residual), strict=True)]
    compliance = _dot(rate, found)
    return [value / compliance for value in found]


def modal_impulse(system: Dynamics, modes: Modes, rate: np.ndarray) -> list[Fraction] | None:
    """The direction of an impulse in the states z of `bvp.modes`, along which the energy changes as it must.

    Parameters
    ----------
    system : Dynamics
    modes : Modes
        Of the system.
    rate : (2n,) ndarray
        The speed across the gap is rate . z.

    Returns
    -------
    list of Fraction or None
        None where damping couples modes that do not all oscillate.
    """
    row = [Fraction(float(value)) for value in rate]
    if modes.layout != "coupled":
        # The kinetic energy is p.p/2, and the flight keeps positions and velocities apart.
        square = _dot(row, row)
        return [value / square for value in row]
    if np.any(modes.pairs[:, 1] < 0) or np.any(modes.delta >= 0.0):
        return None
    first, second = modes.pairs.T
    # A flight is computed with these three numbers of each pair: z_1 = b p, z_2 = w q - d p.
    half = 0.5 * (modes.matrix[first, first] - modes.matrix[second, second])
    side = modes.matrix[first, second]
    frequency = np.sqrt(-modes.delta)
    shapes = modes.to_state[:, first] * side + modes.to_state[:, second] * (1j * frequency - half)
    form = energy_form(system, modes.mean + 1j * frequency, shapes)
    found: list[Fraction] = [Fraction(0)] * len(row)
    b, d, w = ([Fraction(float(value)) for value in numbers] for numbers in (side, half, frequency))
    amplitudes = [
        value
        for k, (i, j) in enumerate(modes.pairs)
        for value in (row[i] * b[k] - row[j] * d[k], row[j] * w[k])
    ]  # fmt: skip
    direction = impulse_direction(form, amplitudes)
    for k, (i, j) in enumerate(modes.pairs):
        p, q = direction[2 * k], direction[2 * k + 1]
        found[i], found[j] = b[k] * p, w[k] * q - d[k] * p
    return found


def two_parts(values: Sequence[Fraction]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers as the nearest doubles and what these leave.

    Examples
    --------
    >>> near, rest = two_parts([Fraction(1, 3)])
    >>> bool(near[0] == 1 / 3), float(rest[0]) == float(Fraction(1, 3) - Fraction(1 / 3))
    (True, True)
    """
    near = [float(value) for value in values]
    return np.array(near), np.array([float(value - Fraction(double)) for value, double in zip(values, near, strict=True)])


def _dot(first: Sequence[Fraction], second: Sequence[Fraction]) -> Fraction:
    return sum((a * b for a, b in zip(first, second, strict=True)), Fraction(0))
