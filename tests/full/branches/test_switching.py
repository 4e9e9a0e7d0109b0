"""Long cases of tests/branches/test_switching.py."""

import pytest

from tests.branches.test_switching import (
    CASES,
    RESONANT,
    WAYS_BACK,
    require_every_emanating_family_leads_back_to_the_old_family,
    require_families_that_emanate_at_a_resonance,
    require_new_families,
)


@pytest.mark.parametrize(("name", "event", "ends", "times"), CASES, ids=[f"{case[0][:7]}-{case[1]}" for case in CASES])
def test_new_families(name, event, ends, times):
    """Oracle: see `require_new_families`."""
    require_new_families(name, event, ends, times)


@pytest.mark.parametrize(("name", "event", "cover"), WAYS_BACK)
def test_every_emanating_family_leads_back_to_the_old_family(name, event, cover):
    """Oracle: see `require_every_emanating_family_leads_back_to_the_old_family`."""
    require_every_emanating_family_leads_back_to_the_old_family(name, event, cover)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "event"), RESONANT)
def test_families_that_emanate_at_a_resonance(name, event):
    """Oracle: see `require_families_that_emanate_at_a_resonance`."""
    require_families_that_emanate_at_a_resonance(name, event)
