"""A small catalogue of real families that the tests share, traced once, and copies of a family under other ids."""

import dataclasses
import sqlite3
from contextlib import closing
from functools import cache

import numpy as np

import saltus
from branches.branch import Ended
from branches.catalogue.members import event_orbit
from bvp.multipoint import MultipointProblem

HIGH = 20.0


@cache
def scene():
    """The reference scene."""
    return saltus.load_scene()


@cache
def real():
    """S13O00+, S11O00-, S73O33-, and the family born where the first breaks its symmetry."""
    backbone, out_of_phase, twisted = (saltus.trace(name, energy=(0.05, HIGH)) for name in ("S13O00+", "S11O00-", "S73O33-"))
    return backbone, out_of_phase, twisted, backbone.switch("SB1", energy=(0.05, HIGH))[0]


def renamed(branch, k, **changes):
    """The same points, but for changes, under the id of another family."""
    copy = dataclasses.replace(branch, ended=(Ended(f"COPY{k}", "a copy"), branch.ended[1]), events=(), **changes)
    stem = branch.id.rpartition(":")[0]
    copy.__dict__["full_family"] = dataclasses.replace(branch.full_family, ids=(f"{stem}:{0xC0FFEE00 + k:08x}",))
    return copy


def same_columns(one, other):
    """Whether two sets of columns are the same bit for bit; NaN is NaN."""
    assert set(one) == set(other)
    for name, values in one.items():
        assert values.shape == other[name].shape, name
        if values.dtype.kind != "U":
            assert values.dtype == other[name].dtype, name
            values, given = (array.astype(complex) if array.dtype.kind == "c" else array for array in (values, other[name]))
            bits, given_bits = values.tobytes(), given.tobytes()
            assert bits == given_bits or np.array_equal(np.isnan(values), np.isnan(given)), name
        assert np.array_equal(values, other[name], equal_nan=values.dtype.kind in "fc"), name
    return True


def linear_mode(h):
    """The quarter period of L11+ at an energy, as an orbit from origin to rest without impacts; by the mode's own frequency."""
    system = scene().system
    problem = MultipointProblem(system, ("origin", "rest"), ())
    frequency = system.modes.frequencies[0]
    start = np.zeros(4)
    start[2] = np.sqrt(2.0 * h)
    y = problem.pack(start, np.empty((0, 4)), [0.5 * np.pi / frequency])
    return event_orbit(problem, problem.solve(y, energy=h).y)


def sql(path, *statements):
    """Change a file as another program would; how many rows each statement has changed."""
    with closing(sqlite3.connect(path)) as connection, connection:
        return [connection.execute(statement).rowcount for statement in statements]


def rows(path, *tables):
    """All rows of tables of a file."""
    with closing(sqlite3.connect(path)) as connection:
        return [connection.execute(f"SELECT * FROM {table}").fetchall() for table in tables]
