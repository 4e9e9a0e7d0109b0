"""Parameters of scenes: the table, expressions in the other tables, and values from the command line. Oracle: the scene with numbers."""

import json
import math

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from saltus import load_scene
from saltus.__main__ import main
from tests.saltus.running import refused, run

BOUNDS = """
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""

SCENE = (
    """
[parameters]
m = 0.5
w0 = 1.5
k = "m*w0**2"
d = 1.0
r = 0.7
F = 0.4
w = 1.1
[system]
mass = [[1, 0], [0, "m"]]
stiffness = [["1 + k", "-k"], ["-k", "k"]]
damping = [["0.02*sqrt(k)", 0], [0, 0]]
[[stops]]
c = [-1, 1]
lower = "-d"
upper = "d"
restitution = "r"
[coordinates]
names = ["x", "y"]
LO = "x"
NES = "y"
[[forces]]
on = "x"
amplitude = "F"
harmonic = 1
[[forces]]
load = [0, "m"]
amplitude = "F/4"
harmonic = 3
phase = "pi/3"
[[forces]]
on = "y"
constant = "-9.81*m"
"""
    + BOUNDS
)

# The same, in numbers.
K = 0.5 * 1.5**2
NUMBERS = (
    f"""
[system]
mass = [[1, 0], [0, 0.5]]
stiffness = [[{1 + K}, {-K}], [{-K}, {K}]]
damping = [[{0.02 * math.sqrt(K)}, 0], [0, 0]]
[[stops]]
c = [-1, 1]
lower = -1.0
upper = 1.0
restitution = 0.7
[coordinates]
names = ["x", "y"]
LO = "x"
NES = "y"
[[forces]]
on = "x"
amplitude = 0.4
frequency = 1.1
[[forces]]
load = [0, 0.5]
amplitude = 0.1
frequency = {3 * 1.1}
phase = {math.pi / 3}
[[forces]]
on = "y"
constant = {-9.81 * 0.5}
"""
    + BOUNDS
)


def written(tmp_path, text, name="scene.toml"):
    """The path of a scene with a text."""
    path = tmp_path / name
    path.write_text(text)
    return path


def test_expressions_give_the_scene_with_numbers(tmp_path):
    """Oracle: the scene with numbers, to rounding; its marks and loads, too."""
    scene, other = load_scene(written(tmp_path, SCENE)), load_scene(written(tmp_path, NUMBERS))
    for name in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(scene.system, name), getattr(other.system, name), rtol=1e-15)
    assert scene.system.stops == other.system.stops and scene.system.coordinates == ("x", "y")
    assert (scene.nes, scene.lo, scene.system.absorber, scene.loads) == (other.nes, other.lo, 1, ("forces",))
    for force, wanted in zip(scene.forces, other.forces, strict=True):
        if isinstance(force, Harmonic):
            np.testing.assert_allclose([force.cosine, force.sine], [wanted.cosine, wanted.sine], rtol=1e-15, atol=1e-16)
            assert force.frequency == pytest.approx(wanted.frequency, rel=1e-15)
        else:
            assert isinstance(force, Constant) and force.load.tolist() == wanted.load.tolist()
    assert scene.parameters == {"m": 0.5, "w0": 1.5, "d": 1.0, "r": 0.7, "F": 0.4, "w": 1.1, "k": K} and other.parameters == {}
    assert scene.parametric.layout.harmonics == (1, 3)


def test_values_replace_those_of_the_scene(tmp_path):
    """Oracle: the text of the scene with another number in its table."""
    changed = load_scene(written(tmp_path, SCENE.replace("w0 = 1.5", "w0 = 2.5").replace("r = 0.7", "r = 0.4"), "changed.toml"))
    scene = load_scene(written(tmp_path, SCENE), w0=2.5, r=0.4)
    assert scene == changed and scene != load_scene(written(tmp_path, SCENE))
    assert scene.parameters["k"] == 0.5 * 2.5**2


def test_parameters_of_the_model_and_the_frequency_of_its_load_need_no_table(tmp_path):
    """Oracle: the reference scene; a load with a frequency."""
    assert load_scene().parameters == {"mu": 0.1, "sigma": 0.1, "lam": 0.0, "rho": 1.0}
    force = '[system]\nmodel = "vibro_impact_nes"\nrho = 0.7\n[[forces]]\non = "u2"\namplitude = 0.3\nfrequency = 1.2\n' + BOUNDS
    scene = load_scene(written(tmp_path, force), w=0.8, mu=0.2)
    assert scene.parameters == {"mu": 0.2, "sigma": 0.1, "lam": 0.0, "rho": 0.7, "w": 0.8}
    assert scene.forces[0].frequency == 0.8 and scene.system.describe()["mu"] == 0.2


def test_a_model_with_parameters_of_the_scene(tmp_path):
    """Oracle: the model made directly: sigma = mu w1^2."""
    text = '[parameters]\nw1 = 0.7\n[system]\nmodel = "vibro_impact_nes"\nmu = 0.2\nsigma = "w1**2/5"\n' + BOUNDS
    scene = load_scene(written(tmp_path, text), w1=0.5)
    assert scene.system.describe() == load_scene(mu=0.2, sigma=0.05).system.describe()
    np.testing.assert_allclose(scene.parametric.derivatives(None, ["w1"])[scene.parametric.layout.stiffness, 0], [0.2, -0.2, -0.2, 0.2])


def test_motion_of_the_ground_and_records_with_parameters(tmp_path):
    """Oracle: -M r a(t), with the mass of the values."""
    (tmp_path / "quake.csv").write_text("time,acceleration\n0,1\n1,2\n")
    ground = '[ground]\namplitude = "F"\nharmonic = 2\ndirection = [1, 0.5]\n'
    text = SCENE[: SCENE.index("[[forces]]")] + BOUNDS
    scene = load_scene(written(tmp_path, ground.join(["", text])), m=0.8, F=2.0)
    assert scene.forces[0].cosine.tolist() == [-2.0, -0.8] and scene.forces[0].frequency == 2.2
    slope = scene.parametric.derivatives(None, ["m"])[scene.parametric.layout.cosine, 0]
    np.testing.assert_allclose(slope, [0.0, -1.0])
    record = '[ground]\nrecord = "quake.csv"\n'
    scene = load_scene(written(tmp_path, record.join(["", text.replace("F = 0.4\nw = 1.1\n", "")])), m=0.8)
    assert isinstance(scene.forces[0], Record) and scene.forces[0].load.tolist() == [-1.0, -0.8]


def test_the_underlying_scene_has_no_loads_and_no_losses(tmp_path):
    """Oracle: the description of the system."""
    underlying = load_scene(written(tmp_path, SCENE)).underlying
    assert underlying.system.is_conservative and underlying.forces == () and underlying.parametric.forces() == ()
    assert load_scene().underlying == load_scene()


def test_loads_without_a_common_period_are_simulated(tmp_path, capsys):
    """Oracle: what needs a period names both frequencies; a simulation needs none."""
    text = SCENE.replace("w = 1.1", "w = 1.1\nv = 0.7").replace("harmonic = 3", 'frequency = "v"')
    path = written(tmp_path, text)
    assert main(["run", "--scene", str(path), "--duration", "3"]) == 0
    assert "at       m = 0.5, w0 = 1.5, d = 1, r = 0.7, F = 0.4, w = 1.1, v = 0.7, k = 1.125\n" in capsys.readouterr().out
    with pytest.raises(ValueError, match="the load frequencies w and v are incommensurate"):
        load_scene(path).parametric.entries()


def test_a_run_takes_values_from_the_command_line_and_records_them(tmp_path, capsys):
    """Oracle: the scene with these numbers in its table moves in the same way."""
    path, changed = written(tmp_path, SCENE), written(tmp_path, SCENE.replace("F = 0.4", "F = 0.9").replace("w = 1.1", "w = 1.3"), "b.toml")
    found = []
    for words in (["--scene", str(path), "--set", "F=0.9", "--set", "w=1.3"], ["--scene", str(changed)]):
        assert main(["run", *words, "--duration", "30", "--json", str(tmp_path / "run.json")]) == 0
        found.append(json.loads((tmp_path / "run.json").read_text()))
    capsys.readouterr()
    assert found[0] == found[1] and found[0]["parameters"]["w"] == 1.3 and len(found[0]["impacts"]) > 3


def test_a_study_takes_values_from_the_command_line(tmp_path, capsys):
    """Oracle: two studies, of the scene and of its changed copy, have the same plan."""
    from saltus.motion.study import read_study_file

    written(tmp_path, SCENE)
    written(tmp_path, SCENE.replace("F = 0.4", "F = 0.9"), "b.toml")
    text = 'scene = "{}"\ndesign = "grid"\n[vary.impulse]\nvalues = [0.1, 0.2]\n[run]\nuntil = 5.0\n'
    first = read_study_file(written(tmp_path, text.format("scene.toml"), "first.toml"), {"F": 0.9})
    second = read_study_file(written(tmp_path, text.format("b.toml"), "second.toml"))
    assert first.plan.digest == second.plan.digest
    other = written(tmp_path, text.replace("[vary.", "[fixed]\nmu = 0.2\n[vary.").format("lee2009"), "third.toml")
    refused(run(capsys, "study", other, "--set", "mu=0.3"), "mu is fixed in the file")


def test_a_conservative_scene_with_parameters_has_the_families_of_its_model(tmp_path, capsys):
    """Oracle: the model with the same values: the ids are hashes of events. A catalogue belongs to one set of values."""
    start = SCENE[SCENE.index("c = [-1, 1]") :]
    text = (
        "[parameters]\nmu = 0.1\nk = 0.1\n[system]\nmass = [['mu', 0], [0, 1]]\nstiffness = [['k', '-k'], ['-k', '1 + k']]\n[[stops]]\n"
        + start[: start.index("restitution")].replace('"-d"', "-1").replace('"d"', "1").replace("[-1, 1]", "[1, -1]")
        + '[coordinates]\nnames = ["u1", "u2"]\nLO = "u2"\nNES = "u1"\n'
        + BOUNDS
    )
    path, place = written(tmp_path, text), str(tmp_path / "a.sqlite")
    ids = []
    for words in (["--scene", path, "--set", "k=0.12", "--catalogue", place, "--save"], ["--sigma", 0.12]):
        code, _, _ = run(capsys, "continue", "S13+", "--energy", "0.2:1", "--json", tmp_path / "a.json", *words)
        ids.append(json.loads((tmp_path / "a.json").read_text())["branch"]["id"])
        assert code == 0
    assert ids[0] == ids[1]
    code, out, _ = run(capsys, "check", "--scene", path, "--mu", "0.1", "--set", "k=0.12", "--catalogue", place)
    assert code == 0 and out.startswith("at       mu = 0.1, k = 0.12\n")


def changed(old, new):
    """SCENE with one change."""
    assert SCENE.count(old) == 1, old
    return SCENE.replace(old, new)


WRONG = [
    (changed("d = 1.0", "d = 1.0\ne = 2.0"), ["parameter e is used nowhere"]),
    (changed("w0 = 1.5", 'w0 = "k"'), ["cycle: w0 -> k -> w0"]),
    (changed('[0, "m"]]', '[0, "mm"]]'), ["row 2 of mass has the name mm, which is no parameter", "nearest: m"]),
    (changed("m = 0.5", "m = 0"), ["mass must be positive definite; its diagonal entry 2 is 0 (at m = 0"]),
    (changed("m = 0.5", "m = -0.5"), ["damping is 0.02*sqrt(k), which has no finite value", "(at m = -0.5"]),
    (changed("r = 0.7", "r = 1.7"), ["restitution lies in [0, 1]; a stop has 1.7", "r = 1.7"]),
    (changed("d = 1.0", "d = [1.0]"), ["parameter d is a finite number or an expression of others; received [1.0]"]),
    (changed('"0.02*sqrt(k)"', "\"__import__('os').system('true')\""), ["cannot be read: the functions known"]),
    (changed('"0.02*sqrt(k)"', '"0.02*root(k)"'), ["the functions known, of one argument, are sqrt"]),
    (changed('"0.02*sqrt(k)"', '"0.02*k^2"'), ["a power is written **"]),
    (changed("c = [-1, 1]", 'c = [-1, "m"]'), ["the gap row of a stop is a list of numbers"]),
    (changed("harmonic = 1", "harmonic = 0"), ["[[forces]] number 1", "harmonic = 0, expected a positive integer"]),
    (changed("harmonic = 1", 'harmonic = 1\nfrequency = "w"'), ["frequency and harmonic each give the frequency"]),
    (changed("harmonic = 1", 'frequency = "-w"'), ["frequency is a finite number above 0", "received -1.1"]),
    (changed("harmonic = 1", "record = 'a.csv'").replace('amplitude = "F"\n', ""), ["record", "does not exist"]),
    (changed("w0 = 1.5", "tan = 1.5"), ["parameter tan would hide the function tan"]),
    (changed("w0 = 1.5", '"w 0" = 1.5'), ["parameter 'w 0' cannot be named in expressions"]),
    (SCENE.replace("w = 1.1\n", ""), ["harmonic = 1 is a multiple of the parameter w, which is missing"]),
    (NUMBERS.replace("amplitude = 0.4", 'amplitude = "F"'), ["amplitude = 'F', expected a finite number"]),
    (NUMBERS.replace("frequency = 1.1", "harmonic = 1"), ["harmonic = 1 is a multiple of the parameter w, which is missing"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_what_is_wrong_is_refused_in_one_line(tmp_path, text, words):
    """Oracle: the change that was made to a scene that loads."""
    with pytest.raises(ValueError) as caught:
        load_scene(written(tmp_path, text))
    message = str(caught.value)
    assert "\n" not in message and "scene.toml" in message
    for word in words:
        assert word in message


OPTIONS = [
    ("--set F", ["'F'", "NAME=VALUE"]),
    ("--set F=x", ["'F=x'", "NAME=VALUE"]),
    ("--set F=inf", ["'F=inf'", "a finite number"]),
    ("--set G=1", ["unknown parameter 'G'", "known: m, w0"]),
    ("--set w1=1", ["unknown parameter 'w1'; nearest: w"]),
    ("--set k=1", ["parameter k is the expression m*w0**2; expected one of m, w0"]),
    ("--set r=1.2", ["restitution lies in [0, 1]; a stop has 1.2 (at r = 1.2)"]),
    ("--set m=0", ["mass must be positive definite", "(at m = 0)"]),
    ("--mu 0.1", ["unknown parameter 'mu'"]),
]


@pytest.mark.parametrize(("words", "said"), OPTIONS)
def test_wrong_values_on_the_command_line_are_refused(tmp_path, capsys, words, said):
    """Oracle: the parameters of the scene and their domains."""
    refused(run(capsys, "run", "--scene", written(tmp_path, SCENE), "--duration", "1", *words.split()), *said)


def test_a_value_that_is_given_twice_is_refused(capsys):
    """Oracle: the two options."""
    refused(run(capsys, "run", "--mu", "0.2", "--set", "mu=0.3"), "mu is given twice, 0.2 and 0.3; expected one value")
