"""The multipoint problem of a free orbit in released parameters: the closures of conservative systems, whose parameters can change.

The states of `ReleasedProblem` are physical ones. At each orbit it gives the `MultipointProblem` of the system there, from which follow
multipliers, labels and the test functions of events.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.closures import ORIGIN, REST, Cycle, EndsError, cycle_of, parse_end
from bvp.contact_sequence import ContactEvent
from bvp.description import RESERVED
from bvp.forced import ForcedProblem
from bvp.multipliers import floquet_multipliers, sort_multipliers
from bvp.multipoint import MOST_PIECES, MultipointProblem, Solution
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from bvp.smooth_cycles import nearest_maximum, nearest_rise, states_at
from bvp.stability import half_map_multipliers

__all__ = ["ReleasedProblem"]

GRAZING = 1e-11
"""Impact speed, over the largest velocity, below which an impact grazes."""

SLACK = 1e-9
"""How far beyond its domain a parameter counts as at the end of it, in units of its default."""


class ReleasedProblem(ForcedProblem):
    """Orbits of a conservative system between two ends, or closed on themselves, in m released parameters.

    Parameters
    ----------
    parametric : ParametricSystem
        Without loads. No released parameter damps it or lowers a restitution.
    ends : (str, str)
    sequence : sequence of str
        As for `MultipointProblem`.
    released : sequence of m str
        Names of the parameters that vary along the family. The first one is reported.
    keep : sequence of m str
        Equations that hold along the family, of parameters, ``energy`` and ``quarter_period``: "energy = 0.8".
    values : mapping, optional
        Values of the parameters that replace the defaults.
    energy : float
        A typical energy: it is the unit of arclength for states.
    pieces : int
        As for `MultipointProblem`.

    Raises
    ------
    EndsError
        For ends that the system does not have, or has not for other values of the released parameters; for a system that loses energy.
    ValueError
        For parameters that the system lacks, and another number of equations.

    Notes
    -----
    The unknowns are y = (t_0, z_0, t_1, z_1, ..., t_k, z_k [, xi], parameters) of states z = (u, v), equation (41). A periodic orbit has
    the unfolding parameter xi, which is zero on every solution. Without impacts it starts where the sum of the modal displacements
    rises through zero, with the modes at `values`: at a maximum all velocities can be zero, and then a kick along them is nothing.
    """

    conserved = RESERVED

    def __init__(
        self,
        parametric: ParametricSystem,
        ends: tuple[str, str],
        sequence: Sequence[str],
        released: Sequence[str],
        keep: Sequence[str],
        *,
        values: Mapping[str, float] | None = None,
        energy: float = 0.5,
        pieces: int = 1,
    ):
        self.ends: tuple[str, str] = str(ends[0]), str(ends[1])
        self.energy = energy
        system = parametric.system_along(parametric.at(values), released)
        # What the ends need is refused by the problem of the system.
        self.structure = MultipointProblem(system, self.ends, sequence, pieces)
        self.kinds, self.periodic = self.structure.kinds, self.structure.periodic
        super().__init__(parametric, sequence, released, keep=keep, values=values, pieces=pieces)
        if not self.structure.periodic:
            self.entries_of_nodes[self.inner :, 1] = -1
        self.starts_rising = self.structure.periodic and not self.sequence
        if self.starts_rising:
            # In place of a gap; the place of its bound is that of the base frequency, which is 0.
            row = self.modes.from_state[: self.degrees_of_freedom, : self.degrees_of_freedom].sum(axis=0)
            self.gap[self.inner, : len(row)] = row / np.linalg.norm(row)
            self.entries_of_nodes[self.inner] = self.parametric.layout.frequency.start, -1

    def _require_determined(self) -> None:
        parametric, layout, released = self.parametric, self.parametric.layout, self.released
        slopes = parametric.derivatives(self.values, released)
        for j, name in enumerate(released):
            for part, what in ((layout.damping, "damps the system"), (layout.restitution, "changes a restitution")):
                if np.any(slopes[part, j]):
                    raise EndsError(f"{name} {what}: a family of free orbits needs a conservative system; expected another parameter")
            if ORIGIN in self.kinds and not self._stays_odd(name):
                raise EndsError(f"{name} breaks the odd symmetry that an origin end needs")
        if self.has_clock or np.any(parametric.entries(self.values)[layout.constant]):
            raise EndsError("a family of free orbits needs a system without loads")

    def sibling(self, sequence: Sequence[str], **changes: Any) -> ReleasedProblem:
        """The problem with another sequence. changes: arguments of the constructor that differ."""
        own = {"ends": self.ends, "released": self.released, "keep": self.keep, "values": self.values, "energy": self.energy}
        own["pieces"] = self.pieces
        return ReleasedProblem(self.parametric, sequence=sequence, **{**own, **changes})

    def _events(self) -> tuple[ContactEvent, ...]:
        return ()

    def _contacts(self, hit: Sequence[int]) -> list[int]:
        return [int(contact) for contact in self.structure.contacts]

    def _closure(self) -> tuple[bool, int, int, int]:
        return self.structure.periodic, self.structure.quarters, *self.structure.kinds

    def _end_rows(self) -> np.ndarray:
        n = self.degrees_of_freedom
        rows = np.zeros((0 if self.structure.periodic else 2 * n, 2 * n))
        for k, (kind, end) in enumerate(zip(self.structure.kinds, self.ends, strict=True) if len(rows) else ()):
            part = rows[k * n : (k + 1) * n]
            if kind == ORIGIN:
                part[:, :n] = np.eye(n)
            elif kind == REST:
                part[:, n:] = np.eye(n)
            else:
                gap = np.asarray(self.system.stops[self.modes.contact_stop[parse_end(self.system, end)[1]]].gap)
                part[0, :n] = gap
                part[1:, n:] = np.linalg.qr(np.column_stack([gap, np.eye(n)]))[0][:, 1:].T
        return rows

    def as_it_is(self, y: np.ndarray) -> Solution:
        found = super().as_it_is(y)
        found.result[RESULT_INDEX["quarter_period"]] = self.period(y) / 4.0
        return found

    def rise(self, y: np.ndarray) -> float:
        """The rate of the sum that is zero at the start of a closed orbit without impacts: the orbit starts there while it is above 0."""
        n = self.degrees_of_freedom
        return float(self.gap[self.inner, :n] @ self.states(y)[0, n:])

    def known_values(self, y: np.ndarray) -> dict[str, float]:
        """The values of all parameters, the energy and the quarter period at y."""
        problem, at = self.orbit_problem(y)
        return self.parameters(y) | {"energy": problem.energy(at), "quarter_period": problem.quarter_period(at)}

    def multipliers(self, y: np.ndarray) -> np.ndarray:
        """All 2 n multipliers of the full period of an orbit y, by modulus descending: two are 1. NaN where an impact grazes."""
        found = self._multipliers_of_system(y)
        return sort_multipliers(np.concatenate([found, np.ones(2 * self.degrees_of_freedom - len(found))]))

    def _multipliers_of_system(self, y: np.ndarray) -> np.ndarray:
        """The multipliers but trivial ones, by the problem of the system there."""
        problem, at = self.orbit_problem(y)
        cycle = cycle_of(problem, at)
        if np.min(np.abs(cycle.speeds), initial=math.inf) < GRAZING * math.sqrt(2.0 * abs(problem.energy(at))):
            return np.full(2 * self.degrees_of_freedom, complex(math.nan, math.nan))
        if problem.is_smooth and not problem.periodic:
            return half_map_multipliers(problem, problem.orbit_at(at))[0] if problem.pairs else np.zeros(0)
        return floquet_multipliers(cycle).values

    def period(self, y: np.ndarray) -> float:
        """T."""
        return float(np.sum(self.flight_times(y))) * 4.0 / self.quarters

    def of_orbit(self, problem: MultipointProblem, y: np.ndarray) -> np.ndarray:
        """The unknowns (u,) of an orbit, a solution y of the problem of the system at these values of the parameters."""
        begin = nearest_rise(cycle_of(problem, y)) if self.starts_rising else 0.0
        return self._unknowns_of(problem, y, begin, [self.values[name] for name in self.released])

    def _unknowns_of(self, problem: MultipointProblem, y: np.ndarray, begin: float, parameters: Sequence[float]) -> np.ndarray:
        """The unknowns of an orbit of the system at values of the released parameters. begin: where a closed one without impacts starts."""
        own = MultipointProblem(problem.system, self.ends, self.sequence, self.pieces)
        if self.starts_rising:
            cycle = cycle_of(problem, y)
            states, times = _begun_at(cycle, begin, self.pieces), np.full(self.pieces, cycle.period / self.pieces)
        else:
            at = problem.in_pieces_of(own, y)
            states, times = np.vstack([own.start(at), own.nodes(at)]), own.flight_times(at)
        return self.pack(states @ own.modes.to_state.T, np.zeros(len(states)), parameters, times)

    def changed(self, y: np.ndarray, change: Callable[[MultipointProblem, np.ndarray], np.ndarray | None]) -> np.ndarray | None:
        """The unknowns of the orbit that a function of problem and unknowns makes of the orbit y of its system; None where that is None. A
        closed orbit has an impact. Where the parameters leave their domain there is no system, and so no image."""
        try:
            problem, at = self._plain(y)
        except (InvalidSystem, EndsError):
            return None
        found = change(problem, at)
        return None if found is None else self._unknowns_of(problem, found, 0.0, self.released_values(y).tolist())

    def in_pieces(self, pieces: int, y: np.ndarray) -> tuple[ReleasedProblem, np.ndarray]:
        """The problem with another number of pieces, and the unknowns y (u,) there."""
        if pieces == self.pieces:
            return self, np.array(y, float)
        other, (plain, at) = self.sibling(self.sequence, pieces=pieces), self._plain(y)
        return other, other._unknowns_of(plain, at, 0.0, self.released_values(y).tolist())

    most_pieces = MOST_PIECES

    @property
    def can_be_cut(self) -> bool:
        """See `ForcedProblem.can_be_cut`."""
        return self.is_smooth

    def orbit_problem(self, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray]:
        """The problem of the system at the parameters of y, with the orbit in its unknowns.

        Raises
        ------
        InvalidSystem, EndsError
            For parameters that the system, or an orbit with these ends, cannot have.
        """
        problem, at = self._plain(y)
        if self.starts_rising:
            cycle = cycle_of(problem, at)
            begun = _begun_at(cycle, nearest_maximum(cycle), self.pieces)
            at = problem.pack(begun[0], begun[1:], self.flight_times(y))
        return problem, at

    def _plain(self, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray]:
        """The same from the start that it has here."""
        values = self.parameters(y)
        for name in self.released:
            # An end is located to rounding.
            low, high = self.parametric.domain(name)
            slack = SLACK * (abs(self.parametric.values[name]) or 1.0)
            values[name] = low if low - slack < values[name] < low else high if high < values[name] < high + slack else values[name]
        forces = self.smooth_forces
        if forces is not None:
            forces = None if forces.is_called else forces.at([values[name] for name in self.released])
        problem = MultipointProblem(self.parametric.system(values, forces), self.ends, self.sequence, self.pieces)
        states = self.states(y) @ problem.modes.from_state.T
        return problem, problem.pack(states[0], states[1:], self.flight_times(y))


def _begun_at(cycle: Cycle, time: float, pieces: int) -> np.ndarray:
    """The states (k, N) of a closed orbit at an instant, and at the cuts that follow."""
    return states_at(cycle, (time + cycle.period * np.arange(pieces) / pieces) % cycle.period)
