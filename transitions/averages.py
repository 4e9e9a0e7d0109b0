"""Means along quasiperiodic motion."""

from __future__ import annotations

import numpy as np

__all__ = ["weighted_mean"]


def weighted_mean(values: np.ndarray) -> float:
    """The mean of values (k,) with the weight exp(-1/(t (1 - t))), equation (21) of docs/theory.md.

    Along a quasiperiodic motion it converges faster than any power of 1/k, where the plain mean converges as 1/k (Das, Saiki, Sander &
    Yorke, Nonlinearity 30 (2017) 4111)."""
    t = (np.arange(len(values)) + 0.5) / len(values)
    weights = np.exp(-1.0 / (t * (1.0 - t)))
    return float(weights @ values / weights.sum())
