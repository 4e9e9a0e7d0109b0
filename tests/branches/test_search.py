"""Every symmetric orbit at an energy.

Oracles: closed forms, published orbits, a uniform scan, a scan in plain numpy, Newton's method from random motions, symmetries.
"""

import json
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from saltus_core import Verdict
from scipy.optimize import brentq

import saltus
from benchmarks import backbone
from branches.naming.labels import parse
from branches.orbit import Orbit
from branches.presentation import cover_of
from branches.record import discovery_to_json
from branches.search import orbit_search
from branches.search.discovery import discover_orbits
from branches.search.intervals import EndCrossing, first_crossings, follow_start, scan
from branches.search.orbit_search import CLASSES, Found, OrbitSearch, _strayed, in_order, judged
from branches.search.starts import ScannedSegment, curves
from branches.sequences import impacts_per_period
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.system import ImpactSystem, Stop
from tests.branches.scans import sampled
from tests.bvp import orbits as orbits_by_numpy

SYSTEM = saltus.vibro_impact_nes()
ALL = tuple(CLASSES)


def alphas(found, *ends):
    return sorted(orbit.alpha for orbit in found.orbits if not ends or "-".join(end.rstrip("+-") for end in orbit.ends) in ends)


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.37, 0.81), (1.3, 0.2)])
@pytest.mark.parametrize("energy", [0.0692, 0.1186, 1.0, 7.3348, 20.0, 50.0])
def test_the_backbones_are_there_and_nothing_else_of_their_kind(mu, sigma, energy):
    """Oracle: closed form: every orbit with one impact a half period, from just above the two thresholds on."""
    system = saltus.vibro_impact_nes(mu, sigma)
    found = discover_orbits(system, energy, quarter_period=5.1, impacts=1)
    mine = [orbit.alpha for orbit in found.orbits if orbit.ends == ("origin", "stop+")]
    assert found.complete and np.allclose(mine, backbone.orbits_at(system, energy, 5.1), rtol=1e-11)


def test_the_thresholds():
    """Oracle: the fold of S11O00- and the grazing of the in-phase mode, from their closed forms."""

    def labels(energy):
        return [orbit.label for orbit in discover_orbits(SYSTEM, energy, quarter_period=2.0, impacts=1).orbits]

    assert labels(0.069116) == [] and labels(0.0691165) == ["S11O00-", "S11O00-"]
    assert labels(0.118507) == ["S11O00-"] and labels(0.118509) == ["S11O00-", "S13O00+"]


def test_published_orbits():
    """Oracle: Lee et al. (2009): S73O33- at h = 7.3348 with alpha = 1.6459, U8353- at h = 1.9458 with alpha = 4.9065
    (printed as U8335-, which is the same orbit started at its other end)."""
    found = discover_orbits(SYSTEM, 7.3348, quarter_period=5.1, impacts=10)
    assert found.complete
    assert [orbit.alpha for orbit in found.orbits if orbit.label == "S73O33-"] == [pytest.approx(1.6459, abs=1e-4)]
    found = discover_orbits(SYSTEM, 1.9458, quarter_period=5.1, impacts=10)
    assert found.complete and any(orbit.label == "U8335-" and abs(orbit.alpha - 4.9065) < 2e-4 for orbit in found.orbits)


def check(orbit, energy):
    """Compare with the energy, the residual, dense samples inside the gap, the label's own parse, and one turn."""
    assert abs(orbit.h / energy - 1.0) < 1e-12 and orbit.residual < 1e-12
    u, _ = orbit.sample(np.linspace(0.0, orbit.period, 3001))
    assert np.max(np.abs(u[:, 0] - u[:, 1])) < 1.0 + 1e-12 and orbit.impacts
    assert not orbit.label or str(parse(orbit.label)) == orbit.label
    assert cover_of(orbit.problem, orbit.solution) == 1


@pytest.mark.parametrize(("energy", "ends"), [(0.3, ALL), (6.0, ("origin-origin",)), (20.0, ALL)])
def test_each_orbit_is_one(energy, ends):
    """Oracle: `check`, the bounds, and that no two are one."""
    found = discover_orbits(SYSTEM, energy, quarter_period=4.0, impacts=6, ends=ends)
    assert found.complete and len(found.orbits) == found.counts["orbits"] > 5
    seen = set()
    for orbit in found.orbits:
        check(orbit, energy)
        assert orbit.alpha <= 4.0 and impacts_per_period(orbit.problem.sequence, orbit.ends) <= 12
        seen.add((orbit.ends, orbit.sequence, round(orbit.alpha, 9), *np.round(np.abs(orbit.problem.start(orbit.solution.y)), 7)))
    assert len(seen) == len(found.orbits)


