"""The numbers of docs/limit.md. Oracles: closed forms of the orbits with impacts; the program computes the smooth families again, whose
events `branches/test_smooth_events.py` compares with many digits."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.optimize import brentq, minimize_scalar

import saltus
from benchmarks import backbone
from branches.orbit import Orbit
from branches.released.impact_limit import impact_limit
from bvp.multipoint import MultipointProblem
from tests.branches.test_impact_limit import scaled_orbit
from tests.branches.test_smooth_agreement import family, second
from transitions.response.tracing import trace_in_parameter

PAGE = (Path(__file__).parents[2] / "docs" / "limit.md").read_text(encoding="utf-8")


def table(begins: str, head: bool = False) -> list[list[str]]:
    """The rows of the table whose head begins so; first its head, if asked for."""
    first, _, *lines = PAGE[PAGE.index(begins) :].splitlines()
    rows = []
    for line in [first, *lines] if head else lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    assert rows
    return rows


def along_mode(mode: int, n: float, energy: tuple[float, float]):
    """The events of the family of a linear mode of the scene."""
    return family("smooth_wall", f"mode:{mode}", *energy, n=n).events


def test_quarter_periods_and_clearances():
    """All rows, from one family in 1/n, which is stable, as is its limit. Oracle of the clearances and of what they leave: equation (48)
    of the theory, whose speed and quarter period have closed forms."""
    scene = saltus.load_scene("smooth_wall")
    parametric = scene.parametric.in_reciprocal("n")
    problem = MultipointProblem(scene.system, ("origin", "rest"), ())
    start = problem.modes.from_state @ [0.0, 0.0, 2.47699186, 3.06373157]
    orbit = Orbit(problem, problem.solve(problem.pack(start, None, [1.65416952]), energy=5.0))
    rows = table("| n | d | alpha, smooth")
    marks = [1.0 / float(row[0]) for row in rows[:-1]]
    branch = trace_in_parameter(orbit, "1/n", (0.005, 1.0), keep="energy = 5", system=parametric, marks=marks)
    at = {round(1.0 / event.values["1/n"]): event.point for event in branch.events if event.type in ("UZ", "EP")}
    for row in rows:
        n, point = int(row[0]), at[int(row[0])]
        limit = impact_limit(parametric, "1/n", branch.orbit(point), branch.problem.parameters(branch.unknowns[point]))
        alpha = limit.smooth.alpha
        clearance, scaled = scaled_orbit(limit.orbit.system, n, 5.0)
        assert abs(limit.clearance / clearance - 1.0) < 1e-12 and abs(limit.scaled.alpha / scaled - 1.0) < 1e-12
        found = (limit.clearance, alpha, alpha - limit.orbit.alpha, alpha - limit.scaled.alpha, n * n * (alpha - limit.scaled.alpha))
        for text, value in zip(row[1:], found, strict=True):
            mantissa, _, exponent = text.partition("e")
            unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
            # half a unit of the last digit, and the rounding of a quarter period, which the last column multiplies
            assert abs(float(text) - value) <= 0.51 * unit + 1e-13 * n * n, (row, text, value)
        if n == 100:
            differ, leave = (f"{value:.1e}".replace("e-0", "e-") for value in (found[2], found[3]))
            assert f"n = 100 still differs by {differ}. The effective clearance leaves {leave} of it" in PAGE
    assert f"{limit.orbit.alpha:.10f}" in PAGE
    assert np.all(branch.columns["stable"]) and limit.orbit.stable is True and max(branch.parameter) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("n", [10, 14, 15, 20, 50, 100])
def test_the_folds_out_of_phase(n):
    """The row of n."""
    folds = [event.h for event in along_mode(2, float(n), (0.02, 0.12)) if event.type == "SN"]
    (row,) = [row for row in table("| n | upper fold") if str(n) in row[0].split(", ")]
    if row[1] == "none":
        assert not folds
    else:
        assert np.allclose(sorted(folds), [float(row[2]), float(row[1])], rtol=0.0, atol=1e-12)


def test_the_resonances_gather():
    """All rows approach the energy at which the mode reaches the walls, which is a closed form."""
    rows = table("| n | 2:5 | PD")
    frequencies, _, b = backbone.participation(saltus.load_scene().system)
    reached = 0.5 * (frequencies[0] / b[0]) ** 2
    assert PAGE.count(f"{reached:.8f}") == 2
    away = np.array([[abs(float(cell) - reached) for cell in row[1:]] for row in rows])
    assert np.all(away[0] > away[2]) and np.all(away[2, :4] > away[3, :4])


def test_both_folds_appear_together():
    """Oracle: DOP853, for a real power. The energy over the quarter period is a polynomial of Chebyshev near its point of inflection, where
    its slope is a smooth function of n and vanishes at the cusp. Rounding of 1e-14 leaves an error of 1e-11 in the slope, which rises by
    5e-3 for 1 in n. The page's digits are those of `saltus/test_curve_command.py`."""
    found = re.search(r"appear together, at n = ([\d.]+) and h = (0\.\d+)", PAGE)
    assert found
    cusp, h = map(float, found.groups())
    branch = family("smooth_wall", "mode:2", 0.02, 0.12, n=14.0)
    near, apart, degree = 1.266, 0.005, 6
    first = branch.orbit(int(np.argmin(np.abs(branch.points["alpha"] - near)))).velocities

    def inflection(n):
        other = replace(second(branch.system), power=2.0 * n + 1.0)

        def energy(alpha, velocities=first):
            for _ in range(6):
                end, columns = other.flown(np.append([0.0, 0.0], velocities), alpha)
                velocities = velocities - np.linalg.solve(columns[2:, 2:], end[2:])
            return 0.5 * velocities @ other.mass @ velocities

        curve = Chebyshev.interpolate(np.vectorize(energy), degree, domain=[near - apart, near + apart])
        place = min(curve.deriv(2).roots(), key=lambda root: abs(root - near)).real
        return curve.deriv()(place), curve(place)

    steps = np.array([-0.02, 0.0, 0.02])
    slopes, energies = np.polyfit(steps, [inflection(cusp + step) for step in steps], 2).T
    zero = min(np.roots(slopes), key=abs)
    assert abs(zero) < 1e-7 and abs(np.polyval(energies, zero) - h) < 1e-10


