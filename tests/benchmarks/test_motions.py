"""The benchmarks of sections and studies: the integrator finds the same motions, and the tables are complete. No time is asserted."""

import numpy as np

import saltus
from benchmarks import motions
from benchmarks.measure import Difference
from benchmarks.motions import integrate, integrated_section, plan, section_table, study, study_table, tail_time
from transitions.section.plane import SectionPlane
from transitions.study.runs import run_block


def test_the_integrator_finds_the_same_points():
    """Oracle: solve_ivp with tolerance 1e-10, in steps so short that it sees its events, from the same starts."""
    system = saltus.vibro_impact_nes()
    plane = SectionPlane(system, 0.06)
    starts = plane.starts(4)
    found = saltus.section(system, 0.06, starts=starts, crossings=6)
    for start, points, growth in zip(starts, found.points, found.growths, strict=True):
        (u,), (v,) = plane.states([start])
        states = integrated_section(0.1, 0.1, u, v, 5, 1e-10, step=0.02)
        assert np.abs(plane.coordinates(states[:, :2], states[:, 2:]) - points[1:]).max() < 1e-9 * np.exp(growth.max())


def test_each_energy_has_a_row():
    """Oracle: the energies; both methods conserve the energy."""
    table = section_table(quick=True)
    assert [row[0] for row in table.rows] == ["0.06", "0.3"] and {len(row) for row in table.rows} == {len(table.columns)}
    assert all(float(row[3]) < 1e-11 and float(row[5]) < 1e-6 for row in table.rows)


def test_the_report_of_a_study_is_its_runs():
    """Oracle: the same runs in this process; scipy's integrator finds the same impacts, and an error of the size of its tolerance."""
    found = study(60, 1)
    wanted = plan(60)
    columns = run_block(wanted, wanted.values(0, 60))
    assert found.runs == 60 and found.impacts == columns["impacts"].sum() and np.array_equal(found.energies, columns["h"])
    assert found.memory == sum(values.nbytes for values in columns.values()) / 60 < 200 and found.error < 1e-12
    few = np.argsort(columns["impacts"])[:2]
    other = integrate(found.energies[few], found.last[few])
    assert other.impacts == columns["impacts"][few].sum() and 1e-15 < other.worst < 1e-6
    table = study_table([found], other, (2e-5, Difference(1e-6, 5e-7)))
    assert "Of 20.0 us of processor a run, about 1 us come after the last impact" in table.notes[1]
    assert f"60 runs with {found.impacts} impacts" in table.notes[0] and [row[0][:9] for row in table.rows] == ["saltus st", "solve_ivp"]


def test_the_tail_of_a_run_is_the_difference_of_least_times(monkeypatch):
    """Oracle: by hand, with a clock that says 9, 7, 8 for the complete runs, and 5, 6, 4 for those that end with their last impact.
    The median is a second above the least of either."""
    clock, found = iter((9.0, 7.0, 8.0, 5.0, 6.0, 4.0)), []

    def timed(runs):
        found.append(runs().summary[:, 2])
        return runs(), next(clock)

    monkeypatch.setattr(motions, "timed", timed)
    assert tail_time(np.array([0.5, 2.0])) == (3.5, (1.5, 1.0))
    assert len(found) == 6 and all(np.array_equal(impacts, found[0]) for impacts in found)