@pytest.mark.parametrize(("energy", "mu", "sigma"), [(0.6, 0.1, 0.1)])
def test_a_uniform_scan_adds_nothing(energy, mu, sigma):
    """Oracle: see `require_a_uniform_scan_adds_nothing`."""
    require_a_uniform_scan_adds_nothing(energy, mu, sigma)


def require_a_uniform_scan_adds_nothing(energy, mu, sigma):
    """Oracle: sign changes between forty thousand uniform angles."""
    system = saltus.vibro_impact_nes(mu, sigma)
    found = discover_orbits(system, energy, quarter_period=4.0, impacts=4)
    assert found.complete
    total = 0
    for end, impacts in (("origin", 4), ("rest", 2), ("stop", 1)):
        for other in sampled(system, end, 4.0, energy, 40000, range(impacts + 1)):
            if other.alpha > 4.0:
                continue
            total += 1
            near = [orbit for orbit in found.orbits if orbit.ends[1].startswith(end) and abs(orbit.alpha / other.alpha - 1.0) < 1e-9]
            assert near, (end, other.alpha, other.problem.sequence)
    assert total >= 5


@pytest.mark.parametrize(("energy", "mu", "sigma"), [(0.4, 0.1, 0.1)])
def test_newton_from_random_motions_adds_nothing(energy, mu, sigma):
    """Oracle: see `require_newton_from_random_motions_adds_nothing`."""
    require_newton_from_random_motions_adds_nothing(energy, mu, sigma)


def require_newton_from_random_motions_adds_nothing(energy, mu, sigma):
    """Oracle: the multipoint problem started from random pieces of random motions: another way to orbits, with any ends and sequences."""
    system = saltus.vibro_impact_nes(mu, sigma)
    found = discover_orbits(system, energy, quarter_period=4.0, impacts=6, ends=ALL)
    assert found.complete
    known = np.array(alphas(found))
    generator = np.random.default_rng(7)
    letters = system.modes.contact_letters
    reached = set()
    for _ in range(900):
        start = ("origin", "rest", "stop")[generator.integers(3)]
        (curve,) = curves(system, start, energy)
        parameter = generator.uniform(curve.low, curve.high)
        impacts = int(generator.integers(0, 6))
        path = follow_start(curve, parameter, impacts, 8.0)
        if len(path.nodes) < impacts or len(path.contacts) < impacts:
            continue
        far = ("origin", "rest", "stop+", "stop-")[generator.integers(4)]
        sequence = tuple(letters[c] for c in path.contacts[:impacts])
        problem = MultipointProblem(system, (curve.end, far), sequence)
        try:
            solution = problem.solve(
                problem.pack(path.start, path.nodes, np.append(path.durations, generator.uniform(0.1, 2.0))), energy=energy
            )
        except NotConverged:
            continue
        orbit = judged(problem, solution)
        if isinstance(orbit, str) or orbit.alpha > 4.0 or impacts_per_period(sequence, problem.ends) > 12:
            continue
        nearest = known[np.argmin(np.abs(known - orbit.alpha))]
        assert abs(nearest / orbit.alpha - 1.0) < 1e-8, (problem.ends, sequence, orbit.alpha)
        reached.add(round(orbit.alpha, 8))
    assert len(reached) >= 6


def test_symmetric_orbits_are_found_from_each_of_their_ends():
    """Oracle: SmnE orbits seen from the origin, and as two quarters from rest to rest."""
    quarter = discover_orbits(SYSTEM, 9.0, quarter_period=5.1, impacts=8, ends=("origin-rest",))
    curve = curves(SYSTEM, "rest", 9.0)[0]
    crossings, open_ones, _ = scan(curve, {"rest": (10.2, 8), "origin": (5.1, 4)}, 10**6)
    assert len(quarter.orbits) >= 3 and all(opening.reason == Verdict.GRAZED for opening in open_ones)
    for orbit in quarter.orbits:
        times = []
        for crossing in crossings:
            if crossing.kind == "rest" and crossing.impacts == 2 * len(orbit.problem.sequence):
                path = follow_start(curve, crossing.parameter, crossing.impacts, 10.2)
                times.append(path.instants[-1] + crossing.flight)
        assert np.min(np.abs(np.array(times) - 2.0 * orbit.alpha)) < 1e-8


