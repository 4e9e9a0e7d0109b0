"""Every function and method of the core with arguments that it takes, for tests of all of them.

`calls` makes objects and their arguments anew, so that one call cannot change what another one finds.
"""

import math
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
import saltus_core as core

from branches.search.starts import curves
from bvp.closures import cycle_of
from bvp.forcing import Harmonic
from bvp.orbits import Orbits
from bvp.simulate import Simulator
from bvp.smooth_flights import core_flight, modal_rows
from bvp.system import vibro_impact_nes
from continuation.control import Settings, control_of
from tests.core.smooth_systems import chain
from tests.core.systems import core_of

POINT = len(core.POINT_NAMES)
COMMON = 11
"""Test functions that all families have."""


@dataclass
class Orbit:
    """An orbit of a problem, with its tangent."""

    problem: object
    y: np.ndarray
    tangent: np.ndarray
    position: np.ndarray
    ends: np.ndarray
    point: np.ndarray

    @classmethod
    def of(cls, problem, solution):
        return cls(problem, solution.y, solution.tangent, solution.position, solution.ends, solution.result)


def nan(*shape):
    return np.full(shape, np.nan)


def landing(problem, *rows):
    sizes = (problem.unknowns,), (problem.tangent_size,), (problem.coordinates,), (problem.inner + 1, problem.size), (POINT,)
    return [nan(*rows, *size) for size in sizes]


def make_problem(problem):
    """A problem of the core that has computed nothing yet."""
    return Orbits(problem).core


def problem_calls(orbit):
    """Name, method and arguments for one orbit of a problem."""
    problem, y, tangent = orbit.problem, orbit.y, orbit.tangent
    u, rng = len(y), np.random.default_rng(1)
    directions, still = rng.normal(size=(3, u)), np.zeros_like(tangent)
    target, energy, period = float(tangent[:u] @ y), 1.01 * problem.energy(y), 1.01 * problem.quarter_period(y)
    yield from ((name, name, (y,)) for name in ("residual", "jacobian", "scales", "end_states", "growth", "unfold"))
    yield "course", "course", (y, tangent[:u].copy())
    yield "row", "constraint_row", (y, orbit.position)
    yield "second", "derivative", (y, directions[:2])
    yield "third", "derivative", (y, directions)
    yield "nodes", "nodes", (problem.start(y), problem.flight_times(y))
    yield "observe", "observe", (y, orbit.ends, orbit.point.copy())
    for name, along, ds, full in [("step", tangent, 0.01, True), ("polish", tangent, 0.0, False), ("still", still, 0.01, True)]:
        yield name, "step", (y, along, ds, 12, full, *landing(problem))
    yield "far", "step", (y, tangent, 30.0, 12, True, *landing(problem))
    yield "correct", "correct", (y + 1e-4, tangent[:u].copy(), target, 12, *landing(problem))
    yield "least", "correct", (y + 1e-4, np.zeros(u), 0.0, 12, *landing(problem))
    yield "energy", "solve", (y, energy, math.nan, *landing(problem))
    yield "period", "solve", (y, math.nan, period, *landing(problem))
    yield "wild", "solve", (3.0 * y + 1.0, energy, math.nan, *landing(problem))
    yield "near", "solve", (y, math.nan, math.nan, *landing(problem))
    yield "meet", "meet_position", (orbit.position + 1e-3, 1e-9, 4, y, tangent, *landing(problem))


def count_of(problem, targets):
    """Test functions of a family, equation (35)."""
    return COMMON + (2 if problem.periodic else 3 + (problem.quarters == 1) + (problem.half > 2)) + targets


def make_family(problem, fold_only=False):
    """A family of the core, with its problem, that has computed nothing yet."""
    targets, bounds = [-1.0, 0.5], (-math.inf, math.inf, math.inf, 2e-13)
    watched, computed = ([0], 1) if fold_only else ([0, 0, 1], count_of(problem, 2))
    return core.OrbitFamily(make_problem(problem), watched, [1e-5] * len(watched), *bounds, targets, computed, 12)


