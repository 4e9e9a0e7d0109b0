"""What can be wrong with a name that can be read, wherever it is looked up."""

from __future__ import annotations

from collections.abc import Callable

from branches.labels import Label, canonical, roots

__all__ = ["PIN_TOLERANCE", "AmbiguousName", "NameNotFound", "several_turns"]

PIN_TOLERANCE = 0.02
"""How far, relatively, the quarter period of a chosen family may be from its pin at the pin's energy."""


class NameNotFound(ValueError):
    """No orbit has the name within the bounds; the message says what was searched and what exists."""


class AmbiguousName(ValueError):
    """Several families have the name; the message lists the suffix that selects each."""


def several_turns(label: Label, exists: Callable[[Label], bool]) -> str:
    """That a label is one of several turns of an orbit that exists; nothing where it is not.

    Examples
    --------
    >>> from branches.labels import parse
    >>> several_turns(parse("L22-"), lambda label: True)
    'L22- is 2 turns of L11-; expected the name of a primitive orbit'
    """
    known = ((canonical(label), label.m),) if label.kind == "L" else roots(label)
    for root, count in known:
        if count > 1 and exists(root):
            return f"{label} is {count} turns of {root}; expected the name of a primitive orbit"
    return ""
