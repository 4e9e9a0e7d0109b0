"""Following forced families and those that begin at their events, each once.

Oracle: the families that are reached from one end of the graph are those that are reached from the other, with the same events.
"""

from __future__ import annotations

import saltus
from branches.forced.onwards import ResponseStart, follow_onwards, trace_start
from transitions.response.path import ParameterPath
from transitions.response.starting import linear_response

RANGE = (0.9, 2.2)
ABSORBER = saltus.load_scene("absorber").parametric


def rest(w):
    """The start without impacts at w."""
    problem, y, why = linear_response(ParameterPath(ABSORBER, ["w"], [], {"w": w}))
    assert why is None
    return ResponseStart(problem, y)


def within(low, high):
    """Traces starts between two values of w."""
    return lambda start: trace_start(start, (low, high))


def test_families_that_were_not_followed_are_counted():
    found = follow_onwards([rest(2.0)], within(*RANGE), through=("GR", "SB"), most=3)
    assert len(found.branches) == 3 and found.left > 0
    (alone,) = follow_onwards([rest(2.0)], within(*RANGE)).branches
    assert alone.sequence == ""


def test_of_two_mirror_images_one_is_followed():
    """Both begin where the symmetry breaks. Behind their grazing the family between them returns to the symmetric one."""
    found = follow_onwards([rest(2.0)], within(0.965, 2.2), through=("GR", "SB"))
    (broken,) = (k for k, branch in enumerate(found.branches) if not branch.problem.half and len(branch.sequence) == 4)
    assert [event for _, event, number in found.links if number == broken] == ["SB1", "SB1", "GR1"]
