"""Catalogues of forced responses: `continue --in --catalogue`, `build --in`, and the commands that read them."""

import csv
import json

import numpy as np
import pytest

from branches.catalogue import Catalogue
from saltus.__main__ import main
from tests.branches.catalogue.families import real
from tests.branches.catalogue.families import scene as energies
from tests.saltus.running import read_json, run, run_refused

START = ("--scene", "absorber", "--in", "w", "--range", "0.7:2.2", "--from", "simulate")
FIRST, FOUR, BROKEN, REST = "half-period-1:+:e156061d", "half-period-1:++:7a637640", "period-1:++--:4a51c4e1", "half-period-1::63014008"

# One degree of freedom: a period doubling, the next one, and a grazing.
SMALL = ("--scene", "impact_oscillator", "--set", "s=-0.08", "--in", "s", "--range=-0.1:0.06", "--from", "simulate", "--start=-0.66,0")
SINGLE, DOUBLED = "period-1:+:c83c54b8", "period-2:++:4b944aed"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A catalogue that a build of depth 1 has filled, and the JSON file of the first family."""
    folder = tmp_path_factory.mktemp("responses")
    place = str(folder / "absorber.sqlite")
    assert main(["build", *START, "--depth", "1", "--catalogue", place, "--json", str(folder / "report.json")]) == 0
    assert main(["continue", *START, "--json", str(folder / "first.json")]) == 0
    return folder


@pytest.fixture
def built(folder):
    return str(folder / "absorber.sqlite")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A catalogue of four families of one degree of freedom that a build of depth 2 has filled."""
    place = str(tmp_path_factory.mktemp("small") / "small.sqlite")
    assert main(["build", *SMALL, "--depth", "2", "--catalogue", place]) == 0
    return place


def test_a_build_finds_the_families_that_begin_at_events(folder, built, small, capsys):
    """Oracle: the families that `continue --from FILE:EVENT` follows; the grazing from which the response without impacts goes on."""
    report = json.loads((folder / "report.json").read_text())
    assert report["failed"] == report["lost"] == [] and report["families"] == 3
    code, out, err = run(capsys, "list", "--catalogue", built)
    assert code == 0 and not err and out.splitlines()[-1] == "3 of 3 families"
    assert out.splitlines()[0].split() == ["id", "impacts", "w", "period", "stable", "points", "events"]
    for place, expected in (
        (built, {(FIRST, "GR1", "fold", FOUR, "GR1"), (FIRST, "GR2", "fold", REST, "GR1")}),
        (small, {(SINGLE, "PD1", "switch", DOUBLED, "BP1")}),
    ):
        with Catalogue(place) as catalogue:
            assert expected <= {(e.source, e.source_event, e.kind, e.target, e.target_event) for e in catalogue.edges()}
        code, out, err = run(capsys, "check", "--catalogue", place)
        assert code == 0 and "all hold" in out


def test_a_build_that_is_repeated_changes_nothing(built, capsys):
    """Oracle: the rows of the file."""
    with Catalogue(built) as catalogue:
        before = [row[:15] for row in catalogue.all_families()], catalogue.edges()
    code, out, _ = run(capsys, "build", *START, "--depth", "1", "--catalogue", built)
    assert code == 0 and "done   3 families" in out
    with Catalogue(built) as catalogue:
        assert ([row[:15] for row in catalogue.all_families()], catalogue.edges()) == before


def test_two_workers_give_the_same(small, capsys, tmp_path):
    """Oracle: the catalogue of one."""
    place = str(tmp_path / "two.sqlite")
    assert run(capsys, "build", *SMALL, "--depth", "2", "--workers", "2", "--catalogue", place)[0] == 0
    with Catalogue(small) as one, Catalogue(place) as two:
        assert [row[:15] for row in one.all_families()] == [row[:15] for row in two.all_families()] and one.edges() == two.edges()


def test_continue_keeps_a_response_and_joins_it_to_its_source(folder, capsys, tmp_path, monkeypatch):
    """Oracle: the edges of the build; a run again changes nothing."""
    monkeypatch.chdir(tmp_path)
    first = str(folder / "first.json")
    code, out, err = run(capsys, "continue", *START[:-2], "--from", "simulate", "--catalogue", "a.sqlite")
    assert code == 0 and f"saved  {FIRST} in a.sqlite" in out, err
    code, out, _ = run(capsys, "continue", "--from", f"{first}:GR1", "--catalogue", "a.sqlite", "--json", "four.json")
    assert code == 0 and f"saved  {FOUR}" in out and f"edge   {FIRST} GR1: fold" in out
    code, out, _ = run(capsys, "continue", "--from", "four.json:SB", "--catalogue", "a.sqlite")
    assert code == 0 and out.count(BROKEN) >= 2 and f"edge   {FOUR} SB1: switch" in out, "both mirror images are one family"
    code, out, _ = run(capsys, "continue", *START, "--catalogue", "a.sqlite")
    assert code == 0 and f"known  {FIRST}" in out
    code, out, _ = run(capsys, "path", FIRST, BROKEN, "--catalogue", "a.sqlite")
    assert code == 0 and out.splitlines()[-1] == "2 events" and "GR1: fold at w = 0.98732553" in out
    code, out, _ = run(capsys, "tree", "e156061d", "--catalogue", "a.sqlite")
    assert code == 0 and out.splitlines()[1].startswith(f"└─ GR1 fold at w 0.987326: {FOUR}")
    assert run(capsys, "check", "--catalogue", "a.sqlite")[0] == 0
    code, out, _ = run(capsys, "continue", "--from", f"{first}:GR2", "--catalogue", "b.sqlite")
    assert code == 0 and f"no family with GR2, where {REST} begins" in out
    code, out, err = run(capsys, "continue", *SMALL, "--through", "PD", "--branches", "2", "--catalogue", "c.sqlite")
    assert code == 0 and f"saved  {DOUBLED}" in out and f"edge   {SINGLE} PD1: switch" in out


