"""The benchmark of forced points: its orbits are right, and the table is complete. No time is asserted."""

import numpy as np
import pytest

from benchmarks.forced import SIZES, chain, one_impact, repeated


@pytest.mark.parametrize("n", SIZES)
def test_the_orbits_have_one_impact_and_can_be_repeated(n):
    """Oracle: the residual of the repeated orbit, and the powers of the multipliers."""
    problem, y = one_impact(chain(n))
    assert len(problem.sequence) == 1 and np.abs(problem.residual(y)).max() < 1e-13
    wide, more = repeated(problem, y, 8)
    assert np.abs(wide.residual(more)).max() < 1e-12
    assert np.abs(wide.multipliers(more)).max() == pytest.approx(np.abs(problem.multipliers(y)).max() ** 8, rel=1e-8)
