"""Forced orbits with sticking: closed forms, second methods, multipliers that are zero, and the events of their families."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from branches.admissible import unphysical
from branches.forced.tracing import follow_response, switch_response
from bvp.closures import EndsError
from bvp.contact_sequence import joined_sequence, parse_contact_sequence
from bvp.forced import ForcedProblem
from bvp.forcing import Harmonic
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop
from tests.branches.forced_systems import oscillator
from tests.lab.problems import chatter_end
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle

TURN = 2.0 * math.pi


def landing(w, s, damping, amplitude=1.0):
    """Closed form of x'' + damping x' + x = A cos(w t), x <= s, without rebound, from rest at the stop: time of release, and of the next
    impact with its speed."""
    begin = math.acos(s / amplitude) / w  # A cos(w t) = s, and the force falls
    decay, turn = 0.5 * damping, math.sqrt(1.0 - 0.25 * damping * damping)
    response = amplitude / complex(1.0 - w * w, damping * w)

    def steady(t):
        return (response * np.exp(1j * w * t)).real, (1j * w * response * np.exp(1j * w * t)).real

    x, v = steady(begin)
    a, b = s - x, -v

    def place(t):
        e = math.exp(-decay * (t - begin))
        c, d = math.cos(turn * (t - begin)), math.sin(turn * (t - begin))
        return steady(t)[0] + e * (a * c + (b + decay * a) / turn * d) - s

    def speed(t):
        e = math.exp(-decay * (t - begin))
        c, d = math.cos(turn * (t - begin)), math.sin(turn * (t - begin))
        return steady(t)[1] + e * (b * c - (a + decay * b) / turn * d)

    times = begin + np.linspace(0.02, TURN / w, 4000)
    found = next(k for k in range(len(times) - 1) if place(times[k]) < 0.0 <= place(times[k + 1]))
    hit = brentq(place, times[found], times[found + 1], xtol=1e-15, rtol=1e-15)
    return begin, hit, speed(hit)


def one_stop(w=0.5, s=-0.3, damping=0.1, **parameters):
    """The orbit with one impact, after which the stop sticks, by its closed form: problem and unknowns."""
    parametric = oscillator(damping=damping, r=0.0, s=s, w=w, **parameters)
    begin, hit, _ = landing(w, s, damping)
    period = TURN / w
    problem = ForcedProblem(parametric, ("+=",), ("s",))
    return problem, problem.pack([[s, 0.0]] * 2, [hit / period, begin / period + 1.0], [s])


@pytest.mark.parametrize(("w", "damping"), [(0.6, 0.0)])
def test_a_family_with_sticking_is_its_closed_form(w, damping):
    """Oracle: see `require_a_family_with_sticking_is_its_closed_form`."""
    require_a_family_with_sticking_is_its_closed_form(w, damping)


def require_a_family_with_sticking_is_its_closed_form(w, damping):
    """Oracle: the closed form of one degree of freedom. The state at the release is that of rest: both multipliers are exactly zero."""
    problem, y = one_stop(w, -0.3, damping)
    assert np.abs(problem.residual(y)).max() < 1e-13
    branch = follow_response(problem, y, (-0.6, 0.05), points=60)
    assert branch.sequence == "+=" and len(branch) > 10
    for point in branch.unknowns:
        s = problem.parameters(point)["s"]
        begin, hit, speed = landing(w, s, damping)
        phases = problem.nodes(point)[:, 2] * problem.period(point)
        assert phases == pytest.approx([hit, begin + problem.period(point)], abs=1e-12 * problem.period(point))
        assert problem.impact_speeds(point) == pytest.approx([speed, 0.0], abs=1e-12)
        assert np.all(problem.multipliers(point) == 0.0)
    assert np.all(branch.stable[1:-1] == 1)
    assert branch.speeds.shape == (len(branch), 1)


def test_sticking_vanishes_and_appears():
    """Oracle: the closed form. Sticking has no duration where the impact and the release are at one instant. On the other side the stop
    opens at once. Where a stop that opens at once is pressed, both impacts become one."""
    problem, y = one_stop(0.5, 0.2, 0.1)
    parametric, period = problem.parametric, problem.period(y)
    begin, _, _ = landing(0.5, 0.2, 0.1)
    times = [0.765414558608761, 0.814698123285901, begin / period + 1.0]
    problem = ForcedProblem(parametric, ("+", "+="), ("s",))
    branch = follow_response(problem, problem.pack([[0.2, 0.0]] * 3, times, [0.2]), (-0.9, 2.0))
    low, high = branch.events
    assert low.neighbours == (("+=", True),)
    assert high.values["s"] == pytest.approx(0.913625764397, abs=1e-10) and high.neighbours == (("++", True),)
    assert "sticking at stop + vanishes" in high.note
    # One impact that sticks, up to where the contact force at it is zero: A cos(w t) = s at the impact.
    s = brentq(lambda s: math.cos(0.5 * landing(0.5, s, 0.1)[1]) - s, 0.0, 0.3, xtol=1e-14)
    assert s == pytest.approx(low.values["s"], abs=1e-12)
    made, step = switch_response(branch, low)[0]
    other = follow_response(made, step, (-0.5, 1.0), direction="along")
    assert other.sequence == "+=" and other.parameter[-1] == pytest.approx(-0.5, abs=1e-12)
    back = follow_response(made, step, (0.0, 1.0))
    event = next(event for event in back.events if event.type == "GR")
    assert event.values["s"] == pytest.approx(s, abs=1e-10) and "zero where it begins to stick" in event.note
    assert event.neighbours == (("++=", True),)
    plain, step = switch_response(branch, high)[0]
    beyond = follow_response(plain, step, (0.0, 2.0))
    event = beyond.events[0]
    assert event.values["s"] == pytest.approx(high.values["s"], abs=1e-10) and "would stay closed" in event.note
    assert event.neighbours == (("++=", True),)


def chain(n, restitution=0.0, stops=1):
    """A chain of n masses under a load and a constant one, with stops; all that a parameter can change."""
    stiffness = [[("2*k" if i == j else "-k" if abs(i - j) == 1 else 0.0) for j in range(n)] for i in range(n)]
    damping = [[(0.3 if i == j else "-c" if abs(i - j) == 1 else 0.0) for j in range(n)] for i in range(n)]
    mass = [[("m" if i == j == 0 else 1.0 if i == j else 0.1 if abs(i - j) == 1 else 0.0) for j in range(n)] for i in range(n)]
    rows = np.eye(n)
    load = np.zeros(n)
    load[-1] = 1.0
    return ParametricSystem.from_description(
        {
            "parameters": {"F": 1.0, "w": 0.6, "k": 1.0, "c": 0.1, "m": 0.8, "d": 0.2, "G": 0.1},
            "system": {
                "mass": mass, "damping": damping, "stiffness": stiffness,
                "stops": [{"c": rows[k].tolist(), "upper": "d" if k == 0 else 0.35, "restitution": restitution} for k in range(stops)],
            },
            "forces": [
                {"load": load.tolist(), "amplitude": "F", "harmonic": 1}, {"load": load.tolist(), "amplitude": 0.3, "harmonic": 3},
                {"load": rows[0].tolist(), "constant": "G"},
            ],
        }
    )  # fmt: skip


def simulated(parametric, periods=80, values=None):
    """The events of the last period of a simulation: symbols, states and fractions of the period."""
    at = parametric.at(values)
    system, n, period = parametric.system(at), parametric.system(at).degrees_of_freedom, TURN / at["w"]
    motion = simulate(system, np.zeros(n), np.zeros(n), (periods + 1) * period, forces=parametric.forces(at))
    letters, found = system.modes.contact_letters, []
    for k in np.flatnonzero((motion.times >= periods * period) & (motion.times < (periods + 1) * period)).tolist():
        letter, kind = letters[motion.contacts[k]], int(motion.kinds[k])
        if kind == 3:  # the impact before it sticks
            found[-1] = found[-1][0] + "=", *found[-1][1:]
        elif kind in (1, 4):
            found.append((letter + (":" if kind == 4 else ""), motion.after[k], motion.times[k] / period - periods))
    first = next(k for k, one in enumerate(found) if not one[0].endswith(":"))
    found = [*found[first:], *((symbol, state, fraction + 1.0) for symbol, state, fraction in found[:first])]
    symbols, states, fractions = zip(*found, strict=True)
    return symbols, np.array(states), np.array(fractions)


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("name", ["F", "w", "k", "c", "m", "d", "G"])
def test_derivatives(n, name):
    """Oracle: differences of the residual, which is exact for each parameter."""
    parametric = chain(n)
    symbols, states, fractions = simulated(parametric)
    problem = ForcedProblem(parametric, symbols, (name,))
    y = problem.solve(problem.pack(states, fractions, [parametric.values[name]])).y
    require_derivatives(problem, y)


def require_derivatives(problem, y):
    """The Jacobian is that of differences of the residual."""
    jacobian, step = problem.jacobian(y), 1e-4
    directions = [*np.eye(len(y))]
    parameters = [k for k in range(len(y)) if k % (problem.size + 1) == problem.size - 1]
    directions[parameters[0]] = sum(directions[k] for k in parameters)  # the nodes have one value of the parameter
    for j, direction in enumerate(directions):
        if j in parameters[1:]:
            continue
        near, far = (
            (problem.residual(y + h * direction) - problem.residual(y - h * direction)) / (2.0 * h) for h in (step, 2.0 * step)
        )
        expected = jacobian @ direction
        assert (4.0 * near - far) / 3.0 == pytest.approx(expected, abs=1e-9 * max(1.0, np.abs(expected).max()))


def turned(force, angle):
    """A load that begins at another phase."""
    if not isinstance(force, Harmonic):
        return force
    c, s = math.cos(angle), math.sin(angle)
    return Harmonic(force.frequency, force.cosine * c + force.sine * s, force.sine * c - force.cosine * s)


@pytest.mark.parametrize(("n", "stops"), [(2, 1)])
def test_the_simulation_comes_back_and_zeros_are_exact(n, stops):
    """Oracle: see `require_the_simulation_comes_back_and_zeros_are_exact`."""
    require_the_simulation_comes_back_and_zeros_are_exact(n, stops)


def require_the_simulation_comes_back_and_zeros_are_exact(n, stops):
    """Oracles: the simulation over a period from the solved state; eigenvalues of the monodromy matrix by differences of the simulation. A
    stop that sticks has two multipliers that are exactly zero."""
    parametric = chain(n, stops=stops)
    symbols, states, fractions = simulated(parametric)
    assert any(symbol.endswith("=") for symbol in symbols)
    problem = ForcedProblem(parametric, symbols, ("w",))
    branch = follow_response(problem, problem.pack(states, fractions, [parametric.values["w"]]), (0.5, 0.7), points=16)
    for y in branch.unknowns[1:-1:4]:
        at, period = problem.parameters(y), problem.period(y)
        system = parametric.system(at)
        flight = int(np.argmax([not event.closed for event in problem.events]))
        node, time = problem.nodes(y)[flight], 0.5 * problem.flight_times(y)[flight]
        start, fraction = problem.fly(node, time, flight)
        forces = [
            turned(force, getattr(force, "frequency", 0.0) * fraction * period) for force in parametric.forces(at)
        ]

        def after(state, system=system, period=period, forces=forces):
            return simulate(system, state[:n], state[n:], period, forces=forces).final

        assert np.abs(after(start) - start).max() < 1e-10
        columns = [(after(start + h) - after(start - h)) / 2e-6 for h in 1e-6 * np.eye(2 * n)]
        expected = np.sort(np.abs(np.linalg.eigvals(np.array(columns).T)))[::-1]
        found = problem.multipliers(y)
        assert np.abs(found) == pytest.approx(expected, abs=1e-6)
        assert np.count_nonzero(found == 0.0) == 2 * max(len(event.closed) for event in problem.events)


def test_a_plastic_impact_that_opens_at_once_has_one_zero():
    """Oracle: an impact without rebound leaves one direction less; the product of the saltation matrices."""
    problem, y = one_stop(0.5, 0.2, 0.1)
    branch = follow_response(ForcedProblem(problem.parametric, ("+",), ("s",)), *_touching(problem.parametric), points=12)
    found = branch.multipliers[5]
    assert np.count_nonzero(found == 0.0) == 1 and 0.0 < abs(found[0])


def _touching(parametric):
    """An orbit whose impact is fast enough and opens at once: by simulation."""
    symbols, states, fractions = simulated(parametric, values={"s": 0.96})
    problem = ForcedProblem(parametric, symbols, ("s",), values={"s": 0.96})
    return problem.pack(states, fractions, [0.96]), (0.9, 1.0)


def test_the_bouncing_ball_leaves_its_table():
    """Oracle: with e = 0 the ball leaves where A w^2 cos(w t) = g, in the coordinate of the table."""
    gamma, w = 1.8, 1.0
    table = ParametricSystem.from_description(
        {
            "parameters": {"A": gamma, "w": w},
            "system": {
                "mass": [[1.0]], "damping": [[0.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": 0.0, "restitution": 0.0}],
            },
            "forces": [{"load": [1.0], "amplitude": "A*w**2", "harmonic": 1}, {"load": [1.0], "constant": -1.0}],
        }
    )  # fmt: skip
    problem = ForcedProblem(table, ("-=",), ("A",))
    leave = 1.0 - math.acos(1.0 / gamma) / TURN
    # From there z = A (cos p - cos q) - A sin(p) (q - p) - (q - p)^2/2 for the phases p, q of both ends.
    p = TURN * (leave - 1.0)

    def height(q):
        return gamma * (math.cos(p) - math.cos(q)) - gamma * math.sin(p) * (q - p) - 0.5 * (q - p) ** 2

    q = brentq(height, p + 0.5, p + TURN, xtol=1e-15)
    y = problem.pack([[0.0, 0.0]] * 2, [q / TURN, leave], [gamma])
    solution = problem.solve(y)
    assert solution.y == pytest.approx(y, abs=1e-13)
    assert unphysical(problem, solution) is None
    assert np.all(problem.multipliers(solution.y) == 0.0)


def test_symbols():
    """Releases that a sequence leaves out, sequences as text, and what is refused."""
    two = ImpactSystem(np.eye(2), np.eye(2), np.eye(2), [Stop((1.0, 0.0), -1.0, 1.0, restitution=0.0), Stop((0.0, 1.0), upper=1.0)])
    assert [event.symbol for event in parse_contact_sequence(two, ["a+=", "b+"])] == ["a+=", "a+:", "b+"]
    held = parse_contact_sequence(two, ["b+", "a+:", "a-=", "b+", "a-:", "a+="])
    assert [sorted(event.closed) for event in held] == [[1], [], [0], [0], [], [1]]
    assert joined_sequence(["a+=", "a+:", "b+"]) == "a+=b+"
    one = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), -1.0, 1.0, restitution=0.0)])
    assert [event.symbol for event in parse_contact_sequence(one, ["+="], half=True)] == ["+=", "+:"]
    for sequence, text in (
        (["a+:"], "begins with an impact"), (["b+", "a+:"], "sticks at the end|does not stick"), (["c+="], "no contact"),
        (["a+=", "a-", "a+:"], "hits a stop that sticks"),
    ):  # fmt: skip
        with pytest.raises(EndsError, match=text):
            parse_contact_sequence(two, sequence)


@pytest.mark.parametrize("restitution", [0.05, 0.4, 0.5, 0.8, 0.93])
def test_a_chatter_under_a_constant_force_has_a_closed_form(restitution):
    """Oracle: bounces under a constant force g last 2 v r/(g (1 - r)) after an impact with the speed v, and so do the derivatives by v and
    r. The end does not depend on where the chatter is cut into single impacts."""
    g, speed, w = 1.3, 0.02, 0.7
    table = ParametricSystem.from_description(
        {
            "parameters": {"A": 0.0, "w": w, "r": restitution},
            "system": {
                "mass": [[2.0]], "damping": [[0.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "upper": 0.5, "restitution": "r"}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}, {"load": [1.0], "constant": 2.0 * g}],
        }
    )  # fmt: skip
    problem = ForcedProblem(table, ("+=",), ("r",))
    end = chatter_end(problem, 1, np.array([0.5, speed, 0.3, restitution]))
    lasts = 2.0 * speed * restitution / (g * (1.0 - restitution))
    assert end.node == pytest.approx([0.5, 0.0, 0.3 + lasts * w / TURN, restitution], abs=1e-14)
    by_speed, by_restitution = lasts / speed * w / TURN, lasts / (restitution * (1.0 - restitution)) * w / TURN
    assert end.derivatives[2] == pytest.approx([0.0, by_speed, 1.0, by_restitution], abs=1e-12)
    assert np.abs(end.derivatives[0] - [1.0, 0.0, 0.0, 0.0]).max() < 1e-13


@pytest.mark.parametrize(("n", "name"), [(1, "r"), (2, "w"), (2, "d")])
def test_bounces_that_end_in_sticking_are_one_impact(n, name):
    """Oracles: see `require_one_impact`. Another mass is in tests/full."""
    require_one_impact(n, name)


def require_one_impact(n, name):
    """Oracles: the simulation, whose end of the bounces is the solved one; differences of the residual; and the orbit with its first bounce
    as an impact of its own, which has the same state behind the bounces and the same multipliers."""
    parametric = oscillator(damping=0.1, r=0.4, s=0.2, w=0.5) if n == 1 else chain(n, 0.5)
    settled = settle(parametric.system(), parametric.forces())
    found = settled_orbit(ParameterPath(parametric, (name,)), settled)
    problem, y = found.problem, found.y
    assert found.distance < 1e-10 and problem.sequence[-2:] == ("+=", "+:")
    require_derivatives(problem, y)
    branch = follow_response(problem, y, points=8)
    other = problem.sibling([*problem.sequence[:-2], "+", *problem.sequence[-2:]])
    for point in (y, branch.unknowns[2], branch.unknowns[-3]):
        single = split_first_bounce(problem, point, other)
        assert np.abs(other.multipliers(single) - problem.multipliers(point)).max() < 1e-9
        assert np.count_nonzero(problem.multipliers(point) == 0.0) == 2


def split_first_bounce(problem, y, other):
    """An orbit with its first summed bounce as an impact of its own."""
    i = len(problem.sequence) - 3  # the flight that ends with the chatter
    nodes, times, size = problem.nodes(y), problem.flight_times(y), 2 * problem.degrees_of_freedom
    after, row = problem.landed(y, i, problem.end_states(y)[i]), problem.rate[i]
    arrived = problem.fly(nodes[i], float(times[i]), i)[1]
    rate = problem.flown(np.array([*after, arrived, *nodes[i, size + 1 :]]), 0.0, 0).rates[:size]
    guess = -2.0 * (row @ after) / (row @ rate)
    states, fractions = np.insert(nodes[:, :size], i + 1, after, axis=0), np.insert(nodes[:, size], i + 1, arrived)
    packed = other.pack(states, fractions, problem.released_values(y), np.insert(times, i + 1, guess))
    solved = other.solve(packed).y
    assert np.abs(other.nodes(solved)[-2] - nodes[-2]).max() < 1e-12
    return solved


def test_long_and_endless_bounces():
    """Oracle: the contact force A cos(w t) - s. The family goes on where its first bounce becomes an impact of its own, and ends where the
    force behind the bounces nearly vanishes."""
    parametric = oscillator(r=0.4, s=-0.5, w=0.5)
    settled = settle(parametric.system(), parametric.forces(), [-0.6], [0.0])
    found = settled_orbit(ParameterPath(parametric, ("s",)), settled)
    branch = follow_response(found.problem, found.y, (-0.6, 0.9))
    event = branch.events[-1]
    assert event.type == "LB" and "too long" in event.note and event.neighbours == ()
    ((problem, step),) = switch_response(branch, event)
    assert len(problem.impacts) == len(branch.problem.impacts) + 1
    begun = problem.step(step.y, np.zeros(2 * problem.unknowns), 0.0)
    assert begun is not None and problem.parameters(begun.y)["s"] > event.values["s"]
    further = follow_response(problem, step, (-0.1, 0.9), direction="along")
    end = further.events[-1]
    assert end.type == "GR" and "hardly end" in end.note
    sticks = next(k for k, one in enumerate(problem.events) if one.sticks)
    node = problem.nodes(further.unknowns[end.point])[sticks]
    force = problem.contact_force(node, sticks, 0)
    assert 0.0 < force < 0.02 and math.cos(TURN * node[2]) - end.values["s"] == pytest.approx(force, abs=1e-9)


@pytest.mark.parametrize(("restitution", "symbols"), [(0.0, ("+", "+=", "+:")), (0.4, ("+", "+", "+", "+=", "+:"))])
def test_a_settled_motion_has_its_sequence(restitution, symbols):
    """Oracle: the closed form of the first case, and the number of bounces of the second one. An impact that opens at once is one of its
    own."""
    parametric = oscillator(damping=0.1, r=restitution, s=0.2, w=0.5)
    found = settled_orbit(ParameterPath(parametric, ("s",)), settle(parametric.system(), parametric.forces()))
    assert found.problem.sequence == symbols and found.distance < 1e-10


def test_a_chatter_has_the_phase_and_the_speed_of_its_first_bounce():
    """Oracle: the impacts of the simulation, one by one. The sequence is +=, after an impact or without one."""
    parametric = oscillator(damping=0.1, A=1.5, w=0.3, r=0.2, s=1.0)
    motion = settle(parametric.system(), parametric.forces())
    found = settled_orbit(ParameterPath(parametric, ("r",)), motion)
    branch = follow_response(found.problem, found.y, (0.15, 0.25), points=9)
    assert branch.sequence.endswith("=")
    system, period = parametric.system(), TURN / 0.3
    state, fraction = found.problem.nodes(found.y)[0, :2], found.problem.nodes(found.y)[0, 2]
    forces = [turned(force, 0.3 * fraction * period) for force in parametric.forces()]
    events = simulate(system, state[:1], state[1:], 1.1 * period, forces=forces).stop_events
    times, speeds = (events.times + fraction * period) * 0.3 % TURN, np.abs(events.before[:, 1])
    for phase, speed in zip(branch.phases[branch.start], branch.speeds[branch.start], strict=True):
        k = int(np.argmin(np.abs(times - phase)))
        assert abs(times[k] - phase) < 1e-8 and speed == pytest.approx(speeds[k], abs=1e-8)
