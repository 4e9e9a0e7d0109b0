"""Values in messages: what was received, in one line that can be read, whatever it is."""

from __future__ import annotations

from typing import Any

__all__ = ["shown"]


def shown(value: Any) -> str:
    """A value as messages show it: in one line, the middle left out where it is long.

    Examples
    --------
    >>> shown(10**400), shown([0.1])
    ('a whole number of 1329 bits, beyond all floats', '[0.1]')
    """
    if isinstance(value, int) and value.bit_length() > 1024:
        return f"a whole number of {value.bit_length()} bits, beyond all floats"
    try:
        text = " ".join(repr(value).split())
    except ValueError:
        # Python writes no whole number of more than some thousand digits, nor a list with one.
        return f"a {type(value).__name__} with a whole number beyond all floats"
    return text if len(text) <= 200 else f"{text[:120]} ... {text[-40:]}"
