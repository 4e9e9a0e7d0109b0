"""Hard cases at grazing: folds beside it, the collapse into it, touches, impacts that merge, and what lies beyond."""

import math
from functools import partial

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import root as solve_equations

import saltus
from branches.orbit import orbit_columns
from branches.tracing import follow_family
from bvp.forcing import Harmonic
from bvp.motion import EventKind, MotionStatus
from bvp.multipoint import MultipointProblem
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.test_grazing import met
from tests.bvp.high_precision import Exact, dot, flow
from tests.bvp.orbits import backbone_segment
from tests.hard.cases import hard, largest
from tests.hard.digits import Closed, relative, root
from tests.lab.paths import ImpactStatus, next_impact

SYSTEM = vibro_impact_nes()
DIGITS_60 = "60-digit solution of the same equations"


def forced_orbit(v, c=0.1, restitution=0.8, d=1.0):
    """x'' + c x' + x = A cos(t + phase), stop x <= d: (A, phase) of the orbit with one impact a period 2 pi at speed v, phase from the
    impact. Linear in the free motion and the steady one: x = d at both ends of the flight, x' = -r v at its start and v at its end."""
    w, t = math.sqrt(1.0 - 0.25 * c * c), 2.0 * math.pi
    e, cosine, sine = math.exp(-0.5 * c * t), math.cos(w * t), math.sin(w * t)
    rows = [[1, 0, 0, 1], [-0.5 * c, w, 1, 0], [e * cosine, e * sine, 0, 1]]
    rows.append([-e * (0.5 * c * cosine + w * sine), e * (w * cosine - 0.5 * c * sine), 1, 0])
    _, _, p, q = np.linalg.solve(rows, [d, -restitution * v, d, v])
    return c * math.hypot(p, q), math.atan2(q, p)


@hard(
    "a forced oscillator with a fold 2.9e-5 below its grazing: the orbit with one impact a period, and its least amplitude",
    source="published: grazing at A = 0.1 exactly, fold at A = 0.099970753628; closed form of the orbit",
    limit=1e-12,
    what="A at the fold; impact speeds after a period, absolute",
)
def test_a_fold_just_below_a_grazing():
    """Families in a parameter of the load are not followed; the fold is the least A for which the run returns to itself."""
    system = ImpactSystem([[1.0]], [[0.1]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=0.8),))

    def after_a_period(v, amplitude, phase):
        load = Harmonic(1.0, cosine=[amplitude * math.cos(phase)], sine=[-amplitude * math.sin(phase)])
        motion = Simulator(system, forces=load).run([1.0], [-0.8 * v], 3.0 * math.pi, max_impacts=1)
        assert motion.kinds[-1] == EventKind.IMPACT.value
        return motion.times[-1] - 2.0 * math.pi, -motion.speeds[-1] - v if motion.speeds[-1] < 0 else motion.speeds[-1] - v

    worst = largest(*(abs(after_a_period(v, *forced_orbit(v))[1]) for v in (0.5, 0.1, 0.01, 0.0041115)))
    speeds = 0.0041115 + 5e-4 * np.arange(-2, 3)
    least = []
    for v in speeds:
        guess = np.array(forced_orbit(v))
        found = solve_equations(lambda x, v=v: after_a_period(v, *x), guess + [1e-8, 1e-7], method="hybr", options={"xtol": 1e-15})
        least.append(found.x[0])
    shape = np.polynomial.Polynomial.fit(speeds, least, 4)
    (at,) = [x.real for x in shape.deriv().roots() if abs(x.imag) < 1e-9 and 0.0038 < x.real < 0.0044]
    assert abs(at - 0.0041115) < 1e-7
    touching = Simulator(system, forces=Harmonic(1.0, cosine=[0.1])).run([0.0], [1.0], 100.0)
    assert touching.impacts == 0 and touching.touches == 16
    return largest(worst, abs(shape(at) - 0.099970753628))


