"""Kernels that come in kinds: the type of the first argument selects one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from bvp.kernels.compiled import chosen, inlined, kernel
from bvp.kernels.stored import require_imported


class Square(NamedTuple):
    side: np.ndarray


class Disc(NamedTuple):
    radius: float
    colour: np.ndarray


@chosen
def area(shape, factor):
    """Area of a shape, times a factor."""


@area.of(Square)
@inlined
def area_of_square(shape, factor):
    return factor * shape.side[0] ** 2


@area.of(Disc)
@kernel
def area_of_disc(shape, factor):
    return factor * 3.0 * shape.radius**2


@kernel
def total(shape, factors):
    found = 0.0
    for k in range(factors.shape[0]):
        found += area(shape, factors[k])
    return found


def test_the_type_of_the_first_argument_selects_the_kernel():
    """Oracle: the formulas."""
    factors = np.array([1.0, 2.0])
    assert total(Square(np.array([2.0])), factors) == 12.0
    assert total(Disc(2.0, factors), factors) == 36.0
    assert total(Square(np.array([1.0])), factors) == 3.0
    assert area(Disc(1.0, factors), 1.0) == 3.0


def test_a_kernel_imports_the_kinds_that_it_contains():
    """Its machine code is found by the sources that it imports. A kind declared elsewhere would change it unseen."""
    require_imported("bvp.kernels.taylor", "bvp.kernels.driving")
    with pytest.raises(TypeError, match=r"bvp\.kernels\.flight contains one of bvp\.kernels\.driving, which it does not import"):
        require_imported("bvp.kernels.flight", "bvp.kernels.driving")
