"""A motion with its stages: the data of its figure, the families in it, and its files (CSV, JSON, NPZ, MAT)."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.export.figure_data import Layout, read_figure_data, reporting, write_figure_data
from bvp.system import ImpactSystem
from bvp.texts import brief
from transitions.record import SampledMotion
from transitions.spectrum import Spectrum, Wavelet
from transitions.stage import Stage, StartFamily, stage_from_data, stages_as_data, start_from_data
from transitions.stages import spectrum_of

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.figures.atlas_data import Atlas

__all__ = ["Transition", "atlas_behind", "read_transition", "require_same", "write_transition"]

BACKBONE = 1.0
"""Largest number of impacts in half a period of the families that are drawn behind every motion."""

SHOWN = 20_000
"""Largest number of times in a spectrum that is drawn. The figure has fewer columns."""

_SINGLE = ("times", "energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo")
_WIDE = ("displacements", "velocities")
_LAYOUT = Layout("transition", dict.fromkeys(_SINGLE, float), _WIDE)


@brief
@dataclass(frozen=True, eq=False)
class Transition:
    """A motion of a system, with its stages.

    Parameters
    ----------
    system : ImpactSystem
        With its dampers and restitution.
    record : SampledMotion
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
    record: SampledMotion
    gap: tuple[float, ...]
    stages: Sequence[Stage] = ()
    wavelet: Wavelet = Wavelet()
    frequencies: tuple[float, float] | None = None
    start: StartFamily | None = None

    @cached_property
    def spectrum(self) -> Spectrum:
        """The wavelet spectrum of the relative displacement, at the times of a figure."""
        return spectrum_of(self.record, self.gap, wavelet=self.wavelet, frequencies=self.frequencies, most=SHOWN)

    def with_stages(self, stages: Sequence[Stage]) -> Transition:
        """The same with other stages. The spectrum does not depend on them and is kept."""
        other = replace(self, stages=tuple(stages))
        if "spectrum" in vars(self):
            vars(other)["spectrum"] = self.spectrum
        return other


def atlas_behind(catalogue: Catalogue, transition: Transition) -> Atlas:
    """The families drawn behind a motion: those that its stages follow, and those with at most two impacts in a period.

    Parameters
    ----------
    catalogue : Catalogue
    transition : Transition

    Raises
    ------
    ValueError
        If the systems differ in their masses, springs or stops.
    """
    from branches.figures.atlas_data import atlas_of

    require_same(catalogue.system, transition.system)
    followed = {stage.follows.family for stage in transition.stages if stage.follows is not None}
    followed |= set() if transition.start is None else {transition.start.family}
    rows = [row for row in catalogue.families() if row.impacts <= BACKBONE or row.id in followed]
    branches = [catalogue.branch(row.id) for row in rows]
    # Families that are followed are named first.
    reference_points: dict[str, dict[str, float]] = {
        stage.follows.label: {} for stage in transition.stages if stage.follows is not None and stage.follows.impacts
    }
    reference_points.pop("", None)
    energy = transition.record.energy[transition.record.energy > 0.0]
    low, high = (float(energy.min()), float(energy.max())) if len(energy) else (0.0, math.inf)
    return atlas_of(catalogue.system, branches, reference_points=reference_points, energy=(0.5 * low, 2.0 * high))


def require_same(undamped: ImpactSystem, moving: ImpactSystem) -> None:
    """Raise an error if the families belong to another system than the motion. Dampers and restitution may differ.

    Raises
    ------
    ValueError
    """
    places = [[(stop.gap, stop.lower, stop.upper) for stop in system.stops] for system in (undamped, moving)]
    same = undamped.mass.shape == moving.mass.shape and np.array_equal(undamped.mass, moving.mass)
    if not (same and np.array_equal(undamped.stiffness, moving.stiffness) and places[0] == places[1]):
        raise ValueError("the families belong to a system with other masses, springs or stops than the one that moves")


def write_transition(transition: Transition, path: str | os.PathLike[str]) -> None:
    """Write a motion as csv, json, npz or mat, by the suffix of the file.

    Each row is a time. The head has the system, the times of the impacts, the gap coordinate, the wavelet and the stages.

    Parameters
    ----------
    transition : Transition
    path : path-like
        A name that ends in .csv, .json, .npz or .mat.

    Raises
    ------
    branches.export.figure_data.ExportError
        For another suffix.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    record = transition.record
    about: dict[str, Any] = {
        "schema": 1,
        "content": "transition",
        "system": transition.system.describe(),
        "impacts": record.impacts.tolist(),
        "gap": list(transition.gap),
        "wavelet": {"bandwidth": transition.wavelet.bandwidth, "centre": transition.wavelet.centre},
        "frequencies": None if transition.frequencies is None else list(transition.frequencies),
        "stages": stages_as_data(transition.stages),
        "start": None if transition.start is None else asdict(transition.start),
    }
    write_figure_data(_LAYOUT, about, {name: getattr(record, name) for name in (*_SINGLE, *_WIDE)}, path)


def read_transition(path: str | os.PathLike[str]) -> Transition:
    """Read a motion.

    Parameters
    ----------
    path : path-like
        A name that ends in .csv, .json, .npz or .mat.

    Raises
    ------
    branches.export.figure_data.ExportError
        With one line: the file cannot be read, or something is missing in it.
    """
    about, columns = read_figure_data(_LAYOUT, path)
    with reporting(os.fspath(path)):
        band = about["frequencies"]
        return Transition(
            ImpactSystem.from_description(about["system"]),
            SampledMotion(**{name: columns[name] for name in (*_SINGLE, *_WIDE)}, impacts=about["impacts"]),
            tuple(float(x) for x in about["gap"]),
            tuple(stage_from_data(item) for item in about["stages"]),
            Wavelet(float(about["wavelet"]["bandwidth"]), float(about["wavelet"]["centre"])),
            None if band is None else (float(band[0]), float(band[1])),
            start_from_data(about.get("start")),
        )