def near_pair():
    """The family U4223+ with its fold 4e-8 below the grazing at which it begins."""
    problem = MultipointProblem(SYSTEM, ("origin", "origin"), ("+", "-", "+", "-", "+"))
    times = [0.455706330705, 1.319362162351, 1.386911737524, 0.933221643285, 1.371056609366, 1.037447119094]
    start = problem.modes.from_state @ [0.0, 0.0, 3.397686270487, 1.158302632655]
    solution = problem.solve(problem.pack(start, None, np.array(times)))
    branch = follow_family(problem, solution.y, energy=(1.2, 1.25))
    return branch.trace(len(branch) // 2, energy=(1.2, 1.25))  # not from the fold itself


def energy_slope(exact, x):
    """dh by the held unknown."""
    step, values = mp.mpf(10) ** -15, []
    for sign in (1, -1):
        exact.move(x + sign * step)
        values.append(exact.energy())
    return (values[0] - values[1]) / (2 * step)


def last_speed(exact, x):
    """Rate of the gap at the last of five inner impacts."""
    exact.move(x)
    problem = exact.problem
    at = problem.parameters + 1 + 3 * (problem.size + 1)
    return dot(exact.segment.gap_rate[4], flow(exact.squares, exact.y[at : at + problem.size], exact.flight_times()[4]))


@hard(
    "U4223+: a fold 4.1e-8 below the grazing at which the family begins",
    source=DIGITS_60,
    limit=1e-13,
    what="energies of both, relative",
)
def test_a_fold_beside_a_grazing_of_a_family():
    branch = near_pair()
    fold = next(e for e in branch.events if e.type == "SN")
    graze = next(e for e in branch.events if e.type == "GR")
    worst = 0.0
    for event in (fold, graze):
        exact = Exact(branch.problem, branch.orbit(event.point).solution)
        base = exact.y[exact.held]

        function = partial(energy_slope if event is fold else last_speed, exact)
        at = mp.findroot(function, (base, base + mp.mpf(10) ** -9), solver="secant", tol=mp.mpf(10) ** -40)
        exact.move(at)
        worst = largest(worst, float(abs(exact.energy() / mp.mpf(event.h) - 1)))
    assert 4.1e-8 < graze.h - fold.h < 4.2e-8
    return worst


def side(sign):
    """(solution, problem, closed form) on one side of the grazing of each linear mode, with impact speeds of about 1e-1 ... 1e-12: the
    speed is sum b^2 / G, and G goes as b^2 / (w^2 (edge - alpha)) there."""
    for mode in (0, 1):
        for power in range(1, 13):
            edge = math.pi / 2.0 / float(Closed(SYSTEM, 1.0).frequencies[mode])
            b = SYSTEM.modes.contacts.gap[0, :2]
            alpha = edge - sign * 10.0**-power * (b[mode] / SYSTEM.modes.frequencies[mode]) ** 2 / float(np.sum(b * b))
            problem, y = backbone_segment(SYSTEM, alpha)
            yield problem.solve(y * (1.0 + 1e-7), quarter_period=alpha), problem, Closed(SYSTEM, alpha)


@pytest.mark.parametrize("sign", [1, -1], ids=["physical", "beyond"])
@hard(
    "collapse into the grazing of a linear mode from both sides, impact speeds 1e-1 ... 1e-12 and -1e-1 ... -1e-12: the orbit",
    source="closed form in 50 digits",
    limit=1e-14,
    what="velocities at the origin, relative; impact speed, absolute",
)
def test_collapse_into_grazing(sign):
    worst, slowest = 0.0, 1.0
    for solution, problem, exact in side(sign):
        velocities = (SYSTEM.modes.to_state @ problem.start(solution.y))[2:]
        worst = largest(worst, relative(velocities, exact.origin), float(abs(solution["speed"] - exact.speed)))
        slowest = min(slowest, abs(float(exact.speed)))
    assert slowest < 2e-12
    return worst


@pytest.mark.parametrize("sign", [1, -1], ids=["physical", "beyond"])
@hard(
    "the same: multipliers, which grow as one over the square of the speed, at speeds down to 1e-3",
    source="closed form in 50 digits",
    limit=1e-11,
    what="tau (1e0 to 7e5), relative",
)
def test_multipliers_beside_grazing(sign):
    """Closer still they stay right until they are said to be unbounded, below 1e-8 of sqrt(2 h): to 1e-6 at 1e-8."""
    worst = 0.0
    for solution, problem, exact in side(sign):
        columns = orbit_columns(problem, [solution])
        speed = abs(float(exact.speed)) / math.sqrt(2.0 * float(exact.energy))
        if speed < 1e-8:
            assert np.isnan(columns["tau"][0]) and columns["stable"][0] == -1 and not columns["reliable"][0]
            continue
        error = float(abs(columns["tau"][0] / (exact.tau_half() ** 2 - 2) - 1))
        assert error < 1e-6 and columns["reliable"][0]
        assert columns["stable"][0] == 0
        worst = largest(worst, error) if speed > 5e-4 else worst
    return worst


@hard(
    "the family with two more impacts that meets S13O00+ at the grazing of the other wall, impact speeds 1e-1 ... 1e-11",
    source=DIGITS_60,
    limit=1e-14,
    what="all unknowns, relative to the largest",
)
def test_collapse_from_the_family_with_more_impacts():
    """Its multipliers, up to 5e14, at speeds down to 7.9e-4 are right to 1e-10."""
    _, _, found = met("S13O00+", 14.5537)
    item = next(item for item in found if item.branch is not None and item.ends == ("origin", "stop+"))
    branch = item.branch
    at = branch.orbit(item.event.point).solution
    worst, slowest = 0.0, 1.0
    for power in range(1, 12):
        steps = [branch.problem.step(at.y, at.tangent, sign * 10.0**-power) for sign in (1, -1)]
        solution = max((step for step in steps if step is not None), key=lambda step: step["speed"])
        exact = Exact(branch.problem, solution)
        differences = [abs(float(a - mp.mpf(float(b)))) for a, b in zip(exact.y, solution.y, strict=True)]
        worst = largest(worst, largest(*differences) / np.max(np.abs(solution.y)))
        slowest = min(slowest, solution["speed"])
        if power <= 3:
            phi = exact.half_map()
            tau = (2 + 4 * phi[0][1] * phi[1][0]) ** 2 - 2
            assert abs(orbit_columns(branch.problem, [solution])["tau"][0] / tau - 1) < 1e-10
    assert slowest < 5e-11
    return worst


@pytest.mark.parametrize("power", range(1, 13))
@hard(
    "touch and go: double roots of the gap, hit or passed by 1e-1 ... 1e-12, and touched exactly",
    source="closed form: u = (1 + depth) sin t against u <= 1",
    limit=1e-15,
    what="time of the hit times its speed",
)
def test_touch_and_go(power):
    """Exactly touched: recorded as touches, one a period, and the motion goes on."""
    oscillator = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), upper=1.0),))
    depth = 10.0**-power
    hit = next_impact(oscillator, [0.0], [1.0 + depth], 3.0)
    assert hit.status is ImpactStatus.HIT and hit.speed == pytest.approx(math.sqrt(depth * (2.0 + depth)), rel=1e-15 / depth + 1e-14)
    assert next_impact(oscillator, [0.0], [1.0 - depth], 3.0).status is ImpactStatus.NONE
    assert next_impact(oscillator, [0.0], [1.0], 3.0).status is ImpactStatus.TOUCH
    events = simulate(oscillator, [0.0], [1.0], 40.0).stop_events
    assert events.touches.all() and len(events.times) == 7
    assert np.abs(events.times - math.pi / 2 - 2 * math.pi * np.arange(7)).max() < 1e-6
    exact = mp.asin(1 / mp.mpf(1.0 + depth))
    return float(abs(hit.time - exact)) * hit.speed


