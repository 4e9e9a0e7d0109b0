"""Compiled arithmetic of the impacting problem: plain arrays in, plain arrays out, no policy."""

from numba import config as _config

if getattr(_config, "DISABLE_JIT", 0):
    raise ValueError("NUMBA_DISABLE_JIT is set, and saltus computes with compiled code alone; expected it unset, or 0")
