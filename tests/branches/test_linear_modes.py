"""Linear modes, and the families that begin where they touch the stops.

Oracles: closed forms of the modes; for two degrees of freedom, a rule for the numbers of touches between impacts that needs no linear
algebra; the impulses of first order against speeds on the traced families; scans at energies beside the grazing; the backbones.
"""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import saltus
from branches.grazing.touching import mode_of
from branches.linear_modes import begins, families_at, linear_modes, response
from branches.sequences import canonical_sequence, full_sequence
from bvp.closures import cycle_of
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.scans import refined, sampled
from tests.branches.traced import traced

SYSTEM = vibro_impact_nes()
IN_PHASE, OUT_OF_PHASE = linear_modes(SYSTEM)


@cache
def at(label, cover, impacts=10):
    mode = IN_PHASE if label == "L11+" else OUT_OF_PHASE
    return families_at(mode, cover, impacts, points=25, energy=(0.01, 10.0))


def test_linear_modes_are_nodes():
    """Oracle: closed form: w^2/(2 b^2), shape ratio 3.702, and the event-driven run just below and above it."""
    for mode, label in ((IN_PHASE, "L11+"), (OUT_OF_PHASE, "L11-")):
        modes = SYSTEM.modes
        w, b = modes.frequencies[mode.index], modes.contacts.gap[0, mode.index]
        assert mode.label == label and mode.stops == ("-", "+") and mode.frequency == w
        assert mode.energies[0] == 0.0 and abs(mode.energies[1] / (0.5 * (w / b) ** 2) - 1.0) < 1e-14
        shape = modes.shapes[:, mode.index]
        for factor, touches in ((1.0 - 1e-6, False), (1.0 + 1e-6, True)):
            run = saltus.simulate(SYSTEM, np.zeros(2), factor * mode.amplitude * w * shape, 8.0 * mode.alpha)
            assert (len(run.stop_events) > 0) == touches
    shape = SYSTEM.modes.shapes[:, 0]
    assert round(max(shape / shape[::-1]), 3) == 3.702


def gaps_allowed(mode, side):
    """For two degrees of freedom: pairs (m, n) of the numbers of touches without impact before and after an impact that pushes.

    With c and s the cosine and sine of w T/2 of the other mode, x_{i+1} + 2 c x_i + x_{i-1} = b^2 s/w P_i."""
    other = SYSTEM.modes.frequencies[1 - mode.index]
    angle = 2.0 * other * mode.alpha
    b = SYSTEM.modes.contacts.gap[0, 1 - mode.index]
    beta = b * b * np.sin(angle) / other
    turn = angle - np.pi

    def inside(n):
        j = np.arange(n + 2) - 0.5 * (n + 1)
        return -side * np.cos(turn * j) / np.cos(0.5 * turn * (n + 1))

    fine = [n for n in range(24) if np.all(inside(n)[1:-1] < -side)]
    return {(m, n) for m in fine for n in fine if (inside(m)[-2] + inside(n)[1] + 2.0 * np.cos(angle) * -side) / beta > 0.0}


def smallest(text):
    """The first in order of the rotations and reflections of a text."""
    images = [text[i:] + text[:i] for i in range(len(text))]
    return min(images + [image[::-1] for image in images])


def patterns(mode, count):
    """Sets of touches over a cycle of so many that begin a family, one of each class under rotation and reflection, as strings."""
    out = {}
    for side in (1, -1):
        pairs = gaps_allowed(mode, side)
        for bits in itertools.product("01", repeat=count):
            text = "".join(bits)
            at = [i for i, bit in enumerate(text) if bit == "1"]
            if not at:
                continue
            gaps = [(b - a - 1) % count if len(at) > 1 else count - 1 for a, b in zip(at, at[1:] + at[:1], strict=True)]
            if all((gaps[i - 1], gaps[i]) in pairs for i in range(len(gaps))):
                out[smallest(text)] = side
    return out


def test_what_keeps_a_reversal_beyond_twelve_touches():
    """Oracle: the rule of gaps, by plain enumeration of the texts that are their own reflection."""
    expected = {text for text in patterns(IN_PHASE, 14) if any(text[::-1] == text[i:] + text[:i] for i in range(14))}
    orbit = IN_PHASE.touching(7)
    matrix = response(IN_PHASE, orbit)
    found = set()
    for mask in orbit.choices():
        bits = [mask >> i & 1 for i in range(14)]
        if mask and begins(matrix, np.array(bits, dtype=bool)):
            found.add(smallest("".join(map(str, bits))))
    assert found == expected and len(found) > 20


