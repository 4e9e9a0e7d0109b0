"""Linear modes as ends of families: each exists up to the energy at which it touches a stop, where very many families begin at once.

At its grazing energy a mode touches the stops at M instants, half a period apart, over so many turns. Let an impulse of size P_i >= 0
act at instant i, away from the stop, and let the mode's own displacement at the stop grow by e. The impulses act where the mode is at rest,
so to first order they change its phase but not its amplitude, and the other modes answer by x = -C P at the stops, where

    C_ij = s_i s_j sum_l b_il b_jl g_l(t_i - t_j),     g_l(t) = cos(w_l (t - T/2)) / (2 w_l sin(w_l T/2)),   0 <= t <= T

is their periodic response (s_i = +-1 the side of the stop, b_il the participation of mode l there, T all turns together). At each instant
there is either an impact, with x_i + e = 0 and P_i > 0, or none, with x_i + e < 0 and P_i = 0: a linear complementarity problem. Its
solutions with e > 0 begin upward in energy, those with e < 0 downward, and impact speeds grow in proportion to |e|. Where C restricted to
the impacts is regular, the implicit function theorem gives exactly one family for each solution, and no others begin there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.grazing.candidates import candidate
from branches.grazing.following import Neighbour, meet
from branches.grazing.touching import EVERY, Touching

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["LinearMode", "beginnings", "families_at", "linear_modes", "mode_of", "response"]

_RESONANT = 1e-9
_MARGIN = 1e-9
_ALONE = 1e-6


@dataclass(frozen=True)
class LinearMode:
    """A mode of free motion, which exists up to the energy at which it touches a stop.

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
        """w."""
        return float(self.system.modes.frequencies[self.index])

    @property
    def alpha(self) -> float:
        """A quarter of its period."""
        return 0.5 * math.pi / self.frequency

    @cached_property
    def label(self) -> str:
        """L11+ where absorber and primary move the same way, L11- where they do not; "" for other systems than two such masses."""
        system = self.system
        if system.degrees_of_freedom != 2 or system.absorber is None or system.primary is None:
            return ""
        shape = system.modes.shapes[:, self.index]
        return "L11+" if shape[system.absorber] * shape[system.primary] > 0.0 else "L11-"

    @property
    def name(self) -> str:
        """Its label; L1, L2, ... by rising frequency for other systems."""
        return self.label or f"L{self.index + 1}"

    @cached_property
    def amplitude(self) -> float:
        """Largest modal amplitude without an impact."""
        modes = self.system.modes
        gap = np.abs(modes.contact_gap[:, self.index])
        with np.errstate(divide="ignore"):
            return float(np.min(np.abs(modes.contact_bound) / gap))

    @property
    def energies(self) -> tuple[float, float]:
        """The range of energies in which it exists: from 0 to (w times its largest amplitude)^2/2."""
        return 0.0, 0.5 * (self.frequency * self.amplitude) ** 2

    @cached_property
    def stops(self) -> tuple[str, ...]:
        """Letters of the contacts that it touches at its largest energy."""
        modes = self.system.modes
        touched = np.abs(modes.contact_bound) <= np.abs(modes.contact_gap[:, self.index]) * self.amplitude * (1.0 + 1e-12)
        return tuple(letter for letter, touches in zip(modes.contact_letters, touched, strict=True) if touches)

    def touching(self, turns: int = 1) -> Touching:
        """The mode at its grazing energy over some turns, from an instant at which it passes the origin.

        Raises
        ------
        ValueError
            Where it touches two stops at one instant.
        """
        modes = self.system.modes
        n = self.system.degrees_of_freedom
        rows: list[tuple[float, int, float]] = []
        for letter in self.stops:
            contact = modes.contact_letters.index(letter)
            side = math.copysign(1.0, modes.contact_bound[contact] * modes.contact_gap[contact, self.index])
            rows.append((self.alpha * (1.0 if side > 0.0 else 3.0), contact, side * self.amplitude))
        rows.sort()
        if len({time for time, _, _ in rows}) < len(rows):
            raise ValueError(f"the mode of frequency {self.frequency:.10g} touches the stops {', '.join(self.stops)} at one instant")
        states = np.zeros((len(rows), 2 * n))
        states[:, self.index] = [displacement for _, _, displacement in rows]
        times, contacts = np.array([row[0] for row in rows]), np.array([row[1] for row in rows], dtype=np.int64)
        grazing = np.ones(len(rows), dtype=bool)
        return Touching(self.system, 4.0 * self.alpha, times, contacts, states, states, grazing, 0).repeated(turns)


