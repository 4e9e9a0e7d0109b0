"""Long cases of tests/bvp/test_forcing.py."""

import pytest

from tests.bvp.test_forcing import require_a_load_near_resonance


@pytest.mark.parametrize("detuning", [0.0, 1e-15, 1e-12, -1e-9, 1e-6, -1e-3, 0.03, -0.5, 3.0])
@pytest.mark.parametrize("damping", [0.0, 1e-10, 0.05, 2.0, 2.1])
def test_a_load_near_resonance(detuning, damping):
    """Oracle: see `require_a_load_near_resonance`."""
    require_a_load_near_resonance(detuning, damping)
