"""Special points of a branch and the reasons of its ends; neither numpy nor compiled kernels are needed for them."""

from __future__ import annotations

from typing import NamedTuple

from bvp.summary import brief

__all__ = ["BranchEvent", "Ended"]


@brief
class BranchEvent(NamedTuple):
    """A special point of a branch, with its error bar.

    id: type and count along the branch, e.g. "SB1". point: index into `Branch.points`. number: count of points from the start orbit,
    negative below it. bracket: arclengths between which it certainly is. residual: of its test function. stop: contact touched or
    left (GR). p_q: [p, q] of a q-tupling. breaks: what an SB breaks. multiplier: modulus of the largest multiplier.
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

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        low, high = self.bracket
        return f"{self.id}: h = {self.h:.10g}, alpha = {self.alpha:.10g}, arclength {low:.10g} to {high:.10g}, {self.status}", []


class Ended(NamedTuple):
    """Why a branch ends where it does: `reason`, the name of a member of `continuation.EndReason`, and `text` in words."""

    reason: str
    text: str
