"""Newton's restitution along M^-1 c. It is linear, so it maps a perturbation as it maps a state."""

from bvp.kernels.bounds import dot
from bvp.kernels.compiled import kernel, part

__all__ = ["restitute", "strike", "strike_columns"]


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
