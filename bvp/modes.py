"""The modes of free flight: the first-order form z' = B z of M u'' + C u' + K u = 0 with B in blocks, and the rows of the
contacts.

Undamped and proportionally damped systems keep the real undamped modes, u = Phi q, v = Phi p, Phi^T M Phi = I, z = (q, p).
Modes that damping couples are block-diagonalised together (`bvp.blocks`).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.blocks import Blocks, damped_blocks, undamped_blocks
from bvp.numerics import exact_product, undamped_modes

if TYPE_CHECKING:
    from bvp.kernels.flight import Contacts, Flight
    from bvp.system import ImpactSystem

__all__ = ["Modes", "balanced", "modes_of", "undamped_modes"]


@dataclass(frozen=True, eq=False)
class Modes:
    """Arrays of free flight and of the contacts, for N = 2n states and m contacts, in C order.

    They are shared by all who ask and not to be written to; no flag says so, because the kernels would then be compiled twice.

    The blocks (layout of `bvp.kernels.flight`)
        pairs (P, 2), mean (P,), delta (P,), matrix (N, N).
    The states
        to_state (2n, N): (u, v) = to_state z; from_state (N, 2n): its inverse.
    The undamped modes
        frequencies (n,), ascending, exactly 0 for a rigid-body mode, NaN where the stiffness is negative; squares (n,), their
        squares (negative where the stiffness is); shapes (n, n), the columns of Phi. layout: "undamped", "proportional" or
        "coupled"; in the first two z = (q_1..q_n, p_1..p_n) with pairs (k, n + k).
    The contacts, one for each finite bound of each stop, lower before upper
        contact_gap, contact_rate, contact_acceleration, contact_push (m, N): w = gap . z, w' = rate . z, w'' = acceleration . z
        in free flight, z+ = z - (1 + r) push (rate . z) at an impact; contact_side (m,), +1 upper and -1 lower; contact_bound,
        contact_restitution (m,); contact_stop (m,), index of the stop; contact_opposite (m,), index of the contact on the
        stop's other side, the contact itself where there is none; contact_letters, "-" and "+", after the stop's letter where there are
        several stops.
    """

    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    to_state: np.ndarray
    from_state: np.ndarray
    frequencies: np.ndarray
    squares: np.ndarray
    shapes: np.ndarray
    layout: str
    contact_gap: np.ndarray
    contact_rate: np.ndarray
    contact_acceleration: np.ndarray
    contact_push: np.ndarray
    contact_side: np.ndarray
    contact_bound: np.ndarray
    contact_restitution: np.ndarray
    contact_stop: np.ndarray
    contact_opposite: np.ndarray
    contact_letters: tuple[str, ...]

    @property
    def flight(self) -> Flight:
        """The blocks as the kernels take them."""
        from bvp.kernels.flight import Flight

        return Flight(self.pairs, self.mean, self.delta, self.matrix)

    @property
    def contacts(self) -> Contacts:
        """The contacts as the kernels take them."""
        from bvp.kernels.flight import Contacts

        return Contacts(
            self.contact_gap,
            self.contact_rate,
            self.contact_acceleration,
            self.contact_side,
            self.contact_bound,
            self.contact_push,
            self.contact_restitution,
        )


def modes_of(system: ImpactSystem) -> Modes:
    """The modes of a system.

    Parameters
    ----------
    system : ImpactSystem

    Returns
    -------
    Modes

    Raises
    ------
    RuntimeError
        Where an eigenvalue iteration does not converge.
    """
    squares, shapes = undamped_modes(system.mass, system.stiffness)
    blocks: Blocks
    if np.any(system.damping):
        blocks = damped_blocks(system, squares, shapes)
    else:
        blocks = undamped_blocks(system.mass, squares, shapes)
    n = system.degrees_of_freedom
    position, velocity = blocks.to_state[:n], blocks.to_state[n:]
    gap: list[np.ndarray] = []
    rate: list[np.ndarray] = []
    acceleration: list[np.ndarray] = []
    push: list[np.ndarray] = []
    side: list[float] = []
    bound: list[float] = []
    restitution: list[float] = []
    stop_index: list[int] = []
    letters: list[str] = []
    for k, stop in enumerate(system.stops):
        row = np.array(stop.gap)
        participation = exact_product(row, blocks.shapes)
        impulse = blocks.shapes @ participation / (participation @ participation)
        for sign, limit in ((-1.0, stop.lower), (1.0, stop.upper)):
            if np.isinf(limit):
                continue
            gap.append(exact_product(row, position))
            rate.append(exact_product(row, velocity))
            acceleration.append(rate[-1] @ blocks.matrix)
            push.append(balanced(blocks.from_state[:, n:] @ impulse, rate[-1]))
            side.append(sign)
            bound.append(limit)
            restitution.append(stop.restitution)
            stop_index.append(k)
            letters.append((stop.name if len(system.stops) > 1 else "") + ("+" if sign > 0.0 else "-"))
    return Modes(
        pairs=_array(blocks.pairs),
        mean=_array(blocks.mean),
        delta=_array(blocks.delta),
        matrix=_array(blocks.matrix),
        to_state=_array(blocks.to_state),
        from_state=_array(blocks.from_state),
        frequencies=np.sqrt(np.where(squares < 0.0, np.nan, squares)),
        squares=squares,
        shapes=_array(blocks.shapes),
        layout=blocks.layout,
        contact_gap=_array(gap),
        contact_rate=_array(rate),
        contact_acceleration=_array(acceleration),
        contact_push=_array(push),
        contact_side=_array(side),
        contact_bound=_array(bound),
        contact_restitution=_array(restitution),
        contact_stop=np.array(stop_index, dtype=np.int64),
        contact_opposite=np.array(_opposite(stop_index), dtype=np.int64),
        contact_letters=tuple(letters),
    )


def balanced(push: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """`push` moved by an ulp or two so that rate . push is 1 as nearly as it can be.

    An impact returns the speed 2 rate . push - 1 times; were that off by a rounding, always to one side, the energy of a long elastic run
    would drift by it at each impact.

    Examples
    --------
    >>> rate = np.array([0.3, 0.7])
    >>> push = rate / (rate @ rate)
    >>> from fractions import Fraction
    >>> off = [sum(Fraction(a) * Fraction(b) for a, b in zip(rate, x, strict=True)) - 1 for x in (push, balanced(push, rate))]
    >>> abs(off[1]) < abs(off[0])
    True
    """
    push = push.copy()
    off = sum((Fraction(float(a)) * Fraction(float(b)) for a, b in zip(push, rate, strict=True)), Fraction(-1))
    steps = [Fraction(float(np.spacing(a))) * Fraction(float(b)) for a, b in zip(push, rate, strict=True)]
    for i in sorted(range(len(steps)), key=lambda i: -abs(steps[i])):
        moved = max(-2, min(2, round(-off / steps[i]))) if push[i] and steps[i] else 0
        push[i] += moved * np.spacing(push[i])
        off += moved * steps[i]
    return push


def _opposite(stops: list[int]) -> list[int]:
    """For each contact of these stops, the index of the other one of its stop; its own where there is none."""
    return [next((j for j, other in enumerate(stops) if other == stop and j != i), i) for i, stop in enumerate(stops)]


def _array(values: Any) -> np.ndarray:
    """A contiguous copy without negative zeros."""
    return np.array(values, order="C") + 0
