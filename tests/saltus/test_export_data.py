"""`saltus export`: every format read back by another program's reader holds what the catalogue holds."""

import csv
import io
import json
import re
import shutil
import subprocess

import networkx
import numpy as np
import pytest
from scipy.io import loadmat

from branches.catalogue import Catalogue
from tests.branches.catalogue.families import real
from tests.branches.test_diagram import assert_texts_apart
from tests.saltus.running import run


@pytest.fixture
def export(catalogue, capsys, tmp_path):
    """Export to a file of a name; the file and the words."""

    def call(what, name, *words):
        code, out, err = run(capsys, "export", what, *words, f"--{name.rpartition('.')[2]}", tmp_path / name, "--catalogue", catalogue)
        assert code == 0 and not err, err
        return tmp_path / name, out

    return call


@pytest.fixture
def graph(catalogue):
    with Catalogue(catalogue) as opened:
        return opened.graph()


def flat(data):
    """What a format without lists and null can hold."""
    joined = {name: " ".join(value) if isinstance(value, list) else value for name, value in data.items()}
    return {name: value for name, value in joined.items() if value is not None}


def test_node_link_json(export, graph):
    """Oracle: networkx's own reader gives the graph with all attributes."""
    path, out = export("graph", "graph.json")
    back = networkx.node_link_graph(json.loads(path.read_text()), edges="edges")
    assert "note" not in out
    assert dict(back.nodes(data=True)) == dict(graph.nodes(data=True))
    assert list(back.edges(keys=True, data=True)) == list(graph.edges(keys=True, data=True))


def test_graphml(export, graph):
    """Oracle: networkx's own reader gives the flattened graph; the words say how it was flattened."""
    path, out = export("graph", "graph.graphml")
    assert "graphml holds neither lists nor null" in out
    back = networkx.read_graphml(path, force_multigraph=True)
    assert {id: flat(data) for id, data in graph.nodes(data=True)} == dict(back.nodes(data=True))
    ours = [(a, b, key, flat(data)) for a, b, key, data in graph.edges(keys=True, data=True)]
    assert sorted(map(str, back.edges(keys=True, data=True))) == sorted(map(str, ours))


def test_dot(export, graph):
    """Oracle: a node and an edge for each of the graph; Graphviz where it is installed."""
    path, out = export("graph", "graph.dot")
    text = path.read_text()
    assert "dot holds neither lists nor null" in out
    assert len(re.findall(r'^  "[^"]*" \[', text, re.MULTILINE)) == graph.number_of_nodes()
    assert len(re.findall(r'^  "[^"]*" -> "[^"]*" \[', text, re.MULTILINE)) == graph.number_of_edges()
    assert 'h = 0.455585"' in text
    if shutil.which("dot"):
        assert b"<svg" in subprocess.run(["dot", "-Tsvg", path], capture_output=True, check=True).stdout


def expected(name):
    return np.concatenate([branch.points[name] for branch in by_row()])


def by_row():
    """The families in the order of the catalogue."""
    return sorted(real(), key=lambda branch: (1.0 if len(branch.sequence) < 2 else 7.0, branch.points["h"].min(), branch.id))


def test_points_as_npz_and_mat(export):
    """Oracle: the branches' columns, to the last bit; flights of different numbers are taken apart again."""
    columns = "family,point,label,h,alpha,stable,velocities,multipliers,flight_times"
    path, _ = export("points", "points.npz", "--columns", columns)
    data = np.load(path)
    mat = loadmat(export("points", "points.mat", "--columns", columns)[0])
    for name in ("h", "alpha", "stable", "velocities", "multipliers"):
        values = expected(name)
        np.testing.assert_array_equal(data[name], values)
        np.testing.assert_array_equal(mat[name].reshape(values.shape), values)
    flights = [row for branch in by_row() for row in branch.points["flight_times"]]
    offsets = data["flight_times_offsets"]
    for i in (0, 250, len(flights) - 1):
        np.testing.assert_array_equal(data["flight_times"][offsets[i] : offsets[i + 1]], flights[i])
        np.testing.assert_array_equal(mat["flight_times"][i, 0].ravel(), flights[i])
        assert mat["label"][i, 0].item() == data["label"][i] == expected("label")[i]
    assert data["family"][0] == by_row()[0].id and data["point"][0] == 0


