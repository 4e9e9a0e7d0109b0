"""Passing through grazing: the families that meet at an orbit that touches a stop.

`following.neighbours(branch, event)` finds and follows them. `touching` unfolds the orbit over its full period. Each choice of the grazing
instants that count as impacts is a candidate. `following` solves the candidates. `branches.linear_modes` does the same for linear modes.
"""
