"""Linear modes: free motion without impacts, up to the energy at which it touches a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from branches.grazing.touching import Touching
from bvp.checks import require_system
from bvp.texts import brief, span

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["LinearMode", "linear_modes", "mode_of"]

_MARGIN = 1e-9
_ALONE = 1e-6


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

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [("frequency", f"{self.frequency:.10g}, alpha = {self.alpha:.10g}"), ("energies", span("h", self.energies))]
        return f"LinearMode {self.name}", rows

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

    def touching(self, cover: int = 1) -> Touching:
        """The mode at its grazing energy, as its k-fold cover, from an instant at which it passes the origin.

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
        return Touching(self.system, 4.0 * self.alpha, times, contacts, states, states, grazing, 0).repeated(cover)


def linear_modes(system: ImpactSystem) -> list[LinearMode]:
    """The modes that move, come to rest and reach a stop: all but rigid-body modes and those that leave every gap unchanged.

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
    require_system(system)
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
