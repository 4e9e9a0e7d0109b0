"""Blocks of results on disk: NPZ or Parquet, each with the study that it belongs to, its number, and a CRC of all its numbers."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from branches.files import one_line, reason, replacing

__all__ = ["DamagedBlock", "ForeignBlock", "block_path", "read_block", "write_block"]

_ABOUT = "about"


class DamagedBlock(ValueError):
    """A block that is not what was written; the message names it and says why."""


class ForeignBlock(ValueError):
    """A whole block of another study."""


def block_path(folder: Path, number: int, kind: str) -> Path:
    """The file of a block.

    Examples
    --------
    >>> block_path(Path("shock.study"), 7, "npz").as_posix()
    'shock.study/block-000007.npz'
    """
    return folder / f"block-{number:06d}.{kind}"


def write_block(path: Path, columns: Mapping[str, np.ndarray], digest: str, number: int) -> None:
    """Write a block, whole or not at all.

    Parameters
    ----------
    path : Path
        Its suffix tells the format.
    columns : mapping of str to (b,) ndarray
    digest : str
        Of the study's plan.
    number : int

    Raises
    ------
    branches.files.WriteFailure
    """
    about = json.dumps({"study": digest, "block": number, "crc": _crc(columns)})
    with replacing(path) as beside:
        if path.suffix == ".parquet":
            import pyarrow
            import pyarrow.parquet

            table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
            pyarrow.parquet.write_table(table.replace_schema_metadata({_ABOUT: about}), beside, use_dictionary=False)
            return
        with open(beside, "wb") as file:
            arrays: dict[str, Any] = {_ABOUT: np.frombuffer(about.encode(), dtype=np.uint8), **columns}
            np.savez(file, **arrays)


def read_block(path: Path, digest: str, number: int, count: int) -> dict[str, np.ndarray]:
    """The columns of a block.

    Parameters
    ----------
    path, digest, number
        As for `write_block`.
    count : int
        Runs that it has.

    Raises
    ------
    DamagedBlock
        Where it cannot be read, its CRC is another one, or it is another block.
    ForeignBlock
        Where it is whole, and of another study.
    """
    try:
        about, columns = _read_parquet(path) if path.suffix == ".parquet" else _read_npz(path)
        told = json.loads(about)
        if told["crc"] != _crc(columns):
            raise ValueError("its CRC is not that of its numbers")
        if told["study"] != digest:
            raise ForeignBlock(f"{path.name} belongs to another study; expected an empty folder, or one of this study")
        if told["block"] != number:
            raise ValueError(f"it is block {told['block']}")
        if any(len(values) != count for values in columns.values()):
            raise ValueError(f"it has not {count} runs")
    except ForeignBlock:
        raise
    except OSError as error:
        raise DamagedBlock(f"{path.name} cannot be read: {reason(error)}") from error
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise DamagedBlock(f"{path.name} is damaged: {one_line(error)}") from error
    return columns


def _read_npz(path: Path) -> tuple[bytes, dict[str, np.ndarray]]:
    with np.load(path, allow_pickle=False) as arrays:
        columns = {name: arrays[name] for name in arrays.files}
    return columns.pop(_ABOUT).tobytes(), columns


def _read_parquet(path: Path) -> tuple[bytes, dict[str, np.ndarray]]:
    import pyarrow.parquet

    table: Any = pyarrow.parquet.read_table(path)
    return (table.schema.metadata or {})[_ABOUT.encode()], {name: table[name].to_numpy() for name in table.column_names}


def _crc(columns: Mapping[str, np.ndarray]) -> int:
    """CRC-32 of the names, kinds and bytes of all columns."""
    crc = 0
    for name, values in columns.items():
        plain = np.ascontiguousarray(values)
        crc = zlib.crc32(f"{name}:{plain.dtype.str}:{plain.shape};".encode(), crc)
        crc = zlib.crc32(plain.data, crc)
    return crc
