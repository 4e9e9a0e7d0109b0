"""Long cases of tests/branches/test_free_criticality.py."""

from __future__ import annotations

import saltus
from branches.figures.curves import HOLLOW
from branches.figures.single import branch_figure
from branches.normal_forms import with_normal_forms
from tests.branches.test_free_criticality import check
from tests.branches.traced import traced


def test_subcritical_events_are_hollow():
    """Oracle: the artists of the figure."""
    branch = with_normal_forms(traced("S31O11+", low=0.05, high=20.0))
    figure = branch_figure(branch)
    lines = {line.get_gid(): line for axes in figure.axes for line in axes.lines}
    assert lines["frequency-hollow-events-PD"].get_markerfacecolor() == HOLLOW
    assert lines["frequency-events-SB"].get_markerfacecolor() != HOLLOW
    assert "hollow: subcritical" in [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    plain = branch_figure(traced("S31O11+", low=0.05, high=20.0))
    assert not any("hollow" in (line.get_gid() or "") for axes in plain.axes for line in axes.lines)


def test_smooth_forces():
    """Oracle: as above."""
    system = saltus.load_scene("cubic_and_stops").system
    found = saltus.discover(system, 1.0, quarter_period=4.0, impacts=3, ends=("origin-stop",))
    families = [saltus.trace(one, energy=(0.9, 1.7)) for one in found.orbits if one.sequence == "-"]
    (branch,) = (family for family in families if any(event.type == "PD" for event in family.events))
    check(branch, {"PD1": "supercritical", "SB1": "subcritical"})