@pytest.mark.parametrize("label", ["L11+", "L11-"])
@pytest.mark.parametrize("cover", [1, 2, 3, 4, 5])
def test_what_begins_is_what_the_rule_allows(label, cover):
    """Oracle: the rule of gaps, by plain enumeration: which touches become impacts, to which side, and nothing else."""
    mode = IN_PHASE if label == "L11+" else OUT_OF_PHASE
    count = 2 * cover
    expected = {}
    for text, side in patterns(mode, count).items():
        period = next(d for d in range(1, count + 1) if count % d == 0 and text[d:] + text[:d] == text)
        if period == count or (2 * period == count and period % 2 == 1):
            expected[text] = side
    found = {}
    for item in at(label, cover):
        sequence = full_sequence(item.branch.problem.sequence, item.ends)
        assert len(sequence) == item.impacts
        problem, y = item.there.problem, item.there.y
        cycle = cycle_of(problem, y)
        places = np.rint((cycle.times - cycle.times[0]) / (2.0 * mode.alpha)).astype(int) % count
        text = "".join("1" if i in places else "0" for i in range(count))
        found[smallest(text)] = 1 if item.kind == "passage" else -1
    assert found == expected


def test_the_backbones_begin_at_the_modes():
    """Oracle: the traced backbones: S13O00+ rises from L11+, S11O00- falls from L11-."""
    for label, name, kind in (("L11+", "S13O00+", "passage"), ("L11-", "S11O00-", "fold")):
        (family,) = [item for item in at(label, 1) if item.ends[0] == "origin"]
        assert family.label == name and family.kind == kind
        whole = traced(name)
        event = next(e for e in whole.events if e.type == "GR" and e.h < 0.2)
        assert abs(family.event.h / event.h - 1.0) < 1e-9 and abs(family.event.alpha / event.alpha - 1.0) < 1e-9
        assert abs(family.h / event.h - 1.0) < 1e-9


NAMED = [("L11+", 2, "U2210+"), ("L11+", 4, "U4621+"), ("L11+", 5, "U5711+"), ("L11+", 5, "S59E22+"), ("L11-", 4, "U4410-")]


@pytest.mark.parametrize(("label", "cover", "found"), NAMED)
def test_families_that_the_reference_names(label, cover, found):
    """Oracle: Lee et al. (2009) name them (p and q exchanged where a family is started at its other end)."""
    assert found in [item.label for item in at(label, cover)]


def test_named_families_behind_the_next_grazing():
    """Oracle: Lee et al. (2009) let U4520- and S55O11- begin at L11+ too: one grazing further on, from three of its covers."""
    (first,) = [item for item in families_at(IN_PHASE, 3, 1, energy=(0.05, 1.0)) if item.label == "S35O00+"]
    event = next(e for e in first.branch.events if e.type == "GR" and e.h > 0.2)
    assert abs(event.h / 0.2543033 - 1.0) < 1e-6
    labels = {alias["label"] for item in first.branch.neighbours(event, energy=(0.05, 1.0)) if item.branch for alias in item.branch.aliases}
    assert "S55O11-" in labels and labels & {"U4520-", "U4502-"}


@pytest.mark.parametrize("cover", [1, 3, 5])
def test_speeds_of_first_order(cover):
    """Oracle: the impulses of the complementarity problem: speed = P c M^-1 c / 2, with the energy rising by w^2 A e / b."""
    modes = SYSTEM.modes
    mode = IN_PHASE
    orbit = mode.touching(cover)
    matrix = response(mode, orbit)
    b = abs(modes.contacts.gap[0, mode.index])
    checked = 0
    for item in at("L11+", cover):
        if item.event is None or item.ends[0] != "origin":
            continue
        cycle = cycle_of(item.there.problem, item.there.y)
        places = np.rint((cycle.times - mode.alpha) / (2.0 * mode.alpha)).astype(int) % len(orbit.times)
        kept = np.zeros(len(orbit.times), dtype=bool)
        kept[places] = True
        impulses = np.zeros(len(kept))
        impulses[kept] = np.linalg.solve(matrix[np.ix_(kept, kept)], np.ones(int(kept.sum())))
        slope = 0.5 * impulses * np.sum(modes.contacts.gap[0, :2] ** 2) * b / (mode.frequency**2 * mode.amplitude)
        ratios = []
        for change in (4e-4, 2e-4):
            h = mode.energies[1] * (1.0 + change * (1 if item.kind == "passage" else -1))
            near = min(item.branch.orbits_at(energy=h), key=lambda other: abs(other.alpha - item.alpha))
            ratios.append(near.cycle.speeds / (h - mode.energies[1]))
        limit = 2.0 * ratios[1] - ratios[0]
        assert np.allclose(np.sort(limit), np.sort(slope[places]), rtol=2e-4)
        checked += 1
    assert checked


@pytest.mark.parametrize("side", [1, -1])
def test_orbits_beside_the_grazing_are_those_that_begin(side):
    """Oracle: a scan of the angles beside the mode's at an energy beside its grazing: the orbits near it, up to the 3-fold cover."""
    mode = IN_PHASE
    h = mode.energies[1] * (1.0 + side * 1e-2)
    expected = set()
    for item in (family for cover in (1, 2, 3) for family in at("L11+", cover)):
        if item.ends[0] == "origin" and any(abs(orbit.alpha / item.alpha - 1.0) < 0.01 for orbit in item.branch.orbits_at(energy=h)):
            assert (item.kind == "passage") == (side == 1)
            expected.add(canonical_sequence(tuple(item.branch.problem.sequence), item.ends))
    found = set()
    for end in ("stop", "rest", "origin"):
        grid = refined(SYSTEM, end, 4.0 * mode.alpha, h, 0.0, 4, 0.2, 4001)
        for orbit in sampled(SYSTEM, end, 4.0 * mode.alpha, h, grid, range(4)):
            cover = orbit.alpha / mode.alpha
            if round(cover) <= 3 and abs(cover / round(cover) - 1.0) < 0.01:
                found.add(canonical_sequence(orbit.problem.sequence, orbit.problem.ends))
    assert found == expected


