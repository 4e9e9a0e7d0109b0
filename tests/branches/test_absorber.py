"""The absorber under a harmonic load (scene `absorber`, F = 0.3): the numbers of docs/absorber.md.

Oracle: `forced_digits`, orbits and events in forty digits by single shooting with textbook saltation matrices; and what must be the same
from another start, in another direction and with other steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mpmath as mp
import numpy as np
import pytest

import saltus
from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from branches.forced.onwards import ResponseStart, follow_onwards, trace_start
from branches.forced.tracing import follow_response, switch_response
from continuation.run import follow_both_ways
from tests.branches.forced_digits import ForcedDigits
from tests.branches.test_forced_sticking import turned
from tests.docs.pages import page, table
from transitions.response.path import ParameterPath
from transitions.response.starting import linear_response
from transitions.response.tracing import simulated_start

RANGE = (0.7, 2.2)
ABSORBER = saltus.load_scene("absorber").parametric
EVENTS = table(page("../absorber.md"), "All bifurcations")
FAST = [cells for cells in EVENTS if int(cells[2]) <= (2 if cells[0] == "GR" else 4)]
"""Events of the others are compared in tests/full."""


@cache
def whole():
    """All families that are linked with the response without impacts by grazings and broken symmetries."""
    starts = []
    for w in (0.72, 2.0):
        problem, y, why = linear_response(ParameterPath(ABSORBER, ["w"], [], {"w": w}))
        assert why is None
        starts.append(ResponseStart(problem, y))
    found = follow_onwards(starts, lambda start: trace_start(start, RANGE), through=("GR", "SB"))
    assert not found.notes and not found.left
    return found


@cache
def located():
    """(branch, event) of each bifurcation and grazing, once: by type, symmetry, impacts in a period and value."""
    found = {}
    for branch in whole().branches:
        half = branch.problem.half
        impacts = len(branch.sequence) * (2 if half else 1)
        for event in branch.events:
            if event.type != "EP":
                of = event.type, half, impacts
                if not any(key[:3] == of and abs(key[3] - event.values["w"]) < 1e-9 for key in found):
                    found[(*of, event.values["w"])] = branch, event
    return found


def of_row(cells):
    """The branch and the event of a row of the page."""
    kind, symmetric, impacts, value = cells[0], cells[1] == "yes", int(cells[2]), float(cells[3])
    near = [pair for key, pair in located().items() if key[:3] == (kind, symmetric, impacts) and abs(key[3] - value) < 2e-9]
    assert len(near) == 1, (cells, len(near))
    return near[0]


def test_the_table_of_the_page_is_whole():
    """Oracle: each event of the families that are no grazing has its row, and no row has none."""
    rows = sorted((cells[0], cells[1] == "yes", int(cells[2]), float(cells[3])) for cells in EVENTS if cells[0] != "GR")
    computed = sorted(key for key in located() if key[0] not in ("GR", "BP"))
    assert rows == [(*of, pytest.approx(w, abs=1e-9)) for *of, w in computed]
    assert len(whole().branches) == 22


@cache
def in_digits(*cells):
    """The orbits next to the event of a row in many digits, and the event there."""
    branch, event = of_row(cells)
    exact = ForcedDigits(branch.problem, branch.unknowns[event.point])
    return exact, exact.event(event.type)


def require_event(cells):
    """Oracle: the event in many digits; its multipliers."""
    branch, event = of_row(cells)
    exact, at = in_digits(*cells[:4])
    assert float(cells[3]) == pytest.approx(float(at[4]), abs=1e-12)
    assert event.values["w"] == pytest.approx(float(at[4]), abs=2e-13)
    if event.type == "GR":
        return
    found = sorted((complex(value) for value in exact.multipliers(at)), key=abs)
    assert np.abs(branch.problem.multipliers(branch.unknowns[event.point])).max() == pytest.approx(abs(found[-1]), rel=1e-9)
    if event.type == "NS":
        angle = min(abs(np.angle(value)) for value in found if abs(abs(value) - 1.0) < 1e-12)
        assert event.angle == pytest.approx(angle, abs=1e-9)


@pytest.mark.parametrize("cells", [cells for cells in FAST if int(cells[2])][::3], ids=lambda cells: f"{cells[0]} {cells[3]}")
def test_events(cells):
    """Oracle: `require_event`."""
    require_event(cells)


@pytest.mark.parametrize("value", [0.733064346690, 1.363310284830])
def test_the_response_without_impacts_touches_both_stops(value):
    """Oracle: the amplitude of the gap, (K - w^2 M + i w C)^-1 F in many digits."""
    mp.mp.dps = 30

    def gap(w):
        s, c = mp.mpf("0.1"), mp.mpf("0.005")
        between = s + 1j * w * c
        own = [between - w * w * mp.mpf("0.1"), 1 + between - w * w + 1j * w * mp.mpf("0.02")]
        k = mp.matrix([[own[0], -between], [-between, own[1]]])
        found = mp.lu_solve(k, mp.matrix([0, mp.mpf("0.3")]))
        return abs(found[0] - found[1]) - 1

    root = float(mp.findroot(gap, value))
    assert root == pytest.approx(value, abs=1e-12)
    grazings = [event.values["w"] for branch in whole().branches for event in branch.events if event.type == "GR" and not branch.sequence]
    assert min(abs(w - root) for w in grazings) < 1e-13


@pytest.mark.parametrize("step", [SETTINGS.maximum_step])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_fold_and_a_pitchfork_that_are_1e_6_apart(step, sign):
    """Oracle: see `require_a_fold_and_a_pitchfork_that_are_1e_6_apart`."""
    require_a_fold_and_a_pitchfork_that_are_1e_6_apart(step, sign)


def require_a_fold_and_a_pitchfork_that_are_1e_6_apart(step, sign):
    """The symmetric response breaks its symmetry at w = 0.781365496480, and the unsymmetric one that leaves there folds at 0.781366314994.

    Oracles: both values in many digits; the same events in both directions along each family and with normal and with small steps."""
    settings = replace(SETTINGS, maximum_step=step, initial_step=min(step, 0.1 * SETTINGS.maximum_step), maximum_points=20000)
    rows = ("SB", "yes", "2", "0.781365496480"), ("SN", "no", "2", "0.781366314994")
    (symmetric, pitchfork), (unsymmetric, fold) = map(of_row, rows)
    exact = [float(in_digits(*row)[1][4]) for row in rows]
    assert exact[1] - exact[0] == pytest.approx(8.185137e-7, abs=1e-13)
    window = (0.77, 0.79)

    def followed(branch, event):
        begun = branch.unknowns[event.point - 2 if event.point > 2 else event.point + 2]
        return follow_both_ways(ForcedFamily(branch.problem, window), begun, settings, direction=sign).events

    codes = {"SN", "SB", "BP", "PD", "NS"}
    found = [(event.code, event.point.parameter) for event in followed(symmetric, pitchfork) if event.code in codes]
    assert [code for code, _ in found] == ["SB"] and found[0][1] == pytest.approx(exact[0], abs=1e-13)
    found = sorted((event.code, event.point.parameter) for event in followed(unsymmetric, fold) if event.code in codes)
    near = [(code, value) for code, value in found if abs(value - exact[0]) < 1e-5]
    assert near[-1] == ("SN", pytest.approx(exact[1], abs=1e-13))
    # The unsymmetric family goes through the symmetric orbit into its mirror image: a branch point, with a fold on each side.
    assert {code for code, _ in near} <= {"BP", "SN"}
    assert [value for code, value in near if code == "BP"] == pytest.approx([exact[0]], abs=1e-10)


def test_a_doubled_family_ends_at_an_orbit_of_the_single_period():
    """Oracle: p is minimal. Where an orbit of twice the period grazes that is twice another one, an impact can appear in each of its two
    parts: this is the family of the single period, which is symmetric here."""
    branch, event = of_row(["PD", "no", "5", "0.980029900377"])
    for _ in range(2):
        ((problem, step),) = switch_response(branch, event)
        branch = follow_response(problem, step, RANGE, direction="along")
        assert branch.problem.load_periods == 2
        (event,) = (one for one in branch.events if one.type == "GR")
    symmetric, grazing = of_row(["GR", "yes", "4", "0.965116377128"])
    assert event.values["w"] == pytest.approx(grazing.values["w"], abs=1e-12)
    # One impact vanishes at one of four images of a place, and the three other images touch. The earliest touch counts, half a period of
    # the loads later: the family there has twice the period and one impact more. A simulation comes back to its orbit.
    found = switch_response(branch, event)
    assert {(problem.load_periods, len(problem.sequence) * (1 + problem.half)) for problem, _ in found} == {(1, 4), (2, 10)}
    ((problem, step),) = (one for one in found if not one[0].half)
    assert all(step.extra[name] > 1e-3 for name in ("clearance", "speed", "flight"))
    at, period, largest = problem.parameters(step.y), problem.period(step.y), np.abs(problem.multipliers(step.y)).max()
    state, fraction = problem.fly(problem.nodes(step.y)[0], 0.5 * problem.flight_times(step.y)[0], 0)
    forces = [turned(force, force.frequency * fraction * period) for force in problem.parametric.forces(at)]
    motion = saltus.simulate(problem.parametric.system(at), state[:2], state[2:], period, forces=forces)
    assert motion.impacts == 10 and np.abs(motion.final - state).max() < 1e-12 * largest
    ((problem, step),) = (one for one in found if one[0].half)
    assert len(problem.sequence) == 2
    ahead = follow_response(problem, step, RANGE, direction="along")
    bifurcations = [(one.type, one.values["w"]) for one in symmetric.events if one.type in ("SN", "NS", "SB")]
    found = [(one.type, pytest.approx(one.values["w"], abs=1e-12)) for one in ahead.events if one.type in ("SN", "NS", "SB")]
    assert bifurcations in (found, found[::-1])


def test_a_family_that_closes_has_the_same_events_from_any_of_them():
    """The symmetric response with ten impacts closes on itself. It is begun at the simulated motion, and at each place where it breaks its
    symmetry. The test functions of the first step are those of its orbit."""
    path = ParameterPath(ABSORBER, ["w"], [], {"w": 0.9436})
    found = simulated_start(path, None, None, phase=0.0, most=3000)[1]
    branch = follow_response(found.problem, found.y)
    wanted = sorted((event.type, event.values["w"]) for event in branch.events)
    assert [code for code, _ in wanted] == ["NS", "SB", "SB", "SN", "SN"] and branch.ended[0].reason == "CLOSED"
    breaking = [branch.unknowns[event.point] for event in branch.events if event.type == "SB"]
    family = ForcedFamily(found.problem)
    for y in breaking:
        events = sorted((event.type, event.values["w"]) for event in follow_response(found.problem, y).events)
        assert [code for code, _ in events] == [code for code, _ in wanted]
        assert [value for _, value in events] == pytest.approx([value for _, value in wanted], abs=1e-11)
        begun = follow_both_ways(family, y, replace(SETTINGS, maximum_points=4), both=False)
        assert begun.points[1].step.tests[7] == pytest.approx(family.begin(begun.points[1].step.y).tests[7], rel=1e-9)


def test_the_response_without_impacts_loses_its_stability_where_a_damper_feeds_it():
    """Oracle: the value of lam at which two rates of free motion are imaginary, in many digits; the angle of half a period."""
    problem, y, why = linear_response(ParameterPath(ABSORBER, ["lam"], [], {"w": 2.0}))
    assert why is None
    branch = follow_response(problem, y, (-0.1, 0.03))
    found = [event for event in branch.events if event.type == "NS"]
    mp.mp.dps = 30

    def imaginary(lam, rate):
        s, c, at = mp.mpf("0.1"), mp.mpf("0.005"), 1j * rate
        determinant = (mp.mpf("0.1") * at**2 + c * at + s) * (at**2 + (lam + c) * at + 1 + s) - (s + c * at) ** 2
        return [determinant.real, determinant.imag]

    exact = [mp.findroot(imaginary, (event.values["lam"], rate)) for event, rate in zip(found, (1.2, 0.85), strict=True)]
    for event, (lam, rate) in zip(found, exact, strict=True):
        assert event.values["lam"] == pytest.approx(float(lam), abs=1e-13)
        turned = float(rate) * np.pi / 2.0 + np.pi  # the map over half a period changes the sign
        assert event.angle == pytest.approx(abs(np.angle(np.exp(1j * turned))), abs=1e-9)
    border = found[-1].values["lam"]
    assert set(branch.stable[branch.parameter > border + 1e-3]) == {1}
    assert 1 not in branch.stable[branch.parameter < border - 1e-3]
