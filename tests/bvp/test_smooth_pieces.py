"""Smooth flights in pieces. Oracles: the Taylor series of the motion and of its variation in fifty digits; equality of paths."""

from __future__ import annotations

import json

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.special import ellipk

from branches.branch import Branch
from branches.forced.record import problem_from, problem_record
from branches.forced.tracing import follow_response, go_on
from branches.naming.at_modes import orbit_at_mode
from branches.orbit import Orbit
from branches.presentation import closed_presentation, presentation_of
from branches.reading import branch_of_record
from branches.record import to_record
from branches.released.branch import ReleasedBranch
from branches.tracing import follow_family
from bvp.multipoint import GROWTH, MultipointProblem, NotConverged
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop

COUPLING = 0.3
DIGITS = 50


def saddle(rate: float) -> ImpactSystem:
    """x'' + x + c (x - y)^3 = 0, y'' - rate^2 y + c (y - x)^3 = 0: a family of unstable oscillations about a saddle of the potential."""
    spring = Spring((1.0, -1.0), stiffness=COUPLING, power=3.0)
    return ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, -rate * rate]), (), springs=(spring,))


def in_parameters() -> ParametricSystem:
    """The same system, with its rate and its coupling as parameters."""
    spring = {"between": ["u1", "u2"], "stiffness": "c", "power": 3}
    system = {"mass": [[1.0, 0.0], [0.0, 1.0]], "stiffness": [[1.0, 0.0], [0.0, "-r**2"]], "springs": [spring]}
    return ParametricSystem.from_description({"parameters": {"r": 4.0, "c": COUPLING}, "system": system})


def advanced(columns, rate: float, time, steps: int):
    """The state [x, y, x', y'] and columns of its variation after a time, by Taylor series of order 40."""
    order, h = 40, time / steps
    for _ in range(steps):
        series = [[[entry] for entry in column] for column in columns]
        w, square = [], []
        for k in range(order):
            state = series[0]
            w.append(state[0][k] - state[1][k])
            square.append(sum(w[j] * w[k - j] for j in range(k + 1)))
            for i, column in enumerate(series):
                own = w if i == 0 else [column[0][j] - column[1][j] for j in range(k + 1)]
                force = (1 if i == 0 else 3) * mpf(COUPLING) * sum(square[j] * own[k - j] for j in range(k + 1))
                rates = (column[2][k], column[3][k], -column[0][k] - force, mpf(rate) ** 2 * column[1][k] + force)
                for r in range(4):
                    column[r].append(rates[r] / (k + 1))
        columns = [[mpmath.polyval(entry[::-1], h) for entry in column] for column in series]
    return columns


def exact(rate: float, energy: float, guess):
    """(quarter period, largest multiplier) of the orbit between origin and rest."""
    velocities, time = [mpf(float(v)) for v in guess.velocities], mpf(float(guess.alpha))
    for _ in range(3):
        end, first, second = advanced([[0, 0, *velocities], [0, 0, 1, 0], [0, 0, 0, 1]], rate, time, 8)
        x, y, *speeds = end
        force = mpf(COUPLING) * (x - y) ** 3
        rates = -x - force, mpf(rate) ** 2 * y + force
        residual = mp.matrix([*speeds, (velocities[0] ** 2 + velocities[1] ** 2) / 2 - mpf(energy)])
        jacobian = mp.matrix([[first[2], second[2], rates[0]], [first[3], second[3], rates[1]], [*velocities, 0]])
        change = mp.lu_solve(jacobian, residual)
        velocities, time = [velocities[0] - change[0], velocities[1] - change[1]], time - change[2]
    _, *columns = advanced([[0, 0, *velocities], *([mpf(r == c) for r in range(4)] for c in range(4))], rate, 4 * time, 32)
    tau = sum(columns[c][c] for c in range(4)) - 2
    return time, tau / 2 + mp.sqrt(tau * tau / 4 - 1)


