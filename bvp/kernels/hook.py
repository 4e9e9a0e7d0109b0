"""What is done with a kernel that has no machine code.

What is called before a kernel is compiled may compile it with others, in several processes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

before_compiling: Callable[[str, str, Any], None] | None = None
"""Called with the module, the name and the types of a kernel that is not on disk."""

interpreting: list[bool] = []
"""Whether kernels without machine code run in Python: not where it is empty. The last item tells whether one of them is running."""


class NotInterpretedError(Exception):
    """A kernel cannot run in Python: machine code divides by zero. What it had to write is half written."""


@contextmanager
def interpreted(wanted: bool = True) -> Iterator[None]:
    """Run kernels that have no machine code in Python, which takes less time than to compile them for a few calls.

    Raises
    ------
    NotInterpretedError
        For a kernel that cannot run so.
    """
    if not wanted:
        yield
        return
    interpreting.append(False)
    try:
        yield
    finally:
        interpreting.pop()
