"""Floquet multipliers of impacting orbits.

Where no multiplier is much larger than another one, they are the eigenvalues of the product of flights and saltation matrices
(`bvp.kernels.monodromy`). A formed product loses small multipliers beside large ones. There, a conservative orbit has the large and the
small ones split off (`bvp.kernels.deflation`). Where that does not do, the linearised multipoint problem is reduced by orthogonal
transformations to a product pencil (`bvp.kernels.pencil`), whose eigenvalues are found by periodic QR with shifts
(`bvp.kernels.periodic_qr`). Which orbits are stable is decided apart from all of them, from the half map: see `bvp.stability`.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from bvp.closures import Cycle, deflated_motions
from bvp.kernels.deflation import deflated_multipliers
from bvp.kernels.monodromy import (
    EXACT,
    FOUND,
    ClosedOrbit,
    EigenvalueWork,
    LinearisedOrbit,
    Reduction,
    formed_multipliers,
    make_eigenvalue_work,
    make_linearised_orbit,
    make_reduction,
    order_multipliers,
)  # fmt: skip
from bvp.kernels.paths import motion_at
from bvp.kernels.pencil import ContactRows, Factors, Linearised, Nodes, landings, pencil, trivial_directions
from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.sweeps import SweepWork, make_sweep_work
from bvp.smooth_flights import flight_of, modal_energies

__all__ = [
    "GRAZING_LIMIT", "TRIVIAL_LOST", "Formed", "Multipliers", "SystemData", "floquet_multipliers", "formed", "nearest_grazing", "pairs_of",
    "saddle_point_multipliers", "scaled_nodes", "sort_multipliers", "system_data",
]  # fmt: skip

GRAZING_LIMIT = 1e-13
"""|g . f| / (|g| |f|) below which an impact counts as grazing and the multipliers as unbounded."""

PAIRING_LIMIT = 1e-6
TRIVIAL_LIMIT = 1e-8
"""Largest errors of reliable multipliers. The error of the trivial directions is relative to the largest multiplier, which magnifies
rounding."""

TRIVIAL_LOST = 1.0
"""Relative error of the trivial directions at which the product of saltation matrices has lost every digit of the trivial multiplier."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Floquet multipliers of the return map to an impact, and how good they are.

    Parameters
    ----------
    values : (m,) complex
        The nontrivial ones, by modulus descending, then by angle. m = 2 n - 2 - 2 f for a conservative system with f motions that no
        spring and no stop resists; m = 2 n - 1 for one that loses energy. NaN where an impact grazes.
    trivial : float
        How badly the saltation product keeps the trivial directions: the larger of |(M - I) f|/|f| and, for a conservative system,
        |grad H (M - I)|/|grad H|.
    pairing : float or None
        Largest |lambda_i lambda_j - 1| over the pairs; None for a system that loses energy, whose multipliers have no pairs.
    reliable : bool
        False where an impact grazes, a pair is off by more than 1e-6, or the trivial directions are off by more than 1e-8 of the largest
        multiplier.
    matrix : (m, m) float
        The return map, in some orthonormal frame: for its size and condition. Its eigenvalues are not right to the last digit.
    sweeps : int
        Steps of the periodic QR iteration, or rounds of the frames of large and small ones; 0 where the product was formed.
    note : str
        What is wrong, in words; empty where nothing is.
    """

    values: np.ndarray
    trivial: float
    pairing: float | None
    reliable: bool
    matrix: np.ndarray
    sweeps: int = 0
    note: str = ""

    @property
    def trace(self) -> float:
        """Sum of the nontrivial multipliers; for n = 2 this is tau."""
        return float(np.real(np.sum(self.values)))


class SystemData(NamedTuple):
    """The arguments of `formed_multipliers` that depend on the system alone, and scratch."""

    flight: Any
    contacts: ContactRows
    conservative: bool
    scaled: bool
    work: Reduction
    deflates: bool
    sweeps: SweepWork
    square: np.ndarray
    spectrum: EigenvalueWork
    passages: dict[int, LinearisedOrbit]
    by_stops: bool = False  # the motions that nothing resists depend on the stops that an orbit hits

    def linearised(self, nodes: int) -> LinearisedOrbit:
        """Arrays for orbits with so many nodes: those of the last such orbit, if it had as many."""
        found = self.passages.get(nodes)
        if found is None:
            self.passages.clear()
            found = self.passages[nodes] = make_linearised_orbit(nodes, len(self.work.scale), self.flight)
        return found


def system_data(
    flight: Any, contacts: ContactRows, squares: np.ndarray, free: np.ndarray, conservative: bool = True, scaled: bool = True
) -> SystemData:
    """That of a system with the modes of free flight, and with motions `free` (f, n) that nothing resists."""
    n = len(squares)
    work = make_reduction(free, np.concatenate([squares, np.ones(n)]) if conservative else np.ones(2 * n), conservative)
    m = 2 * n - len(work.vectors)
    return SystemData(
        flight, contacts, conservative, scaled, work, conservative and n > 2, make_sweep_work(m, 2 * n), np.empty((m, m)),
        make_eigenvalue_work(m), {},
    )  # fmt: skip


@lru_cache(maxsize=64)
def _data_of(system: Any, hit: frozenset[int] | None = None) -> SystemData:
    modes, conservative = system.modes, system.is_conservative
    contacts = ContactRows(modes.contacts.gap, modes.contacts.rate, modes.contacts.push, 1.0 + modes.contacts.restitution)
    free = deflated_motions(system, hit) if conservative else np.zeros((0, len(modes.squares)))
    data = system_data(modes.flight, contacts, modes.squares, free, conservative, modes.layout != "coupled")
    return data._replace(by_stops=conservative and len(system.stops) > 1 and len(modes.squares) > 2 and 0.0 in modes.squares)


class Formed(NamedTuple):
    """Multipliers of a formed product: sorted; errors of the trivial directions and of the pairs; the map; rounds of frames."""

    values: np.ndarray
    trivial: float
    pairing: float
    matrix: np.ndarray
    sweeps: int


def formed(data: SystemData, orbit: ClosedOrbit) -> Formed | None:
    """The multipliers of a linear system's orbit from the product, with the large ones split off where that is needed; None where the
    product loses digits."""
    spectrum = EigenvalueWork(np.empty_like(data.spectrum.matrix), *data.spectrum[1:])  # the result keeps the matrix
    linearised = data.linearised(len(orbit.duration))
    found, _, flow, level, pairing = formed_multipliers(
        data.flight, data.contacts, orbit, data.conservative, data.scaled, data.work, linearised, spectrum
    )
    sweeps = 0
    if found == FOUND and data.deflates:
        sweeps, pairing = deflated_multipliers(
            data.flight, data.contacts, orbit, linearised, data.work, spectrum, data.sweeps, data.square
        )
    if found != EXACT and not sweeps:
        return None
    real, imaginary = spectrum.values
    values = np.empty(len(real), complex)
    values.real, values.imag = real, imaginary
    return Formed(values, max(flow, level), pairing, spectrum.matrix, sweeps)


def floquet_multipliers(cycle: Cycle) -> Multipliers:
    """Multipliers of a closed orbit: those of the formed product where it loses no digit, else with the large ones split off, else
    `saddle_point_multipliers`.

    Raises
    ------
    ValueError
        For a cycle of a linear system without impacts.
    """
    if cycle.system.smooth_forces is not None or max(cycle.contact.tolist()) < 0:
        return saddle_point_multipliers(cycle)
    data = _data_of(cycle.system)
    if data.by_stops:
        data = _data_of(cycle.system, cycle.hit)
    found = formed(data, ClosedOrbit(cycle.before, cycle.after, cycle.duration, cycle.contact))
    if found is None:
        return saddle_point_multipliers(cycle)
    return _judged(cycle, found.values, found.trivial, found.pairing if data.conservative else None, found.matrix, found.sweeps)


def _judged(cycle: Cycle, values: np.ndarray, trivial: float, pairing: float | None, matrix: np.ndarray, sweeps: int) -> Multipliers:
    """The sorted multipliers, with whether they are reliable. A plastic impact has a singular map: the smallest multiplier is 0, not what
    rounding leaves of it."""
    if pairing is None and np.any(cycle.system.modes.contacts.restitution[cycle.contact[cycle.contact >= 0]] == 0.0):
        values[-1] = 0.0
    largest = max(1.0, abs(values[0])) if len(values) else 1.0
    faults = []
    if pairing is not None and not pairing < PAIRING_LIMIT:
        faults.append(f"a pair of multipliers has a product that is off 1 by {pairing:.1e}")
    if not trivial < TRIVIAL_LIMIT * largest:
        faults.append(f"the trivial directions are kept to {trivial:.1e} only")
    return Multipliers(values, trivial, pairing, not faults, matrix, sweeps, "; ".join(faults))


def saddle_point_multipliers(cycle: Cycle) -> Multipliers:
    """Multipliers from the saddle-point matrix, by the periodic QR iteration on its product pencil.

    Small multipliers keep their digits beside large ones, and nothing divides by the speed of an impact before the last step.

    Plain cuts of flights (contact -1) are allowed anywhere. Those of linear flights are left out. At those of smooth flights the map goes
    from section to section, each across the flow.

    Raises
    ------
    ValueError
        For a cycle of a linear system without impacts.

    Notes
    -----
    Fairgrieve & Jepson, SIAM J. Numer. Anal. 28 (1991) 1446; Lust, Int. J. Bifurcation Chaos 11 (2001) 2389. See
    `bvp.kernels.periodic_qr`.
    """
    smooth = cycle.system.smooth_forces is not None
    if not smooth:
        cycle = _without_cuts(cycle)
    modes, flight = cycle.system.modes, flight_of(cycle.system)
    conservative = cycle.system.is_conservative
    scaled = scaled_nodes(cycle)
    nodes, size = scaled.after.shape
    free = deflated_motions(cycle.system, cycle.hit) if conservative else np.zeros((0, size // 2))
    dimension = size - 1 - int(conservative) - 2 * len(free)
    unbounded = np.full(dimension, complex(math.nan, math.nan))
    unpaired = math.nan if conservative else None
    graze, sine = nearest_grazing(cycle)
    if sine < GRAZING_LIMIT:
        note = f"impact {graze + 1} of {nodes} grazes (sine of its angle {sine:.1e}): the multipliers are unbounded"
        return Multipliers(unbounded, math.nan, unpaired, False, np.full((dimension, dimension), math.nan), 0, note)
    contacts = ContactRows(modes.contacts.gap, modes.contacts.rate, modes.contacts.push, 1.0 + modes.contacts.restitution)
    if smooth:
        contacts, scaled = _with_sections(contacts, scaled, flight)
    linear = Linearised(np.empty((nodes, size, size)), np.empty((nodes, size)))
    factors = Factors(np.zeros((nodes, size, size)), np.zeros((nodes, size, size)))
    landings(flight, contacts, scaled, linear)
    scratch = np.empty((5, size, size)), np.empty(2 + 2 * len(free))
    pencil(flight, contacts, scaled, conservative, free, linear, factors, *scratch)
    flow, level = trivial_directions(flight, contacts, scaled, 1, linear, np.empty((4, size)))
    trivial = float(max(flow, level) if conservative else flow)
    # In the order in which they are applied, from the coordinates before the last inverse on.
    chain = np.empty((2 * nodes, dimension, dimension))
    chain[::2] = np.roll(factors.left[:, :dimension, :dimension], 1, axis=0)
    chain[1::2] = factors.right[:, :dimension, :dimension]
    inverse, matrix, found = np.tile(np.array([1, 0], np.int64), nodes), np.empty((dimension, dimension)), np.empty((2, dimension))
    steps = product_eigenvalues(chain, inverse, np.empty((3, 3)), matrix, found)
    if steps < 1 or not np.all(np.isfinite(found)):
        words = "are unbounded: a factor is singular" if steps < 0 else "did not converge" if steps == 0 else "overflow"
        return Multipliers(unbounded, trivial, unpaired, False, np.full_like(matrix, math.nan), max(steps, 0), f"the multipliers {words}")
    pairing = order_multipliers(found, np.empty_like(found), conservative)
    values = found[0] + 1j * found[1]
    pairing = pairing if conservative else None
    return _judged(cycle, values, trivial, pairing, matrix, steps)


def _with_sections(contacts: ContactRows, nodes: Nodes, flight: Any) -> tuple[ContactRows, Nodes]:
    """The contacts and the nodes of a cycle, each cut at a contact of its own: the section across the flow, at which nothing is hit."""
    cuts = np.flatnonzero(nodes.row < 0)
    row, known = nodes.row.copy(), len(contacts.jump)
    row[cuts] = known + np.arange(len(cuts))
    added = np.zeros((len(cuts), nodes.after.shape[1]))
    for section, i in zip(added, cuts, strict=True):
        motion_at(flight, nodes.after[i], 0.0, np.empty_like(section), section)
        section /= nodes.scale**2
    none = np.zeros_like(added)
    parts = ((contacts.gap, added), (contacts.rate, none), (contacts.push, none), (contacts.jump, np.zeros(len(cuts))))
    return ContactRows(*(np.concatenate(pair) for pair in parts)), nodes._replace(row=row)


def _without_cuts(cycle: Cycle) -> Cycle:
    """The cycle begun at an impact, each flight in one piece."""
    impacts = np.flatnonzero(cycle.contact >= 0)
    if impacts.size == 0:
        raise ValueError("an orbit without impacts has no return map to an impact, and no multipliers of one")
    if impacts.size == len(cycle.contact):
        return cycle
    first = int(impacts[0])
    duration = np.add.reduceat(np.roll(cycle.duration, -first), impacts - first)
    lead = cycle.lead + float(np.sum(cycle.duration[:first]))
    return Cycle(cycle.system, cycle.before[impacts], cycle.after[impacts], duration, cycle.contact[impacts], lead)


def scaled_nodes(cycle: Cycle) -> Nodes:
    """The nodes of a cycle with the sizes of their states, for the kernels."""
    modes = cycle.system.modes
    size = cycle.after.shape[1]
    half = size // 2
    scale = np.ones(size)
    weights = np.ones(size)
    if modes.layout != "coupled":
        for part in (slice(0, half), slice(half, size)):
            largest = float(np.max(np.abs(cycle.before[:, part])))
            scale[part] = largest if largest > 0.0 else 1.0
    if cycle.system.is_conservative:
        weights[:half] = modes.squares
        # velocities by sqrt(2 h), not by those at the impacts: an impact may be the only slow part of an orbit
        smooth = cycle.system.smooth_forces is not None
        scale[half:] = math.sqrt(2.0 * modal_energies(cycle.system, cycle.after[0]) if smooth else np.sum(weights * cycle.after[0] ** 2))
    before, after, duration = (np.ascontiguousarray(x, dtype=float) for x in (cycle.before, cycle.after, cycle.duration))
    return Nodes(before, after, duration, np.ascontiguousarray(cycle.contact, dtype=np.int64), scale, weights)


def nearest_grazing(cycle: Cycle) -> tuple[int, float]:
    """The impact nearest to grazing, the first of several, among those that are no cuts, and |g . f| / (|g| |f|) there, f the physical
    velocity; (-1, 1) without impacts."""
    system, modes = cycle.system, cycle.system.modes
    hit = np.flatnonzero(cycle.contact >= 0)
    if not hit.size:
        return -1, 1.0
    contact = cycle.contact[hit]
    n = system.degrees_of_freedom
    velocity = cycle.before[hit] @ modes.to_state[n:].T
    rows = np.array([stop.gap for stop in system.stops])[modes.contact_stop[contact]]
    speed = np.abs(np.sum(rows * velocity, axis=1))
    size = np.linalg.norm(rows, axis=1) * np.max(np.linalg.norm(velocity, axis=1))
    sine = np.divide(speed, size, out=np.zeros_like(speed), where=size > 0.0)
    least = float(sine.min())
    return int(np.argmax(sine <= max(GRAZING_LIMIT, (1.0 + 1e-9) * least))), least


def sort_multipliers(values: np.ndarray) -> np.ndarray:
    """By modulus descending, then by angle ascending from -pi; moduli equal to 1e-9 count as equal. NaN are last."""
    # For a few numbers Python takes half the time of numpy.
    return np.array(sorted(np.asarray(values, dtype=complex).tolist(), key=_order), dtype=complex)


def _order(value: complex) -> tuple[bool, float, float]:
    modulus = math.hypot(value.real, value.imag)  # abs raises an error where it overflows
    return cmath.isnan(value), -round(math.log(modulus), 9) if modulus > 0.0 else math.inf, cmath.phase(value)


def pairs_of(values: np.ndarray) -> list[tuple[complex, complex]]:
    """Multipliers in pairs: each, from the first on, with the one that is left whose product with it is nearest to 1."""
    left = values.tolist()
    pairs = []
    while left:
        value = left.pop(0)
        pairs.append((value, left.pop(int(np.argmin([abs(value * other - 1.0) for other in left])))))
    return pairs
