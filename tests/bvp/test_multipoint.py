"""The multipoint problem: residual, Jacobian, Newton's solution.

Oracles: the same equations written again in numpy with complex numbers, differentiated by complex steps (exact to rounding);
closed forms of one-impact orbits; the numpy event-driven flow; refinement to 60 digits.
"""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import backbone
from bvp.closures import EndsError
from bvp.multipoint import RESULT_INDEX, MultipointProblem, NotConverged
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.flow_twin import Twin
from tests.bvp.high_precision import Exact
from tests.bvp.orbits import backbone_segment, chain, chains, collection
from tests.lab.problems import Equations

EPS = np.finfo(float).eps
ENDS = ("origin", "rest", "stop+", "stop-")


def residual_twin(problem, y, restitution=1.0, pull=1.0):
    """F(y) for complex y, in modal coordinates made by numpy. `restitution` and `pull` = -1 flip the sign of the restitution
    and of the spring forces: mutations that a test must notice."""
    system, n = problem.system, problem.half
    shapes = problem.modes.shapes
    squares = np.array([shapes[:, k] @ system.stiffness @ shapes[:, k] for k in range(n)])
    squares[np.abs(squares) < 1e-13 * np.max(np.abs(squares))] = 0.0
    w = np.sqrt(squares)
    letters = {}
    for stop in system.stops:
        c = shapes.T @ np.array(stop.gap)
        name = stop.name if len(system.stops) > 1 else ""
        letters[name + "-"] = (c, stop.lower, stop.restitution)
        letters[name + "+"] = (c, stop.upper, stop.restitution)

    def flow(z, t):
        cosine = np.cos(w * t)
        sine = np.where(w > 0, np.sin(w * t) / np.where(w > 0, w, 1.0), t)
        return np.concatenate([cosine * z[:n] + sine * z[n:], cosine * z[n:] - pull * squares * sine * z[:n]])

    def impact(z, letter):
        c, _, r = letters[letter]
        return np.concatenate([z[:n], z[n:] - (1.0 + restitution * r) * (c @ z[n:]) / (c @ c) * c])

    s = problem.parameters
    equations = Equations(problem)
    start = equations.start_map @ y[:s] + equations.start_offset
    sequence = problem.sequence[1:] if problem.periodic else problem.sequence
    out = []
    at = s
    z = start
    for letter in sequence:
        z = impact(flow(z, y[at]), letter)
        node = y[at + 1 : at + 1 + 2 * n]
        c, bound, _ = letters[letter]
        out += [*(z - node), c @ node[:n] - bound]
        z = node
        at += 2 * n + 1
    z = flow(z, y[at])
    if problem.periodic:
        gradient = np.concatenate([squares * start[:n], start[n:]])
        c, bound, _ = letters[problem.sequence[0]]
        out += [*(impact(z, problem.sequence[0]) + y[-1] * gradient - start), c @ start[:n] - bound]
    else:
        out += list(equations.end_map @ z - equations.end_offset)
    return np.array(out)


def jacobian_twin(problem, y, **signs):
    """F'(y) by complex steps."""
    columns = []
    for j in range(problem.unknowns):
        stepped = y.astype(complex)
        stepped[j] += 1e-30j
        columns.append(residual_twin(problem, stepped, **signs).imag / 1e-30)
    return np.array(columns).T


def random_sequence(rng, letters, length):
    return tuple(letters[i] for i in rng.integers(len(letters), size=length))


