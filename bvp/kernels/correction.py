"""Corrections of an orbit in one call: onto an energy or a quarter period, and onto a plane across the family.

The steps are those of `bvp.kernels.step`, called at their addresses: a kernel that called them by name would compile them again.
"""

import math

from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import call_at, kernel
from bvp.kernels.flight import inner, set_1
from bvp.kernels.flights import energy_slope, slope_times, twice_energy
from bvp.kernels.multipoint import start_state, total_time, unpack
from bvp.kernels.step import Request, locate, metric_direction

SOLVED, DIVERGED, GROWN, UNSETTLED, FAILED = range(5)
"""Outcomes of `solve_orbit`: not finite; growing; not settled after `ROUNDS`; the last correction, along the family, failed."""

ROUNDS = 30
"""Most corrections onto an energy or a quarter period."""

ITERATIONS = 12
"""Most iterations of one step."""


@kernel
def solve_orbit(compiled, wanted, y, still, metric, landing, ends):
    """The solution near y: at an energy or a quarter period, wanted = (energy, quarter period), NaN where not wanted; else the nearest one
    of the family. y is overwritten.

    compiled: `CompiledProblem`. still (2 u,): zeros. metric (4, N + 2): its first row receives the position. ends (k + 1, N): filled.
    Returns (outcome, last change, the one before)."""
    addresses, packed, factor, observed, work, period = compiled
    energy, quarter_period = wanted
    segment = unpack(packed)
    size = segment.flight.matrix.shape[1]
    parameters = segment.start_map.shape[1]
    unknowns = y.shape[0]
    row = factor.work[5]
    z = work[0, :size]
    at_energy = energy == energy
    held = at_energy or quarter_period == quarter_period
    previous = math.inf
    change = math.inf
    rounds = 0
    while held:
        if rounds == ROUNDS:
            return UNSETTLED, change, previous
        rounds += 1
        for j in range(unknowns):
            row[j] = 0.0
        if at_energy:
            start_state(segment.start_map, segment.start_offset, y, z)
            residual = 0.5 * twice_energy(segment.flight, segment.weights, z) / energy - 1.0
            slope = energy_slope(segment.flight, segment.weights, z, 1.0)
            for j in range(parameters):
                total = 0.0
                for r in range(size):
                    total += segment.start_map[r, j] * slope_times(slope, r, 1.0)
                row[j] = total / energy
        else:
            length = segment.shape[2] * quarter_period
            residual = total_time(segment.flight.matrix, segment.start_map, segment.shape, y) / length - 1.0
            at = parameters
            for _ in range(segment.shape[0] + 1):
                row[at] = 1.0 / length
                at += size + 1
        target = -residual
        for j in range(unknowns):
            target += row[j] * y[j]
        request = Request(0.0, target, 1 if previous > 1e-6 else 8)
        call_at(addresses[0], (packed, factor, y, still, request, metric, landing))
        good = landing.result[entry.CONVERGED] == 1.0
        change = 0.0
        for j in range(unknowns):
            if not abs(landing.y[j]) < math.inf:
                return DIVERGED, change, previous
            change = max(change, abs(landing.y[j] - y[j]) / factor.scale[j])
            y[j] = landing.y[j]
        if change < 1e-13 or (good and previous < 1e-9 and change >= 0.5 * previous):
            break
        if change > 10.0 * previous and change > 1.0:
            return GROWN, change, previous
        previous = change
    set_1(landing.result, math.nan)
    call_at(addresses[0], (packed, factor, y, still, Request(0.0, math.nan, ITERATIONS), metric, landing))
    if landing.result[entry.CONVERGED] != 1.0:
        return FAILED, change, previous
    for i in range(ends.shape[0]):
        for r in range(size):
            ends[i, r] = factor.before[i, r]
    call_at(addresses[1], (packed, observed, landing.y, ends, work, landing.result))
    if addresses[2] != 0:
        call_at(addresses[2], (packed, landing.y, ends, period, landing.result))
    return SOLVED, change, previous


@kernel
def meet_position(compiled, place, most, y, tangent, here, metric, landing):
    """Whether the family through y has an orbit at a position of the arclength's metric, after `most` corrections: each onto the plane
    through the position, across the tangent.

    place: (position (N + 2,), largest distance from it). tangent (2 u,): along the family at y; its length does not matter. here
    (2, N + 2), metric (4, N + 2): scratch. y and tangent are overwritten; the landing receives the orbit."""
    addresses, packed, factor, _, _, _ = compiled
    position, near = place
    segment = unpack(packed)
    unknowns = y.shape[0]
    for _ in range(most):
        energy, alpha = locate(segment, y, here[0])
        _, length = metric_direction(segment, y, here[0], energy, alpha, tangent[:unknowns], here[1])
        if not length > 0.0:
            return False
        for j in range(unknowns):
            tangent[j] /= length
            tangent[unknowns + j] = 0.0
        for r in range(position.shape[0]):
            here[0, r] = position[r] - here[0, r]
        ahead = inner(here[0], here[1]) / length
        call_at(addresses[0], (packed, factor, y, tangent, Request(ahead, math.nan, ITERATIONS), metric, landing))
        if landing.result[entry.CONVERGED] != 1.0:
            return False
        distance = 0.0
        for r in range(position.shape[0]):
            distance += (metric[0, r] - position[r]) ** 2
        if math.sqrt(distance) <= near:
            return True
        for j in range(unknowns):
            y[j] = landing.y[j]
            tangent[j] = landing.tangent[j]
    return False
