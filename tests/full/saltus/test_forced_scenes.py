"""Long cases of tests/saltus/test_forced_scenes.py."""

import pytest

from tests.saltus.test_forced_scenes import require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling


@pytest.mark.parametrize("e", [0.5, 0.8])
@pytest.mark.parametrize("n", [1, 2])
def test_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n):
    """Oracle: see `require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling`."""
    require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n)
