"""`saltus run` and `saltus study` with smooth forces.

Oracles: DOP853 of scipy, with the integrals of what each damper takes; closed forms of a locked sink; families of the undamped system.
"""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import loadmat

from saltus import Simulator, load_scene
from saltus.__main__ import main
from saltus.families import start_of, trace
from tests.saltus.running import refused, run
from transitions.sharing import sharing_of
from transitions.study.study import Study

TIMES = np.linspace(0.0, 60.0, 13)
LOSSES = ("--lam", 0.02, "--set", "lam_nes=0.01")


def shares_of_sink(power, pull, start):
    """u, v, and what sink and oscillator have dissipated, at `TIMES`: a mass 0.05 on the spring `pull`, an oscillator of frequency 1, and
    the damper 0.01 w'^power between them."""

    def rate(_, x):
        w, speed = x[0] - x[1], x[2] - x[3]
        push = pull(w) + 0.01 * speed**power
        return [x[2], x[3], -push / 0.05, push - x[1] - 0.02 * x[3], 0.01 * speed ** (power + 1), 0.02 * x[3] ** 2]

    return solve_ivp(rate, (0.0, 60.0), [*start, 0.0, 0.0], "DOP853", t_eval=TIMES, rtol=1e-13, atol=1e-15).y.T


def test_a_damped_motion_and_its_files(tmp_path, capsys):
    """Oracle: DOP853 with the energies that the dampers take."""
    files = {kind: tmp_path / f"run.{kind}" for kind in ("json", "csv", "npz", "mat")}
    options = [text for kind, path in files.items() for text in (f"--{kind}", path)]
    words = ("--scene", "cubic_nes", "--impulse", 0.8, *LOSSES, "--duration", 60, "--samples", len(TIMES), *options)
    code, out, _ = run(capsys, "run", *words)
    assert code == 0 and "impacts  0" in out
    exact = shares_of_sink(1, lambda w: w**3, [0.0, 0.0, 0.0, 0.8])
    record = json.loads(files["json"].read_text())
    assert record["system"]["springs"] == [{"c": [1.0, -1.0], "power": 3.0, "nonlinear_only": True, "stiffness": 1.0}]
    for table in (np.load(files["npz"]), loadmat(files["mat"], squeeze_me=True)):
        np.testing.assert_allclose(np.hstack([table["u"], table["v"]]), exact[:, :4], atol=1e-11)
        np.testing.assert_allclose(np.stack([table["dissipated_nes"], table["dissipated_lo"]], axis=1), exact[:, 4:], atol=1e-12)
        w, speed = exact[:, 0] - exact[:, 1], exact[:, 2]
        np.testing.assert_allclose(table["nes_energy"], 0.5 * 0.05 * speed**2 + 0.25 * w**4, atol=1e-12)
        np.testing.assert_allclose(table["energy"] + table["dissipated_nes"] + table["dissipated_lo"], 0.32, rtol=1e-13)
    assert record["dissipated"]["gaps"] == pytest.approx(exact[-1, 4], abs=1e-12)
    assert len(files["csv"].read_text().splitlines()) == 1 + len(TIMES)


SCENE = """
[system]
mass = [[0.05, 0.0], [0.0, 1.0]]
stiffness = [[0.0, 0.0], [0.0, 1.0]]
[[springs]]
between = ["sink", "floor"]
potential = "cosh(w) - 1"
[[dampers]]
between = ["sink", "floor"]
damping = 0.01
power = POWER
[[dampers]]
on = "floor"
damping = 0.02
[coordinates]
names = ["sink", "floor"]
NES = "sink"
LO = "floor"
"""


@pytest.mark.parametrize("power", [1, 3])
def test_a_damper_of_a_sink_counts_for_it(tmp_path, capsys, power):
    """Oracle: DOP853 with the energies that the dampers take, of a linear and of a cubic one."""
    (tmp_path / "scene.toml").write_text(SCENE.replace("POWER", str(power)))
    words = ("--scene", tmp_path / "scene.toml", "--impulse", 0.8, "--duration", 60, "--json", tmp_path / "run.json")
    assert run(capsys, "run", *words)[0] == 0
    exact = shares_of_sink(power, np.sinh, [0.0, 0.0, 0.0, 0.8])[-1, 4:] / 0.32
    found = json.loads((tmp_path / "run.json").read_text())
    assert [found["shares"]["nes"], found["shares"]["lo"]] == pytest.approx(list(exact), abs=1e-11)


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    """A catalogue of one family without impacts."""
    path = tmp_path_factory.mktemp("smooth") / "mine.sqlite"
    assert main(["continue", "S11+", "--scene", "cubic_nes", "--energy", "0.04:0.1", "--save", "--catalogue", str(path)]) == 0
    return path


def test_a_locked_smooth_sink(tmp_path, capsys):
    """Oracle: the oscillator with both masses, u2 = V sqrt(1.05) sin(t/sqrt(1.05))."""
    words = ("--scene", "cubic_nes", "--impulse", 0.8, "--duration", 60, "--locked", "--json", tmp_path / "run.json")
    assert run(capsys, "run", *words)[0] == 0
    peak = json.loads((tmp_path / "run.json").read_text())["locked"]["peaks"]["displacements"]["u2"]
    assert peak["peak"] == pytest.approx(0.8 * np.sqrt(1.05), rel=1e-12)
    assert peak["time"] == pytest.approx(0.5 * np.pi * np.sqrt(1.05), abs=1e-6)


STUDY = """
scene = "cubic_nes"
design = "grid"
[vary.energy]
from = 0.02
to = 0.5
points = 3
[fixed]
lam = 0.02
FAMILY
[run]
until = 60.0
"""