def block(problem, rows, computed):
    return [*landing(problem, rows), nan(rows, computed), nan(rows, 2)]


def family_calls(orbit, fold_only=False):
    """The same for a family."""
    problem, y, tangent = orbit.problem, orbit.y, orbit.tangent
    u, computed = len(y), 1 if fold_only else count_of(problem, 2)
    control = tuple(control_of(Settings()))
    yield "step", "step", (y, tangent, 0.01, *block(problem, 1, computed))
    if not fold_only:
        yield "values", "values", (y, orbit.ends, orbit.point, nan(computed))
    begin = y, tangent, orbit.position, np.ones(computed), np.ones(computed), np.ones(computed)
    goal = orbit.position + 100.0, nan(problem.coordinates)
    yield "advance", "advance", (*begin, 0.0, 0.0, *goal, 0.01, control, *block(problem, 6, computed))
    ends = 0.0, y, tangent[:u].copy(), 0.02, y + 0.02 * tangent[:u], tangent[:u].copy()
    yield "inside", "narrow", (y, tangent, *ends, 0.01, 0, 1e-9, 0.5, [], [], 0, *block(problem, 1, computed))
    samples = [0.0, 0.02], [-1.0, 1.0], 1
    yield "zero", "narrow", (y, tangent, *ends, math.nan, 0, 1e-9, 0.5, *samples, *block(problem, 4, computed))


def make_chain(orbit, given=False):
    system = orbit.problem.system
    flight, contacts = core_of(system.modes)
    return core.Chain(flight, contacts, np.zeros((0, orbit.problem.half)), True, not given, given)


def chain_calls(orbit, given=False):
    """The same for chains of flights and impacts."""
    problem, y = orbit.problem, orbit.y
    cycle, k, size = cycle_of(problem, y), problem.inner, problem.size
    flight = core_of(problem.system.modes)[0]
    matrix, maps = problem.system.modes.matrix, np.array([flight.map(t) for t in cycle.duration])
    if given:
        rates = np.ascontiguousarray(cycle.before @ matrix.T), np.ascontiguousarray(cycle.after @ matrix.T)
        yield "maps", "multipliers_of_maps", (maps, *rates, cycle.contact, 2.0 + np.arange(size))
    else:
        yield "product", "multipliers", (cycle.before, cycle.after, cycle.duration, cycle.contact, True)
        yield "factors", "multipliers", (cycle.before, cycle.after, cycle.duration, cycle.contact, False)
    if problem.periodic:
        return
    first = problem.parameters + 1
    states = np.vstack([problem.start(y)[None], y[first : first + k * (size + 1)].reshape(k, size + 1)[:, :size]])
    kinds, held, contact = tuple(map(int, problem.kinds)), np.eye(problem.half), np.array(problem.contacts, dtype=np.int64)
    times = np.ascontiguousarray(problem.flight_times(y))
    if given:
        maps = np.array([flight.map(t) for t in times])
        coming, leaving = np.vstack([states[:1], orbit.ends]) @ matrix.T, np.vstack([states, orbit.ends[-1:]]) @ matrix.T
        rates = np.ascontiguousarray(coming), np.ascontiguousarray(leaving)
        yield "half of maps", "half_map_of_maps", (kinds, held, maps, *rates, contact, 1.0)
    else:
        yield "half", "half_map", (kinds, held, states, times, orbit.ends, contact)


def search_parts():
    """A system of two degrees of freedom, a curve of its starts, a map of its parameters, and arcs."""
    (curve,) = curves(vibro_impact_nes(), "stop", 1.3)
    starts = curve.starts
    return starts.system, starts, core.StartMap(curve.low, curve.high, False, False), curve


def make_scan(most=5):
    _, starts, _, _ = search_parts()
    return core.IntervalScan(starts, [6.0, 6.0, 6.0, 4.0], [3, 3, 3, 3], True, 6.0, math.inf, most)