def test_what_a_scan_in_numpy_finds_is_found():
    """Oracle: the scan of tests/bvp/orbits.py, which shares nothing with this one; primitive orbits."""
    mine = {}
    missing = []
    for other in orbits_by_numpy.scan(SYSTEM, "origin", 0.5, angles=110, impacts=2):
        if cover_of(other.problem, other.solution) > 1:
            continue
        kind = other.problem.ends[1].rstrip("+-")
        inner = len(other.problem.sequence)
        key = kind, inner
        if key not in mine:
            mine[key] = sampled(SYSTEM, kind, 16.0, 0.5, 3000, [inner])
        alphas = [orbit.alpha for orbit in mine[key]]
        if not any(abs(alpha / other.solution["quarter_period"] - 1.0) < 1e-8 for alpha in alphas):
            missing.append(other.name)
    assert not missing and mine


@pytest.mark.parametrize(("sigma", "energy", "longest"), [(0.1, 0.3, 2.0), (0.1, 3.0, 2.0), (0.1, 12.0, 2.0), (0.0, 0.55, 6.0)])
def test_a_scan_of_given_angles_finds_the_backbones(sigma, energy, longest):
    """Oracle: closed form: every orbit with one impact a half period, and nothing else of this kind."""
    system = saltus.vibro_impact_nes(0.1, sigma)
    found = {round(orbit.alpha, 10) for orbit in sampled(system, "stop", longest, energy, 1000, [0])}
    assert found and np.allclose(sorted(found), backbone.orbits_at(system, energy, longest), rtol=1e-9)


@pytest.mark.parametrize(("end", "energy"), [("stop", 1.0), ("rest", 3.0), ("origin", 0.3)])
def test_each_orbit_of_a_scan_of_given_angles(end, energy):
    """Oracle: `check`."""
    found = sampled(SYSTEM, end, 6.0, energy, 1500, range(5))
    assert found
    for orbit in found:
        check(Orbit(orbit.problem, orbit.solution), energy)


def test_a_denser_scan_finds_nothing_less():
    """Oracle: a scan of four times the angles."""
    coarse, fine = (sampled(SYSTEM, "stop", 4.0, 0.6, angles, [0, 1]) for angles in (500, 2000))
    assert coarse
    for orbit in coarse:
        alike = [other.solution.y for other in fine if other.canonical == orbit.canonical and other.problem.ends == orbit.problem.ends]
        assert any(np.allclose(orbit.solution.y, y, rtol=1e-7, atol=1e-9) for y in alike)


def test_several_turns_are_counted():
    """Oracle: the backbone's half period unfolded 1, 2, 3 times."""
    for impacts in (2, 4, 6):
        problem, y = orbits_by_numpy.backbone_segment(SYSTEM, 1.7, impacts)
        assert cover_of(problem, problem.solve(y)) == impacts  # a quarter problem solves half a turn of it
        assert judged(problem, problem.solve(y)) == "covers"


def test_orbits_without_impacts_are_none():
    """Oracle: below every grazing energy there are linear modes alone."""
    for kind in ("rest", "origin"):
        assert sampled(SYSTEM, kind, 6.0, 0.04, 200, [0]) == []
    modes = SYSTEM.modes
    problem = MultipointProblem(SYSTEM, ("origin", "rest"), ())
    start = np.array([0.0, 0.0, 0.2, 0.0])
    guess = problem.pack(start, np.zeros((0, 4)), [0.5 * np.pi / modes.frequencies[0]])
    assert judged(problem, problem.solve(guess)) == "without_impacts"


def test_the_free_impact_damper():
    """Oracle: closed form at sigma = 0, where the sink flies freely: G = b^2 alpha + tan(alpha)."""
    found = discover_orbits(saltus.vibro_impact_nes(0.1, 0.0), 0.55, quarter_period=5.0, impacts=4, ends=ALL)
    assert found.complete
    alphas_of_backbone = [orbit.alpha for orbit in found.orbits if orbit.ends == ("origin", "stop+") and not orbit.sequence]
    assert alphas_of_backbone
    for alpha in alphas_of_backbone:
        g = 10.0 * alpha + math.tan(alpha)
        assert (10.0 + 1.0 / math.cos(alpha) ** 2) / (2.0 * g * g) == pytest.approx(0.55, rel=1e-11)


