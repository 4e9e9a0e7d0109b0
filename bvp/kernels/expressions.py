"""Values of expressions of parameters, by a program: a list of operations in plain arrays. `bvp.expressions.program_of` makes it.

Each operation takes the results of earlier ones, and its own result is kept. What several expressions share is computed once.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import shared

ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, INTEGER_POWER = range(6)
"""Operations on two operands. The second one of the last is an integer itself, not a register."""

SQRT, EXP, LOG, SIN, COS, TAN, SINH, COSH, TANH, ABS, SIGN = range(6, 17)
"""Operations on one operand. SIGN is the derivative of ABS, which is 0 at 0."""


class Program(NamedTuple):
    """Expressions of N parameters. The registers hold the N parameters, then the constants, then the result of each operation."""

    code: np.ndarray  # (L, 3) int64: operation, registers of its operands
    constants: np.ndarray  # (C,)
    outputs: np.ndarray  # (O,) int64: the register of each expression


@shared("boolean")
def run(program, parameters, scratch, out):
    """Evaluate expressions at parameters (N,) into out (O,). scratch: (>= N + C + L,). Returns whether all values are finite."""
    code, constants, outputs = program
    count = parameters.shape[0]
    first = count + constants.shape[0]
    for i in range(count):
        scratch[i] = parameters[i]
    for i in range(constants.shape[0]):
        scratch[count + i] = constants[i]
    for i in range(code.shape[0]):
        operation = code[i, 0]
        x = scratch[code[i, 1]]
        if operation == INTEGER_POWER:
            exponent = abs(code[i, 2])
            value = 1.0
            while exponent > 0:
                if exponent % 2 == 1:
                    value *= x
                x *= x
                exponent //= 2
            if code[i, 2] < 0:
                value = 1.0 / value
        elif operation <= POWER:
            y = scratch[code[i, 2]]
            if operation == ADD:
                value = x + y
            elif operation == SUBTRACT:
                value = x - y
            elif operation == MULTIPLY:
                value = x * y
            elif operation == DIVIDE:
                value = x / y
            else:
                value = math.pow(x, y)
        elif operation == SQRT:
            value = math.sqrt(x)
        elif operation == EXP:
            value = math.exp(x)
        elif operation == LOG:
            value = math.log(x)
        elif operation == SIN:
            value = math.sin(x)
        elif operation == COS:
            value = math.cos(x)
        elif operation == TAN:
            value = math.tan(x)
        elif operation == SINH:
            value = math.sinh(x)
        elif operation == COSH:
            value = math.cosh(x)
        elif operation == TANH:
            value = math.tanh(x)
        elif operation == ABS:
            value = abs(x)
        else:
            value = math.copysign(1.0, x) if x != 0.0 else x
        scratch[first + i] = value
    is_finite = True
    for k in range(outputs.shape[0]):
        out[k] = scratch[outputs[k]]
        is_finite = is_finite and abs(out[k]) < math.inf
    return is_finite
