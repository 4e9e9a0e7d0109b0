"""The flights of a conservative system in modal coordinates, with smooth forces or without.

These are the arrays that the kernels take; states along the flights, and their energies."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import saltus_core as core

from bvp.kernels.flight import Flight, sample_flights
from bvp.kernels.taylor import Paths, SmoothFlight, fly_smooth, make_smooth_flight

if TYPE_CHECKING:
    from bvp.kernels.expressions import Program
    from bvp.kernels.jets import JetProgram
    from bvp.system import ImpactSystem

__all__ = [
    "core_arrays", "core_flight", "flight_of", "loaded_steps", "modal_energies", "sample_path", "smooth_flight", "smooth_steps",
    "why_not_complete", "why_not_flown",
]  # fmt: skip

PIECES = 1, 8, 64, 512
"""Parts in which a flight is computed where only its path is wanted."""


def smooth_flight(system: ImpactSystem, flights: int) -> SmoothFlight:
    """The flights of a conservative system with smooth forces, with room for the paths of so many.

    The state is that of the modes of its linear part, u = Phi q: forces f along the rows d of the coordinates accelerate q by -(d Phi)^T f.
    """
    forces, modes = system.smooth_forces, system.modes
    assert forces is not None
    inputs, push = _modal_rows(system)
    flight: SmoothFlight = make_smooth_flight(modes.matrix, inputs, push, forces.program(), forces.energy_program(), flights)
    if not forces.is_called:
        return flight
    from bvp.kernels.collocation import collocated

    steps: SmoothFlight = collocated(flight)
    return steps


def core_flight(system: ImpactSystem, keep: int = 16) -> core.SmoothFlight:
    """The same flights as the core has them. keep: how many that were computed last are kept."""
    forces, modes = system.smooth_forces, system.modes
    assert forces is not None
    weights = np.concatenate([modes.squares, np.ones(system.degrees_of_freedom)])
    inputs, push = _modal_rows(system)
    return core_arrays(modes.matrix, inputs, push, weights, forces.program(), forces.energy_program(), keep)


def core_arrays(
    matrix: np.ndarray, inputs: np.ndarray, push: np.ndarray, weights: np.ndarray, program: JetProgram, potential: Program, keep: int = 16
) -> core.SmoothFlight:
    """Flights of the core from their arrays: z' = B z (N, N), inputs (I, N), accelerations of unit forces (n, F), and the weights (N,) of
    the quadratic part of twice the energy."""
    arrays = (np.ascontiguousarray(array, dtype=float) for array in (matrix, inputs, push, weights))
    forces = program.code, program.numbers, program.forces, program.slopes, program.registers
    return core.SmoothFlight(*arrays, *forces, potential.code, potential.constants, potential.outputs, keep)


def _modal_rows(system: ImpactSystem) -> tuple[np.ndarray, np.ndarray]:
    """The inputs of the forces (I, N) and the accelerations of unit forces (n, F), in modal coordinates."""
    forces, shapes, n = system.smooth_forces, system.modes.shapes, system.degrees_of_freedom
    assert forces is not None
    inputs = np.hstack([forces.inputs[:, :n] @ shapes, forces.inputs[:, n:] @ shapes])
    return inputs, np.ascontiguousarray(-(forces.directions @ shapes).T)


@lru_cache(maxsize=8)
def flight_of(system: ImpactSystem) -> Flight | SmoothFlight:
    """The flights of a conservative system, for the kernels of `bvp.kernels.flights`. Shared by all who ask."""
    return system.modes.flight if system.smooth_forces is None else smooth_flight(system, 2)


def why_not_flown(flight: Any, begin: np.ndarray | None = None) -> str:
    """Where and why the flight that was computed last has no end; empty where it has one. flight: of any kind, under loads too. begin
    (W + 1,): the node and the duration of another one that was computed."""
    if isinstance(flight, core.SmoothFlight):
        return "" if flight.failure is None else why_not_complete(flight.failure)
    flight = getattr(flight, "taylor", flight)
    if not isinstance(flight, SmoothFlight):
        return ""
    paths, slot = flight.paths, int(flight.paths.latest[0])
    if begin is not None:
        slot = int(np.all(paths.begins == begin, axis=1).argmax())
    steps, count = paths.steps[slot].tolist()
    if steps >= 0:
        return ""
    full = count == paths.coefficients.shape[1]
    called = flight.stages.address != 0
    wrong = "the forces are no numbers, too large or not smooth there" if called else "the forces are too large or not smooth there"
    why = f"it takes more than {count} {'steps' if called else 'Taylor steps'}" if full else wrong
    return _beyond(paths.begins[slot, -1], paths.times[slot, count], why)


def why_not_complete(path: core.TaylorPath) -> str:
    """Where and why a flight has no end."""
    steps = len(path.times) - 1
    why = f"it takes more than {steps} Taylor steps" if path.exhausted else "the forces are too large or not smooth there"
    return _beyond(path.duration, path.times[-1], why)


def _beyond(duration: float, time: float, why: str) -> str:
    return f"a flight of time {duration:.4g} cannot be computed beyond the time {time:.4g}: {why}"


def smooth_steps(flight: Any, state: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """The Taylor steps of a flight of a conservative system with smooth forces: their times (S + 1,), and their polynomials
    (S, ORDER + 1, N).

    Raises
    ------
    RuntimeError
        If the flight cannot be computed.
    """
    if not fly_smooth(flight, 0, np.array(state, float), duration, False):
        flight.paths.latest[0] = 0
        raise RuntimeError(why_not_flown(flight))
    return _kept_steps(flight.paths, 0)


class _Flights(Protocol):
    """What is needed of a forced problem (`bvp.forced.ForcedProblem`)."""

    segment: Any

    def fly(self, node: np.ndarray, time: float, flight: int = 0) -> Any: ...


def loaded_steps(problem: _Flights, node: np.ndarray, duration: float, flight: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of a flight of a forced orbit with smooth forces, from one of its nodes (N,).

    Raises
    ------
    RuntimeError
        If the flight cannot be computed.
    """
    problem.fly(node, duration, flight)
    kept: Any = problem.segment.flight
    paths = kept.taylor.paths
    slots = np.flatnonzero(np.all(paths.begins == np.append(node, duration), axis=1) & (paths.steps[:, 0] > 0))
    if not len(slots):
        raise RuntimeError(f"flight {flight + 1} of an orbit: {why_not_flown(kept)}")
    return _kept_steps(paths, int(slots[0]))