def quarter(rate: float, energy: float) -> Orbit:
    """The orbit between origin and rest at an energy, along the family of the linear mode."""
    system = saddle(rate)
    problem = MultipointProblem(system, ("origin", "rest"), ())
    mode = int(np.argmax(system.modes.squares))
    start = np.zeros(4)
    start[2 + mode] = np.sqrt(2e-4) * np.sign(system.modes.shapes[0, mode])
    y = problem.pack(start, None, [np.pi / 2.0])
    return follow_family(problem, y, energy=(1e-4, 1.1 * energy)).orbit_at(energy=energy)


def read_branch_of(branch: Branch) -> Branch:
    """A branch, written and read."""
    return branch_of_record(json.loads(json.dumps(to_record(branch))))


def closed_problem(orbit: Orbit, pieces: int) -> tuple[MultipointProblem, np.ndarray]:
    """The problem of the same orbit, closed on itself, and the unknowns there."""
    image = closed_presentation(orbit.cycle)
    problem = MultipointProblem(orbit.system, image.ends, image.sequence, pieces)
    return problem, image.unknowns(problem)


@pytest.mark.parametrize("rate", [4.0])
def test_pieces_keep_the_digits_of_strongly_unstable_orbits(rate):
    """Oracle: see `require_pieces_keep_the_digits_of_strongly_unstable_orbits`."""
    require_pieces_keep_the_digits_of_strongly_unstable_orbits(rate)


def require_pieces_keep_the_digits_of_strongly_unstable_orbits(rate):
    """Oracle: the orbit and its largest multiplier, 1.2e9 and 3.9e18, in fifty digits; the product of a pair is 1. Along the whole period
    perturbations grow by the multiplier, so that of the end 7 digits, or none, are left."""
    orbit = quarter(rate, 1.0)
    with mp.workdps(DIGITS):
        time, multiplier = exact(rate, 1.0, orbit)
        assert abs(orbit.alpha / time - 1) < 1e-15 * 4 and orbit.residual < 1e-14
        alone = closed_problem(orbit, 1)
        if rate == 4.0:
            assert Orbit(alone[0], alone[0].solve(alone[1], energy=1.0)).residual > 1e-11
        else:
            with pytest.raises(NotConverged):
                alone[0].solve(alone[1], energy=1.0)
        problem = alone[0].in_enough_pieces(alone[1])
        assert problem.pieces > 1
        y = alone[0].in_pieces_of(problem, alone[1])
        # In half the period a rounding error grows by the root of the multiplier.
        assert np.abs(problem.residual(y)).max() < 100.0 * 1e-16 * float(mp.sqrt(multiplier))
        found = Orbit(problem, problem.solve(y, energy=1.0))
        # Each piece leaves the digits that its growth, 200 at most, takes.
        assert problem.growth(found.solution.y) < 1e3
        assert found.residual < 1e-14 and abs(found.alpha / time - 1) < 1e-14
        for one in (orbit, found):
            assert abs(one.multipliers[0] / multiplier - 1) < 1e-12
            assert abs(one.multipliers[1] * multiplier - 1) < 1e-9
            assert one.quality["reliable"] and not one.stable


def test_a_family_begins_at_a_mode_beside_one_that_grows():
    """Oracle: the orbit and its multiplier, 5.9e46, in 80 digits. Along the quarter period perturbations grow by 10^13. In other pieces the
    orbit is as good as its cuts."""
    begun = orbit_at_mode("mode:2", saddle(20.0), (1e-3, 1.0))
    orbit = follow_family(begun.problem, begun.solution.y, energy=(1e-3, 1.1)).orbit_at(energy=1.0)
    with mp.workdps(80):
        time, multiplier = exact(20.0, 1.0, orbit)
        assert multiplier > 1e46 and abs(orbit.alpha / time - 1) < 1e-14
        assert abs(orbit.multipliers[0] / multiplier - 1) < 1e-11 and not orbit.stable
    other = MultipointProblem(orbit.system, orbit.ends, (), 2 * orbit.problem.pieces + 1)
    assert np.abs(other.residual(orbit.problem.in_pieces_of(other, orbit.solution.y))).max() < 1e-11


