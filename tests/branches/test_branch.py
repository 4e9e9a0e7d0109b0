"""A branch as an object: its columns, orbits, files, and what it answers.

Oracles: the closed form; the branch itself after a round trip through its file; sampled orbits.
"""

import math

import numpy as np
import pytest

import saltus
from benchmarks.backbone import Backbone
from branches.orbit import label_at
from branches.presentation import embed
from bvp.multipoint import MultipointProblem
from tests.branches.traced import traced

COLUMNS = {
    "h", "alpha", "frequency", "frequency_index", "arclength", "stable", "tau", "tau_half", "label", "half_waves", "residual",
    "velocities", "start_u", "start_v", "flight_times", "impact_speeds", "multipliers", "trivial", "pairing", "reliable",
}  # fmt: skip


@pytest.mark.parametrize("name", ["S13O00+", "S73O33-", "U8353-", "S11E11+@h=3.0"])
def test_a_file_keeps_every_bit(tmp_path, name):
    """Oracle: the branch before it was written, column by column, event by event."""
    branch = traced(name)
    branch.save(tmp_path / "b.json")
    back = saltus.read_branch(tmp_path / "b.json")
    assert set(branch.points) == set(back.points) == COLUMNS
    for key, values in branch.points.items():
        np.testing.assert_array_equal(back.points[key], values, err_msg=key)
        assert back.points[key].dtype.kind == values.dtype.kind
    assert back.events == branch.events and back.ended == branch.ended and back.id == branch.id
    for attribute in ("label", "sequence", "ends", "aliases", "start"):
        assert getattr(back, attribute) == getattr(branch, attribute), attribute
    assert back.system.describe() == branch.system.describe()
    back.save(tmp_path / "c.json")
    assert (tmp_path / "c.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    text = (tmp_path / "b.json").read_text()
    assert "NaN" not in text and "Infinity" not in text


def test_the_start_survives_where_no_event_was_found(tmp_path):
    """Oracle: the branch before it was written."""
    branch = saltus.trace("S13O00+@h=0.3", points=9)
    assert not branch.events
    branch.save(tmp_path / "b.json")
    back = saltus.read_branch(tmp_path / "b.json")
    assert back.label == branch.label and back.id == branch.id


def test_frequencies():
    """Oracle: 2 pi / (4 alpha), and m times it with m counted in the label (S31O11 stands at three times omega_1)."""
    branch = traced("S73O33-")
    p = branch.points
    assert np.allclose(p["frequency"], 0.5 * np.pi / p["alpha"], rtol=1e-15)
    m = np.array([int(label[1]) for label in p["label"]])
    assert np.allclose(p["frequency_index"], m * p["frequency"], rtol=1e-15) and np.array_equal(p["half_waves"], m)


def test_orbits_at_an_energy():
    """Oracle: closed form: two orbits of S11O00- at h = 0.08, one at h = 1, none at h = 0.06; energies to rounding."""
    branch = traced("S11O00-")
    backbone = Backbone()
    for h, count in ((0.08, 2), (1.0, 1), (0.06, 0), (0.0691164499682690 * (1 + 1e-9), 2)):
        orbits = branch.orbits_at(energy=h)
        assert len(orbits) == count, h
        for orbit in orbits:
            assert math.isclose(orbit.h, h, rel_tol=1e-13) and abs(backbone.energy(orbit.alpha) / h - 1) < 1e-11
    orbit = branch.orbit_at(alpha=0.5)
    assert orbit.alpha == pytest.approx(0.5, rel=1e-14) and abs(orbit.h / backbone.energy(0.5) - 1) < 1e-12
    with pytest.raises(ValueError, match=r"2 orbits of S11O00- at h = 0.08: h = 0.08, alpha = .*; h = 0.08, alpha = "):
        branch.orbit_at(energy=0.08)
    with pytest.raises(ValueError, match="no orbit of S11O00- at h = 0.06: it was followed over 0.069"):
        branch.orbit_at(energy=0.06)
    with pytest.raises(ValueError, match="give one of energy and alpha"):
        branch.orbits_at(energy=1.0, alpha=1.0)


def test_orbits_at_the_energies_of_the_points_are_the_points():
    """Oracle: the points, ends and folds included."""
    branch = traced("S11O00-")
    for i in (0, 1, 5, 200, len(branch) - 1):
        h, alpha = branch.points["h"][i], branch.points["alpha"][i]
        assert any(abs(orbit.alpha / alpha - 1.0) < 1e-6 for orbit in branch.orbits_at(energy=float(h))), i


def test_an_orbit_is_its_point():
    """Oracle: the columns; indices count from the end as usual, and a point that is not there is an error."""
    branch = traced("U8353-")
    for i in (0, 3, -1, len(branch) - 1):
        orbit = branch.orbit(i)
        assert math.isclose(orbit.h, branch.points["h"][i], rel_tol=1e-13)
        assert math.isclose(orbit.alpha, branch.points["alpha"][i], rel_tol=1e-13)
        assert np.allclose(orbit.velocities, branch.points["velocities"][i], rtol=0, atol=1e-12)
    with pytest.raises(IndexError, match=f"point {len(branch)} does not exist"):
        branch.orbit(len(branch))


def test_samples_of_an_orbit():
    """Oracle: closed form of the motion; periodicity; the velocity after the impact at its time."""
    from benchmarks import backbone
    from bvp.system import vibro_impact_nes

    orbit = traced("S13O00+").orbit_at(alpha=1.7)
    system = vibro_impact_nes()
    times = np.linspace(0.0, 1.6999, 40)
    u, v = orbit.sample(times)
    expected_u, expected_v = backbone.motion(system, 1.7, times)
    sign = 1.0 if orbit.velocities[0] * expected_v[0, 0] > 0.0 else -1.0
    assert np.max(np.abs(u - sign * expected_u)) < 1e-13 and np.max(np.abs(v - sign * expected_v)) < 1e-13
    for shift in (1.0, 7.0, -3.0):
        later_u, later_v = orbit.sample(times[1:] + shift * orbit.period)
        assert np.max(np.abs(later_u - u[1:])) < 1e-12 and np.max(np.abs(later_v - v[1:])) < 1e-12
    for impact in orbit.impacts:
        _, at = orbit.sample(np.array([impact.time]))
        approach = (at[0, 0] - at[0, 1]) * (1.0 if impact.stop == "+" else -1.0)
        assert math.isclose(-approach, impact.speed, rel_tol=1e-12)


@pytest.mark.parametrize(
    ("name", "energy", "label"),
    [("origin-stop+:-:caaea47b", (1.6, 1.67), "S13O11+"), ("U1101+", (0.53, 0.58), "U1101+")],
)
def test_the_label_of_an_impulsive_orbit_is_not_that_of_a_rounded_zero(name, energy, label):
    """Oracle: where u1' is zero at the origin, u1''' = sigma u2'/mu there: beside the origin u1' has the sign of u2'. The orbits 1e-14 to
    both sides have velocities of both signs."""
    branch = saltus.trace(name, energy=energy)
    event = next(event for event in branch.events if event.type == "IO")
    orbit = branch.orbit(event.point)
    beside = [orbit.problem.step(orbit.solution.y, orbit.solution.tangent, s) for s in (-2e-14, 2e-14)]
    starts = [float(one["absorber_start"]) for one in beside]
    assert starts[0] * starts[1] < 0.0 and max(map(abs, starts)) < 1e-12
    assert [str(label_at(orbit.problem, one.result)) for one in (*beside, orbit.solution)] == [label] * 3
    assert label in branch.points["label"]


def test_an_impact_at_the_middle_is_in_the_second_half():
    """Oracle: an orbit with an impact at each quarter, solved over half a period, whose middle impact rounding moves to both sides."""
    orbit = saltus.trace("S11-", energy=(0.3, 0.5)).orbit(3)
    half = embed(orbit.problem, orbit.solution.y, (0, 2))
    problem = MultipointProblem(orbit.system, half.ends, half.sequence)
    counts = set()
    for shift in (-1e-15, 0.0, 1e-15):
        times = half.times * np.array([1.0 + shift, 1.0 - shift])
        found = problem.step(problem.pack(half.start, half.nodes, times), np.zeros(2 * problem.unknowns), 0.0, maximum=0)
        counts.add((found["first_quarter"], found["second_quarter"]))
    assert counts == {(0.0, 1.0)}
