"""Linear modes, free motion without impacts, and the families that begin at the energy at which a mode touches a stop.

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
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from branches.grazing.following import Neighbour, meet
from branches.grazing.touching import EVERY, Touching, candidate, mode_label, mode_name
from branches.sequences import PERIODIC
from branches.tracing import follow_family
from bvp.checks import checked_energy_range, require_system
from bvp.dense import product, solve
from bvp.functions import cos, sin
from bvp.resting import resting_system
from bvp.system import ImpactSystem
from bvp.texts import brief, shown, span, takes_options_of

__all__ = ["MOST_COVERS", "LinearMode", "beginnings", "families_at", "linear_modes", "resonant_modes", "response"]

MOST_COVERS = EVERY - 1
"""Largest cover of a mode at which families are sought."""

_RESONANT = 1e-9
_MARGIN = 1e-9


@brief
@dataclass(frozen=True)
class LinearMode:
    """A mode of free motion. As an orbit it exists up to the energy at which it touches a stop.

    Parameters
    ----------
    system : ImpactSystem
    index : int
        Of its frequency in ascending order, from 0.
    """

    system: ImpactSystem
    index: int

    @property
    def frequency(self) -> float:
        """Angular frequency w."""
        return float(self.system.modes.frequencies[self.index])

    @property
    def alpha(self) -> float:
        """A quarter of its period."""
        return 0.5 * math.pi / self.frequency

    @property
    def label(self) -> str:
        """L11+ where absorber and primary move the same way, L11- where they do not; "" for other systems than two such masses."""
        return mode_label(self.system, self.index)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [("frequency", f"{self.frequency:.10g}, alpha = {self.alpha:.10g}"), ("energies", span("h", self.energies))]
        return f"LinearMode {self.name}", rows

    @property
    def name(self) -> str:
        """Its label; L1, L2, ... by rising frequency for other systems."""
        return mode_name(self.system, self.index)

    @cached_property
    def amplitude(self) -> float:
        """Largest modal amplitude without an impact."""
        modes = self.system.modes
        gap = np.abs(modes.contacts.gap[:, self.index])
        with np.errstate(divide="ignore"):
            return float(np.min(np.abs(modes.contacts.bound) / gap))

    @property
    def energies(self) -> tuple[float, float]:
        """The range of energies in which it exists: from 0 to (w times its largest amplitude)^2/2."""
        return 0.0, 0.5 * (self.frequency * self.amplitude) ** 2

    @cached_property
    def stops(self) -> tuple[str, ...]:
        """Letters of the contacts that it touches at its largest energy."""
        modes = self.system.modes
        touched = np.abs(modes.contacts.bound) <= np.abs(modes.contacts.gap[:, self.index]) * self.amplitude * (1.0 + 1e-12)
        return tuple(letter for letter, touches in zip(modes.contact_letters, touched, strict=True) if touches)

    def touching(self, cover: int = 1) -> Touching:
        """The mode at its grazing energy, as its k-fold cover, from an instant at which it passes the origin.

        Raises
        ------
        ValueError
            Where it touches two stops at one instant.
        """
        modes = self.system.modes
        contacts = np.array([modes.contact_letters.index(letter) for letter in self.stops], dtype=np.int64)
        sides = np.sign(modes.contacts.bound[contacts] * modes.contacts.gap[contacts, self.index])
        order = np.argsort(-sides)
        contacts, sides = contacts[order], sides[order]
        if len(set(sides)) < len(sides):
            raise ValueError(f"the mode of frequency {self.frequency:.10g} touches the stops {', '.join(self.stops)} at one instant")
        states = np.zeros((len(sides), 2 * self.system.degrees_of_freedom))
        states[:, self.index] = sides * self.amplitude
        times = self.alpha * np.where(sides > 0.0, 1.0, 3.0)
        orbit = Touching(self.system, 4.0 * self.alpha, times, contacts, states, states, np.ones(len(sides), dtype=bool), 0)
        return orbit.repeated(cover)


def linear_modes(system: ImpactSystem) -> list[LinearMode]:
    """The modes that move, come to rest and reach a stop: all but rigid-body modes and those that leave every gap unchanged.

    Beside smooth forces there are none: no orbit of finite size is that of a mode. There are none either where the rest position lies at or
    beyond a stop. Those of a system with constant forces are the modes about its position at rest (`bvp.resting`).

    Parameters
    ----------
    system : ImpactSystem

    Raises
    ------
    ValueError
        For a system that loses energy.

    Examples
    --------
    >>> import saltus
    >>> [(mode.label, round(mode.energies[1], 10)) for mode in linear_modes(saltus.vibro_impact_nes(mu=0.1, sigma=0.1))]
    [('L11+', 0.1185078106), ('L11-', 0.0864921894)]
    """
    require_system(system, smooth=True)
    reason = system.why_not_conservative()
    if reason is not None:
        raise ValueError(f"families of periodic orbits need a conservative system: {reason}")
    system = resting_system(system)
    if system.smooth_forces is not None or system.why_not_inside() is not None:
        return []
    modes = system.modes
    size = np.linalg.norm(modes.contacts.gap, axis=1).max()
    return [
        LinearMode(system, k)
        for k, frequency in enumerate(modes.frequencies)
        if frequency > 0.0 and np.max(np.abs(modes.contacts.gap[:, k])) > _MARGIN * size
    ]


def response(mode: LinearMode, orbit: Touching) -> np.ndarray | None:
    """C (M, M): minus the displacement towards the stop, at each instant, by unit impulses away from it at each instant.

    Returns
    -------
    ndarray or None
        None where the first order decides nothing: another mode is in resonance with the cover, or is a rigid-body mode, and has no
        periodic response; or no other mode moves the gaps.
    """
    modes = orbit.system.modes
    apart = (orbit.times[:, None] - orbit.times[None, :]) % orbit.period
    out = np.zeros_like(apart)
    side = modes.contacts.side[orbit.contact]
    for k, frequency in enumerate(modes.frequencies):
        if k == mode.index:
            continue
        participation = side * modes.contacts.gap[orbit.contact, k]
        if np.max(np.abs(participation)) == 0.0:
            continue
        swing = _swing(frequency, orbit.period)
        if not abs(swing) > _RESONANT:
            return None
        out += np.outer(participation, participation) * cos(frequency * (apart - 0.5 * orbit.period)) / swing
    return out if out.any() else None


def _swing(frequency: float, period: float) -> float:
    """What a mode's periodic response to an impulse is divided by: 0 in resonance with the period, and for a rigid-body mode."""
    return 2.0 * frequency * float(sin(0.5 * frequency * period))


