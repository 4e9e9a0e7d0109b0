"""The fast path for many motions of a system with two oscillating modes and one stop, in one compiled call.

`bvp.simulate` runs every motion of every system, and keeps a record. The fast path covers
systems with two oscillating degrees of freedom and one stop. It declines motions that grow, graze, stick or chatter to an end;
`bvp.simulate` runs those.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.blocks import decay_rates, exact
from bvp.forcing import budget_terms, forcing_of, split_damping
from bvp.kernels import fast_path as kernels
from bvp.kernels import two_modes as places
from bvp.modes import energy_form, impulse_direction, two_parts

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["CLEARED", "DECLINED", "FULL_COUNT", "TIMED", "FastPathRuns", "fast_path_numbers", "run_fast_path", "with_restitution"]

CLEARED, TIMED, FULL_COUNT, DECLINED = kernels.CLEARED, kernels.TIMED, kernels.FULL_COUNT, kernels.DECLINED

STEP = 0.7
"""Length of a step times the fastest rate."""

SETTLES = 1e-9
"""Decay, of the rate of a mode, from which on it counts as coming to rest."""

NEAR, WORST, SEEN = 1e-3, 1e3, 1e-6
"""Limits of the fast path: rates too close to each other, modes too close to parallel, or a mode that hardly moves the gap.
`bvp.simulate` runs such systems."""

MOST_TERMS = 4


@dataclass(frozen=True, eq=False)
class FastPathRuns:
    """Results of b motions on the fast path.

    Attributes
    ----------
    reason : (b,) int64 ndarray
        CLEARED (no impact is possible any more), TIMED (the duration), FULL_COUNT (the most impacts) or DECLINED (nothing else holds then).
    duration, impacts, last_impact : (b,) ndarray
        Time reached, number of impacts, and time of the last one (NaN: none). If no further impact is possible, the duration is that time,
        and the dissipation after it counts to infinite time.
    peaks : (b, 2) ndarray
        Largest |u_1| and |u_2|.
    dissipated : (b, 3) ndarray
        By the dampers across the gap, by the others, at the stop.
    times : (b, Q) ndarray
        When each fraction of the initial energy is dissipated; NaN if it is not.
    initial_energy, energy : (b,) ndarray
        At the start and at the end, or at rest where the motion counts to infinite time.
    """

    reason: np.ndarray
    duration: np.ndarray
    impacts: np.ndarray
    last_impact: np.ndarray
    peaks: np.ndarray
    dissipated: np.ndarray
    times: np.ndarray
    initial_energy: np.ndarray
    energy: np.ndarray

    @property
    def balance(self) -> np.ndarray:
        """Initial energy - dissipated - present energy, (b,)."""
        return self.initial_energy - self.dissipated.sum(axis=1) - self.energy


def fast_path_numbers(system: ImpactSystem, dampers: Mapping[str, Any] | None = None) -> np.ndarray | None:
    """The row of numbers that describes a system to `bvp.kernels.fast_path`; None if the fast path does not cover the system.

    Parameters
    ----------
    system : ImpactSystem
    dampers : mapping of str to (2, 2) array_like, optional
        The two parts of the damping matrix whose dissipation is reported; by default those of `bvp.forcing.split_damping`.

    Raises
    ------
    ValueError
        If there are not two dampers, or they do not sum to the damping matrix.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> fast_path_numbers(vibro_impact_nes(lam=0.01)) is None, fast_path_numbers(vibro_impact_nes(sigma=0.0)) is None
    (False, True)
    """
    parts = split_damping(system, dampers)
    if len(parts) != 2:
        raise ValueError(f"the fast path reports two parts of the damping matrix; received {len(parts)}: {', '.join(parts)}")
    if system.degrees_of_freedom != 2 or len(system.stops) != 1 or system.smooth_forces is not None:
        return None
    stop = system.stops[0]
    if not stop.lower < 0.0 < stop.upper or not stop.restitution > 0.0:
        return None
    inverse = np.linalg.inv(system.mass)
    matrix = np.zeros((4, 4))
    matrix[:2, 2:] = np.eye(2)
    matrix[2:, :2], matrix[2:, 2:] = -inverse @ system.stiffness, -inverse @ system.damping
    values, vectors = np.linalg.eig(matrix)
    at = np.flatnonzero(values.imag > 0.0)
    if len(at) != 2 or abs(values[at[0]] - values[at[1]]) <= NEAR * np.abs(values).max() or np.linalg.cond(vectors) > WORST:
        return None
    at = at[np.argsort(values[at].imag)]
    left = np.linalg.inv(vectors)
    gap = np.array(stop.gap)
    numbers = np.zeros(places.TERMS + places.AT * MOST_TERMS)
    into, out = np.zeros((4, 4)), np.zeros((4, 4))
    rates = values[at]
    for k, index in enumerate(at):
        seen = gap @ vectors[:2, index]
        if abs(seen) <= SEEN * np.linalg.norm(gap) * np.linalg.norm(vectors[:2, index]):
            return None
        inward, outward = 2.0 * seen * left[index], vectors[:, index] / seen
        into[2 * k], into[2 * k + 1] = inward.real, -inward.imag
        out[:, 2 * k], out[:, 2 * k + 1] = outward.real, outward.imag
    shapes = out[:, 0::2] + 1j * out[:, 1::2]
    mean = decay_rates(system, shapes)
    if not np.all(mean <= 0.0):
        return None
    frequency = rates.imag
    rate = exact(np.stack([mean, frequency], axis=1).ravel())
    push, push_rest = two_parts(impulse_direction(energy_form(system, mean + 1j * frequency, shapes), rate))
    compliance = gap @ inverse @ gap
    step = STEP / float(np.abs(rates).max())
    numbers[places.MEAN : places.MEAN + 2] = mean
    numbers[places.FREQUENCY : places.FREQUENCY + 2] = rates.imag
    numbers[places.STEP] = step
    numbers[places.LOWER], numbers[places.UPPER] = stop.lower, stop.upper
    numbers[places.RESTITUTION], numbers[places.MASS] = stop.restitution, 1.0 / compliance
    numbers[places.PUSH : places.PUSH + 4] = push
    numbers[places.PUSH_REST : places.PUSH_REST + 4] = push_rest
    numbers[places.INTO : places.INTO + 16], numbers[places.OUT : places.OUT + 16] = into.ravel(), out.ravel()
    numbers[places.FORM : places.FORM + 8] = np.concatenate([system.mass.ravel(), system.stiffness.ravel()])
    for level in range(places.LEVELS):
        turn = np.exp((mean + 1j * rates.imag) * step / 2**level)
        numbers[places.ROTATIONS + 4 * level : places.ROTATIONS + 4 * level + 4] = np.stack([turn.real, turn.imag], axis=1).ravel()
    terms = budget_terms(parts, forcing_of(None, 2), 1)
    if len(terms.weight) > MOST_TERMS or np.any(terms.weight < 0.0):
        return None
    for k in range(MOST_TERMS):
        base = places.TERMS + places.AT * k
        numbers[base] = -1.0
        if k < len(terms.weight):
            numbers[base], numbers[base + 1] = terms.part[k], terms.weight[k]
            numbers[base + 2 : base + 6] = terms.velocity[k] @ out[2:]
    return numbers


def with_restitution(numbers: np.ndarray, restitution: float) -> np.ndarray:
    """The numbers of the same system with another restitution, above 0 and up to 1."""
    changed = numbers.copy()
    changed[places.RESTITUTION] = restitution
    return changed


def run_fast_path(
    numbers: np.ndarray,
    which: np.ndarray,
    states: Any,
    energies: Any,
    *,
    duration: float,
    to_rest: bool,
    max_impacts: Any,
    fractions: Sequence[float],
) -> FastPathRuns:
    """Motions from many states.

    Parameters
    ----------
    numbers : (S, ..) ndarray
        A row of `fast_path_numbers` for each system; `which` (b,) is the system of each motion.
    states, energies : (b, 4) and (b,) array_like
        (u, v) of each start, and its energy.
    duration, max_impacts : float, int or (b,) array_like of int
    to_rest : bool
        Where no impact is possible any more and both modes come to rest, the motion counts to infinite time.
    fractions : sequence of float
        Ascending, of the initial energy.
    """
    numbers = np.ascontiguousarray(numbers)
    starts, initial = np.array(states, dtype=float, order="C"), np.ascontiguousarray(energies, dtype=float)
    terms = np.count_nonzero(numbers[:, places.TERMS :: places.AT] >= 0.0, axis=1)
    rates = np.hypot(numbers[:, places.MEAN : places.MEAN + 2], numbers[:, places.FREQUENCY : places.FREQUENCY + 2])
    rests = np.all(numbers[:, places.MEAN : places.MEAN + 2] < -SETTLES * rates, axis=1) & to_rest
    wanted = np.array(fractions, dtype=float)
    most = np.array(np.broadcast_to(max_impacts, len(starts)), dtype=np.int64)
    out = np.empty((len(starts), kernels.COLUMNS + len(wanted)))
    systems = kernels.Systems(numbers, terms, rests, np.ascontiguousarray(which, dtype=np.int64))
    kernels.fast_path_batch(systems, starts, initial, float(duration), most, wanted, np.empty(4), np.empty(places.PARTS), out)
    ended = np.where(out[:, kernels.REASON] == CLEARED, rests[which], False)
    spent = out[:, kernels.SPENT : kernels.SPENT + places.PARTS]
    forms = numbers[which, places.FORM : places.FORM + 8].reshape(-1, 2, 2, 2)  # mass and stiffness
    u, v = starts[:, :2], starts[:, 2:]
    kinetic_and_elastic = 0.5 * (np.einsum("bi,bij,bj->b", v, forms[:, 0], v) + np.einsum("bi,bij,bj->b", u, forms[:, 1], u))
    return FastPathRuns(
        reason=out[:, kernels.REASON].astype(np.int64),
        duration=out[:, kernels.TIME],
        impacts=np.where(out[:, kernels.REASON] == DECLINED, 0.0, out[:, kernels.IMPACTS]).astype(np.int64),
        last_impact=out[:, kernels.LAST],
        peaks=out[:, kernels.PEAKS : kernels.PEAKS + 2],
        dissipated=spent,
        times=out[:, kernels.TIMES :],
        initial_energy=initial,
        energy=np.where(ended, 0.0, kinetic_and_elastic),
    )
