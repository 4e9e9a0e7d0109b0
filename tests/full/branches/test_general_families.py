"""Long cases of tests/branches/test_general_families.py."""

import numpy as np
import pytest

from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from tests.branches.test_general_families import SYSTEMS, require_a_resonance_has_its_multiplier, require_no_resonance_is_lost
from tests.bvp.orbits import chains


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_resonance_has_its_multiplier(name):
    """Oracle: see `require_a_resonance_has_its_multiplier`."""
    require_a_resonance_has_its_multiplier(name)


@pytest.mark.parametrize("name", SYSTEMS)
def test_no_resonance_is_lost(name):
    """Oracle: see `require_no_resonance_is_lost`."""
    require_no_resonance_is_lost(name)


def test_a_krein_collision_leaves_the_unit_circle():
    """Oracle: multipliers from the saddle-point matrix of orbits on both sides."""
    collisions = 0
    for orbit in (chains()[i] for i in (18, 32)):
        branch = follow_family(orbit.problem, orbit.solution.y, energy=(4.0, 100.0))
        for event in branch.events:
            if event.type != "NS":
                continue
            at = branch.orbit(event.point).solution
            complex_pairs = []
            for step in (-1e-4, 1e-4):
                beside = branch.problem.step(at.y, at.tangent, step)
                values = saddle_point_multipliers(cycle_of(branch.problem, beside.y)).values
                complex_pairs.append(int(np.sum((np.abs(values) > 1.0 + 1e-5) & (np.abs(values.imag) > 1e-5))))
            assert sorted(complex_pairs)[1] - sorted(complex_pairs)[0] == 2, (event.h, complex_pairs)
            collisions += 1
    assert collisions >= 3