def test_mirrored_and_reversed_choices_are_one():
    """Oracle: no two families of one list have the same canonical ends and sequence."""
    for cover in (3, 4, 5):
        keys = [canonical_sequence(tuple(item.branch.problem.sequence), item.ends) for item in at("L11+", cover)]
        assert len(keys) == len(set(keys))


def test_other_systems():
    """Oracle: energies (w d / b)^2 / 2; a one-sided stop is touched once a period, and leaves no origin end; rigid-body modes are none."""
    one_sided = ImpactSystem([[1.0, 0.0], [0.0, 1.0]], [[0.0] * 2] * 2, [[2.0, -1.0], [-1.0, 2.0]], (Stop((1.0, 0.0), upper=0.7),))
    first, second = linear_modes(one_sided)
    for mode, w in ((first, 1.0), (second, 3.0**0.5)):
        assert abs(mode.energies[1] / (0.5 * (w * 0.7) ** 2 * 2.0) - 1.0) < 1e-12
        assert mode.label == "" and len(mode.touching(3).times) == 3
    found = families_at(first, 1, 2, points=10)
    assert found and {end for item in found for end in item.ends} <= {"rest", "stop+", "stop-", "periodic"}
    free = ImpactSystem([[1.0, 0.0], [0.0, 2.0]], [[0.0] * 2] * 2, [[1.0, -1.0], [-1.0, 1.0]], (Stop((1.0, -1.0), -1.0, 1.0),))
    assert [mode.index for mode in linear_modes(free)] == [1]
    with pytest.raises(ValueError, match="families of periodic orbits need a conservative system: restitution 0.7"):
        linear_modes(vibro_impact_nes(rho=0.7))
    twice = ImpactSystem(np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 2.0]], (Stop((1.0, 0.0), -1, 1), Stop((0.0, 1.0), -1, 1)))
    with pytest.raises(ValueError, match=r"touches the stops a-, a\+, b-, b\+ at one instant"):
        families_at(linear_modes(twice)[0], 1, 2)
    for value in (0, 12, float("nan"), True):
        with pytest.raises(ValueError, match=f"cover = {value}: expected an integer, 1 to 11"):
            families_at(first, value, 3)
    with pytest.raises(ValueError, match="impacts = 0: expected an integer, 1 or more"):
        families_at(first, 1, 0)
    with pytest.raises(TypeError, match="the mode is nan, expected one of saltus.linear_modes"):
        families_at(float("nan"), 1, 3)


def test_three_masses():
    """Oracle: the grazing energy of a mode, at which each family has its GR, and the relation seen from the other side."""
    stops = (Stop((1.0, -1.0, 0.0), -1.0, 1.0),)
    stiffness = [[1.3, -0.5, 0.0], [-0.5, 2.1, -0.7], [0.0, -0.7, 1.9]]
    chain = ImpactSystem(np.diag([0.3, 1.0, 0.8]), np.zeros((3, 3)), stiffness, stops)
    mode = linear_modes(chain)[2]
    (family,) = [item for item in families_at(mode, 3, 6, points=60, energy=(0.01, 10.0)) if item.ends == ("origin", "origin")]
    assert abs(family.event.h / mode.energies[1] - 1.0) < 1e-9
    (back,) = family.branch.neighbours(family.event)
    assert back.kind == "linear mode" and abs(back.h / mode.energies[1] - 1.0) < 1e-9
    other = next(event for event in family.branch.events if event.type == "GR" and event.id != family.event.id)
    found = [item for item in family.branch.neighbours(other, points=20) if item.branch is not None]
    assert found and all(abs(item.event.h / other.h - 1.0) < 1e-9 and item.there.residual < 1e-12 for item in found)
    assert families_at(mode, 3, 6, energy=(1.0, 10.0)) == []


def test_a_motion_of_several_modes_is_none():
    """Oracle: a state with both modes."""
    orbit = IN_PHASE.touching(1)
    assert mode_of(orbit) == 0
    mixed = orbit.after.copy()
    mixed[:, 1] = 0.1
    assert mode_of(replace(orbit, after=mixed)) is None


def test_a_resonant_mode_has_no_response():
    """Oracle: frequencies 1 and 2: over one period of the first the second comes back."""
    system = ImpactSystem([[1.0, 0.0], [0.0, 1.0]], [[0.0] * 2] * 2, [[1.0, 0.0], [0.0, 4.0]], (Stop((1.0, 1.0), -1.0, 1.0),))
    mode = linear_modes(system)[0]
    assert response(mode, mode.touching(1)) is None
    assert begins(np.array([[2.0, 3.0], [3.0, 2.0]]), np.array([True, False])) == 1
    assert begins(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([True, False])) == 0
