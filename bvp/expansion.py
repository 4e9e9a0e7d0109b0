"""The multipoint problem of forced orbits, and of free orbits in parameters, in infinitesimals: equations (38) to (43).

With its loads a linear flight is autonomous: x = (u, v), the cosines and sines of the loads and 1 form a state xi' = A xi, so that
xi(t) = exp(A t) xi(0). In infinitesimals (`bvp.nilpotent`) this has the exact derivatives along any directions, since A, t and xi(0) have
them. Flights with smooth forces are those of `bvp.smooth_expansion`. The other equations are products.

Each node carries its own copy of the released parameters. The equations of a flight and of the impact at its end depend on that of the node
where it begins, and the gap of a node on its own. This is how `ForcedProblem.jacobian` places its columns. All nodes have the parameters of
the first one, at which the problem is evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bvp.kernels.multipoint import PERIODIC, STOP, UNFOLDED
from bvp.nilpotent import composed, constant, exponential, inverse, product

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.smooth_expansion import SmoothExpansion

__all__ = ["expanded"]


def expanded(problem: ForcedProblem, y: np.ndarray, directions: Sequence[np.ndarray]) -> np.ndarray:
    """The residual at y + e_1 directions[0] + e_2 directions[1] + ..., (2^d, u - 1), in infinitesimals (`bvp.nilpotent`): the residual
    itself, its derivatives along each direction, and so on; the last one along all of them.

    Examples
    --------
    A mass of 2 that flies past its stop; where its velocity v and its flight time t change it lands v t further:

    >>> from bvp.released import ReleasedProblem
    >>> from bvp.parameters import ParametricSystem
    >>> system = {"mass": [[2.0]], "stiffness": [[0.0]], "stops": [{"c": [1.0], "lower": -1.0, "upper": 1.0}]}
    >>> free = ParametricSystem.from_description({"parameters": {"a": 1.0}, "system": {**system, "mass": [["2*a"]]}})
    >>> problem = ReleasedProblem(free, ("origin", "stop+"), (), ["a"], ["energy = 1"])
    >>> problem.unknowns, expanded(problem, np.array([0, 1, 0, 1, 1.0]), np.eye(5)[[1, 4]])[-1].tolist()
    (5, [0.0, 1.0, 0.0, 0.0])
    """
    return _Expansion(problem, np.asarray(y, dtype=float), directions).residual()


class Motion(NamedTuple):
    """The motion in a contact mode, in infinitesimals: u' = project v, v' = inverse (f - K u - C v)."""

    project: np.ndarray  # (2^d, n, n)
    inverse: np.ndarray  # (2^d, n, n)
    reach: np.ndarray  # (2^d, k, n) contact forces of unit loads
    state: np.ndarray  # (2^d, n, 2 n) [K, C]


class _Expansion:
    """The residual in infinitesimals."""

    def __init__(self, problem: ForcedProblem, y: np.ndarray, directions: Sequence[np.ndarray]):
        self.problem, self.segment = problem, problem.segment
        self.count = count = 1 << len(directions)
        self.order = len(directions)
        self.n = problem.degrees_of_freedom
        self.y = np.zeros((count, len(y)), dtype=np.result_type(*directions, float))
        self.y[0] = y
        for k, direction in enumerate(directions):
            self.y[1 << k] = direction
        values = problem.segment.released.values.copy()
        values[problem.segment.released.columns] = y[2 * self.n + 1 : problem.size]
        self.values = values
        self.rows = problem.segment.released.rows
        self.tables = problem.curvature.tables(values, self.order)
        self.smooth = problem.curvature.smooth_expansion(self.order) if problem.is_smooth else None

    # -- parts ----------------------------------------------------------------------------------------------------------------

    def node(self, i: int) -> np.ndarray:
        """Node i, (2^d, N)."""
        start = i * (self.problem.size + 1)
        return self.y[:, start : start + self.problem.size]

    def time(self, i: int) -> np.ndarray:
        """The time of flight i, (2^d,)."""
        return self.y[:, i * (self.problem.size + 1) + self.problem.size]

    def entries(self, i: int) -> np.ndarray:
        """The entries of the system, (2^d, E), at the parameters of node i."""
        return self._entries[i]

    @cached_property
    def _entries(self) -> list[np.ndarray]:
        found = []
        for i in range(self.problem.inner + 1):
            entries = constant(self.segment.released.entries, self.count).astype(self.y.dtype)
            entries[:, self.rows] = composed(self.tables, self.released(i))
            found.append(entries)
        return found

    def matrices(self, i: int) -> list[np.ndarray]:
        """M, C and K at the parameters of node i, (2^d, n, n)."""
        layout, entries = self.problem.parametric.layout, self.entries(i)
        shape = self.count, self.n, self.n
        return [entries[:, part].reshape(shape) for part in (layout.mass, layout.damping, layout.stiffness)]

    def motion(self, i: int, flight: int) -> Motion:
        """In the contact mode of a flight, at the parameters of node i."""
        mass, damping, stiffness = self.matrices(i)
        state = np.concatenate([stiffness, damping], axis=2)
        flexible = inverse(mass)
        rows, weight = self.problem.contact_modes.sticking(flight)
        project = constant(np.eye(self.n), self.count)
        if not len(rows):
            return Motion(project, flexible, np.zeros((self.count, 0, self.n)), state)
        along = flexible @ rows.T
        compliance = inverse(rows @ along)
        project = project - product(along, compliance, np.matmul) @ rows
        reach = weight[:, None] * product(compliance, np.swapaxes(along, 1, 2), np.matmul)
        return Motion(project, product(project, flexible, np.matmul), reach, state)

    def loads(self, i: int) -> np.ndarray:
        """Amplitudes of the loads, (2^d, n, q), in the order of `phases`."""
        layout, entries = self.problem.parametric.layout, self.entries(i)
        columns = []
        for h, k in enumerate(self.segment.flight.loads.harmonics):
            if k == 0.0:
                columns.append(entries[:, layout.constant])
                continue
            first = (h - self.constants) * self.n
            for part in (layout.cosine, layout.sine):
                columns.append(entries[:, part.start + first : part.start + first + self.n])
        return np.stack(columns, axis=2) if columns else np.zeros((self.count, self.n, 0))

    @property
    def constants(self) -> int:
        """1 if there is a constant load."""
        harmonics = self.segment.flight.loads.harmonics
        return int(len(harmonics) > 0 and harmonics[0] == 0.0)

    def phases(self, i: int) -> np.ndarray:
        """1 for a constant load, then cos and sin of the phase of each harmonic at node i, (2^d, q)."""
        s = self.node(i)[:, 2 * self.n]
        found = [constant(1.0, self.count)] * self.constants
        # The time of a node is an unknown: it has no products of infinitesimals.
        bits = [[b for b in range(self.order) if whole >> b & 1] for whole in range(self.count)]
        degrees = np.array([len(one) for one in bits])
        moved = np.array([math.prod(s[1 << b] for b in one) for one in bits])
        for k in self.segment.flight.loads.harmonics[self.constants :]:
            rate = 2.0 * math.pi * self.segment.flight.loads.load_periods * k
            for shift in (0.0, -0.5 * math.pi):
                found.append(np.cos(rate * s[0].real + shift + 0.5 * math.pi * degrees) * rate**degrees * moved)
        return np.stack(found, axis=1) if found else np.zeros((self.count, 0))

    def turning(self, i: int) -> np.ndarray:
        """The matrix of their rates, (2^d, q, q)."""
        harmonics, frequency = self.segment.flight.loads.harmonics[self.constants :], self.entries(i)[:, self.segment.released.frequency]
        size = self.constants + 2 * len(harmonics)
        found = np.zeros((self.count, size, size), dtype=self.y.dtype)
        for h, k in enumerate(harmonics):
            at = self.constants + 2 * h
            found[:, at, at + 1], found[:, at + 1, at] = -k * frequency, k * frequency
        return found

    # -- flights and impacts --------------------------------------------------------------------------------------------------

    def flight(self, i: int) -> np.ndarray:
        """The state at the end of flight i, before the impact, (2^d, 2 n)."""
        n, motion, loads = self.n, self.motion(i, i), self.loads(i)
        if self.smooth is not None:
            return self.smooth_flight(i, self.smooth)
        q = loads.shape[2]
        rates = np.zeros((self.count, 2 * n + q, 2 * n + q), dtype=self.y.dtype)
        rates[:, :n, n : 2 * n] = motion.project
        rates[:, n : 2 * n, : 2 * n] = -product(motion.inverse, motion.state, np.matmul)
        rates[:, n : 2 * n, 2 * n :] = product(motion.inverse, loads, np.matmul)
        rates[:, 2 * n :, 2 * n :] = self.turning(i)
        start = self.node(i)[:, : 2 * n].copy()
        start[:, n:] = product(motion.project, start[:, n:], np.matmul)
        whole = np.concatenate([start, self.phases(i)], axis=1)
        turn = exponential(rates, self.time(i))
        return product(turn, whole, np.matmul)[:, : 2 * n]

    def smooth_flight(self, i: int, smooth: SmoothExpansion) -> np.ndarray:
        """The same with smooth forces."""
        from bvp.smooth_expansion import Terms

        mass, damping, stiffness = self.matrices(i)
        terms = Terms(inverse(mass), damping, stiffness, self.loads(i), self.turning(i))
        return smooth.flight(self.node(i)[:, : 2 * self.n], self.phases(i), self.time(i), self.released(i), terms)

    def released(self, i: int) -> np.ndarray:
        """The released parameters of node i, (2^d, m)."""
        found = self.node(i)[:, 2 * self.n + 1 :].copy()
        found[0] = self.node(0)[0, 2 * self.n + 1 :]
        return found

    def impact(self, row: int, i: int, x: np.ndarray) -> np.ndarray:
        """The state x after the impact of a row of nodes, at the parameters of node i."""
        contact = self.segment.contact[row]
        if contact[0] < 0 or self.problem.contacts[row] < 0:
            return x
        n, gap = self.n, self.segment.gap[row, : self.n]
        motion = self.motion(i, min(row, self.problem.inner))
        along = motion.inverse @ gap
        push = product(along, inverse((along @ gap)[:, None, None])[:, 0])
        jump = constant(1.0, self.count).astype(self.y.dtype)
        if contact[1] >= 0:
            jump = jump + self.entries(i)[:, contact[1]]
        found = x.copy()
        found[:, n:] -= product(push, product(jump, x[:, n:] @ gap)[:, None])
        return found

    def gap(self, row: int, i: int, u: np.ndarray) -> np.ndarray:
        """The equation that a displacement u lies on the stop of a row, at the parameters of node i."""
        found: np.ndarray = u @ self.segment.gap[row, : self.n] - self.entries(i)[:, self.segment.contact[row, 0]]
        return found

    def release(self, i: int) -> np.ndarray:
        """The contact force at the end of flight i, equation (43), from the node after it."""
        motion, place = self.motion(i + 1, i), self.problem.contact_modes.opening(i)
        assert place is not None
        reach = motion.reach[:, place : place + 1]
        acceleration = product(self.loads(i + 1), self.phases(i + 1), np.matmul)
        acceleration = acceleration - product(motion.state, self.node(i + 1)[:, : 2 * self.n], np.matmul)
        return product(reach, acceleration, np.matmul)[:, 0]

    # -- equations ------------------------------------------------------------------------------------------------------------

    def residual(self) -> np.ndarray:
        """See `expanded`."""
        problem, n = self.problem, self.n
        found = np.zeros((self.count, problem.unknowns - 1), dtype=self.y.dtype)
        loads = self.segment.flight.loads
        for i in range(problem.inner + 1):
            row = i * (problem.size + 1)
            after = self.node(i).copy()
            after[:, : 2 * n] = self.impact(i, i, self.flight(i))
            passed = product(self.time(i), self.entries(i)[:, self.segment.released.frequency])
            after[:, 2 * n] += passed / (2.0 * math.pi * loads.load_periods)
            if i < problem.inner:
                found[:, row : row + problem.size] = after - self.node(i + 1)
                at = row + problem.size
                if problem.contact_modes.opening(i) is not None:
                    found[:, at] = self.release(i)
                elif problem.contacts[i] < 0:  # a cut
                    found[:, at] = self.time(i) - self.time(i + 1)
                else:
                    found[:, at] = self.gap(i, i + 1, self.node(i + 1)[:, :n])
            elif self.segment.shape[3] != PERIODIC:
                self.ends(after[:, : 2 * n], found[:, row:])
            else:
                self.closure(after[:, : 2 * n + 1], found[:, row:])
        return found

    def closure(self, after: np.ndarray, found: np.ndarray) -> None:
        """The orbit closes."""
        size, start, closing = 2 * self.n, self.node(0), self.segment.closing
        found[:, :size] = after[:, :size] - closing[0] * start[:, :size]
        found[:, size] = after[:, size] - start[:, size] - constant(closing[1], self.count)
        if closing[1] == 0.0:
            found[:, size] = start[:, size]
        found[:, size + 1] = start[:, size]
        last = self.problem.inner
        if self.segment.contact[last, 0] >= 0:
            found[:, size + 1] = self.gap(last, 0, closing[0] * start[:, : self.n])
        if self.segment.shape[1] == UNFOLDED:
            first = 0 if self.smooth is None else self.n
            found[:, first:size] += product(self.y[:, -1:], self.energy_gradient()[:, first:])
        self.kept(found[:, size + 2 :])

    def ends(self, after: np.ndarray, found: np.ndarray) -> None:
        """The conditions of a start and of an end that reverse the motion."""
        n, last, rows = self.n, self.problem.inner, self.segment.end_map
        start = self.impact(last + 1, 0, self.node(0)[:, : 2 * n])
        for first, row, i, x in ((n, last, last, after), (0, last + 1, 0, start)):
            found[:, first : first + n] = x @ rows[first : first + n].T
            if self.segment.shape[4 if first else 3] == STOP:
                found[:, first] = self.gap(row, i, x[:, :n])
        found[:, 2 * n] = self.node(0)[:, 2 * n]
        self.kept(found[:, 2 * n + 1 :])

    def energy_gradient(self) -> np.ndarray:
        """The derivative of the energy by the start without smooth forces, (2^d, 2 n)."""
        n, (mass, _, stiffness) = self.n, self.matrices(0)
        x = self.node(0)
        return np.concatenate([product(stiffness, x[:, :n], np.matmul), product(mass, x[:, n : 2 * n], np.matmul)], axis=1)

    def energy(self) -> np.ndarray:
        """The energy of the start, (2^d,)."""
        n, (mass, _, stiffness), x = self.n, self.matrices(0), self.node(0)
        u, v = x[:, :n], x[:, n : 2 * n]
        total: np.ndarray = 0.5 * (product(u, product(stiffness, u, np.matmul), np.dot) + product(v, product(mass, v, np.matmul), np.dot))
        return total if self.smooth is None else total + self.smooth.energy(u, self.released(0))

    def kept(self, found: np.ndarray) -> None:
        """The equations of the user."""
        problem = self.problem
        if not problem.keep:
            return
        moved = [self.node(0)[:, 2 * self.n + 1 :]]
        values = self.values
        if problem.conserved:
            energy = self.energy()
            quarter = sum(self.time(i) for i in range(problem.inner + 1)) / self.segment.shape[2]
            values = np.array([*values, energy[0].real, quarter[0].real])
            moved += [energy[:, None], quarter[:, None]]
        found[:] = composed(problem.curvature.kept_tables(values, self.order), np.concatenate(moved, axis=1))