@st.composite
def problems(draw):
    """A random problem - system, ends, sequence - and random unknowns, which need not be near a solution."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["nes", "chain", "two stops"]))
    if kind == "nes":
        system = vibro_impact_nes(rng.uniform(0.01, 2.0), rng.choice([0.0, rng.uniform(0.0, 2.0)]))
    elif kind == "chain":
        system = chain(rng, int(rng.integers(2, 5)), bool(rng.integers(2)))
    else:
        stops = (Stop((1.0, -1.0), -1.0, 1.0), Stop((0.0, 1.0), -2.0, 2.0))
        system = ImpactSystem(np.diag([0.5, 1.0]), np.zeros((2, 2)), [[0.3, -0.3], [-0.3, 1.3]], stops)
    letters = system.modes.contact_letters
    stops = ["stop" + letter for letter in letters]
    ends = draw(
        st.one_of(
            st.tuples(st.sampled_from(["origin", "rest", *stops]), st.sampled_from(["origin", "rest", *stops])),
            st.just(("periodic", "periodic")),
        )
    )
    length = draw(st.integers(1 if ends[0] == "periodic" else 0, 5))
    problem = MultipointProblem(system, ends, random_sequence(rng, letters, length))
    y = rng.normal(size=problem.unknowns)
    return problem, y


@settings(max_examples=40)
@given(problems())
def test_residual_and_jacobian_against_complex_steps(case):
    problem, y = case
    size = 1.0 + np.max(np.abs(y)) * (1.0 + np.max(problem.modes.frequencies)) ** 2
    assert np.max(np.abs(problem.residual(y) - residual_twin(problem, y))) < 1e-13 * size**2
    jacobian = problem.jacobian(y)
    assert jacobian.shape == (problem.unknowns - 1, problem.unknowns)
    assert np.max(np.abs(jacobian - jacobian_twin(problem, y))) < 1e-13 * size**2


@settings(max_examples=25)
@given(problems())
def test_no_second_derivative_is_by_unknowns_of_two_flights(case):
    """Oracle: the Jacobian at displaced unknowns, which changes in the columns of one block alone."""
    problem, y = case
    base, blocks = problem.jacobian(y), problem.curvature_blocks
    alone = {problem.unknowns - 1} if problem.periodic else set()
    assert np.array_equal(np.concatenate(blocks), np.arange(problem.unknowns - len(alone)))
    assert len(blocks) == problem.inner + 1
    for block in blocks:
        for j in block:
            apart = np.zeros(problem.unknowns)
            apart[j] = 0.3
            changed = np.flatnonzero((problem.jacobian(y + apart) != base).any(axis=0))
            assert set(changed) <= set(block) | alone


@pytest.mark.parametrize("signs", [{"restitution": -1.0}, {"pull": -1.0}])
@pytest.mark.parametrize("ends", [("origin", "stop+"), ("rest", "origin"), ("periodic", "periodic")])
def test_a_flipped_sign_is_noticed(ends, signs):
    """The comparison above tells mutated equations from right ones, in the residual and in each kind of Jacobian block."""
    rng = np.random.default_rng(2)
    problem = MultipointProblem(vibro_impact_nes(0.4, 0.7), ends, ("+", "-", "+"))
    y = rng.normal(size=problem.unknowns)
    assert np.max(np.abs(problem.residual(y) - residual_twin(problem, y, **signs))) > 1e-3
    wrong = np.abs(problem.jacobian(y) - jacobian_twin(problem, y, **signs)) > 1e-3
    times = [problem.parameters + i * (problem.size + 1) for i in range(problem.inner + 1)]
    states = [j for j in range(problem.unknowns) if j not in times]
    assert np.any(wrong[:, times]) and np.any(wrong[:, states])


@pytest.mark.parametrize("index", range(0, 40, 4))
def test_the_tangent_is_the_null_vector(index):
    """J t = 0 for the tangent of the factorised Jacobian."""
    orbit = collection()[index]
    tangent, jacobian = orbit.solution.tangent[: orbit.problem.unknowns], orbit.problem.jacobian(orbit.solution.y)
    assert np.max(np.abs(jacobian @ tangent)) < 1e-12 * np.linalg.norm(jacobian) * np.linalg.norm(tangent)


@pytest.mark.parametrize("index", range(0, 40, 3))
def test_the_conditioning_is_the_smallest_singular_value(index):
    """Oracle: numpy's singular values of the Jacobian in scaled unknowns, its rows of length 1. The growth of n unit entries is sqrt(n)
    over the smallest one at most, and less as the signs and its singular vector have less in common."""
    orbit = collection()[index]
    jacobian = orbit.problem.jacobian(orbit.solution.y) * orbit.problem.scales(orbit.solution.y)
    jacobian /= np.linalg.norm(jacobian, axis=1)[:, None]
    smallest = np.linalg.svd(jacobian)[1][-1]
    assert smallest / np.sqrt(len(jacobian)) * (1.0 - 1e-6) < orbit.solution["conditioning"] < 30.0 * smallest


@pytest.mark.parametrize("mu, sigma", [(0.1, 0.1), (0.37, 0.81), (1.7, 0.2), (0.05, 1.9), (0.8, 0.0)])
@pytest.mark.parametrize("fraction", [0.05, 0.3, 0.6])
def test_backbone_is_a_solution_and_is_found_again(mu, sigma, fraction):
    """Closed form: residual at rounding; Newton from a point 2 % away returns to it at the same energy or quarter period."""
    system = vibro_impact_nes(mu, sigma)
    alpha = fraction * np.pi / 2 / np.max(system.modes.frequencies)
    assert backbone.is_physical(system, alpha)
    problem, y = backbone_segment(system, alpha)
    size = np.max(np.abs(y))
    assert np.max(np.abs(problem.residual(y))) < 1e-14 * max(1.0, size)
    rng = np.random.default_rng(1)
    near = y * (1.0 + 0.02 * rng.normal(size=y.size))
    solution = problem.solve(near, quarter_period=alpha)
    assert np.max(np.abs(solution.y - y)) < 1e-13 * size
    assert abs(solution["energy"] / backbone.energy(system, alpha) - 1.0) < 1e-13
    slope = abs(np.log(backbone.energy(system, alpha * 1.001) / backbone.energy(system, alpha)) / 1e-3)
    solution = problem.solve(near, energy=backbone.energy(system, alpha))
    assert np.max(np.abs(solution.y - y)) < 1e-13 * size * max(1.0, 1.0 / slope)
    assert solution["residual"] < 1e-14


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_backbone_of_chains(n):
    """The closed form holds for any number of degrees of freedom, rigid-body modes included."""
    rng = np.random.default_rng(n)
    if n == 1:
        system = ImpactSystem([[1.0]], [[0.0]], [[2.0]], (Stop((1.0,), -1.0, 1.0),))
    else:
        system = chain(rng, n, grounded=bool(n % 2))
    alpha = 0.4 * np.pi / 2 / np.max(system.modes.frequencies)
    assert backbone.is_physical(system, alpha)
    problem, y = backbone_segment(system, alpha)
    solution = problem.solve(y * (1.0 + 1e-3 * rng.normal(size=y.size)), quarter_period=alpha)
    assert solution["residual"] < 1e-14
    if n <= 2:
        assert np.max(np.abs(solution.y - y)) < 1e-13 * np.max(np.abs(y))
    assert np.max(np.abs(problem.residual(y))) < 1e-13 * np.max(np.abs(y))


def test_one_impact_on_a_one_sided_stop():
    """Closed form: rest to stop is half the period."""
    system = ImpactSystem(np.diag([1.0, 0.5]), np.zeros((2, 2)), [[1.5, -0.5], [-0.5, 0.7]], (Stop((1.0, 0.0), upper=1.0),))
    period = 0.9 * 2.0 * np.pi / np.max(system.modes.frequencies)
    u, v, _ = backbone.one_sided(system, period)
    problem = MultipointProblem(system, ("stop+", "rest"), ())
    after = system.modes.from_state @ np.concatenate([u, -v])
    y = problem.pack(after, np.zeros((0, 4)), [period / 2.0])
    assert np.max(np.abs(problem.residual(y))) < 1e-13 * np.max(np.abs(y))
    solution = problem.solve(y * 1.01, quarter_period=period / 4.0)
    assert np.max(np.abs(solution.y - y)) < 1e-12 * np.max(np.abs(y))


def test_many_words_at_many_systems():
    """At least 20 sequences with different ends at random systems; every residual at rounding level, energies as asked for."""
    found = collection()
    assert len({(orbit.problem.ends, orbit.problem.sequence) for orbit in found}) >= 20
    assert {len(orbit.problem.sequence) for orbit in found} >= {0, 1, 2, 3, 4, 5}
    for orbit in found:
        assert orbit.solution["residual"] < 2e-15 * (1 + orbit.problem.inner), orbit.name
        assert abs(orbit.solution["energy"] / orbit.energy - 1.0) < 1e-13, orbit.name
    larger = chains()
    assert len(larger) >= 20 and {orbit.problem.half for orbit in larger} == {3, 4, 5, 6}
    for orbit in larger:
        assert orbit.solution["residual"] < 1e-14


@pytest.mark.parametrize("index", range(0, 40, 5))
def test_solutions_are_right_to_rounding(index):
    """Refined to 60 digits, no unknown of a solution moves by more than rounding times the orbit's own sensitivity."""
    orbit = collection()[index]
    exact = Exact(orbit.problem, orbit.solution)
    assert exact.left < 1e-45
    y = np.array([float(value) for value in exact.y])
    held = int(np.argmax(np.abs(orbit.solution.tangent[: orbit.problem.unknowns])))
    inverse = np.linalg.inv(np.delete(orbit.problem.jacobian(orbit.solution.y), held, axis=1))
    assert np.max(np.abs(y - orbit.solution.y)) < 20.0 * EPS * max(1.0, np.linalg.norm(inverse, 2)) * np.max(np.abs(y))


