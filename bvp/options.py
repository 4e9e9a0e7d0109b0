"""Functions that pass options on: their signature and docstring list the options themselves."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["takes_options_of"]

Function = TypeVar("Function", bound=Callable[..., Any])


def takes_options_of(inner: Callable[..., Any]) -> Callable[[Function], Function]:
    """Decorate a function that passes ``**options`` to `inner`: ``help`` shows the keywords of `inner` in their place.

    Examples
    --------
    >>> def inner(*, most=3):
    ...     '''Parameters
    ...     ----------
    ...     most : int
    ...         Largest number.
    ...     '''
    >>> @takes_options_of(inner)
    ... def outer(x, **options):
    ...     '''Parameters
    ...     ----------
    ...     x : float
    ...     **options
    ...         As for `inner`.
    ...     '''
    >>> str(inspect.signature(outer)), "most : int" in outer.__doc__, "**options" in outer.__doc__
    ('(x, *, most=3)', True, False)
    """

    def decorate(function: Function) -> Function:
        own = inspect.signature(function)
        kept = [item for item in own.parameters.values() if item.kind is not item.VAR_KEYWORD]
        theirs = inspect.signature(inner).parameters.values()
        passed = [item for item in theirs if item.kind is item.KEYWORD_ONLY and item.name not in own.parameters]
        function.__signature__ = own.replace(parameters=[*kept, *passed])  # type: ignore[attr-defined]
        names = {item.name for item in passed}
        described = "\n".join(text for name, text in _entries(inner.__doc__ or "") if names & set(re.findall(r"\w+", name)))
        for name, text in _entries(function.__doc__ or ""):
            if name.startswith("**"):
                function.__doc__ = inspect.cleandoc(function.__doc__ or "").replace(text, described)
        return function

    return decorate


def _entries(doc: str) -> list[tuple[str, str]]:
    """The entries of the section Parameters of a docstring: the names, and the whole text."""
    found = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n|\Z)", inspect.cleandoc(doc), re.DOTALL | re.MULTILINE)
    texts = re.findall(r"^\S.*(?:\n +.*)*", found[1], re.MULTILINE) if found else []
    return [(text.partition("\n")[0].partition(" :")[0], text) for text in texts]
