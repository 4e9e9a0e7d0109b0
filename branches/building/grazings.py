"""Which grazing orbits were unfolded already: each is, once for all the families that meet there."""

from __future__ import annotations

__all__ = ["KnownGrazings"]

Mark = tuple[float, float, float]

SAME = 1e-7
"""Relative difference of energies, quarter periods and patterns below which two grazing orbits are one. Events are located to 1e-10."""


class KnownGrazings:
    """The grazing orbits that were unfolded, with how many generations of families without a reversal were asked for there.

    Examples
    --------
    >>> known = KnownGrazings()
    >>> known.add((0.5, 1.7, 3.2), (False, 0))
    >>> known.has((0.5 + 1e-12, 1.7, 3.2), (False, 0)), known.has((0.5, 1.7, 3.2), (False, 1)), known.has((0.5, 1.7, 3.2), (True, 0))
    (True, False, False)
    >>> known.add((0.6, 1.7, 3.2), (True, 0))
    >>> known.has((0.6, 1.7, 3.2), (False, 0))
    True
    """

    def __init__(self) -> None:
        self._marks: dict[tuple[bool, int], list[tuple[Mark, int]]] = {}

    def add(self, mark: Mark | None, asked: tuple[bool, int]) -> None:
        """Remember a grazing orbit that was unfolded.

        Parameters
        ----------
        mark : (float, float, float) or None
            `branches.grazing.touching.Touching.mark`; what has none is never known.
        asked : (bool, int)
            In which limits - the wide ones or not -, and how many generations further.
        """
        if mark is not None:
            self._marks.setdefault((asked[0], _cell(mark)), []).append((mark, asked[1]))

    def has(self, mark: Mark | None, asked: tuple[bool, int]) -> bool:
        """Whether it was unfolded in those limits or in wider ones, for at least as many generations."""
        if mark is None:
            return False
        cell = _cell(mark)
        return any(
            further >= asked[1] and all(abs(a - b) <= SAME * b for a, b in zip(mark, other, strict=True))
            for wide in {asked[0], True}
            for near in (cell - 1, cell, cell + 1)
            for other, further in self._marks.get((wide, near), ())
        )


def _cell(mark: Mark) -> int:
    return int(mark[1] * 1e4)
