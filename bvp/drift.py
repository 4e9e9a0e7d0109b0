"""Free translations: motions of a whole system that stretch no spring and move towards no stop.

They leave an orbit's place undetermined: where u(t) is an orbit between two impacts or rests, so is u(t) + a d for every a, and the
equations of a family, which has one parameter, lack a rank. An origin end holds the place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["free_translation", "translation_text"]

_NONE = 1e-9
"""Part of its size below which an entry of a direction is rounding."""


def free_translation(system: ImpactSystem) -> np.ndarray | None:
    """A direction (n,) of displacement that no spring and no stop resists, its largest entry 1; None where there is none.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> free = ImpactSystem([[1, 0], [0, 2]], [[0, 0], [0, 0]], [[3, -3], [-3, 3]], [Stop((1, -1), -1, 1)])
    >>> free_translation(free)
    array([1., 1.])
    """
    modes = system.modes
    rigid = modes.shapes[:, modes.squares == 0.0]
    if not rigid.shape[1]:
        return None
    rigid = rigid / np.linalg.norm(rigid, axis=0)
    rows = np.array([np.asarray(stop.gap) / np.linalg.norm(stop.gap) for stop in system.stops])
    _, singular, directions = np.linalg.svd(rows @ rigid)
    felt = int(np.sum(singular > _NONE))
    if felt == rigid.shape[1]:
        return None
    found = rigid @ directions[-1]
    found = found / found[np.argmax(np.abs(found))]
    return np.where(np.abs(found) < _NONE, 0.0, found)


def translation_text(direction: np.ndarray, coordinates: tuple[str, ...]) -> str:
    """The direction in words.

    Examples
    --------
    >>> translation_text(np.array([1.0, 1.0, 0.0]), ("x", "y", "z")), translation_text(np.array([1.0, -0.5]), ("x", "y"))
    ('x and y by the same amount', 'x : y = 1 : -0.5')
    """
    moved = [(name, entry) for name, entry in zip(coordinates, direction.tolist(), strict=True) if entry]
    names = [name for name, _ in moved]
    if len(moved) == 1:
        return f"{names[0]} alone"
    if max(abs(entry - moved[0][1]) for _, entry in moved) < _NONE:
        return f"{', '.join(names[:-1])} and {names[-1]} by the same amount"
    return f"{' : '.join(names)} = {' : '.join(f'{entry:.4g}' for _, entry in moved)}"
