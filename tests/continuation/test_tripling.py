"""The direction of tripled solutions. Oracle: Arnold's normal form at 1/3, whose solutions are straight lines, in turned coordinates."""

import numpy as np
import pytest

from continuation import SwitchError
from continuation.switching import tripling_direction


class NormalForm:
    """i e z + c conj(z)^2 = 0 for z = x + i y with a further equation, s = e + x y; unknowns are a regular linear image of (e, x, y, s)."""

    def __init__(self, c, seed):
        self.c = c
        self.turn = np.random.default_rng(seed).normal(size=(4, 4)) + 2.0 * np.eye(4)

    def residual(self, unknowns):
        e, x, y, s = self.turn @ unknowns
        out = 1j * e * (x + 1j * y) + self.c * (x - 1j * y) ** 2
        return np.array([out.real, out.imag, s - e - x * y])

    def jacobian(self, unknowns):
        e, x, y, _ = self.turn @ unknowns
        z = x + 1j * y
        columns = [1j * z, 1j * e + 2.0 * self.c * z.conjugate(), -e - 2.0j * self.c * z.conjugate(), 0.0]
        rows = [[complex(v).real for v in columns], [complex(v).imag for v in columns], [-1.0, -y, -x, 1.0]]
        return np.array(rows) @ self.turn


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("c", [1.0, 0.3 - 2.0j])
def test_the_straight_lines_of_the_normal_form(c, seed):
    form = NormalForm(c, seed)
    known = np.linalg.solve(form.turn, [1.0, 0.0, 0.0, 1.0])
    scale = np.array([1.0, 0.5, 2.0, 1.0])
    e, x, y, _ = form.turn @ tripling_direction(form, np.zeros(4), known, scale)
    z = x + 1j * y
    assert abs(1j * e * z + c * z.conjugate() ** 2) < 1e-10 * abs(z) ** 2 and abs(z) > 1e-3
    assert abs(abs(e) / abs(z) - abs(c)) < 1e-10


def test_where_nothing_triples_it_is_said():
    form = NormalForm(1.0, 0)
    known = np.linalg.solve(form.turn, [1.0, 0.0, 0.0, 1.0])
    with pytest.raises(SwitchError, match="not three dimensions"):
        tripling_direction(form, 0.1 * known, known, np.ones(4))
    with pytest.raises(SwitchError, match="not decided at second order"):
        tripling_direction(NormalForm(0.0, 0), np.zeros(4), known, np.ones(4))
