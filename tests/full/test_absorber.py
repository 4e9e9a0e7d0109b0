"""The absorber under a harmonic load: what the sweep and the families say of each other, and the events of responses with many impacts.

Events of responses with few impacts are in tests/branches/test_absorber.py.
"""

from functools import cache

import numpy as np
import pytest

import saltus
from branches.family import SETTINGS
from branches.forced.tracing import follow_response, switch_response
from bvp.simulate import simulate
from tests.branches.forced_digits import ForcedDigits
from tests.branches.test_absorber import (
    ABSORBER,
    EVENTS,
    FAST,
    RANGE,
    of_row,
    require_a_fold_and_a_pitchfork_that_are_1e_6_apart,
    require_event,
    whole,
)
from tests.docs.pages import page, table
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit

DOUBLED = table(page("../absorber.md"), "Period doublings")
NEIMARK_SACKER = [("1.318979577798", -1.0), ("2.062831187243", 1.0)]
"""On the symmetric response with two impacts, and the side of w on which it is stable."""


@pytest.mark.parametrize("cells", [cells for cells in EVENTS if cells not in FAST], ids=lambda cells: f"{cells[0]} {cells[3]}")
def test_events_with_many_impacts(cells):
    """Oracle: `require_event`."""
    require_event(cells)


@cache
def doubled(value):
    """The family of twice the period that begins at the PD of a row of the page."""
    (row,) = (cells for cells in EVENTS if cells[0] == "PD" and cells[3] == value)
    branch, event = of_row(row)
    ((problem, step),) = switch_response(branch, event)
    return follow_response(problem, step, RANGE, direction="along")


def test_each_period_doubling_has_a_row():
    assert [cells[0] for cells in DOUBLED] == [cells[3] for cells in EVENTS if cells[0] == "PD"]


@pytest.mark.parametrize("cells", DOUBLED, ids=lambda cells: cells[0])
def test_families_that_begin_at_a_period_doubling(cells):
    """Oracle: the next period doubling in many digits. The doubled orbits are stable up to it, and end at a grazing."""
    value, impacts, direction, following, digits, grazing = cells
    branch = doubled(value)
    assert branch.problem.load_periods == 2 and len(branch.sequence) == int(impacts)
    assert direction == ("up" if branch.parameter[1] > float(value) else "down")
    assert branch.ended[1].reason == "EVENT" and branch.parameter[-1] == pytest.approx(float(grazing), abs=1e-12)
    doublings = [event for event in branch.events if event.type == "PD"]
    last = doublings[0].point if doublings else len(branch) - 1
    assert set(branch.stable[1:last]) <= {1}
    assert [event.values["w"] for event in doublings] == pytest.approx([] if following == "none" else [float(following)], abs=0.7e-12)
    if doublings:
        exact = ForcedDigits(branch.problem, branch.unknowns[doublings[0].point]).event("PD")[4]
        assert doublings[0].values["w"] == pytest.approx(float(exact), abs=2e-13)
        assert float(digits) == pytest.approx(float(exact), abs=1e-15) and f"{float(exact):.12f}" == following


def at(w):
    return ABSORBER.system({"w": w}), ABSORBER.forces({"w": w})


def orbits_at(branches, w):
    """(problem, unknowns) of the stable orbits of some branches at w."""
    found = []
    for branch in branches:
        values = branch.parameter
        for k in np.flatnonzero((values[:-1] - w) * (values[1:] - w) <= 0.0):
            if branch.stable[k] or branch.stable[k + 1]:
                near = follow_response(branch.problem, branch.unknowns[k], (w - 0.1, w + 0.1), values=(w,), points=40)
                found += [(branch.problem, near.unknowns[event.point]) for event in near.events if event.type == "UZ"]
    # From two points of a branch next to each other the same orbit can be reached, and from one of them two.
    unlike: list = []
    for problem, y in found:
        known = any(len(y) == len(other) and np.abs(y - other).max() < 1e-8 for _, other in unlike)
        if not known and np.abs(problem.multipliers(y)).max() < 1.0:
            unlike.append((problem, y))
    return unlike


def speeds_of(problem, y):
    """Impact speeds in the full period, sorted."""
    return np.sort(np.tile(problem.impact_speeds(y), 2 if problem.half else 1))


def speeds_in(run, k):
    """Impact speeds of a sweep in one period of the motion at its value k, sorted."""
    rows = slice(run.offsets[k], run.offsets[k + 1])
    return np.sort(run.impact_speeds[rows][run.impact_periods[rows] < run.periods[k]])


@pytest.mark.parametrize(
    ("values", "agree"),
    [(np.linspace(0.78, 0.91, 14), 14), (np.linspace(0.97, 1.31, 35), 35), (np.linspace(1.14, 0.97, 18), 18)],
    ids=["below the resonance", "up", "down"],
)
def test_periodic_motions_of_a_sweep_are_orbits_of_the_stable_families(values, agree):
    """Oracle: two methods, simulation and boundary-value problems. The families are those of the page, with those of twice the period.
    At w = 0.98 motions are chaotic for some thousand periods before they settle; for how many rounding decides."""
    run, _ = saltus.sweep(at, values, settings=saltus.SweepSettings(transient=12000, record=20))
    families = [*whole().branches, *(doubled(cells[0]) for cells in DOUBLED)]
    same = 0
    for k, w in enumerate(run.values):
        if not run.periods[k]:
            continue
        speeds = speeds_in(run, k)
        of_kind = [
            branch
            for branch in families
            if branch.problem.load_periods == run.periods[k] and len(branch.sequence) * (1 + branch.problem.half) == len(speeds)
        ]
        orbits = orbits_at(of_kind, w)
        assert orbits, w
        assert min(np.abs(speeds_of(*orbit) - speeds).max() for orbit in orbits) < 1e-8
        same += 1
    assert same == agree


