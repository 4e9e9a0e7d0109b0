"""Names in a catalogue: the grammar of names, ids and their beginnings, suffixes, pins, and what is said where nothing fits."""

import pytest

import saltus
from branches.catalogue import Node
from branches.naming.labels import LabelSyntaxError
from branches.naming.matching import AmbiguousName, NameNotFound
from tests.branches.catalogue.families import HIGH, real, renamed, scene


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    path = tmp_path_factory.mktemp("find") / "real.sqlite"
    with saltus.Catalogue(path, "a", scene=scene()) as filled:
        for branch in real():
            filled.add(branch)
        filled.add_node(Node("L11+", "linear mode", "L11+", (0.0, 0.1185), 1.84))
    with saltus.Catalogue(path) as opened:
        yield opened


BACKBONE, OUT_OF_PHASE, TWISTED, BORN = range(4)

NAMES = {
    "S13O00+": BACKBONE,
    "S13+": BACKBONE,
    "S13O": BACKBONE,
    "S13O00+@h=1": BACKBONE,
    "S11-": OUT_OF_PHASE,
    "S73O33-": TWISTED,
    "S77O33-": TWISTED,
    "S73O33-@h=7.3348,alpha=1.6459": TWISTED,
    "S53O33+@h=15": TWISTED,
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_its_family(catalogue, name):
    """Oracle: the family that was traced under the name; a suffix gives an orbit with its energy and, nearly, its quarter period."""
    match = catalogue.find(name)
    branch = real()[NAMES[name]]
    assert (match.id, match.kind) == (branch.id, "family")
    if "@h=" in name:
        h = float(name.partition("@h=")[2].split(",")[0])
        assert match.h == pytest.approx(h, rel=1e-12)
        exact = min((orbit.alpha for orbit in branch.orbits_at(energy=h)), key=lambda alpha: abs(alpha - match.alpha))
        assert match.alpha == pytest.approx(exact, rel=1e-4)


def test_the_energy_of_a_kept_point_is_that_point(catalogue):
    """Oracle: the points, by all digits of their energies and quarter periods."""
    points = real()[BACKBONE].points
    for i in (0, 3, 50, 150, len(points["h"]) - 1):
        h, alpha = float(points["h"][i]), float(points["alpha"][i])
        for suffix in (f"@h={h!r}", f"@alpha={alpha!r}", f"@h={h!r},alpha={alpha!r}"):
            found = catalogue.find(real()[BACKBONE].id + suffix)
            assert found.h == pytest.approx(h, rel=1e-12) and found.alpha == pytest.approx(alpha, rel=1e-12)


def test_the_end_of_a_family_is_one_of_its_orbits(catalogue):
    """Oracle: the energies between which the families were followed, which each bound meets to rounding only, and the printed digits of a
    grazing; every family that `families` gives at the bound has an orbit there."""
    at_bound = [row.id for row in catalogue.families(energy=HIGH)]
    assert at_bound == [row.id for row in catalogue.families() if abs(row.h[1] / HIGH - 1.0) < 1e-10]
    assert at_bound and all(catalogue.branch(id).orbits_at(energy=HIGH) for id in at_bound)
    assert catalogue.find("S11-@h=20").id in at_bound and catalogue.find("S13+@h=0.1185078").id == real()[BACKBONE].id
    assert {row.id for row in catalogue.families(energy=HIGH, label="S11-", stable=True)} == {real()[OUT_OF_PHASE].id}


def test_either_start_of_an_unsymmetric_orbit_is_its_name(catalogue):
    """Oracle: Umnpq and Umnqp are one orbit."""
    labels = {label for label in real()[BORN].points["label"] if label}
    swapped = {label.replace("01", "x").replace("10", "01").replace("x", "10") for label in labels}
    assert len(labels | swapped) > len(labels) > 1
    for label in labels | swapped:
        assert catalogue.find(label).id == real()[BORN].id


def test_an_id_and_its_beginning(catalogue):
    """Oracle: the ids; one letter more or less of the hash."""
    for branch in real():
        digest = branch.id.rpartition(":")[2]
        for name in (branch.id, branch.id[:-2], digest, digest[:5]):
            assert catalogue.find(name).id == branch.id
    with pytest.raises(AmbiguousName, match="2 families have an id that begins with 'origin-stop\\+::'"):
        catalogue.find("origin-stop+::")
    with pytest.raises(NameNotFound, match="nearest: origin-stop"):
        catalogue.find("origin-stop+:-+-:ffffffff")
    with pytest.raises(NameNotFound, match="no orbit at h = 500"):
        catalogue.find(real()[BACKBONE].id + "@h=500")
    assert catalogue.find(real()[BACKBONE].id + "@h=1").h == 1.0


def test_a_linear_mode(catalogue):
    """Oracle: the node; the modes that there are."""
    assert catalogue.find("L11+") == ("L11+", "linear mode", 0.1185, 1.84, "")
    for name in ("L11-", "L22-"):
        with pytest.raises(NameNotFound, match=rf"no linear mode {name}; it has L11\+"):
            catalogue.find(name)


MISSING = {
    "S39O11+": "S39O11\\+ is the 3-fold cover of S13O00\\+",
    "L33+": "L33\\+ is the 3-fold cover of L11\\+",
    "U8353": "no family U8353; nearest that exist: ",
    "U1201": r"nearest that exist: U1301\+, U1101\+, U2101-",
    "S79O33-": "nearest that exist: .*S77O33-",
    "S13+@h=20": r"no orbit S13O00\+ at h = 20 .* h = 0\.118508 to 14\.5537",
    "S77O33-@h=15": "no orbit S77O33- at h = 15",
    "S73O33-@h=7.3348,alpha=4.8": "no orbit S73O33- at h = 7.3348, alpha = 4.8",
}


@pytest.mark.parametrize("name", MISSING)
def test_what_does_not_exist_is_said(catalogue, name):
    """Oracle: the words, in one line, with what exists instead."""
    with pytest.raises(NameNotFound, match=MISSING[name]) as caught:
        catalogue.find(name)
    assert "\n" not in str(caught.value)


def test_a_name_that_is_none(catalogue):
    """Oracle: the place in the text."""
    with pytest.raises(LabelSyntaxError, match="character 3"):
        catalogue.find("S1x")
    with pytest.raises(LabelSyntaxError, match="character 2"):
        catalogue.families(label="Ux")


@pytest.fixture(scope="module")
def twins(tmp_path_factory):
    """Two families with one label: S73O33- twice, one with every quarter period doubled."""
    twisted = real()[TWISTED]
    points = {name: values.copy() for name, values in twisted.points.items()}
    points["alpha"] *= 2.0
    other = renamed(twisted, 1, points=points)
    with saltus.Catalogue(tmp_path_factory.mktemp("twins") / "twins.sqlite", "a", scene=scene()) as filled:
        filled.add(twisted)
        filled.add(other)
        yield filled, twisted, other


def test_a_suffix_chooses_among_several(twins):
    """Oracle: the family with the quarter period; the names that the message lists all select what they stand for."""
    catalogue, twisted, other = twins
    with pytest.raises(AmbiguousName) as caught:
        catalogue.find("S77O33-")
    listed = str(caught.value).partition("choose one of ")[2].split()
    assert {catalogue.find(name).id for name in listed} == {twisted.id, other.id}
    assert catalogue.find("S73O33-@h=5,alpha=1.646").id == twisted.id
    assert catalogue.find("S73O33-@h=5,alpha=3.292").id == other.id
    assert catalogue.find("S73O33-@alpha=3.2919").id == other.id
    with pytest.raises(AmbiguousName, match="2 families"):
        catalogue.find("S73O33-@h=5")


def test_a_reference_point_chooses_for_a_bare_name_only(twins):
    """Oracle: the scene pins S73O33- to alpha = 1.6459; other pins choose the other family; other names are not helped."""
    catalogue, twisted, other = twins
    assert catalogue.find("S73O33-").id == twisted.id
    assert catalogue.find("S73O33-", reference_points={"S73O33-": {"h": 7.3348, "alpha": 3.2918}}).id == other.id
    with pytest.raises(AmbiguousName):
        catalogue.find("S73O33-", reference_points={})
    with pytest.raises(AmbiguousName):
        catalogue.find("S73O33-", reference_points={"S73O33-": {"h": 7.3348, "alpha": 9.0}})


def test_a_reference_point_finds_a_label_that_is_counted_otherwise(catalogue):
    """Oracle: the orbit at the pin: S53O33+ at h = 15 under a name with its impacts but other half-waves, as the literature has some;
    a name with other impacts is not helped, nor is one without a pin."""
    pins = {"S93O33-": {"h": 15.0, "alpha": 1.64594}, "S93O22-": {"h": 15.0, "alpha": 1.64594}}
    match = catalogue.find("S93O33-", reference_points=pins)
    assert match.id == real()[TWISTED].id and match.h == 15.0 and "counted otherwise" in match.note
    assert catalogue.find("S73O33-").note == ""
    for name in ("S93O22-", "S95O33-"):
        with pytest.raises(NameNotFound):
            catalogue.find(name, reference_points=pins)


def test_an_orbit_is_known_by_its_family(catalogue):
    """Oracle: the family that it was taken from: as it stands, started at its far end, and mirrored; the twin of half its period is
    another; an orbit of a family that is not kept is none."""
    from branches.catalogue.members import seen_from, unknowns_of
    from branches.orbit import Orbit
    from bvp.multipoint import MultipointProblem

    for branch in real():
        orbit = branch.orbit_at(alpha=branch.points["alpha"][len(branch) // 2 + 3])
        assert catalogue.identify(orbit) == branch.id
    born = real()[BORN]
    orbit = born.orbit(len(born) // 2)
    sequence = ("+",) if born.sequence == "-" else ("-",)
    other_end = seen_from(born.problem, orbit.solution.y, ("origin", "origin"), sequence)
    assert other_end is not None
    problem = MultipointProblem(born.system, other_end.ends, sequence)
    turned = Orbit(problem, problem.solve(unknowns_of(problem, other_end)))
    assert turned.label != orbit.label or turned.problem.sequence != orbit.problem.sequence
    assert catalogue.identify(turned) == born.id
    outside = saltus.trace("S33O11-", energy=(0.17, 0.18)).orbit(3)
    assert catalogue.identify(outside) is None


@pytest.mark.parametrize("dots", ["…", ".", "..."])
def test_an_id_that_a_table_has_shortened_is_a_name(catalogue, dots):
    """Oracle: the ids; another beginning, or another hash, is none of them."""
    for branch in real():
        for kept in (1, 4, 8):
            head, digest = branch.id[:kept], branch.id[-9:]
            assert catalogue.find(head + dots + digest).id == branch.id
    h = float(real()[BACKBONE].points["h"][3])
    assert catalogue.find(f"o{dots}{real()[BACKBONE].id[-9:]}@h={h!r}").h == pytest.approx(h, rel=1e-12)
    for name in (f"rest{dots}{real()[BACKBONE].id[-9:]}", f"origin{dots}:01234567"):
        with pytest.raises(NameNotFound, match="no family whose id is shortened to"):
            catalogue.find(name)
