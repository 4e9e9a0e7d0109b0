"""The modes of free flight: the first-order form z' = B z of M u'' + C u' + K u = 0 with B in blocks, and the gap rows of the contacts.

Undamped and proportionally damped systems keep the real undamped modes, u = Phi q, v = Phi p, Phi^T M Phi = I, z = (q, p).
Modes that damping couples are block-diagonalised together (`bvp.blocks`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core as core

from bvp.blocks import REFINEMENTS, Blocks, Matrices, blocks_of, exact, exact_product
from bvp.checks import EPSILON, read_only
from bvp.dense import product, quadratic, solve
from bvp.functions import log

if TYPE_CHECKING:
    from bvp.kernels.flight import Contacts, Flight

__all__ = [
    "Modes", "balanced", "energy_form", "impulse_direction", "modal_impulse", "repeated_contacts", "system_modes", "two_parts",
    "undamped_modes",
]  # fmt: skip

UNPACED = 1 << 20
"""In place of the power of two in the arclength of a system without a frequency: the unit of time is the quarter period."""

KNOWN = 64
"""Pairs of matrices whose modes are kept: the system of an orbit is made several times, for its steps, its stability and its files."""


@dataclass(frozen=True, eq=False)
class Modes(Blocks):
    """Arrays of free flight and of the contacts, for N = 2n states and m contacts, in C order.

    They are shared by all who ask and not to be written to; no flag says so, because the kernels would then be compiled twice.

    The blocks (layout of `bvp.kernels.flight`)
        pairs (P, 2), mean (P,), delta (P,), matrix (N, N); flight: the same, as the kernels take them.
    The states
        to_state (2n, N): (u, v) = to_state z; from_state (N, 2n): its inverse.
    The undamped modes
        frequencies (n,), ascending, exactly 0 for a rigid-body mode, NaN where the stiffness is negative; squares (n,), their
        squares (negative where the stiffness is); shapes (n, n), the columns of Phi. layout: "uncoupled" or "coupled";
        in the first z = (q_1..q_n, p_1..p_n) with pairs (k, n + k).
    The contacts, one for each finite bound of each stop, lower before upper, without those that are the same as an earlier one
        contacts: their arrays, as the kernels take them; contact_stop (m,), index of the stop; contact_opposite (m,), index of the contact
        on the stop's other side, the contact itself where there is none; contact_letters, "-" and "+", after the stop's letter where there
        are several stops.
    """

    frequencies: np.ndarray
    squares: np.ndarray
    flight: Flight
    contacts: Contacts
    contact_stop: np.ndarray
    contact_opposite: np.ndarray
    contact_letters: tuple[str, ...]

    @property
    def pace(self) -> int:
        """The power of two near the lowest frequency above 0: the unit of time of the arclength of families in the energy."""
        rates = [w for w in self.frequencies.tolist() if w > 0.0]
        return math.floor(math.log2(min(rates)) + 0.6) if rates else UNPACED  # no frequency is likely where the next power begins

    def position(self, states: np.ndarray, h: Any, alpha: Any) -> np.ndarray:
        """Orbits in the metric of the arclength, equation (33): modal start states (.., N), energies and quarter periods (..)."""
        scaled = states / np.sqrt(2.0 * np.asarray(h))[..., None]
        scaled[..., : len(self.squares)] *= 2.0**self.pace if np.any(self.frequencies > 0.0) else 1.0 / np.asarray(alpha)[..., None]
        return np.concatenate([scaled, np.asarray(log(h))[..., None], np.asarray(log(alpha))[..., None]], axis=-1)


def system_modes(system: Any) -> Modes:
    """The modes of an `ImpactSystem`.

    Raises
    ------
    RuntimeError
        Where an eigenvalue iteration does not converge.
    """
    return _modes_of(system.mass.tobytes(), system.damping.tobytes(), system.stiffness.tobytes(), system.stops)


@lru_cache(KNOWN)
def _modes_of(mass: bytes, damping: bytes, stiffness: bytes, every_stop: Sequence[Any]) -> Modes:
    """The modes of three matrices (n, n) and of stops."""
    from bvp.kernels.flight import Contacts, Flight

    n = math.isqrt(len(mass) // 8)
    system = Matrices(*(np.frombuffer(entries).reshape(n, n) for entries in (mass, damping, stiffness)))
    squares, shapes = undamped_modes(system.mass, system.stiffness)
    blocks = blocks_of(system, squares, shapes)
    rows = np.zeros((4, len(every_stop), 2 * n))
    for k, stop in enumerate(every_stop):
        row = np.array(stop.gap)
        participation = exact_product(row, blocks.shapes)
        impulse = product(blocks.shapes, participation) / product(participation, participation)
        gap, rate = (exact_product(row, part) for part in blocks.to_state.reshape(2, n, 2 * n))
        rows[0, k], rows[1, k], rows[2, k] = gap, rate, product(rate, blocks.matrix)
        rows[3, k] = balanced(product(blocks.from_state[:, n:], impulse), rate)
    sides = [(k, *of, stop) for k, stop in enumerate(every_stop) for of in ((-1.0, stop.lower), (1.0, stop.upper))]
    repeated = repeated_contacts(every_stop) if len(every_stop) > 1 else {}
    contacts = [contact for i, contact in enumerate(contact for contact in sides if math.isfinite(contact[2])) if i not in repeated]
    stops = [k for k, *_ in contacts]
    opposite = [next((j for j, other in enumerate(stops) if other == k and j != i), i) for i, k in enumerate(stops)]
    contact_stop = np.array(stops, dtype=np.int64)
    side, bound, restitution = np.array([(side, bound, stop.restitution) for _, side, bound, stop in contacts]).reshape(-1, 3).T.copy() + 0
    # Contiguous copies without negative zeros.
    gap, rate, acceleration, push = np.take(rows, contact_stop, axis=1) + 0
    own = {name: np.ascontiguousarray(values) + 0 for name, values in vars(blocks).items() if name != "layout"}
    return Modes(
        **own,
        layout=blocks.layout,
        frequencies=read_only(np.sqrt(np.where(squares < 0.0, np.nan, squares))),  # equal systems share them
        squares=squares,
        flight=Flight(own["pairs"], own["mean"], own["delta"], own["matrix"]),
        contacts=Contacts(gap, rate, acceleration, side, bound, push, restitution),
        contact_stop=contact_stop,
        contact_opposite=np.array(opposite, dtype=np.int64),
        contact_letters=tuple((stop.name if len(every_stop) > 1 else "") + ("-" if side < 0.0 else "+") for _, side, _, stop in contacts),
    )


LEVEL = 1e-13
"""Relative difference below which two gap rows or bounds are equal. It matches the contact tolerance, which decides when two hits are
simultaneous."""


def repeated_contacts(stops: Sequence[Any]) -> dict[int, int]:
    """Contacts that are the same obstacle as an earlier contact of another stop: their number among the finite bounds of all stops, and
    that of the earlier one.

    Examples
    --------
    >>> from bvp.system import Stop
    >>> repeated_contacts([Stop((1.0, 0.0), -1.0, 1.0), Stop((-2.0, 0.0), lower=-2.0)])
    {2: 1}
    """
    found: list[tuple[int, np.ndarray, float]] = []  # the obstacle is row . u <= bound, the largest entry of the row 1
    out: dict[int, int] = {}
    for k, stop in enumerate(stops):
        row = np.array(stop.gap) / np.abs(stop.gap).max()
        for side, bound in ((-1.0, stop.lower), (1.0, stop.upper)):
            if not np.isfinite(bound):
                continue
            bound = side * bound / np.abs(stop.gap).max()
            for i, (other, other_row, other_bound) in enumerate(found):
                same_place = abs(bound - other_bound) <= LEVEL * max(abs(bound), abs(other_bound))
                if other != k and same_place and np.all(np.abs(side * row - other_row) <= LEVEL):
                    out.setdefault(len(found), i)
            found.append((k, side * row, bound))
    return out


def balanced(push: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """`push` moved by an ulp or two so that rate . push is 1 as nearly as it can be.

    An impact returns the speed 2 rate . push - 1 times; were that off by a rounding, always to one side, the energy of a long elastic run
    would drift by it at each impact.

    Examples
    --------
    >>> rate = np.array([0.3, 0.7])
    >>> push = rate / (rate @ rate)
    >>> from fractions import Fraction
    >>> off = [sum(Fraction(a) * Fraction(b) for a, b in zip(rate, x, strict=True)) - 1 for x in (push, balanced(push, rate))]
    >>> abs(off[1]) < abs(off[0])
    True
    """
    push, along = push.copy(), exact(rate)
    off, steps = exact(push) @ along - 1, exact(np.spacing(push)) * along
    for i in sorted(range(len(push)), key=lambda i: -abs(steps[i])):
        moved = max(-2, min(2, round(-off / steps[i]))) if push[i] and steps[i] else 0
        push[i] += moved * np.spacing(push[i])
        off += moved * steps[i]
    return push


def undamped_modes(mass: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared frequencies and shapes of K phi = w^2 M phi.

    Jacobi's method on the pencil scaled by the mass keeps small frequencies accurate beside large ones (Demmel & Veselic,
    SIAM J. Matrix Anal. Appl. 13 (1992) 1204); two steps of Ogita & Aishima's refinement (Japan J. Indust. Appl. Math. 35
    (2018) 1007) on the given matrices remove what the scaling left. A square below the rounding of its own Rayleigh quotient
    is 0, and so is one below 1e-292.

    Returns
    -------
    squares : (n,) ndarray
        Ascending.
    shapes : (n, n) ndarray
        Columns with Phi^T M Phi = I; the component with the most kinetic energy is positive.
    """
    mass, stiffness = np.asarray(mass, dtype=float), np.asarray(stiffness, dtype=float)
    squares, shapes = _known_modes(len(mass), mass.tobytes(), stiffness.tobytes())
    return squares.copy(), shapes.copy(order="K")


