"""Compiled measures of a forced orbit: the largest displacements, and exact integrals of squares and powers along its flights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel
from bvp.kernels.energy_budget import Products, integral_work, integrals
from bvp.kernels.extrema import PEAK_ROWS, peak_flight
from bvp.kernels.flight import copy_1, flow_state, set_1, set_2
from bvp.kernels.forced import refresh
from bvp.kernels.forced_sticking import flight_in, flight_mode, mode_count, orbit_flight
from bvp.kernels.impact import work_array
from bvp.kernels.loaded_paths import GROWTH, PIECES, Extended, any_resonance, extend_flight, extended_state, make_extended, rates_of

__all__ = ["Measuring", "make_measuring", "orbit_measures"]


class Measuring(NamedTuple):
    """What the measures of an orbit need, for n coordinates and flights of E states. R = 2 n + n (n + 1)/2 products."""

    coordinates: np.ndarray  # (n, n) rows on displacements: the coordinates
    extended: Extended
    rows: np.ndarray  # (2 n, E) displacements and velocities
    products: Products  # squares of displacements; products of velocities, row by row of the upper triangle; powers of the loads
    peak: np.ndarray  # scratch of `peak_flight`
    edge: np.ndarray
    work: np.ndarray
    integral: np.ndarray
    begin: np.ndarray  # (E,)
    out: np.ndarray  # (R,)


def make_measuring(blocks: int, size: int, harmonics: int, joined: bool) -> Measuring:
    """Arrays for a system with so many blocks, 2 n states and harmonics; `joined`: with room for the loads in each block."""
    n = size // 2
    extended = make_extended(blocks, size, harmonics, n, joined)
    states, count = len(extended.state), 2 * n + n * (n + 1) // 2
    products = Products(np.zeros((count, states)), np.zeros((count, states)), np.ones(count))
    scratch = np.zeros((PEAK_ROWS, 1, states)), np.zeros((2, 1)), work_array(states, 1), integral_work(states, count)
    return Measuring(np.eye(n), extended, np.zeros((size, states)), products, *scratch, np.zeros(states), np.zeros(count))


@kernel
def orbit_measures(segment, plain, joined, y, peaks, totals):
    """The measures of the solved segment of an orbit y into peaks (n,), the largest displacements, and totals (R,), the integrals of the
    products (`Measuring`). Returns False if the search for a peak gave up."""
    refresh(segment, y[: segment.gap.shape[1]])
    joins = False
    for mode in range(1 + mode_count(segment.sticking)):
        joins = joins or any_resonance(flight_in(segment.sticking, segment.flight, mode))
    if joins:
        return measure_flights(segment, joined, y, peaks, totals)
    return measure_flights(segment, plain, y, peaks, totals)


@kernel
def measure_flights(segment, measuring, y, peaks, totals):
    """See `orbit_measures`."""
    extended = measuring.extended
    rows = measuring.rows
    width = segment.gap.shape[1]
    n = measuring.coordinates.shape[0]
    set_1(peaks, 0.0)
    set_1(totals, 0.0)
    flights = y.shape[0] // (width + 1)
    # The starts of all flights first: a flight that begins at rest is long searched, unless it is known to stay below these.
    for i in range(flights):
        for c in range(n):
            peaks[c] = max(peaks[c], abs(y[i * (width + 1) + c]))
    present = -1
    for i in range(flights):
        at = i * (width + 1)
        duration = y[at + width]
        mode = flight_mode(segment.sticking, i)
        if mode != present:
            present = mode
            extend_flight(flight_in(segment.sticking, segment.flight, mode), measuring.coordinates, extended)
            for c in range(n):
                copy_1(extended.observed.rows[c, 0], rows[c])
                copy_1(extended.observed.rows[c, 1], rows[n + c])
            fill_products(segment, measuring)
        growth, decay = rates_of(extended.flight)
        extended_state(orbit_flight(segment, i), y[at : at + width], extended)
        integrals(extended.flight, measuring.products, extended.state, duration, measuring.integral, measuring.out)
        for r in range(totals.shape[0]):
            totals[r] += measuring.out[r]
        longest = max(GROWTH / growth, duration / PIECES) if growth > 0.0 else duration
        piece = GROWTH / decay if decay > 0.0 else duration
        time = 0.0
        while time < duration:
            piece = min(piece, longest, duration - time)
            flow_state(extended.flight, extended.state, time, measuring.begin)
            if not peak_flight(
                extended.flight, rows, measuring.begin, piece, peaks, peaks[:0], measuring.peak, measuring.edge, measuring.work
            ):
                return False
            if time + piece == time:
                break
            time += piece
            piece *= 2.0
    return True


@kernel
def fill_products(segment, measuring):
    """Rows of the products: of displacements, of velocities, and of each load with the velocity of its coordinate."""
    first, second, _ = measuring.products
    rows, loads, released = measuring.rows, segment.flight.loads, segment.released
    n = measuring.coordinates.shape[0]
    r = n
    for a in range(n):
        copy_1(rows[a], first[a])
        copy_1(rows[a], second[a])
        for b in range(a, n):
            copy_1(rows[n + a], first[r])
            copy_1(rows[n + b], second[r])
            r += 1
    set_2(first[r:], 0.0)
    harmonics = loads.harmonics.shape[0]
    last = measuring.extended.last[0]
    constants = 1 if harmonics > 0 and loads.harmonics[0] == 0.0 else 0
    for c in range(n):
        copy_1(rows[n + c], second[r + c])
        for h in range(harmonics):
            if h < constants:
                first[r + c, last] = released.entries[released.places[1] + c]
            else:
                for part in range(2):
                    entry = released.places[2 + part] + (h - constants) * n + c
                    first[r + c, last + 2 * h + part] = released.entries[entry]
