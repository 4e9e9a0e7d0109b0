"""Events of smooth families. Oracles: DOP853 with the equation of variations, and the normal form of two events that meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.branches.test_smooth_agreement import family, second

BESIDE = 1e-5 * np.array([-1.0, 0.0, 1.0])
"""Quarter periods at an event and beside it, relative. Differences of values with errors of 1e-13 give a slope with eight digits."""


def half_maps(branch, event):
    """Energies, and traces of the half map without its trivial pair, of orbits at quarter periods near an event: by DOP853."""
    other = second(branch.system)
    n = other.size
    velocities = branch.orbit(event.point).velocities.copy()
    energies, traces = [], []
    for alpha in event.alpha * (1.0 + BESIDE):
        for _ in range(3):
            end, columns = other.flown(np.concatenate([np.zeros(n), velocities]), float(alpha))
            velocities = velocities - np.linalg.solve(columns[n:, n:], end[n:])
        end, columns = other.flown(np.concatenate([np.zeros(n), velocities]), 2.0 * float(alpha))
        energies.append(0.5 * velocities @ other.mass @ velocities)
        # u(t + T/2) = -u(t): the flow and the energy have the multiplier -1 of the flow over half a period.
        traces.append(-np.trace(columns) - 2.0)
    return np.array(energies), np.array(traces)


def value_at(event):
    """The trace of the half map at an event, but for its sign: the multipliers of the period are its squares."""
    if event.type == "PD":
        return 0.0
    return 2.0 if event.type in ("SB", "BP") else 2.0 * abs(math.cos(math.pi * event.p_q[0] / event.p_q[1]))


FAMILIES = [
    ("cubic_nes", {}, "mode:2", (1e-3, 2.0)),
    ("smooth_wall", {"n": 3}, "mode:1", (0.02, 4.0)),
    ("smooth_wall", {"n": 20}, "mode:1", (0.02, 4.0)),
    ("duffing_pair", {}, "mode:2", (1e-3, 20.0)),
]


@pytest.mark.parametrize(("scene", "values", "mode", "energy"), FAMILIES)
def test_a_second_integrator_finds_the_same_events(scene, values, mode, energy):
    """Oracle: DOP853. The trace of the half map is a simple function near its value at the event, and the energy near its fold. One event
    of each type; all are in tests/full."""
    require_events(scene, values, mode, energy, 1)


def require_events(scene, values, mode, energy, each):
    """Oracle: the same, at so many events of each type at most."""
    branch = family(scene, mode, *energy, **values)
    events = [event for code in ("SN", "PD", "SB", "RT") for event in [one for one in branch.events if one.type == code][:each]]
    assert events
    for event in events:
        energies, traces = half_maps(branch, event)
        if event.type == "SN":
            steps = 0.5 * (energies[2] - energies[0]) / (2.0 * energies[1] - energies[0] - energies[2])
        else:
            steps = 2.0 * (math.copysign(value_at(event), traces[1]) - traces[1]) / (traces[2] - traces[0])
        assert abs(steps) < 0.1
        assert abs(energies[1] + 0.5 * steps * (energies[2] - energies[0]) - event.h) < 1e-10