@pytest.mark.parametrize("n", [10, 20, 50, 100])
def test_the_resonances_in_phase(n):
    """The row of n, and its order."""
    head, *rows = table("| n | 2:5 | PD", head=True)
    (row,) = [row for row in rows if row[0] == str(n)]
    found = [event for event in along_mode(1, float(n), (0.05, 0.3)) if event.type in ("RT", "PD", "SB")]
    assert ["{}:{}".format(*event.p_q) if event.p_q else event.type for event in found] == head[1:]
    assert np.allclose([event.h for event in found], [float(cell) for cell in row[1:]], rtol=0.0, atol=0.51e-8)


@pytest.mark.parametrize("n", [10, 20, 50, 100])
def test_the_fold_approaches_the_grazing(n):
    """The row of n. The doubling is the last one before the fold."""
    (row,) = [row for row in table("| n | PD | SN") if row[0] == str(n)]
    events = along_mode(1, float(n), (0.05, 15.0))
    fold = next(event for event in events if event.type == "SN")
    doubling = [event for event in events if event.type == "PD" and event.point < fold.point][-1]
    assert [f"{doubling.h:.8f}", f"{fold.h:.8f}", f"{n * (touch() - fold.h):.1f}"] == row[1:]


def touch():
    """The energy at which the orbits with one impact a half period touch the other wall before it: by the closed form."""
    system = saltus.load_scene().system

    def clearance(alpha):
        def gap(part):
            displacement, _ = backbone.motion(system, alpha, np.array([part * alpha]))
            return float(displacement[0] @ np.array(system.stops[0].gap))

        return 1.0 + minimize_scalar(gap, bounds=(0.3, 0.6), method="bounded", options={"xatol": 1e-9}).fun

    return float(backbone.energy(system, brentq(clearance, 1.64, 1.642, xtol=1e-14)))


