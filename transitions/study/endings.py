"""How a run of a study ended."""

from __future__ import annotations

from enum import Enum

from bvp.motion import MotionStatus

__all__ = ["Ending"]


class Ending(Enum):
    """How a run ended; the text says it, and what to do next."""

    CLEAR = (0, "no impact is possible any more")
    DURATION = (1, "the duration was reached")
    LONGEST = (2, "impacts are still possible at the longest time; allow a longer one")
    IMPACTS_FULL = (3, MotionStatus.IMPACTS_FULL.value)
    SIMULTANEOUS = (4, MotionStatus.SIMULTANEOUS.value)
    OUTSIDE = (5, MotionStatus.OUTSIDE.value)
    UNDECIDED = (6, MotionStatus.UNDECIDED.value)
    EXHAUSTED = (7, MotionStatus.EXHAUSTED.value)
    NO_ORBIT = (8, "the starting family has no orbit at this energy; choose energies at which it has")
    PIERCED = (9, MotionStatus.PIERCED.value)

    def __init__(self, code: int, text: str) -> None:
        self.code = code
        self.text = text
