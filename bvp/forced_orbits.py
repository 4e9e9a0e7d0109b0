"""The orbits of a forced problem with linear flights in the compiled core."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core

from bvp.kernels.multipoint import UNFOLDED
from bvp.kernels.smooth_loads import SmoothLoadedFlight
from bvp.released_forces import released_forces

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.forced_modes import ForcedMode

__all__ = ["core_problem", "core_unknowns", "unknowns_of_core"]


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


def core_problem(problem: ForcedProblem, *, general: bool = False) -> Any:
    """The problem in the core; None for forces that are Python functions.

    general: take what is compiled for any number of states and parameters."""
    arguments = core_arguments(problem)
    return None if arguments is None else saltus_core.ForcedProblem(*arguments, general)


def core_arguments(problem: ForcedProblem) -> tuple[Any, ...] | None:
    """What the problem of the core is made of."""
    table, segment, layout = problem.contact_modes, problem.segment, problem.parametric.layout
    released = segment.released
    rows = released.rows
    smooth = problem.smooth_forces
    if smooth is not None and smooth.is_called:
        return None
    varies = bool(np.any(rows < layout.stiffness.stop))
    knows_masses, undamped = varies or table.sums_chatter, varies and problem.is_undamped
    arrays, loads = table.arrays, segment.flight.loads
    size, nodes = 2 * problem.degrees_of_freedom, problem.inner + 1
    first = 0 if knows_masses or problem.conserved or problem.is_smooth else layout.stiffness.stop
    unfolded, has_ends = segment.shape[1] == UNFOLDED, len(segment.end_map) > 0
    all_nodes = nodes + has_ends
    mode, opening, release = arrays.mode[:nodes], arrays.release[:nodes], np.full(nodes, -1, dtype=np.int64)
    closed = np.argwhere(arrays.closed)
    force = np.full(arrays.closed.shape, -1, dtype=np.int64)
    force[tuple(closed.T)] = np.arange(len(closed))
    release[opening >= 0] = force[mode[opening >= 0], opening[opening >= 0]]
    pull, reach = (part[tuple(closed.T)] for part in (arrays.pull, arrays.reach))
    gaps = np.pad(table.stops, ((0, 0), (0, size // 2)))
    bounds = [np.arange(part.start - first, part.stop - first) for part in (layout.lower, layout.upper)]
    stops = np.array([problem.modes.contact_stop[contact] if contact >= 0 else -1 for contact in problem.contacts[:nodes]], dtype=np.int64)
    watched = _numbers(gaps).reshape(-1, size), *bounds, stops, force, np.array(arrays.opens[:nodes])
    places = [part.start - first for part in (layout.constant, layout.cosine, layout.sine, layout.frequency)]
    stop, rebound = (np.where(part >= 0, part - first, -1) for part in segment.contact[:all_nodes].T)
    program = problem.parametric.program(problem.released, 0).program
    kept = problem.parametric.equations(problem.keep, problem.released, problem.conserved, 0)
    bounced = (_numbers(part[:all_nodes, :size]) for part in (segment.gap, segment.gap_rate, segment.push))
    forces = _numbers(pull).reshape(-1, size), *(_numbers(part).reshape(-1, size // 2) for part in (reach, table.stops[closed[:, 1]]))
    weight, at_force = np.concatenate([made.weight for made in table.made]), np.ascontiguousarray(closed[:, 0])
    free = bool(problem.conserved), bool(unfolded), *map(int, segment.shape[2:5])
    entries = _numbers(problem.parametric.entries(problem.values)[first:])
    smooth_flight = saltus_core.SmoothLoadedFlight(*smooth_arguments(problem)) if problem.is_smooth else None
    flights = smooth_flight or _flights(problem, table.made, problem.system.mass)
    return (
        flights, np.array(mode), release, stop, rebound, _numbers(segment.side[:all_nodes]),
        *bounced, *forces, weight, at_force, table.kept[:all_nodes], np.array(arrays.chatter.summed[:nodes]),
        (*segment.closing.tolist(), loads.load_periods), free,
        _numbers(segment.end_map), _numbers(released.values), np.array(released.columns), entries, rows - first, np.array(places),
        tuple(map(np.ascontiguousarray, program)), tuple(map(np.ascontiguousarray, kept)), _numbers(segment.scale), watched,
        knows_masses, undamped, _modes_at(problem) if varies and not (problem.is_smooth or undamped) else None,
    )  # fmt: skip


def _flights(problem: ForcedProblem, made: Sequence[ForcedMode], mass: np.ndarray) -> list[Any]:
    """The flights of contact modes in the core."""
    loads, n = problem.segment.flight.loads, problem.degrees_of_freedom
    flights, inverse = [], np.linalg.inv(mass)
    for mode in made:
        blocks = mode.blocks
        free = saltus_core.LinearFlight(blocks.pairs, blocks.mean, blocks.delta, _numbers(blocks.matrix), np.ones(2 * n))
        shapes = map(_numbers, (mode.enter, mode.leave, mode.enter[:, n:] @ inverse, loads.harmonics))
        flights.append(saltus_core.LoadedFlight(free, *shapes))
    return flights


def smooth_arguments(problem: ForcedProblem) -> tuple[Any, ...]:
    """What the flights with smooth forces of the core are made of."""
    flight = problem.segment.flight
    assert problem.smooth_forces is not None and isinstance(flight, SmoothLoadedFlight)
    forces = released_forces(problem.smooth_forces)
    program = forces.program
    codes = program.code, program.numbers, program.forces, program.slopes
    numbers, energy = (tuple(map(np.ascontiguousarray, part)) for part in (forces.numbers, forces.energy))
    if len(energy[2]):
        energy = (*energy[:2], energy[2][:1])  # without its derivatives
    return (
        forces.rows, _numbers(forces.directions), *map(np.ascontiguousarray, codes), program.registers, len(problem.released), numbers,
        energy, _numbers(flight.loads.harmonics), flight.taylor.paths.times.shape[1] - 1, 2 * (problem.inner + 2),
    )  # fmt: skip


def _modes_at(problem: ForcedProblem) -> Callable[[np.ndarray, np.ndarray], list[Any]]:
    """The function that gives the core the contact modes at values of all parameters, where the entries of the system are known; none where
    the system cannot have them."""
    known = weakref.ref(problem)  # which can have the problem of the core

    def modes_at(parameters: np.ndarray, entries: np.ndarray) -> list[Any]:
        found = known()
        try:
            return [] if found is None else _flights(found, *found.modes_at(tuple(parameters.tolist()), entries))
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            return []

    return modes_at


def core_unknowns(problem: ForcedProblem, y: np.ndarray) -> np.ndarray:
    """The unknowns of the core: those of `ForcedProblem` with one copy of the parameters, and one time for each node. A node that begins a
    chatter is that before it: the end of the flight that leads there."""
    size = 2 * problem.degrees_of_freedom
    nodes = problem.nodes(y)
    times = nodes[:, size] if problem.has_clock else problem.flight_times(y)
    part, kick = np.column_stack([times, nodes[:, :size]]), y[len(nodes) * (problem.size + 1) :]
    if problem.contact_modes.sums_chatter:
        problem.residual(y)
        for i in np.flatnonzero(np.roll(problem.contact_modes.arrays.chatter.summed[: len(nodes)], 1)).tolist():
            sign, turn = problem.segment.closing if i == 0 else (1.0, 0.0)
            before = problem._factor.before[i - 1]
            part[i] = before[size] - turn, *(sign * before[:size])
    return np.concatenate([part.ravel(), kick, nodes[0, size + 1 :]])


def unknowns_of_core(problem: ForcedProblem, y: np.ndarray, core: Any = None) -> np.ndarray:
    """The inverse of `core_unknowns`. core: the problem in the core, for the ends of chatter."""
    size, count, nodes = 2 * problem.degrees_of_freedom, len(problem.released), problem.inner + 1
    kick, parameters = np.split(y[nodes * (size + 1) :], [len(y) - count - nodes * (size + 1)])
    part = y[: nodes * (size + 1)].reshape(nodes, size + 1)
    if not problem.has_clock:
        out = problem.pack(part[:, 1:], np.zeros(nodes), parameters, part[:, 0])
        out[len(out) - len(kick) :] = kick
        return out
    if not problem.contact_modes.sums_chatter:
        return problem.pack(part[:, 1:], part[:, 0], parameters)
    starts = (core_problem(problem) if core is None else core).starts(y)
    ends = np.append(part[1:, 0], part[0, 0] + problem.segment.closing[1])
    out = problem.pack(starts[:, :size], starts[:, size], parameters)
    problem.flight_times(out)[:] = (ends - starts[:, size]) * problem.period(out)
    return out
