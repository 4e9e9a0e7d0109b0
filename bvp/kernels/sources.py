"""What moves a Taylor flight besides its own state: nothing, or the loads of a simulation (`bvp.kernels.driving`)."""

from typing import NamedTuple

from bvp.kernels.compiled import chosen, inlined, spread
from bvp.kernels.flight import copy_1

ORDER = 22
"""Order of the polynomials. The work of a step grows with its square, its length with eps^(-1/ORDER)."""


class Unforced(NamedTuple):
    """No sources: a conservative flight."""

    columns: int  # of derivatives besides those by the state: 0


def number_of_fours(columns):
    """How many blocks of four contain so many columns."""
    return (columns + 3) // 4


@chosen
def begin_sources(sources, z):
    """A flight begins at a node z."""


@begin_sources.of(Unforced)
@inlined
def begin_nothing(sources, z):
    """See `begin_sources`."""


@chosen
def sources_at(sources, at):
    """Compute the sources at a time of the flight."""


@sources_at.of(Unforced)
@inlined
def nothing_at(sources, at):
    """See `sources_at`."""


@chosen
def plus_source_now(sources, total, r):
    """An acceleration with the source of coordinate r at the time that `sources_at` was given last."""


@plus_source_now.of(Unforced)
@inlined
def plus_nothing_now(sources, total, r):
    """See `plus_source_now`."""
    return total


@chosen
def expand_sources(sources, at):
    """Compute the Taylor coefficients of the sources about a time of the flight."""


@expand_sources.of(Unforced)
@inlined
def expand_nothing(sources, at):
    """See `expand_sources`."""


@chosen
def plus_source(sources, total, k, r):
    """The coefficient of order k of an acceleration, with that of the source of coordinate r."""


@plus_source.of(Unforced)
@inlined
def plus_nothing(sources, total, k, r):
    """See `plus_source`."""
    return total


@chosen
def is_enough(sources, count, with_columns):
    """Whether a flight ends after so many steps."""


@is_enough.of(Unforced)
@inlined
def never_enough(sources, count, with_columns):
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


@chosen
def source_terms(sources, flight, at):
    """Compute the sources of the columns about a time of the flight, from the coefficients of its state."""


@source_terms.of(Unforced)
@inlined
def no_terms(sources, flight, at):
    """See `source_terms`."""


@chosen
def column_source(sources, block, k, r):
    """The coefficients of order k of the sources of coordinate r, for a block of four columns."""


@column_source.of(Unforced)
@inlined
def no_column_source(sources, block, k, r):
    """See `column_source`."""
    return spread(0.0)
