"""Exact flight under periodic loads, equation (38): its end and all its derivatives.

The loads are f(t) = sum_h C_h cos(k_h w t) + S_h sin(k_h w t), a constant one having k = 0. In modal coordinates q' = B q + b, and from
rest each harmonic b = Re[c exp(i (phase + nu s))], nu = k w, gives

    q(t) = Re[Psi c exp(i phase)],   Psi(t) = integral of exp(B (t - s)) exp(i nu s) ds, 0 <= s <= t
                                            = (exp(i nu t) - exp(B t)) (i nu - B)^-1

block by block. The second form cancels near resonance, and in a flight that is short beside all periods. There the integral is Gauss's,
in panels so short that its error is far below rounding. Both give the derivative by nu as well.

A node is z = (u, v, s, parameters): displacements, velocities, the time as a fraction of the orbit's period T = 2 pi p/w, where p is the
number of periods of the loads in it, and the released parameters, which do not change along the orbit.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import allocating, chosen, inlined, kernel, shared
from bvp.kernels.flight import (
    APART_LIMIT,
    Flight,
    block_product,
    damped,
    fastest_rate,
    flow_block,
    flow_matrix,
    flow_state,
    growth_rate,
    real_rates,
    set_1,
    set_2,
    times_matrix,
)
from bvp.kernels.flights import comes_with_map, velocity_unit

NEAR_RESONANCE = 30.0
"""Size of a particular solution, beside that far from resonance, above which the integral takes its place."""

SHORT = 0.5
"""Angle that the fastest part turns by in a flight that counts as short."""

PANEL = 8.0
"""Largest angle in a panel: sixteen points integrate exp(8 i s) over 0 <= s <= 1 to 1e-25."""

MOST_PANELS = 1e7
"""A flight that needs more is that of a correction which diverges."""

_nodes, _weights = np.polynomial.legendre.leggauss(16)
GAUSS_NODES = tuple(0.5 * (1.0 + _nodes))
GAUSS_WEIGHTS = tuple(0.5 * _weights)


class Loads(NamedTuple):
    """Periodic loads on a system of n coordinates, and their change with m parameters. H harmonics, of which a constant load is one."""

    harmonics: np.ndarray  # (H,) k
    modal: np.ndarray  # (1 + m, H, 2, 2 n) modal rates from C and S, then their derivatives by each parameter
    clock: np.ndarray  # (1 + m,) w and its derivatives
    load_periods: float  # periods of the base frequency in one of the orbit


class LoadedFlight(NamedTuple):
    """The flight seam under loads: nodes z (N,), N = 2 n + 1 + m."""

    free: Flight
    enter: np.ndarray  # (2 n, 2 n) modal coordinates of (u, v)
    leave: np.ndarray  # (2 n, 2 n) and back
    loads: Loads
    change: np.ndarray  # (m, 2 n, 2 n) change of q' = B q with each parameter, in modal coordinates; (0, ..) where no parameter changes it
    psi: np.ndarray  # (4, 2 n, 2 n) scratch: Psi, real and imaginary, and the same of its derivative by nu
    lines: np.ndarray  # (8, 2 n) scratch
    flow: np.ndarray  # (2 n, 2 n) scratch
    columns: np.ndarray  # (m, 2 n) scratch


@inlined
def off_resonance(flight, k, nu):
    """(i nu - a)(i nu - b) for the two rates of block k, the size of its terms, and the product a b; a single rate counts twice."""
    # The difference of squares (i nu - m)^2 - delta would cancel where the rates are far apart.
    i, j, mean, square, product = flight.pairs[k, 0], flight.pairs[k, 1], flight.mean[k], 0.0, flight.mean[k] ** 2
    if j >= 0:
        square = flight.delta[k]
        product = flight.matrix[i, i] * flight.matrix[j, j] - flight.matrix[i, j] * flight.matrix[j, i]
    return complex(product - nu * nu, -2.0 * mean * nu), nu * nu + mean * mean + abs(square), product


@inlined
def _closed_form(mean, delta, determinant, nu, t):
    """Psi = a + c D of a pair, D^2 = delta, and its derivative by nu: a, c, a', c'."""
    # Equation (38): (i nu - B)^-1 = (i nu - m + D)/((i nu - m)^2 - delta).
    shift = complex(-mean, nu)
    c = 1.0 / complex(determinant - nu * nu, -2.0 * mean * nu)
    a = shift * c
    c_nu = -2.0j * a * c
    a_nu = 1.0j * c - 2.0j * a * a
    cosine, sine = damped(mean, delta, determinant, t)
    turn = complex(math.cos(nu * t), math.sin(nu * t))
    return (
        turn * a - (cosine * a + sine * delta * c),
        turn * c - (cosine * c + sine * a),
        turn * (1.0j * t * a + a_nu) - (cosine * a_nu + sine * delta * c_nu),
        turn * (1.0j * t * c + c_nu) - (cosine * c_nu + sine * a_nu),
    )


@inlined
def _panels(rate, t):
    """Number of panels of a flight of duration t whose fastest part turns at a rate, and the duration of each; nan if they are too many."""
    count = rate * abs(t) / PANEL
    if not count <= MOST_PANELS:
        return 1, math.nan
    panels = max(1, math.ceil(count))
    return panels, t / panels


@kernel
def _integral(mean, delta, determinant, nu, t):
    """The same by Gauss's rule."""
    panels, width = _panels(abs(mean) + math.sqrt(abs(delta)) + nu, t)
    a = complex(0.0, 0.0)
    c = complex(0.0, 0.0)
    a_nu = complex(0.0, 0.0)
    c_nu = complex(0.0, 0.0)
    for panel in range(panels):
        for g in range(16):
            s = (panel + GAUSS_NODES[g]) * width
            cosine, sine = damped(mean, delta, determinant, t - s)
            weight = GAUSS_WEIGHTS[g] * width
            turn = complex(weight * math.cos(nu * s), weight * math.sin(nu * s))
            a += cosine * turn
            c += sine * turn
            a_nu += (cosine * s) * (1.0j * turn)
            c_nu += (sine * s) * (1.0j * turn)
    return a, c, a_nu, c_nu


