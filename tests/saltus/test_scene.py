"""Scenes: what ships is cited and complete, what is wrong is refused with its place and the nearest thing that exists."""

import tomllib
import unicodedata
from importlib import resources

import numpy as np
import pytest

from branches.naming.labels import parse
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from saltus import load_scene
from tests.saltus.running import run

MATRICES = """
title = "two masses"
[system]
mass = [[1, 0], [0, 2.0]]
stiffness = [[2, -1], [-1, 1]]
[[stops]]
c = [1, -1]
upper = 0.5
restitution = 0.9
[coordinates]
names = ["x", "y"]
LO = "y"
NES = "x"
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
[names]
"S13+" = { h = 1.5 }
"""

LETTERS = """
[parameters]
"µ" = 1.5
"ú" = 0.25
[system]
mass = [["µ*µ/µ"]]
damping = [["ú"]]
stiffness = [[1.0]]
[[stops]]
c = [1.0]
upper = 1.0
[coordinates]
names = ["å"]
[[forces]]
on = "å"
amplitude = "ú"
frequency = 1.0
"""

MODEL = """
[system]
model = "vibro_impact_nes"
mu = 0.2
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""

LAW = """
title = "A spring with a power"
source = "none"
[parameters]
"ú" = 3
[system]
mass = [[1]]
stiffness = [[1]]
[[springs]]
c = [1]
stiffness = 1
power = "ú"
[coordinates]
names = ["x"]
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""


def written(tmp_path, text):
    """Return the path of a scene with a text."""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("form", ["NFC", "NFD", "NFKC", "NFKD"])
def test_letters_are_equal_however_they_are_typed(tmp_path, capsys, form):
    """Oracle: the numbers. A letter with an accent is one character or two, and a Greek letter can be the sign of a unit."""
    place = tmp_path / "letters.toml"
    place.write_text(unicodedata.normalize(form, LETTERS), encoding="utf-8")
    scene = load_scene(place)
    assert scene.system.mass.tolist() == [[1.5]] and scene.system.damping.tolist() == [[0.25]]
    assert load_scene(place, **{unicodedata.normalize("NFKC", "µ"): 2.0}).system.mass.tolist() == [[2.0]]
    words = f"sweep --scene {place} --set µ=2 --in ú --range 0.2:0.3 --points 2 --transient 2 --record 2 --y max:å"
    code, out, err = run(capsys, *unicodedata.normalize(form, words).split())
    assert (code, err) == (0, "") and "0.3" in out
    place.write_text(LAW, encoding="utf-8")
    code, out, err = run(capsys, *unicodedata.normalize(form, f"spring --scene {place} --in ú --values 3,5").split())
    assert (code, err) == (0, "") and "1.728" in out and "2.48832" in out  # 1.2^3 and 1.2^5


def test_two_names_that_are_one_are_refused(tmp_path):
    """Oracle: the message. The sign of a unit and the Greek letter are one name, so one of two values would not be used."""
    with pytest.raises(ValueError, match=r"scene .*: \u00b5 \(U\+00B5\), \u03bc \(U\+03BC\) are one name"):
        load_scene(written(tmp_path, LAW.replace("[parameters]", '[parameters]\n"\u00b5" = 1.0\n"\u03bc" = 2.0')))


def test_the_default_scene_is_the_reference_system(tmp_path, monkeypatch):
    """Oracle: Lee et al. 2009, mu = sigma = 0.1, no damping, elastic; found from any working directory."""
    monkeypatch.chdir(tmp_path)
    scene = load_scene()
    assert scene.system.describe() == vibro_impact_nes(0.1, 0.1, 0.0, 1.0).describe()
    assert scene.reference_points["S73O33-"] == {"h": 7.3348, "alpha": 1.6459}
    assert scene.reference_points["U8353-"] == {"h": 1.9458, "alpha": 4.9065}
    assert "Physica D 238 (2009) 1868" in scene.source
    assert load_scene("lee2009").system.describe() == scene.system.describe()


