"""Two impacts at different stops that merge: they change their order, where their impulses do not act on each other."""

from __future__ import annotations

import numpy as np

from bvp.multipoint import MultipointProblem

__all__ = ["CannotMerge", "merged"]

_SHORT = 1e-8
_SAME = 1e-8


class CannotMerge(ValueError):
    """Impacts that merge without a family behind; the message says why."""


def merged(problem: MultipointProblem, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray, tuple[str, str]] | None:
    """The family behind a flight that has vanished: the two impacts around it in the other order.

    Returns
    -------
    problem, y, stops
        The problem with the other order, the orbit as its solution, the two contacts; None where no flight has vanished between impacts
        at different contacts.

    Raises
    ------
    CannotMerge
        Where the order matters, because the impulse of one stop changes the speed at the other, or where an impact comes to an end.
    """
    times = problem.flight_times(y)
    flight = int(np.argmin(times))
    if times[flight] > _SHORT * float(np.sum(times)):
        return None
    word, states, start = list(problem.word), problem.nodes(y), problem.start(y)
    if problem.periodic:
        # Impacts are numbered from the start, and turned so that the start is another one than the two.
        turned = [(i + flight - 1) % len(word) for i in range(len(word))]
        word, states, times = [word[i] for i in turned], np.vstack([start, states])[turned], times[turned]
        i = 1
    else:
        i = flight - 1
    if i < 0 or i + 1 >= len(word):
        raise CannotMerge("an impact comes to an end of the solved segment: it and its image cannot change their order")
    here, there = word[i], word[i + 1]
    if here == there:
        return None
    before = _strike(problem, here, states[i])
    between = _strike(problem, there, before)
    if not np.allclose(_strike(problem, here, between), states[i + 1], rtol=0.0, atol=_SAME * float(np.max(np.abs(states)))):
        raise CannotMerge(f"impacts at {here} and {there} act on each other, so that at one instant their order would matter")
    states = states.copy()
    states[i] = between
    word[i], word[i + 1] = there, here
    other = MultipointProblem(problem.system, problem.ends, word)
    y = other.pack(states[0], states[1:], times) if problem.periodic else other.pack(start, states, times)
    return other, y, (here, there)


def _strike(problem: MultipointProblem, letter: str, z: np.ndarray) -> np.ndarray:
    """The state after an elastic impact, from the one before it or the other way round."""
    modes = problem.modes
    c = modes.contact_letters.index(letter)
    return z - (1.0 + modes.contact_restitution[c]) * modes.contact_push[c] * float(modes.contact_rate[c] @ z)