@kernel
def _single_response(rate, nu, t):
    """The integral of exp(rate (t - s)) exp(i nu s) over 0 <= s <= t, and its derivative by nu."""
    if (abs(rate) + nu) * abs(t) < SHORT:
        a, _, a_nu, _ = _integral(rate, 0.0, rate * rate, nu, t)
    else:
        a, _, a_nu, _ = _closed_form(rate, 0.0, rate * rate, nu, t)
    return a, a_nu


@allocating
def _block_integral(matrix, start, size, nu, t, psi):
    """Psi of a larger block by Gauss's rule, added to zeros."""
    norm = 0.0
    for r in range(start, start + size):
        row = 0.0
        for c in range(start, start + size):
            row += abs(matrix[r, c])
        norm = max(norm, row)
    panels, width = _panels(norm + nu, t)
    for panel in range(panels):
        for g in range(16):
            s = (panel + GAUSS_NODES[g]) * width
            weight = GAUSS_WEIGHTS[g] * width
            block = flow_block(matrix, start, size, t - s)
            real = weight * math.cos(nu * s)
            imaginary = weight * math.sin(nu * s)
            for r in range(size):
                for c in range(size):
                    psi[0, start + r, start + c] += real * block[r, c]
                    psi[1, start + r, start + c] += imaginary * block[r, c]
                    psi[2, start + r, start + c] -= s * imaginary * block[r, c]
                    psi[3, start + r, start + c] += s * real * block[r, c]


@inlined
def load_response(flight, nu, t, psi):
    """Psi of all blocks for one harmonic into psi (4, 2 n, 2 n): real and imaginary parts, and those of its derivative by nu."""
    pairs, mean, delta, matrix = flight
    for part in range(4):
        set_2(psi[part], 0.0)
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j < -1:
            _block_integral(matrix, i, -j, nu, t, psi)
            continue
        distance, size, determinant = off_resonance(flight, k, nu)
        m, square = mean[k], delta[k] if j >= 0 else 0.0
        other = m
        if m < 0.0 < determinant and square * t * t > APART_LIMIT:
            # Psi = far + (near - far)/(slow - fast) (B - fast): what is small beside the slow motion keeps its digits.
            fast, other = real_rates(m, square, determinant)
            a, a_nu = _single_response(fast, nu, t)
            near, near_nu = _single_response(other, nu, t)
            c, c_nu = (near - a) / (other - fast), (near_nu - a_nu) / (other - fast)
        elif NEAR_RESONANCE * abs(distance) <= size or math.sqrt(size) * abs(t) < SHORT:
            a, c, a_nu, c_nu = _integral(m, square, determinant, nu, t)
        else:
            a, c, a_nu, c_nu = _closed_form(m, square, determinant, nu, t)
        parts = (a.real, a.imag, a_nu.real, a_nu.imag)
        factors = (c.real, c.imag, c_nu.real, c_nu.imag)
        for part in range(4):
            psi[part, i, i] = parts[part]
            if j >= 0:
                psi[part, i, i] += factors[part] * (other - matrix[j, j])
                psi[part, j, j] = parts[part] + factors[part] * (other - matrix[i, i])
                psi[part, i, j] = factors[part] * matrix[i, j]
                psi[part, j, i] = factors[part] * matrix[j, i]


