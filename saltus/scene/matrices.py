"""Matrices of a scene that are in files beside it: Matrix Market, NPZ of numpy, MAT of Matlab (versions 5 to 7).

A file says first how large its matrices are. That is checked before a matrix is read, so that a damaged file cannot take all memory.
"""

from __future__ import annotations

import errno
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np

from branches.files import is_special, reason
from bvp.texts import shown
from saltus.errors import BadInput, nearest

__all__ = ["MOST", "with_matrices"]

_NAMES = {"mass": ("mass", "M"), "damping": ("damping", "C"), "stiffness": ("stiffness", "K")}
"""Names that a matrix can have in a file of several."""

MOST = 2000
"""Most rows of a matrix."""

_BYTES = 24 * MOST * MOST + 65536
"""Most bytes of a matrix in a file: two numbers and two indices an entry."""

_HEAD = 4096
"""Bytes at the begin of an element of a MAT file that contain its flags, its shape and its name."""

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of the numbers of a MAT file."""

_COMPRESSED = 15
"""The type of a compressed element."""

_SPARSE = 5
"""The class of a sparse matrix; those of full ones of numbers are the next."""

_FORMS = ("array", "coordinate")

_SYMMETRIES = {"general": 0.0, "symmetric": 1.0, "hermitian": 1.0, "skew-symmetric": -1.0}
"""What the entries above the diagonal of a Matrix Market file are multiples of those below it. 0: they are in the file."""


class _Unfit(Exception):
    """What a file has in place of a matrix that can be used, as the rest of a message."""


def with_matrices(description: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """The table ``[system]`` with rows of numbers in place of the names of files.

    Parameters
    ----------
    description : mapping
    folder : Path
        At which relative names start.
    where : str
        The table, as messages name it.

    Raises
    ------
    BadInput
        For a file that does not exist or cannot be read, or has no such matrix. The message names the nearest.
    """
    files = {key: description[key] for key in _NAMES if isinstance(description.get(key), str)}
    return {**description, **{key: _matrix(key, folder / name, where) for key, name in files.items()}}


def _matrix(key: str, path: Path, where: str) -> list[list[float]]:
    where = f"{where}: {key} = {str(path.name)!r}"
    if path.suffix not in _KINDS:
        raise BadInput(f"{where}, expected rows of numbers, or a file .mtx (Matrix Market), .npz or .mat")
    kind, read = _KINDS[path.suffix]
    try:
        if not path.exists():
            beside = [entry.name for entry in sorted(path.parent.glob("*.m*")) + sorted(path.parent.glob("*.npz"))]
            raise BadInput(f"{where} does not exist{nearest(path.name, beside)}")
        if path.is_dir() or is_special(path):
            raise BadInput(f"{where} is no file")
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            matrix = read(file, _NAMES[key])
    except BadInput:
        raise
    except _Unfit as unfit:
        raise BadInput(f"{where} {unfit}") from unfit
    except Exception as error:  # the readers raise many kinds for a damaged file
        cause = f"it is damaged, or no {kind} file"
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):  # EINVAL: a place before the begin of the file
            cause = reason(error)
        raise BadInput(f"cannot read {where}: {cause}") from error
    dense = matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)
    if dense.dtype.kind not in "iuf":
        raise BadInput(f"{where} is no matrix of real numbers{'; its numbers are complex' if dense.dtype.kind == 'c' else ''}")
    if not np.isfinite(dense).all():
        row, column = np.argwhere(~np.isfinite(dense))[0]
        raise BadInput(f"{where} has {dense[row, column]:g} in row {row + 1}, column {column + 1}; expected finite numbers")
    return [[float(entry) for entry in row] for row in dense]


def _check_shape(shape: tuple[int, ...]) -> None:
    """Refuse what is no square matrix, or is too large."""
    size = " x ".join(shown(int(length)) for length in shape) or "one number"
    if len(shape) != 2:
        raise _Unfit(f"is no matrix of real numbers; received {size if len(shape) != 1 else f'a list of {size}'}")
    if shape[0] != shape[1] or shape[0] < 1:
        raise _Unfit(f"is {size}; expected a square matrix")
    if shape[0] > MOST:
        raise _Unfit(f"is {size}; expected at most {MOST} rows: reduce the model")


def _wanted(names: tuple[str, ...], found: list[str]) -> str:
    """The first of the names that a file has."""
    for name in names:
        if name in found:
            return name
    there = ", ".join(name if name.isprintable() else shown(name) for name in found)
    raise _Unfit(f"has no matrix {' or '.join(names)}; it has {there or 'none'}")


def _matrix_market(file: IO[bytes], names: tuple[str, ...]) -> np.ndarray:
    """Read a matrix of real numbers. The reader of scipy ends the process at some damaged files.

    The format: Boisvert, Pozo, Remington, "The Matrix Market exchange formats", NISTIR 5935 (1996).
    """
    kinds = file.readline(1024).decode("ascii").lower().split()
    if len(kinds) != 5 or kinds[:2] != ["%%matrixmarket", "matrix"] or kinds[2] not in _FORMS or kinds[4] not in _SYMMETRIES:
        raise ValueError("no header")
    if kinds[3] not in ("real", "double", "integer", "unsigned-integer"):
        raise _Unfit(f"is no matrix of real numbers; its numbers are {shown(kinds[3])}")
    line = file.readline(1024)
    while line.startswith(b"%") or line.isspace():
        line = file.readline(1024)
    sparse = kinds[2] == "coordinate"
    rows, columns, *entries = map(int, line.decode("ascii").split())
    _check_shape((rows, columns))
    places = np.tri(rows, k=-1 if kinds[4] == "skew-symmetric" else 0) if kinds[4] != "general" else np.ones((rows, rows))
    wanted = entries[0] if sparse and len(entries) == 1 else int(places.sum())
    if len(entries) != sparse or wanted > rows * rows:
        raise ValueError("no size")
    words = file.read(_BYTES).decode("ascii").split()
    if len(words) != (3 if sparse else 1) * wanted:
        raise _Unfit(f"ends within its entries, or goes on behind them; expected {wanted} entries")
    matrix = np.zeros((rows, rows))
    if sparse:
        i, j = (np.array(words[k::3], dtype=np.int64) - 1 for k in (0, 1))
        if wanted and not 0 <= min(i.min(), j.min()) <= max(i.max(), j.max()) < rows:
            raise _Unfit(f"has an entry outside of its {rows} rows and columns")
        np.add.at(matrix, (i, j), np.array(words[2::3], dtype=float))
    else:  # by column
        matrix.T[places.T > 0.0] = np.array(words, dtype=float)
    return matrix + _SYMMETRIES[kinds[4]] * (matrix - np.diag(np.diag(matrix))).T


def _npz(file: IO[bytes], names: tuple[str, ...]) -> Any:
    from numpy.lib import format as npy

    with np.load(file, allow_pickle=False) as archive:
        name = _wanted(names, list(archive.files))
        with archive.zip.open(name if name in archive.zip.namelist() else f"{name}.npy") as entry:
            read = npy.read_array_header_1_0 if npy.read_magic(entry) == (1, 0) else npy.read_array_header_2_0
            shape, _, numbers = read(entry)
        _check_shape(shape)
        if numbers.kind not in "iufc":
            raise _Unfit("is no matrix of real numbers")
        return archive[name]


def _matlab(file: IO[bytes], names: tuple[str, ...]) -> Any:
    """Read a matrix of real numbers. The reader of scipy ends the process at some damaged files.

    The format: "MAT-File Format", The MathWorks, chapter 1.
    """
    head = file.read(128)
    if 0 in head[:4]:
        raise _Unfit("is MAT 4; expected version 5 to 7: save it with -v7")
    order: Literal["<", ">"] = "<" if head[126:128] == b"IM" else ">"
    if struct.unpack(order + "H", head[124:126])[0] == 0x0200:
        raise _Unfit("is MAT 7.3 (HDF5); expected version 7 or lower: save it with -v7")
    found: dict[str, Callable[[int], bytes]] = {}
    while tag := file.read(8):
        kind, length = struct.unpack(order + "II", tag)
        begin = file.tell()

        def content(most: int, kind: int = kind, length: int = length, begin: int = begin) -> bytes:
            file.seek(begin)
            packed = file.read(min(length, most))
            return zlib.decompressobj().decompress(packed, most)[8:] if kind == _COMPRESSED else packed

        *_, name = islice(_parts(content(_HEAD), order), 3)
        text = name.tobytes().decode("latin1")
        found.setdefault(text, content)
        file.seek(begin + length)
    return _matlab_matrix(found[_wanted(names, list(found))], order)


def _parts(content: bytes, order: Literal["<", ">"]) -> Iterator[np.ndarray]:
    """The arrays of which an element of a MAT file consists, one after another."""
    at = 0
    while at + 8 <= len(content):
        kind, length = struct.unpack_from(order + "II", content, at)
        at += 8
        if kind >> 16:  # in the place of its length
            kind, length, at = kind & 0xFFFF, kind >> 16, at - 4
        yield np.frombuffer(content[at : at + length], np.dtype(_TYPES[kind]).newbyteorder(order))
        at += max(length, 4) if length <= 4 else -(-length // 8) * 8


def _matlab_matrix(content: Callable[[int], bytes], order: Literal["<", ">"]) -> np.ndarray:
    flags, shape, _ = islice(_parts(content(_HEAD), order), 3)
    kind = int(flags[0]) & 0xFF
    if not _SPARSE <= kind <= 15 or int(flags[0]) & 0x800:
        raise _Unfit(f"is no matrix of real numbers{'; its numbers are complex' if kind >= _SPARSE else ''}")
    _check_shape(tuple(shape.tolist()))
    _, _, _, *parts = _parts(content(_BYTES), order)
    if kind != _SPARSE:
        return parts[0].reshape(shape, order="F")
    rows, begins, numbers = parts
    matrix, columns = np.zeros(shape), np.repeat(np.arange(shape[1]), np.diff(begins))
    if len(columns) > len(numbers) or rows[: len(columns)].min(initial=0) < 0:
        raise ValueError("no sparse matrix")
    np.add.at(matrix, (rows[: len(columns)], columns), numbers[: len(columns)])
    return matrix


_KINDS: dict[str, tuple[str, Callable[[IO[bytes], tuple[str, ...]], Any]]] = {
    ".mtx": ("Matrix Market", _matrix_market), ".npz": ("NPZ", _npz), ".mat": ("MAT", _matlab),
}  # fmt: skip
"""Name and reader of each kind of file."""