def test_a_family_that_grows_unstable_is_followed_again_in_pieces():
    """Oracle: the family ends at the energy asked for; points and events are reported once, as those of the branch; its file keeps the
    pieces."""
    seen, events = [], []
    orbit = quarter(6.0, 2.0)
    problem = MultipointProblem(orbit.system, orbit.ends, ())
    start = orbit.problem.in_pieces_of(problem, orbit.solution.y)
    assert problem.in_enough_pieces(start) is problem
    branch = follow_family(problem, start, energy=(1e-3, 2.1), on_point=seen.append, on_event=events.append)
    assert branch.problem.pieces > 1
    assert {end.text.split(": ")[1] for end in branch.ended} == {"lowest energy asked for", "highest energy asked for"}
    assert seen == sorted(set(seen)) and seen[-1] == len(branch)
    assert sorted(event.id for event in events) == sorted(event.id for event in branch.events)
    assert read_branch_of(branch).orbit(0).residual < 1e-14


def in_rate(orbit: Orbit, rate: float, interval: tuple[float, float], **options) -> ReleasedBranch:
    """The family of an orbit at the energy 1 in the rate."""
    problem = ReleasedProblem(in_parameters(), orbit.ends, (), ["r"], ["energy = 1"], values={"r": rate}, energy=1.0)
    branch = follow_response(problem, problem.of_orbit(orbit.problem, orbit.solution.y), interval, **options)
    assert isinstance(branch, ReleasedBranch)
    return branch


def test_a_family_in_a_parameter_is_followed_again_in_pieces():
    """Oracle: the orbit at the last rate in fifty digits; points and events are reported once; the problem of a file keeps the pieces."""
    seen, events = [], []
    branch = in_rate(quarter(4.0, 1.0), 4.0, (4.0, 8.0), on_point=seen.append, on_event=events.append)
    assert branch.problem.pieces > 1 and max(map(branch.problem.growth, branch.unknowns)) < GROWTH
    assert seen == sorted(set(seen)) and seen[-1] == len(branch) and [event.code for event in events] == ["EP", "EP"]
    last = branch.orbit(len(branch) - 1)
    with mp.workdps(DIGITS):
        time, multiplier = exact(8.0, 1.0, last)
        assert abs(last.alpha / time - 1) < 1e-14 and abs(last.multipliers[0] / multiplier - 1) < 1e-11
    assert branch.residual.max() < 1e-14
    again = problem_from(in_parameters(), json.loads(json.dumps(problem_record(branch.problem))))
    assert np.array_equal(again.residual(branch.unknowns[-1]), branch.problem.residual(branch.unknowns[-1]))


def test_a_branch_in_a_parameter_goes_on_in_more_pieces():
    """Oracle: the family that was followed at once; all points solve the equations of the problem in more pieces."""
    orbit = quarter(4.0, 1.0)
    first, whole = in_rate(orbit, 4.0, (4.0, 4.5)), in_rate(orbit, 4.0, (4.0, 8.0))
    branch, ends = go_on(first, (4.0, 8.0))
    assert first.problem.pieces == 1 < branch.problem.pieces and ends == [len(branch) - 1]
    assert max(np.abs(branch.problem.residual(y)).max() for y in branch.unknowns) < 1e-13
    assert np.all(np.diff(branch.parameter) > 0.0) and np.all(np.diff(branch.arclength) > 0.0)
    assert branch.orbit(len(branch) - 1).alpha == pytest.approx(whole.orbit(len(whole) - 1).alpha, rel=1e-13)
    slopes = branch.tangents[:, 2 * branch.problem.degrees_of_freedom + 1]
    assert np.all(slopes > 0.0)


