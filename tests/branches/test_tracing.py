"""Families as they are followed: each orbit is one, each event is where it is said, each label counts what it says.

Oracles: conservation of energy; the event-driven run, which shares no equation with the boundary-value problem; the saltation
product in numpy; dense samples; the closed form of both backbones is in tests/saltus/test_continue.py.
"""

import math

import numpy as np
import pytest

import saltus
from benchmarks.saltation import monodromy as saltation_monodromy
from branches.branch import Ended
from branches.family import SETTINGS
from branches.naming.labels import Label
from branches.tracing import HIGHEST, cut_branch, follow_family
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from continuation.control import BLOCK
from tests.branches.traced import EPS, count_label, monodromy, spread, traced

NAMES = "S13O00+", "S11O00-", "S73O33-", "U8353-", "S11E11+@h=3.0", "S35O22+@h=1.0,alpha=4.91349"


@pytest.fixture(params=NAMES, scope="module")
def branch(request):
    """A family of the reference system: two backbones, symmetric ones, unsymmetric ones, rest ends, unstable orbits."""
    return traced(request.param)


def sampled(branch, count=9):
    return [branch.orbit(i) for i in spread(branch, count)]


def test_each_orbit_keeps_its_energy_and_passes_no_stop(branch):
    """Oracle: conservation of energy, to 1e-13 relative, and |u1 - u2| <= 1, sampled over two periods and across impacts."""
    for orbit in sampled(branch):
        times = np.concatenate([np.linspace(0.0, 2.0 * orbit.period, 10_001), [impact.time for impact in orbit.impacts]])
        u, v = orbit.sample(times)
        assert np.max(np.abs(branch.system.energy(u, v) / orbit.h - 1.0)) < 1e-13
        assert np.max(np.abs(u[:, 0] - u[:, 1])) < 1.0 + 1e-12


def test_each_orbit_returns_to_itself_in_the_event_driven_run(branch):
    """Oracle: a run of one period by the next-impact search; it returns within 100 eps |monodromy| |state|."""
    compared = 0
    for orbit in sampled(branch):
        u, v = orbit.sample(np.zeros(1))
        start = np.concatenate([u[0], v[0]])
        run = saltus.simulate(branch.system, u[0], v[0], orbit.period)
        bound = 100.0 * EPS * np.linalg.norm(monodromy(orbit), 2) * np.linalg.norm(start)
        assert np.linalg.norm(run.final - start) < bound, (orbit.h, orbit.alpha)
        if bound < 0.01 * min(impact.speed for impact in orbit.impacts):  # else its own error may turn a slow impact into none
            assert list(run.stop_events.contacts) == [impact.stop for impact in orbit.impacts]
            compared += 1
    assert compared > 0


def test_multipliers_are_those_of_the_saltation_product(branch):
    """Oracle: eigenvalues of the monodromy formed in numpy; it has two trivial ones, a Jordan pair, known to sqrt(eps) only.
    The trace decides stability where it is further from 2 than its error."""
    for orbit in sampled(branch, 25):
        product = monodromy(orbit)
        size = np.linalg.norm(product, 2)
        tau = np.trace(product) - 2.0
        assert abs(orbit.tau - tau) < 1e3 * EPS * size + 1e-9 * abs(tau), (orbit.h, orbit.tau, tau)
        assert abs(np.sum(orbit.multipliers).real - orbit.tau) < (1e-9 + 4.0 * EPS * size) * max(1.0, abs(orbit.tau))
        assert abs(np.prod(orbit.multipliers) - 1.0) < 1e-9 + 4.0 * EPS * size
        assert orbit.quality["reliable"] is True
        if abs(abs(tau) - 2.0) > 1e4 * EPS * size:
            assert orbit.stable is bool(abs(tau) < 2.0), (orbit.h, tau)
        formed = np.trace(saltation_monodromy(orbit.cycle))  # the product of the benchmarks
        assert abs(formed - np.trace(product)) < 1e4 * EPS * size + 1e-9 * abs(np.trace(product))


