"""Long cases of tests/bvp/test_loads.py."""

from __future__ import annotations

import pytest

from tests.bvp.test_loads import FREE, chain, oscillator, require_flights_agree_with_forty_digits


@pytest.mark.parametrize(
    ("system", "w", "t"),
    [
        pytest.param(oscillator(), 2.8, 2.2, id="undamped"),
        pytest.param(oscillator(), 1.0, 20.0, id="at resonance"),
        pytest.param(oscillator(), 1.0 + 1e-9, 20.0, id="beside resonance"),
        pytest.param(oscillator(0.1), 1.0, 6.0, id="damped, at resonance"),
        pytest.param(oscillator(1e-6), 1.01, 12.0, id="hardly damped"),
        pytest.param(oscillator(2.0), 1.3, 5.0, id="critically damped"),
        pytest.param(oscillator(50.0), 1.3, 5.0, id="strongly damped"),
        pytest.param(oscillator(0.0, 0.0), 3.0, 2.0, id="a free mass"),
        pytest.param(oscillator(0.3, 0.0), 3.0, 2.0, id="a free damped mass"),
        pytest.param(oscillator(0.1), 2.0, 1e-6, id="a very short flight"),
        pytest.param(oscillator(0.1), 2.0, -0.7, id="backwards"),
        pytest.param(chain(2, 0.05), 1.7, 4.0, id="two, coupled damping"),
        pytest.param(chain(3, 0.2), 1.7, 3.0, id="three, coupled damping"),
        pytest.param(FREE, 2.0, 3.0, id="a rigid-body mode"),
    ],
)
def test_flights_agree_with_forty_digits(system, w, t):
    """Oracle: see `require_flights_agree_with_forty_digits`."""
    require_flights_agree_with_forty_digits(system, w, t)