def one_sided(gap=(1.0, -1.0), lower=-math.inf, upper=1.0):
    return ImpactSystem([[0.5, 0.0], [0.0, 1.0]], [[0.0] * 2] * 2, [[1.2, -0.4], [-0.4, 1.0]], (Stop(gap, lower, upper),))


def test_one_impact_a_period_on_a_one_sided_stop():
    """Oracle: closed form: an impulse P = 2 d / sum b_k^2 cot(w_k T/2)/w_k once a period, physical where it pushes away from the stop and
    the stop is not passed in between."""
    system = one_sided()
    w, b = system.modes.frequencies, system.modes.contacts.gap[0, :2]
    longest, energy = 4.0, 1.7

    def impulse(period):
        return 2.0 / np.sum(b**2 / np.tan(w * period / 2.0) / w)

    def residual(period):
        return 0.5 * np.sum((b * impulse(period) / (2.0 * np.sin(w * period / 2.0))) ** 2) - energy

    grid = np.linspace(0.01, 4.0 * longest, 40001)
    values = np.array([residual(t) for t in grid])
    expected = []
    for i in np.flatnonzero(values[:-1] * values[1:] < 0.0):
        if abs(values[i]) + abs(values[i + 1]) > 1.0:
            continue
        period = brentq(residual, grid[i], grid[i + 1], xtol=1e-14)
        push = impulse(period)
        times = np.linspace(0.0, period, 4001)[1:-1]
        gap = np.sum(
            [b[k] ** 2 * push * np.cos(w[k] * (times - period / 2.0)) / (2.0 * w[k] * np.sin(w[k] * period / 2.0)) for k in (0, 1)], axis=0
        )
        if push < 0.0 and np.max(gap) < 1.0:
            expected.append(period / 4.0)
    found = discover_orbits(system, energy, quarter_period=longest, impacts=2, ends=("rest-rest", "rest-stop", "stop-stop"))
    mine = [orbit.alpha for orbit in found.orbits if orbit.ends == ("rest", "stop+") and not orbit.sequence]
    assert found.complete and len(expected) >= 2 and np.allclose(mine, expected, rtol=1e-10)


def test_the_mirror_changes_nothing():
    """Oracle: the gap coordinate counted the other way, and a stop on the other side: the same orbits."""

    def listed(system, ends):
        found = discover_orbits(system, 1.4, quarter_period=3.5, impacts=4, ends=ends)
        assert found.complete
        return np.array([(o.alpha, o.tau, o.stable) for o in found.orbits])

    rest = ("rest-rest", "rest-stop", "stop-stop")
    first = listed(one_sided(), rest)
    assert len(first) >= 4
    for system in (one_sided(lower=-1.0, upper=math.inf), one_sided((-1.0, 1.0))):
        assert listed(system, rest) == pytest.approx(first, rel=1e-8, abs=1e-8)
    turned = ImpactSystem(SYSTEM.mass, SYSTEM.damping, SYSTEM.stiffness, (Stop((-1.0, 1.0), -1.0, 1.0),))
    assert listed(turned, ALL) == pytest.approx(listed(SYSTEM, ALL), rel=1e-8, abs=1e-8)


def test_what_is_not_decided_is_said():
    """Oracle: a budget of starts that cannot do."""
    found = discover_orbits(SYSTEM, 1.0, quarter_period=5.1, impacts=6, budget=150)
    assert not found.complete and found.counts["over_budget"] > 0 and found.counts["open"] >= found.counts["over_budget"]
    assert len(found.open) == found.counts["open"] and all(opening.width > 0.0 for opening in found.open)


@pytest.mark.parametrize("mu", [1e-5, 1e-7, 1e-9])
def test_a_sink_of_almost_no_mass_is_searched_or_refused(mu):
    """Oracle: it ends within the starts asked for; the closed form of the orbits with one impact half a period."""
    system = saltus.vibro_impact_nes(mu=mu)
    quarter_period = 1.8 if mu > 1e-8 else 0.4
    found = discover_orbits(system, 1.0, quarter_period=quarter_period, impacts=1, budget=2000)
    assert found.counts["starts"] < 3000 and found.complete is (found.counts["open"] == 0)
    mine = [orbit.alpha for orbit in found.orbits if orbit.ends == ("origin", "stop+")]
    assert (mine or mu < 1e-8) and all(abs(backbone.energy(system, alpha) - 1.0) < 1e-6 for alpha in mine)


