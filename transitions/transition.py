"""A motion with its stages: the data of its figure, the families in it, and its files (CSV, JSON, NPZ, MAT)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.data import Layout, read_figure_data, reporting, write_figure_data
from bvp.system import ImpactSystem
from bvp.texts import brief
from transitions.record import SampledMotion, require
from transitions.spectrum import Spectrum, Wavelet, morlet_spectrum
from transitions.stage import Leaving, Stage, StartFamily, stage_from_data, stages_as_data

if TYPE_CHECKING:
    from branches.branch import Branch
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
        times, motion = self.record.times, self.record.along(self.gap)
        return morlet_spectrum(times, *motion, wavelet=self.wavelet, frequencies=self.frequencies, most=SHOWN)


def atlas_behind(transition: Transition, catalogue: Catalogue | None = None, branches: Sequence[Branch] = ()) -> Atlas:
    """The families drawn behind a motion.

    With a catalogue these are the families that the stages follow, and those with at most two impacts in a period. Otherwise they are the
    given branches. The linear modes are always drawn.

    Raises
    ------
    ValueError
        If the system of the catalogue has other masses, springs or stops.
    """
    from branches.figures.atlas_data import atlas_of

    system, names = transition.system.underlying, dict[str, dict[str, float]]()
    if catalogue is not None:
        system = catalogue.system
        require_same(system, transition.system)
        follows = [stage.follows for stage in transition.stages if stage.follows is not None]
        ids = {item.family for item in follows} | (set() if transition.start is None else {transition.start.family})
        branches = [catalogue.branch(row.id) for row in catalogue.families() if row.impacts <= BACKBONE or row.id in ids]
        # Families that are followed are named first.
        names = {item.label: {} for item in follows if item.impacts and item.label}
    energy = transition.record.energy[transition.record.energy > 0.0]
    band = (0.5 * float(energy.min()), 2.0 * float(energy.max())) if len(energy) else None
    return atlas_of(system, branches, reference_points=names, energy=band)


def require_same(undamped: ImpactSystem, moving: ImpactSystem) -> None:
    """Raise a ValueError if the families belong to another system than the motion. Dampers and restitution may differ."""
    places = [[(stop.gap, stop.lower, stop.upper) for stop in system.stops] for system in (undamped, moving)]
    if not (np.array_equal(undamped.mass, moving.mass) and np.array_equal(undamped.stiffness, moving.stiffness) and places[0] == places[1]):
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
    TypeError
        For anything but a Transition.
    branches.figures.data.ExportError
        For another suffix.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    require(transition, Transition, "the motion", "saltus.Transition(system, record, gap, stages)")
    about: dict[str, Any] = {
        "schema": 1,
        "content": "transition",
        "system": transition.system.describe(),
        "impacts": transition.record.impacts.tolist(),
        "gap": list(transition.gap),
        "wavelet": asdict(transition.wavelet),
        "frequencies": transition.frequencies,
        "stages": stages_as_data(transition.stages),
        "start": None if transition.start is None else asdict(transition.start),
    }
    write_figure_data(_LAYOUT, about, {name: getattr(transition.record, name) for name in (*_SINGLE, *_WIDE)}, path)


def read_transition(path: str | os.PathLike[str]) -> Transition:
    """Read a motion with its stages from a file of `saltus.write_transition`.

    Parameters
    ----------
    path : path-like
        A name that ends in .csv, .json, .npz or .mat.

    Raises
    ------
    branches.figures.data.ExportError
        With one line: the file cannot be read, or something is missing in it.
    """
    about, columns = read_figure_data(_LAYOUT, path)
    with reporting(os.fspath(path)):
        start, band = about.get("start"), about["frequencies"]
        return Transition(
            ImpactSystem.from_description(about["system"]),
            SampledMotion(**{name: columns[name] for name in (*_SINGLE, *_WIDE)}, impacts=about["impacts"]),
            tuple(float(x) for x in about["gap"]),
            tuple(stage_from_data(item) for item in about["stages"]),
            Wavelet(**about["wavelet"]),
            band and (float(band[0]), float(band[1])),
            start and StartFamily(**{**start, "left": start["left"] and Leaving(*start["left"])}),
        )
