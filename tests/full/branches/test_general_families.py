"""Long cases of tests/branches/test_general_families.py."""

import numpy as np
import pytest

from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from tests.branches.test_general_families import (
    SYSTEMS,
    closed,
    require_a_resonance_has_its_multiplier,
    require_no_collision_is_missed,
    require_no_resonance_is_lost,
)
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


def test_no_collision_is_missed():
    """Oracle: see `require_no_collision_is_missed`. Chains of three to six masses, and periodic closures of three of them."""
    orbits = [orbit for orbit in chains() if orbit.problem.pairs > 1]
    cases = [(orbit.problem, orbit.solution.y, orbit.energy) for orbit in orbits]
    cases += [(*closed(chains()[i]), chains()[i].energy) for i in (5, 6, 15)]
    found = [require_no_collision_is_missed(problem, y, (0.1 * energy, 10.0 * energy)) for problem, y, energy in cases]
    resonances, collisions = np.sum(found, axis=0)
    assert len(cases) == 31 and resonances > 600 and collisions >= 7
