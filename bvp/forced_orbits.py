"""The orbits of a forced problem with linear flights in the compiled core."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core

from bvp.kernels.multipoint import UNFOLDED

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.forced_modes import ForcedMode

__all__ = ["core_problem", "core_unknowns", "unknowns_of_core"]


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


def core_problem(problem: ForcedProblem, *, general: bool = False) -> Any:
    """The problem in the core; None for smooth forces and for summed chatter.

    general: take what is compiled for any number of states and parameters."""
    arguments = core_arguments(problem)
    return None if arguments is None else saltus_core.ForcedProblem(*arguments, general)


def core_arguments(problem: ForcedProblem) -> tuple[Any, ...] | None:
    """What the problem of the core is made of."""
    table, segment, layout = problem.contact_modes, problem.segment, problem.parametric.layout
    released = segment.released
    rows = released.rows
    if problem.is_smooth or table.sums_chatter:
        return None
    varies = bool(np.any(rows < layout.stiffness.stop))
    arrays, loads = table.arrays, segment.flight.loads
    size, nodes, first = 2 * problem.degrees_of_freedom, problem.inner + 1, 0 if varies or problem.conserved else layout.stiffness.stop
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
    return (
        _flights(problem, table.made, problem.system.mass), np.array(mode), release, stop, rebound, _numbers(segment.side[:all_nodes]),
        *bounced, *forces, weight, at_force, table.kept[:all_nodes], (*segment.closing.tolist(), loads.load_periods), free,
        _numbers(segment.end_map), _numbers(released.values), np.array(released.columns), entries, rows - first, np.array(places),
        tuple(map(np.ascontiguousarray, program)), tuple(map(np.ascontiguousarray, kept)), _numbers(segment.scale), watched,
        _modes_at(problem) if varies else None,
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
    """The unknowns of the core: those of `ForcedProblem` with one copy of the parameters, and one time for each node."""
    size = 2 * problem.degrees_of_freedom
    nodes = problem.nodes(y)
    times = nodes[:, size] if problem.has_clock else problem.flight_times(y)
    kick = y[len(nodes) * (problem.size + 1) :]
    return np.concatenate([np.column_stack([times, nodes[:, :size]]).ravel(), kick, nodes[0, size + 1 :]])


def unknowns_of_core(problem: ForcedProblem, y: np.ndarray) -> np.ndarray:
    """The inverse of `core_unknowns`."""
    size, count, nodes = 2 * problem.degrees_of_freedom, len(problem.released), problem.inner + 1
    kick, parameters = np.split(y[nodes * (size + 1) :], [len(y) - count - nodes * (size + 1)])
    part = y[: nodes * (size + 1)].reshape(nodes, size + 1)
    if problem.has_clock:
        return problem.pack(part[:, 1:], part[:, 0], parameters)
    out = problem.pack(part[:, 1:], np.zeros(nodes), parameters, part[:, 0])
    out[len(out) - len(kick) :] = kick
    return out
