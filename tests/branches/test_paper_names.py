"""The families that Lee, Nucera, Vakakis, McFarland and Bergman, Physica D 238 (2009) 1868, name.

Oracles: the event-driven run, which knows nothing of boundary-value problems, closes each orbit; what the paper says of each family: which
are one, from which one they bifurcate, where the impulsive orbit lies, which is stable; a complete list where a name is not found.
"""

import numpy as np
import pytest

import saltus
from branches.naming.families import resolve
from branches.naming.labels import canonical_label, parse
from branches.naming.search import passes, search_bounds
from saltus.__main__ import main
from tests.branches.paper_names import NAMES, SCENE, SYSTEM, event, family, found, orbit_of

PUBLISHED = {"S13+": 1.7, "S73O33-": 1.6459, "U8353-": 4.9065}
"""Quarter periods in the captions of Fig. 7, at the energies of the table."""


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_the_family_that_the_paper_means(name):
    """Oracle: the table; the run from the orbit's start closes after a period, with these impacts."""
    h, alpha, label, impacts, stable = NAMES[name]
    orbit = orbit_of(name)
    assert orbit.h == pytest.approx(h, rel=1e-12) and orbit.alpha == pytest.approx(alpha, rel=1e-9)
    assert canonical_label(parse(orbit.label)) == canonical_label(parse(label)) and orbit.stable in (stable, None)
    if name in PUBLISHED:
        assert round(orbit.alpha, 4) == pytest.approx(PUBLISHED[name], abs=1.01e-4)
    motion = saltus.simulate(SYSTEM, np.zeros(2), orbit.velocities, orbit.period * (1.0 - 1e-9))
    assert len(motion.stop_events) == 2 * impacts
    u, v = motion.sample(np.array([orbit.period * (1.0 - 1e-9)]))
    scale = np.sqrt(2.0 * h)
    assert np.max(np.abs(u)) < 1e-6 * scale and np.max(np.abs(v - orbit.velocities)) < 1e-6 * scale


UNSIGNED = ("S31O11", "S73E33", "S95E22", "S55O11", "U5421", "U(15)578", "U8353", "U8344", "U5231", "U4122", "U3201")


@pytest.mark.parametrize("name", [*UNSIGNED, "U8335-"][::3])
def test_names_without_a_sign_are_the_same(name):
    """Oracle: see `require_names_without_a_sign_are_the_same`."""
    require_names_without_a_sign_are_the_same(name)


def require_names_without_a_sign_are_the_same(name):
    """Oracle: the family of the name with the sign that the paper gives, also where p and q are exchanged."""
    orbit, _ = resolve(name, SYSTEM, reference_points=SCENE.reference_points, limits=search_bounds(SCENE.bounds), energy=SCENE.energy)
    assert passes(family("U8353-" if name == "U8335-" else name + "-"), orbit)


@pytest.mark.parametrize("names", [("U2201+", "U3201-"), ("U4421+", "U5421-"), ("U11+", "U21+", "U21-")])
def test_an_impulsive_orbit_lies_between_the_names_of_one_family(names):
    """Oracle: Lee et al.: a tongue changes from in-phase to out-of-phase where it has an impulsive orbit."""
    branch = family(names[0])
    for name in names:
        assert passes(branch, found(name))
    h, alpha = branch.points["h"], branch.points["alpha"]
    places = [int(np.argmin(np.hypot(np.log(h / found(name).h), np.log(alpha / found(name).alpha)))) for name in (names[-2], names[-1])]
    between = [e for e in branch.events if e.type == "IO" and min(places) <= e.point <= max(places)]
    assert len(between) == 1


def test_families_at_the_linear_modes():
    """Oracle: closed form of the grazing energies w^2/(2 b^2): Lee et al. name these from L11+ and, at Fig. 10(c), beside L11-."""
    energies = [0.5 * (w / b) ** 2 for w, b in zip(SYSTEM.modes.frequencies, SYSTEM.modes.contacts.gap[0], strict=False)]
    for name in ("U2201+", "U5511+", "U4421+", "S95E22-"):
        assert event(family(name), "GR", energies[0]).h == pytest.approx(energies[0], rel=1e-9)
    assert event(family("U44-"), "GR", energies[1]).h == pytest.approx(energies[1], rel=1e-9)


def test_stable_and_unstable_orbits_beside_the_out_of_phase_mode():
    """Oracle: Lee et al.: at h = 0.06 there are stable and unstable periodic orbits U44-."""
    here = saltus.discover(SYSTEM, 0.06, quarter_period=10.0, impacts=16)
    assert here.complete and [(orbit.label, orbit.stable) for orbit in here.orbits] == [("U4401-", True), ("U4401-", False)]