@pytest.mark.parametrize("family", ["", 'family = "S11-"'])
def test_a_study(tmp_path, capsys, family):
    """Oracle: the simulation of each run alone."""
    (tmp_path / "shock.toml").write_text(STUDY.replace("FAMILY", family))
    code, out, _ = run(capsys, "study", tmp_path / "shock.toml", "--set", "lam_nes=0.01", "--workers", 1)
    assert code == 0 and "3: the duration was reached" in out
    study, scene = Study(tmp_path / "shock.study"), load_scene("cubic_nes", lam=0.02, lam_nes=0.01)
    shared = sharing_of(scene.system, scene.nes, scene.lo)
    branch = trace("S11-", scene=scene.underlying, energy=(0.01, 0.6)) if family else None
    for k, h in enumerate([0.02, 0.26, 0.5]):
        if branch is not None:
            (orbit,) = branch.orbits_at(energy=h)
            u, v, _ = start_of(orbit)
        else:
            u, v = np.zeros(2), np.array([0.0, np.sqrt(2.0 * h)])
        motion = Simulator(scene.system, dampers=shared.dampers).run(u, v, 60.0)
        shares = np.array(shared.totals(motion.dissipated)) / motion.initial_energy
        assert study["h"][k] == pytest.approx(h, rel=1e-9)
        assert [study["nes_share"][k], study["lo_share"][k]] == pytest.approx(list(shares), rel=1e-7 if family else 1e-12)
    assert study["balance_error"].max() < 1e-13


def test_a_study_of_smooth_forces_has_a_duration(tmp_path, capsys):
    (tmp_path / "shock.toml").write_text(STUDY.replace("until = 60.0", "").replace("FAMILY", ""))
    words = "the spring between u1 and u2 is not linear, and only linear flights have a proof that no impact is possible"
    refused(run(capsys, "study", tmp_path / "shock.toml"), "expected a duration", words)


def test_a_section(tmp_path, capsys, catalogue):
    """Oracle: the energy of the section; the orbits of a catalogue are marked where motions return to."""
    files = [tmp_path / f"section.{kind}" for kind in ("json", "png")]
    words = ("--energy", 0.05, "--orbits", 4, "--crossings", 30, "--catalogue", catalogue, "--json", files[0], "--plot", files[1])
    code, out, _ = run(capsys, "section", "--scene", "cubic_nes", *words)
    (section,) = json.loads(files[0].read_text())["sections"]
    assert code == 0 and "found  1 periodic orbits (1 elliptic)" in out and files[1].stat().st_size > 10_000
    assert section["energy_drift"] < 1e-13 and section["points"] == 120
    ((x, y),) = section["marks"][0]["points"]
    code, _, _ = run(capsys, "section", "--scene", "cubic_nes", "--energy", 0.05, "--start", f"{x:.17g},{y:.17g}", "--json", files[0])
    points = np.array(json.loads(files[0].read_text())["sections"][0]["orbits"][0]["points"])
    assert np.abs(points[:20] - [x, y]).max() < 1e-9


AWAY = """
[system]
mass = [[1.0]]
stiffness = [[0.0]]
[[springs]]
on = "u1"
stiffness = -1.0
power = 3
"""


def test_a_motion_that_runs_away(tmp_path, capsys):
    """Oracle: u = 1/(1 - t/sqrt(2)) of u'' = u^3 has no value beyond sqrt(2)."""
    (tmp_path / "scene.toml").write_text(AWAY)
    words = ("--scene", tmp_path / "scene.toml", "--state", "1,0.70710678118654752", "--duration", 5, "--json", tmp_path / "run.json")
    code, out, _ = run(capsys, "run", *words)
    assert code == 1 and "ended    the smooth forces grow beyond" in out and "peaks    not computed: the motion runs away" in out
    assert "shares   not computed: the motion runs away" in out and "%" not in out and "balance" not in out
    assert json.loads((tmp_path / "run.json").read_text())["duration"] == pytest.approx(np.sqrt(2.0), abs=1e-9)


@pytest.mark.parametrize(
    "state, expected",
    [
        ("0,2,0,1", "the energy at the start is nan, expected a finite number: the potential of a spring on u2 has no finite value there"),
        ("0,1,0,1", "the energy at the start is inf, expected a finite number: the potential of a spring on u2 has no finite value there"),
        ("0,0,1e200,0", "the energy at the start is inf, expected a finite number"),
    ],
)
def test_a_start_without_an_energy_is_refused(tmp_path, capsys, state, expected):
    """The logarithm of 1 - w has no value beyond w = 1; a square of 1e200 is beyond the range of floats."""
    matrices = "[system]\nmass = [[1.0, 0.0], [0.0, 0.4]]\nstiffness = [[1.0, -0.2], [-0.2, 0.3]]\n"
    (tmp_path / "scene.toml").write_text(matrices + '[[springs]]\non = "u2"\npotential = "-log(1 - w) - w"\n')
    refused(run(capsys, "run", "--scene", tmp_path / "scene.toml", "--state", state, "--duration", 5), expected)


@pytest.mark.parametrize("words", [("run", "--impulse", 1, "--duration", 5), ("section", "--energy", 1)])
def test_springs_without_a_potential_are_refused(tmp_path, capsys, words):
    (tmp_path / "scene.toml").write_text(SCENE.replace('potential = "cosh(w) - 1"', 'force = "floor**3"').replace("POWER", "1"))
    refused(run(capsys, *words, "--scene", tmp_path / "scene.toml"), "the springs have no potential: the force on sink changes with floor")


def test_a_smooth_family_without_an_impulsive_orbit(capsys, catalogue):
    words = ("--scene", "cubic_nes", "--on", "S11+", "--impulsive", "--duration", 5, "--catalogue", catalogue)
    refused(run(capsys, "run", *words), "S11+ has no impulsive orbit")
