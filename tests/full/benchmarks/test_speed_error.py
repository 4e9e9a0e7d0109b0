"""Long cases of tests/benchmarks/test_speed_error.py."""

import signal
from dataclasses import replace

import pytest

from benchmarks.peers.integrators import INTEGRATORS
from benchmarks.speed_error.command import measure
from benchmarks.speed_error.tasks import IN_PHASE
from tests.benchmarks.methods import Endless, Plain
from tests.benchmarks.test_speed_error import (
    TINY,
    require_a_run_that_is_ended_from_outside_keeps_its_rows,
    require_integrators_come_nearer_with_their_tolerance,
    rows_in,
)


@pytest.mark.parametrize("method", INTEGRATORS, ids=lambda method: method.integrator)
def test_integrators_come_nearer_with_their_tolerance(method):
    """Oracle: see `require_integrators_come_nearer_with_their_tolerance`."""
    require_integrators_come_nearer_with_their_tolerance(method)


def test_an_endless_work_is_stopped(tmp_path, capsys):
    """Oracle: a work that sleeps at its second setting: one row that says so, and no other setting of its ladder. The first one has the
    time that a process takes to start."""
    effort = replace(TINY, limit=3.0, tolerances=(1e-2, 1e-4, 1e-6), impacts=(), degrees=(), periods=())
    assert measure(tmp_path, effort, [IN_PHASE], [Endless(), Plain()]) == 0
    rows = rows_in(tmp_path)
    assert [(row["method"], row["failed"]) for row in rows] == [
        ("endless", None), ("endless", "not done in 3 s"), ("plain", None), ("plain", None), ("plain", None),
    ]  # fmt: skip


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL], ids=lambda ending: ending.name)
def test_a_run_that_is_ended_from_outside_keeps_its_rows(tmp_path, ending):
    """Oracle: see `require_a_run_that_is_ended_from_outside_keeps_its_rows`."""
    require_a_run_that_is_ended_from_outside_keeps_its_rows(tmp_path, ending)
