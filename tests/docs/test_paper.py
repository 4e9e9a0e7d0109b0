"""docs/reference/paper.md: each number of the right-hand columns is computed here, and compared to the digits that are printed.

Oracles: saltus, for the page; closed forms where there are some (linear modes, thresholds).
"""

import re
from functools import cache

import numpy as np
import pytest

import saltus
from benchmarks.backbone import Backbone
from branches.naming.labels import canonical_label, parse
from branches.naming.search import passes
from branches.orbit import Orbit
from branches.search.impulsive_motions import impulsive_state
from bvp.system import vibro_impact_nes
from tests.branches.paper_names import NAMES, SYSTEM, event, family, found, orbit_of
from tests.branches.traced import traced
from tests.docs.pages import compare, numbers, page, table

PAGE = page("paper.md")


def grazing_energies():
    """Closed form, in phase first: w^2/(2 b^2)."""
    return [0.5 * (w / b) ** 2 for w, b in zip(SYSTEM.modes.frequencies, SYSTEM.modes.contacts.gap[0, :2], strict=True)]


def share(name, h):
    """The NES's part of the kinetic energy at an origin start."""
    (orbit,) = traced(name).orbits_at(energy=h)
    return 0.1 * orbit.velocities[0] ** 2 / (2.0 * h)


def impulsive(name):
    """Energy of the impulsive orbit of a family; some have it at either end of the same orbit."""
    h, *others = (e.h for e in family(name).events if e.type == "IO")
    assert others == pytest.approx([h] * len(others), rel=1e-9)
    return h


def motion(name):
    """Time average of the NES's kinetic energy over h, and slope of the line fitted to (u1, u2), on a family's impulsive orbit."""
    branch = family(name) if name in NAMES else traced(name, high=200.0)
    io = next(e for e in branch.events if e.type == "IO")
    orbit = branch.orbit(io.point)
    u, v = orbit.sample(np.linspace(0.0, orbit.period, 20001)[:-1])
    return io.h, 0.05 * float(np.mean(v[:, 0] ** 2)) / orbit.h, float(np.polyfit(u[:, 0], u[:, 1], 1)[0])


ROWS = {}


def row(number):
    """Register what computes a row."""
    return lambda compute: ROWS.setdefault(number, compute)


@row(1)
def first_impact():
    c = np.array([1.0, -1.0])
    least = 0.5 / (c @ np.linalg.solve(SYSTEM.stiffness, c))
    w, b = SYSTEM.modes.frequencies, SYSTEM.modes.contacts.gap[0, :2]
    speed = 1.0 / np.sum(np.abs(b * SYSTEM.modes.shapes[1] / w))
    for factor, hits in ((1.0 - 1e-6, False), (1.02, True)):
        assert (len(saltus.simulate(SYSTEM, *impulsive_state(SYSTEM, 0.5 * factor * speed**2), 2000.0).stop_events) > 0) == hits
    return [least, 0.5 * speed**2, family("U44-").points["h"].min()]


@row(2)
def mode_shape():
    shape = SYSTEM.modes.shapes[:, 0]
    ratio = shape[0] / shape[1]
    return [ratio, 3.702, 1.0, np.arctan(1.0 / ratio) / np.pi]


@row(3)
def thresholds():
    (low, high), (first, second) = grazing_energies(), SYSTEM.modes.frequencies
    return [first, low, second, high]


@row(4)
def backbones():
    out = [next(e.h for e in traced(name).events if e.type == "GR" and e.h < 0.2) for name in ("S13O00+", "S11O00-")]
    assert out == pytest.approx(grazing_energies(), rel=1e-9)
    return out


@row(5)
def fold():
    found = next(e for e in traced("S11O00-").events if e.type == "SN")
    assert Backbone().energy(found.alpha) == pytest.approx(found.h, rel=1e-12)
    return [found.h, found.alpha]


@row(6)
def stability_of_s11():
    branch = traced("S11O00-")
    doubling = next(e for e in branch.events if e.type == "PD")
    h, alpha, stable = (branch.points[key] for key in ("h", "alpha", "stable"))
    beyond = alpha < fold()[1] * (1.0 - 1e-3)
    assert (stable[beyond & (np.abs(h / doubling.h - 1.0) > 1e-3)] == 1).all() and beyond.sum() > 100
    return [h.max(), doubling.h, -1.0]


@row(7)
def stability_of_s13():
    branch = traced("S13O00+")
    breaking = next(e for e in branch.events if e.type == "SB")
    h, stable = branch.points["h"], branch.points["stable"]
    assert (stable[1:-1][h[1:-1] < 0.999 * breaking.h] == 0).all() and (stable[1:-1][h[1:-1] > 1.001 * breaking.h] == 1).all()
    return [breaking.h, h.max()]


@row(8)
def localization():
    return [10.0, share("S11O00-", 10.0), share("S13O00+", 10.0)]