@inlined
def turn_load(loads, j, h, z, real, imaginary):
    """real, imaginary (2 n,): the load as Re[(real - i imaginary) exp(i k w s)] after the time s in flight from a node z.

    j: 0, the load itself; 1 + j, its derivative by parameter j. Returns whether it is not zero."""
    cosine = loads.modal[j, h, 0]
    sine = loads.modal[j, h, 1]
    angle = loads.harmonics[h] * 2.0 * math.pi * loads.load_periods * z[real.shape[0]]
    c = math.cos(angle)
    s = math.sin(angle)
    is_loaded = False
    for r in range(real.shape[0]):
        is_loaded = is_loaded or cosine[r] != 0.0 or sine[r] != 0.0
        real[r] = cosine[r] * c + sine[r] * s
        imaginary[r] = sine[r] * c - cosine[r] * s
    return is_loaded


@inlined
def _add_response(pairs, psi, real, imaginary, factor, lines, out):
    """out += factor Re[Psi (real - i imaginary)]. psi: its two parts. lines (2, 2 n): scratch."""
    block_product(pairs, psi[0], real, lines[0])
    block_product(pairs, psi[1], imaginary, lines[1])
    for r in range(out.shape[0]):
        out[r] += factor * (lines[0, r] + lines[1, r])


@kernel
def _add_change(flight, z, t):
    """columns += the change of the flight's end where parameters change masses, dampers and springs: equation (40), by Gauss's rule."""
    free, enter, _, loads, change, psi, lines, flow, columns = flight
    size = enter.shape[0]
    # What decays without turning acts beside both ends of the flight alone: panels are as narrow there, and grow with the distance.
    fastest = fastest_rate(free)
    _, highest = growth_rate(free)
    for k in range(free.pairs.shape[0]):
        if free.pairs[k, 1] < -1:
            highest = fastest
        elif free.mean[k] >= 0.0 or free.delta[k] < 0.0:
            highest = max(highest, abs(free.mean[k]) + math.sqrt(abs(free.delta[k])))
    for h in range(loads.harmonics.shape[0]):
        highest = max(highest, loads.harmonics[h] * loads.clock[0])
    _, widest = _panels(2.0 * highest, t)
    narrowest = 0.5 * PANEL / fastest if fastest > 0.0 else math.inf
    start = lines[0]
    at = 0.0
    while at < abs(t):
        width = min(abs(widest), max(narrowest, min(at, 0.5 * (abs(t) - at))), abs(t) - at)
        for g in range(16):
            s = math.copysign(at + GAUSS_NODES[g] * width, t)
            weight = math.copysign(GAUSS_WEIGHTS[g] * width, t)
            here = lines[1]
            times_matrix(enter, z, start)
            flow_state(free, start, s, here)
            for h in range(loads.harmonics.shape[0]):
                load_response(free, loads.harmonics[h] * loads.clock[0], s, psi)
                turn_load(loads, 0, h, z, lines[6], lines[7])
                _add_response(free.pairs, psi, lines[6], lines[7], 1.0, lines[2:], here)
            for j in range(change.shape[0]):
                times_matrix(change[j], here, lines[2])
                flow_state(free, lines[2], t - s, lines[3])
                for r in range(size):
                    columns[j, r] += weight * lines[3, r]
        at = at + width if at + width > at else abs(t)


@inlined
def add_row(factor, row, out):
    """out += factor row, as far as the row goes."""
    for c in range(row.shape[0]):
        out[c] += factor * row[c]


@inlined
def _compose(pairs, leave, flow, enter, inner_product, out):
    """out[: 2 n, : 2 n] += leave flow enter, row by row; inner_product (2 n, 2 n): scratch. Half of `leave` is often zero."""
    size = enter.shape[0]
    set_2(inner_product, 0.0)
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        if j >= 0:
            for c in range(size):
                inner_product[i, c] = flow[i, i] * enter[i, c] + flow[i, j] * enter[j, c]
                inner_product[j, c] = flow[j, i] * enter[i, c] + flow[j, j] * enter[j, c]
        else:
            for r in range(i, i - j):
                set_1(inner_product[r], 0.0)
                for q in range(i, i - j):
                    add_row(flow[r, q], enter[q], inner_product[r])
    for r in range(size):
        for k in range(size):
            if leave[r, k] != 0.0:
                add_row(leave[r, k], inner_product[k], out[r])


