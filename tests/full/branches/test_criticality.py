"""Long cases of tests/branches/test_criticality.py."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bvp.criticality import criticality
from tests.branches.forced_systems import absorber_families
from tests.lab.problems import units


def torus_radius(problem, y, start, rounds):
    """The root of the mean square of the start's distance from that of an orbit with one impact, over sqrt(2), on the torus around it."""
    n, closing = problem.degrees_of_freedom, problem.closing
    gap, push = problem.gap[0, :n], problem.push[0, n:]
    stop = problem.system.stops[0]
    bound = stop.upper if problem.side[0] > 0 else stop.lower
    scale = units(problem)[: 2 * n + 1]
    node, time = problem.nodes(y)[0].copy(), float(problem.flight_times(y)[0])
    node[n : 2 * n] += start * scale[n : 2 * n]
    squares = []
    for _ in range(rounds):
        for _ in range(20):
            state, fraction = problem.fly(node, time)
            change = (gap @ state[:n] - bound) / (gap @ state[n:])
            time -= change
            if abs(change) < 1e-13:
                break
        state, fraction = problem.fly(node, time)
        state[n:] -= (1.0 + stop.restitution) * push * (gap @ state[n:])
        node[: 2 * n], node[2 * n] = closing[0] * state, fraction - closing[1]
        squares.append(float(np.sum(((node - problem.nodes(y)[0])[: 2 * n + 1] / scale) ** 2)))
    return math.sqrt(0.5 * np.mean(squares[rounds // 2 :]))


def test_the_torus_has_the_size_of_its_normal_form():
    """Oracle: the map from impact to impact, iterated where the orbit is unstable by 0.05 and 0.1 percent in each half period. The square
    of the radius is (1 - |mu|)/Re(e^(-i angle) d); the rest is of second order."""
    first = absorber_families()[0]
    event = next(event for event in first.events if event.type == "NS" and event.values["w"] > 2.0)
    problem, y = first.problem, first.unknowns[event.point]
    found = criticality(problem, y, "NS", event.angle)
    assert found.kind == "supercritical" and found.coefficient == pytest.approx(criticality(problem, y, "NS").coefficient, rel=1e-9)
    place = problem.place
    errors = []
    for change, rounds in ((-6e-3, 16000), (-1.2e-2, 8000)):
        moved = y.copy()
        moved[place] += change
        moved = problem.solve(moved).y
        growth = float(np.abs(problem.multipliers(moved)).max()) - 1.0
        radius = math.sqrt(-growth / found.coefficient)
        errors.append(torus_radius(problem, moved, radius, rounds) / radius - 1.0)
    assert np.abs(errors).max() < 0.013 and errors[0] == pytest.approx(0.5 * errors[1], rel=0.3)
