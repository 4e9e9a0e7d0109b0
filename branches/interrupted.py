"""The branch that an interrupted or failed run has computed travels with its error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bvp.interrupts import defer_interrupts
from continuation.run import Run

__all__ = ["with_branch", "with_computed"]


def with_branch(error: BaseException, branch: Any) -> BaseException:
    """The error, with a branch as its attribute `branch`."""
    error.branch = branch  # type: ignore[attr-defined]
    return error


def with_computed(error: BaseException, branch_of: Callable[[Run], Any]) -> BaseException:
    """The error of `continuation.follow_both_ways`, with the branch of the points before it as its attribute `branch`, if there are any."""
    with defer_interrupts():
        computed = getattr(error, "computed", lambda: None)()
        return error if computed is None else with_branch(error, branch_of(computed))
