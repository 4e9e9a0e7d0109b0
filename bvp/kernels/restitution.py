"""An impact: Newton's restitution along M^-1 c, and how it carries a perturbation (docs/theory.md, Impact).

Restitution R is linear, so it maps a perturbation as it maps a state. But a perturbed motion arrives at another time. After the flight
time t the state is z-, and the perturbation dz of the start has become exp(B t) dz. The arrival moves by

    dt = -(g . exp(B t) dz)/(g . B z-)

and the perturbation on the stop, after the impact, is J dz + F dt with J = R exp(B t) and F = R B z-.
"""

from bvp.kernels.arrays import dot
from bvp.kernels.compiled import kernel, part
from bvp.kernels.flight import block_product

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
def restitute(contacts, c, z, out):
    """`strike` with the contact's own restitution."""
    strike(contacts.rate, contacts.push, c, 1.0 + contacts.restitution[c], z, out)


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


@part
def land(flight, rate_rows, push, c, jump, before, flow, along):
    """J = R exp(B t) from `flow` = exp(B t), in place, and F = R B z- into `along`, for the state z- = `before`. jump = 0: no impact."""
    block_product(flight.pairs, flight.matrix, before, along)
    if jump != 0.0:
        strike(rate_rows, push, c, jump, along, along)
        strike_columns(rate_rows, push, c, jump, flow)


@part
def arrive(rows, c, velocity, change):
    """Move a perturbation `change` along the flow onto rows[c] . z = constant: change += velocity dt. Returns dt."""
    shift = -dot(rows, c, change) / dot(rows, c, velocity)
    for r in range(change.shape[0]):
        change[r] += shift * velocity[r]
    return shift
