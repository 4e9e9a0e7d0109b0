"""What moves a Taylor flight besides its own state: nothing, or periodic loads, which come with columns of derivatives.

The loads are g(t) = sum_h C_h cos a + S_h sin a, a = k_h (2 pi p s + w t), on a flight from a node with the time s, as a fraction of the
orbit's period (`bvp.kernels.loads`). Their Taylor coefficients about a time follow from those of cos a and sin a.

A column of derivatives by s or by a released parameter obeys the linearised motion, with a source of its own: the derivative of v' by it,
at a fixed state. All factors of these sources have Taylor coefficients that are known when those of the state are.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import chosen, four_of, inlined, spread
from bvp.kernels.flight import copy_1
from bvp.kernels.loads import Loads

ORDER = 22
"""Order of the polynomials. The work of a step grows with its square, its length with eps^(-1/ORDER)."""


class Unforced(NamedTuple):
    """No sources: a conservative flight."""

    columns: int  # of derivatives besides those by the state: 0


class LoadSources(NamedTuple):
    """Loads on n coordinates, and m released parameters, of which m' = m or 0 change masses, dampers or springs. F smooth forces."""

    columns: int  # 1 + m
    loads: Loads  # of accelerations: (u, v) takes the place of modal coordinates
    change: np.ndarray  # (m', 2 n, 2 n) derivatives of the matrix of z' = B z
    push_slope: np.ndarray  # (m', n, F) derivatives of the accelerations of unit forces
    time: np.ndarray  # (1,) scratch: s
    load: np.ndarray  # (ORDER + 1, n) scratch: coefficients of g
    turned: np.ndarray  # (ORDER + 1, n) scratch: those of sum_h k_h dg_h/da
    changed: np.ndarray  # (m, ORDER + 1, n) scratch: those of g with the derivatives of C and S
    terms: np.ndarray  # (B, ORDER, n, 4) scratch: those of the sources of all columns, in blocks of four
    now: np.ndarray  # (n,) scratch: g at a time


def number_of_fours(columns):
    """How many blocks of four contain so many columns."""
    return (columns + 3) // 4


def make_load_sources(loads, change, push_slope):
    """A `LoadSources`, with its scratch."""
    m, n = len(loads.clock) - 1, loads.modal.shape[-1] // 2
    room = np.zeros((ORDER + 1, n)), np.zeros((ORDER + 1, n)), np.zeros((m, ORDER + 1, n))
    terms = np.zeros((number_of_fours(2 * n + 1 + m), ORDER, n, 4))
    return LoadSources(1 + m, loads, change, push_slope, np.zeros(1), *room, terms, np.zeros(n))


@chosen
def begin_sources(sources, z):
    """A flight begins at a node z."""


@begin_sources.of(Unforced)
@inlined
def begin_nothing(sources, z):
    """See `begin_sources`."""


@begin_sources.of(LoadSources)
@inlined
def begin_loads(sources, z):
    """See `begin_sources`."""
    sources.time[0] = z[2 * sources.now.shape[0]]


@chosen
def sources_at(sources, at):
    """Compute the sources at a time of the flight."""


@sources_at.of(Unforced)
@inlined
def nothing_at(sources, at):
    """See `sources_at`."""


@sources_at.of(LoadSources)
@inlined
def loads_at(sources, at):
    """See `sources_at`."""
    loads, now = sources.loads, sources.now
    n = now.shape[0]
    for r in range(n):
        now[r] = 0.0
    for h in range(loads.harmonics.shape[0]):
        angle = loads.harmonics[h] * (2.0 * math.pi * loads.load_periods * sources.time[0] + loads.clock[0] * at)
        c = math.cos(angle)
        s = math.sin(angle)
        for r in range(n):
            now[r] += loads.modal[0, h, 0, n + r] * c + loads.modal[0, h, 1, n + r] * s


@chosen
def plus_source_now(sources, total, r):
    """An acceleration with the source of coordinate r at the time that `sources_at` was given last."""


@plus_source_now.of(Unforced)
@inlined
def plus_nothing_now(sources, total, r):
    """See `plus_source_now`."""
    return total


@plus_source_now.of(LoadSources)
@inlined
def plus_load_now(sources, total, r):
    """See `plus_source_now`."""
    return total + sources.now[r]


@chosen
def expand_sources(sources, at):
    """Compute the Taylor coefficients of the sources about a time of the flight."""


@expand_sources.of(Unforced)
@inlined
def expand_nothing(sources, at):
    """See `expand_sources`."""


