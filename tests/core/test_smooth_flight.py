"""Flights with smooth forces in the compiled core. Oracles: the kernels, the exact linear flight, many digits, and differences.

`tests/bvp/test_smooth_flight.py` has closed forms and constants of motion."""

import threading

import mpmath
import numpy as np
import pytest
import saltus_core as core
import sympy

from bvp.jet_programs import even_power, jet_program, plain_powers, signed_power
from bvp.kernels.taylor import fly_smooth
from bvp.programs import program_of
from bvp.smooth_flights import core_arrays, core_flight, why_not_flown
from tests.core.smooth_systems import chain, states, wall
from tests.core.systems import core_of
from tests.lab.flights import smooth_flight

W = sympy.Symbol("w", real=True)

SYSTEMS = {
    "cubic 1": lambda: chain(1),
    "cubic 2": lambda: chain(2),
    "cubic 3": lambda: chain(3),
    "cubic 6": lambda: chain(6),
    "a high power": lambda: chain(2, 21),
    "a broken power": lambda: chain(3, 2.5),
    "exponential": lambda: wall(2),
    "pendulum": lambda: wall(3, "1 - cos(w) - w**2/2"),
    "logarithm": lambda: wall(2, "log(1 + w**2)**2"),
    "root": lambda: wall(4, "sqrt(1 + w**2)*tanh(w)**3 + sinh(w)/(2 + cosh(w))"),
}


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("duration", [0.4, 3.0, -1.7, 0.0])
def test_steps_ends_and_maps_are_those_of_the_kernels(name, duration):
    """They differ in the rounding of elementary functions and of sums, which the flight makes grow."""
    system = SYSTEMS[name]()
    kernel, flight = smooth_flight(system, 1), core_flight(system)
    for z in states(system, 3):
        for with_map in (True, False):
            assert fly_smooth(kernel, 0, z, duration, with_map)
            path, steps = flight.path(z, duration, with_map), int(kernel.paths.steps[0, 0])
            growth = max(1.0, np.linalg.norm(kernel.paths.maps[0]))
            assert path.complete and len(path.times) == steps + 1
            np.testing.assert_allclose(path.times, kernel.paths.times[0, : steps + 1], atol=1e-9)
            assert np.abs(path.end - kernel.paths.ends[0]).max() < 1e-14 * growth
            if with_map:
                assert np.abs(path.map - kernel.paths.maps[0]).max() < 1e-12 * growth
            else:
                assert path.map.size == 0


@pytest.mark.parametrize("n", [1, 2, 4])
@pytest.mark.parametrize("damped", [False, True])
def test_linear_forces_written_as_expressions(n, damped):
    """Oracle: exp(B t), where the same forces are part of B."""
    rng = np.random.default_rng(n)
    modes = chain(n).modes
    exact, _ = core_of(modes)
    inputs = np.hstack([rng.normal(size=(n, n)), damped * rng.normal(size=(n, n))])
    weights = sympy.symbols(f"w0:{n}", real=True)
    program = jet_program([sympy.Integer(2) * w for w in weights], list(weights))[0]
    # What the forces 2 w do is taken out of the matrix again.
    push = rng.normal(size=(n, n))
    matrix = modes.matrix.copy()
    matrix[n:] -= 2.0 * push @ inputs
    flight = core_arrays(matrix, inputs, push, np.ones(2 * n), program, program_of([sympy.Integer(0)], list(weights)))
    for z in rng.normal(size=(3, 2 * n)):
        for t in (0.3, 2.0, -1.0):
            end, map_ = flight.end_with_map(z, t)
            size = np.linalg.norm(exact.map(t)) * (1.0 + np.abs(2.0 * push @ inputs).max())
            assert np.abs(end - exact.end(z, t)).max() < 1e-14 * size * np.linalg.norm(z)
            assert np.abs(map_ - exact.map(t)).max() < 1e-13 * size


