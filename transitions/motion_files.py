"""Files of a motion - CSV, JSON, NPZ, MAT - and back; its picture can be drawn again from them."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from branches.export.picture_data import Layout, read_data, told, write_data

if TYPE_CHECKING:
    from transitions.motion import Motion

__all__ = ["read_motion", "write_motion"]

_SINGLE = ("times", "energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo")
_WIDE = ("displacements", "velocities")
_LAYOUT = Layout("motion", _SINGLE, _WIDE)


def write_motion(motion: Motion, path: str | os.PathLike[str]) -> None:
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
    from transitions.stages import stages_as_data

    record = motion.record
    about: dict[str, Any] = {
        "schema": 1,
        "content": "motion",
        "system": motion.system.describe(),
        "impacts": record.impacts.tolist(),
        "gap": list(motion.gap),
        "wavelet": {"bandwidth": motion.wavelet.bandwidth, "centre": motion.wavelet.centre},
        "frequencies": None if motion.frequencies is None else list(motion.frequencies),
        "stages": stages_as_data(motion.stages),
    }
    write_data(_LAYOUT, about, {name: getattr(record, name) for name in (*_SINGLE, *_WIDE)}, path)


def read_motion(path: str | os.PathLike[str]) -> Motion:
    """Read a motion.

    Raises
    ------
    branches.export.ExportError
        In one line: the file cannot be read, or what it lacks.
    """
    about, columns = read_data(_LAYOUT, path)
    with told(os.fspath(path)):
        from bvp.system import ImpactSystem
        from transitions.motion import Motion, stage_from_data
        from transitions.record import Record
        from transitions.spectrum import Wavelet

        band = about["frequencies"]
        return Motion(
            ImpactSystem.from_description(about["system"]),
            Record(**{name: columns[name] for name in (*_SINGLE, *_WIDE)}, impacts=about["impacts"]),
            tuple(float(x) for x in about["gap"]),
            tuple(stage_from_data(item) for item in about["stages"]),
            Wavelet(float(about["wavelet"]["bandwidth"]), float(about["wavelet"]["centre"])),
            None if band is None else (float(band[0]), float(band[1])),
        )
