"""Forced systems for tests, closed forms, and orbits that a simulation settles on."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate


def oscillator(damping=0.0, **parameters):
    """x'' + damping x' + x = A cos(w t), x <= s, v -> -r v."""
    return ParametricSystem.from_description(
        {
            "parameters": {"A": 1.0, "w": 2.8, "r": 0.8, "s": 0.0} | parameters,
            "system": {
                "mass": [[1.0]], "damping": [[damping]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "s", "restitution": "r"}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )  # fmt: skip


def impact_speed(w, r, n, s, sign):
    """The impact speed of x'' + x = cos(w t) with one impact in n periods: one of two roots; nan where there is none."""
    period = 2.0 * math.pi * n / w
    gamma = 1.0 / (1.0 - w * w)
    c = (1.0 + r) * math.sin(period) / (1.0 - math.cos(period))
    rest = (1.0 - r) / w
    square = 4.0 * (gamma * gamma * c * c - (s * s - gamma * gamma) * rest * rest)
    return (-2.0 * c * s + sign * math.sqrt(square)) / (c * c + rest * rest) if square >= 0.0 else math.nan


def settled(parametric, released, periods=300, load_periods=1, half=False, values=None, start=None):
    """The problem and the unknowns of the motion that a simulation from rest has after many periods: its impacts in the last ones."""
    at = parametric.at(values)
    system, forces = parametric.system(at), parametric.forces(at)
    n = system.degrees_of_freedom
    period = 2.0 * math.pi / at["w"]
    u, v = (np.zeros(n), np.zeros(n)) if start is None else start
    motion = simulate(system, u, v, (periods + load_periods) * period, forces=forces)
    events = motion.stop_events
    end = periods + (load_periods / 2 if half else load_periods)
    inside = (events.times >= periods * period) & (events.times < end * period) & ~events.touches
    sequence = tuple(letter for letter, here in zip(events.contacts, inside, strict=True) if here)
    problem = ForcedProblem(parametric, sequence, released, load_periods=load_periods, half=half, values=values)
    if sequence:
        states, fractions = events.after[inside], events.times[inside] / (load_periods * period) - periods / load_periods
    else:
        states, fractions = motion.final[None], np.zeros(1)
    return problem, problem.pack(states, fractions, [at[name] for name in released])


@cache
def absorber_families():
    """The response of the shipped absorber over w, and families that emanate from it: with one impact more in half a period, without
    the symmetry, and of twice the period."""
    from branches.forced.tracing import follow_response, switch_response
    from saltus.scene import load_scene
    from transitions.response.path import ParameterPath
    from transitions.response.starting import settled_orbit
    from transitions.sweep.settle import settle

    def emanating(branch, code):
        event = next(event for event in branch.events if event.type == code)
        return follow_response(*switch_response(branch, event)[0], (0.7, 2.2))

    parametric = load_scene("absorber").parametric
    found = settled_orbit(ParameterPath(parametric, ["w"]), settle(parametric.system(), parametric.forces()))
    first = follow_response(found.problem, found.y, (0.7, 2.2))
    four = emanating(first, "GR")
    broken = emanating(four, "SB")
    return first, four, broken, emanating(broken, "PD")