def test_closed_orbits_are_followed_in_a_parameter_in_pieces():
    """Oracle: the same orbits between an origin and an end at rest. Over the period perturbations grow by 1e9, and more with the rate."""
    orbit = quarter(4.0, 1.0)
    alone = closed_problem(orbit, 1)
    problem = alone[0].in_enough_pieces(alone[1])
    closed = Orbit(problem, problem.solve(alone[0].in_pieces_of(problem, alone[1]), energy=1.0))
    one, other = (in_rate(given, 4.0, (4.0, 4.5)) for given in (orbit, closed))
    assert isinstance(other.problem, ReleasedProblem) and other.problem.pieces > 4 and other.residual.max() < 1e-13
    for i in (0, -1):
        ends = [branch.orbit(i % len(branch)) for branch in (one, other)]
        assert ends[0].alpha == pytest.approx(ends[1].alpha, rel=1e-13)
        assert ends[0].multipliers[0] == pytest.approx(ends[1].multipliers[0], rel=1e-10)


@pytest.mark.parametrize("pieces", [2, 5])
def test_a_family_does_not_see_its_cuts(pieces):
    """Oracle: equality of paths. In pieces a family has the labels, events and multipliers of its whole flights."""
    spring = Spring((1.0, -1.0), stiffness=1.0, power=3.0)
    mass, stiffness = [[0.05, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]
    system = ImpactSystem(mass, np.zeros((2, 2)), stiffness, (), absorber=0, primary=1, springs=(spring,))
    whole = MultipointProblem(system, ("origin", "rest"), ())
    start = whole.pack([0.0, 0.0, 0.0, np.sqrt(2e-4)], None, [np.pi / 2.0])
    cut = MultipointProblem(system, ("origin", "rest"), (), pieces)
    one, other = (follow_family(problem, whole.in_pieces_of(problem, start), energy=(1e-4, 0.5)) for problem in (whole, cut))
    assert other.problem.pieces == pieces and len(one.events) > 10
    assert [(event.type, event.label) for event in one.events] == [(event.type, event.label) for event in other.events]
    assert np.allclose([event.h for event in one.events], [event.h for event in other.events], rtol=1e-9)
    assert one.id == other.id and one.points["flight_times"].shape[1] == other.points["flight_times"].shape[1] == 1
    a, b = (branch.orbit_at(energy=0.3) for branch in (one, other))
    assert abs(a.alpha / b.alpha - 1.0) < 1e-13 and np.allclose(a.multipliers, b.multipliers, rtol=1e-11) and a.label == b.label
    times = np.linspace(0.0, a.period, 9)
    assert np.allclose(a.sample(times), b.sample(times), atol=1e-11)


@pytest.mark.parametrize("ends", [("origin", "stop+"), ("periodic", "periodic")])
def test_cuts_between_impacts_are_no_impacts(ends):
    """Oracle: equality of paths. An orbit with impacts has their speeds, its clearance and its multipliers in pieces, too."""
    springs = (Spring((1.0, -1.0), stiffness=0.4, power=3.0),)
    stiffness = [[0.1, -0.1], [-0.1, 1.1]]
    stop = Stop((-1.0, 1.0), -1.0, 1.0)
    system = ImpactSystem([[0.1, 0.0], [0.0, 1.0]], np.zeros((2, 2)), stiffness, (stop,), absorber=0, primary=1, springs=springs)
    first = MultipointProblem(system, ("origin", "stop+"), ())
    orbit = Orbit(first, first.solve(first.pack([0.0, 0.0, 0.9, 0.6], [], [1.6]), quarter_period=1.6))
    sequence = orbit.cycle.letters if ends[0] == "periodic" else ()
    problems = [MultipointProblem(system, ends, sequence, pieces) for pieces in (1, 3)]
    image = closed_presentation(orbit.cycle) if ends[0] == "periodic" else presentation_of(first, orbit.solution.y)
    one, other = (Orbit(problem, problem.solve(image.unknowns(problem), energy=orbit.h)) for problem in problems)
    assert np.allclose(one.impact_speeds, other.impact_speeds, rtol=1e-12) and one.label == other.label
    assert np.allclose(one.multipliers, other.multipliers, rtol=1e-10) and one.stable == other.stable
    assert [impact.stop for impact in one.impacts] == [impact.stop for impact in other.impacts]
    for name in ("clearance", "speed", "first_quarter", "second_quarter"):
        assert one.solution[name] == pytest.approx(other.solution[name], rel=1e-10)


def test_a_strongly_unstable_orbit_is_read_from_a_point_without_its_pieces():
    """Oracle: equality of paths. A file of a family without the number of pieces, too, gives orbits to rounding."""
    problem, y = closed_problem(quarter(4.0, 1.0), 6)
    branch = follow_family(problem, y, energy=(0.5, 2.0), points=3)
    record = to_record(branch)
    del record["branch"]["pieces"]
    orbit = branch_of_record(json.loads(json.dumps(record))).orbit(1)
    assert orbit.residual < 1e-14 and orbit.problem.pieces > 1
    assert orbit.alpha == pytest.approx(branch.orbit(1).alpha, rel=1e-14)


def test_a_family_that_approaches_a_saddle_of_its_potential_ends_there():
    """Oracle: x'' + x - x^3 = 0 has saddles x = 1 and -1 of energy 1/4. Its orbit of turning point a, with h = a^2/2 - a^4/4, has the
    quarter period K(m)/sqrt(1 - a^2/2) with m = a^2/(2 - a^2): the energies below 1/4 are all those that there are."""
    spring = Spring((1.0,), stiffness=-1.0, power=3.0)
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (), springs=(spring,))
    problem = MultipointProblem(system, ("origin", "rest"), ())
    y = problem.solve(problem.pack([0.0, np.sqrt(0.46)], None, [2.4]), energy=0.23).y
    branch = follow_family(problem, y, energy=(0.22, 0.3))
    h, alpha = branch.points["h"], branch.points["alpha"]
    below = h < 0.2499
    square = 1.0 - np.sqrt(1.0 - 4.0 * h[below])
    assert alpha[below] == pytest.approx(ellipk(square / (2.0 - square)) / np.sqrt(1.0 - 0.5 * square), rel=1e-11)
    assert h.max() == pytest.approx(0.25, abs=1e-13)
    assert branch.ended[1].reason == "SADDLE" and "the equilibrium u1 = 1 of energy h = 0.25" in branch.ended[1].text
    with pytest.raises(ValueError, match=r"mode:1: .* up to h = 0\.25 \(there is no turning point beyond the equilibrium u1 = 1 "):
        orbit_at_mode("mode:1", system, (0.5, 1.0))
    assert orbit_at_mode("mode:1", system, (0.2499, 1.0)).h == pytest.approx(0.2499, rel=1e-9)


@pytest.mark.parametrize(
    ("potential", "linear", "words"),
    [
        ("1-1/(1+w**2)**2", 0.0, "its orbits approach the energy h = 1, at which the potential levels off beyond u1 = "),
        ("-w-log(1-w)", 2.0, "its orbits approach u1 = 1, beyond which the potential has no values"),
    ],
)
def test_the_end_of_a_potential_is_given_as_the_reason(potential, linear, words):
    """Oracle: the formulas of the potentials, one of which has a limit far away, and the other one a pole."""
    system = ParametricSystem.from_description(
        {"system": {"mass": [[1.0]], "stiffness": [[linear]], "springs": [{"c": [1.0], "potential": potential}]}}
    ).system()
    orbit = orbit_at_mode("mode:1", system, (0.02, 50.0))
    branch = follow_family(orbit.problem, orbit.solution.y, energy=(0.01, 50.0), direction="up")
    assert branch.ended[1].reason == "MINIMUM_STEP" and words in branch.ended[1].text
