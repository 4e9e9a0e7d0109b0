"""Loads of a scene: harmonics, constants, records, motion of the ground. Oracles: the formulae, and the text that was written."""

import math

import numpy as np
import pytest

from bvp.forcing import forcing_of
from saltus import load_scene
from tests.bvp import twins

SCENE = """
[system]
mass = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 0.5]]
damping = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.0]]
stiffness = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
[[stops]]
c = [0.0, -1.0, 1.0]
lower = -1.0
upper = 1.0
restitution = 0.6
[coordinates]
names = ["floor", "roof", "sink"]
LO = ["floor", "roof"]
NES = ["sink"]
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""

RECORD = "# made by hand\n time , acceleration,other\n0, 1.0,7\n\n0.5,-2.0,8\n2.0,0.0,9\n"


def scene_of(tmp_path, loads, record=RECORD, text=SCENE):
    """A scene with loads, and a record beside it."""
    (tmp_path / "quake.csv").write_text(record)
    path = tmp_path / "scene.toml"
    path.write_text(text + loads)
    return load_scene(path)


def force_at(scene, time):
    """f(t)."""
    return twins.force_at(forcing_of(scene.forces, scene.system.degrees_of_freedom), time)


def test_a_harmonic_on_a_coordinate(tmp_path):
    """Oracle: amplitude cos(frequency t + phase)."""
    scene = scene_of(tmp_path, '[[forces]]\non = "roof"\namplitude = 3.0\nfrequency = 1.7\nphase = 0.4\n')
    for time in (0.0, 0.3, 4.0):
        np.testing.assert_allclose(force_at(scene, time), [0.0, 3.0 * math.cos(1.7 * time + 0.4), 0.0], atol=1e-14)


def test_forces_add_up(tmp_path):
    """Oracle: a constant with a load on each coordinate, and a harmonic."""
    both = '[[forces]]\nload = [1.0, -2.0, 0.0]\nconstant = 0.5\n[[forces]]\non = "sink"\namplitude = 2.0\nfrequency = 1.0\n'
    scene = scene_of(tmp_path, both)
    np.testing.assert_allclose(force_at(scene, 0.7), [0.5, -1.0, 2.0 * math.cos(0.7)], atol=1e-15)


@pytest.mark.parametrize("direction", [None, [1.0, 1.0, 0.5]])
def test_motion_of_the_ground(tmp_path, direction):
    """Oracle: -M r a(t), with a linear between the rows of the file and zero after the last one."""
    extra = "" if direction is None else f"direction = {direction}\n"
    scene = scene_of(tmp_path, f'[ground]\nrecord = "quake.csv"\nscale = 2.0\n{extra}')
    r = np.ones(3) if direction is None else np.array(direction)
    for time, value in ((0.0, 1.0), (0.25, -0.5), (1.25, -1.0), (2.5, 0.0)):
        np.testing.assert_allclose(force_at(scene, time), -2.0 * value * np.array([2.0, 3.0, 0.5]) * r, atol=1e-14)


def test_another_column_of_a_record(tmp_path):
    """Oracle: the file."""
    scene = scene_of(tmp_path, '[[forces]]\non = "floor"\nrecord = "quake.csv"\ncolumn = "other"\n')
    np.testing.assert_allclose(force_at(scene, 0.5), [8.0, 0.0, 0.0])


def test_marks_are_names_or_lists_of_them(tmp_path):
    """Oracle: the lists; one name in a list is the coordinate that labels count."""
    scene = scene_of(tmp_path, "")
    assert scene.nes == (2,) and scene.lo == (0, 1)
    assert scene.system.absorber == 2 and scene.system.primary is None
    reference = load_scene(rho=0.7, lam=0.01)
    assert reference.nes == (0,) and reference.lo == (1,) and reference.forces == ()


def test_the_underlying_scene_is_conservative_and_keeps_the_names(tmp_path):
    """Oracle: the reference scene without its damping; matrices without theirs."""
    damped = load_scene(rho=0.7, lam=0.01)
    assert damped.underlying.system.describe() == load_scene().system.describe()
    assert damped.underlying.reference_points_for(damped.underlying.system) == load_scene().reference_points_for(load_scene().system) != {}
    assert dict(load_scene(mu=0.2, rho=0.7).reference_points) == {}
    scene = scene_of(tmp_path, '[[forces]]\non = "floor"\nconstant = 1.0\n').underlying
    assert scene.system.is_conservative and scene.forces == () and scene.system.absorber == 2
    np.testing.assert_array_equal(scene.system.stiffness[1], [-1.0, 2.0, -1.0])


WRONG = [
    ({"loads": '[force]\non = "roof"\n'}, ["unknown key 'force'", "nearest: forces"]),
    ({"loads": '[[forces]]\non = "rof"\nconstant = 1\n'}, ["on = 'rof'", "nearest: roof", "[[forces]] number 1"]),
    ({"loads": "[[forces]]\nconstant = 1\n"}, ["on", "load"]),
    ({"loads": '[[forces]]\non = "roof"\nload = [1, 1, 1]\nconstant = 1\n'}, ["on", "load"]),
    ({"loads": '[[forces]]\non = "roof"\n'}, ["record, amplitude", "constant; received none"]),
    ({"loads": '[[forces]]\non = "roof"\nconstant = 1\namplitude = 1\n'}, ["record, amplitude", "amplitude, constant"]),
    ({"loads": '[[forces]]\non = "roof"\namplitude = 1\n'}, ["frequency is missing, expected a number"]),
    ({"loads": '[[forces]]\non = "roof"\namplitude = 1\nfrequency = -2\n'}, ["frequency = -2,", "above 0"]),
    ({"loads": '[[forces]]\non = "roof"\nconstant = 1\nscale = 2\n'}, ["unknown key 'scale'", "known: on, load, constant"]),
    ({"loads": '[[forces]]\non = "roof"\namplitude = 1\nfrequenc = 2\n'}, ["unknown key 'frequenc'", "nearest: frequency"]),
    ({"loads": "[[forces]]\nload = [1, 1]\nconstant = 1\n"}, ["a list of 3 numbers"]),
    ({"loads": '[[forces]]\non = "roof"\nconstant = inf\n'}, ["constant = inf", "finite"]),
    ({"loads": '[ground]\nrecord = "quak.csv"\n'}, ["quak.csv", "does not exist", "nearest: quake.csv"]),
    ({"loads": '[ground]\nrecord = "quake.csv"\ncolumn = "aceleration"\n'}, ["no column 'aceleration'", "nearest: acceleration"]),
    ({"loads": '[ground]\nrecord = "quake.csv"\ndirection = [1, 1]\n'}, ["direction", "a list of 3 numbers"]),
    ({"record": "time,acceleration\n0,1\n1,x\n"}, ["row 2", "acceleration is no finite number"]),
    ({"record": "time,acceleration\n0,1\n1\n"}, ["Line #3", "got 1 columns instead of 2"]),
    ({"record": "time,acceleration\n0,1\n1,nan\n"}, ["row 2", "finite"]),
    ({"record": "time,acceleration\n0,1\n1,2\n# a remark\n1,3\n"}, ["row 3", "time 1 after 1", "ascend"]),
    ({"record": "time,acceleration\n0,1\n"}, ["1 rows", "2 at least"]),
    ({"record": ""}, ["it is empty"]),
    ({"record": "0,1\n1,2\n"}, ["no column 'time'", "0, 1"]),
    ({"text": SCENE.replace('NES = ["sink"]', 'NES = ["snik"]')}, ["'snik' is none of", "floor, roof, sink"]),
    ({"text": SCENE.replace('NES = ["sink"]', 'NES = ["snik", "sink"]')}, ["'snik' is none of", "nearest: sink"]),
    ({"text": SCENE.replace('NES = ["sink"]', 'NES = ["roof", "sink"]')}, ["roof", "NES", "LO"]),
    ({"text": SCENE.replace('NES = ["sink"]', 'NES = ["sink", "sink"]')}, ["sink is marked twice"]),
    ({"text": SCENE.replace('NES = ["sink"]', "NES = []")}, ["NES = []", "a list of coordinates"]),
    ({"text": SCENE.replace('NES = ["sink"]', 'NES = ["sink", 2]')}, ["NES = ['sink', 2]", "a list of coordinates"]),
]


@pytest.mark.parametrize(("changes", "words"), WRONG, ids=[str(i) for i in range(len(WRONG))])
def test_wrong_loads_records_and_marks_are_named(tmp_path, changes, words):
    """Oracle: the change that was made to a scene that loads; one line. A message about a record names its row."""
    with pytest.raises(ValueError) as caught:
        scene_of(tmp_path, **{"loads": '[ground]\nrecord = "quake.csv"\n', **changes})
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value), str(caught.value)
