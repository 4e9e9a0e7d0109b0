"""Named tuples that kernels pass to each other by their address."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.compiler import dispatcher, intermediate_code, machine_code
from bvp.kernels.stored import types_of


class Pair(NamedTuple):
    """Equal types."""

    first: np.ndarray
    second: np.ndarray


class Mixed(NamedTuple):
    """Different types, one of them a tuple."""

    pair: Pair
    number: int
    factor: float


@kernel
def weighted(mixed, i):
    """Sum of one entry of each array."""
    total = 0.0
    for k in range(mixed.number):
        mixed.pair.second[i] += 1.0  # what lies behind the arrays may change
        total += mixed.factor * mixed.pair.first[i] - mixed.pair.second[i] + k
    return total


@kernel
def product(a, b):
    """A kernel that an inlined one calls."""
    return a * b


@inlined
def scaled(mixed, factor):
    """Another tuple with the same arrays."""
    return Mixed(mixed.pair, mixed.number, product(factor, mixed.factor))


@kernel
def chosen(mixed, other, swap):
    """One of two tuples, after it was passed on, in a branch and in a loop."""
    before = mixed
    for k in range(4):
        last = before
        if (k + swap) % 2 == 0:
            before = other
        else:
            before = scaled(mixed, 2.0 + k)
        before.pair.first[0] += weighted(last, k % 2) - weighted(before, 1)
    return before


@kernel
def exchanged(mixed, other, out):
    """Two variables that exchange their tuples; the result of a call is passed to the next one."""
    one, two = mixed, other
    for k in range(out.shape[0]):
        one, two = two, one
        found = chosen(one, scaled(two, 0.5), k)
        out[k] = weighted(found, 0) + weighted(one, 1) - weighted(scaled(found, 3.0), 0)
    return two.factor


def arguments():
    """Two tuples and an array, for `exchanged`."""
    first, second, third = np.arange(12.0).reshape(3, 4)
    return Mixed(Pair(first, second), 3, 0.5), Mixed(Pair(second.copy(), third), 2, -2.0), np.zeros(5)


def test_tuples_keep_their_values_through_calls_branches_and_loops():
    """Oracle: the same functions as Python runs them, with exact arithmetic."""
    expected, found = arguments(), arguments()
    namespace: dict[str, object] = {"Pair": Pair, "Mixed": Mixed}
    for one in (product, weighted, scaled, chosen, exchanged):
        function = type(one.function)(one.function.__code__, namespace, one.function.__name__)
        namespace[one.function.__name__] = function
    assert exchanged(*found) == function(*expected)
    for mine, theirs in zip(found[:2], expected[:2], strict=True):
        for array, other in zip(mine.pair, theirs.pair, strict=True):
            assert array.tolist() == other.tolist()
    assert found[2].tolist() == expected[2].tolist() and np.all(found[2] != 0.0)


def test_what_an_inlined_kernel_calls_is_not_inlined_for_that():
    """Oracle: the attributes of the intermediate code. The code of a kernel must not depend on what was compiled before it."""
    machine_code(exchanged, types_of(arguments()), "exchanged")
    marked = {}
    for one in (product, scaled):
        (compiled,) = dispatcher(one).overloads.values()
        (function,) = [item for item in intermediate_code(compiled)._final_module.functions if not item.is_declaration]
        marked[one] = any(b"alwaysinline" in attributes for attributes in function.attributes)
    assert marked == {product: False, scaled: True}
