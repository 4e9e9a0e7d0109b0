"""Long cases of tests/bvp/test_integral.py."""

import pytest

from bvp.system import vibro_impact_nes
from tests.bvp.test_integral import DAMPER, EPSILON, OFFSETS, RATE, STATE, TWO_DOF_STATE, V, one, require_dissipation
from tests.bvp.test_modes import exceptional_point


@pytest.mark.parametrize(
    ("systems", "row", "z", "times", "accuracy"),
    [
        ([one(2.0 * (1.0 + offset), 1.0) for offset in OFFSETS], V, STATE, (1e-4, 0.3, 0.99, 3.0, 40.0), 100 * EPSILON),
        ([one(c, k) for c in (0.0, 1e-9, 0.3, 50.0) for k in (0.0, 1e-12, -0.5)], V, STATE, (0.2, 7.0), 200 * EPSILON),
        ([vibro_impact_nes(lam=0.01)], DAMPER, TWO_DOF_STATE, (1e-6, 0.01, 0.9, 2.5, 30.0, 400.0), 200 * EPSILON),
        ([exceptional_point()], RATE, TWO_DOF_STATE, (0.1, 3.0, 60.0), 1e-12),
    ],
    ids=["critical damping", "rigid bodies and negative stiffness", "the reference system", "a larger block"],
)
def test_dissipation(systems, row, z, times, accuracy):
    """Oracle: see `require_dissipation`."""
    require_dissipation(systems, row, z, times, accuracy)