def scanned(passes=200):
    """A scan of an interval, and the arcs that it found."""
    scan, (_, _, place, curve) = make_scan(), search_parts()
    scan.begin(curve.low + 0.01, curve.low + 0.4, place, 500)
    while not scan.go(passes):
        pass
    return scan


def make_meetings():
    _, starts, _, _ = search_parts()
    return core.MeetingSearch([starts], [0], np.array([[6.0]]), np.array([[3]]), True, 100)


def function_calls(orbit):
    """All other functions, classes and methods: where each is, its name, and its arguments."""
    modes = orbit.problem.system.modes
    flight, contacts = core_of(modes)
    size, rng = len(modes.flight.matrix), np.random.default_rng(2)
    z, rows, square = rng.normal(size=size), rng.normal(size=(4, size)), rng.normal(size=(4, 4))
    yield core, "LinearFlight", (*map(np.ascontiguousarray, modes.flight), np.ones(size))
    parts = modes.contacts
    rows_of = parts.gap, parts.rate, parts.acceleration, parts.side, parts.bound, parts.push, parts.restitution
    yield core, "Contacts", tuple(map(np.ascontiguousarray, rows_of))
    for name, arguments in [("end", (z, 0.3)), ("map", (0.3,)), ("rate", (z,)), ("bounds", (rows[0].copy(), z, 1.0))]:
        yield flight, name, arguments
    yield core, "next_impact", (flight, contacts, -1, False, 0.01 * z, 5.0, True)
    yield core, "sign_changes", (flight, rows, z, 5.0, 0, False, False)
    yield core, "crossing_times", (flight, rows, z, 5.0, nan(9))
    yield core, "rises", (flight, rows, z, 5.0, 0, nan(9))
    yield core, "tie_of", (*rows, 1.0)
    yield core, "clearance", (flight, rows, -9.0, 9.0, z, 5.0, 0.0, math.inf)
    half = size // 2
    shown = np.eye(half, size), np.eye(half, size, half)
    yield core, "raise_peaks", (flight, *shown, z, 5.0, np.zeros(half), nan(half))
    for name in ("determinant", "signed_least_singular", "eigenvalues", "eigensystem", "singular_values"):
        yield core, name, (square,)
    yield core, "certain_determinant", (square, 1e-9)
    yield core, "symmetric_eigenvalues", (square + square.T,)
    yield core, "product_eigenvalues", (rng.normal(size=(3, 4, 4)), np.array([0, 1, 0]))
    yield core, "section_basis", (rng.normal(size=3), np.eye(3))
    yield core, "half_map_multipliers", (square, True)
    yield core, "half_map_tests", (square, True, False, 2.0, 1, True, 1.0, 0.5, np.array([-1.0]))
    for name in ("solve", "product"):
        yield core, name, (square, rows[:, :2].copy())
    yield core, "cholesky", (square @ square.T,)
    for name in ("orthonormal", "singular_directions"):
        yield core, name, (rows,)
    schur = core.schur(square)
    yield core, "schur", (square,)
    yield core, "move_block", (*schur, 0, 0)
    yield core, "sylvester", (square, schur[0], square)
    yield from path_calls(flight, z)
    yield from smooth_calls()
    elimination = core.BlockElimination(2, 3, 3, 2, True)
    jacobian = np.zeros((8, 9))
    jacobian[:3, :6], jacobian[3:6, 3:9], jacobian[6:] = (rng.normal(size=shape) for shape in ((3, 6), (3, 6), (2, 9)))
    yield core, "BlockElimination", (2, 3, 3, 2, True)
    elimination.factorise(jacobian, np.zeros(2))
    yield elimination, "factorise", (jacobian, np.zeros(2))
    yield elimination, "solve", (np.ones(8),)
    yield elimination, "null_vector", ()
    yield elimination, "conditioning", ()
    control = tuple(control_of(Settings()))
    yield core, "common_tests", (np.ones(len(core.POINT_NAMES)), 0.1, 9.0, 20.0, 2e-13)
    yield core, "distance", ([0.0, 1.0], [2.0, 3.0])
    yield core, "height", ([0.0, 1.0], [2.0, 3.0], [1.0, 1.0])
    yield core, "arclength_of", (0.1, 0.99)
    yield core, "refusal", (0.99, 0.1, 0.02, 0.02, control)
    yield core, "next_step", (0.02, 0.99, 0.1, control)
    yield core, "may_hide", (1.0, 0.5, 0.25, 0.1, 0.2)
    values = [1.0], [0.9], [0.8], [-0.7]
    yield core, "watch", ([0], [1e-5], *values, 0.01, 0.01, 0.01, 2)
    yield from search_calls()
    yield from motion_calls()
    yield from number_calls()


