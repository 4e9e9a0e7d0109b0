"""saltus compile: compile the kernels of all commands, so that none is compiled later."""

from __future__ import annotations

import argparse
import time

from branches.files import WriteFailure
from saltus import compiling
from saltus.errors import DONE, FAILED

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from bvp.kernels.stored import cache_root

    left = calls = compiling.missing()
    reason = compiling.unkept(calls)
    if reason:
        raise WriteFailure(f"compiled kernels cannot be kept: {reason}")
    if calls:
        compiling.announce(calls)
        began = time.monotonic()
        compiling.compile_kernels(calls)
        left = compiling.missing()
        done = len(calls) - len(left)
        print(f"compiled {done} of {len(calls)} kernels in {time.monotonic() - began:.0f} s, kept in {cache_root()}")
    if not left:
        print("all kernels are compiled: no command compiles any")
        return DONE
    for _, module, name, _ in left:
        print(f"not compiled: {name} of {module}")
    return FAILED
