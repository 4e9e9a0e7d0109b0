"""How a run ended: one enum whose texts tell the user what to do next, and the count of what was tried."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class EndReason(Enum):
    """Why a family was followed no further. The value is a text for the user."""

    CLOSED = "the family closes on itself: it is back at its first point; nothing is left to follow"
    REPEATED = "the family repeats itself: it passes one branch point for the third time; what follows are images of what was followed"
    EVENT = "the family ends at this event; to go on, start the neighbouring family from the last point"
    STOP_AT = "an event of a type to stop at was reached; start again from the last point to go on"
    STOP_WHEN = "the stop condition held; start again from the last point to go on"
    POINTS = "the number of points was reached; allow more points, or start again from the last point"
    NOT_ASKED = "this direction was not asked for; start again from this point to go there"
    MINIMUM_STEP = (
        "steps were refused down to the shortest allowed; the family may end here or turn sharply: "
        "look at the detail, then try a smaller minimum_step"
    )
    NO_START = "the start could not be corrected onto a family; give a start that is nearer to a solution"

    @property
    def text(self) -> str:
        """What happened and what to do next."""
        return self.value


class Tally(NamedTuple):
    """What a run tried: the steps it accepted, and those it refused and halved, by cause.

    ``accepted`` counts steps, not points: the start and the points at events are not steps.
    """

    accepted: int = 0
    not_converged: int = 0
    slow: int = 0
    turned: int = 0
    jumped: int = 0

    @property
    def refused(self) -> int:
        """All refused steps."""
        return self.not_converged + self.slow + self.turned + self.jumped


class End(NamedTuple):
    """The end of a run: `reason`, `detail` in words (may be empty), and the `tally` of steps."""

    reason: EndReason
    detail: str = ""
    tally: Tally = Tally()

    @property
    def text(self) -> str:
        """The reason in words with its detail."""
        return f"{self.reason.text} ({self.detail})" if self.detail else self.reason.text
