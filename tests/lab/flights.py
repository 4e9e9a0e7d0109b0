"""Flights: from a state and a time to the end, its derivatives and its rate."""

from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import saltus_core as core

from bvp import smooth_flights
from bvp.kernels import flight as linear
from bvp.kernels.taylor import ROUNDING, make_smooth_flight
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


class Loads(NamedTuple):
    """Loads in modal coordinates, and their derivatives by m parameters.

    harmonics (H,), clock (1 + m,), load_periods : as in `LoadedFlight`
    modal (1 + m, H, 2, N) : cosine and sine of each harmonic
    """

    harmonics: np.ndarray
    modal: np.ndarray
    clock: np.ndarray
    load_periods: float


class LoadedFlight:
    """The flights of a system under periodic loads, from nodes (u, v, fraction of the period, parameters).

    harmonics (H,), cosine and sine (H, n) : forces of each harmonic
    clock (1 + m,) : base frequency, and its derivatives by the parameters
    load_periods : periods of the base frequency in one of the orbit
    cosine_slope, sine_slope (m, H, n) : derivatives of the forces by the parameters
    """

    def __init__(self, system, harmonics, cosine, sine, clock, load_periods, cosine_slope=None, sine_slope=None, one_block=False):
        modes, n, m = system.modes, system.degrees_of_freedom, len(clock) - 1
        zero = np.zeros((m, len(harmonics), n))
        parts = [
            np.concatenate([[part], zero if slope is None else slope]) for part, slope in ((cosine, cosine_slope), (sine, sine_slope))
        ]
        drive = modes.from_state[:, n:] @ np.linalg.inv(system.mass)
        self._forces = np.stack(parts, axis=2).reshape(-1, n)
        self.loads = Loads(np.array(harmonics, float), np.stack(parts, axis=2) @ drive.T, np.array(clock, float), float(load_periods))
        self.to_state = np.ascontiguousarray(modes.to_state)
        self._flight = core.LoadedFlight(
            LinearFlight(system, one_block).core, np.ascontiguousarray(modes.from_state), self.to_state, drive, self.loads.harmonics
        )

    def end(self, node, t):
        """Return the node at the end (N,), its derivatives by the first one (N, N), and its rate (N,).

        The core's flights know the time by their oscillators.
        """
        loads, node = self.loads, np.array(node, float)
        size = len(self.to_state)
        w, turn = loads.clock[0], 2.0 * np.pi * loads.load_periods
        clock = node[size], node[size] + t * w / turn

        def oscillators(fraction):
            angle = loads.harmonics * turn * fraction
            return np.stack([np.cos(angle), np.sin(angle)], axis=1).ravel()

        longer = -t * loads.clock[1:] / w  # while the oscillators stay
        state, by_state, columns = self._flight.end(
            node[:size].copy(), float(t), *map(oscillators, clock), loads.clock, np.ascontiguousarray(self._forces), longer
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
    return make_smooth_flight(system.modes.matrix, inputs, push, forces.program(), forces.energy_program(), flights)


class SmoothEnd(NamedTuple):
    """The end of a flight with smooth forces.

    state (N,), derivatives (N, N) : at the end, and by the state at the begin (of no use without columns)
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
    """

    def __init__(self, matrix, rows, push, program, potential):
        self.matrix, self.rows, self.push = (np.array(part, float) for part in (matrix, rows, push))
        self._core = core_arrays(self.matrix, self.rows, self.push, np.ones(len(self.matrix)), program, potential)

    @classmethod
    def of(cls, system):
        """The flights of a system with smooth forces, in the modal coordinates of its linear part."""
        flight = cls.__new__(cls)
        flight.matrix, (flight.rows, flight.push) = system.modes.matrix, modal_rows(system)
        flight._core = core_flight(system)
        return flight

    def end(self, z, t, derivatives=True):
        """Return the `SmoothEnd` of a flight, or None where it cannot be computed. t < 0: back in time."""
        path = self._core.path(np.array(z, float), float(t), derivatives)
        return SmoothEnd(path.end, path.map, path.times, path.coefficients) if path.complete else None

    @property
    def why_not(self):
        """Why the last flight could not be computed; empty where it could."""
        return why_not_flown(self._core)


def limit_steps(monkeypatch, steps):
    """Let flights of conservative systems with smooth forces have at most so many steps."""
    monkeypatch.setattr(smooth_flights, "core_arrays", partial(core_arrays, most_steps=steps))
