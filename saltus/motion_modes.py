"""The empirical modes of a damped motion: what its relative displacement is made of, as a table, as data and as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus.errors import BadInput
from saltus.units import Units

if TYPE_CHECKING:
    from branches.export.table_files import Table
    from saltus.motions import Told
    from transitions.empirical import Modes

__all__ = ["mode_lines", "mode_table", "modes_of_motion", "modes_record", "require_sifting"]


def require_sifting() -> None:
    """Say before the work that the package for it is missing.

    Raises
    ------
    BadInput
    """
    from transitions.empirical import NotInstalled, sifting

    try:
        sifting()
    except NotInstalled as error:
        raise BadInput(str(error)) from error


def modes_of_motion(told: Told) -> Modes | None:
    """The empirical modes of the relative displacement over the record that the stages are told from; None where there is no record."""
    from transitions.empirical import decompose

    if told.shown is None:
        return None
    record = told.shown.record
    return decompose(record.times, record.along(told.shown.gap)[0])


def modes_record(modes: Modes | None, units: Units) -> dict[str, Any] | None:
    """The modes as JSON has them: of each its mean frequency, weighted by its squared amplitude (None where it has none), and the root
    mean square of itself."""
    if modes is None:
        return None
    sizes = np.sqrt(np.mean(modes.functions**2, axis=1))
    rows = zip((modes.mean_frequencies * units.frequency).tolist(), (sizes * units.length).tolist(), strict=True)
    return {
        "orthogonality": modes.orthogonality,
        "modes": [{"frequency": frequency if size > 0.0 else None, "rms": size} for frequency, size in rows],
        "residue_rms": float(np.sqrt(np.mean(modes.residue**2))) * units.length,
    }


def mode_table(modes: Modes | None, units: Units) -> Table:
    """The modes over time, with amplitude and frequency by the Hilbert transform, (m, k) each; nothing where there are none."""
    if modes is None:
        return {}
    return {
        "emd_time": modes.times * units.time,
        "emd_modes": modes.functions.T * units.length,
        "emd_amplitudes": modes.amplitudes.T * units.length,
        "emd_frequencies": modes.frequencies.T * units.frequency,
        "emd_residue": modes.residue * units.length,
    }


def mode_lines(record: dict[str, Any]) -> Iterator[str]:
    """The lines that tell the modes, of `saltus.motion_data.motion_record`."""
    told = record["empirical"]
    if told is None:
        yield f"emd      not told: {record['stages_note']}"
        return
    yield f"emd      {len(told['modes'])} empirical modes of the relative displacement; index of orthogonality {told['orthogonality']:.3g}"
    yield f"{'mode':>6}  {'frequency':>14}  {'rms':>14}"
    for k, mode in enumerate(told["modes"], 1):
        frequency = "none" if mode["frequency"] is None else f"{mode['frequency']:.6g}"
        yield f"{k:>6}  {frequency:>14}  {mode['rms']:>14.6g}"
    yield f"{'rest':>6}  {'':>14}  {told['residue_rms']:>14.6g}"
