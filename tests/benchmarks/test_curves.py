"""The benchmark of curves: its closed forms are right, and the table is complete. No time is asserted."""

import pytest

from benchmarks import curves
from tests.branches import curve_oracles


@pytest.mark.parametrize("w", [1.3, 1.9, 2.8, 4.5])
def test_the_closed_forms_are_those_in_many_digits(w):
    """Oracle: the same curves in 40 digits."""
    assert curves.fold_stop(w) == pytest.approx(float(curve_oracles.fold_stop(w, 0.8)), rel=1e-12)
    assert curves.doubling_stop(w) == pytest.approx(float(curve_oracles.doubling_stop(w, 0.8)), rel=1e-12)