@row(9)
def figure_7a():
    (orbit,) = traced("S13O00+").orbits_at(alpha=1.7)
    assert orbit.h == pytest.approx(float(Backbone().energy(1.7)), rel=1e-12)
    return [orbit.h, 1.7]


@row(10)
def figure_7b():
    here = saltus.discover(SYSTEM, 0.2, quarter_period=5.1, impacts=7, ends=("origin-stop",))
    (other,) = [orbit.alpha for orbit in here.orbits if orbit.label == "S73O33-"]
    return [found("S73O33-").alpha, found("S73O33-").h, other, 0.2]


@row(11)
def figure_7c():
    return [found("U8353-").alpha, found("U8353-").h]


@row(12)
def tongue():
    branch, backbone = family("U4122-"), traced("S11O00-")
    root = event(backbone, "RT", 0.2888)
    assert root.p_q[1] == 4 and abs(root.h / branch.points["h"].min() - 1.0) < 1e-6
    grazing = event(branch, "GR", 8.7)
    # Umnpq and Umnqp are one orbit, started at either end
    assert {"U1121+", "U1112+"} & {one.label for one in branch.neighbours(grazing, points=20)}
    return [root.h, branch.points["alpha"].min(), branch.points["alpha"].max(), impulsive("U4122-"), grazing.h]


@row(13)
def bridge():
    branch, backbone = family("S31O11-"), traced("S11O00-")
    root = event(backbone, "RT", 0.1729)
    assert root.p_q == [1, 3] and abs(root.h / branch.points["h"].min() - 1.0) < 1e-6
    grazing = event(branch, "GR", 14.5)
    assert abs(grazing.h / traced("S13O00+").points["h"].max() - 1.0) < 1e-9
    return [root.h, impulsive("S31O11-"), grazing.h]


@row(14)
def crossings():
    branch = family("S31O11-")
    five, three = event(branch, "RT", 1.3086), event(branch, "RT", 2.0915)
    assert five.p_q == [1, 5] and three.p_q == [1, 3] and five.h < impulsive("S31O11-") < three.h
    return [five.h, three.h, event(family("U8353-"), "GR", 1.89).h]


@row(15)
def doubling():
    backbone = traced("S11O00-")
    root = next(e for e in backbone.events if e.type == "PD")
    (born,) = {one.id: one for one in backbone.switch(root, energy=(0.05, 100.0)) if one.ends == ("origin", "origin")}.values()
    assert "U2111-" in born.points["label"]
    grazing = event(family("U21-"), "GR", 0.604)
    assert any(e.type == "GR" and abs(e.h / grazing.h - 1.0) < 1e-9 for e in born.events)
    return [root.h, grazing.h]


@row(16)
def u21():
    branch = family("U21+")
    breaking = next(e for e in traced("S13O00+").events if e.type == "SB")
    assert abs(branch.points["h"].min() / breaking.h - 1.0) < 1e-6
    return [breaking.h, impulsive("U21+"), event(branch, "GR", 0.6).h]


@row(17)
def between_the_frequencies():
    low = grazing_energies()[0]
    out = []
    for name in ("U2201+", "U5511+", "U4421+"):
        assert event(family(name), "GR", low).h == pytest.approx(low, rel=1e-9)
        out.append(parse(name).m * 2.0 * np.pi / orbit_of(name).period)
        assert SYSTEM.modes.frequencies[0] < out[-1] < SYSTEM.modes.frequencies[1]
    return [low, *out]


@row(18)
def from_the_in_phase_mode():
    low = grazing_energies()[0]
    for name in ("S95E22-", "U5421-", "U3201-"):
        assert event(family(name), "GR", low).h == pytest.approx(low, rel=1e-9)
    for name, label in (("S95E22-", "S55E22+"), ("U5421-", "U4412+"), ("U3201-", "U2201+")):
        labels = {str(canonical_label(parse(one))) for one in family(name).points["label"] if one}
        assert str(canonical_label(parse(label))) in labels
    first = saltus.trace("S35O00+", SYSTEM, energy=(0.05, 1.0))
    assert event(first, "GR", low).h == pytest.approx(low, rel=1e-9)
    next_grazing = event(first, "GR", 0.25)
    for name in ("U4520-", "S55O11-"):
        assert event(family(name), "GR", 0.25).h == pytest.approx(next_grazing.h, rel=1e-9)
    return [next_grazing.h]


@row(19)
def along_the_impulsive_orbits():
    assert not any(e.type == "IO" for e in family("U44-").events)
    return [impulsive(name) for name in ("S73E33-", "U21-", "S95E22-", "U5421-", "U4520-", "S55O11-", "U3201-")]


@row(20)
def lowest_regime():
    return [first_impact()[1], grazing_energies()[1]]


@row(21)
def below_the_bullets():
    h = family("U44-").points["h"]
    assert h.max() == pytest.approx(grazing_energies()[1], rel=1e-9)
    return [h.min(), h.max()]