@pytest.mark.parametrize("w", [2.0742, 2.0806])
def test_the_second_stable_piece_with_two_impacts_is_reached(w):
    """Oracle: a simulation that starts beside the orbit, with velocities changed by 0.1 %, settles on it."""
    branch, _ = of_row(["NS", "yes", "2", "2.062831187243"])
    ((problem, y),) = orbits_at([branch], w)
    node = problem.nodes(y)[0]
    settled = saltus.settle(*at(w), node[:2], 1.001 * node[2:4], phase=2.0 * np.pi * node[4])
    assert settled.period == 1
    assert np.sort(settled.impacts.speeds) == pytest.approx(speeds_of(problem, y), abs=1e-8)


def test_an_isolated_family_of_ten_impacts_closes():
    """Oracle: its ends in w, as the page has them, from a motion to which a simulation settles; both are folds in many digits."""
    state = np.array([4.828872276412282, 5.173399313758923, 10.915419232248402, 8.80982713899319])
    path = ParameterPath(ABSORBER, ["w"], [], {"w": 0.944})
    found = settled_orbit(path, saltus.settle(*at(0.944), state[[0, 1]], state[[2, 3]]))
    branch = follow_response(found.problem, found.y, RANGE)
    assert found.problem.half and len(found.problem.sequence) == 5
    assert [end.reason for end in branch.ended] == ["CLOSED", "CLOSED"]
    folds = sorted((event for event in branch.events if event.type == "SN"), key=lambda event: event.values["w"])
    assert [event.values["w"] for event in (folds[0], folds[-1])] == pytest.approx([0.943432071, 0.956814163], abs=0.51e-9)
    for event in (folds[0], folds[-1]):
        exact = ForcedDigits(branch.problem, branch.unknowns[event.point]).event("SN")[4]
        assert event.values["w"] == pytest.approx(float(exact), abs=2e-13)


@pytest.mark.parametrize(("value", "stable_side"), NEIMARK_SACKER)
def test_a_motion_beside_a_neimark_sacker_bifurcation_turns_with_its_angle(value, stable_side):
    """Oracle: the rotation number of the simulated map over half a period, from the unwrapped phase of states beside the orbit. It is the
    angle of the multipliers there, and tends to that of the event."""
    branch, event = of_row(["NS", "yes", "2", value])
    away = []
    for distance in (4e-3, 2e-3, 1e-3):
        w = event.values["w"] + stable_side * distance
        ((problem, y),) = orbits_at([branch], w)
        turned = rotation(problem, y, w)
        multiplier = max(problem.multipliers(y), key=abs)
        assert turned == pytest.approx(abs(np.angle(multiplier)), abs=1e-5)
        away.append(turned - event.angle)
    assert abs(2.0 * away[2] - away[1]) < 1e-5  # its limit at the event, from two distances


def rotation(problem, y, w, turns=1500):
    """Mean angle in (0, pi) by which a simulated motion beside an orbit turns around it in half a period."""
    system, forces = at(w)
    node = problem.nodes(y)[0]
    orbit = saltus.settle(system, forces, node[:2], node[2:4], phase=2.0 * np.pi * node[4]).states[0]
    beside = orbit * (1.0 + 1e-5 * np.array([1.0, -1.0, 1.0, 1.0]))
    times = np.arange(turns) * np.pi / w
    u, v = simulate(system, beside[:2], beside[2:], times[-1] + 0.1, forces=forces).sample(times)
    signs = (-1.0) ** np.arange(turns)
    apart = signs[:, None] * np.concatenate([u, v], axis=1) - orbit
    steps = np.diff(np.unwrap(np.angle(apart[:, 1] + 1j * apart[:, 3])))[100:]  # the other multipliers are gone
    place = (np.arange(len(steps)) + 0.5) / len(steps)
    weights = np.exp(-1.0 / (place * (1.0 - place)))  # such a mean converges fast for a motion with two frequencies
    return abs(weights @ steps / weights.sum())


@pytest.mark.parametrize("cells", [cells for cells in FAST if int(cells[2])], ids=lambda cells: f"{cells[0]} {cells[3]}")
def test_events(cells):
    """Oracle: `require_event`."""
    require_event(cells)


@pytest.mark.parametrize("step", [SETTINGS.maximum_step, 0.005])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_fold_and_a_pitchfork_that_are_1e_6_apart(step, sign):
    """Oracle: see `require_a_fold_and_a_pitchfork_that_are_1e_6_apart`."""
    require_a_fold_and_a_pitchfork_that_are_1e_6_apart(step, sign)
