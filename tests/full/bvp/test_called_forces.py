"""Long cases of tests/bvp/test_called_forces.py."""

from __future__ import annotations

import numpy as np

from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from tests.bvp.test_called_forces import cube, oscillator


def test_a_force_that_is_no_number_ends_the_family():
    """Oracle: the contract. The energy at the edge of the table is 1.5^2/2 + 1.5^4/4."""
    system = oscillator(lambda w: np.where(np.abs(np.real(w)) < 1.5, cube(w), np.nan))
    problem = MultipointProblem(system, ("origin", "rest"), ())
    y = problem.solve(problem.pack(np.array([0.0, 1.1]), None, [1.4]), energy=0.6).y
    branch = follow_family(problem, y, energy=(0.6, 9.0))
    edge = 1.5**2 / 2.0 + 1.5**4 / 4.0
    assert 0.8 * edge < branch.points["h"].max() < edge
    assert any("converge" in end.text for end in branch.ended)
