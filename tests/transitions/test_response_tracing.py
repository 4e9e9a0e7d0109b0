"""Responses from Python: the same as from the command line, saved and read again, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import saltus
from benchmarks import backbone
from transitions.response.path import ParameterPath
from transitions.response.tracing import simulated_start


@pytest.fixture(scope="module")
def absorber():
    return saltus.load_scene("absorber").parametric


@pytest.fixture(scope="module")
def symmetric(absorber):
    (branch,) = saltus.trace_response(absorber, "w", (0.9, 1.2))
    return branch


def test_a_response_has_its_events_and_the_families_behind_them(symmetric):
    """Oracle: the grazing of the symmetric response; the family behind it begins there, and has an impact more."""
    (event,) = [event for event in symmetric.events if event.type == "GR"]
    assert event.values["w"] == pytest.approx(0.9873255373, abs=1e-9)
    further = saltus.emanating_responses(symmetric, event.id, points=5)
    assert further and all(np.abs(branch.parameter - event.values["w"]).min() < 1e-4 for branch in further)
    assert all(len(branch.sequence) > len(symmetric.sequence) for branch in further)


def test_saved_responses_are_read_again(symmetric, tmp_path):
    """Oracle: the branch itself; a table has a row for each point."""
    saltus.save_responses([symmetric], tmp_path / "one.json")
    saltus.save_responses([symmetric], tmp_path / "one.csv")
    (again,) = saltus.read_responses(tmp_path / "one.json")
    assert np.array_equal(again.unknowns, symmetric.unknowns) and again.id == symmetric.id
    table = saltus.response_dataframe(symmetric)
    assert len(table) == len(symmetric) == len((tmp_path / "one.csv").read_text(encoding="utf-8").splitlines()) - 1
    assert table["w"].to_numpy() == pytest.approx(symmetric.parameter, abs=0.0)


def test_marks_and_a_response_from_rest(absorber):
    """Oracle: the amplitude of the linear response at the mark."""
    branches = saltus.trace_response(absorber, "w", (0.3, 0.7), start="rest", values={"w": 0.4}, marks=[0.5])
    (at,) = [(branch, event) for branch in branches for event in branch.events if event.type == "UZ"]
    branch, event = at
    system, forces = absorber.system({"w": 0.5}), absorber.forces({"w": 0.5})
    stiffness = system.stiffness - 0.25 * system.mass + 0.5j * system.damping
    expected = np.linalg.solve(stiffness, forces[0].cosine)
    state = branch.problem.nodes(branch.unknowns[event.point])[0]
    np.testing.assert_allclose(state[:4], [*expected.real, *(0.5j * expected).real], atol=1e-13)


@pytest.mark.parametrize("phase", [-1e-17, 2.0 * np.pi])
def test_a_whole_turn_of_the_phase_is_none(absorber, phase):
    """Oracle: the start at the phase 0. In floats -1e-17 and 2 pi are equal modulo 2 pi."""
    path = ParameterPath(absorber, ["w"])
    turned, plain = (simulated_start(path, phase=one)[0] for one in (phase, 0.0))
    assert np.array_equal(turned.states, plain.states)


@pytest.fixture(scope="module")
def backbone_orbit():
    return saltus.trace("S11-", energy=(0.5, 1.0)).orbit_at(energy=0.8)


@pytest.fixture(scope="module")
def in_the_mass_ratio(backbone_orbit):
    return saltus.trace_in_parameter(backbone_orbit, "mu", (0.09, 0.25), keep="energy = 0.8", marks=[0.2])


def test_a_backbone_in_the_mass_ratio(backbone_orbit, in_the_mass_ratio):
    """Oracle: the closed form of one impact in half a period, at each point; the scene's system gives the same."""
    branch = in_the_mass_ratio
    assert [event.type for event in branch.events] == ["EP", "UZ", "RT", "EP"] and np.ptp(branch.columns["h"]) < 1e-13
    for mu, alpha, h in zip(branch.parameter, branch.columns["alpha"], branch.columns["h"], strict=True):
        assert backbone.energy(saltus.vibro_impact_nes(mu=mu, sigma=0.1), alpha) == pytest.approx(h, rel=1e-11)
    parametric = saltus.load_scene("lee2009").parametric
    few = {"direction": "up", "points": 10}
    one = saltus.trace_in_parameter(backbone_orbit, "mu", (0.09, 0.25), keep="energy = 0.8", **few)
    again = saltus.trace_in_parameter(backbone_orbit, ["mu"], (0.09, 0.25), keep=["energy = 0.8"], system=parametric, **few)
    assert len(one) == 10 and np.array_equal(again.unknowns, one.unknowns)


def test_families_that_begin_on_a_backbone_in_the_mass_ratio(in_the_mass_ratio):
    """Oracle: at the resonance 1:5 an orbit of five times the period begins, with the same energy."""
    branch = in_the_mass_ratio
    (event,) = [event for event in branch.events if event.type == "RT"]
    found = saltus.emanating_responses(branch, event, points=10)
    for one in found:
        k = int(np.abs(one.parameter - event.values["mu"]).argmin())
        assert one.periods[k] == pytest.approx(5.0 * branch.periods[event.point], rel=1e-4)
        assert one.columns["h"] == pytest.approx(0.8, rel=1e-12)
    assert found


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": "omega"}, "omega"),
        ({"keep": ()}, "equation"),
        ({"keep": "energy = 0.8*oops"}, "oops"),
        ({"interval": (0.2, 0.3)}, "the range 0.2 to 0.3 has not the value mu = 0.1; expected it inside"),
        ({"system": saltus.ParametricSystem.of(saltus.vibro_impact_nes(mu=0.2, sigma=0.1))}, "another system: its mass differ"),
    ],
)
def test_families_in_a_parameter_that_cannot_be_are_refused(backbone_orbit, change, message):
    given = {"names": "mu", "interval": (0.05, 0.3), "keep": "energy = 0.8", **change}
    with pytest.raises(ValueError, match=message):
        saltus.trace_in_parameter(backbone_orbit, given.pop("names"), given.pop("interval"), **given)
    with pytest.raises(RuntimeError, match="no orbit near S11O00- fulfils energy = 1e-3"):
        saltus.trace_in_parameter(backbone_orbit, "mu", (0.05, 0.3), keep="energy = 1e-3")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": "here"}, "start is 'simulate' or 'rest'; received 'here'"),
        ({"interval": (1.2, 1.5)}, "the range 1.2 to 1.5 has not the value w = 1"),
        ({"names": "omega"}, "omega"),
        ({"through": ["NS"]}, "families begin at events of type PD, SB, BP, GR, LB; received NS"),
    ],
)
def test_what_cannot_be_followed_is_refused(absorber, change, message):
    given = {"names": "w", "interval": (0.9, 1.2), **change}
    with pytest.raises(ValueError, match=message):
        saltus.trace_response(absorber, given.pop("names"), given.pop("interval"), **given)


def test_events_without_a_family_are_refused(symmetric):
    with pytest.raises(ValueError, match="no event PD7; known: "):
        saltus.emanating_responses(symmetric, "PD7")
    with pytest.raises(ValueError, match=r"expected a name that ends in \.json or \.csv"):
        saltus.save_responses([symmetric], "one.png")
