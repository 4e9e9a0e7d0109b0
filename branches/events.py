"""Special points of a branch, the reasons of its ends, and counters of stability work. Importing this loads neither numpy nor kernels."""

from __future__ import annotations

from typing import NamedTuple

from bvp.texts import brief

__all__ = ["BranchEvent", "DigitWork", "Ended"]


@brief
class BranchEvent(NamedTuple):
    """A special point of a branch, with its error bar.

    id: type and count along the branch, e.g. "SB1". point: index into `Branch.points`. number: count of points from the start orbit,
    negative below it. bracket: arclengths between which it certainly is. residual: of its test function. stop: contact touched or
    left (GR). p_q: [p, q] of a p:q resonance. breaks: what an SB breaks. multiplier: modulus of the largest multiplier. coefficient: of
    the normal form at SN, SB and PD, if it was computed (`branches.curves.free_criticality`); criticality: what it means at SB and PD.
    """

    id: str
    type: str
    point: int
    number: int
    h: float
    alpha: float
    arclength: float
    status: str
    bracket: tuple[float, float]
    residual: float
    label: str
    stop: str | None
    p_q: list[int] | None
    breaks: str | None
    note: str | None
    stable: bool | None
    multiplier: float | None
    coefficient: float | None = None
    criticality: str | None = None

    @property
    def normal_form(self) -> str:
        """The criticality and the coefficient, as a table shows them."""
        number = "" if self.coefficient is None else f"{self.coefficient:.4g}"
        return " ".join(part for part in (self.criticality or "", number) if part)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        low, high = self.bracket
        return f"{self.id}: h = {self.h:.10g}, alpha = {self.alpha:.10g}, arclength {low:.10g} to {high:.10g}, {self.status}", []


class Ended(NamedTuple):
    """Why a branch ends where it does: `reason`, the name of a member of `continuation.EndReason`, and `text`."""

    reason: str
    text: str


class DigitWork(NamedTuple):
    """How many orbits were solved in fifty digits to decide their stability, and the time in seconds."""

    orbits: int = 0
    seconds: float = 0.0

    def __add__(self, other: tuple[object, ...]) -> DigitWork:  # of the sums, not of the tuples
        assert isinstance(other, DigitWork)
        return DigitWork(self.orbits + other.orbits, self.seconds + other.seconds)
