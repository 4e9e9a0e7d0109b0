"""What is called before a kernel is compiled. It may compile the kernel with others, in several processes."""

from collections.abc import Callable
from typing import Any

before_compiling: Callable[[str, str, Any], None] | None = None
"""Called with the module, the name and the types of a kernel that is not on disk."""
