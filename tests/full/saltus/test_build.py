"""Long cases of tests/saltus/test_build.py."""

import numpy as np
import pytest

from branches.catalogue import Catalogue
from saltus.__main__ import main
from tests.saltus.test_build import FAR, require_what_is_beside_changes_no_family


@pytest.mark.parametrize(
    ("oscillators", "more"), [((0.15,), ""), ((), FAR.format(gap=[0.0, 1.0])), ((0.15, 0.11), FAR.format(gap=[0.0, 0.0, 1.0, 0.0]))]
)
def test_what_is_beside_changes_no_family(tmp_path, oscillators, more):
    """Oracle: see `require_what_is_beside_changes_no_family`."""
    require_what_is_beside_changes_no_family(tmp_path, oscillators, more)


def test_a_family_that_comes_back_into_the_bounds_ends_at_them(tmp_path):
    """Oracle: the bounds, and the energy at which S11+ loses its symmetry, where the asymmetric family ends on both sides. S11+ leaves the
    bounds between its ends."""
    file = tmp_path / "a.sqlite"
    assert main(f"build --scene cubic_nes --energy 0.02:8 --max-quarter-period 1.7 --catalogue {file} --workers 1".split()) == 0
    with Catalogue(file) as catalogue:
        families = catalogue.families()
        ends = np.array([catalogue.branch(row.id).points["h"][[0, -1]] for row in families])
    assert len(families) == 10 and ends.max() < 8.0 * (1.0 + 1e-9) and max(row.h_high for row in families) > 100.0
    assert min(row.h_high for row in families if row.ends == "rest-rest") == pytest.approx(5.971227, abs=1e-6)