def test_two_hundred_inner_impacts():
    """The hundred-fold cover of a stable backbone orbit as one segment between two origins; the closed form is its solution."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 1.0, impacts=200)
    assert problem.inner == 200
    rng = np.random.default_rng(0)
    solution = problem.solve(y * (1.0 + 1e-4 * rng.normal(size=y.size)), energy=backbone.energy(system, 1.0))
    assert np.max(np.abs(solution.y - y)) < 1e-11
    assert solution["residual"] < 1e-14
    assert abs(solution["quarter_period"] - 200.0) < 1e-11


def test_two_hundred_impacts_of_an_irregular_orbit():
    """A run of the numpy flow over 200 impacts, no part of which repeats, polished onto an end: energy kept to rounding, of
    which each flight and each impact adds its own."""
    system = vibro_impact_nes(0.1, 0.1)
    twin = Twin(system)
    velocity = backbone.origin_velocity(system, 0.3)
    x = np.concatenate([np.zeros(2), velocity * np.array([1.0, 1.03])])
    _, events = twin.run(x, 1e4, None, 201)
    sequence = tuple(twin.contacts[event[1]][4] for event in events[:200])
    problem = MultipointProblem(system, ("origin", "stop" + twin.contacts[events[200][1]][4]), sequence)
    nodes = np.array([system.modes.from_state @ event[3] for event in events[:200]])
    guess = problem.pack(system.modes.from_state @ x, nodes, np.diff([0.0] + [event[0] for event in events]))
    solution = problem.solve(guess)
    assert solution["residual"] < 1e-14 and solution["clearance"] > 0.0
    states = problem.nodes(solution.y)
    energies = 0.5 * np.sum(Equations(problem).weights * states**2, axis=1)
    assert np.max(np.abs(energies / solution["energy"] - 1.0)) < 4.0 * EPS * 201


def test_step_follows_the_closed_form_through_its_fold():
    """Every point on the closed form, steps of unit tangents in the metric, and d h / d alpha that of the closed form."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 0.9)
    point = problem.solve(y, quarter_period=0.9)
    energies = [point["energy"]]
    for _ in range(20):
        following = problem.step(point.y, point.tangent, 0.02)
        assert following is not None
        alpha = following["quarter_period"]
        assert abs(following["energy"] / backbone.energy(system, alpha) - 1.0) < 1e-13
        assert np.linalg.norm(following.position - point.position) == pytest.approx(0.02, rel=5e-3)
        rate = np.sum(problem.flight_times(following.tangent[: problem.unknowns]))
        change = (backbone.energy(system, alpha + 1e-5) - backbone.energy(system, alpha - 1e-5)) / 2e-5
        assert abs(following["slope"] - change * rate) < 1e-8
        energies.append(following["energy"])
        point = following
    assert min(energies) < energies[0] and min(energies) < energies[-1]


