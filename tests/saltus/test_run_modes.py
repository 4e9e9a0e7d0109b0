"""`saltus run --emd`. Oracles: the modes sum to the motion itself; the ridge of the stages; one tone is one mode."""

import json
import math
import sys

import numpy as np
import pytest
from scipy.io import loadmat

from bvp.simulate import simulate as run_damped
from bvp.system import vibro_impact_nes
from tests.saltus.running import refused, run

START = ("--impulsive", "--energy", "2", "--rho", "0.7", "--lam", "0.01", "--duration", "60")


def test_the_modes_of_a_motion_sum_to_it(capsys, tmp_path):
    """Oracle: the motion run directly."""
    pytest.importorskip("PyEMD")
    files = [word for kind in ("json", "npz", "mat") for word in (f"--{kind}", tmp_path / f"a.{kind}")]
    code, out, err = run(capsys, "run", *START, "--emd", *files)
    assert code == 0, err
    reported = json.loads((tmp_path / "a.json").read_text())["empirical"]
    arrays, matlab = np.load(tmp_path / "a.npz"), loadmat(tmp_path / "a.mat")
    u, _ = run_damped(vibro_impact_nes(lam=0.01, rho=0.7), [0.0, 0.0], [0.0, 2.0], 60.0).sample(arrays["emd_time"])
    np.testing.assert_allclose(arrays["emd_modes"].sum(axis=1) + arrays["emd_residue"], u[:, 0] - u[:, 1], rtol=0.0, atol=1e-12)
    for name in ("emd_modes", "emd_amplitudes", "emd_frequencies"):
        assert arrays[name].shape == (len(u), len(reported["modes"]))
        np.testing.assert_array_equal(matlab[name], arrays[name])
    sizes = [mode["rms"] for mode in reported["modes"]]
    np.testing.assert_allclose(sizes, np.sqrt(np.mean(arrays["emd_modes"] ** 2, axis=0)), rtol=1e-14)
    assert f"{len(reported['modes'])} empirical modes" in out
    assert f"index of orthogonality {reported['orthogonality']:.3g}" in out


def test_a_tone_is_one_mode_in_its_units(capsys):
    """Oracle: a linear mode that stays between the stops, in closed form: u1 - u2 = 0.5 cos(w t), of root mean square 0.5/sqrt 2, for
    twenty periods, of which the Hilbert transform is exact."""
    pytest.importorskip("PyEMD")
    modes = vibro_impact_nes().modes
    w, shape = float(modes.frequencies[0]), modes.shapes[:, 0]
    a, b = (0.5 * shape / (shape[0] - shape[1])).tolist()
    state = f"--state={a!r},{b!r},0,0"
    units = ("--clearance", "3", "--natural-frequency", "5")
    code, out, err = run(capsys, "run", state, "--duration", repr(40.0 * math.pi / w), "--emd", *units, "--json", "-")
    assert code == 0, err
    reported = json.loads(out)["empirical"]
    largest = max(reported["modes"], key=lambda mode: mode["rms"])
    assert largest["frequency"] == pytest.approx(5.0 * w, rel=5e-3)
    assert largest["rms"] == pytest.approx(3.0 * 0.5 / math.sqrt(2.0), rel=5e-3)
    assert abs(reported["orthogonality"]) < 0.01


def test_without_the_option_there_are_none(capsys):
    """Oracle: null, and no line."""
    code, out, err = run(capsys, "run", *START, "--json", "-")
    assert code == 0, err
    assert json.loads(out)["empirical"] is None


def test_a_missing_package_is_reported_before_the_work(capsys, tmp_path, monkeypatch):
    """Oracle: the words."""
    monkeypatch.setitem(sys.modules, "PyEMD", None)
    refused(run(capsys, "run", *START, "--emd", "--json", tmp_path / "a.json"), 'pip install "saltus[emd]"')
    assert not (tmp_path / "a.json").exists()
