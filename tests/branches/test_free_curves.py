"""Curves of bifurcations and of grazings of free orbits in two parameters.

Oracles: closed forms of orbits with one impact in half a period or in a period, in many digits; the events of the families that pass
through points of a curve; the same orbits solved between other ends; differences of a matrix.
"""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.backbone import OneImpact
from branches.curves.free import BOTH, FOLD, SYMMETRIES, Breaking, Turned, free_condition, smallest_singular
from branches.curves.free_monitor import FreeMonitor
from branches.curves.free_points import event_of, observed_free
from branches.curves.free_start import free_curve_start, released_of
from branches.curves.grazing_monitor import enter_least
from branches.curves.plane import plane_of
from branches.curves.single_orbits import narrowed, widened
from branches.curves.starting import curve_start
from branches.curves.tracing import follow_curve
from branches.family import SETTINGS
from branches.linear_modes import linear_modes
from branches.presentation import canonical_orbit, closed_presentation, is_solved_as_it_is
from branches.released.presentation import released_orbit
from branches.released.segments import changed, segment_of
from branches.switching import emanating_families
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.system import vibro_impact_nes
from continuation.curves import Curve
from continuation.run import follow_both_ways
from saltus import trace
from tests.branches.curve_oracles import DIGITS, ReferenceBackbone, double_breaking
from tests.branches.test_released import chain
from tests.bvp.orbits import collection

SYSTEM = vibro_impact_nes(mu=0.1, sigma=0.1)
NES = ParametricSystem.of(SYSTEM)
FREE = (0.0, math.inf)

COARSE = replace(SETTINGS, initial_step=0.05, maximum_step=0.1, target_turn=0.15)
"""Longer steps than those of figures."""


@pytest.fixture(scope="module")
def branches():
    """Families of the reference system, by label, and at mu = 0.2 the in-phase backbone."""
    found = {label: trace(label, SYSTEM, energy=(0.06, 4.0)) for label in ("S11O00-", "S13O00+", "U21-", "S31O11-")}
    return found | {"mu = 0.2": trace("S13O00+", vibro_impact_nes(mu=0.2, sigma=0.1), energy=(0.06, 4.0))}


def of_type(branch, code, number=1):
    return [event for event in branch.events if event.type == code][number - 1]


def start(branch, code, names, window, keep=(), number=1, parametric=None):
    """Plane, curve and first unknowns at an event of a branch."""
    problem, y = released_of(branch.orbit(of_type(branch, code, number).point), names, parametric)
    return free_curve_start(problem, y, code, names, keep, window)


def followed(plane, curve, y):
    """The run, and all parameters at each of its points."""
    begin = curve.begin(y)
    assert begin.converged and np.max(np.abs((begin.y - y) / plane.scales(y))) < 1e-9
    run = follow_both_ways(curve, begin, COARSE)
    return run, [plane.values(point.step.y) for point in run.points]


def places(plane, run, code):
    """The parameters at the events of a type."""
    return [plane.linearised(event.point.y).parameters.tolist() for event in run.events if event.code == code]


def distance(value, wanted):
    """Relative difference from a number in many digits."""
    with mp.workdps(DIGITS):
        return float(abs(mp.mpf(value) / wanted - 1))


def require_reference(points, point_of, energy=1e-11):
    """Each point is that of the closed form at its mu and sigma."""
    for values in points:
        wanted = point_of(ReferenceBackbone(values["mu"], values["sigma"]), values)
        assert distance(values["energy"], wanted.h) < energy
        assert distance(values["quarter_period"], wanted.alpha) < energy


@pytest.mark.parametrize(("name", "low"), [("mu", 0.02)])
def test_fold_of_the_out_of_phase_backbone(branches, name, low):
    require_fold_of_the_out_of_phase_backbone(branches, name, low)


