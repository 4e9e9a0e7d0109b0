"""The orbits of a forced problem in the compiled core."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core

from bvp.checks import EPSILON
from bvp.programs import program_of
from bvp.released_forces import released_forces

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.forced_modes import ForcedMode

__all__ = ["core_problem"]

SINGLE = 2048
"""Most steps of a flight with smooth forces that is a whole period of loads. Pieces of it share twice as many."""


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


def core_problem(problem: ForcedProblem, *, general: bool = False) -> Any:
    """The problem in the core.

    general: take what is compiled for any number of states and parameters."""
    return saltus_core.ForcedProblem(*core_arguments(problem), general)


def core_arguments(problem: ForcedProblem) -> tuple[Any, ...]:
    """What the problem of the core is made of."""
    table, layout, parametric = problem.contact_modes, problem.parametric.layout, problem.parametric
    released = parametric.program(problem.released)
    rows = released.rows
    varies = problem.varies
    knows_masses, undamped = varies or table.sums_chatter, varies and problem.is_undamped
    size, nodes = 2 * problem.degrees_of_freedom, problem.inner + 1
    first = 0 if knows_masses or problem.conserved or problem.is_smooth else layout.stiffness.stop
    has_ends = len(problem.end_rows) > 0
    all_nodes = nodes + has_ends
    opening, release = table.release[:nodes], np.full(nodes, -1, dtype=np.int64)
    force = force_rows(problem)
    release[opening >= 0] = force[table.mode[opening >= 0], opening[opening >= 0]]
    at_force = np.repeat(np.arange(len(table.made)), [len(made.weight) for made in table.made])
    closed = [stop for f in range(len(table.made)) for stop in table.stopped(f).tolist()]
    pull, reach, weight = (
        np.concatenate([getattr(made, name) for made in table.made]) for name in ("pull", "reach", "weight")
    )
    gaps = np.pad(table.stops, ((0, 0), (0, size // 2)))
    bounds = [np.arange(part.start - first, part.stop - first) for part in (layout.lower, layout.upper)]
    contacts = problem.contacts[:nodes]
    stops = np.array([problem.modes.contact_stop[contact] if contact >= 0 else -1 for contact in contacts], dtype=np.int64)
    watched = _numbers(gaps).reshape(-1, size), *bounds, stops, force, np.array(table.opens[:nodes])
    places = [part.start - first for part in (layout.constant, layout.cosine, layout.sine, layout.frequency)]
    stop, rebound = (np.where(part >= 0, part - first, -1) for part in problem.entries_of_nodes[:all_nodes].T)
    program = parametric.program(problem.released, 0).program
    kept = parametric.equations(problem.keep, problem.released, problem.conserved, 0)
    bounced = (_numbers(part[:all_nodes]) for part in (problem.gap, problem.rate, problem.push))
    forces = _numbers(pull).reshape(-1, size), *(_numbers(part).reshape(-1, size // 2) for part in (reach, table.stops[closed]))
    free = bool(problem.conserved), problem.unfolds, problem.quarters, *map(int, problem.kinds)
    entries = _numbers(parametric.entries(problem.values)[first:])
    flights = saltus_core.SmoothLoadedFlight(*smooth_arguments(problem)) if problem.is_smooth else _flights(
        problem, table.made, problem.system.mass
    )  # fmt: skip
    values = _numbers([problem.values[name] for name in parametric.names])
    columns = np.array([parametric.names.index(name) for name in problem.released], dtype=np.int64)
    return (
        flights, table.mode, release, stop, rebound, _numbers(problem.side[:all_nodes]),
        *bounced, *forces, _numbers(weight), at_force, table.kept[:all_nodes], np.array(table.summed[:nodes]),
        (*problem.closing, float(problem.load_periods)), free,
        _numbers(problem.end_rows), values, columns, entries, rows - first, np.array(places),
        tuple(map(np.ascontiguousarray, program)), tuple(map(np.ascontiguousarray, kept)), _numbers(problem.units), watched,
        knows_masses, undamped, _modes_at(problem) if varies and not (problem.is_smooth or undamped) else None,
        _unseen(problem, first), _located(problem),
    )  # fmt: skip


def force_rows(problem: ForcedProblem) -> np.ndarray:
    """The row of the core of the contact force of each stop in each contact mode, (F, S) int64; -1: the stop is open."""
    table, count = problem.contact_modes, 0
    found = np.full(table.closed.shape, -1, dtype=np.int64)
    for f in range(len(found)):
        stops = table.stopped(f)
        found[f, stops] = count + np.arange(len(stops))
        count += len(stops)
    return found


Domains = tuple[list[int], list[float], list[float]]
"""Places, and the lower and upper ends of the domain at each."""


def _unseen(problem: ForcedProblem, first: int) -> Domains:
    """Entries that can leave their domain where no test function sees it, and their domains: there orbits have no end."""
    layout, rows = problem.parametric.layout, problem.parametric.unseen_entries(problem.released, problem.located)
    rates = np.array([row in range(layout.size)[layout.restitution] for row in rows], dtype=bool)
    low, high = np.where(rates, -4.0 * EPSILON, np.finfo(float).tiny), np.where(rates, 1.0 + 4.0 * EPSILON, math.inf)
    return [row - first for row in rows], low.tolist(), high.tolist()


def _located(problem: ForcedProblem) -> Domains:
    """The places of the released parameters whose domains are located, and these domains: beyond them entries are not looked at."""
    names = [name for name in problem.located if name in problem.released]
    domains = [problem.parametric.domain(name) for name in names]
    return [problem.released.index(name) for name in names], [low for low, _ in domains], [high for _, high in domains]


def _harmonics(problem: ForcedProblem) -> np.ndarray:
    """The harmonics of the loads, 0 for constant ones."""
    return _numbers([*([0.0] if problem.has_constant_loads else []), *problem.parametric.layout.harmonics])


def _flights(problem: ForcedProblem, made: Sequence[ForcedMode], mass: np.ndarray) -> list[Any]:
    """The flights of contact modes in the core."""
    n, harmonics = problem.degrees_of_freedom, _harmonics(problem)
    flights, inverse = [], np.linalg.inv(mass)
    for mode in made:
        blocks = mode.blocks
        free = saltus_core.LinearFlight(blocks.pairs, blocks.mean, blocks.delta, _numbers(blocks.matrix), np.ones(2 * n))
        shapes = map(_numbers, (mode.enter, mode.leave, mode.enter[:, n:] @ inverse))
        flights.append(saltus_core.LoadedFlight(free, *shapes, harmonics))
    return flights


def smooth_arguments(problem: ForcedProblem) -> tuple[Any, ...]:
    """What the flights with smooth forces of the core are made of."""
    smooth = problem.smooth_forces
    assert smooth is not None
    called: tuple[Any, ...] = ()
    nodes, nothing = problem.inner + 2, tuple(map(np.ascontiguousarray, program_of([], [])))
    if smooth.is_called:
        found = smooth.called_forces()
        inputs, directions, program, numbers, energy = smooth.inputs, smooth.directions, found.program, nothing, nothing
        program = program._replace(code=program.code[:0])
        called = found.write, found.energies, [tuple(row) for row in program.changes.tolist()]
    else:
        inputs, directions, program, *formulas = released_forces(smooth)
        numbers, energy = (tuple(map(np.ascontiguousarray, part)) for part in formulas)
        if len(energy[2]):
            energy = (*energy[:2], energy[2][:1])  # without its derivatives
    codes = program.code, program.numbers, program.forces, program.slopes
    return (
        _numbers(inputs), _numbers(directions), *map(np.ascontiguousarray, codes), program.registers, len(problem.released), numbers,
        energy, _harmonics(problem), max(saltus_core.MOST_TAYLOR_STEPS, 2 * SINGLE // nodes), 2 * nodes, *called,
    )  # fmt: skip


def _modes_at(problem: ForcedProblem) -> Callable[[np.ndarray, np.ndarray], list[Any]]:
    """The function that gives the core the contact modes at values of all parameters, where the entries of the system are known; none where
    the system cannot have them."""
    known = weakref.ref(problem)  # which has the problem of the core

    def modes_at(parameters: np.ndarray, entries: np.ndarray) -> list[Any]:
        found = known()
        try:
            return [] if found is None else _flights(found, *found.modes_at(tuple(parameters.tolist()), entries))
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            return []

    return modes_at
