"""Flights: from a state and a time to the end, its derivatives and its rate."""

from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import saltus_core as core

from bvp import smooth_flights
from bvp.kernels import flight as linear
from bvp.kernels.forced import fly_loaded
from bvp.kernels.loads import LoadedFlight as _LoadedArrays
from bvp.kernels.loads import Loads
from bvp.kernels.sources import make_load_sources
from bvp.kernels.taylor import ROUNDING, fly_smooth, make_smooth_flight
from bvp.smooth_flights import core_arrays, core_flight, modal_rows, why_not_flown

__all__ = ["LinearFlight", "LoadedFlight", "Loads", "ROUNDING", "SmoothEnd", "SmoothFlight", "circular", "limit_steps", "smooth_flight"]


def circular(delta, t):
    """Return C and S of a block with discriminant delta: cosh and sinh of sqrt(delta) t, the second one over sqrt(delta)."""
    return linear.circular(delta, t)


class LinearFlight:
    """The flights z' = B z of a system, in its modal coordinates.

    one_block : bool
        Whether all modes are one block, as where B cannot be cut.
    """

    def __init__(self, system, one_block=False):
        self.blocks = system.modes.flight
        if one_block:
            self.blocks = self._joined(self.blocks.matrix, [(0, len(self.blocks.matrix))])

    @classmethod
    def of_blocks(cls, matrix, blocks):
        """The flights of a block-diagonal matrix, given the first row and the size of each block: 1, or above 2."""
        flight = cls.__new__(cls)
        flight.blocks = cls._joined(np.array(matrix, float), blocks)
        return flight

    @staticmethod
    def _joined(matrix, blocks):
        mean = np.array([np.trace(matrix[k : k + size, k : k + size]) / size for k, size in blocks])
        return linear.Flight(np.array([[k, -size] for k, size in blocks]), mean, np.zeros(len(blocks)), matrix)

    @cached_property
    def core(self):
        """The same flights as the core has them."""
        return core.LinearFlight(*self.blocks, np.ones(len(self.blocks.matrix)))

    def end(self, z, t):
        """Return exp(B t) z."""
        return self.core.end(z, float(t))

    def map(self, t):
        """Return exp(B t)."""
        return self.core.map(float(t))

    def rate(self, z):
        """Return B z."""
        return self.core.rate(z)

    def amplitudes(self, row, z, horizon):
        """Return bounds of |w|, |w''| and |w'''| of w = row . exp(B t) z for 0 <= t <= horizon."""
        return self.core.bounds(row, z, horizon)

    @property
    def fastest_rate(self):
        """A bound of the rates of all blocks."""
        return self.core.fastest


class LoadedFlight:
    """The flights of a system under periodic loads, from nodes (u, v, fraction of the period, parameters).

    harmonics (H,), cosine and sine (H, n) : forces of each harmonic
    clock (1 + m,) : base frequency, and its derivatives by the parameters
    load_periods : periods of the base frequency in one of the orbit
    cosine_slope, sine_slope (m, H, n) : derivatives of the forces by the parameters
    """

    def __init__(self, system, harmonics, cosine, sine, clock, load_periods, cosine_slope=None, sine_slope=None, one_block=False):
        modes, n, m = system.modes, system.degrees_of_freedom, len(clock) - 1
        size, zero = 2 * n, np.zeros((m, len(harmonics), n))
        parts = [
            np.concatenate([[part], zero if slope is None else slope]) for part, slope in ((cosine, cosine_slope), (sine, sine_slope))
        ]
        self.drive = modes.from_state[:, n:] @ np.linalg.inv(system.mass)
        self.forces = np.stack(parts, axis=2).reshape(-1, n)
        modal = np.stack(parts, axis=2) @ self.drive.T
        self.loads = Loads(np.array(harmonics, float), modal, np.array(clock, float), float(load_periods))
        self.to_state = np.ascontiguousarray(modes.to_state)
        self._arrays = _LoadedArrays(
            LinearFlight(system, one_block).blocks, np.ascontiguousarray(modes.from_state), self.to_state, self.loads,
            np.zeros((0, size, size)), np.zeros((4, size, size)), np.zeros((8, size)), np.zeros((size, size)), np.zeros((max(m, 1), size)),
        )  # fmt: skip

    def end(self, node, t):
        """Return the node at the end (N,), its derivatives by the first one (N, N), and its rate (N,)."""
        node = np.array(node, float)
        out, derivatives, rate = np.empty(len(node)), np.empty((len(node), len(node))), np.empty(len(node))
        fly_loaded(self._arrays, node, float(t), out, derivatives, rate)
        return out, derivatives, rate

    def core_end(self, node, t):
        """The same by the core, of which the flights know the time by their oscillators."""
        arrays, loads = self._arrays, self.loads
        size = len(self.to_state)
        w, turn = loads.clock[0], 2.0 * np.pi * loads.load_periods
        clock = node[size], node[size] + t * w / turn

        def oscillators(fraction):
            angle = loads.harmonics * turn * fraction
            return np.stack([np.cos(angle), np.sin(angle)], axis=1).ravel()

        flight = core.LoadedFlight(
            core.LinearFlight(*arrays.free, np.ones(size)), arrays.enter, self.to_state, self.drive, np.array(loads.harmonics, float)
        )
        longer = -t * loads.clock[1:] / w  # while the oscillators stay
        state, by_state, columns = flight.end(
            np.array(node[:size]), float(t), *map(oscillators, clock), loads.clock, np.ascontiguousarray(self.forces), longer
        )
        out = np.array([*state, clock[1], *node[size + 1 :]])
        derivatives, rate = np.eye(len(out)), np.zeros(len(out))
        derivatives[:size, :size] = by_state
        derivatives[:size, size] = (columns[0] + columns[1]) * turn / w
        derivatives[:size, size + 1 :] = (columns[2:] - longer[:, None] * columns[1]).T
        derivatives[size, size + 1 :] = t * loads.clock[1:] / turn
        rate[:size], rate[size] = columns[1], w / turn
        return out, derivatives, rate


