"""The work of one seed, where a search is not complete and where a family is cut."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

import saltus
from branches.building import work as module
from branches.building.plan import Bounds, BuildPlan, level_energies


@pytest.mark.parametrize("place", [0, -1])
def test_energies_beside_the_outermost_are_inside_the_bounds(place, monkeypatch):
    """Oracle: the bounds. A family that is followed from an orbit outside them has a single point."""
    system, bounds = saltus.vibro_impact_nes(mu=0.1, sigma=0.1), Bounds((0.06, 0.4), 1.9, 2)
    energy = level_energies(0, bounds.energy)[place]
    asked = []

    def incomplete(system, energy, **limits):
        asked.append(energy)
        return SimpleNamespace(orbits=(), complete=False)

    monkeypatch.setattr(module, "discover_orbits", incomplete)
    answer = module._at_energy(system, energy, BuildPlan.within(bounds))
    assert answer.incomplete == (energy,) and asked[0] == energy
    assert len(asked) == 2 and all(bounds.energy[0] <= h <= bounds.energy[1] for h in asked)


@pytest.mark.parametrize(("half", "halves", "failed"), [((), 0, 2), ((0,), 1, 1), ((1,), 1, 1), ((0, 1), 1, 0)])
def test_an_end_that_is_cut_is_reported_unless_the_image_goes_on_there(half, halves, failed, monkeypatch):
    """Oracle: the ends themselves. That the image goes on at one end says nothing of the other."""
    branch = saltus.trace("S13O00+", energy=(0.3, 0.4))
    cut = tuple(end._replace(reason="MINIMUM_STEP") for end in branch.ended)
    short = replace(branch, ended=cut)
    monkeypatch.setattr(module, "is_half", lambda branch, end: end in half)
    found, messages = module._ends_cut(short)
    assert found == halves and len(messages) == failed and all(branch.id in text for text in messages)
