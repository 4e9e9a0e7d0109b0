"""Makes the matrices of the scene beam_on_cubic_spring: ``python catalogues/beam_on_cubic_spring.py`` writes them beside itself.

A beam of length 1, mass 1 and bending stiffness 1 on hinges at both ends, by eleven Euler-Bernoulli elements with cubic shape functions.
The coordinates are the displacements of the ten inner nodes. The rotations follow them statically (R. J. Guyan, AIAA Journal 3 (1965)
380), so that no frequency is far above those of ten modes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

__all__ = ["beam_matrices"]

ELEMENTS = 11


def beam_matrices(elements: int = ELEMENTS) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness matrix (m - 1, m - 1) of a hinged beam of m elements."""
    h = 1.0 / elements
    mass = h / 420.0 * np.array(
        [
            [156.0, 22.0 * h, 54.0, -13.0 * h],
            [22.0 * h, 4.0 * h**2, 13.0 * h, -3.0 * h**2],
            [54.0, 13.0 * h, 156.0, -22.0 * h],
            [-13.0 * h, -3.0 * h**2, -22.0 * h, 4.0 * h**2],
        ]
    )  # fmt: skip
    stiffness = 1.0 / h**3 * np.array(
        [
            [12.0, 6.0 * h, -12.0, 6.0 * h],
            [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
            [-12.0, -6.0 * h, 12.0, -6.0 * h],
            [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2],
        ]
    )  # fmt: skip
    size = 2 * (elements + 1)
    whole = np.zeros((2, size, size))
    for k in range(elements):
        part = slice(2 * k, 2 * k + 4)
        whole[0, part, part] += mass
        whole[1, part, part] += stiffness
    moved, turned = np.arange(2, size - 2, 2), np.arange(1, size, 2)
    follow = np.zeros((size, elements - 1))
    follow[moved] = np.eye(elements - 1)
    follow[turned] = -np.linalg.solve(whole[1][np.ix_(turned, turned)], whole[1][np.ix_(turned, moved)])
    mass, stiffness = (follow.T @ matrix @ follow for matrix in whole)
    return 0.5 * (mass + mass.T), 0.5 * (stiffness + stiffness.T)


def _write(folder: Path) -> None:
    from scipy.io import mmwrite

    for name, matrix in zip(("mass", "stiffness"), beam_matrices(), strict=True):
        mmwrite(folder / f"beam_{name}.mtx", matrix, precision=17, symmetry="symmetric", comment="by beam_on_cubic_spring.py")


if __name__ == "__main__":
    _write(Path(__file__).parent)