@chosen
def loaded_flight(flight, z, t, out, jacobian):
    """out (N,) = the node z after a flight of duration t, before any impact; jacobian (N, N): its derivative by z."""


@loaded_flight.of(LoadedFlight)
@shared("none")
def exact_loaded_flight(flight, z, t, out, jacobian):
    """See `loaded_flight`."""
    free, enter, leave, loads, change, psi, lines, flow, columns = flight
    size = enter.shape[0]
    parameters = z.shape[0] - size - 1
    q = lines[4]
    by_time = lines[5]
    cycle = 2.0 * math.pi * loads.load_periods
    w = loads.clock[0]
    set_2(jacobian, 0.0)
    # Equation (38): free flight of the start, and what the loads give from rest.
    flow_matrix(free, t, flow)
    times_matrix(enter, z, lines[0])
    block_product(free.pairs, flow, lines[0], q)
    set_1(by_time, 0.0)
    for j in range(parameters):
        set_1(columns[j], 0.0)
    for h in range(loads.harmonics.shape[0]):
        k = loads.harmonics[h]
        load_response(free, k * w, t, psi)
        real = lines[6]
        imaginary = lines[7]
        turn_load(loads, 0, h, z, real, imaginary)
        _add_response(free.pairs, psi, real, imaginary, 1.0, lines, q)
        for j in range(parameters):
            if loads.clock[1 + j] != 0.0:
                _add_response(free.pairs, psi[2:], real, imaginary, k * loads.clock[1 + j], lines, columns[j])
        # The phase turns real into imaginary, and imaginary into -real.
        for r in range(size):
            real[r] = -real[r]
        _add_response(free.pairs, psi, imaginary, real, k * cycle, lines, by_time)
        for j in range(parameters):
            if turn_load(loads, 1 + j, h, z, real, imaginary):
                _add_response(free.pairs, psi, real, imaginary, 1.0, lines, columns[j])
    if change.shape[0] > 0:
        _add_change(flight, z, t)
    times_matrix(leave, q, out[:size])
    times_matrix(leave, by_time, lines[0])
    for r in range(size):
        jacobian[r, size] = lines[0, r]
    for j in range(parameters):
        times_matrix(leave, columns[j], lines[0])
        for r in range(size):
            jacobian[r, size + 1 + j] = lines[0, r]
    _compose(free.pairs, leave, flow, enter, psi[0], jacobian)
    advance_time(loads, z, t, out, jacobian)


@inlined
def advance_time(loads, z, t, out, jacobian):
    """The entries of a node behind its state, after a flight of duration t: the time and the parameters. Their derivatives, where they are
    not zero."""
    size = z.shape[0] - loads.clock.shape[0]
    cycle = 2.0 * math.pi * loads.load_periods
    out[size] = z[size] + t * loads.clock[0] / cycle
    jacobian[size, size] = 1.0
    for j in range(loads.clock.shape[0] - 1):
        out[size + 1 + j] = z[size + 1 + j]
        jacobian[size + 1 + j, size + 1 + j] = 1.0
        jacobian[size, size + 1 + j] = t * loads.clock[1 + j] / cycle


@chosen
def loaded_rate(flight, z, out):
    """out (N,) = z' of a node in flight."""


@velocity_unit.of(LoadedFlight)
@inlined
def loaded_velocity_unit(flight, end, velocity, duration):
    """See `velocity_unit`: forces are no larger than displacements."""
    return velocity


@comes_with_map.of(LoadedFlight)
@inlined
def comes_alone(flight):
    """See `comes_with_map`."""
    return False


@loaded_rate.of(LoadedFlight)
@inlined
def exact_loaded_rate(flight, z, out):
    """See `loaded_rate`."""
    free, enter, leave, loads, _, _, lines, _, _ = flight
    size = enter.shape[0]
    times_matrix(enter, z, lines[0])
    block_product(free.pairs, free.matrix, lines[0], lines[1])
    for h in range(loads.harmonics.shape[0]):
        turn_load(loads, 0, h, z, lines[2], lines[3])
        for r in range(size):
            lines[1, r] += lines[2, r]
    times_matrix(leave, lines[1], out[:size])
    set_1(out[size:], 0.0)
    out[size] = loads.clock[0] / (2.0 * math.pi * loads.load_periods)
