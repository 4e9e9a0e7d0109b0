"""Stages of motions on the families of two scenes: the reference system, and one with another mass ratio."""

from __future__ import annotations

import pytest

import saltus
from branches.building.build import build
from branches.building.plan import Bounds, BuildPlan
from branches.catalogue import Catalogue
from saltus.processes import open_executor
from tests.transitions import test_stages as origin
from tests.transitions.test_stages import (
    check_a_cut,
    check_other_amplitudes,
    check_own_families,
    check_third_harmonics,
    require_a_faint_end_goes_on_as_far_as_the_record_goes,
)
from transitions.families import families_of

light = origin.light


@pytest.fixture(scope="module")
def scenes(small_scene, tmp_path_factory):
    """The small reference scene, and one with another mass ratio, open, with their families."""
    path = tmp_path_factory.mktemp("heavy") / "heavy.sqlite"
    heavy = saltus.vibro_impact_nes(mu=0.2, sigma=0.1)
    with open_executor(2) as (executor, workers), Catalogue(path, "a", scene=heavy) as catalogue:
        build(catalogue, BuildPlan.within(Bounds((0.05, 100.0), 2.2, 3)), executor, workers)
    with Catalogue(small_scene[0]) as light, Catalogue(path) as other:
        yield {"light": (light, families_of(light)), "heavy": (other, families_of(other))}


@pytest.mark.parametrize("scene", ["light", "heavy"])
def test_the_motion_of_each_stable_orbit_is_one_stage_on_its_own_family(scenes, scene):
    """Oracle: the catalogue."""
    reported, named = check_own_families(*scenes[scene], every=1)
    assert reported > named >= 8 and reported >= 12


def test_another_mass_ratio(scenes):
    """Oracles: the signal, and the harmonics of the orbits."""
    check_a_cut(*scenes["heavy"])
    check_third_harmonics(*scenes["heavy"])
    check_other_amplitudes(*scenes["heavy"], "S13O00+", "stop+-stop-::31e6f439")


def test_the_motion_of_a_stable_orbit_is_one_stage_on_its_own_family(light):
    """Oracle: the catalogue. Orbits whose strong harmonics the wavelet parts; what fits as well by spectrum and impacts is reported, and
    has no fewer impacts than what is named."""
    reported, named = check_own_families(*light, every=4)
    assert reported > named >= 3


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("offset", [0.0, 0.4])
@pytest.mark.parametrize("decades", [3, 7, 12])
def test_a_faint_end_goes_on_as_far_as_the_record_goes(decades, offset, reverse):
    """Oracle: see `require_a_faint_end_goes_on_as_far_as_the_record_goes`."""
    require_a_faint_end_goes_on_as_far_as_the_record_goes(decades, offset, reverse)