def test_the_orbits_that_cross_s31o11():
    """Oracle: Lee et al.: S31O11- has two bifurcations with U(15)578 and U8353. The first leaves it at five times its period; the second
    meets, at a grazing, a family that leaves it at three times its period."""
    branch = family("S31O11-")
    for name, cover, energy in (("U(15)578-", 5, 1.3087), ("U8353-", 3, 2.0915)):
        root = event(branch, "RT", energy)
        assert root.p_q == [1, cover] and abs(root.h / energy - 1.0) < 1e-4
        born = [one for one in branch.switch(root, energy=(0.05, 100.0)) if one.ends == ("origin", "origin")]
        if cover == 5:
            assert any(passes(one, found(name)) for one in born)
            continue
        ends = [(e.h, e.alpha) for one in born for e in one.events if e.type == "GR"]
        grazing = event(family(name), "GR", 1.89)
        assert any(abs(h / grazing.h - 1.0) < 1e-9 and abs(alpha / grazing.alpha - 1.0) < 1e-9 for h, alpha in ends)


def test_u21_leaves_the_backbone_where_its_symmetry_breaks():
    """Oracle: Lee et al.: U11+ and U21+- bifurcate from S13+ where that becomes unstable."""
    backbone = saltus.trace("S13O00+", SYSTEM, energy=(0.3, 0.7))
    breaking = event(backbone, "SB", 0.4556)
    (born,) = {one.id: one for one in backbone.switch(breaking)}.values()
    for name in ("U11+", "U21+", "U21-"):
        assert passes(born, found(name))
    stable = backbone.points["stable"]
    assert (stable[backbone.points["h"] < 0.99 * breaking.h] != 1).all() and (stable[backbone.points["h"] > 1.01 * breaking.h] != 0).all()


def test_u3401_is_not_found():
    """Oracle: complete lists, from 160 energies, of the orbits with one impact in half a period and a quarter period up to 10."""
    labels = set()
    for h in np.geomspace(0.0505, 100.0, 160):
        here = saltus.discover(SYSTEM, float(h), quarter_period=10.0, impacts=1)
        assert here.complete
        labels |= {str(canonical_label(parse(orbit.label))) for orbit in here.orbits if orbit.label.startswith("U")}
    assert labels == {"U1101+", "U2101-", "U2201+", "U3201-", "U4401+", "U4401-"}


def test_a_catalogue_resolves_the_names(tmp_path, capsys):
    """Oracle: the families that the names' own search finds, among others with the same labels."""
    with saltus.Catalogue(tmp_path / "names.sqlite", "a", scene=SCENE) as catalogue:
        ids = {name: catalogue.add(family(name)) for name in NAMES}
        for twin in ("S73O33-@h=0.18,alpha=4.8652", "U8344-@h=1.65971,alpha=1.64634", "U44-@h=0.0725747,alpha=4.77535"):
            catalogue.add(saltus.trace(twin, SYSTEM, energy=(0.05, 10.0)))
    assert len(set(ids.values())) == 18
    with saltus.Catalogue(tmp_path / "names.sqlite") as catalogue:
        for name, family_id in ids.items():
            assert catalogue.find(name).id == family_id, name
            assert ("counted otherwise" in catalogue.find(name).note) == (name in ("U21+", "U(15)578-", "S31O11-"))
    for name in ("U21+", "U(15)578", "S31O11"):
        assert main(["show", name, "--catalogue", str(tmp_path / "names.sqlite")]) == 0
        assert ids.get(name, ids.get(name + "-")) in capsys.readouterr().out


def test_a_name_that_is_counted_otherwise_says_so(capsys):
    """Oracle: the words, beside the label that is counted."""
    assert main(["continue", "U21+", "--points", "3"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("start"))
    assert line.startswith("start  U1101+:") and "U21+ is the scene's name of this orbit" in line and "counted otherwise" in line
    assert main(["continue", "S73O33-", "--points", "3"]) == 0
    assert "counted otherwise" not in capsys.readouterr().out


def test_an_orbit_that_a_family_passes_twice_is_one(capsys):
    """Oracle: a family between two mirror images of a bifurcation has each orbit from either end, as U1101+ and U1110+."""
    for name in ("U21+", "U8344-"):
        h, alpha = NAMES[name][:2]
        assert len(family(name).orbits_at(energy=h)) == 2
        assert main(["orbit", name, "--energy", str(h)]) == 0
        said = capsys.readouterr().out.partition("alpha = T/4 = ")[2].split()[0]
        assert float(said) == pytest.approx(alpha, rel=1e-9)


def test_a_pin_outside_the_range_of_energies_still_chooses():
    """Oracle: the family, and an orbit in the range."""
    for name, energy in (("S73O33-", (1.0, 2.0)), ("U4122-", (0.3, 0.4)), ("U(15)578-", (1.32, 1.36))):
        orbit, _ = resolve(name, SYSTEM, reference_points=SCENE.reference_points, limits=search_bounds(SCENE.bounds), energy=energy)
        assert energy[0] <= orbit.h <= energy[1] and passes(family(name), orbit)