def smooth_flight(system, flights):
    """Return the flights of a conservative system with smooth forces as the kernels take them, with room for the paths of so many."""
    forces, (inputs, push) = system.smooth_forces, modal_rows(system)
    flight = make_smooth_flight(system.modes.matrix, inputs, push, forces.program(), forces.energy_program(), flights)
    if not forces.is_called:
        return flight
    from bvp.kernels.collocation import collocated

    return collocated(flight)


class SmoothEnd(NamedTuple):
    """The end of a flight with smooth forces.

    state (N,), derivatives (N, C) : at the end, and by the state at the begin and what the loads depend on (of no use without columns)
    times (S + 1,), coefficients (S, order + 1, N) : of the steps
    """

    state: np.ndarray
    derivatives: np.ndarray
    times: np.ndarray
    coefficients: np.ndarray

    @property
    def steps(self):
        """Number of steps."""
        return len(self.coefficients)


class SmoothFlight:
    """Flights with smooth forces f: z = (u, v), v' = A z + P f(rows z).

    matrix (2 n, 2 n) : of the linear part of z'
    rows (I, 2 n), push (n, F) : the inputs of the forces, and the accelerations of unit forces
    program, potential : the forces' jets (`bvp.jet_programs.jet_program`), and the program of their energy
    loads : `Loads`, optional
    """

    def __init__(self, matrix, rows, push, program, potential, loads=None):
        matrix, rows, push = (np.array(part, float) for part in (matrix, rows, push))
        size = len(matrix)
        sources = (make_load_sources(loads, np.zeros((0, size, size)), np.zeros((0, *push.shape))),) if loads is not None else ()
        self._arrays = make_smooth_flight(matrix, rows, push, program, potential, 1, *sources)
        self._core = core_arrays(matrix, rows, push, np.ones(size), program, potential) if loads is None else None

    @classmethod
    def of(cls, system):
        """The flights of a system with smooth forces, in the modal coordinates of its linear part."""
        flight = cls.__new__(cls)
        flight._arrays = smooth_flight(system, 1)
        flight._core = core_flight(system)
        return flight

    @property
    def matrix(self):
        return self._arrays.matrix

    @property
    def rows(self):
        return self._arrays.rows

    @property
    def push(self):
        return self._arrays.push

    @property
    def is_collocated(self):
        """Whether its steps are by collocation, as for a force that has no Taylor series."""
        return bool(self._arrays.stages.address)

    def end(self, z, t, derivatives=True):
        """Return the `SmoothEnd` of a flight, or None where it cannot be computed. t < 0: back in time."""
        if self._core is not None:
            path = self._core.path(np.array(z, float), float(t), derivatives)
            return SmoothEnd(path.end, path.map, path.times, path.coefficients) if path.complete else None
        paths = self._arrays.paths
        if not fly_smooth(self._arrays, 0, np.array(z, float), float(t), derivatives):
            return None
        count = int(paths.steps[0, 0])
        return SmoothEnd(
            paths.ends[0].copy(), paths.maps[0].copy(), paths.times[0, : count + 1].copy(), paths.coefficients[0, :count].copy()
        )

    @property
    def why_not(self):
        """Why the last flight could not be computed; empty where it could."""
        return why_not_flown(self._arrays if self._core is None else self._core)

    def forget_derivatives(self):
        """Replace what the last flight left by NaN."""
        self._arrays.paths.maps[:] = np.nan


def limit_steps(monkeypatch, steps):
    """Let flights of conservative systems with smooth forces have at most so many steps."""
    monkeypatch.setattr(smooth_flights, "core_arrays", partial(core_arrays, most_steps=steps))
