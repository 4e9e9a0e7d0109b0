"""The commands that read and write a catalogue: list, show, tree, path, check, continue --save, orbit --catalogue."""

import contextlib
import csv
import dataclasses
import json
import os
import re
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import saltus
from branches.catalogue import Catalogue, Edge, EventOrbit
from branches.naming.search import from_other_end
from branches.normal_forms import with_normal_forms
from branches.search.orbit_search import Found
from branches.tracing import follow_family
from saltus.__main__ import main
from saltus.catalogues import default_path
from tests.branches.catalogue.families import linear_mode, real, renamed, scene
from tests.saltus.running import refused, run

ROOT = Path(__file__).parents[2]


def test_list_reports_the_families(catalogue, capsys):
    """Oracle: the branches."""
    code, out, err = run(capsys, "list", "--catalogue", catalogue)
    assert code == 0 and not err and out.splitlines()[-1] == "4 of 4 families"
    for branch in real():
        (line,) = [line for line in out.splitlines() if branch.id in line]
        assert line.split()[0] == branch.label and f" {len(branch)} " in line


def test_list_tells_undecided_families_from_unstable_ones(capsys, tmp_path):
    """Oracle: the column of the points, changed."""
    columns = []
    for stable in (0, -1):
        with Catalogue(tmp_path / f"{stable}.sqlite", "a", scene=scene()) as filled:
            branch = real()[0]
            filled.add(dataclasses.replace(branch, points=branch.points | {"stable": np.full(len(branch), stable)}, events=()))
        columns.append(run(capsys, "list", "--catalogue", tmp_path / f"{stable}.sqlite")[1].splitlines()[1].split()[-3])
    assert columns == ["0%", "undecided"]


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (["--label", "U*"], [3]),
        (["--label", "S13+"], [0]),
        (["--energy", "0.5"], [0, 1, 3]),
        (["--energy", "1", "--stable", "--label", "S*"], [0, 1, 2]),
        (["--energy", "0.3", "--stable", "--label", "S13*"], []),
        (["--ends", "origin-stop"], [0, 1, 2]),
        (["--impacts", "2:7"], [2]),
    ],
)
def test_list_filters(catalogue, capsys, words, kept):
    """Oracle: the families by hand; S13O00+ is stable only above its symmetry breaking at h = 0.4556."""
    code, out, _ = run(capsys, "list", "--catalogue", catalogue, "--json", "-", *words)
    record = json.loads(out)
    assert code == 0 and record["schema"] == 2 and set(record["filters"]) == {word[2:] for word in words if word.startswith("--")}
    families = {family["id"]: family for family in record["families"]}
    assert set(families) == {real()[k].id for k in kept} and all("sequence" in family for family in families.values())
    if real()[2].id in families:
        assert [part["label"] for part in families[real()[2].id]["labels"]] == [alias["label"] for alias in real()[2].aliases]


def test_show_reports_all_of_a_family(catalogue, capsys, tmp_path):
    """Oracle: the branch's events and ends, the neighbours that were connected."""
    branch = real()[0]
    picture, file = tmp_path / "orbit.png", tmp_path / "show.json"
    code, out, err = run(capsys, "show", "S13+@h=1", "--catalogue", catalogue, "--plot", picture, "--json", file)
    assert code == 0 and not err
    for words in (branch.id, "S13O00+", "origin-stop+", "quarter-period problem", "0.45558546", "no admissible neighbour", "L11+"):
        assert words in out
    assert out.count("GR") >= 4 and branch.ended[0].text in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    record = json.loads(file.read_text())
    assert [event["id"] for event in record["events"]] == [event.id for event in branch.events]
    assert {(item["event"], item["to"]["kind"]) for item in record["neighbours"]} == {
        ("SB1", "family"), ("GR1", "linear mode"), ("GR2", "dead end")
    }  # fmt: skip
    assert record["family"]["h"] == [branch.points["h"].min(), branch.points["h"].max()]


