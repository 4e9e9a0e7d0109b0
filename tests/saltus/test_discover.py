"""`saltus discover`: what it prints and writes. Oracles: the search from Python; the format."""

import json
import math

import pytest

import saltus
from saltus.__main__ import main
from saltus.commands.discover import summary
from tests.branches.catalogue.families import real
from tests.saltus.running import reported

WORDS = ("discover", "--energy", "1", "--max-quarter-period", "2", "--max-impacts", "5")


@pytest.fixture(scope="module")
def found():
    return saltus.discover(saltus.vibro_impact_nes(), 1.0, quarter_period=2.0, impacts=5)


def test_the_table_and_the_summary(capsys, found):
    """Oracle: the orbits found from Python, one line each, in their order."""
    assert main(list(WORDS)) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert err == "" and lines[0].split()[:4] == ["label", "ends", "sequence", "impacts"]
    assert [line.split()[0] for line in lines[1 : 1 + len(found.orbits)]] == [orbit.label for orbit in found.orbits]
    assert lines[1 + len(found.orbits) :] == summary(found) and lines[-1].startswith("complete")


@pytest.mark.parametrize("hyphen", [True, False])
def test_json(capsys, tmp_path, found, hyphen):
    """Oracle: the orbits found from Python; standard output carries the data alone."""
    path = "-" if hyphen else str(tmp_path / "found.json")
    assert main([*WORDS, "--json", path]) == 0
    out, err = capsys.readouterr()
    record = json.loads(out if hyphen else (tmp_path / "found.json").read_text())
    assert ("S11O00-" in err) == hyphen
    assert [entry["alpha"] for entry in record["orbits"]] == [orbit.alpha for orbit in found.orbits]
    assert record["bounds"] == {"quarter_period": 2.0, "impacts": 5, "ends": ["origin-origin"]}


def test_the_parameters_of_the_scene(capsys):
    """Oracle: the search from Python with them; without a bound the scene's quarter period holds."""
    assert main(["discover", "--energy", "0.5", "--mu", "0.37", "--sigma", "0.81", "--max-impacts", "2", "--json", "-"]) == 0
    record = json.loads(capsys.readouterr().out)
    same = saltus.discover(saltus.vibro_impact_nes(0.37, 0.81), 0.5, quarter_period=10.0, impacts=2)
    assert record["bounds"]["quarter_period"] == 10.0
    assert [entry["alpha"] for entry in record["orbits"]] == [orbit.alpha for orbit in same.orbits]


def test_families_of_a_catalogue(catalogue, capsys, tmp_path):
    """Oracle: at h = 0.5 three of the catalogue's branches are crossed, at their own quarter periods; the other orbits, which discovery
    finds just the same, lie on none of it. Python says the same."""
    words = ["discover", "--energy", "0.5", "--max-quarter-period", "2", "--max-impacts", "4", "--catalogue", str(catalogue)]
    assert main([*words, "--json", str(tmp_path / "found.json")]) == 0
    out = capsys.readouterr().out
    record = json.loads((tmp_path / "found.json").read_text())
    crossed = {}
    for branch in real():
        for orbit in branch.orbits_at(energy=0.5):
            crossed[branch.id] = pytest.approx(orbit.alpha, rel=1e-9)
    assert len(crossed) == 3
    reported = {entry["family"]: entry["alpha"] for entry in record["orbits"] if entry["family"] is not None}
    assert crossed == reported
    assert all(id in out for id in crossed) and f"{len(record['orbits']) - 3} orbits lie on none" in out
    with saltus.Catalogue(catalogue) as kept:
        found = saltus.discover(kept.system, 0.5, quarter_period=2.0, impacts=4, catalogue=kept)
        assert list(found.families) == [entry["family"] for entry in record["orbits"]]
        with pytest.raises(ValueError, match="mu is 0.1, not 0.2"):
            saltus.discover(saltus.vibro_impact_nes(mu=0.2), 0.5, catalogue=kept)
        with pytest.raises(ValueError, match="mu is 0.1, not 0.2"):
            kept.identify(saltus.trace("S11O00-", saltus.vibro_impact_nes(mu=0.2), energy=(0.2, 0.3)).orbit(2))


def test_all_kinds_of_ends(capsys):
    """Oracle: the words of the command and of the search are the same."""
    from branches.search.orbit_search import CLASSES

    words = ["discover", "--energy", "0.3", "--max-quarter-period", "2", "--max-impacts", "3", "--ends", ",".join(CLASSES), "--model"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "model  equal gaps" in out and "rest stop+" in out


def test_a_search_that_is_not_complete_says_why(capsys):
    """Oracle: a budget that cannot do."""
    assert main([*WORDS, "--max-starts", "150"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("not complete: the starts were used up") and "--max-starts" in last


PRESSING = """
[system]
mass = [[1.0, 0.0], [0.0, 1.0]]
stiffness = [[3.0, 0.0], [0.0, 1.0]]
[[stops]]
c = [0.0, 1.0]
upper = {upper}
[bounds]
energy = [0.1, 20.0]
quarter_period = 0.6
impacts = 1
"""


def test_a_stop_that_presses_at_rest(tmp_path):
    """Oracle: u2 = -A cos t returns from -A to the stop at -1 in arccos(1/A), half a period; below A = 1 there is no motion. The id is that
    of one family at each energy, which ends at rest."""
    scene = tmp_path / "pressing.toml"
    scene.write_text(PRESSING.format(upper=-1.0))
    ids = set()
    for h in (0.6, 1.0):
        code, out, err = reported(f"discover --scene {scene} --energy {h} --max-impacts 1")
        assert (code, err) == (0, "") and out.splitlines()[-1].startswith("complete")
        (row,) = [line.split() for line in out.splitlines() if line.lstrip().startswith("rest stop+")]
        assert float(row[3]) == pytest.approx(0.5 * math.acos(1.0 / math.sqrt(2.0 * h)), rel=1e-7)
        ids.add(row[-1])
    assert len(ids) == 1
    code, out, err = reported(f"discover --scene {scene} --energy 0.4")
    assert (code, err) == (0, "") and "0 orbits at h = 0.4" in out
    assert "the rest position lies beyond stop a, whose gap coordinate goes from -inf to -1" in out and "energy than h = 0.5" in out
    code, out, err = reported(f"continue --scene {scene} --from mode:1")
    assert code == 2 and out == "" and "mode:1: the rest position lies beyond stop a" in err and "no linear mode exists" in err
    code, out, err = reported(f"build --scene {scene} --energy 0.1:0.3 --workers 1 --catalogue {tmp_path}/a.sqlite")
    assert code == 0 and "0 families" in out and "the rest position lies beyond stop a" in out
    scene.write_text(PRESSING.format(upper=0.0))
    code, out, err = reported(f"continue --scene {scene} --from mode:1")
    assert code == 2 and "mode:1: the rest position lies at stop a" in err
