"""What is called before a kernel is compiled, and after one that called a Python function which failed.

What is called before may compile the kernel with others, in several processes."""

from collections.abc import Callable
from typing import Any

before_compiling: Callable[[str, str, Any], None] | None = None
"""Called with the module, the name and the types of a kernel that is not on disk."""

failures: list[BaseException] = []
"""Errors of Python functions that kernels called. The next kernel that returns to Python raises the first."""