@pytest.mark.parametrize("offset", [0.0, 1e-16, -1e-16, 1e-14, -1e-14, 1e-9, -1e-9])
@hard(
    "an impact at the very end of a flight: motions cut at each impact, and beside it by 1e-16, 1e-14, 1e-9, and taken up again",
    source="closed form: u = 2 sin t against u <= 1, impacts at pi/6 + 4 pi k/3",
    limit=1e-13,
    what="times of ten impacts; each is met once",
)
def test_an_impact_at_the_end_of_a_flight(offset):
    oscillator = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), upper=1.0),))
    exact = math.pi / 6.0 + 4.0 * math.pi / 3.0 * np.arange(10)
    worst = 0.0
    for k in range(10):
        first = simulate(oscillator, [0.0], [2.0], float(exact[k] * (1.0 + offset)))
        second = simulate(oscillator, first.final[:1], first.final[1:], float(exact[9] + 1.0 - first.duration))
        assert first.status is second.status is MotionStatus.DURATION_REACHED
        met, later = first.stop_events, second.stop_events
        times = np.concatenate([met.times, first.duration + later.times])
        assert len(times) == 10 and not met.touches.any() and not later.touches.any(), (k, len(met.times), len(later.times))
        assert len(met.times) == k + (offset > 1e-15) or abs(offset) < 1e-13
        worst = largest(worst, np.max(np.abs(times - exact)))
    return worst


def two_stops(coupling):
    """Two masses, each with its own stop, joined by a spring or not; the impulses do not act on each other."""
    stops = (Stop((1.0, 0.0), -1.0, 1.0, name="a"), Stop((0.0, 1.0), -0.8, 0.8, name="b"))
    return ImpactSystem([[1.0, 0.0], [0.0, 1.5]], np.zeros((2, 2)), [[2.0, coupling], [coupling, 1.6]], stops)


