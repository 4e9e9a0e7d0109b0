"""Long cases of tests/saltus/test_continue.py."""

import pytest

from tests.saltus.test_continue import (
    RANDOM,
    require_absurd_systems_give_one_line_or_an_answer,
    require_random_and_extreme_systems,
    require_unfinished_labels_match_all_that_fit,
)


@pytest.mark.parametrize(("mu", "sigma"), [*map(tuple, RANDOM[:2]), (1e-6, 0.1), (1e6, 0.1), (0.1, 1e-8), (0.1, 0.0)])
def test_random_and_extreme_systems(mu, sigma):
    """Oracle: see `require_random_and_extreme_systems`."""
    require_random_and_extreme_systems(mu, sigma)


@pytest.mark.parametrize("name", ["S13", "U21", "S11", "S13O"])
def test_unfinished_labels_match_all_that_fit(name):
    """Oracle: see `require_unfinished_labels_match_all_that_fit`."""
    require_unfinished_labels_match_all_that_fit(name)


@pytest.mark.parametrize("words", ["--mu 1e300", "--sigma 1e300", "--mu 1e-12", "--sigma 1e-300", "--sigma 1e-320"])
def test_absurd_systems_give_one_line_or_an_answer(words):
    """Oracle: see `require_absurd_systems_give_one_line_or_an_answer`."""
    require_absurd_systems_give_one_line_or_an_answer(words)