@pytest.mark.parametrize(
    ("system", "ends", "sequence", "words"),
    [
        (ImpactSystem(np.eye(2), np.zeros((2, 2)), np.eye(2), (Stop((1.0, 0.0), -1.0, 2.0),)), ("origin", "stop+"), (), "odd symmetry"),
        (vibro_impact_nes(rho=0.7), ("origin", "stop+"), (), "restitution"),
        (vibro_impact_nes(lam=0.1), ("origin", "stop+"), (), "damping"),
        (vibro_impact_nes(), ("orgin", "stop+"), (), "unknown end"),
        (vibro_impact_nes(), ("origin", "stop+"), ("x",), "no contact 'x'; this system's contacts are -, \\+"),
        (vibro_impact_nes(), ("origin", "periodic"), ("+",), "two periodic ends"),
        (vibro_impact_nes(), ("periodic", "periodic"), (), "at least one impact"),
    ],
)
def test_refusals(system, ends, sequence, words):
    with pytest.raises(EndsError, match=words):
        MultipointProblem(system, ends, sequence)


@pytest.mark.parametrize(
    ("factor", "energy", "words"),
    [(1.0, 0.045, "grow"), (1.5, 0.045, "grow|did not settle in 30 steps"), (math.nan, 0.045, "diverged"), (0.1, None, "did not settle$")],
)
def test_no_orbit_is_said_so(factor, energy, words):
    """There is no impacting orbit below h = sigma/2 (energy needed to reach the stop), and none so fast: Newton must not claim one."""
    problem, y = backbone_segment(vibro_impact_nes(), 1.0)
    with pytest.raises(NotConverged, match=words):
        problem.solve(factor * y, energy=energy)