def require_fold_of_the_out_of_phase_backbone(branches, name, low):
    plane, curve, y = start(branches["S11O00-"], "SN", ("energy", name), (FREE, (low, 1.0)))
    assert plane.names == (name, "energy")
    run, points = followed(plane, curve, y)
    require_reference(points[::4], lambda line, _: line.fold())
    ends = sorted(point[name] for point in (points[0], points[-1]))
    assert ends == pytest.approx([low, 1.0], rel=1e-12)
    # A cusp would need a third orbit: the energy has one minimum along this backbone.
    assert not places(plane, run, "CP")


def breaking(line, values):
    """The symmetry breaking that is nearest to a point: two of them coalesce at the turn."""
    found = []
    for order in (0, 1):
        try:
            found.append(line.symmetry_breaking(order=order))
        except ValueError:
            break
    return min(found, key=lambda point: abs(point.alpha - values["quarter_period"]))


def test_symmetry_breaking_in_sigma_and_the_double_one(branches):
    """It crosses that of the other kind where the half map is -1: oracle `double_breaking`."""
    plane, curve, y = start(branches["S13O00+"], "SB", ("energy", "sigma"), (FREE, (0.05, 1.0)))
    run, points = followed(plane, curve, y)
    require_reference(points[1:-1:4], breaking)
    (double,) = places(plane, run, "R2")
    value, at = double_breaking(points[0]["quarter_period"], 0.1, 0.0738, "sigma")
    assert distance(double[0], value) < 1e-11 and distance(double[1], at.h) < 1e-11


def test_the_other_symmetry_breaking(branches):
    """At mu = 0.2 both kinds exist. The stops are kept where the perturbation is antisymmetric about the start."""
    branch = branches["mu = 0.2"]
    parametric = ParametricSystem.of(branch.system)
    plane, curve, y = start(branch, "SB", ("mu", "energy"), ((0.15, 0.3), FREE), parametric=parametric)
    assert curve.monitor.symmetry == (True, False)
    _, points = followed(plane, curve, y)
    require_reference(points[::5], lambda line, values: line.symmetry_breaking("stop", 0))


def test_in_two_parameters_of_the_system_at_one_energy(branches):
    """The energy of the fold is the one that is kept."""
    energy = of_type(branches["S11O00-"], "SN").h
    names, window = ("sigma", "mu"), ((0.02, 1.0), (0.05, 0.2))
    plane, curve, y = start(branches["S11O00-"], "SN", names, window, keep=(f"energy = {energy!r}",))
    assert plane.names == names
    _, points = followed(plane, curve, y)
    assert max(abs(values["energy"] / energy - 1.0) for values in points) < 1e-13
    require_reference(points[::5], lambda line, _: line.fold())


@pytest.mark.parametrize(("names", "keep"), [(("quarter_period", "mu"), None), (("mu", "sigma"), "quarter_period = {alpha!r}")])
def test_fold_in_the_energy_over_the_quarter_period(branches, names, keep):
    """The surface of orbits has no fold over this plane. The curve is that of the folds in the energy."""
    event = of_type(branches["S11O00-"], "SN")
    kept = () if keep is None else (keep.format(alpha=event.alpha),)
    window = (FREE, (0.05, 0.2)) if keep is None else ((0.05, 0.2), (0.05, 0.2))
    plane, curve, y = start(branches["S11O00-"], "SN", names, window, keep=kept)
    _, points = followed(plane, curve, y)
    assert len(points) > 4
    require_reference(points[::3], lambda line, _: line.fold())


@pytest.mark.parametrize(("label", "mode"), [("S11O00-", 1), ("S13O00+", 0)])
def test_impact_that_vanishes_on_a_linear_mode(branches, label, mode):
    """Oracle: h = w^2/(2 b^2)."""
    plane, curve, y = start(branches[label], "GR", ("energy", "mu"), (FREE, (0.06, 0.3)))
    _, points = followed(plane, curve, y)
    assert len(points) > 10
    for values in points:
        w, b = ReferenceBackbone(values["mu"], values["sigma"]).modes[mode]
        assert distance(values["energy"], w * w / (2 * b)) < 1e-12