def path_calls(flight, z):
    """Those of paths along a flight of some kind."""
    rows, times = np.random.default_rng(3).normal(size=(3, len(z))), np.array([0.1, 0.4])
    yield core, "path", (flight, z, 0.5)
    yield core, "sample", (flight, z, times)
    yield core, "linearise", (flight, np.array([z, z]), times, np.array([z, -z]))
    path = core.path(flight, z, 0.5)
    yield path, "state", (0.2,)
    yield path, "motion", (0.2,)
    yield path, "crossings", (rows,)
    yield path, "rises", (rows, 0)


def smooth_calls():
    """Those of flights with smooth forces."""
    flight, z = core_flight(chain(2)), np.array([0.3, 0.1, 0.2, -0.4])
    system = chain(2)
    forces = system.smooth_forces
    program, energy = forces.program(), forces.energy_program()
    arrays = system.modes.matrix, *modal_rows(system), np.ones(4)
    codes = program.code, program.numbers, program.forces, program.slopes, program.registers
    yield core, "SmoothFlight", (*arrays, *codes, energy.code, energy.constants, energy.outputs, 4)
    for name in ("end", "end_with_map", "path"):
        yield flight, name, (z, 0.5)
    for name in ("rate", "twice_energy", "energy_slope", "energy_bend"):
        yield flight, name, (z,)
    yield flight, "end_along", (z, 0.5, z, 0.1)
    yield core, "slowest_instants", (flight, z, 0.5, True, 4)
    yield from path_calls(flight, z)


class Recorded:
    """In place of the contact modes of the core: it keeps what they are given."""

    def __init__(self, *arguments):
        self.made, self.added = arguments, []

    def add(self, *arguments):
        self.added.append(arguments)

    def __len__(self):
        return len(self.added)


def motion_calls():
    """Those of motions: a sink with a load, in its free mode."""
    table = Simulator(vibro_impact_nes(lam=0.01, rho=0.7), [Harmonic(0.3, [0.0, 0.1])]).table
    with patch.object(core, "ContactModes", Recorded):
        given = table.core
    modes, row = core.ContactModes(*given.made), given.added[0]
    yield core, "ContactModes", given.made
    yield modes, "add", row
    yield modes, "__len__", ()
    start, fractions = np.array([0.0, 0.0, 0.0, 2.0]), np.array([0.5, 0.9])
    yield core, "Motion", (modes, start, 2.0, -1, fractions)
    motion = core.Motion(modes, start, 2.0, -1, fractions)
    yield motion, "move", (9.0, 20, 50)
    for name in ("record", "state", "sums", "marks"):
        yield motion, name, ()
    starts, most = np.outer([0.5, 1.0, 2.0], start), np.array([5, 10, 20])
    who, none = np.array([2, 0]), np.full(3, -1)
    parts = len(motion.sums())
    summary = nan(3, 9 + parts + len(fractions) * (1 + parts) + 2)
    yield core, "run_batch", (
        modes, starts, 0.5 * starts[:, 3] ** 2, np.array([0.7, math.nan, 0.5]), none, most, who, 9.0, fractions, True, False, 100, 2,
        summary, nan(3, 4), nan(3, 4),
    )  # fmt: skip


