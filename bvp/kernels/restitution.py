"""Newton's restitution along M^-1 c. It is linear, so it maps a perturbation as it maps a state."""

from bvp.kernels.bounds import dot
from bvp.kernels.compiled import kernel, part

__all__ = ["bounce", "kick", "restitute", "strike", "strike_columns"]

SPLIT = 134217729.0
"""2^27 + 1, for the upper half of the digits of a double (Veltkamp)."""


@part
def kick(change, near, rest):
    """change (near + rest), rounded to either side alike. `near` is the nearest double to a number, and `rest` what it leaves.

    Were rest left out, or added to a rounded product, every product would be off to the same side."""
    scaled = near * SPLIT
    head = scaled - (scaled - near)
    return change * head + change * ((near - head) + rest)


@part
def bounce(rate_rows, push, push_rest, c, jump, z):
    """`strike`, in place, along a push that is known beyond double precision, so that the energy of many impacts does not drift."""
    change = jump * dot(rate_rows, c, z)
    for r in range(z.shape[0]):
        z[r] -= kick(change, push[c, r], push_rest[c, r])


@part
def strike(rate_rows, push, c, jump, z, out):
    """out = z - jump push (rate . z), the impact at contact c: jump = 1 + r, 0 leaves it out (out may be z)."""
    change = jump * dot(rate_rows, c, z)
    for r in range(z.shape[0]):
        out[r] = z[r] - change * push[c, r]


@kernel
def restitute(rate_rows, push, restitution, c, z, out):
    """`strike` with the contact's own restitution."""
    strike(rate_rows, push, c, 1.0 + restitution[c], z, out)


@part
def strike_columns(rate_rows, push, c, jump, matrix):
    """`strike` each column of a matrix (N, N), in place."""
    size = matrix.shape[1]
    for column in range(size):
        change = 0.0
        for r in range(size):
            change += rate_rows[c, r] * matrix[r, column]
        change *= jump
        if change != 0.0:
            for r in range(size):
                matrix[r, column] -= change * push[c, r]
