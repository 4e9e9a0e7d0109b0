"""The orbits that are followed here: S13O00+ run through several times, so that the exact answer is known for any number of impacts.

The quarter of an orbit SmnO00 goes from the origin to a stop and has no inner impact. The segment that goes on from there, through
k impacts to the next one, covers 2k + 1 quarters of the same orbit: to the multipoint problem with k inner impacts it is a
solution like any other, and the closed form of one impact a half period gives its energy and its velocities.
"""

from __future__ import annotations

import numpy as np

from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, vibro_impact_nes
from continuation.problem import Step
from saltus.bench import backbone

__all__ = ["ALPHA", "INNER", "MU", "SIGMA", "closed_form_error", "segment", "step_error", "system"]

MU, SIGMA = 0.1, 0.1

INNER = (0, 2, 4, 8, 64)
"""Numbers of inner impacts."""

ALPHA = 1.65
"""Quarter period where the families are started: h = 5.1366. From there to the grazing end at h = 14.554 events are few (each is one of
S13O00+, or one of the orbits near it that close after 2k + 1 turns), and one flight takes about half a period of the fast mode."""


def system() -> ImpactSystem:
    """The reference system."""
    return vibro_impact_nes(MU, SIGMA)


def segment(of: ImpactSystem, inner: int, alpha: float = ALPHA) -> tuple[MultipointProblem, np.ndarray]:
    """The problem with `inner` impacts between the origin and a stop, and its exact unknowns at a quarter period of S13O00+.

    Parameters
    ----------
    of : ImpactSystem
        With one stop of gap -1..1.
    inner : int
        Number k of inner impacts.
    alpha : float
        Quarter period of the orbit that is run through; the segment is 2k + 1 times as long.

    Returns
    -------
    (MultipointProblem, (u,) float)
    """
    n = of.degrees_of_freedom
    start = of.modes.from_state @ np.concatenate([np.zeros(n), backbone.origin_velocity(of, alpha)])
    u, v = backbone.motion(of, alpha, np.array([-alpha]))
    after = -(of.modes.from_state @ np.concatenate([u[0], v[0]]))  # an antiperiodic motion has just left the upper side at t = alpha
    nodes = np.array([after if i % 2 == 0 else -after for i in range(inner)]).reshape(inner, 2 * n)
    word = tuple("+-"[i % 2] for i in range(inner))
    problem = MultipointProblem(of, ("origin", "stop" + "+-"[inner % 2]), word)
    return problem, problem.pack(start, nodes, [alpha] + [2.0 * alpha] * inner)


def closed_form_error(of: ImpactSystem, inner: int, energy: float, duration: float, velocities: np.ndarray) -> float:
    """Relative error of an orbit against the closed form at its own quarter period: the larger of those of h and of the start.

    Parameters
    ----------
    of : ImpactSystem
    inner : int
        Number k of inner impacts.
    energy : float
        h of the orbit.
    duration : float
        Time from the origin to the stop at the end of the segment; 2k + 1 quarters.
    velocities : (n,) float
        At the origin.
    """
    alpha = duration / (2 * inner + 1)
    exact = backbone.origin_velocity(of, alpha)
    in_energy = abs(energy / backbone.energy(of, alpha) - 1.0)
    in_velocity = float(np.linalg.norm(velocities - exact) / np.linalg.norm(exact))
    return max(in_energy, in_velocity)


def step_error(problem: MultipointProblem, step: Step) -> float:
    """The same for a point that saltus found."""
    of = problem.system
    state = of.modes.to_state @ problem.start(step.y)
    velocities = state[of.degrees_of_freedom :]
    return closed_form_error(of, problem.inner, step.parameter, float(np.sum(problem.flight_times(step.y))), velocities)