def test_show_has_normal_forms(catalogue, capsys, tmp_path):
    """Oracle: those of the branch. The catalogue was filled without them, a second one with them."""
    branch = with_normal_forms(real()[0])
    with Catalogue(tmp_path / "with.sqlite", "a", scene=scene()) as filled:
        filled.add(branch)
    for path in (catalogue, tmp_path / "with.sqlite"):
        code, out, err = run(capsys, "show", branch.id, "--catalogue", path)
        assert code == 0 and not err and "normal form" in out
        (line,) = [line for line in out.splitlines() if line.split()[1:2] == ["SB"]]
        assert branch.event("SB1").normal_form in line
        record = json.loads(run(capsys, "show", branch.id, "--catalogue", path, "--json", "-")[1])
        assert [event["coefficient"] for event in record["events"]] == [event.coefficient for event in branch.events]
        assert [event["criticality"] for event in record["events"]] == [event.criticality for event in branch.events]


def test_show_a_linear_mode(catalogue, capsys):
    """Oracle: the node."""
    code, out, _ = run(capsys, "show", "L11+", "--catalogue", catalogue)
    assert code == 0 and "linear mode  L11+" in out and "0.1185078106" in out and real()[0].id in out


def test_a_meeting_that_both_sides_report_is_shown_once(catalogue, capsys, tmp_path):
    """Oracle: the edges by hand: the grazing of the mode reported by the family too, at the same event and at another; JSON has all."""
    path = tmp_path / "both.sqlite"
    path.write_bytes(catalogue.read_bytes())
    id = real()[0].id
    graze = next(event for event in real()[0].events if event.id == "GR1")
    for event, rows in (("GR1", 1), ("GR2", 2)):
        with Catalogue(path, "a") as filled:
            filled.connect(Edge(id, event, "GR", "linear mode", "L11+", graze.h, graze.alpha, note="reported by the family"))
        code, out, _ = run(capsys, "show", "L11+", "--catalogue", path)
        assert code == 0 and out.count(id) == rows and out.count("reported by the family") == rows - 1
        record = json.loads(run(capsys, "show", "L11+", "--catalogue", path, "--json", "-")[1])
        assert len(record["neighbours"]) == rows + 1


@pytest.mark.parametrize("name", ["S13+@h=1", "S13+", "{id}", "S73O33-@h=7.3348,alpha=1.6459"])
def test_show_says_which_orbit_it_drew(catalogue, capsys, tmp_path, name):
    """Oracle: the branch: the name that is reported selects one orbit, which has the energy that was asked for where one was."""
    branch = real()[2 if name.startswith("S7") else 0]
    code, out, err = run(capsys, "show", name.format(id=branch.id), "--catalogue", catalogue, "--plot", tmp_path / "o.png")
    reported = re.search(r"^wrote  \S+o\.png: the orbit (\S+)@h=(\S+),alpha=(\S+)$", out, re.MULTILINE)
    assert code == 0 and not err and reported
    h, alpha = float(reported[2]), float(reported[3])
    assert min(abs(orbit.alpha - alpha) for orbit in branch.orbits_at(energy=h)) < 1e-4
    if "@h=" in name:
        assert h == float(name.partition("@h=")[2].split(",")[0])
    elif name == "{id}":
        assert h == pytest.approx(float(branch.points["h"][branch.start]), rel=1e-5)


def test_tree_ends(catalogue, capsys):
    """Oracle: each node is opened once; from the born family the way leads over the backbone to the mode and the dead end."""
    code, out, _ = run(capsys, "tree", "U1101+", "--catalogue", catalogue)
    assert code == 0
    lines = out.splitlines()
    assert real()[3].id in lines[0] and real()[0].id in lines[1] and len(lines) == 4
    assert "dead end: no admissible neighbour" in out and "L11+ (linear mode)" in out
    code, out, _ = run(capsys, "tree", "U1101+", "--catalogue", catalogue, "--depth", "1")
    assert "2 more events" in out and len(out.splitlines()) == 3
    record = json.loads(run(capsys, "tree", "L11+", "--catalogue", catalogue, "--json", "-")[1])
    (way,) = record["tree"]["events"]
    assert way["opens"]["id"] == real()[0].id and len(way["opens"]["events"]) == 2


