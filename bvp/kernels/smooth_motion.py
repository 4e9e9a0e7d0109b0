"""Simulation with smooth forces: the contact modes of a motion whose flights are Taylor series, and integrals and peaks along these.

All contact modes have the state of `bvp.kernels.pieces`: where contacts stick, the accelerations are projected. What follows from the
state as rows on it - gaps, forces of contacts, dampers - is as for linear flights, and so are the kernels of simulation.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, shared
from bvp.kernels.contact_mode import BREAK_INDEX, cannot_hit, flight_of, renew_loads, settle, write_loads
from bvp.kernels.driving import DrivingSources
from bvp.kernels.energy_budget import integrals
from bvp.kernels.extrema import next_sign_change, peak_flight, raise_peak, refine, track_of
from bvp.kernels.flight import copy_1, inner, row_dot
from bvp.kernels.pieces import ROOM, MotionFlight, find_piece, on_piece, project_step
from bvp.kernels.smooth import track_along
from bvp.kernels.sources import ORDER, begin_sources
from bvp.kernels.taylor import SmoothFlight, expand


class SmoothModes(NamedTuple):
    """`bvp.kernels.contact_mode.ContactModes` with smooth forces: states Z of N entries, of which W are (q, p, y)."""

    sticking: np.ndarray  # (M,) int64, for M contact modes
    pairs: np.ndarray  # (M, P, 2) entries of Z that exchange energy
    matrix: np.ndarray  # (M, N, N) of Z' = B Z, without f'''
    leave: np.ndarray
    enter: np.ndarray
    to_modes: np.ndarray
    from_modes: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    push: np.ndarray
    push_rest: np.ndarray
    side: np.ndarray
    bound: np.ndarray
    first: np.ndarray
    second: np.ndarray
    restitution: np.ndarray
    contact_mass: np.ndarray
    contact_stop: np.ndarray
    weight: np.ndarray
    part: np.ndarray
    frequency: np.ndarray
    breaks: np.ndarray
    levels: np.ndarray
    shape: np.ndarray
    own: np.ndarray  # (M, 2 n, 2 n) of (q, p)' without loads and smooth forces
    forced: np.ndarray  # (M, n, F) accelerations of unit forces
    driven: np.ndarray  # (M, n, 2 G) those of unit loads
    taylor: SmoothFlight  # what the modes share
    owner: np.ndarray  # (J,) int64 the mode of each path that is kept
    current: np.ndarray  # (1,) int64 the path that began last
    polynomials: np.ndarray  # (2, ORDER + 1) scratch


@flight_of.of(SmoothModes)
@inlined
def taylor_of_mode(modes, f):
    """See `flight_of`."""
    shared_part = modes.taylor
    old = shared_part.sources
    sources = DrivingSources(old.columns, modes.driven[f], old.frequency, old.begin, old.now, old.course, old.most)
    taylor = SmoothFlight(
        modes.own[f], shared_part.rows, modes.forced[f], shared_part.program, sources, shared_part.potential, shared_part.jets,
        shared_part.probe, shared_part.states, shared_part.columns, shared_part.inputs, shared_part.sums, shared_part.places,
        shared_part.scratch, shared_part.parts, shared_part.value, shared_part.slope, shared_part.rates, shared_part.projected,
        shared_part.bounds, shared_part.paths,
    )  # fmt: skip
    return MotionFlight(modes.pairs[f], modes.matrix[f], taylor, f, modes.owner, modes.current, modes.polynomials)


@cannot_hit.of(SmoothModes)
@inlined
def not_proven(modes, f, z):
    """See `cannot_hit`: there is no proof."""
    return False


@settle.of(SmoothModes)
@shared("none")
def settle_forces(modes, f, z):
    """See `settle`: the smooth forces and their derivatives."""
    flight = flight_of(modes, f)
    taylor = flight.taylor
    paths = taylor.paths
    width = paths.begins.shape[1] - 1
    slot = flight.current[0]
    same = paths.steps[slot, 0] > 0 and flight.owner[slot] == f
    for r in range(width):
        same = same and paths.begins[slot, r] == z[r]
    if same:
        copy_1(paths.coefficients[slot, 0, 0, width:], z[width:])
        return
    program, jets = taylor.program, taylor.jets
    begin_sources(taylor.sources, z)
    copy_1(z[: taylor.states.shape[1]], taylor.states[0])
    expand(taylor, 0.0, 0.0)
    forces = program.forces.shape[0]
    for j in range(forces):
        force = jets[program.forces[j]]
        z[width + j] = force[0]
        z[width + forces + j] = force[1]
        z[width + 2 * forces + j] = 2.0 * force[2]


@renew_loads.of(SmoothModes)
@inlined
def write_loads_again(modes, motion, z):
    """See `renew_loads`."""
    write_loads(modes, motion.counts[BREAK_INDEX], motion.clock, motion.angles, z)


@inlined
def _product_integral(first, second, h):
    """The integral of the product of two polynomials from 0 to h."""
    total = 0.0
    for order in range(2 * ORDER, -1, -1):
        part = 0.0
        for k in range(max(0, order - ORDER), min(order, ORDER) + 1):
            part += first[k] * second[order - k]
        total = total * h + part / (order + 1)
    return total * h


@integrals.of(MotionFlight)
@shared("none")
def piece_integrals(flight, products, z, t, work, out):
    """See `integrals`: of polynomials, step by step."""
    count = products.first.shape[0]
    for c in range(count):
        out[c] = 0.0
    if count == 0 or t == 0.0:
        return
    if find_piece(flight, z, t, ROOM) < 0.0:
        for c in range(count):
            out[c] = math.nan
        return
    paths = flight.taylor.paths
    slot = flight.current[0]
    first, second = flight.polynomials[0], flight.polynomials[1]
    for place in range(paths.steps[slot, 0]):
        begin = paths.times[slot, place]
        if begin >= t:
            break
        for c in range(count):
            h = min(project_step(flight, products.first, c, place, first), t - begin)
            project_step(flight, products.second, c, place, second)
            out[c] += products.weight[c] * _product_integral(first, second, h)


@track_of.of(MotionFlight)
@inlined
def piece_track(flight, value, rate, second, z, duration, parts):
    """See `track_of`."""
    known = find_piece(flight, z, duration, ROOM)
    return track_along(flight.taylor, flight.current[0] if known >= 0.0 else int64(-1), value, duration)


@peak_flight.of(MotionFlight)
@shared("boolean")
def piece_peaks(flight, leave, z, duration, peaks, when, scratch, edge, work):
    """See `peak_flight`: at the ends, and where the velocity changes its sign."""
    state = scratch[3, 0]
    if find_piece(flight, z, duration, ROOM) < 0.0:
        return False
    n = peaks.shape[0]
    for i in range(n):
        raise_peak(i, row_dot(leave, i, z), 0.0, peaks, when)
        on_piece(flight, duration, state)
        end = inner(leave[i], state)
        track = track_of(flight, leave[i], leave[i], leave[i], z, duration, state)
        if track.level <= max(peaks[i], abs(end)):
            raise_peak(i, end, duration, peaks, when)
            continue
        track = track_of(flight, leave[n + i], leave[i], leave[i], z, duration, state)
        sign = int64(0)
        here, f, t, steps = 0.0, 0.0, 0.0, 0
        while True:
            found, before, f_before, here, f, t, steps = next_sign_change(track, 1e-13 * duration, 0.0, 0.0, 0.0, sign, here, f, t, steps)
            if not found:
                break
            if sign != 0:
                turn = refine(track, before, f_before, here, f, 1e-9 * duration)
                on_piece(flight, turn, state)
                raise_peak(i, inner(leave[i], state), turn, peaks, when)
            sign = int64(1) if f > 0.0 else int64(-1)
        if t != math.inf:
            return False
        raise_peak(i, end, duration, peaks, when)
    return True
