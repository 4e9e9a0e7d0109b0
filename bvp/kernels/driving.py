"""Loads of a simulation with smooth forces: a kind of sources whose states y are part of the node that a flight begins at."""

import math
from typing import NamedTuple

import numpy as np
from numpy import int64

from bvp.kernels.compiled import inlined, spread
from bvp.kernels.flight import row_dot
from bvp.kernels.jets import extend_jets
from bvp.kernels.sources import (
    ORDER,
    begin_sources,
    column_source,
    expand_sources,
    is_enough,
    keep_step,
    plus_source,
    plus_source_now,
    source_terms,
    sources_at,
)


class DrivingSources(NamedTuple):
    """Loads whose G states y are part of the flight's node (q, p, y), for n coordinates."""

    columns: int  # 0
    push: np.ndarray  # (n, 2 G) accelerations by unit entries of y
    frequency: np.ndarray  # (G,)
    begin: np.ndarray  # (2 G,) scratch: y at the begin of the flight
    now: np.ndarray  # (2 G,) scratch: y at a time
    course: np.ndarray  # (ORDER + 1, 2 G) scratch: Taylor coefficients of y
    most: np.ndarray  # (1,) int64 steps of a flight


@begin_sources.of(DrivingSources)
@inlined
def begin_driven(sources, z):
    """See `begin_sources`."""
    first = 2 * sources.push.shape[0]
    for k in range(sources.begin.shape[0]):
        sources.begin[k] = z[first + k]


@sources_at.of(DrivingSources)
@inlined
def driven_at(sources, at):
    """See `sources_at`."""
    begin, now = sources.begin, sources.now
    for g in range(sources.frequency.shape[0]):
        a = begin[2 * g]
        b = begin[2 * g + 1]
        if sources.frequency[g] > 0.0:
            c = math.cos(sources.frequency[g] * at)
            s = math.sin(sources.frequency[g] * at)
            now[2 * g] = c * a - s * b
            now[2 * g + 1] = s * a + c * b
        else:
            now[2 * g] = a + b * at
            now[2 * g + 1] = b


@plus_source_now.of(DrivingSources)
@inlined
def plus_driven_now(sources, total, r):
    """See `plus_source_now`."""
    for k in range(sources.now.shape[0]):
        total += sources.push[r, k] * sources.now[k]
    return total


@expand_sources.of(DrivingSources)
@inlined
def expand_driven(sources, at):
    """See `expand_sources`."""
    driven_at(sources, at)
    course = sources.course
    for g in range(sources.frequency.shape[0]):
        w = sources.frequency[g]
        a = sources.now[2 * g]
        b = sources.now[2 * g + 1]
        for k in range(ORDER + 1):
            course[k, 2 * g] = a
            course[k, 2 * g + 1] = b
            part = 1.0 / (k + 1)
            if w > 0.0:
                a, b = -w * b * part, w * a * part
            else:
                a, b = (b if k == 0 else 0.0), 0.0


@plus_source.of(DrivingSources)
@inlined
def plus_driven(sources, total, k, r):
    """See `plus_source`."""
    for j in range(sources.now.shape[0]):
        total += sources.push[r, j] * sources.course[k, j]
    return total


@source_terms.of(DrivingSources)
@inlined
def no_driven_terms(sources, flight, at):
    """See `source_terms`."""


@column_source.of(DrivingSources)
@inlined
def no_driven_column_source(sources, block, k, r):
    """See `column_source`."""
    return spread(0.0)


@is_enough.of(DrivingSources)
@inlined
def is_a_piece(sources, count, with_columns):
    """See `is_enough`: a flight with columns has the time that it is given."""
    return count >= sources.most[0] and not with_columns


@keep_step.of(DrivingSources)
@inlined
def keep_all(sources, flight, least, coefficients):
    """See `keep_step`: the coefficients of Z."""
    states, jets, program, course = flight.states, flight.jets, flight.program, sources.course
    size = states.shape[1]
    loads = course.shape[1]
    forces = program.forces.shape[0]
    for i in range(flight.rows.shape[0]):
        jets[i, ORDER] = row_dot(flight.rows, i, states[ORDER])
    extend_jets(program, jets, int64(ORDER), least)
    for k in range(ORDER + 1):
        row = coefficients[k]
        for r in range(size):
            row[r] = states[k, r]
        for j in range(loads):
            row[size + j] = course[k, j]
        at = size + loads
        for j in range(forces):
            force = jets[program.forces[j]]
            row[at + j] = force[k]
            row[at + forces + j] = (k + 1) * force[k + 1] if k < ORDER else 0.0
            row[at + 2 * forces + j] = (k + 1) * (k + 2) * force[k + 2] if k < ORDER - 1 else 0.0
