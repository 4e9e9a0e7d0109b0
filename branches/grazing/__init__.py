"""Passing through grazing: the families that meet where an orbit touches a stop.

`following.neighbours(branch, event)` finds and follows them. The orbit at the event is unfolded over its whole period (`touching`). Each
choice of the grazing instants that count as impacts is a candidate (`candidates`). Each candidate is solved and followed (`following`).
"""
