"""Orbits with a known answer and any number of impacts or masses: S13O00+ traversed several times, and a chain of masses.

The quarter of an orbit SmnO00 goes from the origin to a stop without an inner impact. The segment that continues through k impacts to the
next one covers 2k + 1 quarters of the same orbit. It solves the multipoint problem with k inner impacts. The closed form of one impact a
half period gives its energy and its velocities.
"""

from __future__ import annotations

import numpy as np

from benchmarks import backbone
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from continuation.problem import Step

__all__ = ["ALPHA", "INNER", "MU", "SIGMA", "chain", "closed_form_error", "physical_period", "segment", "step_error", "system"]

MU, SIGMA = 0.1, 0.1
"""Parameters of the reference system."""

INNER = (0, 2, 4, 8, 64)
"""Numbers of inner impacts."""

ALPHA = 1.65
"""Quarter period at which the families start (h = 5.1366). Few events lie between there and the grazing end at h = 14.554.
Each is an event of S13O00+ or of a nearby orbit that closes after 2k + 1 quarters. A flight takes about half a period of the fast mode."""


def system() -> ImpactSystem:
    """The reference system."""
    return vibro_impact_nes(MU, SIGMA)


def chain(degrees: int) -> ImpactSystem:
    """A chain of unit masses, each on a spring to the ground and coupled to the next. The first has a cavity with a small mass.

    Parameters
    ----------
    degrees : int
        Degrees of freedom, 2 or more; with 2 it is the reference system.
    """
    stiffness = np.diag([SIGMA, 1.0 + SIGMA, *[1.0] * (degrees - 2)])
    stiffness[0, 1] = stiffness[1, 0] = -SIGMA
    for i in range(1, degrees - 1):
        stiffness[i : i + 2, i : i + 2] += [[1.0, -1.0], [-1.0, 1.0]]
    gap = (1.0, -1.0, *[0.0] * (degrees - 2))
    return ImpactSystem(np.diag([MU, *[1.0] * (degrees - 1)]), np.zeros((degrees, degrees)), stiffness, (Stop(gap, -1.0, 1.0),))


def physical_period(system: ImpactSystem) -> float:
    """The first quarter period of a grid at which the orbit with one impact a half period stays within the stops.

    Raises
    ------
    RuntimeError
        If there is none.
    """
    for alpha in np.linspace(0.3, 0.6, 31):
        if backbone.is_physical(system, float(alpha)):
            return float(alpha)
    raise RuntimeError("no orbit of one impact a half period within the stops was found")


def segment(of: ImpactSystem, inner: int, alpha: float = ALPHA) -> tuple[MultipointProblem, np.ndarray]:
    """The problem with `inner` impacts between the origin and a stop, and its exact unknowns (u,) at a quarter period of S13O00+.

    The system has one stop of gap -1..1. With k inner impacts the segment is 2k + 1 quarters long."""
    n = of.degrees_of_freedom
    start = of.modes.from_state @ np.concatenate([np.zeros(n), backbone.origin_velocity(of, alpha)])
    u, v = backbone.motion(of, alpha, np.array([-alpha]))
    # The motion is antiperiodic: the state after the impact at t = alpha is minus the one at t = -alpha.
    after = -(of.modes.from_state @ np.concatenate([u[0], v[0]]))
    nodes = np.array([after if i % 2 == 0 else -after for i in range(inner)]).reshape(inner, 2 * n)
    sequence = tuple("+-"[i % 2] for i in range(inner))
    problem = MultipointProblem(of, ("origin", "stop" + "+-"[inner % 2]), sequence)
    return problem, problem.pack(start, nodes, [alpha] + [2.0 * alpha] * inner)


def closed_form_error(of: ImpactSystem, inner: int, energy: float, duration: float, velocities: np.ndarray) -> float:
    """Relative error of an orbit against the closed form at its own quarter period: the larger of those of h and of the start.

    `duration` is the time from the origin to the stop at the end of the segment, 2k + 1 quarters; the velocities (n,) are at the origin."""
    alpha = duration / (2 * inner + 1)
    exact = backbone.origin_velocity(of, alpha)
    in_energy = abs(energy / backbone.energy(of, alpha) - 1.0)
    in_velocity = float(np.linalg.norm(velocities - exact) / np.linalg.norm(exact))
    return max(in_energy, in_velocity)


def step_error(problem: MultipointProblem, step: Step) -> float:
    """The same error of a point that saltus found."""
    of = problem.system
    state = of.modes.to_state @ problem.start(step.y)
    velocities = state[of.degrees_of_freedom :]
    return closed_form_error(of, problem.inner, step.parameter, float(np.sum(problem.flight_times(step.y))), velocities)
