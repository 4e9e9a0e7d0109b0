"""Curves of forced orbits in two parameters against closed forms, many digits and the branches through their points."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from branches.curves.grazing import observed
from branches.curves.record import BifurcationCurve
from branches.curves.starting import NoCurve, curve_start
from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from branches.forced.family import ForcedFamily
from branches.forced.resequencing import exchanged
from branches.forced.tracing import follow_response, switch_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from saltus.scene import load_scene
from tests.branches.curve_oracles import AbsorberOrbit, ImpactOscillator, doubling_stop, fold_stop
from tests.branches.forced_systems import absorber_families, oscillator, settled
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle

EVERYWHERE = ((-math.inf, math.inf), (-math.inf, math.inf))
COCO = ImpactOscillator("0.1", "0.8")
WALL = ImpactOscillator("0.04", "0.9", periods=2)


def event_of(branch, code, number=0):
    return [event for event in branch.events if event.type == code][number]


def started(branch, event, names, **options):
    return curve_start(branch.problem, branch.unknowns[event.point], event.type, names, angle=event.angle, **options)


def ids(curve):
    return [event.id for event in curve.events]


def places(curve, code):
    return [curve.parameters[event.point] for event in curve.events if event.type == code]


@cache
def without_damping():
    """x'' + x = cos(w t), r = 0.8, one impact a period, over the place of the stop."""
    problem, y = settled(oscillator(), ["s"], values={"s": -0.2}, start=([-1.0], [0.0]))
    return follow_response(problem, y, (-3.0, 1.0))


@cache
def curve_without_damping(code):
    branch = without_damping()
    return follow_curve(started(branch, event_of(branch, code), ("w", "s")), ((1.2, 6.0), (-5.0, 1.0)))


@pytest.mark.parametrize(("code", "form"), [("SN", fold_stop), ("PD", doubling_stop)])
def test_curves_without_damping_are_those_of_the_formula(code, form):
    """Oracle: the closed forms of design section 9, to 1e-12 at each point. All three curves meet at w = 2, s = 1/3."""
    curve = curve_without_damping(code)
    for w, s in curve.parameters:
        if abs(w - 2.0) > 1e-9:
            assert s == pytest.approx(float(form(w, 0.8)), rel=1e-12, abs=1e-12)
    assert curve.residual.max() < 1e-12
    assert not {"R1", "R2", "NS", "FF", "FN"} & {event.type for event in curve.events}


def test_the_curve_of_doublings_ends_at_the_grazing():
    """Oracle: w = 2 n/m with odd m, s = 1/|1 - w^2|."""
    (place,) = places(curve_without_damping("PD"), "PD-GR")
    assert place == pytest.approx([2.0, 1.0 / 3.0], abs=1e-12)


def orbit_of(oscillator, scene, one, names, periods=1):
    """The orbit of a closed form as one of the program."""
    parametric = scene.parametric
    w, amplitude = float(one.w), float(one.amplitude)
    problem = ForcedProblem(parametric, ("+",), ("A",), load_periods=periods, values={"w": w, "A": amplitude})
    d = float(one.distance) if scene.title.startswith("Damped") else 0.0
    restitution = float(oscillator.restitution)
    y = problem.pack([[d, -restitution * float(one.speed)]], [float(one.phase) / (2.0 * math.pi * periods)], [amplitude])
    return problem, y


CASES = {
    "coco": (COCO, "damped_impact_oscillator", {}, 1, 2, (0.7, 1.4)),
    "wall": (WALL, "oscillator_at_wall", {"c": 0.04}, 2, 5, (0.7, 0.95)),
}


@cache
def meeting_curves(case) -> dict[str, BifurcationCurve]:
    """The curves SN, PD and GR of one degree of freedom that meet in a point, started from orbits of the closed form beside it."""
    one, name, given, periods, halves, span = CASES[case]
    scene, w = load_scene(name, **given), float(one.meeting(halves))
    found = {}
    for code, form in (("SN", one.fold), ("PD", one.doubling)):
        for beside in (w + 0.004, w - 0.004):
            try:
                problem, y = orbit_of(one, scene, form(beside), ("w", "A"), periods)
            except ValueError:
                continue  # on this side the impact would pull
            found[code] = follow_curve(curve_start(problem, y, code, ("w", "A")), (span, (0.01, 3.0)))
            break
    graze = one.grazing(w + 0.05)
    problem, y = orbit_of(one, scene, graze, ("w", "A"), periods)
    found["GR"] = follow_curve(curve_start(problem, y, "GR", ("w", "A")), (span, (0.01, 3.0)))
    return found


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("code", ["SN", "PD", "GR"])
def test_curves_of_one_degree_of_freedom(case, code):
    """Oracle: the closed form in 40 digits, at each point of the curve."""
    one = CASES[case][0]
    form = {"SN": one.fold, "PD": one.doubling, "GR": one.grazing}[code]
    curve = meeting_curves(case)[code]
    assert len(curve) > 20
    for (w, amplitude), y in list(zip(curve.parameters, curve.unknowns, strict=True))[::7]:
        try:
            exact = form(w)
        except ValueError:  # at the meeting itself rounding decides the side
            continue
        assert amplitude == pytest.approx(float(exact.amplitude), rel=1e-12)
        assert -curve.plane.problem.states(y)[0, 1] / float(one.restitution) == pytest.approx(float(exact.speed), abs=1e-9)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("code", "types"), [("SN", {"SN-GR"}), ("PD", {"PD-GR"}), ("GR", {"SN-GR", "PD-GR"})])
def test_fold_doubling_and_grazing_meet(case, code, types):
    """Oracle: w = 2 p sqrt(k - c^2/4)/m, to 1e-9 from each of the three curves (here 1e-12)."""
    one, *_, halves, _ = CASES[case]
    w = one.meeting(halves)
    wanted = [float(w), float(one.grazing(w).amplitude)]
    curve = meeting_curves(case)[code]
    for kind in types:
        assert min(np.abs(place - wanted).max() for place in places(curve, kind)) < 1e-12
    assert not {"NS", "R1", "R2"} & {event.type for event in curve.events}


def test_the_grazing_where_a_fold_ends_is_that_of_the_family():
    """Oracle: the closed form of the grazing. The orbit of two periods repeats itself but for its touch, so the touch of its image is no
    second grazing, wherever the curve is started: it runs through the whole window."""
    fold, family = (meeting_curves("wall")[code] for code in ("SN", "GR"))
    place = min((event.point for event in fold.events if event.type == "SN-GR"), key=lambda k: abs(fold.parameters[k, 0] - WALL.meeting(5)))
    start = curve_through(fold, place, "GR")
    found = follow_curve(start, ((0.7, 0.95), (0.01, 3.0)))
    assert start.grazing.repeats == (1, False)
    assert sorted(ids(found)) == sorted(ids(family)) and "GR-GR" not in {event.type for event in found.events}
    assert found.parameters[:, 0].min() == pytest.approx(0.7, rel=1e-12) and found.parameters[:, 0].max() == pytest.approx(0.95, rel=1e-12)
    for w, amplitude in found.parameters[::5]:
        assert amplitude == pytest.approx(float(WALL.grazing(w).amplitude), rel=1e-12)


def test_the_fold_at_the_wall_becomes_inadmissible_by_a_touch():
    """Oracle: the touch in the other swing, in 40 digits. The curve ends there, with that reason."""
    curve = meeting_curves("wall")["SN"]
    touch, _ = WALL.touching(WALL.fold, 0.788, 10.45)
    ends = [(curve.parameters[k], ended.text) for k, ended in zip((0, -1), curve.ended, strict=True)]
    place, text = next((place, text) for place, text in ends if "touches stop" in text)
    assert place == pytest.approx([float(touch.w), float(touch.amplitude)], rel=1e-12)
    assert text.startswith("SN-GR at w = 0.788122256363 and A = 0.35064902634")


ABSORBER = ((0.5, 3.0), (0.05, 3.5))


@cache
def absorber_curve(family, code, number=0, window=ABSORBER):
    branch = absorber_families()[family]
    return follow_curve(started(branch, event_of(branch, code, number), ("w", "F")), window)


@pytest.mark.parametrize(("family", "code"), [(0, "SN"), (1, "SN"), (2, "PD")])
def test_points_of_the_absorber_have_their_multiplier(family, code):
    """Oracle: see `require_points_of_the_absorber_have_their_multiplier`."""
    require_points_of_the_absorber_have_their_multiplier(family, code)


def require_points_of_the_absorber_have_their_multiplier(family, code):
    """Oracle: products of matrix exponentials and saltation matrices."""
    curve = absorber_curve(family, code)
    u = curve.plane.size
    for i in range(1, len(curve) - 1, max(1, len(curve) // 12)):
        orbit = AbsorberOrbit.of(curve.plane.problem, curve.unknowns[i, :u])
        assert orbit.residual() < 1e-11
        # A double multiplier is known to the root of rounding.
        assert orbit.distance(code) < (1e-8 if np.min(np.abs(np.diff(np.sort(np.abs(orbit.multipliers()))))) > 1e-3 else 1e-4)


def test_grazings_of_the_absorber_touch():
    """Oracle: the dense path of matrix exponentials."""
    curve = absorber_curve(0, "GR")
    for i in range(1, len(curve) - 1, 60):
        orbit = AbsorberOrbit.of(curve.plane.problem, curve.unknowns[i, : curve.plane.size])
        assert np.abs(orbit.impact_speeds()).min() < 1e-9


@pytest.mark.parametrize(("family", "code"), [(0, "SN"), (0, "NS"), (1, "SB"), (2, "PD")])
def test_a_branch_through_a_point_of_a_curve_has_the_event(family, code):
    """The family at one value of F through a point of the curve has the event there, to 1e-9."""
    curve = absorber_curve(family, code)
    i = len(curve) // 3
    w, f = curve.parameters[i]
    problem = curve.plane.problem
    single = ForcedProblem(
        problem.parametric, problem.sequence, ("w",), load_periods=problem.load_periods, half=problem.half,
        values=problem.parameters(curve.unknowns[i, : curve.plane.size]),
    )  # fmt: skip
    nodes, y = problem.nodes(curve.unknowns[i, : curve.plane.size]), curve.unknowns[i, : curve.plane.size]
    start = single.pack(nodes[:, :4], nodes[:, 4], [w], problem.flight_times(y))
    # A fold's own parameter does not determine its orbit: the branch is started beside it.
    begin = single.step(start, np.zeros(2 * single.unknowns), 0.0)
    branch = follow_response(single, single.step(begin.y, begin.tangent, 1e-3).y, (w - 0.02, w + 0.02))
    assert min(abs(event.values["w"] - w) for event in branch.events if event.type == code) < 1e-9
    assert problem.parameters(y)["F"] == pytest.approx(f)


def test_curves_of_the_absorber_meet_where_both_have_the_point():
    """The same point of codimension two is located on both curves, each with its own equations."""
    first, second = absorber_curve(0, "NS"), absorber_curve(0, "SN")
    (one,), (other,) = places(first, "FN"), places(second, "FN")
    assert one == pytest.approx(other, abs=1e-9)
    one, other = places(absorber_curve(1, "NS"), "R1")[0], places(absorber_curve(1, "SN"), "R1")
    assert min(np.abs(one - place).max() for place in other) < 1e-9


def test_the_absorber_has_strong_resonances():
    """A pair at exp(+-2 pi i/3) and +-i, of the half map. Oracle: its multipliers by matrix exponentials."""
    curve = absorber_curve(0, "NS")
    for code, angle in (("R3", 2.0 * math.pi / 3.0), ("R4", math.pi / 2.0)):
        events = [event for event in curve.events if event.type == code]
        assert events
        for event in events:
            orbit = AbsorberOrbit.of(curve.plane.problem, curve.unknowns[event.point, : curve.plane.size])
            assert orbit.half
            assert np.min(np.abs(orbit.multipliers() - np.exp(1j * angle))) < 1e-9


def test_another_curve_is_reached_at_a_point_of_codimension_two():
    """Where NS meets -1 of the half map the curve SB passes; where it grazes, the curve GR. The point is on both, to 1e-9."""
    curve = absorber_curve(0, "NS")
    for kind, code in (("PN", "SB"), ("NS-GR", "GR"), ("FN", "SN")):
        event = next(event for event in curve.events if event.type == kind)
        start = curve_through(curve, event.point, code)
        other = follow_curve(start, ((0.8, 2.5), (0.05, 1.0)))
        assert min(np.abs(place - curve.parameters[event.point]).max() for place in places(other, kind)) < 1e-9
    with pytest.raises(NoCurve, match="no curve SN passes"):
        curve_through(curve, next(event.point for event in curve.events if event.type == "PN"), "SN")


def test_events_without_a_curve_are_refused():
    branch = absorber_families()[0]
    y = branch.unknowns[0]
    for code, reason in (("EP", "no bifurcation"), ("LB", "without a bifurcation"), ("IO", "no bifurcation"), ("UZ", "marked value")):
        with pytest.raises(NoCurve, match=reason):
            curve_start(branch.problem, y, code, ("w", "F"))
    with pytest.raises(ValueError, match="unknown parameter G"):
        started(branch, event_of(branch, "NS"), ("w", "G"))


def test_a_parameter_without_effect_is_refused():
    """The response without impacts does not know the restitution."""
    branch = absorber_families()[0]
    with pytest.raises(NoCurve, match="does not depend on rho"):
        follow_curve(started(branch, event_of(branch, "GR", 1), ("w", "rho")), EVERYWHERE)


def pressing():
    """x'' + 0.1 x' + x = A cos(w t), x <= 0.3, impacts without rebound: a stop that sticks."""
    return ParametricSystem.from_description(
        {
            "parameters": {"A": 2.0, "w": 0.3},
            "system": {
                "mass": [[1.0]],
                "damping": [[0.1]],
                "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "upper": 0.3, "restitution": 0.0}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )


@cache
def sticking_families():
    """Families over A, each behind the grazing of the one before."""
    path = ParameterPath(pressing(), ["A"])
    found = settled_orbit(path, settle(path.parametric.system(path.values), path.parametric.forces(path.values)))
    families = [follow_response(found.problem, found.y, (0.1, 3.0))]
    for _ in range(3):
        event = event_of(families[-1], "GR")
        problem, step = switch_response(families[-1], event)[0]
        families.append(follow_response(problem, step, (0.1, 3.0)))
    return families


STICKING = [
    (0, "the contact force at stop + is zero where it begins to stick"),
    (1, "the impacts at stop + before it sticks vanish"),
    (3, "sticking at stop + vanishes"),
]
"""Numbers of those families, and grazings of each."""


def sticking_event(family, note):
    """A family, and its grazing."""
    branch = sticking_families()[family]
    return branch, next(event for event in branch.events if event.type == "GR" and note in (event.note or ""))


@pytest.mark.parametrize(("family", "note"), STICKING[-1:])
def test_grazings_of_a_stop_that_sticks(family, note):
    """Oracle: see `require_grazings_of_a_stop_that_sticks`."""
    require_grazings_of_a_stop_that_sticks(family, note)


def require_grazings_of_a_stop_that_sticks(family, note):
    """The family over A through a point of the curve ends there, to 1e-9: onset and end of sticking, and the force that vanishes."""
    branch, event = sticking_event(family, note)
    curve = follow_curve(started(branch, event, ("A", "w")), ((0.1, 8.0), (0.2, 0.5)))
    assert len(curve) > 20 and curve.residual.max() < 1e-12
    checked = 0
    for i in range(1, len(curve) - 1, len(curve) // 6):
        y, amplitude = curve.unknowns[i], curve.parameters[i, 0]
        values = curve.plane.problem.parameters(y)
        single = ForcedProblem(curve.plane.problem.parametric, curve.plane.problem.sequence, ("A",), values=values)
        nodes = curve.plane.problem.nodes(y)
        start = single.pack(nodes[:, :2], nodes[:, 2], [amplitude], curve.plane.problem.flight_times(y))
        family_there = ForcedFamily(single)
        begin = family_there.begin(start)
        # Beside the grazing, on the side on which it is an orbit.
        for ds in (1e-3, -1e-3):
            step = family_there.step(begin.y, begin.tangent, ds)
            if step.converged and min(step.extra[name] for name in ("clearance", "speed", "flight")) > 0.0:
                near = follow_response(single, step, (0.05, 10.0), points=60)
                ends = [event.values["A"] for event in near.events if event.type == "GR"]
                assert min(abs(end - amplitude) for end in ends) < 1e-9 * amplitude
                checked += 1
    assert checked >= 3


def test_a_curve_ends_where_impacts_exchange_their_order():
    """Oracle: the multipliers of both orders of impacts at the end. One order has -1, the other one not. These impacts do not interact, so
    the flight between them may end 1e-12 of the period before it begins; in the other order the places differ by its way."""
    path = ParameterPath(load_scene("forced_chain").parametric, ["w"])
    found = settled_orbit(path, settle(path.parametric.system(path.values), path.parametric.forces(path.values)))
    first = follow_response(found.problem, found.y, (0.3, 1.0))
    problem, step = switch_response(first, event_of(first, "LB"))[0]
    branch = follow_response(problem, step, (0.3, 1.0))
    doubling = min((event for event in branch.events if event.type == "PD"), key=lambda event: event.values["w"])
    curve = follow_curve(started(branch, doubling, ("w", "F")), ((0.2, 1.0), (0.1, 2.0)))
    event = next(event for event in curve.events if event.type == "LB")
    assert event.point in (0, len(curve) - 1) and "exchange their order" in curve.ended[event.point > 0].text
    problem, y = curve.plane.problem, curve.unknowns[event.point]
    short = abs(problem.flight_times(y).min())
    assert short < 1.1e-12 * problem.period(y)
    other, there = exchanged(problem, y, int(observed(problem, y)["flight_index"]))
    assert np.abs(other.residual(there)[:-1]).max() < 1e-12 + short * problem.impact_speeds(y).max()
    assert np.abs(problem.multipliers(y) + 1.0).min() < 1e-9 < 0.1 < np.abs(other.multipliers(there) + 1.0).min()
    with pytest.raises(NoCurve, match="which is no grazing"):
        curve_through(curve, event.point, "GR")
