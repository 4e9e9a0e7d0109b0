"""Events of smooth families. Oracles: DOP853 with the equation of variations, and the normal form of two events that meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from branches.naming.at_modes import orbit_at_mode
from branches.tracing import follow_family
from saltus.scene import load_scene
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


def tip(n):
    """The energy at which a tongue crosses the 3-fold cover of the in-phase family of smooth walls, and that of the tongue's tip."""
    energy = (0.05, 0.06)
    first = orbit_at_mode("mode:1", load_scene("smooth_wall", n=n).system, energy)
    branch = follow_family(first.problem, first.solution.y, energy=energy)
    (crossing,) = (event for event in branch.events if event.type == "RT" and event.p_q == [1, 3])
    tongues = branch.switch(crossing.id, energy=(crossing.h - 1e-4, crossing.h + 1e-4))
    (fold,) = (event for tongue in tongues for event in tongue.events if event.type == "SN")
    return crossing.h, fold.h


def test_the_tip_of_a_tongue_is_told_from_its_crossing_with_a_cover():
    """Oracle: the normal form of a tripling. Along the tongue h - h_crossing = a s + b s^2, so its tip is at -a^2/(4 b), where a is zero
    at one exponent of the walls. The root of the distance is a smooth function of the exponent: the parabola through three of its values,
    at most 4.3e-7 apart in h, gives the others, down to 7e-10. Its error is that of the next term, 4e-4 here."""
    known = {n: tip(n) for n in (1.41, 1.42, 1.43)}
    roots = [math.copysign(math.sqrt(crossing - fold), n - 1.4255) for n, (crossing, fold) in known.items()]
    parabola = np.polyfit(list(known), roots, 2)
    for n in (1.4249, 1.4264):
        crossing, fold = tip(n)
        assert 3e-10 < crossing - fold < 1.3e-9
        assert math.sqrt(crossing - fold) == pytest.approx(abs(np.polyval(parabola, n)), rel=2e-3)
