"""The families that begin where a linear mode touches a stop.

At its grazing energy a mode touches the stops at M instants, half a period apart, in its k-fold cover. Let an impulse of size P_i >= 0
act at instant i, away from the stop, and let the mode's own displacement at the stop grow by e. The impulses act where the mode is at rest,
so to first order they change its phase but not its amplitude, and the other modes answer by x = -C P at the stops, where

    C_ij = s_i s_j sum_l b_il b_jl g_l(t_i - t_j),     g_l(t) = cos(w_l (t - T/2)) / (2 w_l sin(w_l T/2)),   0 <= t <= T

is their periodic response. Here s_i = +-1 is the side of the stop, b_il the participation of mode l there, and T the period of the cover.
At each instant there is either an impact, with x_i + e = 0 and P_i > 0, or none, with x_i + e < 0 and P_i = 0. This is a linear
complementarity problem. Its solutions with e > 0 begin upward in energy, those with e < 0 downward, and impact speeds grow in proportion to
|e|. Where C restricted to the impacts is regular, the implicit function theorem gives exactly one family for each solution, and no others
begin there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from branches.grazing.following import Neighbour, meet
from branches.grazing.touching import EVERY, Touching, candidate
from branches.linear_modes import LinearMode
from branches.tracing import follow_family
from bvp.texts import takes_options_of

__all__ = ["beginnings", "families_at", "response"]

_RESONANT = 1e-9
_MARGIN = 1e-9


def response(mode: LinearMode, orbit: Touching) -> np.ndarray | None:
    """C (M, M): minus the displacement towards the stop, at each instant, by unit impulses away from it at each instant.

    Returns
    -------
    ndarray or None
        None where another mode is in resonance with the cover, or is a rigid-body mode: it has no periodic response.
    """
    modes = orbit.system.modes
    apart = (orbit.times[:, None] - orbit.times[None, :]) % orbit.period
    out = np.zeros_like(apart)
    side = modes.contact_side[orbit.contact]
    for k, frequency in enumerate(modes.frequencies):
        if k == mode.index:
            continue
        participation = side * modes.contact_gap[orbit.contact, k]
        if np.max(np.abs(participation)) == 0.0:
            continue
        swing = 2.0 * frequency * math.sin(0.5 * frequency * orbit.period)
        if not abs(swing) > _RESONANT:
            return None
        out += np.outer(participation, participation) * np.cos(frequency * (apart - 0.5 * orbit.period)) / swing
    return out


def begins(matrix: np.ndarray, impacts: np.ndarray) -> int:
    """Whether a family with these impacts begins upward (1) or downward (-1) in energy, to first order, or not at all (0).

    Parameters
    ----------
    matrix : (M, M) float
        C.
    impacts : (M,) bool
    """
    try:
        impulses = np.linalg.solve(matrix[np.ix_(impacts, impacts)], np.ones(int(np.sum(impacts))))
    except np.linalg.LinAlgError:
        return 0
    gaps = 1.0 - matrix[np.ix_(~impacts, impacts)] @ impulses
    size = float(np.max(np.abs(impulses)))
    for side in (1, -1):
        if np.all(side * impulses > -_MARGIN * size) and np.all(side * gaps < _MARGIN):
            return side
    return 0


@takes_options_of(follow_family)
def families_at(mode: LinearMode, cover: int, impacts: int, *, periodic: bool = True, **options: Any) -> list[Neighbour]:
    """The families that begin where a linear mode touches the stops, with the period of its k-fold cover.

    Parameters
    ----------
    mode : LinearMode
    cover : int
        k. Families of a shorter period belong to a smaller k. At most 11, so that all choices can be tried.
    impacts : int
        Most impacts in half a period.
    periodic : bool
        Whether families without a reversal are given too; not beyond twelve touches in the cover.
    **options
        As for `branches.tracing.follow_family`; where the mode grazes outside the `energy` range there are none.

    Returns
    -------
    list of Neighbour
        In the order of their impacts; of kind "passage" where the family begins upward in energy, above the mode, and "fold" where it
        begins downward, beside the mode.

    Examples
    --------
    >>> import saltus
    >>> from branches.linear_modes import linear_modes
    >>> mode = linear_modes(saltus.vibro_impact_nes(mu=0.1, sigma=0.1))[0]
    >>> [(family.label, family.kind) for family in families_at(mode, 2, 5, points=30) if family.ends == ("origin", "origin")]
    [('U2210+', 'fold')]
    """
    energy = options.get("energy", (0.0, math.inf))
    return [item.followed(**options) for item in beginnings(mode, cover, impacts, periodic=periodic, energy=energy)]


def beginnings(
    mode: LinearMode, cover: int, impacts: int, *, periodic: bool = True, energy: tuple[float, float] = (0.0, math.inf)
) -> list[Neighbour]:
    """The families of `families_at`, each with only its first orbit `beside` the mode.

    Parameters
    ----------
    mode, cover, impacts, periodic
        As for `families_at`.
    energy : (float, float)
        Where the mode grazes outside there are none.

    Raises
    ------
    ValueError
        For a cover or impacts out of range.
    """
    if cover < 1 or impacts < 1:
        raise ValueError(f"cover is {cover} and impacts {impacts}, expected 1 or more of each")
    if cover >= EVERY:
        raise ValueError(f"cover is {cover}: families are enumerated up to the {EVERY - 1}-fold cover of a linear mode")
    low, high = energy
    if not low <= mode.energies[1] <= high:
        return []
    orbit = mode.touching(cover)
    matrix = response(mode, orbit)
    count = len(orbit.times)
    found = []
    for mask in orbit.choices():
        number = bin(mask).count("1")
        if not 0 < number <= 2 * impacts:
            continue
        if matrix is not None and not begins(matrix, np.array([bool(mask >> i & 1) for i in range(count)])):
            continue
        choice = candidate(orbit, mask)
        if choice.cover > 1 or (choice.ends == ("periodic", "periodic") and not periodic):
            continue
        family = meet(orbit, choice, False)
        if family.beside is not None:
            found.append(family)
    return sorted(found, key=lambda item: (item.impacts, item.ends, item.sequence))