def touch_at_rest(mu, half):
    """Near a guess in many digits: an orbit with one impact a period, which is at rest half a period later, where it touches the other stop
    and the gap is not accelerated. A mode with the square b of its part in the gap moves it by J b cos(w (t - T/2))/(2 w sin(w T/2))."""
    with mp.workdps(DIGITS):

        def modes(mu, half):
            return [(w, b, mp.sin(w * half), mp.cos(w * half)) for w, b in ReferenceBackbone(mu, "0.1").modes]

        def conditions(mu, half):
            parts = modes(mu, half)
            return sum(b * (c + 1) / (w * s) for w, b, s, c in parts), sum(b * w / s for w, b, s, _ in parts)

        mu, half = mp.findroot(conditions, (mp.mpf(mu), mp.mpf(half)))
        parts = modes(mu, half)
        kick = 1 / sum(b * c / (2 * w * s) for w, b, s, c in parts)
        return mu, sum(b * (kick / (2 * s)) ** 2 for w, b, s, _ in parts) / 2


def test_touch_that_comes_to_an_end_at_rest(branches):
    """The curve is singular there: it is located on the curve of touches at the end itself."""
    branch = branches["U21-"]
    other = next(iter(emanating_families(branch, of_type(branch, "SB"))))
    closed = follow_family(other.problem, other.step.y, energy=(0.3, 2.0))
    problem, y = released_of(closed.orbit(of_type(closed, "GR").point), ("mu", "energy"))
    curve = follow_curve(curve_start(problem, y, "GR", ("mu", "energy")), ((0.09, 1.0), FREE))
    assert "rest" in curve.plane.problem.ends
    (end,) = [event for event in curve.events if event.type == "GR-GR"]
    assert end.status == "located" and "at rest" in end.note and end.point in (0, len(curve) - 1)
    for value, wanted in zip(curve.parameters[end.point], touch_at_rest(0.17, 3.69), strict=True):
        assert distance(float(value), wanted) < 1e-11
    # Where the range ends before that point, the curve does, too.
    short = follow_curve(curve_start(problem, y, "GR", ("mu", "energy")), ((0.09, 0.1705), FREE))
    assert short.parameters[:, 0].max() == pytest.approx(0.1705, rel=1e-12)
    assert sorted(event.type for event in short.events if event.point in (0, len(short) - 1)) == ["EP", "EP"]


def events_at(plane, y):
    """The events, with relative energy, of the family in the energy that passes through an orbit of a curve."""
    plain, at = plane.problem.orbit_problem(y)
    if not is_solved_as_it_is(plain, at):
        plain, at = canonical_orbit(plain, at)
    energy = plain.energy(at)
    for part in (1.001, 0.999, 1.003, 0.997):
        try:
            beside = plain.solve(at, energy=part * energy)
            family = follow_family(plain, beside.y, energy=(0.99 * energy, 1.01 * energy))
        except (RuntimeError, ValueError):
            continue
        return [(event.type, abs(event.h / energy - 1.0), event.note) for event in family.events]
    raise AssertionError("no orbit of a family beside that of the curve")


CASES = {
    "doubling of a quarter period": ("S11O00-", "PD", 1, "PD", ("origin", "origin"), "period doubling"),
    "doubling, with an inner impact": ("S31O11-", "PD", 1, "PD", ("origin", "origin"), "period doubling"),
    "half-period symmetry": (
        "S31O11-", "SB", 1, "SB", ("origin", "stop+"), "half-period symmetry breaks, the reversal about the start stays",
    ),  # fmt: skip
    "last reversal": ("U21-", "SB", 1, "SB", ("origin", "origin"), "the last reversal is broken"),
    "touch": ("U21-", "GR", 1, "GR", ("origin", "origin"), "vanishes"),
    "branch point": ("U21-", "BP", 1, "SB", ("origin", "stop+"), "half-period symmetry breaks, the reversal about the start stays"),
}