FUNCTIONS = {
    "product": W * (1 + W) * (2 - W**2),
    "quotient": W / (2 + W**2),
    "powers": W**7 - W**2 / 3 + (1 + W**2) ** sympy.Rational(3, 2),
    "exp and log": sympy.exp(W) * sympy.log(3 + W**2),
    "circular": sympy.sin(2 * W) + sympy.cos(W) * sympy.tan(W / 3),
    "hyperbolic": sympy.sinh(W) / sympy.cosh(W / 2) + sympy.tanh(W),
    "moduli": signed_power(W, 2.5) + even_power(W, 3.5),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("start", [0.7, -0.4])
def test_series_of_a_force(name, start):
    """Oracle: sixty digits of the series of w'' = f(w), by differentiation of f. Each order loses a rounding or two."""
    force = FUNCTIONS[name]
    program = jet_program([force], [W])[0]
    flight = core_arrays([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]], [[1.0]], [0.0, 1.0], program, program_of([0], [W]))
    found = flight.path(np.array([start, 0.3]), 0.01).coefficients[0]
    side = sympy.Symbol("s", positive=True)
    plain = plain_powers(force).xreplace({W: side if start > 0.0 else -side}).doit()
    call = sympy.lambdify(side, plain, "mpmath")
    sign = 1 if start > 0.0 else -1
    order = 12
    with mpmath.workdps(60):
        of_force = [sign**k * c for k, c in enumerate(mpmath.taylor(call, mpmath.mpf(abs(start)), order))]
        w, v = [mpmath.mpf(start)], [mpmath.mpf(0.3)]
        for k in range(order):
            shift = [mpmath.mpf(0), *w[1:]]  # w - w(0), to the order k
            total, term = [mpmath.mpf(0)] * (k + 1), [mpmath.mpf(1)] + [mpmath.mpf(0)] * k
            for factor in of_force[: k + 1]:
                total = [a + factor * b for a, b in zip(total, term, strict=True)]
                term = [mpmath.fsum(term[i] * (shift[j - i] if j - i < len(shift) else 0) for i in range(j + 1)) for j in range(k + 1)]
            w.append(v[k] / (k + 1))
            v.append(total[k] / (k + 1))
        for k in range(order + 1):
            scale = max(float(abs(x)) for x in v[: k + 1]) * 4.0**k
            assert abs(found[k, 0] - float(w[k])) < 1e-15 * scale and abs(found[k, 1] - float(v[k])) < 1e-15 * scale