def test_the_grazing_is_a_nonsmooth_fold():
    """Oracles: the closed form of the grazing; two families below it, none beside it above."""
    assert PAGE.count(f"{touch():.8f}") >= 2
    branch = saltus.trace("S13O00+", energy=(10.0, 20.0))
    grazing = next(event for event in branch.events if event.type == "GR")
    assert grazing.h == pytest.approx(touch(), rel=1e-9) and branch.points["h"].max() == pytest.approx(grazing.h, rel=1e-12)
    (behind,) = [item for item in branch.neighbours(grazing, points=5) if item.branch and item.branch.label == "S13O11+"]
    assert behind.kind == "fold" and behind.branch.points["h"].max() == pytest.approx(grazing.h, rel=1e-9)


def test_the_family_with_impacts_out_of_phase():
    """Oracles: the closed forms of its beginning and of its fold."""
    system = saltus.load_scene().system
    frequencies, _, b = backbone.participation(system)
    fold = minimize_scalar(lambda alpha: backbone.energy(system, alpha), bounds=(1.1, 1.2), method="bounded", options={"xatol": 1e-9})
    begins = 0.5 * (frequencies[1] / b[1]) ** 2
    assert f"the out-of-phase mode, h = {begins:.8f}, leads to lower energies, and folds at h = {fold.fun:.8f}" in PAGE


def test_one_smooth_family_leads_to_several_with_impacts():
    """Oracles: DOP853, by which the sink is at rest at the impulsive orbit; the labels of the family with impacts of the last two."""
    branch = family("smooth_wall", "mode:1", 0.02, 15.0, n=100)
    parametric = saltus.load_scene("smooth_wall").parametric.in_reciprocal("n")
    fold, impulsive = (next(event for event in branch.events if event.type == code) for code in ("SN", "IO"))
    labels = []
    for h, begin, end in ((10.0, 0, fold.point), (5.0, fold.point, impulsive.point), (1.0, impulsive.point, impulsive.point + 100)):
        point = begin + int(np.argmin(np.abs(branch.points["h"][begin:end] - h)))
        labels.append(impact_limit(parametric, "1/n", branch.orbit(point), {"mu": 0.1, "sigma": 0.1, "1/n": 0.01}).orbit.label)
    assert labels == ["S13O00+", "S13O11+", "S33O11-"]
    assert set(labels[1:]) <= set(saltus.trace("S13O11+", energy=(0.5, 15.0)).points["label"])
    assert f"behind the impulsive orbit at h = {impulsive.h:.4f} to S33O11-" in PAGE
    velocities, _, _ = second(branch.system).quarter(branch.orbit(impulsive.point).velocities, impulsive.alpha, impulsive.h)
    assert abs(velocities[0]) < 1e-9 * abs(velocities[1])


def test_where_the_second_contact_is_slow():
    """Oracle: DOP853 to the turning point of the gap inside the quarter: there the spring's force is that of all others."""
    branch = family("smooth_wall", "mode:1", 0.02, 15.0, n=100)
    other = second(branch.system)
    weight = float(other.row @ np.linalg.solve(other.mass, other.row))
    fold = next(event for event in branch.events if event.type == "SN")

    def excess(energy):
        (orbit,) = [orbit for orbit in branch.orbits_at(energy=energy) if orbit.alpha < fold.alpha]
        velocities, quarter, _ = other.quarter(np.array(orbit.velocities), orbit.alpha, energy)

        def at(part):
            return other.flown(np.append([0.0, 0.0], velocities), part * quarter)[0]

        state = at(brentq(lambda part: other.row @ at(part)[2:], 0.3, 0.6, xtol=1e-12))
        w = float(other.row @ state[:2])
        push, change = weight * abs(w) ** other.power, float(other.row @ other.rate(state)[2:])
        return push - abs(change + math.copysign(push, w))

    assert f"Between the fold and h = {brentq(excess, 12.0, 13.0, xtol=1e-4):.2f} the second contact is slow" in PAGE
