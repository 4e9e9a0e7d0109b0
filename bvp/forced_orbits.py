"""The orbits of a forced problem with linear flights in the compiled core."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core

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
    size, nodes, first = 2 * problem.degrees_of_freedom, problem.inner + 1, 0 if varies else layout.stiffness.stop
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
    stop, rebound = (np.where(part >= 0, part - first, -1) for part in segment.contact[:nodes].T)
    program = problem.parametric.program(problem.released, 0).program
    kept = problem.parametric.equations(problem.keep, problem.released, problem.conserved, 0)
    return (
        _flights(problem, table.made, problem.system.mass), np.array(mode), release, stop, rebound, _numbers(segment.side[:nodes]), _numbers(segment.gap[:nodes, :size]),
        _numbers(segment.gap_rate[:nodes, :size]), _numbers(segment.push[:nodes, :size]), _numbers(pull).reshape(-1, size),
        _numbers(reach).reshape(-1, size // 2), _numbers(table.stops[closed[:, 1]]).reshape(-1, size // 2),
        np.concatenate([made.weight for made in table.made]), np.ascontiguousarray(closed[:, 0]), table.kept[:nodes], (*segment.closing.tolist(), loads.load_periods), _numbers(released.values),
        np.array(released.columns), _numbers(problem.parametric.entries(problem.values)[first:]), rows - first,
        np.array(places), tuple(map(np.ascontiguousarray, program)), tuple(map(np.ascontiguousarray, kept)), _numbers(segment.scale),
        watched, _modes_at(problem) if varies else None,
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
    return np.concatenate([np.column_stack([times, nodes[:, :size]]).ravel(), nodes[0, size + 1 :]])


def unknowns_of_core(problem: ForcedProblem, y: np.ndarray) -> np.ndarray:
    """The inverse of `core_unknowns`."""
    size, count = 2 * problem.degrees_of_freedom, len(problem.released)
    nodes, parameters = y[: len(y) - count].reshape(-1, size + 1), y[len(y) - count :]
    if problem.has_clock:
        return problem.pack(nodes[:, 1:], nodes[:, 0], parameters)
    return problem.pack(nodes[:, 1:], np.zeros(len(nodes)), parameters, nodes[:, 0])
