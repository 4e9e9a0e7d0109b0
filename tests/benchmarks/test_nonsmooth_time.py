"""The paper's own method: shooting in nonsmooth time, against the closed form and against the orbits of the multipoint problem."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.peers.nonsmooth_time import TOLERANCE, NotMatched, Shot, Stagnates, solve_nonsmooth_time
from bvp.closures import cycle_of
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import chain, collection

ALPHA = 1.7


def rounded(values, digits):
    """A guess: the values to some significant digits."""
    return [float(f"{value:.{digits - 1}e}") for value in values]


@pytest.mark.parametrize("integrator", ["RK45", "DOP853"])
@pytest.mark.parametrize(("alpha", "h"), [(1.7, 0.58875), (0.5, None)])
def test_the_backbones_keep_within_the_tolerance(alpha, h, integrator):
    """Oracle: closed form of both backbones (S13O00+ and S11O00-), and the published h = 0.58875 at alpha = 1.7. Ten
    thousand times the tolerance is at least a hundred times the error."""
    system = vibro_impact_nes()
    exact = backbone.origin_velocity(system, alpha)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        orbit = solve_nonsmooth_time(system, alpha, rounded(exact, 2), tolerance=tolerance, integrator=integrator)
        assert orbit.mismatch < tolerance and orbit.tolerance == tolerance
        errors.append(abs(orbit.h / backbone.energy(system, alpha) - 1.0))
        assert errors[-1] < 10.0 * tolerance
        assert np.allclose(orbit.velocities, exact, atol=10.0 * tolerance, rtol=0.0)
        assert [impact[1] for impact in orbit.impacts] in (["+", "-"], ["-", "+"])
        assert np.allclose([impact[0] for impact in orbit.impacts], [alpha, 3.0 * alpha], atol=10.0 * tolerance)
        if h is not None and tolerance < 1e-5:
            assert abs(orbit.h - h) < 5e-6
    assert errors[2] < 0.01 * errors[0]


def test_orbits_with_inner_impacts():
    """Oracle: the multipoint problem: velocities, energy, times, stops and speeds of all impacts over the period."""
    found = [x for x in collection() if x.problem.ends[0] == "origin" and x.problem.inner >= 2 and abs(x.solution["trace"]) < 50.0][:8]
    assert len(found) >= 5 and max(x.problem.inner for x in found) >= 4
    for orbit in found:
        problem, system, y = orbit.problem, orbit.problem.system, orbit.solution.y
        n = system.degrees_of_freedom
        velocities = (system.modes.to_state @ problem.start(y))[n:]
        cycle = cycle_of(problem, y)
        near = solve_nonsmooth_time(system, problem.quarter_period(y), rounded(velocities, 6), tolerance=1e-9)
        assert np.isclose(near.h, problem.energy(y), rtol=1e-6), orbit.name
        assert [impact[1] for impact in near.impacts] == list(cycle.letters), orbit.name
        assert np.allclose([impact[0] for impact in near.impacts], cycle.times, atol=1e-6)
        assert np.allclose([impact[2] for impact in near.impacts], cycle.speeds, atol=1e-5)


def test_three_masses():
    """Oracle: the closed form of one impact a half period for any linear system."""
    system = chain(np.random.default_rng(2), 3, grounded=True)
    alpha = next(a for a in np.linspace(0.3, 2.0, 18) if backbone.is_physical(system, a))
    exact = backbone.origin_velocity(system, alpha)
    orbit = solve_nonsmooth_time(system, alpha, rounded(exact, 4))
    assert np.isclose(orbit.h, backbone.energy(system, alpha), rtol=1e-5)
    assert orbit.tolerance == TOLERANCE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"system": vibro_impact_nes(lam=0.01)}, "damping"),
        ({"system": vibro_impact_nes(rho=0.9)}, "restitution 0.9"),
        ({"system": ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), (Stop((1.0, -1.0), upper=1.0),))}, "odd symmetry"),
        ({"quarter_period": -1.0}, "quarter_period.*-1"),
        ({"velocities": [1.0]}, "2 finite numbers"),
        ({"velocities": [0.0, 0.0]}, "all zero"),
        ({"tolerance": 0.0}, "tolerance.*0"),
        ({"tolerance": 9e-14}, "1e-13 or more.*9e-14"),
        ({"tolerance": float("nan")}, "NaN"),
        ({"integrator_tolerance": -1e-9}, "integrator_tolerance.*-1e-09"),
    ],
)
def test_what_it_cannot_do_is_refused(change, words):
    """Oracle: the message names what was received."""
    given = {"system": vibro_impact_nes(), "quarter_period": ALPHA, "velocities": [1.4, 1.0]} | change
    with pytest.raises(ValueError, match=words):
        solve_nonsmooth_time(**given)


def test_shooting_that_stands_still_ends(monkeypatch):
    """Oracle: an end with noise of 1e-9 is not matched to 1e-12; as many shots as corrections with it would take are not made."""
    from benchmarks.peers import nonsmooth_time

    shoot, shots = nonsmooth_time._shoot, []

    def noisy(*given, **options):
        shot = shoot(*given, **options)
        shots.append(shot)
        return shot._replace(end=shot.end + 1e-9 * np.sin(1e3 * len(shots) + np.arange(2.0)))

    monkeypatch.setattr(nonsmooth_time, "_shoot", noisy)
    with pytest.raises(Stagnates, match=r"stagnates at a mismatch of .*e-(09|10|11), not below 1\.0e-12"):
        solve_nonsmooth_time(vibro_impact_nes(), ALPHA, [1.4, 1.0], tolerance=1e-12, integrator_tolerance=1e-10)
    assert len(shots) < 3 * 20


@pytest.mark.rounding
def test_shooting_that_does_not_arrive_is_reported():
    """Oracle: the motion at rest satisfies both ends, and is no orbit that impacts; and the message has the mismatch that stays, whose
    digits are those of an iteration that does not converge, on any one machine."""
    with pytest.raises(NotMatched, match="without impacts"):
        solve_nonsmooth_time(vibro_impact_nes(), 0.05, [1e-3, 1e-3])
    with pytest.raises(NotMatched, match="mismatch of .*, not below 1.0e-02") as refused:
        solve_nonsmooth_time(vibro_impact_nes(), ALPHA, [3.0, 1.0], tolerance=0.01, integrator_tolerance=0.01, integrator="DOP853")
    assert float(re.search(r"mismatch of (\S+),", str(refused.value)).group(1)) > 0.01


@pytest.mark.parametrize(
    ("gap", "words"),
    [(lambda begin, tau: 1.0, r"penetrated a stop by \S+ between two steps"), (lambda begin, tau: begin - tau, "missed a flight")],
)
def test_an_integrator_that_passes_a_stop_is_reported(gap, words, monkeypatch):
    """Oracle: events that see no impact at all, and events that see one where the flight begins, in place of the integrator's."""
    from scipy import integrate

    whole = integrate.solve_ivp

    def blind(motion, span, state, *, events, **options):
        def event(tau, state):
            return gap(span[0], tau)

        event.terminal, event.direction = True, -1.0
        return whole(motion, span, state, events=[event] * len(events), **options)

    monkeypatch.setattr(integrate, "solve_ivp", blind)
    with pytest.raises(NotMatched, match=f"{words}.*smaller tolerance"):
        solve_nonsmooth_time(vibro_impact_nes(), ALPHA, [30.0, 1.0])


def ends_at(*end):
    """A shot with an end that the start has no influence on."""
    return lambda *given: Shot(np.array(end), [], 0.0)


def no_step(*given, **options):
    """An integrator that stops."""
    return SimpleNamespace(success=False, message="no step")


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("scipy.integrate.solve_ivp", no_step, "the integrator failed: no step"),
        ("benchmarks.peers.nonsmooth_time._FLIGHTS", 0, "more than 0 impacts in half a period"),
        ("benchmarks.peers.nonsmooth_time._shoot", ends_at(1.0, 1.0), "mismatch of 1.0e[+]00: the end does not depend on the start"),
        ("benchmarks.peers.nonsmooth_time._shoot", ends_at(np.inf, 1.0), "shooting diverged from a mismatch of inf"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_shooting_that_fails_says_why(monkeypatch, name, value, said):
    """Oracle: what is put in place of a part of it."""
    monkeypatch.setattr(name, value)
    with pytest.raises(NotMatched, match=f"{said}$"):
        solve_nonsmooth_time(vibro_impact_nes(), ALPHA, [1.4, 1.0])
