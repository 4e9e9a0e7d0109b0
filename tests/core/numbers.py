"""Print numbers that the core computes, every bit of them, one a line: `python -m tests.core.numbers [words]`.

`.ci/instructions` compares what the core prints when it is compiled for other processors and by other compilers. A new part of the core
gets a function in PARTS. It yields a name and an array for each result, and takes few seconds in all. The arguments are exact or computed
by the core, because numpy's functions differ between processors. The words are required in the name of the core's compiler.
"""

import sys

import numpy as np
import saltus_core

ONE = "sqrt sin cos tan exp expm1 log log1p sinh cosh tanh asinh asin acos atan".split()
TWO = "pow hypot atan2".split()


def grid():
    """Numbers of all magnitudes and both signs, and others spread evenly around zero: integers over powers of two."""
    magnitudes = np.ldexp(1.0 + np.arange(900) / 900.0, np.arange(900) % 120 - 80)
    return np.concatenate([magnitudes, -magnitudes, np.arange(-700, 700) / 64.0, np.arange(-700, 700) / 1024.0])


def elementary_functions():
    """Of doubles, with their first derivatives, and of double-doubles."""
    x = grid()
    y = x[::-1].copy()
    wide = [np.array([z, np.ldexp(z, -55)]) for z in (x, y)]
    for name in ONE:
        yield name, getattr(saltus_core, name)(x)
        yield f"jets.{name}", getattr(saltus_core.jets, name)(x)
        yield f"double_double.{name}", getattr(saltus_core.double_double, name)(wide[0])
    for name in TWO:
        yield name, getattr(saltus_core, name)(x, y)
        yield f"double_double.{name}", getattr(saltus_core.double_double, name)(*wide)


PARTS = [elementary_functions]


def lines():
    for part in PARTS:
        for name, values in part():
            for k, value in enumerate(np.asarray(values, dtype=float).ravel().tolist()):
                yield f"{name} {k} {value.hex()}"


if __name__ == "__main__":
    for word in " ".join(sys.argv[1:]).split():
        if word not in saltus_core.compiler:
            sys.exit(f"expected {word} in the compiler of {saltus_core.__file__}: {saltus_core.compiler}")
    sys.stdout.writelines(f"{line}\n" for line in lines())
