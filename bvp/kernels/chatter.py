"""The end of chattering from the impacts before it.

The bounces on a stop that presses back shrink by the restitution: the speed s of leaving obeys s -> restitution s (1 + O(s)), a map whose
iterates are a power series in restitution^k (Koenigs), and so is everything that moves with them: time, displacements, velocities, energies
lost. With q = restitution^stride, values after every stride-th impact are x_k = x + a_1 q^k + a_2 q^2k + ..., and Neville's scheme with these
known ratios takes one power away after the other:

    x_k^(i) = (x_k^(i-1) - q^i x_(k-1)^(i-1))/(1 - q^i)

The difference between the two last orders is the error of the lower one. The stride keeps q below 1/2, so rounding grows tenfold at most.
"""

import math

from bvp.kernels.compiled import kernel

__all__ = ["LEVELS", "extrapolate", "stride_of"]

LEVELS = 10
"""Orders kept."""


@kernel
def stride_of(restitution):
    """Impacts between two values used."""
    return max(1, int(math.ceil(math.log(0.5) / math.log(restitution))))


@kernel
def extrapolate(table, rows, ratio, values):
    """Take in the next values (W,), the `rows`-th since the chatter began (from 0); `table` (LEVELS, W) keeps the last value of each order,
    the highest one in row min(rows, LEVELS - 1)."""
    for w in range(values.shape[0]):
        new = values[w]
        power = 1.0
        for i in range(min(rows, LEVELS - 1) + 1):
            old = table[i, w]
            table[i, w] = new
            power *= ratio
            new = (new - power * old) / (1.0 - power)