@expand_sources.of(LoadSources)
@inlined
def expand_loads(sources, at):
    """See `expand_sources`."""
    loads, load, turned, changed = sources.loads, sources.load, sources.turned, sources.changed
    orders, n = load.shape
    for k in range(orders):
        for r in range(n):
            load[k, r] = 0.0
            turned[k, r] = 0.0
            for j in range(changed.shape[0]):
                changed[j, k, r] = 0.0
    for h in range(loads.harmonics.shape[0]):
        multiple = loads.harmonics[h]
        rate = multiple * loads.clock[0]
        angle = multiple * (2.0 * math.pi * loads.load_periods * sources.time[0] + loads.clock[0] * at)
        c = math.cos(angle)
        s = math.sin(angle)
        for k in range(orders if multiple > 0.0 else 1):
            for r in range(n):
                cosine = loads.modal[0, h, 0, n + r]
                sine = loads.modal[0, h, 1, n + r]
                load[k, r] += cosine * c + sine * s
                turned[k, r] += multiple * (sine * c - cosine * s)
                for j in range(changed.shape[0]):
                    changed[j, k, r] += loads.modal[1 + j, h, 0, n + r] * c + loads.modal[1 + j, h, 1, n + r] * s
            before = c
            c = -rate * s / (k + 1)
            s = rate * before / (k + 1)


@chosen
def plus_source(sources, total, k, r):
    """The coefficient of order k of an acceleration, with that of the source of coordinate r."""


@plus_source.of(Unforced)
@inlined
def plus_nothing(sources, total, k, r):
    """See `plus_source`."""
    return total


@plus_source.of(LoadSources)
@inlined
def plus_load(sources, total, k, r):
    """See `plus_source`."""
    return total + sources.load[k, r]


@chosen
def is_enough(sources, count, with_columns):
    """Whether a flight ends after so many steps."""


@is_enough.of(Unforced)
@inlined
def never_enough(sources, count, with_columns):
    """See `is_enough`."""
    return False


@is_enough.of(LoadSources)
@inlined
def never_enough_loaded(sources, count, with_columns):
    """See `is_enough`."""
    return False


@chosen
def keep_step(sources, flight, least, coefficients):
    """Keep what was computed of a step: its coefficients (ORDER + 1, N)."""


@keep_step.of(Unforced)
@inlined
def keep_states(sources, flight, least, coefficients):
    """See `keep_step`."""
    for k in range(ORDER + 1):
        copy_1(flight.states[k], coefficients[k])


@keep_step.of(LoadSources)
@inlined
def keep_loaded_states(sources, flight, least, coefficients):
    """See `keep_step`."""
    for k in range(ORDER + 1):
        copy_1(flight.states[k], coefficients[k])


@chosen
def source_terms(sources, flight, at):
    """Compute the sources of the columns about a time of the flight, from the coefficients of its state."""


@source_terms.of(Unforced)
@inlined
def no_terms(sources, flight, at):
    """See `source_terms`."""


@source_terms.of(LoadSources)
@inlined
def load_terms(sources, flight, at):
    """See `source_terms`."""
    loads, turned, terms = sources.loads, sources.turned, sources.terms
    program, states, jets, push = flight.program, flight.states, flight.jets, flight.push
    n = sources.now.shape[0]
    cycle = 2.0 * math.pi * loads.load_periods
    for k in range(ORDER):
        for r in range(n):
            terms[n // 2, k, r, 2 * n % 4] = cycle * turned[k, r]
        for j in range(sources.changed.shape[0]):
            by_clock = loads.clock[1 + j]
            column = 2 * n + 1 + j
            for r in range(n):
                total = sources.changed[j, k, r]
                if by_clock != 0.0:
                    total += by_clock * at * turned[k, r]
                    if k > 0:
                        total += by_clock * turned[k - 1, r]
                terms[column // 4, k, r, column % 4] = total
        for j in range(sources.change.shape[0]):
            column = 2 * n + 1 + j
            for r in range(n):
                total = 0.0
                for c in range(2 * n):
                    total += sources.change[j, n + r, c] * states[k, c]
                for f in range(push.shape[1]):
                    total += sources.push_slope[j, r, f] * jets[program.forces[f], k]
                terms[column // 4, k, r, column % 4] += total
        for d in range(program.changes.shape[0]):
            slope = jets[program.changes[d, 2], k]
            column = 2 * n + 1 + program.changes[d, 1]
            for r in range(n):
                terms[column // 4, k, r, column % 4] += push[r, program.changes[d, 0]] * slope


@chosen
def column_source(sources, block, k, r):
    """The coefficients of order k of the sources of coordinate r, for a block of four columns."""


@column_source.of(Unforced)
@inlined
def no_column_source(sources, block, k, r):
    """See `column_source`."""
    return spread(0.0)


@column_source.of(LoadSources)
@inlined
def load_column_source(sources, block, k, r):
    """See `column_source`."""
    return four_of(sources.terms[block, k, r])
