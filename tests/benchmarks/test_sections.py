"""The benchmark of sections: its second method finds the same points, and the table is printed. No time is asserted."""

import numpy as np

import saltus
from benchmarks import sections
from transitions.section_plane import SectionPlane


def test_the_integrator_finds_the_same_points():
    """Oracle: solve_ivp, whose tolerance is 1e-10, in steps so short that its events are seen, from the same starts."""
    system = saltus.vibro_impact_nes()
    plane = SectionPlane(system, 0.06)
    starts = plane.starts(4)
    found = saltus.section(system, 0.06, starts=starts, crossings=6)
    for start, points, growth in zip(starts, found.points, found.growths, strict=True):
        (u,), (v,) = plane.states([start])
        states = sections.integrated(0.1, 0.1, u, v, 5, 1e-10, step=0.02)
        assert np.abs(plane.coordinates(states[:, :2], states[:, 2:]) - points[1:]).max() < 1e-9 * np.exp(growth.max())


def test_the_table_is_printed(capsys):
    """Oracle: a row for each energy."""
    sections.main(quick=True)
    assert capsys.readouterr().out.count("\n| 0.") == 2
