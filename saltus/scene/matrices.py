"""Matrices of a scene that are in files beside it: Matrix Market, NPZ of numpy, MAT of Matlab (to version 7)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from saltus.errors import BadInput, nearest, one_line

__all__ = ["with_matrices"]

_NAMES = {"mass": ("mass", "M"), "damping": ("damping", "C"), "stiffness": ("stiffness", "K")}
"""Names that a matrix can have in a file of several."""


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
    if path.suffix not in (".mtx", ".npz", ".mat"):
        raise BadInput(f"{where}, expected rows of numbers, or a file .mtx (Matrix Market), .npz or .mat")
    if not path.exists():
        beside = [entry.name for entry in sorted(path.parent.glob("*.m*")) + sorted(path.parent.glob("*.npz"))]
        raise BadInput(f"{where} does not exist{nearest(path.name, beside)}")
    try:
        found = _content(path)
    except Exception as error:  # the readers raise many kinds for a damaged file
        raise BadInput(f"cannot read {where}: {one_line(error)}") from error
    names = [name for name in _NAMES[key] if name in found] if path.suffix != ".mtx" else [""]
    if not names:
        raise BadInput(f"{where} has no matrix {' or '.join(_NAMES[key])}; it has {', '.join(found) or 'none'}")
    matrix = found[names[0]]
    dense = matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)
    if dense.ndim != 2 or dense.dtype.kind not in "iuf":
        raise BadInput(f"{where} is no matrix of real numbers; received shape {dense.shape} of {dense.dtype}")
    return [[float(entry) for entry in row] for row in dense]


def _content(path: Path) -> dict[str, Any]:
    """The matrices of a file by name; that of a Matrix Market file has none."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    from scipy import io

    if path.suffix == ".mtx":
        return {"": io.mmread(path)}
    return {name: value for name, value in io.loadmat(path).items() if not name.startswith("__")}