def test_show_prints_and_draws_a_response(built, capsys, tmp_path):
    """Oracle: the events of the branch."""
    picture = tmp_path / "a.png"
    code, out, err = run(capsys, "show", FIRST, "--catalogue", built, "--plot", picture, "--json", tmp_path / "a.json")
    assert code == 0 and not err and picture.read_bytes().startswith(b"\x89PNG")
    for words in ("closure  half-period-1  sequence +", "in       w = 0.987325537", "period   T = ", "angle 0.9768", FOUR, REST):
        assert words in out
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["family"]["parameter"][0] == pytest.approx(0.9873255373309, rel=1e-12) and "h" not in json.dumps(list(record["family"]))
    assert [event["type"] for event in record["events"]] == ["GR", "NS", "NS", "SN", "GR"]
    assert {event["type"] for event in record["events"] if event["multiplier"] is None} == {"GR"}


def test_export_writes_points_graph_and_figure(folder, small, capsys, tmp_path):
    """Oracle: the numbers of families and points of the list; the JSON is a file of responses."""
    names = {kind: tmp_path / f"a.{kind}" for kind in ("json", "csv", "npz", "mat", "png")}
    files = [text for kind, name in names.items() for text in ("--plot" if kind == "png" else f"--{kind}", name)]
    code, _, err = run(capsys, "export", "response", "--catalogue", small, "--y", "max:x", *files)
    assert code == 0 and not err and names["png"].read_bytes().startswith(b"\x89PNG")
    record = json.loads(names["json"].read_text())
    assert record["kind"] == "response" and {branch["id"] for branch in record["branches"]} >= {SINGLE, DOUBLED}
    count = sum(len(branch["points"]) for branch in record["branches"])
    assert len(np.load(names["npz"])["s"]) == count == len(list(csv.DictReader(names["csv"].open())))
    code, out, _ = run(capsys, "export", "points", SINGLE, "--catalogue", small, "--columns", "event,coefficient", "--csv", "-")
    with Catalogue(small) as catalogue:
        events = catalogue.branch(SINGLE).events
    rows = [line.split(",") for line in out.splitlines()[1:]]
    assert code == 0 and [row for row in rows if row[0]] == [[event.id, repr(event.coefficient or "").strip("'")] for event in events]
    code, out, _ = run(capsys, "export", "points", SINGLE, "--catalogue", small, "--columns", "family,s,max.x", "--csv", "-")
    (points,) = (len(branch["points"]) for branch in record["branches"] if branch["id"] == SINGLE)
    assert code == 0 and out.splitlines()[0] == "family,s,max.x" and len(out.splitlines()) == 1 + points
    for kind in ("json", "graphml", "dot"):
        code, out, _ = run(capsys, "export", "graph", "--catalogue", small, f"--{kind}", "-")
        assert code == 0 and SINGLE in out
    graph = json.loads(run(capsys, "export", "graph", "--catalogue", small, "--json", "-")[1])
    assert graph["graph"] == {"schema": 2, "axes": ["s", "T"]} and {"parameter_low", "period_high", "closure"} <= set(graph["nodes"][0])
    code, out, _ = run(capsys, "export", "response", "--branches", folder / "first.json", "--csv", "-")
    assert code == 0 and len(out.splitlines()) == 1 + sum(len(branch["points"]) for branch in read_json(folder / "first.json")["branches"])
    code, out, _ = run(capsys, "show", folder / "first.json")
    assert code == 0 and out.startswith("branch 1: sequence +")


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        (["show", "half-period-1:+:e1560000"], ["no family whose id begins with", "nearest: half-period-1:+:e156061d"]),
        (["show", "period-1:+:ffff0000"], ["no family whose id", "nearest: "]),
        (["show", "S13O00+"], ["responses in w, which have ids and no labels", "nearest: "]),
        (["show", f"{FIRST}@h=1"], ["expected an id without @"]),
        (["path", FIRST, "S11-"], ["ids and no labels"]),
        (["list", "--label", "U8*"], ["--label needs families in the energy", "holds responses in w"]),
        (["list", "--energy", "1"], ["--energy needs families in the energy"]),
        (["list", "--ends", "origin-stop"], ["no family has the ends", "half-period-1"]),
        (["export", "fep", "--plot", "a.png"], ["saltus export fep needs families in the energy"]),
        (["export", "velocities", "--plot", "a.png"], ["saltus export velocities needs"]),
        (["export", "orbits", "--csv", "-"], ["saltus export orbits needs families in the energy"]),
        (["export", "points", REST, "--columns", "family,max.u3", "--csv", "-"], ["unknown column 'max.u3'", "nearest: max.u"]),
        (["export", "response", "--y", "max:u3", "--plot", "a.png"], ["--y: unknown column 'max:u3'", "nearest: max:u"]),
        (["list", "--scene", "bouncing_ball"], ["belongs to another system"]),
        (["list", "--scene", "absorber", "--set", "F=0.4"], ["parameters.F is 0.3, not 0.4"]),
        (["list", "--scene", "lee2009"], ["belongs to another system"]),
        (["orbit", "S13+@h=1"], ["holds responses in w, and no families in the energy"]),
        (["continue", "S13+", "--save"], ["holds responses in w, and no families in the energy"]),
        (["build", "--energy", "0.06:0.1"], ["holds responses in w, and no families in the energy"]),
        (["build", *START, "--energy", "1:2"], ["--energy belongs to families in the energy"]),
        (["build", "--depth", "2"], ["--depth belongs to responses; expected --in NAME"]),
        (["continue", *START[:2], "--in", "F", "--range", "0.1:0.4", "--from", "simulate"], ["holds responses in w; received one in F"]),
        (["continue", "--scene", "absorber", "--set", "F=0.31", *START[2:]], ["parameters.F is 0.3, not 0.31"]),
    ],
)
def test_what_a_catalogue_of_responses_cannot_do_is_refused(built, capsys, tmp_path, monkeypatch, words, texts):
    """Oracle: the message names what was asked for, and what there is."""
    monkeypatch.chdir(tmp_path)
    message = run_refused(capsys, *words, "--catalogue", built)
    for text in texts:
        assert text in message, message


