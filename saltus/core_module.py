"""Whether the compiled core can be used, and what to do where it cannot."""

from __future__ import annotations

import sys
from pathlib import Path

__all__ = ["core_fault", "is_command", "require_core"]

NAME = "saltus_core"


def core_fault(error: BaseException) -> str:
    """What is wrong with the compiled core, where that is the reason of an error, and the command that compiles it; else empty.

    Examples
    --------
    >>> print(core_fault(ImportError("no such file", name="saltus_core")))  # doctest: +ELLIPSIS
    the compiled core of saltus cannot be imported (no such file); compile it: ... -m pip install ...
    >>> import saltus_core
    >>> try:
    ...     saltus_core.forgotten
    ... except AttributeError as error:
    ...     print(core_fault(error))  # doctest: +ELLIPSIS
    the compiled core of saltus is older than the program (module 'saltus_core' has no attribute 'forgotten'); compile it: ...
    >>> core_fault(ImportError("No module named 'numpy'", name="numpy")), core_fault(AttributeError("x"))
    ('', '')
    """
    is_old = isinstance(error, AttributeError) or "cannot import name" in str(error)
    place = getattr(error.obj, "__name__", "") if isinstance(error, AttributeError) else getattr(error, "name", "")
    if place != NAME:
        return ""
    fault = "is older than the program" if is_old else "cannot be imported"
    folder = Path(__file__).resolve().parents[1]
    what = f'--editable "{folder}"' if (folder / "backend.py").is_file() else "--force-reinstall --no-deps saltus"
    return f"the compiled core of saltus {fault} ({error}); compile it: {sys.executable} -m pip install {what}"


def require_core() -> None:
    """Import the compiled core.

    Raises
    ------
    ImportError
        What is missing, and which command compiles it.
    """
    try:
        import saltus_core  # noqa: F401
    except ImportError as error:
        raise ImportError(core_fault(error) or str(error), name=error.name) from error


def is_command() -> bool:
    """Whether this process is the command `saltus`, which reports a missing core itself. In `python -m saltus` the name of the module is
    not known yet."""
    return Path(sys.argv[0] if sys.argv else "").stem in ("saltus", "-m")
