"""The flights of a conservative system in modal coordinates, with smooth forces or without, as the compiled core has them: states along
them, and their energies."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import saltus_core as core

from bvp.dense import product

if TYPE_CHECKING:
    from collections.abc import Callable

    from bvp.kernels.expressions import Program
    from bvp.kernels.jets import JetProgram
    from bvp.modes import Modes
    from bvp.system import ImpactSystem

__all__ = [
    "core_arrays", "core_flight", "flight_of", "loaded_steps", "make_flight", "modal_energies", "modal_rows", "sample_path", "smooth_steps",
    "why_not_complete", "why_not_flown",
]  # fmt: skip


def make_flight(system: ImpactSystem) -> Any:
    """The flights of a conservative system: a `LinearFlight` or `SmoothFlight` of the core, which keeps the last flights.

    The state is that of the modes of its linear part, u = Phi q: forces f along the rows d of the coordinates accelerate q by -(d Phi)^T f.
    """
    if system.smooth_forces is None:
        return _linear_flight(system.modes)
    return core_flight(system)


def core_flight(system: ImpactSystem, keep: int = 16) -> core.SmoothFlight:
    """The flights of a system with smooth forces. keep: how many that were computed last are kept."""
    forces, modes = system.smooth_forces, system.modes
    assert forces is not None
    arrays = modes.matrix, *modal_rows(system), _weights(modes)
    if not forces.is_called:
        return core_arrays(*arrays, forces.program(), forces.energy_program(), keep)
    called = forces.called_forces()
    return core_arrays(*arrays, called.program, forces.energy_program(), keep, called.write, lambda at: called.energies(at)[0])


def core_arrays(
    matrix: np.ndarray, inputs: np.ndarray, push: np.ndarray, weights: np.ndarray, program: JetProgram, potential: Program, keep: int = 16,
    called: Callable[[np.ndarray, int], None] | None = None, energy: Callable[[np.ndarray], float] | None = None,
    most_steps: int = core.MOST_TAYLOR_STEPS,
) -> core.SmoothFlight:  # fmt: skip
    """Flights of the core from their arrays: z' = B z (N, N), inputs (I, N), accelerations of unit forces (n, F), and the weights (N,) of
    the quadratic part of twice the energy. called, energy: see `bvp.called_forces.CalledForces`."""
    arrays = (np.ascontiguousarray(array, dtype=float) for array in (matrix, inputs, push, weights))
    code = program.code if called is None else program.code[:0]
    forces = code, program.numbers, program.forces, program.slopes, program.registers
    return core.SmoothFlight(*arrays, *forces, potential.code, potential.constants, potential.outputs, keep, called, energy, most_steps)


def modal_rows(system: ImpactSystem) -> tuple[np.ndarray, np.ndarray]:
    """The inputs of the forces (I, N) and the accelerations of unit forces (n, F), in modal coordinates."""
    forces, shapes, n = system.smooth_forces, system.modes.shapes, system.degrees_of_freedom
    assert forces is not None
    inputs = np.hstack([product(forces.inputs[:, :n], shapes), product(forces.inputs[:, n:], shapes)])
    return inputs, np.ascontiguousarray(-product(forces.directions, shapes).T)


@lru_cache(maxsize=64)
def _linear_flight(modes: Modes) -> Any:
    pairs, mean, delta, matrix = modes.flight
    return core.LinearFlight(pairs, mean, delta, np.ascontiguousarray(matrix), _weights(modes))


def _weights(modes: Modes) -> np.ndarray:
    """H = sum(weights z^2)/2 without smooth forces, (N,)."""
    return np.concatenate([modes.squares, np.ones(len(modes.squares))])


@lru_cache(maxsize=8)
def flight_of(system: ImpactSystem) -> Any:
    """The same flights, shared by all who ask."""
    return make_flight(system)


def why_not_flown(flight: core.LinearFlight | core.SmoothFlight) -> str:
    """Where and why the flight that was computed last has no end; empty where it has one."""
    if not isinstance(flight, core.SmoothFlight) or flight.failure is None:
        return ""
    return why_not_complete(flight.failure, flight.is_called)


def why_not_complete(path: core.TaylorPath, called: bool = False) -> str:
    """Where and why a flight has no end. called: whether the forces are a Python function."""
    return _why(path.duration, path.times[-1], len(path.times) - 1, path.exhausted, called)


def _why(duration: float, time: float, count: int, full: bool, called: bool) -> str:
    wrong = "the forces are no numbers, too large or not smooth there" if called else "the forces are too large or not smooth there"
    why = f"it takes more than {count} {'steps' if called else 'Taylor steps'}" if full else wrong
    return f"a flight of time {duration:.4g} cannot be computed beyond the time {time:.4g}: {why}"


def smooth_steps(flight: Any, state: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """The Taylor steps of a flight of a conservative system with smooth forces: their times (S + 1,), and their polynomials
    (S, ORDER + 1, N).

    Raises
    ------
    RuntimeError
        If the flight cannot be computed.
    """
    path = flight.path(np.ascontiguousarray(state, dtype=float), duration)
    if not path.complete:
        raise RuntimeError(why_not_complete(path, flight.is_called))
    return path.times, path.coefficients


class _Flights(Protocol):
    """What is needed of a forced problem (`bvp.forced.ForcedProblem`)."""

    @property
    def core(self) -> Any: ...

    size: int
    smooth_forces: Any


def loaded_steps(problem: _Flights, node: np.ndarray, duration: float, flight: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of a flight of a forced orbit with smooth forces, from one of its nodes: (S, ORDER + 1, 2 n) of (u, v).

    Raises
    ------
    RuntimeError
        If the flight cannot be computed.
    """
    size, n = problem.size, problem.size // 2
    node = np.ascontiguousarray(node, dtype=float)
    path = problem.core.path(node[size + 1 :], flight, node[: size + 1], float(duration))
    if not path.complete:
        raise RuntimeError(f"flight {flight + 1} of an orbit: {why_not_complete(path, problem.smooth_forces.is_called)}")
    coefficients = path.coefficients
    half = coefficients.shape[2] // 2  # the oscillators of the loads follow the coordinates
    return path.times, np.concatenate([coefficients[..., :n], coefficients[..., half : half + n]], axis=2)


def modal_energies(system: ImpactSystem, states: np.ndarray) -> np.ndarray:
    """h of states (..., N) in modal coordinates, (...,)."""
    if system.smooth_forces is None:
        return np.asarray(0.5 * np.sum(_weights(system.modes) * states * states, axis=-1))
    displacements, velocities = np.split(states @ system.modes.to_state.T, 2, axis=-1)
    return np.asarray(system.energy(displacements, velocities))


def sample_path(system: ImpactSystem, begins: np.ndarray, flights: np.ndarray, times: np.ndarray, states: np.ndarray) -> None:
    """States (m, N) at times (m,), of flights that begin at times (P,), ascending, with states (P, N)."""
    flight = flight_of(system)
    place = np.maximum(np.searchsorted(begins, times, side="right") - 1, 0)
    order = np.lexsort((times, place))
    for chosen in np.split(order, np.flatnonzero(np.diff(place[order])) + 1) if len(order) else ():
        k = int(place[chosen[0]])
        states[chosen] = core.sample(flight, np.ascontiguousarray(flights[k], dtype=float), times[chosen] - begins[k])
