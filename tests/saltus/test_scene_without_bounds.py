"""A scene without a table [bounds]: what needs none computes what it does with one, and what needs it refuses in one line."""

from pathlib import Path

import pytest

from catalogues import __file__ as shipped
from saltus import load_scene
from tests.saltus.running import read_branch, read_json, refused, run

pytestmark = pytest.mark.usefixtures("folder")


def without_bounds(name):
    """A shipped scene as a file without the table, which comes last."""
    text, _, bounds = (Path(shipped).parent / f"{name}.toml").read_text().partition("[bounds]")
    assert "[" not in bounds.replace("energy = [", "")
    Path("own.toml").write_text(text)
    return "own.toml"


def test_a_response_needs_no_bounds(capsys):
    scene = without_bounds("damped_impact_oscillator")
    branches = []
    for given in (scene, "damped_impact_oscillator"):
        words = "continue", "--scene", given, "--from", "rest", "--in", "A", "--range", "0.05:0.2", "--json", "a.json"
        code, _, err = run(capsys, *words)
        assert code == 0, err
        branches.append(read_branch("a.json"))
    assert branches[0] == branches[1]
    sweep = "sweep", "--scene", scene, "--in", "w", "--range", "0.9:1", "--points", "3", "--transient", "20", "--record", "20"
    for words in (("run", "--scene", scene, "--duration", "5"), sweep):
        code, _, err = run(capsys, *words)
        assert code == 0, (words, err)


def test_what_is_searched_within_bounds_needs_them(capsys):
    path = Path("own.toml")
    path.write_text('[system]\nmodel = "vibro_impact_nes"\nmu = 0.1\nsigma = 0.1\nlam = 0.0\nrho = 1.0\n')
    message = "the scene has no table [bounds]; expected one with energy, quarter_period and impacts"
    for text in ("continue S11-", "continue --from mode:1", "discover --energy 1", "build --catalogue a.saltus", "orbit S11- --energy 1"):
        refused(run(capsys, *text.split(), "--scene", str(path)), message)
    scene = load_scene(path)
    assert scene.energy is scene.quarter_period is scene.impacts is None and scene == load_scene(path) and scene.underlying is scene


def test_what_is_given_bounds_needs_no_table(capsys):
    """Oracle: the same build, and the same family saved, of the scene with the table."""
    text = "[system]\nmass = [[1.0]]\nstiffness = [[1.0]]\n[[stops]]\nc = [1.0]\nupper = 1.0\n"
    Path("with.toml").write_text(f"{text}[bounds]\nenergy = [0.1, 2.0]\nquarter_period = 9.0\nimpacts = 4\n")
    Path("without.toml").write_text(text)
    build = "build --energy 0.1:2 --max-quarter-period 5 --workers 1"
    found = []
    for name in ("with", "without"):
        words = *build.split(), "--max-impacts", "3", "--scene", f"{name}.toml", "--catalogue", f"{name}.sqlite", "--json", "a.json"
        code, _, err = run(capsys, *words)
        assert code == 0, err
        assert run(capsys, "check", "--scene", f"{name}.toml", "--catalogue", f"{name}.sqlite")[0] == 0
        follow = "continue", "--from", "mode:1", "--energy", "0.1:2", "--scene", f"{name}.toml", "--catalogue", f"{name}.sqlite", "--save"
        code, out, err = run(capsys, *follow)
        assert code == 0 and "known  rest-stop+::" in out, err
        found.append(read_json("a.json"))
    assert found[0] == found[1] and found[0]["families"] == 1
    refused(
        run(capsys, *build.split(), "--scene", "without.toml"), "no table [bounds]", "or --energy, --max-quarter-period and --max-impacts"
    )
