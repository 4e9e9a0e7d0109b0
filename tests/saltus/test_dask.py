"""`saltus build --dask ADDRESS`, and `saltus study`: the work goes to a cluster, and nothing changes but where it is done."""

import socket

import pytest

import saltus
from branches.building.build import build
from branches.building.plan import Bounds, BuildPlan
from branches.catalogue import Catalogue
from saltus.__main__ import main
from tests.branches.building.test_frontier import Serial
from tests.branches.catalogue.families import rows
from tests.saltus.running import refused, run
from tests.saltus.test_study import SMALL as STUDY
from tests.saltus.test_study import assert_same, written

distributed = pytest.importorskip("distributed")

SMALL = "build --energy 0.1:0.2 --max-quarter-period 1.9 --max-impacts 2"


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as running:
        yield running


TABLES = ("scene", "families", "points", "events", "nodes", "edges", "work", "progress")
"""All but the provenance, which says when a catalogue was made."""


def test_a_cluster_builds_the_same_catalogue(cluster, tmp_path, capsys):
    """Oracle: the catalogue that is built in this process, one seed after the other: row for row, bit for bit."""
    assert main([*SMALL.split(), "--dask", cluster.scheduler_address, "--catalogue", str(tmp_path / "cluster.sqlite")]) == 0
    out, err = capsys.readouterr()
    assert not err and "complete" in out
    with Catalogue(tmp_path / "serial.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        build(catalogue, BuildPlan.within(Bounds((0.1, 0.2), 1.9, 2)), Serial())
    one, other = (rows(tmp_path / f"{name}.sqlite", *TABLES) for name in ("serial", "cluster"))
    assert len(one[1]) > 3 and one == other


def test_a_cluster_runs_the_same_study(cluster, tmp_path, capsys):
    """Oracle: the study of one process."""
    path = written(tmp_path, STUDY)
    for place in ("--workers", 1), ("--dask", cluster.scheduler_address):
        code, _, err = run(capsys, "study", path, "--out", tmp_path / place[0], *place)
        assert code == 0 and not err
    assert_same(tmp_path / "--dask", tmp_path / "--workers")


def test_a_cluster_draws_the_same_basins(cluster, tmp_path, capsys):
    """Oracle: the basins of this process, in the same blocks."""
    words = "basin --scene damped_impact_oscillator --set w=2.2 --set A=1 --set c=0.02 --grid 24x24".split()
    for place in ("--workers", 1), ("--dask", cluster.scheduler_address):
        code, _, err = run(capsys, *words, *place, "--csv", tmp_path / f"{place[0]}.csv")
        assert code == 0 and not err
    one, other = ((tmp_path / f"{place}.csv").read_bytes() for place in ("--workers", "--dask"))
    assert one == other and len(one.splitlines()) == 577


def refused_address(address, tmp_path, capsys):
    """The line with which an address is refused, before anything is written."""
    err = refused(run(capsys, *SMALL.split(), "--dask", address, "--catalogue", tmp_path / "a.sqlite"))
    assert not list(tmp_path.iterdir())
    return err


@pytest.mark.parametrize("address", ["nonsense", "", "tcp://127.0.0.1", "post://127.0.0.1:8786"])
def test_what_is_no_address(address, tmp_path, capsys):
    """Oracle: exit code 2 and one line that names the address and what one looks like."""
    said = refused_address(address, tmp_path, capsys)
    assert repr(address) in said and "expected an address such as tcp://127.0.0.1:8786" in said


def test_nobody_answers(tmp_path, capsys):
    """Oracle: a port that was free a moment ago."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = "tcp://{}:{}".format(*server.getsockname())
    said = refused_address(address, tmp_path, capsys)
    assert f"no Dask scheduler answers at {address!r}: Connection refused" in said


def test_a_scheduler_without_workers(tmp_path, capsys):
    """Oracle: exit code 2 in place of waiting for ever."""
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as idle:
        assert "has no workers" in refused_address(idle.scheduler_address, tmp_path, capsys)


def test_workers_of_another_version(cluster, tmp_path, capsys, monkeypatch):
    """Oracle: the two versions."""
    monkeypatch.setattr("saltus.__version__", "0.0.1")
    said = refused_address(cluster.scheduler_address, tmp_path, capsys)
    assert "have saltus" in said and "expected 0.0.1" in said


def test_workers_that_cannot_run_saltus(cluster, tmp_path, capsys, monkeypatch):
    """Oracle: the error that a worker raises."""

    def fail():
        raise ModuleNotFoundError("No module named 'saltus'")

    monkeypatch.setattr("saltus.processes._version", fail)
    said = refused_address(cluster.scheduler_address, tmp_path, capsys)
    assert "cannot run saltus: " in said and "No module named 'saltus'" in said
