"""Families of free orbits in a parameter: closed forms of points and events, closures that describe the same orbits, closed loops."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.backbone import Backbone
from branches.admissible import describe_grazing
from branches.forced.tracing import follow_response
from branches.tracing import follow_family
from bvp.multipoint import RESULT_INDEX, MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.system import vibro_impact_nes
from saltus import trace

NES = ParametricSystem.of(vibro_impact_nes())


def start(parametric, ends, sequence, names, keep, state, alpha, nodes=None, times=None, **wanted):
    """A problem and an orbit of it near a guess; keep is formatted with its energy h and quarter period alpha."""
    plain = MultipointProblem(parametric.system(), ends, sequence)
    guess = plain.pack(plain.modes.from_state @ np.array(state), nodes, [alpha] if times is None else times)
    y = plain.solve(guess, **(wanted or {"quarter_period": alpha})).y
    h, alpha = plain.energy(y), plain.quarter_period(y)
    problem = ReleasedProblem(parametric, ends, sequence, names, [text.format(h=h, alpha=alpha) for text in keep], energy=h)
    return problem, problem.of_orbit(plain, y), h


def in_phase(names, keep, alpha=1.7):
    """The in-phase backbone S13O00+, whose closed form is known."""
    return start(NES, ("origin", "stop+"), (), names, keep, [0.0, 0.0, 1.4, 1.0], alpha)


def out_of_phase(names, keep, alpha):
    """The out-of-phase backbone S11O00-."""
    state = np.concatenate([np.zeros(2), backbone.origin_velocity(NES.system(), alpha)])
    return start(NES, ("origin", "stop+"), (), names, keep, state, alpha)


def root(function, *near):
    """A root in 30 digits."""
    with mp.workdps(30):
        found = mp.findroot(function, [mp.mpf(value) for value in near])
        return [float(value) for value in found]


def event_of(branch, kind, number=1):
    return [event for event in branch.events if event.type == kind][number - 1]


@pytest.fixture(scope="module")
def in_mu():
    """S13O00+ in mu at the energy that it has at alpha = 1.7."""
    problem, y, h = in_phase(("mu",), ["energy = {h!r}"])
    return follow_response(problem, y, (0.02, 0.5)), h


def test_every_point_is_the_closed_form(in_mu):
    branch, h = in_mu
    for mu, alpha, speed in zip(branch.parameter, branch.columns["alpha"], branch.speeds[:, -1], strict=True):
        form = Backbone(mu, 0.1)
        if speed < 1e-6:
            continue
        with mp.workdps(30):
            wanted = mp.findroot(lambda a, form=form: form.energy(a) - mp.mpf(h), mp.mpf(alpha))
        assert alpha == pytest.approx(float(wanted), rel=1e-12)
    assert np.abs(branch.columns["h"] / h - 1.0).max() < 1e-13
    assert branch.parameter[-1] == pytest.approx(0.5, rel=1e-13)


def test_symmetry_breaks_where_the_trace_of_the_closed_form_is_minus_two(in_mu):
    branch, h = in_mu
    for event in [event for event in branch.events if event.type == "SB"]:
        near = event.values["mu"], event.values["quarter_period"]
        mu, _ = root(lambda mu, a: [Backbone(mu, 0.1).tau_half(a) + 2, Backbone(mu, 0.1).energy(a) - mp.mpf(h)], *near)
        assert event.values["mu"] == pytest.approx(mu, rel=1e-9)
    assert len([event for event in branch.events if event.type == "SB"]) == 2
    # Between the two the orbits are stable, as tau_half of the closed form says.
    first, last = (event.point for event in branch.events if event.type == "SB")
    assert (branch.stable[first + 1 : last] == 1).all() and (branch.stable[1:first] == 0).all() and (branch.stable[last + 1 :] == 0).all()


def test_the_impact_vanishes_at_the_grazing_of_the_linear_mode(in_mu):
    """There h = w^2/(2 b^2) and alpha = pi/(2 w), for the mode of the lower frequency."""
    branch, h = in_mu
    event = event_of(branch, "GR")

    def beyond(mu):
        w, _, b = Backbone(mu, 0.1).modes[0]
        return w**2 / (2 * b**2) - mp.mpf(h)

    with mp.workdps(30):
        mu = float(mp.findroot(beyond, mp.mpf(event.values["mu"])))
        w = float(Backbone(mu, 0.1).modes[0][0])
    assert event.values["mu"] == pytest.approx(mu, rel=1e-9)
    assert event.values["quarter_period"] == pytest.approx(math.pi / (2.0 * w), rel=1e-8)
    assert event.stop == "+" and branch.ended[0].text.startswith(f"GR at mu = {event.values['mu']:.12g}")


def test_fold_in_mu(in_mu):
    """At a fixed energy it is where the trace of the closed form is 2. The stability changes there."""
    problem, y, h = out_of_phase(("mu",), ["energy = {h!r}"], 1.2)
    branch = follow_response(problem, y, (0.09, 0.4))
    event = event_of(branch, "SN")

    near = event.values["mu"], event.values["quarter_period"]
    mu, alpha = root(lambda mu, a: [Backbone(mu, 0.1).tau_half(a) - 2, Backbone(mu, 0.1).energy(a) - mp.mpf(h)], *near)
    assert event.values["mu"] == pytest.approx(mu, rel=1e-11)
    assert event.values["quarter_period"] == pytest.approx(alpha, rel=1e-6)
    assert {int(branch.stable[event.point - 1]), int(branch.stable[event.point + 1])} == {0, 1}


def test_stability_at_a_fixed_quarter_period_changes_at_a_fold_in_the_energy():
    """The family in mu has no fold there. It is the orbit at which the closed form has the trace 2."""
    problem, y, _ = out_of_phase(("mu",), ["quarter_period = {alpha!r}"], 1.12)
    branch = follow_response(problem, y, (0.07, 0.12))
    event = next(event for event in branch.events if event.note == "fold in the energy, at these parameters")
    with mp.workdps(30):
        alpha, near = mp.mpf(event.values["quarter_period"]), mp.mpf(event.values["mu"])
        mu = mp.findroot(lambda mu: Backbone(mu, 0.1).tau_half(alpha) - 2, (0.99 * near, 1.02 * near), solver="anderson")
        # There the energy is stationary.
        assert abs(mp.diff(Backbone(mu, 0.1).energy, alpha, h=mp.mpf(10) ** -12)) < 1e-9
    assert event.values["mu"] == pytest.approx(float(mu), rel=1e-8)
    assert {int(branch.stable[event.point - 1]), int(branch.stable[event.point + 1])} == {0, 1}
    assert np.abs(np.diff(branch.parameter)).min() > 0.0


def test_two_parameters_with_two_equations():
    """The closed form along sigma = mu^2 + 0.09 and h = 4 mu + 0.0001 alpha."""
    problem, y, h = in_phase(("mu", "sigma"), ["sigma = mu**2 + 0.09", "energy = {h!r} + 4*(mu - 0.1) + (quarter_period - {alpha!r})/10"])
    branch = follow_response(problem, y, (0.08, 0.15), points=60)
    alpha = 1.7
    for i in range(0, len(branch), 7):
        at, found = problem.parameters(branch.unknowns[i]), float(branch.columns["alpha"][i])
        assert at["sigma"] == pytest.approx(at["mu"] ** 2 + 0.09, rel=1e-14)
        wanted = h + 4.0 * (at["mu"] - 0.1) + (found - alpha) / 10.0
        assert float(Backbone(at["mu"], at["sigma"]).energy(found)) == pytest.approx(wanted, rel=1e-12)


def test_around_a_closed_loop(in_mu):
    """In mu at one energy, in the energy, back in mu, and in the energy to the start: the orbit is the same."""
    branch, h = in_mu
    y = branch.unknowns[branch.start]

    def moved(name, keep, orbit, value):
        problem = ReleasedProblem(
            NES.replaced(orbit[1]), ("origin", "stop+"), (), (name,), [keep.format(h=orbit[0].h, alpha=orbit[0].alpha)], energy=orbit[0].h
        )
        begin = problem.of_orbit(orbit[0].problem, orbit[0].solution.y)
        default = problem.values[name]
        followed = follow_response(problem, begin, (min(default, value), max(default, value)))
        end = 0 if abs(followed.parameter[0] - value) < 1e-12 else -1
        return followed.orbit(end), {name: value}

    def risen(orbit, h):
        low, high = sorted((orbit[0].h, h))
        family = follow_family(orbit[0].problem, orbit[0].solution.y, energy=(low, high), direction="up" if h > orbit[0].h else "down")
        return family.orbits_at(energy=h)[-1], orbit[1]

    begin = branch.orbit(branch.start)
    here = moved("mu", "energy = {h!r}", (begin, {}), 0.12)
    here = risen(here, 0.75)
    here = moved("mu", "energy = {h!r}", here, 0.1)
    here = risen(here, h)
    plain, at = branch.problem.orbit_problem(y)
    assert here[0].alpha == pytest.approx(begin.alpha, rel=1e-11)
    assert here[0].solution.y == pytest.approx(at, abs=1e-10)
    assert plain.unknowns == len(at)


def chain(k=0.7, lower=-1.1):
    """Three masses in a chain; the first one has a stop."""
    return ParametricSystem.from_description(
        {
            "parameters": {"k": k, "d": 1.1},
            "system": {
                "mass": [[1.0, 0.0, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 1.3]],
                "stiffness": [["1 + k", "-k", 0.0], ["-k", "k + 0.9", -0.9], [0.0, -0.9, 1.6]],
                "stops": [{"c": [1.0, 0.0, 0.0], "upper": "d"} if lower is None else {"c": [1.0, 0.0, 0.0], "lower": "-d", "upper": "d"}],
            },
        }
    )


def test_chain_in_a_stiffness():
    """One impact a half period of three masses, at fixed energy: the closed form of any system in double precision."""
    parametric = chain()
    alpha = 1.15
    state = np.concatenate([np.zeros(3), 1.1 * backbone.origin_velocity(parametric.system(), alpha)])
    problem, y, h = start(parametric, ("origin", "stop+"), (), ("k",), ["energy = {h!r}"], state, alpha)
    branch = follow_response(problem, y, (0.4, 1.1))
    assert branch.parameter.min() < 0.69 and branch.parameter.max() > 0.71
    for i in range(len(branch)):
        if branch.speeds[i, -1] > 1e-4:
            system = parametric.system({"k": branch.parameter[i]})
            assert 1.21 * float(backbone.energy(system, branch.columns["alpha"][i])) == pytest.approx(h, rel=1e-11)


def test_chain_in_a_gap_on_one_side():
    """One impact a period on a one-sided stop, between rest and the stop, from the closed form. The motion scales with the gap."""
    parametric = chain(lower=None)
    period = 3.4
    u, v, _ = backbone.one_sided(parametric.system(), period)
    plain = MultipointProblem(parametric.system(), ("rest", "stop+"), ())
    w, shapes, _ = backbone.participation(parametric.system())
    begin = shapes @ ((shapes.T @ u) / np.cos(w * period / 2.0))  # at rest half a period before
    keep, times = ["quarter_period = {alpha!r}"], [period / 2.0]
    problem, y, h = start(parametric, ("rest", "stop+"), (), ("d",), keep, [*begin, 0.0, 0.0, 0.0], period / 4.0, times=times)
    assert plain.quarters == 2 and h > 0.0
    branch = follow_response(problem, y, (0.5, 2.0))
    assert branch.columns["h"] == pytest.approx(h * (branch.parameter / 1.1) ** 2, rel=1e-12)
    assert branch.speeds[:, -1] == pytest.approx(v[0] * branch.parameter / 1.1, rel=1e-11)


def test_a_periodic_closure_has_the_same_orbits(in_mu):
    """The full period of the symmetric orbits, with the unfolding parameter, which stays zero."""
    branch, h = in_mu
    orbit = branch.orbit(branch.start)
    cycle = orbit.cycle
    plain = MultipointProblem(NES.system(), ("periodic", "periodic"), cycle.letters)
    y = plain.solve(plain.pack(cycle.after[0], cycle.after[1:], cycle.duration), energy=h).y
    problem = ReleasedProblem(NES, ("periodic", "periodic"), cycle.letters, ("mu",), [f"energy = {h!r}"], energy=h)
    whole = follow_response(problem, problem.of_orbit(plain, y), (0.09, 0.13))
    assert np.abs(whole.unknowns[:, whole.problem.place - 1]).max() < 1e-14
    for mu, alpha in zip(whole.parameter, whole.columns["alpha"], strict=True):
        with mp.workdps(30):
            form = Backbone(mu, 0.1)
            wanted = float(mp.findroot(lambda a, form=form: form.energy(a) - mp.mpf(h), mp.mpf(alpha)))
        assert alpha == pytest.approx(wanted, rel=1e-12)


def test_a_family_ends_where_its_parameter_leaves_its_domain():
    """A stiffness of zero is the last one, though the system of a smaller one cannot be made."""
    problem, y, h = in_phase(("sigma",), ["energy = {h!r}"])
    branch = follow_response(problem, y, (-1.0, 0.12))
    assert branch.parameter[0] == pytest.approx(0.0, abs=1e-12)
    assert branch.ended[0].text.endswith("sigma leaves its domain here") and branch.events[0].values["sigma"] == branch.parameter[0]
    assert float(Backbone(0.1, mp.mpf(10) ** -18).energy(branch.columns["alpha"][0])) == pytest.approx(h, rel=1e-12)


def test_events_do_not_depend_on_the_start(in_mu):
    branch, h = in_mu
    orbit = branch.orbit(len(branch) // 2)
    problem = ReleasedProblem(
        NES.replaced({"mu": float(branch.parameter[len(branch) // 2])}), ("origin", "stop+"), (), ("mu",), [f"energy = {h!r}"], energy=h
    )
    other = follow_response(problem, problem.of_orbit(orbit.problem, orbit.solution.y), (0.02, 0.5))
    assert [event.type for event in other.events] == [event.type for event in branch.events]
    for one, two in zip(branch.events, other.events, strict=True):
        assert one.values["mu"] == pytest.approx(two.values["mu"], rel=1e-8)


def test_marked_values(in_mu):
    problem, y, _ = in_phase(("mu",), ["energy = {h!r}"])
    branch = follow_response(problem, y, (0.09, 0.13), values=(0.11, 0.125))
    assert [event.values["mu"] for event in branch.events if event.type == "UZ"] == pytest.approx([0.11, 0.125], abs=1e-12)


def test_events_are_those_of_families_in_the_energy():
    """S95E22- in mu at h = 0.345: at the parameter of each bifurcation, impulsive orbit and change of label, the family in the energy of
    that system has the same event, at the same energy."""
    begin = trace("S95E22-@h=0.345,alpha=8.155", energy=(0.34, 0.35)).orbits_at(energy=0.345)
    orbit = next(one for one in begin if abs(one.alpha - 8.155) < 0.01)
    problem = ReleasedProblem(NES, orbit.ends, orbit.problem.sequence, ["mu"], ["energy = 0.345"], energy=0.345)
    branch = follow_response(problem, problem.of_orbit(orbit.problem, orbit.solution.y), (0.095, 0.15))
    kinds = [event.type for event in branch.events]
    assert {kinds.count(kind) for kind in ("PD", "IO", "LB", "SB")} == {1} and kinds.count("RT") == 4
    for event in branch.events:
        if event.type != "EP":
            here = branch.orbit(event.point)
            near = follow_family(here.problem, here.solution.y, energy=(0.3449, 0.3451))
            family = follow_family(near.problem, near.unknowns(0), energy=(0.3449, 0.3451))
            same = [other for other in family.events if other.type == event.type]
            assert any(abs(other.h / 0.345 - 1.0) < 1e-8 for other in same), event
            # The two sides of a change of label are in the order of each branch.
            words = [sorted((other.note or "").partition(":")[0].split(" becomes ")) for other in same]
            assert sorted((event.note or "").partition(":")[0].split(" becomes ")) in words


def test_a_grazing_of_free_orbits_in_parameters_names_the_end_at_which_it_is():
    """Oracle: S13O00+ goes from the origin to stop +, where its only impact is. The family in the energy names the same place."""
    problem, y, h = in_phase(["mu"], ["energy = {h!r}"])
    plain, at = problem.orbit_problem(y)
    for solved, solution in ((problem, problem.solve(y)), (plain, plain.solve(at, energy=h))):
        solution.result[RESULT_INDEX["speed_node"]], solution.result[RESULT_INDEX["flight_index"]] = 0.0, 0.0
        assert describe_grazing(solved, solution, "vanishes")["note"].startswith("the impact at the far end (stop +) vanishes")
        assert describe_grazing(solved, solution, "merge")["note"].startswith("the start and the far end merge")
