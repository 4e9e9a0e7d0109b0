"""A scene without a table [bounds]: what needs none computes what it does with one, and what needs it refuses in one line."""

from pathlib import Path

import pytest

from catalogues import __file__ as shipped
from saltus import load_scene
from tests.saltus.running import read_branch, refused, run

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
