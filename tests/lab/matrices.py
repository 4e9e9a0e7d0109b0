"""Products of numbers."""

import numpy as np
import saltus_core as core

__all__ = ["bounded_product"]


def bounded_product(factors):
    """Return a number in [-1, 1] with the sign and the zeros of the product of real numbers and conjugate pairs."""
    numbers = np.array(factors, dtype=complex)
    return core.bounded_product(numbers.real.copy(), numbers.imag.copy())
