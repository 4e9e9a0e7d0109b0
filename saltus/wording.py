"""Numbers of things in words."""

from __future__ import annotations

__all__ = ["counted"]


def counted(count: int, thing: str) -> str:
    """A number of things, one of them in the singular.

    Examples
    --------
    >>> counted(1, "orbit"), counted(0, "edge"), counted(2, "family")
    ('1 orbit', '0 edges', '2 families')
    """
    if count == 1:
        return f"1 {thing}"
    return f"{count} {thing[:-1]}ies" if thing.endswith("y") else f"{count} {thing}s"
