"""Where a stop that sticks opens for a moment, or opens no more: closed forms of the event, of the orbits beside it, and its neighbours."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

from branches.forced.tracing import follow_response, switch_response
from bvp.closures import EndsError
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from saltus.scene import load_scene
from tests.branches.test_forced_sticking import turned
from transitions.response.path import ParameterPath
from transitions.response.starting import NoOrbit, settled_orbit
from transitions.sweep.settle import settle

TURN = 2.0 * math.pi
SHIFT = 0.4


def held(restitution, shift=SHIFT, stop=0.4):
    """x'' + 0.1 x' + x = cos(w t) - B cos(3 w t + shift), x <= s: while the stop sticks, its force is the load less s."""
    return ParametricSystem.from_description(
        {
            "parameters": {"B": 0.3, "w": 0.5, "s": stop},
            "system": {
                "mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "upper": "s", "restitution": restitution}],
            },
            "forces": [
                {"load": [1.0], "amplitude": 1.0, "harmonic": 1},
                {"load": [1.0], "amplitude": "-B", "harmonic": 3, "phase": shift},
            ],
        }
    )  # fmt: skip


def response(parametric, name, interval, values=None):
    """The family of the motion that a simulation settles on."""
    at = ParametricSystem.from_description(parametric.description | {"parameters": parametric.at(values)})
    found = settled_orbit(ParameterPath(at, (name,)), settle(at.system(), at.forces()))
    return follow_response(found.problem, found.y, interval)


def touch(stop=0.4, shift=SHIFT):
    """B and w t at which cos(w t) - B cos(3 w t + shift) touches s from above: two equations."""

    def equations(at):
        amplitude, angle = at
        wave = 3.0 * angle + shift
        return math.cos(angle) - amplitude * math.cos(wave) - stop, -math.sin(angle) + 3.0 * amplitude * math.sin(wave)

    return fsolve(equations, [0.6, 0.0], xtol=1e-13)


@pytest.mark.parametrize("restitution", [0.0])
def test_the_contact_force_touches_zero_inside_sticking(restitution):
    """Oracle: see `require_the_contact_force_touches_zero_inside_sticking`."""
    require_the_contact_force_touches_zero_inside_sticking(restitution)