@lru_cache(KNOWN)
def _known_modes(n: int, mass_entries: bytes, stiffness_entries: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The modes of two matrices (n, n)."""
    mass, stiffness = np.frombuffer(mass_entries + stiffness_entries).reshape(2, n, n)
    try:
        squares, shapes = core.undamped_modes(mass, stiffness)
    except ValueError as error:
        raise np.linalg.LinAlgError(str(error)) from None
    return squares, shapes


def reduced_blocks(
    system: Any, basis: np.ndarray, mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray
) -> Blocks:
    """The blocks of a system that moves along a basis (n, m), m > 0, with its matrices there (m, m). What is rounding in them is zero."""
    mass, stiffness = 0.5 * (mass + mass.T), 0.5 * (stiffness + stiffness.T)
    rounding = 4.0 * len(basis) * EPSILON * product(np.abs(basis).T, np.abs(system.damping), np.abs(basis))
    damping = np.where(np.abs(damping) <= rounding, 0.0, damping)
    squares, shapes = undamped_modes(mass, stiffness)
    scale = 8.0 * len(basis) * EPSILON * quadratic(np.abs(system.stiffness), np.abs(product(basis, shapes)))
    return blocks_of(Matrices(mass, damping, stiffness), np.where(np.abs(squares) <= scale, 0.0, squares), shapes)


def energy_form(system: Matrices, rates: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """G of the energy a.G a/2 of oscillating modes, a = (p_1, q_1, p_2, ..), (u, v) = Re(sum of (p - i q) shape).

    The oscillating entries account for the power of the dampers and vanish without damping. They follow from Lyapunov's equation, so that
    the energy change of a flight equals the dissipation to the last digit. Added to the constant entries, they would be rounded away.

    `rates` (k,) are those that the flight is computed with, and `shapes` (2n, k) complex; G is (2k, 2k).
    """
    u, v = np.split(shapes, 2)
    damping = 0.5 * (system.damping + system.damping.T)
    energy = _between(u.conj(), system.stiffness, u).real + _between(v.conj(), system.mass, v).real
    apart = rates.conj()[:, None] + rates
    np.fill_diagonal(apart, 1.0)
    steady = -2.0 * _between(v.conj(), damping, v) / apart
    np.fill_diagonal(steady, energy.diagonal())
    turning = -2.0 * _between(v, damping, v) / (rates[:, None] + rates)
    amplitudes = np.kron(np.eye(len(rates)), [1.0, -1.0j])
    lasting = _between(amplitudes.conj(), 0.25 * (steady + steady.conj().T), amplitudes).real
    other = _between(amplitudes, 0.25 * (turning + turning.T), amplitudes).real
    return exact(lasting) + exact(other)


def _between(left: np.ndarray, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left^T matrix right of complex columns."""
    k, m = left.shape[1], right.shape[1]
    found = np.zeros((k, m), dtype=complex)
    for part, unit in ((matrix.real, 1.0), (matrix.imag, 1.0j)):
        real = product(np.hstack([left.real, left.imag]).T, part, np.hstack([right.real, right.imag]))
        found += unit * (real[:k, :m] - real[k:, m:] + 1j * (real[:k, m:] + real[k:, :m]))
    return found


def impulse_direction(form: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """G^-1 r/(r.G^-1 r) to more than thirty digits, of exact numbers.

    Examples
    --------
    >>> found = impulse_direction(exact(np.diag([3.0, 7.0])), exact(np.ones(2)))
    >>> [float(abs(10 * value - right)) < 1e-29 for value, right in zip(found, (7, 3))]
    [True, True]
    """
    rounded, found = form.astype(float), exact(np.zeros(len(rate)))
    for _ in range(REFINEMENTS):
        found = found + exact(solve(rounded, (rate - form @ found).astype(float)))
    return found / (rate @ found)


def modal_impulse(system: Matrices, modes: Modes, rate: np.ndarray) -> np.ndarray | None:
    """The direction of an impulse in the states z of `bvp.modes`, along which the energy changes as it must; None where damping couples
    modes that do not all oscillate. The speed across the gap is rate . z."""
    if modes.layout != "coupled":
        return along_row(rate)
    if np.any(modes.pairs[:, 1] < 0) or np.any(modes.delta >= 0.0):
        return None
    first, second = modes.pairs.T
    # A flight is computed with these three numbers of each pair: z_1 = b p, z_2 = w q - d p.
    half = 0.5 * (modes.matrix[first, first] - modes.matrix[second, second])
    side = modes.matrix[first, second]
    frequency = np.sqrt(-modes.delta)
    shapes = modes.to_state[:, first] * side + modes.to_state[:, second] * (1j * frequency - half)
    row, b, d, w = map(exact, (rate, side, half, frequency))
    amplitudes = np.stack([row[first] * b - row[second] * d, row[second] * w], axis=1).ravel()
    p, q = impulse_direction(energy_form(system, modes.mean + 1j * frequency, shapes), amplitudes).reshape(-1, 2).T
    found = np.empty_like(row)
    found[first], found[second] = b * p, w * q - d * p
    return found


def along_row(rate: np.ndarray) -> np.ndarray:
    """The direction of an impulse of modal velocities p whose kinetic energy is p.p/2, where positions and velocities are kept apart.

    Examples
    --------
    >>> [str(value) for value in along_row(np.array([1.0, 3.0]))]
    ['1/10', '3/10']
    """
    row = exact(rate)
    return row / (row @ row)


def two_parts(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact numbers as the nearest doubles and what these leave.

    Examples
    --------
    >>> near, rest = two_parts(exact(np.ones(1)) / 3)
    >>> bool(near[0] == 1 / 3), float(3 * sum(exact([*near, *rest])) - 1) < 1e-31
    (True, True)
    """
    near = values.astype(float)
    return near, (values - exact(near)).astype(float)
