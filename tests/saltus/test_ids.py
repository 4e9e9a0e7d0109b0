"""Ids as names: of families without a label, in scenes of every kind, with a catalogue and without one."""

import json
import os
import sys

import pytest

import saltus
from branches.presentation import closed_presentation
from branches.search.discovery import discover_orbits
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from tests.branches.catalogue.families import real, renamed
from tests.saltus.running import refused, run

ONE_SIDED = """
[system]
mass = [[0.1, 0.0], [0.0, 1.0]]
stiffness = [[0.1, -0.1], [-0.1, 1.1]]
[[stops]]
c = [1.0, -1.0]
upper = 1.0
[bounds]
energy = [0.1, 2.0]
quarter_period = 4.0
impacts = 3
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A file of a scene whose gap is bounded on one side."""
    path = tmp_path_factory.mktemp("one_sided") / "one.toml"
    path.write_text(ONE_SIDED)
    return path


@pytest.fixture(scope="module")
def branches(scene):
    """Its families at one energy, with one impact in half a period at most, by id."""
    system = saltus.load_scene(scene).system
    found = [
        orbit
        for pair in ("rest-stop", "rest-rest")
        for orbit in discover_orbits(system, 1.0, quarter_period=4.0, impacts=1, ends=(pair,)).orbits
    ]  # fmt: skip
    followed = [follow_family(orbit.problem, orbit.solution.y, energy=(0.8, 1.2)) for orbit in found]
    assert len(followed) == 3
    return {branch.id: branch for branch in followed}


