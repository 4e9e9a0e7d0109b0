"""Passing through grazing: the families that meet where an orbit touches a stop.

`neighbours(branch, event)` finds and follows them. The orbit at the event is unfolded over its whole period (`touching`), each choice of
the grazing instants that count as impacts is a candidate (`candidates`), and each candidate is solved and followed (`following`).
"""

from __future__ import annotations

from branches.grazing.following import Neighbour, neighbours

__all__ = ["Neighbour", "neighbours"]