def test_labels_count_half_waves_and_impacts(branch):
    """Oracle: sign changes of u1' and u2' and impacts, counted on dense samples of the half period."""
    compared = 0
    for i in spread(branch, 12):
        orbit = branch.orbit(i)
        m, n, first, second, quarter = count_label(orbit)
        if any(event.point == i for event in branch.events):
            continue
        symmetric = branch.ends != ("origin", "origin")
        parity = ("O" if quarter else "E") if symmetric else None
        u, v = orbit.sample(np.zeros(1))
        expected = Label("S" if parity else "U", m, n, parity, first, second, "+" if v[0, 0] * v[0, 1] > 0 else "-")
        assert orbit.label == str(expected) == branch.points["label"][i], (orbit.h, orbit.alpha)
        compared += 1
    assert compared > 3


def test_symmetric_orbits_are_antiperiodic(branch):
    """Oracle: u(t + T/2) = -u(t) where a quarter was solved."""
    if branch.ends == ("origin", "origin"):
        return
    orbit = branch.orbit(len(branch) // 2)
    times = np.linspace(0.0123, 0.9871, 50) * orbit.period
    u, v = orbit.sample(times)
    later_u, later_v = orbit.sample(times + 0.5 * orbit.period)
    assert np.max(np.abs(later_u + u)) < 1e-12 * np.max(np.abs(u)) and np.max(np.abs(later_v + v)) < 1e-11 * np.max(np.abs(v))


def test_points_and_events_are_in_order_of_arclength(branch):
    """Oracle: the definition of arclength: chords of (start / sqrt(2 h), log h, log alpha) are no longer, and nearly as long."""
    s = branch.points["arclength"]
    assert s[0] == 0.0 and np.all(np.diff(s) > 0.0)
    assert all(a.arclength <= b.arclength for a, b in zip(branch.events, branch.events[1:], strict=False))
    h, alpha = branch.points["h"], branch.points["alpha"]
    chords = np.hypot(np.diff(np.log(h)), np.diff(np.log(alpha)))
    assert np.all(chords <= np.diff(s) * (1.0 + 1e-6) + 1e-9)
    assert np.max(branch.points["residual"]) < 1e-12


def test_events_lie_in_their_brackets(branch):
    """Oracle: the bracket, 1e-10 wide in arclength where the event is located; at a branch point the equations are singular. Where rounding
    refuses the steps inside, as at strongly unstable orbits, a bracket is wider, up to the width of one event."""
    assert branch.events
    widths = []
    for event in branch.events:
        low, high = event.bracket
        assert low <= event.arclength <= high and branch.points["arclength"][event.point] == event.arclength
        assert branch.points["h"][event.point] == event.h and branch.points["alpha"][event.point] == event.alpha
        if event.type != "BP":
            assert event.status == "located" and high - low < SETTINGS.coincidence_tolerance, event
            widths.append(high - low)
    assert np.median(widths) <= 1.01 * SETTINGS.location_tolerance


@pytest.mark.parametrize("name", [name for name in NAMES if name != "U8353-"])
def test_tau_at_the_events(name):
    """Oracle: tau = 2 at SN, BP and SB, -2 at PD, 2 cos(2 pi p/q) at RT, from the saltation product. U8353- has no such event."""
    branch = traced(name)
    events = [event for event in branch.events if event.type in ("SN", "BP", "SB", "PD", "RT")]
    assert len(events) >= 3
    for event in events:
        product = monodromy(branch.orbit(event.point))
        p, q = {"PD": (1, 2)}.get(event.type) or event.p_q or (0, 1)
        expected = 2.0 * math.cos(2.0 * math.pi * p / q)
        slope = np.gradient(branch.points["tau"], branch.points["arclength"])
        steep = np.nanmax(np.abs(slope[max(0, event.point - 3) : event.point + 4]))
        error = 1e4 * EPS * np.linalg.norm(product, 2) + (event.bracket[1] - event.bracket[0]) * steep
        assert abs(np.trace(product) - 2.0 - expected) < (error if event.type != "BP" else 1e-6), event


def test_grazing_ends_are_grazing():
    """Oracle: the orbits at the ends: a wall is touched to 1e-9 without an impact, or an impact has no speed."""
    kinds = set()
    for name in NAMES:
        branch = traced(name)
        for event in branch.events:
            if event.type != "GR":
                continue
            kinds.add("touches" in event.note)
            assert event.point in (0, len(branch) - 1)
            orbit = branch.orbit(event.point)
            if "touches" in event.note:
                u, _ = orbit.sample(np.linspace(0.0, orbit.period, 200001))
                w = u[:, 0] - u[:, 1]
                times = np.linspace(0.0, orbit.period, 200001)
                away = np.min(np.abs(times[:, None] - np.array([x.time for x in orbit.impacts])), axis=1) > 1e-2
                reached = np.max(np.abs(w[away]))
                assert 1.0 - 1e-6 < reached < 1.0 + 1e-9
            else:
                assert min(x.speed for x in orbit.impacts) < 1e-8 * math.sqrt(2.0 * orbit.h)
                assert event.multiplier is None and event.stable is None
    assert kinds == {True, False}


def test_a_multiplier_above_a_hundred_million_keeps_its_pair():
    """Oracle: the product of a pair is 1, to 1e-6 relative; orbits next to grazing, by the saddle-point route."""
    branch = traced("S11O00-")
    quarter = 0.5 * math.pi / branch.system.modes.frequencies[1]
    for apart in (1e-5, 1.5e-5, 2e-5):
        solution = branch.problem.solve(branch.unknowns(1), quarter_period=quarter * (1.0 - apart))
        found = saddle_point_multipliers(cycle_of(branch.problem, solution.y))
        assert abs(found.values[0]) > 1e8 and found.reliable
        assert abs(found.values[0] * found.values[1] - 1.0) < 1e-6


# ------------------------------------------------------------------------------------------------------- how a family is followed


def test_tracing_on_from_a_saved_point_is_the_same_branch(tmp_path):
    """Oracle: the branch itself: id, ends, events and energies of the family traced on from several of its points."""
    branch = traced("S13O00+")
    branch.save(tmp_path / "branch.json")
    saved = saltus.read_branch(tmp_path / "branch.json")
    for i in (1, 20, len(saved) // 2, len(saved) - 2):
        again = saved.trace(i, energy=(0.05, 1e4))
        assert again.id == branch.id
        types = [event.type for event in again.events]
        assert types == [event.type for event in branch.events]
        for mine, theirs in zip(again.events, branch.events, strict=True):
            assert math.isclose(mine.h, theirs.h, rel_tol=1e-9) and math.isclose(mine.alpha, theirs.alpha, rel_tol=1e-9)


def test_conditions_of_the_user():
    """Oracle: the condition itself; the words that it gives are the reason."""
    branch = saltus.trace("S13O00+", direction="up", stop_when=lambda orbit: orbit.alpha < 1.65 and "alpha is below 1.65")
    assert branch.ended[1].reason == "STOP_WHEN" and "alpha is below 1.65" in branch.ended[1].text
    assert branch.points["alpha"][-1] < 1.65 and np.all(branch.points["alpha"][:-1] >= 1.65)


def test_a_condition_that_holds_at_the_start_ends_the_family_there():
    """Oracle: the condition itself."""
    branch = saltus.trace("S13O00+", stop_when=lambda orbit: orbit.h < 1e3 and "low energy")
    assert len(branch) == 1 and branch.events == () and branch.points["h"][0] < 1e3
    assert all(end.reason == "STOP_WHEN" and "low energy, at the start already" in end.text for end in branch.ended)


@pytest.mark.parametrize("sigma", [0.0, 0.1])
@pytest.mark.parametrize("energy", [(0.3, 0.7), (0.2, 0.3), (0.1301, 7.3)])
@pytest.mark.parametrize("name", ["S11O00-@h=0.3", "S13O00+@h=0.3"])
def test_the_ends_lie_inside_the_range(name, energy, sigma):
    """Oracle: the range asked for, whose bound may be the start; points have arclengths of their own."""
    branch = saltus.trace(name, saltus.vibro_impact_nes(mu=0.1, sigma=sigma), energy=energy)
    h = branch.points["h"]
    assert energy[0] * (1.0 - 4.0 * EPS) <= h.min() and h.max() <= energy[1] * (1.0 + 4.0 * EPS)
    assert np.all(np.diff(branch.points["arclength"]) > 0.0)
    ends = [event for event in branch.events if event.type == "EP"]
    assert ends and all(min(abs(event.h / bound - 1.0) for bound in energy) < 1e-9 for event in ends)
    assert math.isclose(h[branch.start], 0.3, rel_tol=1e-12)


def test_an_interrupted_run_keeps_what_it_has():
    """Oracle: the points before the interruption travel with it, in order of arclength: those reported and the rest of their block. After a
    search it is the full branch."""

    def interrupt(count):
        if count >= 150:
            raise KeyboardInterrupt

    full = saltus.trace("S13O00+")
    with pytest.raises(KeyboardInterrupt) as caught:
        follow_family(full.problem, full.unknowns(full.start), energy=full.energy, on_point=interrupt)
    kept = caught.value.branch
    assert 150 <= len(kept) < 150 + BLOCK and np.all(np.diff(kept.points["arclength"]) > 0.0)
    assert set(kept.ended) == {Ended("INTERRUPTED", "the run was interrupted here; trace on from this point")}
    assert np.allclose(kept.points["h"], full.points["h"][full.start - kept.start :][: len(kept)], rtol=1e-10)
    with pytest.raises(KeyboardInterrupt) as caught:
        saltus.trace("S13O00+", on_point=interrupt)
    assert len(caught.value.branch) == len(full) and caught.value.branch.ended == full.ended


def test_callbacks_get_what_the_branch_has():
    """Oracle: the branch that is returned."""
    events, ends, counts = [], [], []
    branch = saltus.trace("S95E22-", energy=(0.05, 10.0), on_event=events.append, on_end=ends.append, on_point=counts.append)
    found, kept = (sorted((e.type, e.number, e.h, e.label, e.note) for e in some) for some in (events, branch.events))
    assert found == kept
    assert tuple(ends) == branch.ended and counts[-1] == len(branch)


def test_a_start_far_from_any_orbit_is_refused():
    """Oracle: ten times a solution."""
    branch = traced("S13O00+")
    with pytest.raises(RuntimeError, match="the family could not be followed: the start could not be corrected onto a family"):
        follow_family(branch.problem, 10.0 * branch.unknowns(5))


def test_the_identity_does_not_depend_on_the_way():
    """Oracle: one family has one id: from several starts, in either order, by name and by name with a suffix."""
    branch = traced("S13O00+")
    ids = {branch.trace(i, energy=(0.05, 1e4), rising=rising).id for i in (5, 60, -5) for rising in (True, False)}
    ids |= {saltus.trace(name).id for name in ("S13+", "S13O00+@h=0.5", "S13O00+@alpha=1.66")}
    assert ids == {branch.id}
    assert saltus.trace(branch.id).id == branch.id


def test_without_a_range_a_family_ends_where_its_forces_are_lost():
    """Oracle: the documented highest energy, on the backbone whose energy has no bound."""
    branch = saltus.trace("S11O00-", saltus.vibro_impact_nes(), energy=(0.5, 2.0))
    further = branch.trace(-1, direction="up")
    assert further.points["h"].max() <= HIGHEST * (1.0 + 1e-12) and further.events[-1].type == "EP"


@pytest.mark.parametrize(("name", "energy"), [("S13O00+", (1.0, 5.0)), ("S11O00-", (0.07, 2.0)), ("S73O33-@alpha=4.866", (0.1, 0.5))])
def test_a_cut_branch_is_what_is_followed_in_its_range(name, energy):
    """Oracle: the family followed in that range from the same orbit. Both have the same events, ends, id and other pieces."""
    found = saltus.trace(name, energy=energy, points=2)
    start = found.unknowns(found.start)
    full, anew = (follow_family(found.problem, start, energy=limits) for limits in ((0.05, 1e3), energy))
    cut = cut_branch(full, energy)
    assert cut.energy == energy and len(cut) < len(full) and np.all(np.diff(cut.points["arclength"]) > 0.0)
    assert [(e.id, e.type, e.label, e.note) for e in cut.events] == [(e.id, e.type, e.label, e.note) for e in anew.events]
    for mine, other in zip(cut.events, anew.events, strict=True):
        assert math.isclose(mine.h, other.h, rel_tol=1e-9) and abs(mine.arclength - other.arclength) < 1e-8
        assert mine.h == cut.points["h"][mine.point] and mine.number == mine.point - cut.start
        assert math.isclose(mine.arclength, cut.points["arclength"][mine.point], abs_tol=1e-12)
    assert [end.reason for end in cut.ended] == [end.reason for end in anew.ended]
    assert cut.points["h"][cut.start] == full.points["h"][full.start]
    assert cut.id == full.id and cut.others == anew.others


def test_a_branch_is_not_cut_where_its_start_is_outside():
    """Oracle: the energy of the start."""
    full = saltus.trace("S13O00+", energy=(0.2, 5.0))
    h = full.points["h"][full.start]
    assert cut_branch(full, (1.1 * h, 5.0)) is None and cut_branch(full, (0.9 * h, 1.1 * h)) is not None
