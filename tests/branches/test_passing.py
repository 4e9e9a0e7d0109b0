"""Runs that are stuck beside branch points: the longest of several, and families of which one side is the image of the other."""

import saltus
from branches.passing import PARTS, is_half, longest


def test_runs_start_elsewhere_until_none_is_stuck():
    """Oracle: the lengths that are given."""
    asked = []

    def again(run, part):
        asked.append(part)
        return run + 1.0 if part == PARTS[1] else run - 0.5

    assert longest(1.0, again, lambda run: run < 2.0, lambda run: run) == 2.0
    assert asked == list(PARTS[:2])
    assert longest(3.0, again, lambda run: False, lambda run: run) == 3.0 and len(asked) == 2
    assert longest(0.0, lambda run, part: -1.0, lambda run: True, lambda run: run) == 0.0


def test_a_family_beside_its_symmetry_breaking_is_a_half():
    """Oracle: the family with U1110+ at h = 0.5 is born where S13O00+ loses its half-period symmetry, at its own lowest energy
    0.4555854652; at its other end it grazes, and has no more symmetry than elsewhere."""
    born = saltus.trace("U1110+@h=0.5", energy=(0.3, 0.8))
    beside = born.trace(len(born) - 3, direction="down", stop_when=lambda orbit: orbit.h < 0.455588)
    lower = 0 if beside.points["h"][0] < beside.points["h"][-1] else 1
    assert beside.ended[lower].reason == "STOP_WHEN"
    assert is_half(beside, lower) and not is_half(beside, 1 - lower)