def resonant_modes(mode: LinearMode, cover: int) -> list[LinearMode]:
    """The other modes in resonance with the k-fold cover of a mode: if they touch its stops, the first order decides nothing there."""
    period = 4.0 * cover * mode.alpha
    others = [other for other in linear_modes(mode.system) if other.index != mode.index]
    return [other for other in others if not abs(_swing(other.frequency, period)) > _RESONANT]


def begins(matrix: np.ndarray, impacts: np.ndarray) -> int:
    """Whether a family with these impacts begins upward (1) or downward (-1) in energy, to first order, or not at all (0).

    Parameters
    ----------
    matrix : (M, M) float
        C.
    impacts : (M,) bool
    """
    try:
        impulses = solve(matrix[np.ix_(impacts, impacts)], np.ones(int(np.sum(impacts))))
    except np.linalg.LinAlgError:
        return 0
    gaps = 1.0 - product(matrix[np.ix_(~impacts, impacts)], impulses)
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
    >>> mode = saltus.linear_modes(saltus.vibro_impact_nes(mu=0.1, sigma=0.1))[0]
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
        For a cover or impacts out of range, and for energies that are no range.
    """
    if not isinstance(mode, LinearMode):
        raise TypeError(f"the mode is {shown(mode)}, expected one of saltus.linear_modes(system)")
    for name, value, most in (("cover", cover, MOST_COVERS), ("impacts", impacts, math.inf)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= most:
            raise ValueError(f"{name} = {shown(value)}: expected an integer, 1 {f'to {most}' if name == 'cover' else 'or more'}")
    low, high = checked_energy_range(energy)
    if not low <= mode.energies[1] <= high:
        return []
    orbit = mode.touching(cover)
    matrix = response(mode, orbit)
    found = []
    for mask in orbit.choices():
        chosen = np.array([bool(mask >> i & 1) for i in range(len(orbit.times))])
        if not 0 < np.sum(chosen) <= 2 * impacts or (matrix is not None and not begins(matrix, chosen)):
            continue
        choice = candidate(orbit, mask)
        if choice.cover > 1 or (choice.ends == PERIODIC and not periodic):
            continue
        family = meet(orbit, choice, False)
        if family.beside is not None:
            found.append(family)
    return sorted(found, key=lambda item: (item.impacts, item.ends, item.sequence))
