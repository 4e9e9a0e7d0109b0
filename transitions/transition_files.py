"""Files of a motion - CSV, JSON, NPZ, MAT - and back; its picture can be drawn again from them."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from branches.export.picture_data import Layout, read_data, told, write_data

if TYPE_CHECKING:
    from transitions.transition import Transition

__all__ = ["read_transition", "write_transition"]

_SINGLE = ("times", "energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo")
_WIDE = ("displacements", "velocities")
_LAYOUT = Layout("transition", _SINGLE, _WIDE)


def write_transition(transition: Transition, path: str | os.PathLike[str]) -> None:
    """Write a motion: csv, json, npz or mat, as the file's name ends.

    The rows are the times; what holds for all of them has the system, the times of the impacts, the gap coordinate, the wavelet and the
    stages.

    Raises
    ------
    branches.export.ExportError
        For another ending.
    branches.files.WriteFailure
        If the file cannot be written; an old file is then unchanged.
    """
    from transitions.stage import stages_as_data

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
    write_data(_LAYOUT, about, {name: getattr(record, name) for name in (*_SINGLE, *_WIDE)}, path)


def read_transition(path: str | os.PathLike[str]) -> Transition:
    """Read a motion.

    Raises
    ------
    branches.export.ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    about, columns = read_data(_LAYOUT, path)
    with told(os.fspath(path)):
        from bvp.system import ImpactSystem
        from transitions.record import Record
        from transitions.spectrum import Wavelet
        from transitions.stage import stage_from_data
        from transitions.start_family import start_from_data
        from transitions.transition import Transition

        band = about["frequencies"]
        return Transition(
            ImpactSystem.from_description(about["system"]),
            Record(**{name: columns[name] for name in (*_SINGLE, *_WIDE)}, impacts=about["impacts"]),
            tuple(float(x) for x in about["gap"]),
            tuple(stage_from_data(item) for item in about["stages"]),
            Wavelet(float(about["wavelet"]["bandwidth"]), float(about["wavelet"]["centre"])),
            None if band is None else (float(band[0]), float(band[1])),
            start_from_data(about.get("start")),
        )