def test_a_tree_with_a_ring_ends(tmp_path, capsys):
    """Oracle: three families in a ring, each reported by both sides: every node is opened once, and named where it is met again."""
    ring = [renamed(real()[0], k) for k in range(3)]
    with Catalogue(tmp_path / "ring.sqlite", "a", scene=scene()) as filled:
        ids = [filled.add(branch) for branch in ring]
        for k in range(3):
            one, other = ids[k], ids[(k + 1) % 3]
            filled.connect(Edge(one, "GR1", "GR", "fold", other, 1.0 + k, 1.7, "GR2"))
            filled.connect(Edge(other, "GR2", "GR", "fold", one, 1.0 + k, 1.7, "GR1"))
    code, out, _ = run(capsys, "tree", ids[0], "--catalogue", tmp_path / "ring.sqlite", "--depth", "9")
    assert code == 0 and len(out.splitlines()) < 12
    assert out.count("GR1 fold at h 1") == 1 and "1 more event" not in out
    for id in ids[1:]:
        assert sum(id in line and "elsewhere" not in line for line in out.splitlines()) == 1


def test_path_is_the_shortest(catalogue, capsys):
    """Oracle: born family, backbone, mode; the events on the way."""
    code, out, _ = run(capsys, "path", "U1101+", "L11+", "--catalogue", catalogue)
    assert code == 0 and out.splitlines()[-1] == "2 events"
    assert "SB1: switch at h = 0.455585465" in out and "GR1" in out
    record = json.loads(run(capsys, "path", "L11+", "U1101+", "--catalogue", catalogue, "--json", "-")[1])
    assert [node["id"] for node in record["nodes"]] == ["L11+", real()[0].id, real()[3].id] and len(record["edges"]) == 2
    code, out, err = run(capsys, "path", "S11-", "S13+", "--catalogue", catalogue)
    assert code == 1 and "no chain of events joins S11- and S13+" in err
    assert run(capsys, "path", "S13+", "S13+", "--catalogue", catalogue)[1].splitlines()[-1] == "0 events"


def test_check_says_that_all_holds(catalogue, capsys):
    """Oracle: the counts; the grazing of the linear mode closes, too."""
    code, out, err = run(capsys, "check", "--catalogue", catalogue)
    assert code == 0 and not err
    points = sum(map(len, real()))
    assert out.startswith(f"4 families, {points} points, ") and "3 edges looked at: all hold" in out


def test_check_reports_what_fails(catalogue, capsys, tmp_path):
    """Oracle: an edge whose target is no family of the catalogue, and an orbit of a mode at another energy."""
    path = tmp_path / "wrong.sqlite"
    path.write_bytes(catalogue.read_bytes())
    before = real()[0]
    with Catalogue(path, "a") as filled:
        orbit = EventOrbit(("origin", "rest"), "", linear_mode(0.2).start, linear_mode(0.2).flight_times)
        filled.connect(Edge("L11+", "", "GR", "fold", before.id, 0.1, 1.84, "GR1", source_orbit=orbit, target_orbit=None))
    code, out, _ = run(capsys, "check", "--catalogue", path, "--json", tmp_path / "check.json")
    *_, last, wrote = out.splitlines()
    assert code == 1 and "h = 0.2" in out and last.endswith("failures") and wrote == f"wrote  {tmp_path / 'check.json'}"
    assert len(json.loads((tmp_path / "check.json").read_text())["failures"]) == out.count("FAILS")