def test_each_shipped_scene_loads_and_cites_its_source():
    """Oracle: the scene's own file."""
    names = [entry.name for entry in resources.files("catalogues").iterdir() if entry.name.endswith(".toml")]
    assert "lee2009.toml" in names
    for name in names:
        scene = load_scene(name.removesuffix(".toml"))
        assert scene.title and scene.source
        for label in scene.reference_points:
            assert parse(label)


def test_all_names_of_the_system_of_a_scene():
    """Oracle: the scene's own file: a name without a point is one, too; none holds for another system."""
    scene = load_scene()
    names = scene.names_for(scene.system)
    assert names["S11-"] == names["S13+"] == {} and names["S31O11-"] == {"h": 1.5, "alpha": 1.6376}
    assert tuple(names) == scene.names and not scene.names_for(vibro_impact_nes(0.2, 0.1))


def test_parameters_replace_those_of_the_model_and_drop_its_reference_points():
    """Oracle: the system made directly; a cited point says nothing about another system."""
    scene = load_scene(mu=0.37, sigma=0.81)
    assert scene.system.describe() == vibro_impact_nes(0.37, 0.81).describe()
    assert dict(scene.reference_points) == {}
    assert "U8353-" in load_scene(mu=0.1).reference_points
    assert load_scene().reference_points_for(vibro_impact_nes(0.2, 0.1)) == {}
    assert "U8353-" in load_scene().reference_points_for(vibro_impact_nes(0.1, 0.1))


def test_a_scene_with_matrices(tmp_path):
    """Oracle: the system made directly."""
    scene = load_scene(written(tmp_path, MATRICES))
    expected = ImpactSystem(
        np.diag([1.0, 2.0]),
        np.zeros((2, 2)),
        [[2.0, -1.0], [-1.0, 1.0]],
        (Stop((1.0, -1.0), upper=0.5, restitution=0.9),),
        ("x", "y"),
        absorber=0,
        primary=1,
    )
    assert scene.system.describe() == expected.describe()
    assert scene.energy == (0.1, 10.0) and scene.quarter_period == 8.0 and scene.impacts == 6
    assert scene.reference_points == {"S13+": {"h": 1.5}}
    assert scene.bounds == {"energy": (0.1, 10.0), "quarter_period": 8.0, "impacts": 6}


def changed(text, old, new):
    """Return a text with one place changed."""
    assert text.count(old) == 1
    return text.replace(old, new)


WRONG = [
    (changed(MATRICES, "stiffness =", "stifness ="), ["unknown key 'stifness'", "nearest known: stiffness"]),
    (changed(MATRICES, 'NES = "x"', 'NSE = "x"'), ["unknown key 'NSE'", "nearest: NES"]),
    (changed(MATRICES, "h = 1.5", "energy = 1.5"), ["unknown key 'energy'", "h, alpha"]),
    (changed(MATRICES, "h = 1.5", "h = -1.5"), ["h = -1.5", "above 0"]),
    (changed(MATRICES, "S13+", "S1x"), ["S1x", "character 3"]),
    (changed(MATRICES, "[1, 0], [0, 2.0]", "[1, 0.5], [0, 2.0]"), ["symmetric"]),
    (changed(MATRICES, "[1, 0], [0, 2.0]", "[1, 2], [2, 1]"), ["indefinite"]),
    (changed(MATRICES, "[1, 0], [0, 2.0]", "[1, 0], [0]"), ["mass", "square matrix"]),
    (changed(MATRICES, "[1, 0], [0, 2.0]", '[1, 0], [0, "a"]'), ["mass", "[0, 'a']", "square matrix of numbers"]),
    (changed(MATRICES, "[1, 0], [0, 2.0]", "[1, 0], [0, nan]"), ["mass", "entry (2, 2)", "finite numbers"]),
    (changed(MATRICES, "c = [1, -1]", "c = [1, -1, 0]"), ["gap"]),
    (changed(MATRICES, "upper = 0.5", ""), ["bound"]),
    (changed(MATRICES, "restitution = 0.9", "restitution = 1.9"), ["restitution", "1.9", "[0, 1]"]),
    (changed(MATRICES, 'LO = "y"', 'LO = "z"'), ["z", "x, y"]),
    (changed(MATRICES, "energy = [0.1, 10]", "energy = [10, 0.1]"), ["energy = [10, 0.1]", "lowest < highest"]),
    (changed(MATRICES, "energy = [0.1, 10]", "energy = [1]"), ["energy = [1]", "[lowest, highest]"]),
    (changed(MATRICES, "energy = [0.1, 10]", ""), ["energy is missing, expected [lowest, highest]"]),
    (changed(MATRICES, "impacts = 6", "impacts = true"), ["impacts = True", "an integer"]),
    (changed(MATRICES, "quarter_period = 8", 'quarter_period = "8"'), ["quarter_period = '8'", "a number"]),
    (changed(MATRICES, 'title = "two masses"', "title = 2"), ["title = 2", "a string"]),
    (changed(MODEL, "mu = 0.2", "mue = 0.2"), ["unknown key 'mue'", "nearest known: mu"]),
    (changed(MODEL, "mu = 0.2", 'mu = "0.2"'), ["mu", "'0.2'", "number"]),
    (changed(MODEL, "vibro_impact_nes", "vibro_impact_nse"), ["vibro_impact_nse", "known: vibro_impact_nes"]),
    (MODEL + "[[stops]]\nc = [1, -1]\n", ["stops", "brings its own"]),
    (changed(MODEL, "mu = 0.2", "mu = = 0.2"), ["as TOML", "line 4", "column"]),
    ("h,alpha\n0.1,2\n", ["as TOML", "line 1"]),
    ("", ["system is missing, expected a table [system]"]),
]


