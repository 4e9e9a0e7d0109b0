"""The operations on a branch that `Branch` offers as methods.

A `Branch` is data and imports no operation. Importing this module adds the methods; `saltus` does it before it hands out a branch.
"""

from __future__ import annotations

from branches.branch import Branch
from branches.grazing.following import neighbours
from branches.record import save
from branches.switching import switch
from branches.tracing import extend

__all__ = ["Branch"]

Branch.save = save
Branch.trace = extend
Branch.switch = switch
Branch.neighbours = neighbours