def test_points_as_csv_and_json(export):
    """Oracle: the branches' columns; what is not finite is empty or null, stability is true, false or empty."""
    rows = list(csv.DictReader(io.StringIO(export("points", "points.csv")[0].read_text())))
    record = json.loads(export("points", "points.json")[0].read_text())
    assert record["schema"] == 1 and len(record["points"]) == len(rows) == sum(map(len, real()))
    assert [float(row["h"]) for row in rows] == [point["h"] for point in record["points"]] == expected("h").tolist()
    for row, point, tau, stable, multipliers in zip(
        rows, record["points"], expected("tau"), expected("stable"), expected("multipliers"), strict=True
    ):
        assert point["tau"] == (tau if np.isfinite(tau) else None) and (row["tau"] == "") == (point["tau"] is None)
        assert point["stable"] == {1: True, 0: False, -1: None}[int(stable)]
        assert row["stable"] == {1: "true", 0: "false", -1: ""}[int(stable)]
        if np.isfinite(multipliers[0]):
            assert complex(*point["multipliers"][0]) == complex(float(row["multipliers.1.re"]), float(row["multipliers.1.im"]))
            assert complex(*point["multipliers"][0]) == multipliers[0]


def test_points_of_some_families(export):
    """Oracle: the counts of the branches."""
    backbone, *_ = real()
    assert len(export("points", "a.csv", "S13+", "--columns", "h")[0].read_text().splitlines()) == len(backbone) + 1
    assert len(export("points", "b.csv", "--ends", "origin-origin")[0].read_text().splitlines()) == len(real()[3]) + 1


def test_one_of_a_thing_is_reported_in_the_singular(export):
    """Oracle: grammar."""
    assert export("orbits", "one.csv", "S13+@h=1")[1].endswith(": 1 orbit\n")
    assert export("orbits", "two.csv", "S13+@h=1", "S13+@h=2")[1].endswith(": 2 orbits\n")
    assert export("orbits", "sample.csv", "S13+@h=1", "--samples", "1")[1].endswith(": 1 sample\n")
    assert export("graph", "one.json", "S13+")[1].endswith(": 3 nodes, 2 edges\n")
    assert export("graph", "other.json", "U1101+")[1].endswith(": 2 nodes, 0 edges\n")


def test_orbits(export):
    """Oracle: the orbits of the branches at that energy; the motion sampled closes after a period and keeps its energy."""
    record = json.loads(export("orbits", "orbits.json", "--energy", "0.5")[0].read_text())
    exact = {branch.id: pytest.approx(orbit.alpha, rel=1e-9) for branch in real() for orbit in branch.orbits_at(energy=0.5)}
    assert len(record["orbits"]) == len(exact) and {orbit["family"]: orbit["alpha"] for orbit in record["orbits"]} == exact
    assert all(abs(orbit["h"] - 0.5) < 1e-12 and orbit["residual"] < 1e-12 for orbit in record["orbits"])
    data = np.load(export("orbits", "samples.npz", "S13O00+@alpha=1.7", "S73O33-@h=7.3348", "--samples", "50")[0])
    assert data["u"].shape == data["v"].shape == (100, 2)
    np.testing.assert_allclose(data["u"][[0, 50]], data["u"][[49, 99]], atol=1e-9)
    energy = real()[0].system.energy(data["u"], data["v"])
    np.testing.assert_allclose(energy, data["h"], rtol=1e-12)
    assert data["time"][49] == pytest.approx(6.8, rel=1e-12) and data["h"][0] == pytest.approx(0.588748128566, rel=1e-11)
    assert abs(data["alpha"][50] - 1.6459) < 1e-4


def test_a_figure_of_orbits(catalogue, capsys, tmp_path, monkeypatch):
    """Oracles: the words of the panels, one for each orbit, by the name that was given; the motion itself over a period. Texts do not
    overlap."""
    from branches.figures import single

    made = []
    plain = single.orbits_figure
    monkeypatch.setattr(single, "orbits_figure", lambda orbits: made.append(plain(orbits)) or made[-1])
    names, place = ("S13+@h=1", "U1101+@h=0.5", "S73O33-@h=7.3348"), tmp_path / "orbits.png"
    code, out, err = run(capsys, "export", "orbits", *names, "--plot", place, "--catalogue", catalogue)
    assert code == 0 and not err and place.read_bytes().startswith(b"\x89PNG") and out.endswith(": 3 orbits\n")
    (figure,) = made
    assert_texts_apart(figure, "png")
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert len(titles) == 3 and all(name in title for name, title in zip(("S13", "U11", "S73"), titles, strict=True))
    assert "$h = 7.3348$" in titles[2] and "stable" in titles[2]
    lines = figure.findobj(lambda artist: artist.get_gid() == "displacement-0")
    for line, orbit in zip(lines, (real()[0].orbits_at(energy=1.0)[0],), strict=False):
        times, u = line.get_data()
        np.testing.assert_allclose(u, orbit.sample(times)[0][:, 0], atol=1e-12)


def test_a_graph_of_some_families(export):
    """Oracle: the families kept, and the dead end only with its family."""
    nodes = json.loads(export("graph", "some.json", "--ends", "origin-origin")[0].read_text())["nodes"]
    assert [node["id"] for node in nodes if node["kind"] == "family"] == [real()[3].id]
    assert not [node for node in nodes if node["kind"] == "dead end"]
