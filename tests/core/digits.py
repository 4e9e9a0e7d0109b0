"""The functions of the core in many digits, by mpmath."""

from __future__ import annotations

import mpmath as mp
import numpy as np

__all__ = ["EXACT", "LARGEST", "errors_in_ulps", "random_numbers", "relative_errors"]

LARGEST = float(np.finfo(float).max)

EXACT = {name: getattr(mp, name) for name in "sin cos tan exp expm1 log log1p sinh cosh tanh asinh atan asin acos sqrt hypot atan2".split()}
EXACT |= {"pow": mp.power, "add": mp.fadd, "multiply": mp.fmul, "divide": mp.fdiv}


def random_numbers(seed, count, low, high, signs=True):
    """Numbers whose sizes are spread evenly over all magnitudes from low to high."""
    source = np.random.default_rng(seed)
    sizes = np.exp(source.uniform(np.log(low), np.log(high), count))
    return sizes * source.choice([-1.0, 1.0], count) if signs else sizes


def errors_in_ulps(name, values, *arguments, precision=200):
    """Errors of values of a function, in units of the spacing of doubles at the exact value.

    A value of infinity counts as right where the exact one rounds to it.
    """
    out = []
    with mp.workprec(precision):
        overflow = mp.mpf(2) ** 1024 * (1 - mp.mpf(2) ** -54)
        for value, *point in zip(values, *arguments, strict=True):
            exact = EXACT[name](*(mp.mpf(float(x)) for x in point))
            if abs(exact) >= overflow:
                out.append(0.0 if value == np.copysign(np.inf, float(mp.sign(exact))) else np.inf)
                continue
            spacing = mp.ldexp(1, max(mp.frexp(exact)[1] - 53, -1074) if exact else -1074)
            out.append(float(abs(mp.mpf(float(value)) - exact) / spacing) if np.isfinite(value) else np.inf)
    return np.array(out)


def relative_errors(name, values, *arguments, precision=400, least=0.0):
    """Errors of wide numbers (parts, N), relative to the exact value, or to `least` where this is larger."""
    out = []
    with mp.workprec(precision):
        for i in range(values.shape[1]):
            exact = EXACT[name](*(mp.fsum(x[:, i].tolist()) for x in arguments))
            error = abs(mp.fsum(values[:, i].tolist()) - exact)
            out.append(float(error / max(abs(exact), mp.mpf(least))) if error else 0.0)
    return np.array(out)