@pytest.mark.parametrize("case", CASES)
def test_families_through_points_of_a_curve_have_the_event_there(branches, case):
    """Oracle: located events of families in the energy, by test functions from the half map."""
    label, code, number, kind, ends, note = CASES[case]
    plane, curve, y = start(branches[label], code, ("energy", "mu"), (FREE, (0.095, 0.13)), number=number)
    assert plane.problem.ends == ends and getattr(curve.monitor, "code", "GR") == kind
    run, points = followed(plane, curve, y)
    assert len(points) > 4
    for place in (len(points) // 4, len(points) - 2):
        found = events_at(plane, run.points[place].step.y)
        assert min(apart for one, apart, words in found if one == kind and note in words) < 1e-11, found


REST = [0.0, 0.0, 4.2027619572429895, 1.822285030510867], [0.42437832, 1.21328014], 2.5435217696744417
"""Start, flight times and energy of an orbit with an inner impact that comes to rest near a stop."""


def test_end_at_rest_that_touches_a_stop_is_a_stop_without_speed():
    state, times, energy = REST
    plain = MultipointProblem(SYSTEM, ("origin", "rest"), ("+",))
    orbit = plain.solve(plain.pack(plain.modes.from_state @ np.array(state), None, times), energy=energy)
    branch = follow_family(plain, orbit.y, energy=(2.5, 2.6))
    plane, curve, y = start(branch, "GR", ("energy", "mu"), (FREE, (0.09, 0.11)))
    assert plane.problem.ends == ("origin", "stop-") and plane.problem.sequence == ("+",)
    run, _ = followed(plane, curve, y)
    for point in run.points[::4]:
        found = events_at(plane, point.step.y)
        assert min(apart for one, apart, _ in found if one == "GR") < 1e-11


@pytest.fixture(scope="module")
def one_sided():
    """A chain of three masses with one impact a period on a one-sided stop, between rest and the stop."""
    parametric = chain(lower=None)
    system, period = parametric.system(), 3.4
    u, _, _ = backbone.one_sided(system, period)
    w, shapes, _ = backbone.participation(system)
    at_rest = shapes @ ((shapes.T @ u) / np.cos(w * period / 2.0))
    plain = MultipointProblem(system, ("rest", "stop+"), ())
    guess = plain.pack(plain.modes.from_state @ np.array([*at_rest, 0.0, 0.0, 0.0]), None, [period / 2.0])
    return parametric, follow_family(plain, plain.solve(guess, quarter_period=period / 4.0).y, energy=(0.05, 8.0))


def test_fold_of_a_chain_of_three_masses(one_sided):
    """Oracle: the energy of the closed form is stationary."""
    parametric, branch = one_sided
    plane, curve, y = start(branch, "SN", ("energy", "k"), (FREE, (0.5, 0.9)), parametric=parametric)
    _, points = followed(plane, curve, y)
    for values in points[:: len(points) // 3]:
        alpha, energy = stationary(OneImpact(parametric.system({"k": values["k"]})), values["quarter_period"])
        assert distance(values["energy"], energy) < 1e-11
        assert distance(values["quarter_period"], alpha) < 1e-9


def stationary(form, near):
    """Quarter period and energy of a closed form where the energy is stationary."""

    def slope(alpha):
        return mp.diff(lambda x: form.one_sided(x)[0], alpha, h=mp.mpf(10) ** -12)

    with mp.workdps(DIGITS):
        alpha = mp.findroot(slope, (mp.mpf(near) - 1e-6, mp.mpf(near) + 1e-6), solver="secant", tol=1e-40)
        return alpha, form.one_sided(alpha)[0]


def conditions_of(plane):
    """All conditions of a surface of orbits, each with the code and the words of its event."""
    problem = plane.problem
    if problem.structure.periodic:
        return {("SN", "fold"): free_condition(plane, "SN"), ("PD", "period doubling"): free_condition(plane, "PD")}
    breaking = Breaking(plane)
    found = {event_of(problem, symmetry): breaking.condition(symmetry) for symmetry in SYMMETRIES}
    return found | {("SN", "fold"): free_condition(plane, "SN")}


def families(branches):
    """Families of many ends and sequences. Multiple covers, at whose events several matrices are singular, are left out."""
    yield from branches.values()
    wanted = {("rest", "rest"), ("rest", "origin"), ("rest", "stop-")}
    for orbit in collection():
        problem, energy = orbit.problem, orbit.problem.energy(orbit.solution.y)
        if problem.ends in wanted and problem.inner == 3 - (problem.ends[1] == "origin") and is_solved_as_it_is(problem, orbit.solution.y):
            yield follow_family(problem, orbit.solution.y, energy=(0.7 * energy, 1.4 * energy), points=60)


def test_one_matrix_is_singular_at_an_event_and_no_other(branches):
    """Oracle: located events of families in the energy, by test functions from the half map."""
    kinds, count = set(), 0
    for branch in families(branches):
        parametric = ParametricSystem.of(branch.system)
        for event in (event for event in branch.events if event.type in ("SN", "SB", "PD")):
            here = branch.orbit(event.point)
            plane, y = plane_of(*released_of(here, ("energy", "mu"), parametric), ("energy", "mu"))
            at, scale = plane.linearised(y), plane.scales(y)
            sizes = {words: smallest_singular(condition, at, scale) for words, condition in conditions_of(plane).items()}
            singular = {words for words, (least, second) in sizes.items() if least < 1e-9 * second}
            if event.id == "SN1" and branch is branches["S31O11-"]:
                continue  # next to the branch point, it is located to 1e-5 only
            # A quarter period doubles where its half map has the eigenvalues +-i: no matrix of the quarter is singular.
            none = event.type == "PD" and branch.problem.quarters == 1
            assert singular == (set() if none else {(event.type, "fold" if event.type == "SN" else event.note)})
            assert all(sizes[words][0] < 1e-12 for words in singular)
            kinds.add((event.type, *branch.problem.kinds))
            count += 1
    assert count >= 15 and len(kinds) >= 7, (count, kinds)


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize(
    "ends", [("origin", "origin"), ("origin", "stop"), ("stop", "origin"), ("stop", "stop"), ("rest", "origin"), ("rest", "rest")]
)
def test_derivatives_of_a_critical_matrix(ends, symmetry):
    """Oracle: central differences of the matrix times its null vector, at an orbit where the number is not zero: those of the rows that do
    not vanish with it."""
    orbit = next(one for one in collection() if tuple(end.rstrip("+-") for end in one.problem.ends) == ends and one.problem.sequence)
    problem, energy = orbit.problem, orbit.problem.energy(orbit.solution.y)
    parametric, sequence = ParametricSystem.of(problem.system), problem.sequence
    keep = [f"sigma = {parametric.values['sigma']!r}", f"energy = {energy!r}"]
    released = ReleasedProblem(parametric, problem.ends, sequence, ("mu", "sigma"), keep, energy=energy)
    plane, y = plane_of(released, released.of_orbit(problem, orbit.solution.y), ("mu", "sigma"), [f"energy = {energy!r}"])
    breaking, scale = Breaking(plane), plane.scales(y)
    condition = breaking.condition(symmetry)
    rng = np.random.default_rng(5)
    direction, along = (rng.standard_normal(plane.size) * scale for _ in range(2))
    direction[released.place] = 0.0  # where the energy is freed, the first parameter is no part of a perturbation
    step = 1e-5
    ahead, back = (breaking.matrix(plane.linearised(y + sign * step * along), symmetry) @ direction for sign in (1.0, -1.0))
    wanted = (ahead - back) / (2.0 * step)
    found = condition._whole_slopes(plane.linearised(y), direction[None], np.zeros(0)) @ along
    assert found == pytest.approx(wanted, abs=2e-7 * np.max(np.abs(wanted)))


@pytest.mark.parametrize(("label", "code"), [("S11O00-", "SN"), ("S13O00+", "SB"), ("S31O11-", "PD"), ("S11O00-", "GR"), ("U21-", "GR")])
def test_steps_stay_on_the_curve(branches, label, code):
    """Oracle: the residual, and the condition's gradient, to which the tangent is at right angles."""
    plane, curve, y = start(branches[label], code, ("energy", "mu"), (FREE, (0.02, 1.0)))
    begin = curve.begin(y)
    for ds in (0.0, 0.03, -0.05, 1e-3):
        corrected = curve.corrected(begin.y, begin.tangent, ds)
        assert corrected.residual < 1e-12
        assert corrected.held.gradient @ corrected.along == pytest.approx(0.0, abs=1e-10 * np.max(np.abs(corrected.held.gradient)))


@pytest.mark.parametrize("window", ["as it is", "twice", "closed", "half", "half of a half"])
def test_changes_of_a_segment(branches, window):
    """Oracle: central differences."""
    plane, _, y = start(branches["S31O11-"], "PD", ("energy", "mu"), (FREE, (0.02, 1.0)))
    problem, scale = plane.problem, plane.scales(y)
    assert problem.quarters == 2
    windows = {
        "as it is": lambda segment, change: change or segment,
        "twice": lambda segment, change: (change or segment).backwards().twice(),
        "closed": lambda segment, change: (change or segment).twice().closed(),
        "half": lambda segment, change: segment.half(problem, change),
        "half of a half": lambda segment, change: segment.half(problem, change).twice().twice(),
    }
    way = np.random.default_rng(3).standard_normal(plane.size) * scale
    ahead, behind = (windows[window](segment_of(problem, y + sign * 1e-5 * way), None) for sign in (1.0, -1.0))
    here = segment_of(problem, y)
    found = windows[window](here, changed(problem, y, way))
    assert (found.ends, found.sequence) == (ahead.ends, ahead.sequence)
    for name in ("after", "before", "times", "parameters"):
        wanted = (getattr(ahead, name) - getattr(behind, name)) / 2e-5
        assert getattr(found, name) == pytest.approx(wanted, abs=1e-7 * max(1.0, np.max(np.abs(wanted)))), name


def test_doubling_of_orbits_closed_on_themselves(branches):
    """Oracle: the same orbits between two reversals."""
    doubled = branches["S11O00-"].switch("PD1", energy=(0.05, 1.0), points=200)[0]
    window = FREE, (0.09, 0.11)
    plane, curve, y = start(doubled, "PD", ("energy", "mu"), window)
    assert plane.problem.ends == ("origin", "origin") and curve.monitor.symmetry in SYMMETRIES[1:]
    _, between = followed(plane, curve, y)
    orbit = doubled.orbit(of_type(doubled, "PD").point)
    cycle = orbit.cycle
    plain = MultipointProblem(SYSTEM, ("periodic", "periodic"), cycle.letters)
    at = plain.solve(plain.pack(cycle.after[0], cycle.after[1:], cycle.duration), energy=orbit.h).y
    problem, unknowns = released_orbit(plane.problem, plane.problem.parameters(y), plain, at)
    plane, unknowns = plane_of(problem, unknowns, ("energy", "mu"))
    monitor = FreeMonitor(plane, "PD", FOLD, (window[1], window[0]))
    run, closed = followed(plane, Curve(plane, free_condition(plane, "PD"), monitor), unknowns)
    assert np.max(np.abs([point.step.y[plane.problem.place - 1] for point in run.points])) < 1e-12
    # Both runs end at mu = 0.09 and 0.11.
    ends = [sorted((values[0]["mu"], values[0]["energy"]) for values in (points, points[::-1])) for points in (between, closed)]
    assert ends[0] == [pytest.approx(end, rel=1e-10) for end in ends[1]]


def test_refusals(branches):
    problem, y = released_of(branches["S31O11-"].orbit(of_type(branches["S31O11-"], "BP").point), ("energy", "mu"))
    with pytest.raises(ValueError, match="p:q resonance"):
        free_curve_start(problem, y, "BP", ("energy", "mu"), (), (FREE, FREE))
    with pytest.raises(ValueError, match="no perturbation"):
        free_curve_start(problem, y, "SB", ("energy", "mu"), (), (FREE, FREE))
    with pytest.raises(ValueError, match="type RT"):
        free_curve_start(problem, y, "RT", ("energy", "mu"), (), (FREE, FREE))
    orbit = branches["S31O11-"].orbit(0)
    with pytest.raises(ValueError, match="a plane needs a parameter of the system"):
        released_of(orbit, ("energy", "quarter_period"))
    with pytest.raises(ValueError, match="unknown parameter kappa; expected one of"):
        released_of(orbit, ("energy", "kappa"))
    plane, _ = plane_of(problem, y, ("energy", "mu"))
    with pytest.raises(ValueError, match="breaks no symmetry"):
        free_condition(plane, "SB", FOLD)


def test_turned_ends_have_as_many_rows():
    problem = ReleasedProblem(NES, ("origin", "stop+"), (), ("mu",), ("energy = 0.5",))
    turned = Turned(problem)
    assert turned.unknowns == problem.unknowns and turned.end_rows.shape == problem.end_rows.shape
    assert free_condition(plane_of(problem, problem.pack([[0, 0, 1, 1]], [0], [0.1], [1.0]), ("mu", "energy"))[0], "SB", BOTH).own == 0


@pytest.mark.parametrize(("label", "ends"), [("S13O00+", None), ("S31O11-", None), ("U21-", ("origin", "origin"))])
@pytest.mark.parametrize("first", [0, 1])
def test_closed_orbits_with_a_reversal_or_that_run_twice_are_known(branches, label, ends, first):
    """Oracle: the orbit as it was followed."""
    orbit = branches[label].orbit(len(branches[label]) // 2)
    problem, y = released_of(orbit, ("mu", "energy"))
    plain, at = problem.orbit_problem(y)
    for cover in (1, 2):
        closed = closed_presentation(cycle_of(plain, at), cover, first)
        wide = MultipointProblem(plain.system, closed.ends, closed.sequence)
        made, whole = released_orbit(problem, problem.parameters(y), wide, closed.unknowns(wide))
        narrow = narrowed(made, whole)
        assert narrow.apart < 1e-11 and narrow.code == ("SB" if cover == 1 else narrow.code)
        assert np.abs(narrow.problem.residual(narrow.y)).max() < 1e-11
        if cover == 1:
            assert narrow.problem.ends != ("periodic", "periodic") and (ends is None or narrow.problem.ends == ends)
        period = narrow.problem.period(narrow.y) * (cover if narrow.code == "PD" else 1)
        assert period == pytest.approx(made.period(whole), rel=1e-12)
        again = widened(narrow.problem, narrow.y, made, whole)
        assert made.scales(whole) @ np.abs(again - whole) < 1e-9


@pytest.mark.parametrize("noise", [-1e-15, 0.0, 1e-15])
def test_rounding_does_not_choose_what_is_nearest_to_grazing(noise):
    """Oracles: half a period of a mode, which comes to rest as near to either bound of its stop; values that are one, and that are not."""
    problem, mode = ReleasedProblem(NES, ("rest", "rest"), (), ["mu"], ["energy = 0.08"]), linear_modes(SYSTEM)[0]
    shape = 0.9 * mode.amplitude * SYSTEM.modes.to_state[:2, mode.index]
    y = problem.pack([[*shape, 0.0, 0.0]], [0.0], [0.1], [2.0 * mode.alpha])
    whole = problem.flights(y)
    seen = observed_free(problem, y, whole._replace(ends=whole.ends * (1.0 + noise)))
    assert (seen["clearance_time"], seen["clearance_side"]) == (0.0, math.copysign(1.0, shape[0] - shape[1]))
    assert seen["clearance"] == pytest.approx(0.1, abs=1e-14)
    for values, least, first in (([0.3, 0.1, 0.1 * (1.0 + noise), math.inf], 0.1, 5), ([0.1 + 1e-9, 0.1], 0.1, 5), ([], math.inf, -1)):
        result = np.zeros(2)
        enter_least(result, [0, 1], np.array(values), [4, 5, 6, 7])
        assert result == pytest.approx([least, first], abs=1e-15)