def both_at_once(system, alpha):
    """Velocities at the origin of the orbit that hits both stops a quarter period later, in 50 digits: u = C P, mode by mode."""
    with mp.workdps(50):
        masses = [mp.sqrt(mp.mpf(float(m))) for m in np.diag(system.mass)]
        stiffness = mp.matrix([[mp.mpf(float(system.stiffness[i, j])) / masses[i] / masses[j] for j in (0, 1)] for i in (0, 1)])
        squares, vectors = mp.eigsy(stiffness)
        shapes = mp.matrix([[vectors[i, k] / masses[i] for k in (0, 1)] for i in (0, 1)])
        w = [mp.sqrt(x) for x in squares]
        response = mp.matrix(2)
        for i in (0, 1):
            for j in (0, 1):
                response[i, j] = mp.fsum(shapes[i, k] * shapes[j, k] * mp.tan(w[k] * alpha) / w[k] for k in (0, 1))
        half = mp.lu_solve(response, mp.matrix([stop.upper for stop in system.stops]))
        p = [mp.fsum(shapes[i, k] * half[i] for i in (0, 1)) / mp.cos(w[k] * alpha) for k in (0, 1)]
        return [mp.fsum(shapes[i, k] * p[k] for k in (0, 1)) for i in (0, 1)]


@pytest.mark.parametrize("coupling", [0.0, -0.7])
@hard(
    "zero-length flights: impacts at two stops at one instant, along a full family",
    source="closed form in 50 digits",
    limit=1e-14,
    what="velocities at the origin, relative; duration of the flight between, absolute",
)
def test_impacts_that_merge(coupling):
    """An elastic motion that hits both at one instant goes back the way it came, so the impacts are at one instant all along its family.

    The equations are regular in the flight times; the run takes the two in turn where their impulses do not act on each other, and stops
    where they do. The order of two such impacts says nothing, so such a family ends at once, with GR.
    """
    system = two_stops(coupling)
    modes = system.modes
    problem = MultipointProblem(system, ("origin", "origin"), ("a+", "b+"))
    worst = 0.0
    for alpha in (0.2, 0.6, 1.0):
        exact = both_at_once(system, mp.mpf(alpha))
        start = modes.from_state @ np.array([0.0, 0.0, *map(float, exact)])
        motion = simulate(system, [0.0, 0.0], [float(x) for x in exact], 1.5 * alpha)
        assert motion.status is MotionStatus.DURATION_REACHED and sorted(motion.stop_events.contacts) == ["a+", "b+"]
        last = modes.from_state @ motion.stop_events.after[-1]
        first = last.copy()
        b = modes.contact_letters.index("b+")
        first += 2.0 * modes.contacts.push[b] * -(modes.contacts.rate[b] @ first)
        guess = problem.pack(start, [first, last], [alpha, 0.0, alpha])
        solution = problem.solve(guess * (1.0 + 1e-5 * np.cos(np.arange(len(guess)))), quarter_period=alpha)
        velocities = (modes.to_state @ problem.start(solution.y))[2:]
        worst = largest(worst, relative(velocities, exact), abs(problem.flight_times(solution.y)[1]))
        ended = follow_family(problem, solution.y, energy=(1e-3, 1e3)).ended
        assert all(end.text.startswith("GR at h") for end in ended)
    coupled = [[1.0, 0.3], [0.3, 1.0]]
    mixed = ImpactSystem(coupled, np.zeros((2, 2)), coupled, (Stop((1.0, 0.0), upper=0.5), Stop((0.0, 1.0), upper=0.5)))
    assert simulate(mixed, [0.0, 0.0], [1.0, 1.0], 5.0).status is MotionStatus.SIMULTANEOUS
    return worst


@hard(
    "unphysical solutions - through the wall, negative impact speed: solved, flagged, refused as a start, and never passed by a family",
    source="closed form in 50 digits",
    limit=1e-12,
    what="by how far the wall is pierced, and the negative speed",
)
def test_unphysical_continuation():
    worst = 0.0
    for alpha in (1.639, 1.635):
        problem, y = backbone_segment(SYSTEM, alpha)
        solution = problem.solve(y, quarter_period=alpha)
        exact = Closed(SYSTEM, alpha)
        lowest = root(exact.rate, 0.7, 0.9)
        worst = largest(worst, float(abs(solution["clearance"] - (1 - abs(exact.gap(lowest))))))
        assert solution["clearance"] < 0.0
        with pytest.raises(ValueError, match="no orbit: flight 1 of 1 passes beyond stop - by"):
            follow_family(problem, solution.y)
    edge = math.pi / 2.0 / SYSTEM.modes.frequencies[1]
    for alpha in (edge + 1e-3, edge + 1e-6):
        problem, y = backbone_segment(SYSTEM, alpha)
        solution = problem.solve(y, quarter_period=alpha)
        worst = largest(worst, float(abs(solution["speed"] - Closed(SYSTEM, alpha).speed)))
        assert solution["speed"] < 0.0
        with pytest.raises(ValueError, match="is no orbit"):
            follow_family(problem, solution.y)
    for name in ("S13O00+", "S11O00-"):
        branch = saltus.trace(name, SYSTEM, energy=(0.05, 50.0))
        assert np.all(branch.points["impact_speeds"] > -1e-9)
    return worst