@pytest.mark.parametrize("name", SYSTEMS)
def test_derivatives_by_jets_are_those_of_the_columns(name):
    """Both are exact derivatives of the same steps, but for the lengths of steps, which none takes into account."""
    system = SYSTEMS[name]()
    flight = core_flight(system)
    rng = np.random.default_rng(3)
    for z, time in zip(states(system, 3), (1.3, -0.8, 0.0), strict=True):
        end, map_ = flight.end_with_map(z, time)
        for dz, dt in ((rng.normal(size=len(z)), 0.0), (np.zeros(len(z)), 1.0), (rng.normal(size=len(z)), -0.7)):
            expected = map_ @ dz + flight.rate(end) * dt
            found = flight.end_along(z, time, dz, dt)
            assert np.abs(found - expected).max() < 1e-12 * np.linalg.norm(map_) * (1.0 + np.abs(flight.rate(end)).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_energy_and_its_derivatives(name):
    """Oracles: the energy of the system; H along a flight; the second derivative by differences of the first."""
    system = SYSTEMS[name]()
    n = system.degrees_of_freedom
    flight = core_flight(system)
    for z in states(system, 3):
        energy = flight.twice_energy(z)
        displacements, velocities = np.split(system.modes.to_state @ z, 2)
        assert energy == pytest.approx(2.0 * system.energy(displacements, velocities), rel=1e-14)
        assert flight.twice_energy(flight.end(z, 2.0)) == pytest.approx(energy, rel=1e-13)
        slope, bend = flight.energy_slope(z), flight.energy_bend(z)
        assert np.abs(bend - bend.T).max() < 1e-13 * np.abs(bend).max()
        for c in range(2 * n):
            step = 1e-4 * np.eye(2 * n)[c]
            sides = [flight.energy_slope(z + k * step) for k in (-2, -1, 1, 2)]
            difference = (8.0 * (sides[2] - sides[1]) - (sides[3] - sides[0])) / 12e-4
            assert np.abs(difference - bend[:, c]).max() < 1e-7 * np.abs(bend).max()
            h = [flight.twice_energy(z + k * step) for k in (-2, -1, 1, 2)]
            assert (8.0 * (h[2] - h[1]) - (h[3] - h[0])) / 24e-4 == pytest.approx(slope[c], abs=1e-8 * max(1.0, np.abs(slope).max()))


def test_what_is_kept_changes_nothing():
    """Oracle: each flight alone. A longer flight from the same state, or one without a map, has other steps."""
    system = chain(3)
    z = next(states(system, 1))
    shared = core_flight(system, keep=2)
    shared.path(z, 5.0), shared.path(z, 2.0, False)
    alone = core_flight(system)
    for t in (2.0, 1.0, 5.0, 2.0):
        for first, second in zip(shared.end_with_map(z, t), alone.end_with_map(z, t), strict=True):
            np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(shared.path(z, t).coefficients, core_flight(system).path(z, t).coefficients)


def test_threads_share_a_flight():
    """Oracle: one thread."""
    system = chain(4)
    flight, begins = core_flight(system, keep=3), list(states(system, 8))
    expected = [core_flight(system).end(z, 1.0) for z in begins]
    found = {}

    def work(k):
        for _ in range(20):
            for i, z in enumerate(begins):
                found[k, i] = flight.end(z, 1.0)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for (_, i), end in found.items():
        np.testing.assert_array_equal(end, expected[i])


def test_a_flight_without_an_end():
    """The end is no number, and the flight says how far it came."""
    flight = core_flight(chain(1))
    z = np.array([1.0, 0.0])
    assert flight.failure is None and why_not_flown(flight) == ""
    end, map_ = flight.end_with_map(z, 1e4)
    assert np.isnan(end).all() and np.isnan(map_).all()
    path = flight.path(z, 1e4, True)
    assert path.exhausted and not path.complete and len(path.times) == core.MOST_TAYLOR_STEPS + 1
    assert why_not_flown(flight).endswith("it takes more than 256 Taylor steps")
    end, map_ = flight.end_with_map(np.array([0.0, 1e150]), 1.0)
    assert np.isnan(end).all() and not flight.failure.exhausted
    assert "too large" in why_not_flown(flight)
    assert np.isnan(flight.end_along(z, 1e4, z, 0.0)).all()
    flight.end(z, 1.0)
    assert flight.failure is None
    flight.end(z, 1e4)  # it is kept, and asked for again
    assert flight.failure.exhausted


def test_arrays_are_checked_at_the_border():
    program, potential = jet_program([W**3], [W])[0], program_of([W**4 / 4], [W])
    good = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([[-1.0]]), np.ones(2)
    core_arrays(*good, program, potential)
    for k, wrong in ((0, np.eye(3)), (1, np.ones((1, 3))), (2, np.ones((2, 1))), (2, np.ones((1, 2))), (3, np.ones(3))):
        with pytest.raises(ValueError):
            core_arrays(*good[:k], wrong, *good[k + 1 :], program, potential)
    for changed in (
        program._replace(code=program.code + [[0, 0, 100, 0]]),
        program._replace(code=program.code + [[100, 0, 0, 0]]),
        program._replace(code=program.code - [[0, 5, 0, 0]]),
        program._replace(forces=program.forces + 100),
        program._replace(slopes=program.slopes + [[1, 0, 0]]),
        program._replace(slopes=program.slopes + [[0, 1, 0]]),
        program._replace(slopes=program.slopes + [[0, 0, 99]]),
        program._replace(registers=1),
    ):
        with pytest.raises(ValueError):
            core_arrays(*good, changed, potential)
    for changed in (potential._replace(code=potential.code + [[0, 1, 0]]), potential._replace(outputs=potential.outputs + 9)):
        with pytest.raises(ValueError):
            core_arrays(*good, program, changed)
    with pytest.raises(ValueError):
        core_arrays(*good, program, potential).end(np.zeros(3), 1.0)