def search_calls():
    system, starts, place, curve = search_parts()
    contacts = core_of(vibro_impact_nes().modes)[1]
    yield core, "PlanarSystem", ([1.0, 2.0], contacts, -1.0, 1.0)
    yield system, "amplitude", (0, [0.1, 0.2, 0.3, 0.4], 1.0, 0)
    arrays = np.full((8, 1), -1), nan(8, 3), nan(8, 3), nan(2, 12), nan(2, 3)
    yield system, "scan", (core.FarEnd.ORIGIN, 0.2 * np.ones((2, 4)), [True] * 4, 6.0, *arrays)
    yield core, "Starts", (system, [[0.1] * 4] * 3, core.Curve.TRIGONOMETRIC, -1)
    middle = 0.5 * (curve.low + curve.high)
    yield starts, "follow", (middle, 6.0, math.inf, 4)
    flight = starts.follow(middle, 6.0, math.inf, 4)[1]
    yield core, "FlightRecord", ()
    yield starts, "find_clearance", (flight, 6.0)
    yield core, "StartMap", (0.0, 1.0, True, False)
    yield place, "place", (0.3,)
    yield place, "unplace", (middle,)
    yield core, "positive_between", (1.0, 0.1, 1.1, 0.1, 1.2, 0.1, 0.5, 1e-9)
    yield core, "crossing", ([0.0, 0.0], core.FarEnd.ORIGIN, [1.0, 0.0, -1.0, 0.1], [0.0, 1.0, 0.0, 0.0], 0.01, 0.0, [0.5, 1.5, 0.9])
    yield core, "IntervalScan", (starts, [6.0] * 4, [3] * 4, False, 6.0, math.inf, 5)
    scan = scanned()
    yield scan, "begin", (curve.low + 0.1, curve.low + 0.2, place, 50)
    yield scan, "go", (10,)
    flights = starts.follow(middle, 6.0, math.inf, 4)
    yield scan, "verdict", (1, flights, flights, flights, 1e-3, 1e-16)
    arcs = scanned().take_arcs(0, 0, 0.0)
    yield scan, "take_arcs", (0, 0, 0.0)
    one, other = arcs[0], arcs[len(arcs) - 1]
    yield core, "Arc", ([[0.1] * 3, [0.2] * 3, [0.4] * 3], [[0.1] * 3, [0.2] * 3, [0.3] * 3])
    yield one, "model", (0.3,)
    yield arcs, "__getitem__", (0,)
    yield arcs, "__len__", ()
    yield core, "stop_arcs", (starts, [curve.low, middle, curve.high], True, 0)
    yield core, "boxes_apart", (one, other)
    yield core, "are_apart", (one, other, [0, 1])
    yield core, "turn_between", (one, other, [0, 1])
    yield core, "MeetingSearch", ([starts], [0], np.array([[6.0]]), np.array([[3]]), True, 100)
    meetings = make_meetings()
    yield meetings, "run", ([arcs],)
    yield meetings, "follow_arc", (one, 0.3)
    yield meetings, "meetings", ()


def number_calls():
    x, wide, wider = np.array([0.3, 0.7]), np.array([[0.3, 0.7], [0.0, 1e-20]]), np.zeros((4, 2))
    wider[0] = 0.3, 0.7
    z = x + 0.5j
    for place, argument in [(core, x), (core.double_double, wide), (core.quad_double, wider), (core.complex, z), (core.jets, x)]:
        for name in dir(place):
            function = getattr(place, name)
            if name.startswith("_") or type(function).__name__ != "nb_func" or (place is core and name not in dir(core.double_double)):
                continue
            two = name in ("pow", "hypot", "atan2", "add", "multiply", "divide", "mixture")
            arguments: tuple = (argument, argument) if two else (argument,)
            if place is core.jets and name.startswith("jacobian"):
                arguments = ([0.1, 0.2, 0.3, 0.4, 0.5],)
            elif place is core.jets and name == "pow":
                arguments = (x, 2.5)
            elif place is core.complex and name in ("sqrt", "derivatives"):
                arguments = (0.3 + 0.5j,)
            yield place, name, arguments