def _kept_steps(paths: Paths, slot: int) -> tuple[np.ndarray, np.ndarray]:
    count = int(paths.steps[slot, 0])
    return paths.times[slot, : count + 1].copy(), paths.coefficients[slot, :count].copy()


def modal_energies(system: ImpactSystem, states: np.ndarray) -> np.ndarray:
    """h of states (..., N) in modal coordinates, (...,)."""
    if system.smooth_forces is None:
        weights = np.concatenate([system.modes.squares, np.ones(system.degrees_of_freedom)])
        return np.asarray(0.5 * np.sum(weights * states * states, axis=-1))
    displacements, velocities = np.split(states @ system.modes.to_state.T, 2, axis=-1)
    return np.asarray(system.energy(displacements, velocities))


def sample_path(system: ImpactSystem, begins: np.ndarray, flights: np.ndarray, times: np.ndarray, states: np.ndarray) -> None:
    """States (m, N) at times (m,), of flights that begin at times (P,), ascending, with states (P, N)."""
    if system.smooth_forces is None:
        sample_flights(system.modes.flight, begins, flights, times, states)
    else:
        _sample_smooth(system, begins, flights, times, states)


def _sample_smooth(system: ImpactSystem, begins: np.ndarray, flights: np.ndarray, times: np.ndarray, states: np.ndarray) -> None:
    """See `sample_path`.

    Each flight is computed from one time to the next: in one piece, or, where it has too many steps for that, in more.
    """
    path = smooth_flight(system, 1)
    place = np.searchsorted(begins, times, side="right") - 1
    for k in range(len(begins)):
        here, state = float(begins[k]), np.array(flights[k], float)
        for i in sorted(np.flatnonzero(place == k), key=lambda i: times[i]):
            ahead = float(times[i]) - here
            if ahead > 0.0:
                tried = (_flown(path, state, ahead, pieces) for pieces in PIECES)
                state = next((found for found in tried if found is not None), np.full_like(state, np.nan))
            here = float(times[i])
            states[i] = state


def _flown(path: SmoothFlight, state: np.ndarray, ahead: float, pieces: int) -> np.ndarray | None:
    """The state after a time, in so many pieces; None where one has too many steps, or leaves where forces are known."""
    for _ in range(pieces):
        if not fly_smooth(path, 0, state, ahead / pieces, False):
            return None
        state = path.paths.ends[0].copy()
    return state
