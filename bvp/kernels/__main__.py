"""Compile kernels, one after the other, for another process: `python -m bvp.kernels`.

Each line of standard input is JSON: module, name and types of a kernel. Each line of standard output says how many seconds it took.
"""

import importlib
import json
import sys
import time

from bvp.kernels.compiled import Kernel
from bvp.kernels.stored import types_from


def compile_requested() -> None:
    """Compile what standard input asks for."""
    for line in sys.stdin:
        module, name, types = json.loads(line)
        began = time.process_time()
        kernel: Kernel = getattr(importlib.import_module(module), name)
        kernel.compile(types_from(types))
        print(f"{time.process_time() - began:.2f}", flush=True)


if __name__ == "__main__":
    compile_requested()