@row(22)
def figure_9():
    out = []
    for name in ("U5231-", "U4122-"):
        io = next(e for e in family(name).events if e.type == "IO")
        assert family(name).orbit(io.point).stable
        out += [io.h, io.alpha]
    return out


@row(23)
def localization_of_impulsive_orbits():
    low, high = motion("U3201-"), motion("S(15)3O77-@h=41,alpha=1.64716")
    return [low[1], low[0], high[1], high[0], high[2], np.arctan(high[2]) / np.pi]


@row(24)
def figure_10c():
    here = saltus.discover(SYSTEM, 0.06, quarter_period=10.0, impacts=16)
    assert here.complete and [orbit.label for orbit in here.orbits] == ["U4401-"] * 2
    assert [orbit.stable for orbit in here.orbits] == [True, False]
    return [0.06, 10.0, 16, here.orbits[0].alpha, here.orbits[1].alpha, fold()[0]]


@row(25)
def why_a_cover():
    with pytest.raises(ValueError, match="3-fold cover of S13O00\\+"):
        saltus.trace("S39O11+", SYSTEM, energy=(0.2, 2.0))
    return []


@pytest.mark.parametrize("cells", table(PAGE, "Statements"), ids=lambda cells: f"{cells[0]}: {cells[1][:40]}")
def test_statements(cells):
    """Oracle: the functions above."""
    compare(cells[2], ROWS[int(cells[0])]())


@pytest.mark.parametrize("cells", table(PAGE, "Names"), ids=lambda cells: cells[0])
def test_names(cells):
    """Oracle: the families that the names resolve to."""
    name, label, *values = cells
    orbit, branch = orbit_of(name), family(name)
    assert canonical_label(parse(label.strip("`"))) == canonical_label(parse(orbit.label))
    h = branch.points["h"]
    impulsive_at = [impulsive(name)] if any(e.type == "IO" for e in branch.events) else []
    ends = [h.min()] if h.max() > 99.9 else [h.min(), h.max()]
    assert bool(values[3]) == (len(ends) == 2) and bool(values[4]) == bool(impulsive_at)
    compare(" ".join(values), [orbit.h, orbit.alpha, *ends, *impulsive_at])


def test_the_tables_name_all_names():
    """Oracle: the names that the tests of resolving know, and the reference points of the scene."""
    assert [cells[0] for cells in table(PAGE, "Names")] == list(NAMES)
    assert set(saltus.load_scene().reference_points) == set(NAMES) - {"S11-", "S13+"}
    assert [int(cells[0]) for cells in table(PAGE, "Statements")] == sorted(ROWS)


@cache
def searched(low, high, count, quarter_period, impacts):
    """Labels, with p <= q, of a complete list at each of some energies."""
    labels = set()
    for h in np.geomspace(low, high, count):
        here = saltus.discover(vibro_impact_nes(), float(h), quarter_period=quarter_period, impacts=impacts)
        assert here.complete
        labels |= {str(canonical_label(parse(orbit.label))) for orbit in here.orbits if orbit.label}
    return labels


def test_what_is_not_found():
    """Oracle: complete lists at many energies; the labels along the families."""
    one, two, three, four = table(PAGE, "Not found, or counted otherwise")
    count, low, high, quarter_period = (float(value) for value in numbers(one[1]))
    labels = {label for label in searched(low, high, int(count), quarter_period, 1) if label.startswith("U")}
    assert labels == set(re.findall(r"`([^`]*)`", one[2].partition(". ")[0]))
    count, low, high, quarter_period, impacts = (float(value) for value in numbers(two[1]))
    assert not [label for label in searched(low, high, int(count), quarter_period, int(impacts)) if re.fullmatch(r"U21.*\+", label)]
    for cells, name in ((three, "U(15)578-"), (four, "S31O11-")):
        along = {str(canonical_label(parse(label))) for label in family(name).points["label"] if label}
        assert set(re.findall(r"`([^`]*)`", cells[2])) <= along and name not in along
    fives = {label for label in family("U(15)578-").points["label"] if label and parse(label).n == 5}
    assert {str(canonical_label(parse(label))) for label in fives} == {"U(14)578-"}


def test_numbers_are_read():
    """Oracle: texts by hand."""
    text = "`U4401-` at h = 0.06, alpha = -1.50 and 16, S13+, U(15)578-, L11+, S(15)3O77-, u1 = u2, m 2 pi/T"
    assert numbers(text) == ["0.06", "-1.50", "16"]
    compare("h = 0.123, 4", [0.12345, 4.4])
    for wrong in ([0.1245, 4.4], [0.12345, 4.6], [0.12345]):
        with pytest.raises(AssertionError):
            compare("h = 0.123, 4", wrong)


def test_the_families_of_one_row_are_one():
    """Oracle: the orbit of each name lies on the family of the other."""
    for one, other in (("U2201+", "U3201-"), ("U4421+", "U5421-"), ("U11+", "U21-"), ("U21+", "U21-")):
        assert passes(family(one), found(other))
    assert isinstance(orbit_of("U21+"), Orbit)
