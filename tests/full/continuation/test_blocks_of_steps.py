"""Long cases of tests/continuation/test_blocks_of_steps.py."""

import pytest

from tests.continuation.test_blocks_of_steps import CASES, require_a_march_is_the_run_step_by_step


@pytest.mark.parametrize("points", [None, 2, 3, 66, 67])
@pytest.mark.parametrize("patient", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_a_march_is_the_run_step_by_step(case, patient, points):
    require_a_march_is_the_run_step_by_step(case, patient, points)