def test_the_families_of_a_one_sided_scene_are_followed_by_id(capsys, scene, branches):
    """Oracle: the branches that were followed from what a search at one energy finds."""
    for id, branch in branches.items():
        code, out, err = run(capsys, "continue", id, "--scene", scene, "--energy", "0.8:1.2", "--json", "-")
        data = json.loads(out)
        assert code == 0 and data["branch"]["id"] == id, err
        point = data["points"][len(data["points"]) // 3]  # the middle of a symmetric family is its least energy
        assert any(orbit.alpha == pytest.approx(point["alpha"], rel=1e-9) for orbit in branch.orbits_at(energy=point["h"]))


def test_an_orbit_and_a_motion_of_a_one_sided_scene_are_named_by_id(capsys, scene, branches):
    """Oracle: the branch's own orbit at that energy."""
    id, branch = next(iter(branches.items()))
    alpha = branch.orbit_at(energy=1.0).alpha
    code, out, _ = run(capsys, "orbit", f"{id}@h=1", "--scene", scene, "--json", "-")
    assert code == 0 and json.loads(out)["orbit"]["alpha"] == pytest.approx(alpha, rel=1e-10)
    code, out, _ = run(capsys, "run", "--on", id, "--energy", "1", "--scene", scene, "--duration", "1", "--json", "-")
    assert code == 0 and json.loads(out)["initial"]["on"]["alpha"] == pytest.approx(alpha, rel=1e-10)


@pytest.fixture(scope="module")
def kept(scene, branches, tmp_path_factory):
    """A catalogue of these families."""
    path = tmp_path_factory.mktemp("one_sided") / "one.sqlite"
    with saltus.Catalogue(path, "a", scene=saltus.load_scene(scene)) as catalogue:
        for branch in branches.values():
            catalogue.add(branch)
    return path


@pytest.mark.parametrize("command", [("orbit",), ("continue", "--points", "5"), ("run", "--duration", "1", "--on")])
def test_a_part_of_an_id_names_the_family_for_every_command(capsys, scene, branches, kept, command):
    """Oracle: what the command reports for the whole id."""
    id = next(id for id, branch in branches.items() if not branch.label)
    given = ["--energy", "0.9:1.1"] if "continue" in command else []

    def report(name):
        return run(capsys, *command, name, *given, "--scene", scene, "--catalogue", kept)

    suffix = "@h=1"
    whole = report(id + suffix)
    assert whole[0] == 0 and id in whole[1], whole[2]
    hash = id.rpartition(":")[2]
    for part in (hash, hash[:4], id[:-4], f"{id[:6]}..:{hash}"):
        assert report(part + suffix) == whole
    refused(report("00000000@h=1"), str(kept), "begins with '00000000'", id)
    refused(report("rest@h=1"), "3 families have an id that begins with 'rest'", id)


def test_orbits_without_a_label_are_listed_by_id(capsys, scene, branches, kept):
    """Oracle: the branch's quarter period at the energy, and at another one that does not exist."""
    id, branch = next((id, branch) for id, branch in branches.items() if not branch.label)
    alpha = branch.orbit_at(energy=1.0).alpha
    asked = ("--energy", "1", "--alpha", repr(2 * alpha), "--scene", scene, "--catalogue", kept)
    refused(run(capsys, "orbit", id, *asked), f"nearest: {id}@h=1,alpha={alpha:.6g}")


def test_a_search_without_a_catalogue_names_orbits_that_have_no_label(capsys, scene, branches):
    """Oracle: the ids of the branches; the family that is followed by that name passes through the orbit."""
    code, out, err = run(capsys, "discover", "--energy", "1", "--max-impacts", "1", "--scene", scene, "--json", "-")
    data = json.loads(out)
    assert code == 0 and {orbit["family"] for orbit in data["orbits"]} == set(branches) and all(id in err for id in branches)
    orbit = data["orbits"][0]
    selected = ("--energy", "1", "--alpha", repr(orbit["alpha"]))
    code, out, err = run(capsys, "orbit", orbit["family"], *selected, "--scene", scene, "--json", "-")
    assert code == 0 and json.loads(out)["orbit"]["alpha"] == pytest.approx(orbit["alpha"], rel=1e-10), err


def second_fails(monkeypatch, error):
    """Let the second family that is followed fail."""
    followed, asked = follow_family, []

    def fails(*arguments, **options):
        asked.append(arguments)
        if len(asked) == 2:
            raise error
        return followed(*arguments, **options)

    monkeypatch.setattr("branches.tracing.follow_family", fails)


@pytest.mark.parametrize(("error", "code"), [(RuntimeError("it is lost"), 0), (KeyboardInterrupt(), 130)])
def test_a_family_that_cannot_be_followed_leaves_the_others(capsys, scene, branches, monkeypatch, tmp_path, error, code):
    """Oracle: the same search where all are followed; a note, or after an interrupt the ids before it."""
    words = ("discover", "--energy", "1", "--max-impacts", "1", "--scene", scene, "--json")
    assert run(capsys, *words, tmp_path / "whole.json")[0] == 0
    second_fails(monkeypatch, error)
    ended, out, err = run(capsys, *words, tmp_path / "cut.json")
    whole, cut = (json.loads((tmp_path / f"{name}.json").read_text())["orbits"] for name in ("whole", "cut"))
    expected = [orbit["family"] for orbit in whole]
    expected[1] = None
    if code:
        expected[2:] = [None] * len(expected[2:])
        assert err.startswith("saltus: interrupted; the search is complete") and err.count("\n") == 1
    else:
        assert f"note   the orbit at alpha = {whole[1]['alpha']:.8g} has no id: it is lost\n" in out and err == ""
    assert ended == code and [orbit["family"] for orbit in cut] == expected and len(expected) == 3
    assert all(f"{orbit['alpha']:.8g}" in out for orbit in whole) and expected[0] in out


def test_orbits_that_lie_on_no_family_of_a_catalogue_have_ids_too(capsys, scene, branches, tmp_path):
    """Oracle: the search without a catalogue; the catalogue knows one family of three. Python hands out what the catalogue knows."""
    path, known = tmp_path / "one.sqlite", next(iter(branches))
    with saltus.Catalogue(path, "a", scene=saltus.load_scene(scene)) as catalogue:
        catalogue.add(branches[known])
    words = ("discover", "--energy", "1", "--max-impacts", "1", "--scene", scene, "--catalogue", path, "--json", "-")
    code, out, err = run(capsys, *words)
    assert code == 0 and {orbit["family"] for orbit in json.loads(out)["orbits"]} == set(branches)
    assert "families 1 of the catalogue; 2 orbits lie on none of it" in err
    with saltus.Catalogue(path) as catalogue:
        found = saltus.discover(catalogue.system, 1.0, quarter_period=4.0, impacts=1, catalogue=catalogue)
        assert set(found.families) == {known, None}


@pytest.mark.parametrize("name", ["L11+", "S13O00+"])
def test_a_scene_without_labels_expects_no_label(capsys, scene, name):
    """Oracle: labels need an origin, which a gap bounded on one side does not have; its families have ids."""
    err = refused(run(capsys, "continue", name, "--scene", scene), name, "expected the id of a family", "saltus discover")
    assert "S11O00" not in err


def test_an_id_that_no_family_has_is_answered_with_those_that_exist(capsys, scene, branches):
    """Oracle: the ids with the same ends and sequence."""
    there = [id for id in branches if "stop" in id]
    refused(run(capsys, "continue", "rest-stop+::12345678", "--scene", scene), "rest-stop+::12345678", *there)
    refused(run(capsys, "continue", "rest-stop+::12345678@h=1", "--scene", scene), "no orbit rest-stop+::12345678")
    id = next(id for id in branches if "stop" in id)
    refused(run(capsys, "continue", f"{id}@h=1,alpha=3.9", "--scene", scene), "alpha = 3.9", "@h=1,alpha=")


@pytest.mark.parametrize(
    ("id", "meets", "energy", "event"),
    [
        ("periodic:+-:60a5a8a0", "origin-origin:+:eaae1c2a", "0.05:0.1", "SB1"),
        ("periodic:++--:7cedfa25", "origin-stop+:-:fbaea3dc", "0.17:0.3", "GR2"),
    ],
)
def test_a_family_without_a_reversal_is_found_by_id_and_at_the_event_where_it_begins(capsys, tmp_path, id, meets, energy, event):
    """Oracle: the id of the family that begins at the event of the family that it meets, as the catalogue of the scene has both."""
    path = tmp_path / "family.json"
    code, out, err = run(capsys, "continue", id, "--energy", energy, "--json", "-")
    assert code == 0 and json.loads(out)["branch"]["id"] == id, err
    assert run(capsys, "continue", meets, "--energy", energy, "--json", path)[0] == 0
    code, out, err = run(capsys, "continue", "--from", f"{path}:{event},{id}", "--energy", energy, "--json", "-")
    assert code == 0 and json.loads(out)["branch"]["id"] == id, err
    wrong = f"{id[:-8]}00000000"
    refused(run(capsys, "continue", "--from", f"{path}:{event},{wrong}"), f"{wrong} begins at {event}", f"{event},{id[:-9]}")


@pytest.mark.skipif(sys.platform == "win32", reason="the data folder is given by a variable of this system")
@pytest.mark.parametrize("saves", [False, True])
def test_an_id_is_looked_up_in_the_scenes_own_catalogue(capsys, tmp_path, monkeypatch, saves):
    """Oracle: a family with an id that no search finds: only the catalogue has it."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    os.makedirs(tmp_path / "saltus")
    kept = renamed(real()[3], 0)
    with saltus.Catalogue(tmp_path / "saltus" / "lee2009.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        catalogue.add(kept)
    save = ["--save", "--catalogue", tmp_path / "other.sqlite"] if saves else []
    code, out, err = run(capsys, "continue", kept.id, "--points", "5", *save)
    assert code == 0 and f"of {kept.id} in" in out, err
    h = float(kept.points["h"][len(kept) // 2])
    for words in (["orbit", kept.id], ["run", "--duration", "1", "--rho", "0.7", "--on", kept.id]):
        code, _, err = run(capsys, *words, "--energy", repr(h))
        assert code == 0, err
    refused(run(capsys, "orbit", kept.id, "--energy", repr(h), "--mu", "0.11"), f"no orbit {kept.id} found")


@pytest.mark.skipif(sys.platform == "win32", reason="the data folder is given by a variable of this system")
@pytest.mark.parametrize("part", [False, True])
def test_a_catalogue_of_its_own_that_cannot_be_used_is_not_passed_over(capsys, tmp_path, monkeypatch, part):
    """Oracle: the words on a file that is no catalogue, on one of another system, and where there is none."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    os.makedirs(tmp_path / "saltus")
    kept = real()[3]
    name = kept.id.rpartition(":")[2] if part else kept.id
    place = tmp_path / "saltus" / "lee2009.sqlite"
    on = f"{name}@h={kept.points['h'][len(kept) // 2]}"
    for command in (["continue", name, "--points", "2"], ["run", "--duration", "1", "--on", on]):
        place.write_text("no catalogue\n" * 100)
        refused(run(capsys, *command), f"{place} is not a catalogue")
        place.unlink()
        with saltus.Catalogue(place, "a", scene=saltus.load_scene(mu=0.2)):
            pass
        refused(run(capsys, *command), f"{place} belongs to another system: there mu is 0.2, not 0.1")
        place.unlink()
    if part:
        refused(run(capsys, *command), f"{name} is a part of an id, and no catalogue is there")
    else:
        code, _, err = run(capsys, "continue", name, "--points", "2")
        assert code == 0, err


def test_a_tree_of_one_family_says_why_it_has_no_neighbours(capsys, tmp_path):
    """Oracle: --save of one family; the command that finds neighbours."""
    path = tmp_path / "a.sqlite"
    assert run(capsys, "continue", "S13O00+", "--energy", "0.2:0.4", "--save", "--catalogue", path)[0] == 0
    code, out, _ = run(capsys, "tree", "S13+", "--catalogue", path)
    assert code == 0 and len(out.splitlines()) == 2 and out.splitlines()[1].startswith("note   ") and "saltus build" in out


SHIPPED = [
    ("origin-origin:++-+--+-++:a699c366", (5.0, 60.0)),
    ("origin-origin:++-+:ee82e1c3", (9.83056475696501, 14.55370108913408)),
    ("stop+-stop-:++---++-+:ba5424b7", (29.748149319417674, 29.750000166142282)),
    ("rest-stop+:--++--+-:35277757", (20.0, 60.0)),
    ("stop+-stop+:-++--:9d56599a", (1.6597279271953347, 1.781286771907527)),
    ("periodic:++--:7cedfa25", (0.2, 0.21)),
    ("periodic:++-+-+-:edf23254", (0.2786411393988897, 0.29829698254231996)),
    ("periodic:+++-+-+-+--:8212214a", (10.0, 14.0)),
    ("periodic:++-++-+-+-:6d755b34", (0.3862234389472785, 0.6042488024451786)),
    ("periodic:++-+-+-+-++-+--+-:deb73ac0", (31.568088023332002, 47.6530956448421)),
    ("periodic:+++++---++----++----:fede24cb", (66.84681334648717, 73.92533020054627)),
    ("periodic:++-++-+-+-+-+-+-:3bbc9664", (2.3445300357160326, 2.3603990148707448)),
]
"""Families of the catalogue that `saltus build` makes of the shipped scene, each with a range of energies in which it has orbits: a small
part of the range, the whole family, two that are narrow, and one that few starts lead to; three without a reversal that begin at grazings,
with an impact more, an impact less, and several less; two that have three and two periods of the grazing orbit; one that is followed past
its fold from nearly all of its impacts; and one that begins at an SB of a family to which few starts lead.
`tests/full/test_shipped_scene.py` takes all."""


@pytest.mark.parametrize(("id", "energy"), SHIPPED)
def test_an_id_of_the_shipped_catalogue_is_found_without_it(id, energy):
    """Oracle: the id, which a build computed from families that it reached along others."""
    assert saltus.trace(id, energy=energy, points=5).id == id


def test_an_id_does_not_depend_on_the_impact_at_which_the_period_begins():
    """Oracle: the id in the presentation of a build. From one of the 20 impacts, either way in time, the run gets stuck at the fold."""
    id, energy = SHIPPED[-2]
    branch = saltus.trace(id, energy=energy)
    cycle = cycle_of(branch.problem, branch.unknowns(branch.start))
    for image in (closed_presentation(cycle, first=first, backwards=back) for first in range(10, 14) for back in (False, True)):
        problem = MultipointProblem(branch.system, image.ends, image.sequence)
        assert follow_family(problem, image.unknowns(problem), points=1).id == id


def test_a_family_with_two_periods_of_the_grazing_orbit_begins_there(tmp_path, capsys):
    """Oracle: the period, twice that of the grazing orbit."""
    path, (id, _) = tmp_path / "family.json", SHIPPED[-3]
    assert run(capsys, "continue", "origin-stop+:+-:2867119e", "--energy", "40:60", "--json", path)[0] == 0
    code, out, err = run(capsys, "continue", "--from", f"{path}:GR1,{id}", "--energy", "40:60", "--json", "-")
    assert code == 0, err
    branch, parent = json.loads(out), json.loads(path.read_text())
    touch = next(event for event in parent["events"] if event["id"] == "GR1")
    met = [event for event in branch["events"] if event["type"] == "GR" and abs(event["h"] / touch["h"] - 1.0) < 1e-9]
    assert branch["branch"]["id"] == id and met and abs(met[0]["alpha"] / (2.0 * touch["alpha"]) - 1.0) < 1e-9


def test_a_family_that_was_found_by_its_id_has_its_events():
    """Oracle: the symmetry breaking of the family at h = 27.010136146917, of an independent computation."""
    branch = saltus.trace(SHIPPED[0][0], energy=(26.9, 27.1))
    assert any(event.type == "SB" and abs(event.h - 27.010136146917) < 1e-9 for event in branch.events)


def test_an_id_that_is_not_there_is_refused_with_the_bounds_and_what_is_there(capsys):
    """Oracle: the family that has these ends and this sequence."""
    refused(
        run(capsys, "continue", "origin-origin:++-+--+-++:00000000", "--energy", "26:27"), "h in 26:27", "quarter period up to 10",
        "there are origin-origin:++-+--+-++:a699c366",
    )  # fmt: skip
    above = run(capsys, "continue", "origin-origin:++-+--+-++:a699c366", "--energy", "30:60")
    refused(above, "h = 25.53", "outside the energy range 30:60")


def test_pieces_of_one_family_are_one_match():
    """Oracle: the range of energies with which one piece is followed into the other. From h = 1 to 30 the family has four pieces of the
    orbit S11+; above h = 30 it turns."""
    scene = saltus.load_scene("cubic_nes")
    branch = saltus.trace("S11+", scene=scene, energy=(1.0, 30.0))
    assert len(branch.others) == 3
    reach = branch.full_family.reach(branch.energy, float("inf"))
    turned = saltus.trace("S11+@h=1.327680076,alpha=1.618871029", scene=scene, energy=reach[0])
    alphas = [orbit.alpha for orbit in turned.orbits_at(energy=22.2628)]
    assert min(abs(alpha / 1.61014 - 1.0) for alpha in alphas) < 1e-5
