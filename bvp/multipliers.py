"""Floquet multipliers of impacting orbits.

The core finds them from a chain of flights and saltation matrices. Where no multiplier is much larger than another one, they are the
eigenvalues of the formed product. A formed product loses small multipliers beside large ones. There, a conservative orbit has the large and
the small ones split off. Where that does not do, the linearised multipoint problem is reduced by orthogonal transformations to a
product pencil, whose eigenvalues are found by periodic QR with shifts. Which orbits are stable is decided apart from all of them, from the
half map: see `bvp.stability`.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import saltus_core as core

from bvp.closures import Cycle, deflated_motions
from bvp.smooth_flights import flight_of, modal_energies

__all__ = [
    "GRAZING_LIMIT", "TRIVIAL_LOST", "LinearisedFlights", "Multipliers", "ScaledNodes", "floquet_multipliers", "given_chain",
    "linearised_flights", "make_chain", "nearest_grazing", "pairs_of", "saddle_point_multipliers", "scaled_nodes", "sort_multipliers",
    "system_chain",
]  # fmt: skip

FORMED, PARTED, FACTORED, SINGULAR, DIVERGED = range(5)
"""How the core found the multipliers: from the formed product, with large ones split off, by periodic QR. Or not: a factor is singular, the
iteration does not converge."""

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


def make_chain(flight: Any, contacts: Any, weights: np.ndarray, free: np.ndarray, conservative: bool, scaled: bool, given: bool) -> Any:
    """The chains of a system for the core.

    Parameters
    ----------
    flight, contacts : Flight, Contacts
        Arrays of free flight and of the contacts, as `bvp.modes.Modes` has them.
    weights : (N,) float
        H = sum(weights z^2)/2.
    free : (f, n) float
        Motions that nothing resists, whose multipliers 1 are left out.
    conservative : bool
        Whether it keeps its energy.
    scaled : bool
        Whether displacements and velocities are divided by their sizes.
    given : bool
        Whether the maps of flights are handed over.
    """
    flights = core.LinearFlight(*(np.ascontiguousarray(part) for part in flight), np.ascontiguousarray(weights))
    rows = core.Contacts(*(np.ascontiguousarray(part) for part in contacts))
    return core.Chain(flights, rows, free, conservative, scaled, given)


@lru_cache(maxsize=64)
def _system_chain(system: Any, hit: frozenset[int] | None, given: bool) -> Any:
    modes, conservative = system.modes, system.is_conservative
    free = deflated_motions(system, hit) if conservative else np.zeros((0, len(modes.squares)))
    weights = np.concatenate([modes.squares, np.ones(len(modes.squares))])
    return make_chain(modes.flight, modes.contacts, weights, free, conservative, modes.layout != "coupled", given)


def system_chain(system: Any, hit: frozenset[int] | None = None) -> Any:
    """The core's chain for the orbits of a linear system. hit: the stops whose springs count; None: all."""
    return _system_chain(system, hit, False)


def given_chain(system: Any, hit: frozenset[int] | None = None) -> Any:
    """The core's chain for maps of flights that are computed here."""
    return _system_chain(system, hit, True)


class LinearisedFlights(NamedTuple):
    """Flights and nodes of an orbit with smooth forces, for the core: F flights, P nodes."""

    maps: np.ndarray  # (F, N, N)
    coming: np.ndarray  # (P, N) rates before each node
    leaving: np.ndarray  # (P, N) and after it


def linearised_flights(flight: Any, before: np.ndarray, after: np.ndarray, duration: np.ndarray) -> LinearisedFlights:
    """The flights from the first nodes over the given durations (F,). before, after: states around each node, (P, N)."""
    before, after, duration = (np.ascontiguousarray(x, dtype=float) for x in (before, after, duration))
    return LinearisedFlights(*core.linearise(flight, after, duration, before))


def floquet_multipliers(cycle: Cycle) -> Multipliers:
    """Multipliers of a closed orbit: those of the formed product where it loses no digit, else with the large ones split off, else
    `saddle_point_multipliers`.

    Raises
    ------
    ValueError
        For a cycle of a linear system without impacts.
    """
    if cycle.system.smooth_forces is not None:
        return saddle_point_multipliers(cycle)
    return _judged(cycle, _of_linear_flights(cycle, True))