def require_the_contact_force_touches_zero_inside_sticking(restitution):
    """Oracles: the force is a known sum of harmonics, whose touch of zero is two equations. Behind it the stop opens where the force
    vanishes, and the simulation comes back."""
    amplitude, angle = touch()
    branch = response(held(restitution), "B", (0.29, 0.9))
    event = next(event for event in branch.events if event.type == "GR")
    assert event.point == len(branch) - 1 and "touches zero" in event.note and event.stop == "+"
    assert event.values["B"] == pytest.approx(amplitude, abs=1e-10)
    problem, y = branch.problem, branch.unknowns[-1]
    flight = next(i for i, one in enumerate(problem.events) if one.sticks)
    lasts = float(event.note.split("touches zero ")[1].split()[0])
    phase = TURN * problem.nodes(y)[flight, 2] + 0.5 * lasts
    assert math.remainder(phase - angle, TURN) == pytest.approx(0.0, abs=1e-5)  # the note has six digits
    assert event.neighbours == ((branch.sequence + "+=" if branch.sequence.endswith("=") else "+=" + branch.sequence, True),)
    ((wide, step),) = switch_response(branch, event)
    opened = follow_response(wide, step, (0.2, amplitude + 0.005))
    # The flight has no duration at its beginning, which is the same event.
    first = opened.events[0]
    assert first.values["B"] == pytest.approx(amplitude, abs=1e-10) and "opens no more" in first.note
    assert first.neighbours == ((branch.sequence, True),)
    for point in opened.unknowns[len(opened) // 2 :: 8]:
        at, period, n = wide.parameters(point), wide.period(point), 1
        for event, node in zip(wide.events, wide.nodes(point), strict=True):
            if event.is_release:
                phase = TURN * node[2]
                assert math.cos(phase) - at["B"] * math.cos(3.0 * phase + SHIFT) == pytest.approx(at["s"], abs=1e-12)
        k = next(i for i, event in enumerate(wide.events) if not event.closed and wide.flight_times(point)[i] > 1.0)
        state, fraction = wide.fly(wide.nodes(point)[k], 0.5 * wide.flight_times(point)[k], k)
        forces = [turned(force, force.frequency * fraction * period) for force in wide.parametric.forces(at)]
        final = simulate(wide.parametric.system(at), state[:n], state[n:], 3.0 * period, forces=forces).final
        assert np.abs(final - state).max() < 1e-11


def table(restitution):
    """A ball on a vibrating table, in the coordinate of the table. Gamma is A for w = 1."""
    return ParametricSystem.from_description(
        {
            "parameters": {"A": 1.2, "w": 1.0},
            "system": {
                "mass": [[1.0]], "damping": [[0.0]], "stiffness": [[0.0]],
                "stops": [{"c": [1.0], "lower": 0.0, "restitution": restitution}],
            },
            "forces": [{"load": [1.0], "amplitude": "A*w**2", "harmonic": 1}, {"load": [1.0], "constant": -1.0}],
        }
    )  # fmt: skip


@pytest.mark.parametrize("restitution", [0.1, 0.5])
def test_the_bouncing_ball_leaves_its_table_above_gravity(restitution):
    """Oracle: see `require_leaving`. The ball without rebound is in tests/full."""
    require_leaving(restitution)


def require_leaving(restitution):
    """Oracle: the ball leaves if the acceleration of the table exceeds that of gravity, Gamma = 1 exactly. Below it there is no flight."""
    branch = response(table(restitution), "A", (0.5, 1.3))
    event = branch.events[0]
    assert event.type == "GR" and event.point == 0 and "sticks for the whole period" in event.note
    assert event.values["A"] == pytest.approx(1.0, abs=1e-14)
    assert branch.ended[0].reason == "EVENT" and event.neighbours == () and event.multiplier == 0.0
    assert branch.periods[0] == pytest.approx(TURN) and np.all(np.diff(branch.parameter) > 0.0)


def test_bounces_before_sticking_vanish_where_the_contact_force_does():
    """Oracle: the family without the bounce, whose contact force is zero where sticking begins."""
    branch = response(held(0.0, 0.0), "B", (0.1, 0.5))
    event = branch.events[0]
    assert "zero where it begins to stick" in event.note and event.neighbours == (("++=", True),)
    problem, step = switch_response(branch, event)[0]
    back = follow_response(problem, step, (0.1, 0.5))
    last = next(one for one in back.events if one.type == "GR")
    assert last.values["B"] == pytest.approx(event.values["B"], abs=1e-12)
    assert last.neighbours == (("+=", True),) and "before it sticks vanish" in last.note


@pytest.mark.parametrize("amplitude", [2.0, 3.0])
def test_bounces_that_last_too_long_go_on_with_the_first_one_apart(amplitude):
    """Oracle: the family that a simulation settles on behind this place ends at the same value. A guess leads to orbits before it, too."""
    parametric = load_scene("damped_impact_oscillator").parametric
    branch = response(parametric, "e", (0.0, 1.0), {"A": amplitude, "e": 0.005})
    place = branch.events[-1]
    assert branch.sequence == "+=" and place.type == "LB" and "last too long" in place.note
    (start,) = switch_response(branch, place)
    onwards = follow_response(*start, (0.0, 1.0), direction="along", origin="LB1")
    assert onwards.parameter[0] == pytest.approx(place.values["e"], abs=1e-3) and onwards.parameter[0] > place.values["e"]
    beyond = response(parametric, "e", (0.0, 1.0), {"A": amplitude, "e": place.values["e"] + 0.001})
    assert beyond.sequence == onwards.sequence == "+=+"
    assert onwards.events[-1].type == beyond.events[-1].type == "GR"
    assert onwards.events[-1].values["e"] == pytest.approx(beyond.events[-1].values["e"], rel=1e-10)


def test_long_bounces_are_impacts_of_their_own():
    """Oracle: simulated states behind the end of summed bounces, and beside a strong damper."""
    plain, damped = (load_scene(name).parametric for name in ("impact_oscillator", "damped_impact_oscillator"))
    branch = response(plain, "r", (0.0, 1.0), {"w": 3.9, "s": -0.391, "r": 0.01})
    ((made, step),) = switch_response(branch, branch.events[-1])
    beyond = response(plain, "r", (0.139, 0.141), {"w": 3.9, "s": -0.391, "r": float(step.y[made.place])})
    strong = response(damped, "A", (1500.0, 2500.0), {"c": 1e3, "e": 0.5, "A": 2e3})
    assert (branch.parameter[0], *strong.parameter[[0, -1]], strong.sequence) == (0.0, 1500.0, 2500.0, "++++=")
    assert step.y == pytest.approx(beyond.unknowns[beyond.start], abs=1e-9)


def coupled(mass, distance, restitution=0.5):
    """Two masses that M couples. The first one can stick at its stop when the second one hits its own."""
    return ParametricSystem.from_description(
        {
            "parameters": {"d": distance, "m": mass, "w": 0.6},
            "system": {
                "mass": [[1.0, "m"], ["m", 1.0]], "damping": [[0.3, 0.0], [0.0, 0.1]], "stiffness": [[2.0, -1.0], [-1.0, 2.0]],
                "stops": [
                    {"c": [1.0, 0.0], "upper": 0.2, "restitution": 0.0}, {"c": [0.0, 1.0], "upper": "d", "restitution": restitution},
                ],
            },
            "forces": [
                {"load": [1.0, 0.0], "amplitude": 1.0, "harmonic": 1}, {"load": [0.0, 1.0], "amplitude": 0.6, "harmonic": 3},
            ],
        }
    )  # fmt: skip


@pytest.mark.parametrize("mass", [-0.3, 0.3])
def test_an_impact_that_would_pull_a_sticking_stop_open_ends_the_family(mass):
    """Oracle: the impulse at the second stop changes the first speed by m/(1 - m^2) times itself, upwards for m > 0. Then the stop is
    pressed, and the family with that impact begins. For m < 0 it would be pulled."""
    branch = response(coupled(mass, 1.5), "d", (0.4, 2.0))
    event = branch.events[0]
    assert event.type == "GR" and event.stop == "b+"
    sticks = next(i for i, one in enumerate(branch.problem.events) if one.sticks)
    with_impact = [*branch.problem.sequence[: sticks + 1], "b+", "a+:"]
    if mass > 0.0:
        assert event.neighbours[0][0].endswith("a+=b+a+:") and "becomes possible" in event.note
        assert branch.problem.sibling(with_impact).sequence == tuple(with_impact)
    else:
        assert event.neighbours == () and "would pull stop a+ open" in event.note
        with pytest.raises(EndsError, match=r"b\+ pulls stop a\+ open"):
            branch.problem.sibling(with_impact)


def test_a_simulated_motion_whose_stop_is_pulled_open_is_refused():
    """Oracle: the events of the simulation. No contact force reaches zero in it."""
    parametric = coupled(-0.3, 0.5)
    with pytest.raises(NoOrbit, match=r"stop a\+ sticks until an impact at another stop pulls it open"):
        settled_orbit(ParameterPath(parametric, ("d",)), settle(parametric.system(), parametric.forces()))