def test_no_bound_of_impacts():
    """Oracle: a bound that is never reached."""
    found = discover_orbits(SYSTEM, 0.4, quarter_period=3.0)
    bounded = discover_orbits(SYSTEM, 0.4, quarter_period=3.0, impacts=60)
    assert found.complete and alphas(found) == pytest.approx(alphas(bounded), rel=1e-12) and len(found.orbits) > 5
    assert found.impacts is None


class Made(dict):
    """A solution with results that are given."""

    def __init__(self, **changes):
        self.problem, self.y = orbits_by_numpy.backbone_segment(SYSTEM, 1.7, 2)
        super().__init__({"residual": 1e-15, "clearance": 0.1, "speed": 1.0, "flight": 1.0, **changes})


@pytest.mark.parametrize(
    ("moved", "changes", "reason"),
    [
        (1e-3, {}, "Newton's method moved away from it"),
        (0.0, {"residual": 1e-11}, "its residual stays at 1.0e-11"),
        (0.0, {"speed": -1e-13}, "it grazes a stop within rounding"),
        (0.0, {}, None),
    ],
)
def test_segments_that_are_not_solved_are_set_aside(monkeypatch, moved, changes, reason):
    """Oracle: a start beside the solution's, and results of a solution."""
    made = Made(**changes)
    problem, y = made.problem, made.y
    parts = problem.start(y) + moved, problem.nodes(y), problem.flight_times(y)
    segment = ScannedSegment(problem.ends, problem.sequence, *parts, 0.5, 0.4, 0.6, 0.0)
    assert _strayed(segment, problem, made) == reason
    monkeypatch.setattr(orbit_search, "segments", lambda *arguments: [(segment, False)])
    search = OrbitSearch(SYSTEM)
    search.scan([], {}, 1, MultipointProblem.solve)
    assert [found.reason for found in search.unpolished] == ["its impacts were not found again"] and not search.found


def test_smaller_bounds_give_a_part():
    """Oracle: the larger search, cut."""
    large = discover_orbits(SYSTEM, 12.0, quarter_period=3.6, impacts=6)
    small = discover_orbits(SYSTEM, 12.0, quarter_period=1.9, impacts=4)
    cut = [o.alpha for o in large.orbits if o.alpha <= 1.9 and impacts_per_period(o.problem.sequence, o.ends) <= 8]
    assert large.complete and small.complete and len(cut) > 5
    assert np.allclose(alphas(small), cut, rtol=1e-11)


def test_later_passages_of_one_start_repeat_it():
    """Oracle: an orbit run through several times, by hand."""

    def crossing(kind, impacts, parameter):
        return EndCrossing(kind, impacts, parameter, 0.0, 0.0, True, 0.0, 1.0)

    listed = [
        crossing("stop", 1, 0.3),
        crossing("origin", 3, 0.3 + 1e-13),
        crossing("stop", 4, 0.3),
        crossing("origin", 3, 0.4),
        crossing("origin", 2, 0.3),
    ]
    words = [("+", "+"), ("+", "+", "+"), ("+", "+", "+", "-", "-"), ("+", "+", "+"), ("+", "-")]
    first, repeated = first_crossings(listed, [1.1, 2.2, 3.3, 2.2, 2.9], words, "origin", 3.0)
    assert first == [0, 3, 4] and sorted(repeated) == [1, 2]
    words[1] = ("+", "+", "-")
    assert first_crossings(listed, [1.1, 2.2, 3.3, 2.2, 2.9], words, "origin", 3.0) == ([0, 1, 3, 4], [2])


def test_the_record():
    """Oracle: the keys of the format, numbers that JSON can hold, and the orbits themselves."""
    found = discover_orbits(SYSTEM, 1.0, quarter_period=3.0, impacts=4, ends=ALL)
    record = json.loads(discovery_to_json(found), parse_constant=lambda text: pytest.fail(text))
    assert list(record) == ["schema", "energy", "bounds", "complete", "counts", "orbits", "unpolished"]
    assert record["schema"] == 2 and record["energy"] == 1.0 and record["complete"] is True and record["unpolished"] == []
    assert record["bounds"] == {"quarter_period": 3.0, "impacts": 4, "ends": list(ALL)} and record["counts"] == found.counts
    for entry, orbit in zip(record["orbits"], found.orbits, strict=True):
        assert list(entry) == [
            "label", "family", "ends", "sequence", "impacts", "alpha", "h", "velocities", "impact_speeds", "tau", "stable", "residual",
        ]  # fmt: skip
        assert entry["alpha"] == orbit.alpha and entry["family"] is None and entry["sequence"] == orbit.sequence
        assert entry["impacts"] == impacts_per_period(orbit.problem.sequence, orbit.ends) / 2
        assert (entry["velocities"] is None) == (orbit.ends[0] != "origin") and entry["label"] == (orbit.label or None)


