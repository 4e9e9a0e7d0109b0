"""What the picture of a motion shows: the record, how its spectrum is made, its stages, and the families that it is laid over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from transitions.record import Record
from transitions.spectrum import Spectrum, Wavelet
from transitions.stage import Stage
from transitions.stages import spectrum_of
from transitions.start_family import StartFamily

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.diagram.atlas_data import Atlas
    from bvp.system import ImpactSystem

__all__ = ["Transition", "atlas_behind", "require_same"]

BACKBONE = 1.0
"""Families with so many impacts in half a period at most are drawn behind every motion."""


SHOWN = 20_000
"""Times of a spectrum that is drawn, at most: the picture has fewer columns than that."""


@dataclass(frozen=True, eq=False)
class Transition:
    """A motion of a system, with its stages.

    Parameters
    ----------
    system : ImpactSystem
        That moves, with its dampers and restitution.
    record : Record
    gap : tuple of n floats
        The relative displacement: (1, -1) for u1 - u2.
    stages : sequence of Stage
    wavelet : Wavelet
    frequencies : (float, float) or None
        Range of the spectrum; None for the band of the signal.
    start : StartFamily or None
        The family that the motion starts on.
    """

    system: ImpactSystem
    record: Record
    gap: tuple[float, ...]
    stages: Sequence[Stage] = ()
    wavelet: Wavelet = Wavelet()
    frequencies: tuple[float, float] | None = None
    start: StartFamily | None = None

    @cached_property
    def spectrum(self) -> Spectrum:
        """The wavelet spectrum of the relative displacement, at as many times as a picture shows."""
        return spectrum_of(self.record, self.gap, wavelet=self.wavelet, frequencies=self.frequencies, most=SHOWN)

    def with_stages(self, stages: Sequence[Stage]) -> Transition:
        """The same with other stages; its spectrum, which does not depend on them, is not made again."""
        other = replace(self, stages=tuple(stages))
        if "spectrum" in vars(self):
            vars(other)["spectrum"] = self.spectrum
        return other


def atlas_behind(catalogue: Catalogue, transition: Transition) -> Atlas:
    """The families over which a motion is laid: those that its stages follow, and those with two impacts a period or fewer.

    Parameters
    ----------
    catalogue : Catalogue
    transition : Transition

    Raises
    ------
    ValueError
        Where the motion is of a system with other masses, springs or stops.
    """
    from branches.diagram.atlas_data import atlas_of

    require_same(catalogue.system, transition.system)
    followed = {stage.follows.family for stage in transition.stages if stage.follows is not None}
    followed |= set() if transition.start is None else {transition.start.family}
    rows = [row for row in catalogue.families() if row.impacts <= BACKBONE or row.id in followed]
    branches = [catalogue.branch(row.id) for row in rows]
    # A name without a cited point is for every family with the label: those that are followed are named first.
    pinned: dict[str, dict[str, float]] = {
        stage.follows.label: {} for stage in transition.stages if stage.follows is not None and stage.follows.impacts
    }
    pinned.pop("", None)
    energy = transition.record.energy[transition.record.energy > 0.0]
    low, high = (float(energy.min()), float(energy.max())) if len(energy) else (0.0, math.inf)
    return atlas_of(catalogue.system, branches, pinned=pinned, energy=(0.5 * low, 2.0 * high))


def require_same(undamped: ImpactSystem, moving: ImpactSystem) -> None:
    """Refuse families of another system than the one that moves, dampers and restitution apart.

    Raises
    ------
    ValueError
    """
    places = [[(stop.gap, stop.lower, stop.upper) for stop in system.stops] for system in (undamped, moving)]
    same = undamped.mass.shape == moving.mass.shape and np.array_equal(undamped.mass, moving.mass)
    if not (same and np.array_equal(undamped.stiffness, moving.stiffness) and places[0] == places[1]):
        raise ValueError("the families belong to a system with other masses, springs or stops than the one that moves")
