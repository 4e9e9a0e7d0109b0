"""What can be wrong with a name that can be read, wherever it is looked up."""

from __future__ import annotations

__all__ = ["PIN_TOLERANCE", "AmbiguousName", "NameNotFound"]

PIN_TOLERANCE = 0.02
"""How far, relatively, the quarter period of a chosen family may be from its pin at the pin's energy."""


class NameNotFound(ValueError):
    """No orbit has the name within the bounds; the message says what was searched and what exists."""


class AmbiguousName(ValueError):
    """Several families have the name; the message lists the suffix that selects each."""
