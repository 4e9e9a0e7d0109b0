"""Random forced chains with soft stops: a simulated motion that sticks is solved, continued, and simulated again at its points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from branches.family import SETTINGS
from branches.forced.closing import with_exact_ends
from branches.forced.family import ForcedFamily
from branches.forced.tracing import follow_response, switch_response
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from continuation.run import follow_both_ways
from tests.branches.test_forced_chains import chain
from tests.branches.test_forced_sticking import turned
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import SettledKind, settle


def soft_chain(seed):
    """A chain of `chain` with other restitutions: most of them 0, the others small."""
    description = dict(chain(np.random.RandomState(seed)).description)
    random = np.random.RandomState(1000 + seed)
    restitutions = [0.0 if random.rand() < 0.6 else round(float(random.uniform(0.1, 0.6)), 3) for _ in description["system"]["stops"]]
    stops = [stop | {"restitution": r} for stop, r in zip(description["system"]["stops"], restitutions, strict=True)]
    return ParametricSystem.from_description(description | {"system": description["system"] | {"stops": stops}})


def check_sticking(seed, stride=1, periods=10):
    """Whether a chain settles on a motion that sticks for a part of its period. Its orbit is then followed, 20 points in both directions.
    The simulation of some periods comes back to each point (one of `stride`), but for what the largest multiplier makes of rounding."""
    parametric = soft_chain(seed)
    settled = settle(parametric.system(), parametric.forces(), most=3000)
    if settled.kind is not SettledKind.PERIODIC or settled.sticking or settled.sticking_time == 0.0:
        return False
    found = settled_orbit(ParameterPath(parametric, ("w",)), settled)
    problem, n, w = found.problem, found.problem.degrees_of_freedom, parametric.values["w"]
    assert found.distance < 1e-9 and any(event.sticks for event in problem.events)
    family = ForcedFamily(problem, (0.2 * w, 5.0 * w))
    run = with_exact_ends(family, follow_both_ways(family, found.y, replace(SETTINGS, maximum_points=40)))
    assert {end.reason.name for end in run.ends} <= {"EVENT", "POINTS"}
    for point in run.points[::stride]:
        if point.event is not None:
            continue
        y = point.step.y
        assert np.count_nonzero(problem.multipliers(y) == 0.0) == 2 * max(len(event.closed) for event in problem.events)
        at, period = problem.parameters(y), problem.period(y)
        flight = next(i for i, event in enumerate(problem.events) if not event.closed)
        state, fraction = problem.fly(problem.nodes(y)[flight], 0.5 * problem.flight_times(y)[flight], flight)
        forces = [turned(force, getattr(force, "frequency", 0.0) * fraction * period) for force in parametric.forces(at)]
        largest = max(1.0, float(np.abs(problem.multipliers(y)).max()))
        # Of an unstable orbit rounding grows until the motion is another one.
        count = max(1, min(periods, int(math.log(1e5) / math.log(largest)))) if largest > 1.0 else periods
        final = simulate(parametric.system(at), state[:n], state[n:], count * period, forces=forces).final
        assert np.abs(final - state).max() < 1e-10 * max(1.0, float(np.abs(state).max())) * largest**count
    return True


@pytest.mark.parametrize("seed", [14, 26, 41, 100, 107])
def test_settled_motions_that_stick_are_orbits(seed):
    """Oracle: see `require_settled_motions_that_stick_are_orbits`."""
    require_settled_motions_that_stick_are_orbits(seed)


def require_settled_motions_that_stick_are_orbits(seed):
    """Oracle: the simulation, and the number of multipliers that are zero."""
    assert check_sticking(seed, stride=5, periods=3)


def followed(seed, low, high):
    """The response of a chain in a range of w, in parts of its own."""
    parametric = soft_chain(seed)
    found = settled_orbit(ParameterPath(parametric, ("w",)), settle(parametric.system(), parametric.forces(), most=3000))
    w = parametric.values["w"]
    return follow_response(found.problem, found.y, (low * w, high * w), points=300)


def test_steps_that_land_where_a_flight_has_no_time_are_left_out():
    """Oracle: the family without the first of two plastic impacts, whose contact force is zero at the same frequency. The equations of both
    impacts hold beyond it, too, with a branch point where they do."""
    branch = followed(386, 0.9, 1.5)
    event = branch.events[-1]
    assert event.point == len(branch) - 1 and event.neighbours == (("+=-", True),) or event.neighbours == (("-+=", True),)
    assert not any(event.type in ("BP", "PD") for event in branch.events)
    ((problem, step),) = switch_response(branch, event)
    other = follow_response(problem, step, (0.9 * event.values["w"], 1.1 * event.values["w"]))
    assert min(abs(one.values["w"] - event.values["w"]) for one in other.events if one.type == "GR") < 1e-10


def test_each_grazing_of_a_chain_that_sticks_has_a_neighbour():
    """Oracle: see `require_neighbours`. Longer families are in tests/full."""
    require_neighbours(205)


def require_neighbours(seed):
    """Oracle: the other family ends at the same frequency."""
    branch = followed(seed, 0.5, 2.0)
    for event in branch.events:
        if event.type != "GR":
            continue
        assert event.neighbours, event
        problem, step = switch_response(branch, event)[0]
        w = event.values["w"]
        other = follow_response(problem, step, (0.5 * w, 2.0 * w), points=30)
        assert min(abs(value - w) for value in other.parameter) < 1e-5 * w


def test_no_family_with_an_opening_is_made_up():
    """A stop would open for a moment at an end of this family; no orbit is found there, and the family is kept."""
    branch = followed(402, 0.5, 2.0)
    assert len(branch) > 10 and {event.type for event in branch.events} == {"GR"}
