"""Real families for the pictures of many, followed once for all tests."""

from functools import cache

from branches.figures.atlas_data import atlas_of, regime_bounds
from branches.search.impulsive_motions import impulsive_manifold
from branches.search.impulsive_orbits import impulsive_orbits
from branches.tracing import follow_family
from bvp.system import vibro_impact_nes
from tests.branches.traced import traced

SYSTEM = vibro_impact_nes()
ENERGY = (0.03, 30.0)
PINS = {"S13O00+": {}, "S31O11+": {}}


@cache
def impulsive():
    return impulsive_orbits(SYSTEM, (0.05, 2.4), quarter_period=5.1)


@cache
def families():
    """Both backbones, and the families through the impulsive orbits."""
    found = [traced("S13O00+"), traced("S11O00-")]
    for orbit in impulsive().orbits:
        branch = follow_family(orbit.orbit.problem, orbit.orbit.solution.y, energy=(0.05, ENERGY[1]))
        if branch.id not in {other.id for other in found}:
            found.append(branch)
    return tuple(found)


@cache
def curve():
    return impulsive_manifold(SYSTEM, (0.03, 5.0), density=20, periods=50)


@cache
def atlas():
    """Everything that a picture can hold."""
    bounds, missing = regime_bounds(SYSTEM, families())
    assert not missing
    return atlas_of(
        SYSTEM, families(), reference_points=PINS, manifold=curve(), impulsive=impulsive(), bounds=bounds, energy=ENERGY
    )