CASES = [
    (dict(energy=0.0), "the energy is 0.0"),
    (dict(energy=math.nan), "the energy is nan"),
    (dict(energy=math.inf), "the energy is inf"),
    (dict(quarter_period=-1.0), "quarter period is -1.0"),
    (dict(system=saltus.vibro_impact_nes(mu=1e-9)), "fastest mode .*1e.04.* rotates by 4e.04 .*quarter period up to 0.5 can be searched"),
    (dict(impacts=-2), "impacts of half a period is -2"),
    (dict(impacts=1.5), "1.5, expected an integer"),
    (dict(ends=("origin-sop",)), "unknown ends 'origin-sop'.*nearest: origin-stop"),
    (dict(ends=()), r"the ends are \(\), expected a list"),
    (dict(system=saltus.vibro_impact_nes(rho=0.5)), "restitution 0.5"),
    (dict(system=one_sided(), ends=("origin-origin",)), "the ends origin-origin need odd symmetry"),
    (
        dict(system=ImpactSystem(np.eye(2), np.zeros((2, 2)), [[1.0, -1.0], [-1.0, 1.0]], SYSTEM.stops), ends=("rest-rest",)),
        "need a positive stiffness along the stop; received 0",
    ),
    (dict(system=ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), -1.0, 1.0),))), "two degrees of freedom; this system has 1"),
    (
        dict(system=ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), (Stop((1.0, 0.0), -1, 1), Stop((0.0, 1.0), -1, 1)))),
        "one stop; this one has 2",
    ),
]


@pytest.mark.parametrize(("given", "message"), CASES)
def test_what_cannot_be_searched(given, message):
    """Oracle: the message."""
    options = {"system": SYSTEM, "energy": 1.0, "quarter_period": 2.0, "impacts": 2} | given
    with pytest.raises(ValueError, match=message):
        discover_orbits(options.pop("system"), options.pop("energy"), **options)


def test_a_system_without_odd_symmetry_is_searched_between_all_the_ends_that_it_has():
    """Oracle: the same search with these ends named."""
    given = {"ends": ("rest-rest", "rest-stop", "stop-stop")}
    default, named = (discover_orbits(one_sided(), 1.0, quarter_period=3.0, impacts=2, **ends) for ends in ({}, given))
    assert default.ends == named.ends and default.orbits
    assert [orbit.solution.y.tobytes() for orbit in default.orbits] == [orbit.solution.y.tobytes() for orbit in named.orbits]


def test_problems_kept_from_other_searches_change_nothing():
    """Oracle: the same search in a thread of its own, where nothing is kept: every orbit bit for bit, in the same order."""

    def bits(system, energy):
        found = discover_orbits(system, energy, quarter_period=3.0, impacts=4)
        return [(orbit.ends, orbit.sequence, orbit.solution.y.tobytes()) for orbit in found.orbits]

    searches = [(system, energy) for system in (SYSTEM, saltus.vibro_impact_nes(0.2)) for energy in (0.3, 0.5, 0.31)] * 2
    together = [bits(*search) for search in searches]
    for search, orbits in zip(searches, together, strict=True):
        with ThreadPoolExecutor(1) as thread:
            assert thread.submit(bits, *search).result() == orbits != []


@pytest.mark.parametrize("energy", [0.26367582, 1.0965121, 1.7633065])
def test_rounding_does_not_order_orbits(energy):
    """Oracle: the order is the same whatever the last digits of the quarter periods are. At these energies pairs of orbits of different
    families have quarter periods that are the same to rounding."""
    found = discover_orbits(SYSTEM, energy, quarter_period=5.1, impacts=10, ends=ALL)
    orbits = [Found(orbit.problem, orbit.solution, None) for orbit in found.orbits]
    periods = np.array([orbit.alpha for orbit in orbits])
    assert np.min(np.diff(periods) / periods[1:]) < 3e-15
    noise = np.random.default_rng(7)
    for _ in range(20):
        shuffled = [orbits[i] for i in noise.permutation(len(orbits))]
        for orbit in shuffled:
            orbit.alpha = orbit.solution["quarter_period"] * (1.0 + 3e-15 * noise.uniform(-1.0, 1.0))
        assert in_order(shuffled) == orbits