def linear_modes(system: ImpactSystem) -> list[LinearMode]:
    """The modes that move, come to rest and reach a stop: all but rigid-body modes and those that leave every gap unchanged.

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
    reason = system.why_not_conservative()
    if reason is not None:
        raise ValueError(f"families of periodic orbits need a conservative system: {reason}")
    modes = system.modes
    size = np.linalg.norm(modes.contact_gap, axis=1).max()
    return [
        LinearMode(system, k)
        for k, frequency in enumerate(modes.frequencies)
        if frequency > 0.0 and np.max(np.abs(modes.contact_gap[:, k])) > _MARGIN * size
    ]


def mode_of(orbit: Touching) -> LinearMode | None:
    """The one mode that a grazing orbit without hard impacts is the motion of; None where several modes move."""
    modes = orbit.system.modes
    n = len(modes.frequencies)
    energies = 0.5 * (modes.squares * orbit.after[0, :n] ** 2 + orbit.after[0, n:] ** 2)
    k = int(np.argmax(energies))
    return LinearMode(orbit.system, k) if np.sum(energies) - energies[k] < _ALONE**2 * energies[k] else None


def response(mode: LinearMode, orbit: Touching) -> np.ndarray | None:
    """C (M, M): minus the displacement towards the stop, at each instant, by unit impulses away from it at each instant.

    Returns
    -------
    ndarray or None
        None where another mode is in resonance with all turns together, or is a rigid-body mode: it has no periodic response.
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


def families_at(mode: LinearMode, turns: int, impacts: int, *, periodic: bool = True, **options: Any) -> list[Neighbour]:
    """The families that begin where a linear mode touches the stops, with the period of so many of its turns.

    Parameters
    ----------
    mode : LinearMode
    turns : int
        Exactly: shorter ones are those of fewer turns. Up to 11, of which all choices can be looked at.
    impacts : int
        Most impacts in half a period.
    periodic : bool
        Whether families without a reversal are given too; not beyond twelve touches in all turns.
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
    >>> mode = linear_modes(saltus.vibro_impact_nes(mu=0.1, sigma=0.1))[0]
    >>> [(family.label, family.kind) for family in families_at(mode, 2, 5, points=30) if family.ends == ("origin", "origin")]
    [('U2210+', 'fold')]
    """
    energy = options.get("energy", (0.0, math.inf))
    return [item.followed(**options) for item in beginnings(mode, turns, impacts, periodic=periodic, energy=energy)]


def beginnings(
    mode: LinearMode, turns: int, impacts: int, *, periodic: bool = True, energy: tuple[float, float] = (0.0, math.inf)
) -> list[Neighbour]:
    """The same as `families_at`, each with its first orbit `beside` the mode, and not followed.

    Parameters
    ----------
    mode, turns, impacts, periodic
        As for `families_at`.
    energy : (float, float)
        Where the mode grazes outside there are none.

    Raises
    ------
    ValueError
        For turns or impacts out of range.
    """
    if turns < 1 or impacts < 1:
        raise ValueError(f"turns is {turns} and impacts {impacts}, expected 1 or more of each")
    if turns >= EVERY:
        raise ValueError(f"turns is {turns}: families are enumerated up to {EVERY - 1} turns of a linear mode")
    low, high = energy
    if not low <= mode.energies[1] <= high:
        return []
    orbit = mode.touching(turns)
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
        if choice.turns > 1 or (choice.ends == ("periodic", "periodic") and not periodic):
            continue
        family = meet(orbit, choice, False)
        if family.beside is not None:
            found.append(family)
    return sorted(found, key=lambda item: (item.impacts, item.ends, item.word))
