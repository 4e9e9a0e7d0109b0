"""The events of a family are those of the family: random starts, ranges and steps give the same.

Takes a few minutes, and is run apart: `python -m pytest tests/full`.
"""

from dataclasses import replace

import numpy as np
import pytest

from branches.catalogue import Catalogue
from branches.tracing import SETTINGS, follow_family
from tests.branches.building.pieces import differences
from tests.branches.test_events_of_families import BORN, OPEN, require_a_family_passes_the_branch_point_that_it_is_born_at
from tests.full.test_shipped_scene import COMPLETE

FAMILIES = 320
DIFFERENT = 0.004
"""Share of the runs that may have a fold more or less within rounding of a branch point (docs/reference/limits.md: none of 1920)."""

STUCK = 0.01
"""Part of the runs that may end beside a branch point, where the corrector fails. They say so, and are compared as far as they go."""


def test_events_do_not_depend_on_start_range_direction_or_step_size(built):
    """Oracle: the events that the catalogue keeps, to 1e-9 in energy and quarter period, on the piece that both runs cover."""
    rng = np.random.default_rng(13)
    wrong, stuck = [], 0
    with Catalogue(built[0]) as catalogue:
        rows = catalogue.families()
        for place in rng.choice(len(rows), FAMILIES, replace=False):
            branch = catalogue.branch(rows[place].id)
            events = {event.point for event in branch.events}
            start = int(rng.choice([i for i in range(len(branch)) if i not in events]))
            h = float(branch.points["h"][start])
            low, high = COMPLETE["energy"]
            energy = max(low, h / (1.02 + 3.0 * rng.random() ** 2)), min(high, h * (1.02 + 3.0 * rng.random() ** 2))
            longest = max(COMPLETE["quarter_period"], float(branch.points["alpha"].max()) * (1.0 + 1e-7))
            settings = replace(
                SETTINGS,
                initial_step=10.0 ** rng.uniform(-3.0, -2.0),
                maximum_step=10.0 ** rng.uniform(-2.0, -1.0),
                target_turn=rng.uniform(0.02, 0.1),
            )
            direction = str(rng.choice(["both", "up", "down"], p=[0.6, 0.2, 0.2]))
            run = follow_family(
                branch.problem, branch.unknowns(start), energy=energy, quarter_period=longest, settings=settings, direction=direction
            )
            stuck += any(end.reason == "MINIMUM_STEP" for end in (*run.ended, *branch.ended))
            missing, added = differences(branch, start, run)
            if missing or added:
                wrong.append((branch.id, start, energy, direction, settings, missing, added))
    assert len(wrong) <= DIFFERENT * FAMILIES, f"{len(wrong)} of {FAMILIES}: {wrong[:5]}"
    assert stuck <= STUCK * FAMILIES


@pytest.mark.parametrize(("parent", "energy"), [*BORN, OPEN])
def test_a_family_passes_the_branch_point_that_it_is_born_at(parent, energy):
    """Oracle: see `require_a_family_passes_the_branch_point_that_it_is_born_at`."""
    require_a_family_passes_the_branch_point_that_it_is_born_at(parent, energy)