@pytest.mark.parametrize(("text", "words"), WRONG, ids=[str(i) for i in range(len(WRONG))])
def test_what_is_wrong_is_named(tmp_path, text, words):
    """Oracle: the change that was made to a scene that loads."""
    path = written(tmp_path, text)
    with pytest.raises(ValueError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert "\n" not in message and "scene.toml" in message
    for word in words:
        assert word in message


def test_other_files_are_no_scene(tmp_path):
    """Oracle: what each file is."""
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="utf-8"):
        load_scene(path)
    with pytest.raises(ValueError, match="scene.toml$"):
        load_scene(tmp_path / "scen.toml")
    with pytest.raises(ValueError, match="directory"):
        load_scene(tmp_path)
    with pytest.raises(ValueError, match="nearest: lee2009"):
        load_scene("lee2008")


def test_parameters_need_a_model(tmp_path):
    """Oracle: matrices have no parameter mu; the model has no parameter nu."""
    with pytest.raises(ValueError, match="has no parameter mu: its matrices are numbers"):
        load_scene(written(tmp_path, MATRICES), mu=0.2)
    with pytest.raises(ValueError, match="unknown parameter 'nu'"):
        load_scene(nu=0.2)


def test_a_changed_copy_of_a_shipped_scene_loads(tmp_path):
    """Oracle: the shipped scene, changed in one value by its text."""
    text = (resources.files("catalogues") / "lee2009.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["system"]["mu"] == 0.1
    changed_scene = load_scene(written(tmp_path, changed(text, "mu = 0.1 ", "mu = 0.3 ")))
    assert changed_scene.system.describe() == vibro_impact_nes(0.3, 0.1).describe()


def test_scenes_of_other_systems():
    """Oracle: frequencies in closed form: 2 sin((2 k - 1) pi/14) of a chain of three masses from a wall on; sqrt(k (1/m + 1/M)) of the
    torsion of a shaft, and 1 of the oscillator of an impact damper. The last two have rigid-body modes."""
    chain = 2.0 * np.sin((2.0 * np.arange(1, 4) - 1.0) * np.pi / 14.0)
    expected = {"three_mass_chain": chain, "gear_pair": [0.0, 0.0, np.sqrt(1.25)], "impact_damper": [0.0, 1.0]}
    for name, frequencies in expected.items():
        scene = load_scene(name)
        assert np.allclose(scene.system.modes.frequencies, frequencies, rtol=1e-14, atol=0.0)
        assert scene.title and scene.source and scene.complete["energy"] != scene.energy
        assert scene.system.why_not_conservative() is None
