"""The numbers of docs/limit.md. Oracle: the program computes them again where that takes seconds; orders of convergence for the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import saltus
from branches.naming.at_modes import orbit_at_mode
from branches.orbit import Orbit
from branches.released.impact_limit import impact_limit
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from transitions.response.tracing import trace_in_parameter

PAGE = (Path(__file__).parents[2] / "docs" / "limit.md").read_text(encoding="utf-8")


def table(head: str) -> list[list[str]]:
    """The rows of the table whose head begins so."""
    lines = PAGE[PAGE.index(head) :].splitlines()[2:]
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    assert rows
    return rows


def along_mode(mode: int, n: float, energy: tuple[float, float]):
    """The events of the family of a linear mode of the scene."""
    system = saltus.load_scene("smooth_wall", n=n).system
    orbit = orbit_at_mode(f"mode:{mode}", system, energy)
    return follow_family(orbit.problem, orbit.solution.y, energy=energy).events


def test_quarter_periods_and_clearances():
    """All rows, from one family in 1/n."""
    scene = saltus.load_scene("smooth_wall")
    parametric = scene.parametric.in_reciprocal("n")
    problem = MultipointProblem(scene.system, ("origin", "rest"), ())
    start = problem.modes.from_state @ [0.0, 0.0, 2.47699186, 3.06373157]
    orbit = Orbit(problem, problem.solve(problem.pack(start, None, [1.65416952]), energy=5.0))
    rows = table("| n | d | alpha, smooth")
    marks = [1.0 / float(row[0]) for row in rows[1:-1]]
    branch = trace_in_parameter(orbit, "1/n", (0.005, 0.1), keep="energy = 5", system=parametric, marks=marks)
    at = {round(1.0 / event.values["1/n"]): event.point for event in branch.events if event.type in ("UZ", "EP")}
    for row in rows:
        n, point = int(row[0]), at[int(row[0])]
        limit = impact_limit(parametric, "1/n", branch.orbit(point), branch.problem.parameters(branch.unknowns[point]))
        alpha = limit.smooth.alpha
        found = (limit.clearance, alpha, alpha - limit.orbit.alpha, alpha - limit.scaled.alpha, n * n * (alpha - limit.scaled.alpha))
        for text, value in zip(row[1:], found, strict=True):
            mantissa, _, exponent = text.partition("e")
            unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
            # half a unit of the last digit, and the rounding of a quarter period, which the last column multiplies
            assert abs(float(text) - value) <= 0.51 * unit + 1e-13 * n * n, (row, text, value)
    assert f"{limit.orbit.alpha:.10f}" in PAGE


@pytest.mark.parametrize("n", [10, 14, 15, 20])
def test_the_folds_out_of_phase(n):
    """Rows to n = 20."""
    folds = [event.h for event in along_mode(2, float(n), (0.02, 0.12)) if event.type == "SN"]
    (row,) = [row for row in table("| n | upper fold") if str(n) in row[0].split(", ")]
    if row[1] == "none":
        assert not folds
    else:
        assert np.allclose(sorted(folds), [float(row[2]), float(row[1])], rtol=0.0, atol=1e-12)


def test_the_resonances_in_phase():
    """The row n = 20; and all rows approach the energy at which the mode reaches the walls."""
    rows = table("| n | 2:5 | PD")
    (row,) = [row for row in rows if row[0] == "20"]
    found = [event.h for event in along_mode(1, 20.0, (0.05, 0.3)) if event.type in ("RT", "PD", "SB")]
    assert np.allclose(found, [float(cell) for cell in row[1:]], rtol=0.0, atol=1e-8)
    reached = saltus.linear_modes(saltus.load_scene().system)[0].energies[1]
    assert abs(reached - 0.11850781) < 1e-8
    away = np.array([[abs(float(cell) - reached) for cell in row[1:]] for row in rows])
    assert np.all(away[0] > away[2]) and np.all(away[2, :4] > away[3, :4])


def test_the_fold_approaches_the_grazing():
    """All rows: the distance times n is the one that is given, and the period doubling lies before the fold."""
    for n, doubling, fold, scaled in table("| n | PD | SN"):
        assert abs(int(n) * (14.55370109 - float(fold)) - float(scaled)) <= 0.05
        assert 0.0 < float(fold) - float(doubling) < 4.0 / int(n)