@pytest.mark.parametrize("impacts", [0, 3])
def test_a_family_meets_the_positions_of_its_orbits_alone(impacts):
    """Oracle: the closed form of one impact a half period, at two quarter periods; a position beside the family, and one of no family."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 1.4, impacts)
    _, wanted = backbone_segment(system, 1.42, impacts)
    start, energy, alpha = problem.start(wanted), problem.energy(wanted), problem.quarter_period(wanted)
    position = np.concatenate([start / math.sqrt(2.0 * energy), [math.log(energy), math.log(alpha)]])
    for length in (1.0, 1e3):  # of the direction, which does not matter
        found = problem.family_orbit_at(y, length * (wanted - y), position, 1e-12, 8)
        assert np.max(np.abs(found - wanted)) < 1e-11
    assert problem.family_orbit_at(y, wanted - y, position, 1e-12, 1) is None  # the plane is flat
    assert problem.family_orbit_at(y, wanted - y, position + np.eye(6)[4] * 1e-6, 1e-7, 8) is None
    assert problem.family_orbit_at(y, 0.0 * y, position, 1e-7, 8) is None


def test_a_problem_that_has_been_followed_goes_to_another_process():
    """Oracle: the copy makes the same step."""
    problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    solution = problem.solve(problem.pack([0.0, 0.0, 0.9, 0.6], [], [1.7]), quarter_period=1.7)
    copy = pickle.loads(pickle.dumps(problem))
    steps = [each.step(solution.y, solution.tangent, 0.01) for each in (problem, copy)]
    np.testing.assert_array_equal(steps[0].result, steps[1].result)


def test_what_is_compiled_for_four_entries_is_what_is_compiled_for_any_number():
    """Oracle: the same functions, compiled without knowing how many entries a state has: the same numbers to the last bit."""
    seen = set()
    for orbit in collection():
        kind = (orbit.problem.kinds, min(orbit.problem.inner, 2))
        if kind in seen:
            continue
        seen.add(kind)
        general = MultipointProblem(orbit.problem.system, orbit.problem.ends, orbit.problem.sequence)
        general._two_dof = False
        for ds in (0.0, 0.01):
            planar, plain = (p.step(orbit.solution.y, orbit.solution.tangent, ds) for p in (orbit.problem, general))
            for name in ("y", "tangent", "position", "ends"):
                np.testing.assert_array_equal(getattr(planar, name), getattr(plain, name))
            np.testing.assert_array_equal(planar.result[: RESULT_INDEX["a"]], plain.result[: RESULT_INDEX["a"]])
    assert len(seen) >= 10
