"""The events of a family are the same from every start and with every step length."""

from dataclasses import replace

import pytest

from branches.tracing import SETTINGS, follow_family, trace
from bvp.system import vibro_impact_nes
from tests.branches.building.pieces import differences

SYSTEM = vibro_impact_nes(mu=0.1, sigma=0.1)
RESONANCES = [2.591576, 2.592445, 2.594166, 2.595702, 2.600394, 2.601768, 2.603223, 2.603926]
"""Energies of the eight resonances that lie within one step, where tau_half runs from +2 to -2."""


@pytest.fixture(scope="module")
def family():
    return trace("origin-stop+:-++:b8ea1bf0@h=2.54", SYSTEM, energy=(2.0, 3.8))


def test_eight_resonances_within_one_step_are_found(family):
    """Oracle: the zeros of tau_half -+ 2 cos(pi p/q), by an independent program."""
    found = sorted(event.h for event in family.events if event.type == "RT" and 2.585 < event.h < 2.61)
    assert found == pytest.approx(RESONANCES, abs=6e-7)


@pytest.mark.parametrize("part", [0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95])
@pytest.mark.parametrize("longest", [0.01, 0.025, 0.1])
def test_events_do_not_depend_on_the_start_or_the_steps(family, part, longest):
    """Oracle: the events from another start, to 1e-9."""
    events = {event.point for event in family.events}
    start = min((i for i in range(len(family)) if i not in events), key=lambda i: abs(i - part * len(family)))
    settings = replace(SETTINGS, maximum_step=longest, initial_step=0.3 * longest, target_turn=2.0 * longest)
    run = follow_family(family.problem, family.unknowns(start), energy=(2.0, 3.8), settings=settings)
    assert differences(family, start, run) == ([], [])