def saddle_point_multipliers(cycle: Cycle) -> Multipliers:
    """Multipliers from the saddle-point matrix, by the periodic QR iteration on its product pencil.

    Small multipliers keep their digits beside large ones, and nothing divides by the speed of an impact before the last step.

    Plain cuts of flights (contact -1) are allowed anywhere. The map goes from section to section, and at a cut the section is across the
    flow.

    Raises
    ------
    ValueError
        For a cycle of a linear system without impacts.

    Notes
    -----
    Fairgrieve & Jepson, SIAM J. Numer. Anal. 28 (1991) 1446; Lust, Int. J. Bifurcation Chaos 11 (2001) 2389.
    """
    if cycle.system.smooth_forces is None:
        return _judged(cycle, _of_linear_flights(cycle, False))
    linear = linearised_flights(flight_of(cycle.system), cycle.before, cycle.after, cycle.duration)
    contact = np.ascontiguousarray(cycle.contact, dtype=np.int64)
    return _judged(cycle, given_chain(cycle.system, cycle.hit).multipliers_of_maps(*linear, contact, scaled_nodes(cycle).scale))


def _of_linear_flights(cycle: Cycle, product: bool) -> tuple[Any, ...]:
    """What the core finds. product: whether the formed product may do."""
    if max(cycle.contact.tolist()) < 0:
        raise ValueError("an orbit without impacts has no return map to an impact, and no multipliers of one")
    system = cycle.system
    squares = system.modes.squares
    # The motions that nothing resists can depend on the stops that a cycle hits.
    by_stops = len(system.stops) > 1 and len(squares) > 2 and 0.0 in squares and system.is_conservative
    chain = system_chain(system, cycle.hit if by_stops else None)
    found: tuple[Any, ...] = chain.multipliers(cycle.before, cycle.after, cycle.duration, cycle.contact, product)
    return found


def _judged(cycle: Cycle, found: tuple[Any, ...]) -> Multipliers:
    """What the core found, with whether it is reliable. A plastic impact has a singular map: the smallest multiplier is 0, not what
    rounding leaves of it."""
    route, values, trivial, pairing, matrix, steps = found
    if not cycle.system.is_conservative:
        pairing = None
        if np.any(cycle.system.modes.contacts.restitution[cycle.contact[cycle.contact >= 0]] == 0.0):
            values[-1] = 0.0
    if route >= FACTORED:
        unbounded, unpaired = np.full_like(values, complex(math.nan, math.nan)), None if pairing is None else math.nan
        graze, sine = nearest_grazing(cycle)
        if sine < GRAZING_LIMIT:
            note = f"impact {graze + 1} of {len(cycle.contact)} grazes (sine of its angle {sine:.1e}): the multipliers are unbounded"
            return Multipliers(unbounded, math.nan, unpaired, False, np.full_like(matrix, math.nan), 0, note)
        if route != FACTORED or not np.all(np.isfinite(values)):
            words = {SINGULAR: "are unbounded: a factor is singular", DIVERGED: "did not converge"}.get(route, "overflow")
            nothing = np.full_like(matrix, math.nan)
            return Multipliers(unbounded, trivial, unpaired, False, nothing, max(steps, 0), f"the multipliers {words}")
    largest = max(1.0, abs(values[0])) if len(values) else 1.0
    faults = []
    if pairing is not None and not pairing < PAIRING_LIMIT:
        faults.append(f"a pair of multipliers has a product that is off 1 by {pairing:.1e}")
    if not trivial < TRIVIAL_LIMIT * largest:
        faults.append(f"the trivial directions are kept to {trivial:.1e} only")
    return Multipliers(values, trivial, pairing, not faults, matrix, steps, "; ".join(faults))


class ScaledNodes(NamedTuple):
    """The nodes of a cycle with the sizes of their states."""

    after: np.ndarray  # (P, N) states after each
    scale: np.ndarray  # (N,) sizes of the states' entries
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2


def scaled_nodes(cycle: Cycle) -> ScaledNodes:
    """The sizes of a cycle's states."""
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
        scale[half:] = math.sqrt(2.0 * modal_energies(cycle.system, cycle.after[0]))
    return ScaledNodes(np.ascontiguousarray(cycle.after, dtype=float), scale, weights)


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