def test_browsing_loads_no_kernels(catalogue):
    """Oracle: the modules that a process has loaded."""
    script = "import sys; from saltus.__main__ import main; code = main(sys.argv[1:]); assert 'numba' not in sys.modules; sys.exit(code)"
    for words in (["list"], ["show", "S13+"], ["tree", "S13+"], ["path", "S13+", "L11+"]):
        command = [sys.executable, "-c", script, *words, "--catalogue", str(catalogue)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr
    command[2] = command[2].replace("numba", "numpy")
    done = subprocess.run([*command[:3], "list", "--catalogue", str(catalogue)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_continue_saves_and_finds_again(tmp_path, capsys, monkeypatch):
    """Oracle: the file of the same run; the family followed from the catalogue is the same family."""
    path = tmp_path / "mine.sqlite"
    words = ["continue", "S13+", "--energy", "0.2:1", "--save", "--catalogue", path]
    code, out, err = run(capsys, *words, "--json", tmp_path / "S13.json")
    assert code == 0 and not err
    branch = saltus.read_branch(tmp_path / "S13.json")
    assert f"saved  {branch.id} in {path}" in out
    assert f"known  {branch.id} in {path}" in run(capsys, *words)[1]
    with Catalogue(path) as kept:
        assert [row.id for row in kept.families()] == [branch.id] and kept.provenance["saltus"] == saltus.__version__
    code, out, _ = run(capsys, "continue", "S13+", "--energy", "0.2:1", "--catalogue", path, "--json", tmp_path / "again.json")
    assert code == 0 and "of origin-stop+::" in out
    assert saltus.read_branch(tmp_path / "again.json").id == branch.id
    # With the catalogue, no search is made.
    monkeypatch.setattr("branches.naming.search.Search.run", lambda *_: pytest.fail("a search was made"))
    code, out, _ = run(capsys, "orbit", "S13+", "--energy", "0.58874812856618", "--catalogue", path)
    assert code == 0 and "alpha = T/4 = 1.7" in out
    with pytest.raises(pytest.fail.Exception):
        main(["orbit", "S13+", "--energy", "0.5"])


def test_continue_saves_the_wider_range(tmp_path, capsys):
    """Oracle: the range that the catalogue has; a run over another range, which lacks a part of it, is refused with both."""
    path = tmp_path / "mine.sqlite"

    def save(energy):
        return run(capsys, "continue", "S13+", "--energy", energy, "--save", "--catalogue", path)

    id = real()[0].id
    assert f"saved  {id} in {path}, with h = 0.3:0.6" in save("0.3:0.6")[1]
    assert f"known  {id} in {path}, with h = 0.3:0.6" in save("0.4:0.5")[1]
    code, out, err = save("0.2:1")
    assert code == 0 and not err and f"wider  {id} in {path}, now with h = 0.2:1; before with h = 0.3:0.6" in out
    code, _, err = save("0.5:2")
    assert code == 1 and err.count("\n") == 1 and f"{id} stays kept in {path} with h = 0.2:1, and not with h = 0.5:2: " in err
    with Catalogue(path) as kept:
        assert kept.family(id).h == pytest.approx((0.2, 1.0), rel=1e-9)


def test_the_default_place(tmp_path, capsys, monkeypatch):
    """Oracle: the user's data folder; another system has a file of its own, so that neither is in the other's way."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    for more in ([], ["--mu", "0.2"]):
        code, out, err = run(capsys, "continue", "S11-", "--energy", "0.2:0.4", "--save", *more)
        assert code == 0 and not err
    assert {entry.name for entry in (tmp_path / "data" / "saltus").iterdir()} == {"lee2009.sqlite", "lee2009-mu0.2.sqlite"}
    assert "1 of 1 family" in run(capsys, "list")[1]
    for words in (["list"], ["show", "S11-"], ["tree", "S11-"], ["path", "S11-", "S11-"]):
        ids = {run(capsys, *words, *more)[1].count("9e0b51fa") for more in ([], ["--mu", "0.2"])}
        assert len(ids) == 2, "both systems have the same family"
    code, _, err = run(capsys, "continue", "S11-", "--mu", "0.2", "--save", "--catalogue", default_path())
    assert code == 2 and "mu is 0.1, not 0.2" in err


def test_a_catalogue_in_use_is_refused_before_the_work(tmp_path, capsys):
    """Oracle: exit code 2 and the process that writes it."""
    path = tmp_path / "used.sqlite"
    script = f"""
import saltus, sys
with saltus.Catalogue({str(path)!r}, "a", scene=saltus.load_scene()):
    print("open", flush=True)
    sys.stdin.read()
"""
    process = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT)
    try:
        process.stdout.readline()
        code, out, err = run(capsys, "continue", "S13+", "--save", "--catalogue", path)
        assert code == 2 and f"process {process.pid} on" in err and not out
    finally:
        process.communicate()
    assert os.listdir(tmp_path) == ["used.sqlite"]


def test_an_empty_catalogue_can_be_browsed(tmp_path, capsys):
    """Oracle: nothing, said in words; names exit 2."""
    path = tmp_path / "empty.sqlite"
    Catalogue(path, "a", scene=scene()).close()
    assert "0 of 0 families" in run(capsys, "list", "--catalogue", path, "--ends", "origin-rest")[1]
    assert "all hold" in run(capsys, "check", "--catalogue", path)[1]
    for name in ("S13+", "abcd", "L11+"):
        code, _, err = run(capsys, "show", name, "--catalogue", path)
        assert code == 2 and "none" in err
    for file in ("graph.dot", "graph.graphml"):
        assert run(capsys, "export", "graph", f"--{file[6:]}", tmp_path / file, "--catalogue", path)[0] == 0
    at_energy = ("orbits", "--npz", "orbits.npz", "--energy", 1)
    tables = ("points", "--csv", "points.csv"), ("points", "--mat", "points.mat"), at_energy
    for what, option, file, *words in (*tables, ("fep", "--plot", "f.png")):
        refused(run(capsys, "export", what, *words, option, tmp_path / file, "--catalogue", path), "has no family")
        assert not (tmp_path / file).exists()


@pytest.mark.parametrize("name", ["with space.sqlite", "what?.sqlite", "half#1.sqlite", "100%25.sqlite", "Übersicht.sqlite", "-.sqlite"])
def test_any_file_name_will_do(tmp_path, capsys, name):
    """Oracle: the file that is there, and only that."""
    with Catalogue(tmp_path / name, "a", scene=scene()) as filled:
        filled.add(real()[0])
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert "1 of 1 family" in run(capsys, "list", "--catalogue", tmp_path / name)[1]


def test_a_family_of_a_catalogue_is_followed_by_any_of_its_names(catalogue, capsys):
    """Oracle: the family's own points: a beginning of its id, a family without a searchable name, a label that it has elsewhere."""
    twisted = real()[2]
    digest = twisted.id.rpartition(":")[2]
    for name, label in ((digest[:6], "S"), ("S53O33+@h=15", "S53O33+")):
        code, out, err = run(capsys, "continue", name, "--energy", "14:16", "--catalogue", catalogue, "--csv", "-")
        assert code == 0 and f"of {twisted.id} in" in err
        rows = [line.split(",") for line in out.splitlines()]
        h, alpha = rows[0].index("h"), rows[0].index("alpha")
        for row in rows[1:]:
            exact = twisted.orbits_at(energy=float(row[h]))
            assert min(abs(orbit.alpha - float(row[alpha])) for orbit in exact) < 1e-9
        assert any(label in cell for cell in rows[1])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
@pytest.mark.parametrize(
    "words",
    [
        "list --json /dev/full --catalogue {catalogue}",
        "show S13+ --json /dev/full --catalogue {catalogue}",
        "export points --csv /dev/full --catalogue {catalogue}",
        "export graph --dot /dev/full --catalogue {catalogue}",
        "discover --energy 0.1 --max-quarter-period 1.5 --json /dev/full",
        "build --catalogue /dev/full",
        "continue S13+ --energy 0.5:0.6 --save --catalogue /dev/full",
    ],
)
def test_a_full_device_is_one_line_and_exit_code_2(catalogue, capsys, words):
    """Oracle: /dev/full, which refuses every byte, and stays alone in its directory; the catalogue is as it was."""
    before = catalogue.read_bytes()
    code, _, err = run(capsys, *words.format(catalogue=catalogue).split())
    assert code == 2 and err.startswith("saltus: cannot write /dev/full: ") and err.count("\n") == 1, err
    assert catalogue.read_bytes() == before and [name for name in os.listdir("/dev") if name.startswith("full")] == ["full"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs limits on a process")
def test_a_limit_on_files_is_named_and_what_was_kept_stays(catalogue, tmp_path):
    """Oracle: the limit, which the system sets; exit code 2, one line, and the families of the file before."""
    path = tmp_path / "mine.sqlite"
    path.write_bytes(catalogue.read_bytes())
    # Less than the log of a family needs, more than its index.
    limit = 40_000
    script = f"""
import resource, sys
import saltus, saltus.families
from saltus.__main__ import main
from tests.branches.catalogue.families import renamed
branch = renamed(saltus.read_branch({str(tmp_path / "branch.json")!r}), 1)
saltus.families.trace = lambda *arguments, **options: branch
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
sys.exit(main(["continue", "S13+", "--save", "--catalogue", {str(path)!r}]))
"""
    real()[2].save(tmp_path / "branch.json")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert f"no file may be larger than {limit} bytes here (ulimit -f)" in done.stderr and "device refused" not in done.stderr
    with Catalogue(path) as kept, Catalogue(catalogue) as old:
        assert [row.id for row in kept.families()] == [row.id for row in old.families()]
    assert sorted(os.listdir(tmp_path)) == ["branch.json", "mine.sqlite"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs limits on a process")
def test_a_limit_on_files_leaves_the_old_one(catalogue, tmp_path):
    """Oracle: the limit, which the system sets; the file of before, and nothing beside it."""
    path = tmp_path / "list.json"
    path.write_text("old")
    script = f"""
import resource, sys
from saltus.__main__ import main
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
sys.exit(main(["list", "--json", {str(path)!r}, "--catalogue", {str(catalogue)!r}]))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2, done.stderr
    assert done.stderr == f"saltus: cannot write {path}: the file would be larger than the system allows (ulimit -f)\n"
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["list.json"]


def test_families_as_tables(catalogue, capsys, tmp_path):
    """Oracle: the JSON of the same command, and the orbits that a discovery lists."""
    files = [word for kind in ("json", "csv", "npz") for word in (f"--{kind}", tmp_path / f"a.{kind}")]
    assert run(capsys, "list", "--catalogue", catalogue, *files)[0] == 0
    families = json.loads((tmp_path / "a.json").read_text())["families"]
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    arrays = np.load(tmp_path / "a.npz")
    for row, family, h in zip(rows, families, arrays["h"], strict=True):
        assert (row["id"], int(row["points"])) == (family["id"], family["points"])
        assert [float(row["h.1"]), float(row["h.2"])] == family["h"] == h.tolist()
    bounds = ("--energy", 0.5, "--max-quarter-period", 2, "--max-impacts", 2)
    assert run(capsys, "discover", *bounds, *files)[0] == 0
    orbits = json.loads((tmp_path / "a.json").read_text())["orbits"]
    assert np.load(tmp_path / "a.npz")["alpha"].tolist() == [orbit["alpha"] for orbit in orbits] and orbits
    assert [row["label"] for row in csv.DictReader((tmp_path / "a.csv").read_text().splitlines())] == [o["label"] for o in orbits]


def test_a_family_has_one_name_in_all_that_is_printed_of_it(capsys, tmp_path):
    """Oracle: the name that the scene cites, U4520-, of a family whose orbits are stored from their other end."""
    place = tmp_path / "a.sqlite"
    with saltus.Catalogue(place, "a", scene=saltus.load_scene()) as catalogue:
        given = saltus.trace("U4520-", energy=(0.2275, 0.24)).orbit(1)
        other = from_other_end(Found(given.problem, given.solution, None))
        branches = [follow_family(one.problem, one.solution.y, energy=(0.2, 0.3)) for one in (given, other)]
        catalogue.add(next(branch for branch in branches if "U4502-" in branch.points["label"]))
        (row,) = catalogue.families()
        (node,) = (data for _, data in catalogue.graph().nodes(data=True) if data["kind"] == "family")
    name = node["label"]
    assert name in ("U4520-", "U3502+", "U4302-")
    found = {"graph": node["labels"]}
    for words in (
        ("list",), ("list", "--csv", "-"), ("show", row.id), ("tree", row.id), ("list", "--json", "-"), ("show", row.id, "--json", "-"),
    ):  # fmt: skip
        code, out, err = run(capsys, *words, "--catalogue", place)
        assert code == 0 and name in out and not re.search(r"U4502-|U3520|U4320", out), (words, err)
        found[" ".join(words)] = sorted({*re.findall(r"\bU[0-9]{4}[+-]", out)})
    assert found["list --json -"] == found[f"show {row.id} --json -"] == found["list"] == sorted(found["graph"])
    assert found["list"] == ["U3502+", "U4302-", "U4520-"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs limits on a process")
def test_a_file_that_could_not_be_filled_is_not_left(tmp_path):
    """Oracle: a limit on the size of files, set by the system in a process of its own: not even the tables of a catalogue fit."""
    path = tmp_path / "a.sqlite"
    script = """
import resource, sys
import saltus
sys.dont_write_bytecode = True
scene = saltus.load_scene()
saltus.Catalogue(sys.argv[1] + ".other", "a", scene=scene).close()
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
try:
    saltus.Catalogue(sys.argv[1], "a", scene=scene)
except RuntimeError as error:
    sys.exit(str(error))
"""
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1 and f"cannot write {path}" in done.stderr and "Traceback" not in done.stderr
    assert os.listdir(tmp_path) == ["a.sqlite.other"]


def test_an_empty_file_becomes_a_catalogue_with_a_word(capsys, tmp_path):
    """Oracle: the family that is kept in it; to read it is refused."""
    path = tmp_path / "a.sqlite"
    path.touch()
    refused(run(capsys, "list", "--catalogue", path), "is not a catalogue: it is empty")
    code, _, err = run(capsys, "continue", "S13+", "--energy", "0.5:0.6", "--save", "--catalogue", path)
    assert code == 0 and f"{path} is empty: a new catalogue is written in its place" in err
    with Catalogue(path) as kept:
        assert len(kept) == 1


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ("UPDATE points SET h = h*1.0000001 WHERE family = 1 AND position = 2", "1 of 6 families does not fit its checksum"),
        ("UPDATE points SET label = 'S1' WHERE position = 2", "6 of 6 families do not fit their checksums"),
        ("DELETE FROM points WHERE family = 1 AND position = 2", "1 of 6 families does not fit its checksum"),
        ("UPDATE arrays SET npz = substr(npz, 2)", "6 of 6 families do not fit their checksums"),
        ("UPDATE events SET h = 2*h", "of the table events does not fit its checksum"),
        ("DELETE FROM events WHERE family = 1", "1 of 6 families does not fit its checksum"),
    ],
)
def test_list_says_that_a_catalogue_is_damaged(catalogue, capsys, tmp_path, change, word):
    """Oracle: the change that was made; without it nothing is said."""
    path = tmp_path / "a.sqlite"
    path.write_bytes(Path(catalogue).read_bytes())
    total = len(Catalogue(path))
    assert run(capsys, "list", "--catalogue", path)[::2] == (0, "")
    with contextlib.closing(sqlite3.connect(path)) as connection:
        assert connection.execute(change).rowcount
        connection.commit()
    code, out, err = run(capsys, "list", "--catalogue", path)
    assert code == 1 and f"{total} of {total} families" in out
    assert f"{path} is damaged" in err and word.replace("6", str(total)) in err and err.count("\n") == 1


def test_list_says_that_pages_are_damaged(catalogue, capsys, tmp_path):
    """Oracle: bytes in the middle of the file, which is no page of the table of families."""
    path = tmp_path / "a.sqlite"
    content = bytearray(Path(catalogue).read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 4096] = b"U" * 4096
    path.write_bytes(content)
    code, _, err = run(capsys, "list", "--catalogue", path)
    assert code != 0 and f"{path} is damaged" in err and err.count("\n") == 1
