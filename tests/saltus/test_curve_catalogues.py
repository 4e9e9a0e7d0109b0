"""Curves on the command line: in catalogues, shown, exported, extended, and families from their points."""

import csv
import json
import shutil

import numpy as np
import pytest

from branches.catalogue import Catalogue
from saltus.__main__ import main
from tests.saltus.running import read_branch, read_json, run, run_refused

SINGLE = "period-1:+:c83c54b8"
START = ("--scene", "impact_oscillator", "--set", "s=-0.08", "--in", "s", "--range=-0.1:0", "--from", "simulate", "--start=-0.66,0")
NARROW, WIDE = "--range=-0.09:0,2.77:2.9", "--range=-0.1:0.01,2.75:3"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A response with a period doubling, the curve of that, and a catalogue with both."""
    folder = tmp_path_factory.mktemp("curves")
    response, curve = str(folder / "r.json"), str(folder / "c.json")
    assert main(["continue", *START, "--json", response]) == 0
    words = ["curve", f"{response}:PD1", "--in", "s,w", NARROW, "--json", curve, "--save", "--catalogue", str(folder / "a.sqlite")]
    assert main(words) == 0
    return folder


@pytest.fixture
def kept(folder):
    return str(folder / "a.sqlite")


@pytest.fixture
def curve(folder):
    return str(folder / "c.json")


@pytest.fixture
def id(kept):
    with Catalogue(kept) as catalogue:
        (row,) = catalogue.curve_rows()
        return row.id


def test_a_curve_and_its_family_are_kept(folder, kept, curve, id, capsys, tmp_path):
    """Oracle: the files of the response and of the curve. A second run changes nothing."""
    with Catalogue(kept) as catalogue:
        assert [row.id for row in catalogue.all_families()] == [SINGLE]
        ((row, edge),) = catalogue.curve_edges(SINGLE)
    assert row.id == id == read_json(curve)["curves"][0]["id"] and edge.source_event == "PD1"
    place = shutil.copy(kept, tmp_path / "b.sqlite")
    code, out, err = run(capsys, "curve", f"{folder / 'r.json'}:PD1", "--in", "s,w", NARROW, "--save", "--catalogue", place)
    assert code == 0 and not err, err
    assert f"known  {SINGLE} in {place}" in out and f"known  {id} in {place}, with s = " in out
    assert f"edge   {SINGLE} PD1: curve; a family of twice the period begins there, not in the catalogue" in out
    code, out, _ = run(capsys, "curve", f"{SINGLE}:PD1", "--in", "w,s", "--range=2.78:2.81,-0.1:0", "--save", "--catalogue", place)
    assert code == 0 and f"known  {id}" in out
    code, out, err = run(capsys, "continue", "--from", f"{folder / 'r.json'}:PD1", "--points", "20", "--catalogue", place)
    assert code == 0, err
    with Catalogue(place) as catalogue:
        ((_, edge),) = catalogue.curve_edges()
        assert edge.source == SINGLE != edge.target and edge.note is None
    code, out, _ = run(capsys, "show", edge.target, "--catalogue", place)
    assert code == 0 and id in out
    code, out, _ = run(capsys, "tree", SINGLE, "--catalogue", place)
    assert code == 0 and "curve" not in out and out.splitlines()[1].startswith("└─ PD1 switch")
    code, out, _ = run(capsys, "path", SINGLE, edge.target, "--catalogue", place)
    assert code == 0 and out.splitlines()[-1] == "1 event"
    code, out, _ = run(capsys, "check", "--catalogue", place, "--json", tmp_path / "check.json")
    assert code == 0 and "1 curve looked at: all hold" in out and read_json(tmp_path / "check.json")["counts"]["curves"] == 1


def test_curves_are_shown(kept, curve, id, capsys, tmp_path):
    """Oracle: the file of the curve."""
    code, out, err = run(capsys, "show", curve, "--json", tmp_path / "again.json", "--plot", tmp_path / "a.png")
    assert code == 0 and not err and out.startswith("curve  PD: ") and "event " in out and "EP2" in out
    assert (tmp_path / "again.json").read_bytes() == open(curve, "rb").read()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = run(capsys, "show", id[:8], "--catalogue", kept, "--json", tmp_path / "b.json", "--plot", tmp_path / "b.png")
    assert code == 0 and not err and (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")
    for words in (f"curve    {id}", "type     period doubling", "ended    at the first point: EP at s = ", SINGLE, "twice the period"):
        assert words in out
    record, (stored,) = read_json(tmp_path / "b.json")["curve"], read_json(curve)["curves"]
    assert record["events"] == stored["events"] and record["edges"][0]["source"] == SINGLE and "parameter" in record["edges"][0]
    assert (record["first"]["name"], record["second"]["name"]) == ("s", "w") and record["window"] == stored["window"]
    code, out, _ = run(capsys, "show", SINGLE, "--catalogue", kept, "--json", tmp_path / "c.json")
    assert code == 0 and ["PD1", id] in [line.split()[:2] for line in out.splitlines()]
    assert [one["curve"] for one in read_json(tmp_path / "c.json")["curves"]] == [id]
    code, out, _ = run(capsys, "list", "--catalogue", kept, "--json", tmp_path / "d.json")
    assert code == 0 and id in [line.split()[0] for line in out.splitlines() if line] and "1 of 1 family" in out
    assert [one["id"] for one in read_json(tmp_path / "d.json")["curves"]] == [id]


def test_curves_are_exported(kept, curve, id, capsys, tmp_path):
    """Oracle: the file of the curve. The exported file is one that `saltus curve` reads."""
    files = [word for kind in ("json", "csv", "npz", "mat") for word in (f"--{kind}", tmp_path / f"e.{kind}")]
    code, out, err = run(capsys, "export", "curves", id, "--catalogue", kept, *files, "--plot", tmp_path / "e.pdf")
    assert code == 0 and not err and out.count("wrote") == 5
    assert (tmp_path / "e.json").read_bytes() == open(curve, "rb").read()
    (stored,) = read_json(curve)["curves"]
    with open(tmp_path / "e.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [[float(row["s"]), float(row["w"])] for row in rows] == [point["parameters"] for point in stored["points"]]
    assert np.load(tmp_path / "e.npz")["s"].tolist() == [point["parameters"][0] for point in stored["points"]]
    code, out, _ = run(capsys, "export", "graph", "--catalogue", kept, "--json", "-")
    (edge,) = json.loads(out)["edges"]
    assert (edge["kind"], edge["curve"], edge["names"]) == ("curve", id, ["s", "w"])
    for kind in ("graphml", "dot"):
        code, _, err = run(capsys, "export", "graph", "--catalogue", kept, f"--{kind}", tmp_path / f"g.{kind}")
        assert code == 0 and id in (tmp_path / f"g.{kind}").read_text()


def test_a_family_starts_at_a_point_of_a_curve(curve, capsys, tmp_path):
    """Oracle: the parameters of the point."""
    (stored,) = read_json(curve)["curves"]
    s, w = stored["points"][9]["parameters"]
    code, out, err = run(capsys, "continue", "--from", f"{curve}:#9", "--in", "s", "--json", tmp_path / "s.json")
    assert code == 0 and out.startswith("start  #9 of ") and "a point of a curve PD at s = " in out, err
    branch = read_branch(tmp_path / "s.json")
    assert branch["values"]["w"] == w and branch["range"] == stored["window"][0]
    assert min(abs(event["values"]["s"] - s) for event in branch["events"] if event["type"] == "PD") < 1e-9
    end = stored["events"][0]
    code, out, err = run(
        capsys, "continue", "--from", f"{curve}:{end['id']}", "--in", "w", "--range", "2.7:3", "--json", tmp_path / "w.json"
    )
    assert code == 0, err
    branch = read_branch(tmp_path / "w.json")
    assert branch["values"]["s"] == end["values"]["s"]
    assert min(abs(event["values"]["w"] - end["values"]["w"]) for event in branch["events"] if event["type"] == "PD") < 1e-9


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("continue --from {c}:#9", ["--in NAME is required"]),
        ("continue --from {c} --in s", ["which event? expected", "EP1, EP2", "#N"]),
        ("continue --from {c}:#999 --in s", ["no such point", "#0 to #"]),
        ("continue --from {c}:#a --in s", ["no such point", "#0 to #"]),
        ("continue --from {c}:2.#1 --in s", ["there is no curve 2", "1 to 1"]),
        ("continue --from {c}:EQ1 --in s", ["no event EQ1", "nearest: EP1"]),
        ("continue --from {c}:EP --in s", ["matches EP1, EP2"]),
        ("continue --from {c}:#1 --in q", ["--in q: no such parameter"]),
        ("continue --from {c}:#1 --in r", ["--range LO:HI is required"]),
        ("continue --from {c}:#1 --in r --range 0.1:0.2", ["has not the start's value r = 0.8"]),
        ("continue --from {c}:#1 --in s --scene impact_oscillator", ["has a system of its own"]),
        ("curve {c} --range=-1:1,1:4 --save", ["--catalogue FILE is required"]),
        ("curve {c} --range=-1:1,1:4 --save --catalogue nothing.sqlite", ["no catalogue nothing.sqlite"]),
        ("curve {c} --range=-1:1,1:4 --catalogue {a}", ["nothing is looked up in a catalogue", "--save"]),
        ("curve {c} --range=-1:1,1:4 --points 3", ["--points 3: the curve has", "points already, expected more"]),
        ("curve FOO:PD1 --in s,w --range=-1:1,1:4 --catalogue {a}", ["no family and no curve FOO", SINGLE]),
        ("curve period-1:PD7 --in s,w --range=-1:1,1:4 --catalogue {a}", ["no event PD7", "nearest: PD1"]),
        ("curve period-1:PD1 --range=-1:1,1:4 --catalogue {a}", ["--in P1,P2 is required"]),
        ("show PD:x --catalogue {a}", ["no curve PD:x"]),
        ("export curves NS: --catalogue {a} --json -", ["no curve NS:"]),
        ("export curves --catalogue {a}", ["missing: --json"]),
    ],
)
def test_what_cannot_be_followed_is_refused(words, parts, curve, kept, capsys):
    """Oracle: one line, exit code 2."""
    line = run_refused(capsys, *words.format(c=curve, a=kept).split())
    assert all(part in line for part in parts), line


@pytest.mark.parametrize(
    "words",
    ["show {f}", "continue --from {f} --in s", "continue --from {f}:#3 --in s", "curve {f} --range=0:1,0:1", "plot {f} --plot a.png"],
)
def test_a_damaged_file_is_refused_for_what_it_is(words, curve, tmp_path, capsys):
    """Oracle: the first half of a file."""
    path = tmp_path / "half.json"
    path.write_text(open(curve, encoding="utf-8").read()[:3000], encoding="utf-8")
    assert "half.json is truncated: it ends in line" in run_refused(capsys, *words.format(f=path).split())


def test_a_catalogue_without_curves_says_so(capsys, tmp_path, kept, folder):
    """Oracle: by hand."""
    place = str(tmp_path / "b.sqlite")
    assert run(capsys, "continue", "--from", f"{folder / 'r.json'}", "--range=-0.1:0", "--catalogue", place)[0] == 0
    assert "has no curve; expected one saved" in run_refused(capsys, "export", "curves", "--catalogue", place, "--json", "-")
    assert "curve" not in run(capsys, "list", "--catalogue", place)[1]
