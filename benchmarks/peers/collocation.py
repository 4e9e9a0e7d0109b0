"""`scipy.integrate.solve_bvp` on the multi-segment form: the same orbits by collocation with an adaptive mesh.

Each flight of the segment is mapped to [0, 1]. All flights together are one boundary-value problem in modal coordinates. Its parameters are
the flight times. Its boundary conditions are the start, the impacts, the end, and the wanted energy or quarter period. All derivatives are
given. The method is of fourth order. It computes no multipliers, and does not check whether a flight penetrates a stop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp

from benchmarks.speed_error.methods import Answer, Method, Task, Work
from benchmarks.speed_error.tasks import OrbitTask
from bvp.multipoint import MultipointProblem
from tests.lab.flights import LinearFlight
from tests.lab.problems import Equations

__all__ = ["Collocation", "CollocationError", "CollocationOrbit", "solve_collocation"]

NODES = 7
"""Nodes of the first mesh."""

ENTRIES = 1e7
"""Most entries of a matrix of solve_bvp: some hundred megabytes."""


class CollocationError(RuntimeError):
    """solve_bvp did not reach the tolerance; the message quotes it."""


@dataclass(frozen=True, eq=False)
class CollocationOrbit:
    """An orbit that collocation found."""

    unknowns: np.ndarray  # (u,) those of the multipoint problem
    energy: float
    quarter_period: float
    tolerance: float  # the wanted one
    residual: float  # largest relative residual of the mesh intervals, as solve_bvp estimates it
    mesh: np.ndarray  # (m,) nodes in [0, 1], the same for all flights
    states: np.ndarray  # (4 (k + 1), m) modal states of all flights there


class _Segments:
    """The right-hand side and the boundary conditions, with their derivatives. Only a wanted energy is not linear."""

    def __init__(self, problem: MultipointProblem, energy: float | None, quarter_period: float | None) -> None:
        self.problem = problem
        self.flights = problem.inner + 1
        self.size = size = problem.size
        self.energy = energy
        self.rates = problem.modes.matrix  # z' = B z in free flight
        segment = Equations(problem)
        self.weights = segment.weights
        # Conditions on (states at 0, states at 1, flight times): rows @ these = right.
        width = self.flights * size
        rows: list[np.ndarray] = []
        right: list[float] = []

        def condition(at_zero: tuple[int, np.ndarray] | None, at_one: tuple[int, np.ndarray] | None, value: float) -> None:
            row = np.zeros(2 * width + self.flights)
            for offset, part in ((0, at_zero), (width, at_one)):
                if part is not None:
                    row[offset + part[0] * size : offset + (part[0] + 1) * size] = part[1]
            rows.append(row)
            right.append(value)

        start = segment.start_map
        for normal in np.linalg.svd(start.T)[2][start.shape[1] :]:  # the complement of the free directions of the start
            condition((0, normal), None, float(normal @ segment.start_offset))
        for i in range(problem.inner):
            condition(None, (i, segment.gap[i]), float(segment.bound[i]))
            jump = np.eye(size) - segment.jump[i] * np.outer(segment.push[i], segment.gap_rate[i])
            for j in range(size):
                condition((i + 1, np.eye(size)[j]), (i, -jump[j]), 0.0)
        for end_row, end_value in zip(segment.end_map, segment.end_offset, strict=True):
            condition(None, (self.flights - 1, end_row), float(end_value))
        if quarter_period is not None:
            row = np.zeros(2 * width + self.flights)
            row[2 * width :] = 1.0 / (problem.quarters * quarter_period)
            rows.append(row)
            right.append(1.0)
        self.rows, self.right = np.array(rows), np.array(right)
        self.width = width

    def motion(self, x: np.ndarray, y: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Derivatives (n, m) with respect to x in [0, 1]."""
        states = y.reshape(self.flights, self.size, -1)
        return (times[:, None, None] * np.einsum("ij,fjm->fim", self.rates, states)).reshape(y.shape)

    def motion_derivatives(self, x: np.ndarray, y: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d/dy (n, n, m) and d/dtimes (n, k + 1, m)."""
        size = self.size
        by_state = np.zeros((self.width, self.width, len(x)))
        by_time = np.zeros((self.width, self.flights, len(x)))
        for i, time in enumerate(times):
            mine = slice(i * size, (i + 1) * size)
            by_state[mine, mine] = (time * self.rates)[:, :, None]
            by_time[mine, i] = self.rates @ y[mine]
        return by_state, by_time

    def conditions(self, first: np.ndarray, last: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Residuals (n + k + 1,) of the boundary conditions."""
        linear = self.rows @ np.concatenate([first, last, times]) - self.right
        if self.energy is None:
            return linear
        start = first[: self.size]
        return np.append(linear, 0.5 * np.sum(self.weights * start * start) / self.energy - 1.0)

    def condition_derivatives(self, first: np.ndarray, last: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Their derivatives with respect to the states at 0, the states at 1, and the times."""
        rows = self.rows
        if self.energy is not None:
            row = np.zeros(rows.shape[1])
            row[: self.size] = self.weights * first[: self.size] / self.energy
            rows = np.vstack([rows, row])
        return rows[:, : self.width], rows[:, self.width : 2 * self.width], rows[:, 2 * self.width :]


def solve_collocation(
    problem: MultipointProblem,
    y: np.ndarray,
    *,
    energy: float | None = None,
    quarter_period: float | None = None,
    tolerance: float = 1e-6,
    near: CollocationOrbit | None = None,
    most_nodes: int = 20_000,
) -> CollocationOrbit:
    """Solve an orbit between two ends at a given energy or quarter period, exactly one of them, from a guess of the unknowns y.

    `tolerance` is that of solve_bvp, for the relative residuals of the equations and the absolute residuals of the boundary conditions. The
    states and the mesh of an orbit `near` replace the guess. solve_bvp stops at `most_nodes` nodes. Its memory grows with them and with the
    square of the number of flights.

    Raises
    ------
    ValueError
        For a periodic closure, and for both or none of energy and quarter period.
    CollocationError
        If the tolerance is not reached.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    >>> guess = problem.pack([0.0, 0.0, 0.9, 0.6], [], [1.7])
    >>> round(solve_collocation(problem, guess, quarter_period=1.7, tolerance=1e-8).energy, 7)
    0.5887481
    """
    if problem.periodic:
        raise ValueError("collocation is written for orbits between two ends; received a closed one")
    if (energy is None) == (quarter_period is None):
        raise ValueError("expected an energy or a quarter period; received " + ("none" if energy is None else "both"))
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance lies between 0 and 1; received {tolerance:g}")
    segments = _Segments(problem, energy, quarter_period)
    if near is None:
        mesh = np.linspace(0.0, 1.0, NODES)
        states = _states(problem, np.asarray(y, dtype=float), mesh)
        times = problem.flight_times(y)
    else:
        mesh, states, times = near.mesh, near.states, problem.flight_times(near.unknowns)
    found = solve_bvp(
        segments.motion, segments.conditions, mesh, states, p=times, tol=tolerance, bc_tol=tolerance, max_nodes=most_nodes,
        fun_jac=segments.motion_derivatives, bc_jac=segments.condition_derivatives,
    )  # fmt: skip
    if not found.success:
        raise CollocationError(f"solve_bvp with tolerance {tolerance:.1e}: {' '.join(found.message.split())} ({len(found.x)} nodes)")
    if np.min(found.p) <= 0.0:
        raise CollocationError(f"solve_bvp came to a flight of time {np.min(found.p):.3g}")
    nodes = found.y[:, 0].reshape(segments.flights, segments.size)
    unknowns = problem.pack(nodes[0], nodes[1:], found.p)
    residual = float(np.max(found.rms_residuals))
    return CollocationOrbit(unknowns, problem.energy(unknowns), problem.quarter_period(unknowns), tolerance, residual, found.x, found.y)


def _states(problem: MultipointProblem, y: np.ndarray, mesh: np.ndarray) -> np.ndarray:
    """Modal states of all flights of a guess at the nodes of a mesh, (4 (k + 1), m)."""
    begins = np.vstack([problem.start(y)[None], problem.nodes(y)])
    out, flight = np.empty((len(begins), len(mesh), problem.size)), LinearFlight(problem.system)
    for i, (begin, time) in enumerate(zip(begins, problem.flight_times(y), strict=True)):
        for j, x in enumerate(mesh):
            out[i, j] = flight.end(begin, time * x)
    return out.transpose(0, 2, 1).reshape(-1, len(mesh))


@dataclass(frozen=True)
class Collocation(Method):
    """Orbits and their energies by solve_bvp, without stability."""

    name = "solve_bvp"
    setting = "tol"

    def prepare(self, task: Task, setting: float | None) -> Work:
        assert isinstance(task, OrbitTask) and setting is not None
        guess = task.guess()
        # A matrix of solve_bvp has an entry for every pair of states at every node.
        most = int(min(20_000, ENTRIES / (4 * (len(task.sequence) + 1)) ** 2))

        def solve() -> Answer:
            found = solve_collocation(task.problem, guess, quarter_period=task.alpha, tolerance=setting, most_nodes=most)
            return Answer(orbits=(task.answer(found.unknowns, found.energy),))

        return Work(solve)
