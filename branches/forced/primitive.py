"""One orbit in several problems: of half its period or the full one, once or repeated; and the primitive orbit that it repeats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from branches.forced.resequencing import in_order
from branches.released.presentation import primitive_free_orbit
from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.multipoint import Solution
from bvp.released import ReleasedProblem

__all__ = [
    "SAME", "apart_from_image", "full_period", "half_later", "half_of", "image_sign", "is_odd", "kind_of", "later_sign", "primitive_orbit",
    "twice",
]  # fmt: skip

SAME = 1e-6
"""Largest change, beside the largest unknown, with which an orbit repeats itself, or has the symmetry of half a period."""


def twice(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit, traversed twice, as a solution of the problem with twice the period."""
    wide = _twice_as_long(problem, problem.sequence * 2, load_periods=2 * problem.load_periods)
    return wide, _repeated(problem, wide, y, np.eye(2 * problem.degrees_of_freedom), 0.5)


def full_period(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit whose half period was solved, as a solution of the problem of its full period."""
    wide = _twice_as_long(problem, [*problem.sequence, *map(problem.mirrored, problem.sequence)], half=False)
    return wide, _repeated(problem, wide, y, -np.eye(2 * problem.degrees_of_freedom), 1.0)


def _twice_as_long(problem: ForcedProblem, sequence: Sequence[str], **changes: Any) -> ForcedProblem:
    """The problem of a segment of twice the duration, in twice as many pieces if there are some."""
    return problem.sibling(sequence, **changes, **({"pieces": 2 * problem.pieces} if problem.pieces > 1 else {}))


def _repeated(problem: ForcedProblem, wide: ForcedProblem, y: np.ndarray, image: np.ndarray, part: float) -> np.ndarray:
    """The unknowns of the wide problem: those of the narrow one, and their image. part: its period over that of the wide one. Linear in y
    but for a constant."""
    values, instants, states = problem.released_values(y), problem.instants(y), problem.states(y)
    if wide.inner == problem.inner:
        return wide.pack(states, instants, values, 2.0 * problem.flight_times(y))
    out = np.zeros(wide.unknowns)
    rows, count = wide.rows(out), problem.inner + 1
    wide.released_values(out)[:] = values
    rows[:count, 1:], rows[count:, 1:] = states, states @ image.T
    if problem.has_clock:
        rows[:, 0] = np.tile(instants * part, 2)
        rows[count:, 0] += 0.5
    else:
        rows[:, 0] = np.tile(problem.flight_times(y), 2)
    return out


def image_sign(problem: ForcedProblem) -> float:
    """What the second half of the sequence is to the first one: 1, the same, of twice a period; -1, its mirror image; 0, neither."""
    count, odd = divmod(len(problem.sequence), 2)
    if odd or not count or problem.half or problem.ends is not None:
        return 0.0
    first, second = problem.sequence[:count], problem.sequence[count:]
    if problem.load_periods % 2 == 0 and first == second:
        return 1.0
    return -1.0 if second == tuple(map(problem.mirrored, first)) else 0.0


def is_odd(problem: ForcedProblem) -> bool:
    """Whether the mirror image of a motion, half a period of the loads later, is a motion, too."""
    if problem.half:
        return True
    try:
        problem.sibling(problem.sequence, half=True, load_periods=1)
    except EndsError:
        return False
    return True


def later_sign(problem: ForcedProblem) -> float:
    """The sign with which the orbits of a problem are orbits of it again half a period later; 0 where they are none."""
    if problem.sequence:
        sign = image_sign(problem)
    else:  # linear responses without impacts are isolated
        sign = 0.0 if problem.half or not problem.is_smooth else -1.0 if problem.load_periods % 2 else 1.0
    return sign if sign >= 0.0 or is_odd(problem) else 0.0


def half_later(problem: ForcedProblem, sign: float, y: np.ndarray) -> np.ndarray:
    """An orbit half a period later, with its states times `later_sign`."""
    out, count = np.array(y), len(problem.sequence) // 2
    if not count:
        pieces = problem.pieces
        states = problem.cut(y, 2 * pieces)[0]
        problem.states(out)[:] = sign * np.roll(states, -pieces, axis=0)[::2]
        return out
    rows = np.roll(problem.rows(y), -count, axis=0)
    rows[:, 1:] *= sign
    rows[:, 0] += np.where(np.arange(2 * count) < count, -0.5, 0.5) * problem.has_clock
    problem.rows(out)[:] = rows
    return out


def apart_from_image(problem: ForcedProblem, y: np.ndarray) -> float:
    """The difference of the states in both halves of an orbit, beside its size, where `image_sign` is not zero."""
    count, states = len(problem.sequence) // 2, problem.states(y)
    return float(np.abs(states[:count] - image_sign(problem) * states[count:]).max() / np.abs(states).max())


def half_of(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, Solution] | None:
    """A symmetric orbit as one of half its period; None where the orbit is not symmetric. Impacts appear and vanish there in pairs."""
    problem, y = in_order(problem, y)
    count, odd = divmod(len(problem.sequence), 2)
    if odd:
        return None
    changes = {"half": True, "values": problem.parameters(y), "pieces": 1 if count else -(-problem.pieces // 2)}
    try:
        half = problem.sibling(problem.sequence[:count], **changes)
    except EndsError:
        return None
    begun = _first_part(problem, y, half, 2)
    if count and problem.sequence != full_period(half, begun)[0].sequence:
        return None
    solution = half.step(begun, np.zeros(2 * half.unknowns), 0.0)
    return None if solution is None or np.abs(solution.y - begun).max() > SAME * np.abs(begun).max() else (half, solution)


def _first_part(problem: ForcedProblem, y: np.ndarray, part: ForcedProblem, times: int) -> np.ndarray:
    """The unknowns of the problem of a part of an orbit, which is so many times as long as the part."""
    kept, size, nodes = len(part.sequence), 2 * problem.degrees_of_freedom, problem.nodes(y)
    if kept:
        states, fractions, flights = nodes[:kept, :size], nodes[:kept, size], problem.flight_times(y)[:kept]
    else:
        states, fractions, flights = problem.cut(y, part.pieces, 1.0 / times)
    return part.pack(states, fractions * problem.load_periods / part.load_periods, nodes[0, size + 1 :], flights)


def primitive_orbit(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """The orbit that y repeats, over half its period where it is symmetric, with its problem; the orbit itself where there is none."""
    if isinstance(problem, ReleasedProblem):
        return primitive_free_orbit(problem, y)
    if problem.half and problem.load_periods == 1:
        return problem, y
    wide, full = full_period(problem, y) if problem.half else (problem, y)
    ordered, whole = in_order(wide, full)
    parts = (_part(ordered, whole, times) for times in range(wide.load_periods, 1, -1) if wide.load_periods % times == 0)
    wide, full = next((part for part in parts if part is not None), (wide, full))
    symmetric = half_of(wide, full)
    if symmetric is not None:
        return symmetric[0], symmetric[1].y
    return (problem, y) if problem.half else (wide, full)


def _part(problem: ForcedProblem, y: np.ndarray, times: int) -> tuple[ForcedProblem, np.ndarray] | None:
    """The orbit that y repeats so many times, as a solution of its own problem; None where it does not."""
    count, rest = divmod(len(problem.sequence), times)
    if rest or problem.sequence != problem.sequence[:count] * times:
        return None
    pieces = 1 if count else -(-problem.pieces // times)
    part = problem.sibling(problem.sequence[:count], load_periods=problem.load_periods // times, pieces=pieces)
    begun = _first_part(problem, y, part, times)
    solution = part.step(begun, np.zeros(2 * part.unknowns), 0.0)
    if solution is None or np.abs(solution.y - begun).max() > SAME * np.abs(begun).max():
        return None
    # Only the first of its repetitions was taken: the others must be the same.
    size = 2 * problem.degrees_of_freedom
    states = problem.nodes(y)[:, :size] if count else problem.cut(y, times * pieces)[0]
    repeated = np.abs(states - np.tile(part.nodes(begun)[:, :size], (times, 1))).max()
    return (part, solution.y) if repeated <= SAME * np.abs(states).max() else None


def kind_of(problem: ForcedProblem) -> str:
    """What the orbits of a family have in common: periods of the loads, symmetry, and the impacts of a full period up to a mirror image."""
    modes, symbols = problem.modes, list(problem.sequence)
    odd = bool(np.all(np.asarray(modes.contact_opposite) >= 0))
    if problem.half:
        symbols += [problem.mirrored(symbol) for symbol in symbols]
    images = [symbols, [problem.mirrored(symbol) for symbol in symbols]] if odd else [symbols]
    turned = (image[k:] + image[:k] for image in images for k in range(max(len(image), 1)))
    return " ".join([str(problem.load_periods), "half" if problem.half else "full", *min(turned)])