def test_other_files_are_refused(folder, capsys, tmp_path, monkeypatch):
    """Oracle: one line that names the file and what was expected."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.json").write_text("[1, 2]")
    assert "holds no response" in run_refused(capsys, "export", "response", "--branches", "list.json", "--csv", "-")
    with Catalogue(tmp_path / "energies.sqlite", "a", scene=energies()) as catalogue:
        catalogue.add(real()[0])
    assert "holds families in the energy" in run_refused(capsys, "export", "response", "--catalogue", "energies.sqlite", "--csv", "-")
    words = "holds families in the energy, and no families in a parameter"
    assert words in run_refused(capsys, "continue", *START, "--catalogue", "energies.sqlite")
    assert "--catalogue FILE is required" in run_refused(capsys, "continue", "--from", f"{folder / 'first.json'}:GR1", "--save")
    message = run_refused(capsys, "export", "response", FIRST, "--branches", folder / "first.json", "--csv", "-")
    assert "expected it without --branches" in message


def test_export_joins_only_files_of_one_system(folder, capsys, tmp_path, monkeypatch):
    """Oracle: the difference by hand."""
    monkeypatch.chdir(tmp_path)
    words = "--scene", "absorber", "--from", "simulate", "--points", "5"
    run(capsys, "continue", *words, "--in", "w", "--range", "0.9:1.1", "--set", "F=0.31", "--json", "other.json")
    run(capsys, "continue", *words, "--in", "F", "--range", "0.2:0.4", "--json", "load.json")
    first = folder / "first.json"
    assert "parameters.F is 0.3, not 0.31" in run_refused(capsys, "export", "response", "--branches", first, "other.json", "--csv", "-")
    assert "load.json is in F, and" in run_refused(capsys, "export", "response", "--branches", first, "load.json", "--csv", "-")


def test_a_family_that_sticks_is_kept(tmp_path, capsys):
    """Oracle: the spring and the load press the mass on its plastic stop with cos(t/2) - s. Above s = -1 it leaves, and there is no family
    behind. At s = 0 the contact force at the impact is zero exactly, and the next family begins."""
    place = str(tmp_path / "sticks.sqlite")
    start = ("--from", "simulate", "--start=-0.6,0", "--set", "r=0", "--set", "s=-0.5", "--set", "w=0.5")
    options = ("--scene", "impact_oscillator", "--in", "s", "--range=-1.2:0.2", *start)
    code, out, err = run(capsys, "build", *options, "--catalogue", place)
    assert code == 0, err
    assert "lost   period-1:+=:cee7afeb: GR1 at -1: no family was found at GR1" in out
    with Catalogue(place) as catalogue:
        assert sorted(edge.source_event for edge in catalogue.edges()) == ["GR1", "GR2"]
        assert catalogue.family("period-1:+=:cee7afeb").h == pytest.approx((-1.0, 0.0), abs=1e-10)
    code, out, err = run(capsys, "check", "--catalogue", place)
    assert code == 0 and "all hold" in out, out
