"""All points of the curves of the absorber in the plane of frequency and amplitude: the branch through each has the event there."""

import pytest

from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from tests.branches.test_absorber_curves import CURVES, WINDOW, curve, named, point
from tests.branches.through_curves import regular_points, require_event


@pytest.mark.parametrize("name", CURVES)
def test_a_branch_through_each_point_of_a_curve_has_the_event(name):
    """Oracle: matrix exponentials before and behind, and the event that is located on the branch, to 1e-9."""
    found = named(name)
    for i in regular_points(found):
        require_event(found, i)


def test_a_curve_of_tori_begins_at_the_fold_flip_of_the_symmetric_orbits():
    """Oracle: the curve SB, on which the point is a crossing. Beyond it the orbits are the images of those before it."""
    folds, breaking = curve("SN''"), curve("SB")
    tori = follow_curve(curve_through(folds, point(folds, "FN", (0.998, 0.1418)), "NS"), WINDOW)
    events = {event.type: tori.parameters[event.point] for event in tori.events if event.type in ("FF", "R1")}
    assert events["FF"] == pytest.approx(breaking.parameters[point(breaking, "FF", (0.9618, 0.092))], abs=1e-9)
    assert events["R1"] == pytest.approx(folds.parameters[point(folds, "R1", (0.9978, 0.1415))], abs=1e-9)
    assert [event.type for event in tori.events].count("GH") == 3
    assert sorted(end.text.split()[0] for end in tori.ended) == ["FF", "R1"]
    back = follow_curve(curve_through(tori, point(tori, "FF", (0.9618, 0.092)), "SB"), WINDOW)
    assert back.plane.problem.half and back.parameters[back.start] == pytest.approx(events["FF"], abs=1e-9)
    assert back.parameters[point(back, "DP", (0.9194, 0.0289))] == pytest.approx(
        breaking.parameters[point(breaking, "DP", (0.9194, 0.0289))]
    )
