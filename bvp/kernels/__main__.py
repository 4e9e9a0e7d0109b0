"""Compile kernels, one after the other, for another process: `python -m bvp.kernels`.

Each line of standard input is JSON: module, name and types of a kernel. Each line of standard output says how many seconds it took.
"""

import importlib
import json
import os
import sys
import threading
import time
from queue import SimpleQueue

from bvp.kernels.compiled import Kernel
from bvp.kernels.stored import types_from


def compile_requested() -> None:
    """Compile what standard input asks for. This process ends with the one that writes there."""
    lines: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_read, args=(lines,), daemon=True).start()
    while True:
        module, name, types = json.loads(lines.get())
        began = time.process_time()
        kernel: Kernel = getattr(importlib.import_module(module), name)
        kernel.compile(types_from(types))
        print(f"{time.process_time() - began:.2f}", flush=True)


def _read(lines: SimpleQueue[str]) -> None:
    """Pass lines on. At their end the other process has ended, and a kernel that takes long is not waited for."""
    for line in sys.stdin:
        lines.put(line)
    os._exit(1)


if __name__ == "__main__":
    compile_requested()
