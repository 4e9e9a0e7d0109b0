"""Run a system from a state: the front door to `bvp.damped.Mover` for one motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bvp.damped import Mover

if TYPE_CHECKING:
    from bvp.motion import Motion
    from bvp.system import ImpactSystem

__all__ = ["run"]


def run(
    system: ImpactSystem,
    u: Any,
    v: Any,
    duration: float,
    max_impacts: int = 10_000_000,
    leaving: str | None = None,
    *,
    forces: Any = None,
    dampers: Mapping[str, Any] | None = None,
    marks: Sequence[float] = (0.5, 0.85, 0.9, 0.99),
    on_progress: Callable[[float], object] | None = None,
) -> Motion:
    """The motion of a system from the state (u, v): flights, impacts, chattering, sticking, and where the energy goes.

    Parameters
    ----------
    system : ImpactSystem
    u, v : (n,) array_like
        Displacements and velocities at time 0.
    duration : float
        Time to run, >= 0.
    max_impacts : int
        Most impacts; the motion ends there.
    leaving : str, optional
        Letter of the contact that the start is on exactly, after its impact. A start within the contact tolerance of a stop
        is on it without being told.
    forces : Constant, Harmonic, Record or a list of them, optional
        Loads f(t) (`bvp.forcing`).
    dampers : mapping of str to (n, n) array_like, optional
        Named parts that sum to the damping matrix, whose dissipation is told apart; by default those across gaps and the rest.
    marks : sequence of float
        Fractions of the initial energy: the time at which that much is dissipated is found.
    on_progress : callable, optional
        Called with the time that the motion has come to, some times a second.

    Returns
    -------
    Motion
        `status` says how it ended; no ending is an exception, whatever the restitution, but for a start beyond a stop.

    Raises
    ------
    KeyboardInterrupt
        With the motion up to there as its attribute `motion`.
    ValueError
        For a start beyond a stop, a state or a load of the wrong length or not finite, a negative duration, a max_impacts below 0, an
        unknown contact, marks outside (0, 1), dampers that do not sum to the damping matrix.

    Examples
    --------
    A ball between two walls, without gravity:

    >>> from bvp.system import ImpactSystem, Stop
    >>> free = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 1.0)])
    >>> motion = run(free, [0.5], [1.0], 3.0)
    >>> motion.stop_events.times, motion.stop_events.contacts, motion.status.name
    (array([0.5, 1.5, 2.5]), ('+', '-', '+'), 'DURATION_REACHED')
    >>> u, v = motion.sample([0.25, 0.5, 1.0])
    >>> u[:, 0], v[:, 0]
    (array([0.75, 1.  , 0.5 ]), array([ 1., -1., -1.]))

    One that falls from height 1/2, g = 1, and keeps half its speed: it rests at t = 1 + 2 v r/(g (1 - r)) = 3.

    >>> from bvp.forcing import Constant
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)])
    >>> motion = run(ball, [0.5], [0.0], 5.0, forces=Constant([-1.0]))
    >>> round(motion.stretches[1].begin, 12), motion.stretches[1].held, motion.balance_error < 1e-15
    (3.0, ('-',), True)
    """
    return Mover(system, forces, dampers).run(u, v, duration, max_impacts, leaving, marks, on_progress)
