"""Long cases of tests/transitions/test_response_tracing.py."""

from __future__ import annotations

import numpy as np

import saltus


def test_a_grazing_of_a_free_orbit_has_no_bounded_multipliers(tmp_path):
    """Oracle: at the impact's vanishing speed they grow as one over its square. A file has all of the family."""
    orbit = saltus.trace("S13+", energy=(0.4, 0.8)).orbit_at(alpha=1.7)
    branch = saltus.trace_in_parameter(orbit, "sigma", (0.1, 0.3), keep="quarter_period = 1.7", direction="up")
    assert branch.events[-1].type == "GR" and branch.events[-1].multiplier is None
    assert np.isnan(branch.problem.multipliers(branch.unknowns[-1])).all() and branch.problem.multipliers(branch.unknowns[-2])[0].real > 1e2
    saltus.save_responses([branch], tmp_path / "a.json")
    assert np.array_equal(saltus.read_responses(tmp_path / "a.json")[0].unknowns, branch.unknowns)
