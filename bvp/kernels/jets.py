"""Taylor coefficients of smooth forces along a motion, by a program: a list of operations in plain arrays.

`bvp.jet_programs.jet_program` makes it. Each register holds the coefficients of one quantity in time, (K + 1,) numbers. The first ones are
those of the inputs, which are linear in the state. Each operation adds the coefficient of order k of its result, from those of its operands
up to the order k and of its own up to the order k - 1 (Jorba & Zou, Experimental Mathematics 14 (2005) 99, section 2).
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined

ADD, SUBTRACT, MULTIPLY, DIVIDE, SQUARE = range(5)
"""Operations on registers: a + b, a - b, a b, a/b, a^2."""

SCALE, SHIFT, POWER, SIGNED_POWER, EVEN_POWER = range(5, 10)
"""Operations on a register and a number: s a, a + s, a^s, |a|^s sign a, |a|^s."""

EXP, LOG, SIN, SINH = range(10, 14)
"""Functions of a register. SIN and SINH write the cosine, or hyperbolic cosine, to the register behind their own."""


CALLED = 14
"""All forces and their derivatives, as a Python function computes them: in the core only. The inputs come first."""


class JetProgram(NamedTuple):
    """What smooth forces are as functions of their I inputs. Registers: inputs, then the results of the operations."""

    code: np.ndarray  # (L, 4) int64: operation, register of the result, of the first operand, of the second one or the number's index
    numbers: np.ndarray  # (S,) the numbers of the operations
    forces: np.ndarray  # (F,) int64: the register of each force
    slopes: np.ndarray  # (D, 3) int64: force, input, and the register of the derivative of one by the other, where it is not zero
    changes: np.ndarray  # (C, 3) int64: force, released parameter, and the register of that derivative, where it is not zero
    registers: int


@inlined
def _product(a, b, k, last):
    """Sum of a[j] b[k - j] for j = 1 .. last. Without the coefficients of order k, and as two sums, it waits for nothing: the processor
    computes it beside others."""
    even = 0.0
    odd = 0.0
    j = 1
    while j < last:
        even += a[j] * b[k - j]
        odd += a[j + 1] * b[k - j - 1]
        j += 2
    if j == last:
        even += a[j] * b[k - j]
    return even + odd


@inlined
def _weighted(a, b, k):
    """Sum of j a[j] b[k - j] for j = 1 .. k."""
    total = 0.0
    for j in range(1, k):
        total += j * a[j] * b[k - j]
    return total + k * a[k] * b[0]


@inlined
def _power(a, c, k, s):
    """The coefficient of order k of c = a^s, from a c' = s a' c."""
    total = 0.0
    for j in range(1, k):
        total += (s * j - (k - j)) * a[j] * c[k - j]
    return (total + s * k * a[k] * c[0]) / (k * a[0])


@inlined
def extend_jets(program, jets, k, least):
    """Add the coefficients of order k to `jets` (registers, > k); those of the inputs are there.

    A power of |a| is zero where a is 0, or where it is not above `least` in size: there it has no expansion."""
    code, numbers = program.code, program.numbers
    for i in range(code.shape[0]):
        operation = code[i, 0]
        c = jets[code[i, 1]]
        a = jets[code[i, 2]]
        if operation == ADD:
            c[k] = a[k] + jets[code[i, 3], k]
        elif operation == SUBTRACT:
            c[k] = a[k] - jets[code[i, 3], k]
        elif operation == MULTIPLY:
            b = jets[code[i, 3]]
            c[k] = _product(a, b, k, k - 1) + (a[0] * b[k] + a[k] * b[0]) if k > 0 else a[0] * b[0]
        elif operation == SQUARE:
            half = (k - 1) // 2
            total = 2.0 * _product(a, a, k, half)
            if k % 2 == 0:
                total += a[k // 2] * a[k // 2]
            c[k] = total + 2.0 * a[0] * a[k] if k > 0 else total
        elif operation == DIVIDE:
            b = jets[code[i, 3]]
            c[k] = (a[k] - _product(b, c, k, k - 1) - b[k] * c[0]) / b[0] if k > 0 else a[0] / b[0]
        elif operation == SCALE:
            c[k] = numbers[code[i, 3]] * a[k]
        elif operation == SHIFT:
            c[k] = a[k] + numbers[code[i, 3]] if k == 0 else a[k]
        elif operation <= EVEN_POWER:
            s = numbers[code[i, 3]]
            if k == 0:
                if operation == POWER:
                    c[0] = math.pow(a[0], s)
                else:
                    c[0] = math.pow(abs(a[0]), s)
                    if c[0] <= least or a[0] == 0.0:
                        c[0] = 0.0
                    elif operation == SIGNED_POWER and a[0] < 0.0:
                        c[0] = -c[0]
            elif c[0] == 0.0:
                c[k] = 0.0
            else:
                c[k] = _power(a, c, k, s)
        elif operation == EXP:
            c[k] = math.exp(a[0]) if k == 0 else _weighted(a, c, k) / k
        elif operation == LOG:
            if k == 0:
                c[0] = math.log(a[0])
            else:
                total = 0.0
                for j in range(1, k):
                    total += j * c[j] * a[k - j]
                c[k] = (a[k] - total / k) / a[0]
        else:
            other = jets[code[i, 1] + 1]
            if k == 0:
                c[0] = math.sin(a[0]) if operation == SIN else math.sinh(a[0])
                other[0] = math.cos(a[0]) if operation == SIN else math.cosh(a[0])
            else:
                turned = _weighted(a, c, k) / k
                c[k] = _weighted(a, other, k) / k
                other[k] = -turned if operation == SIN else turned
