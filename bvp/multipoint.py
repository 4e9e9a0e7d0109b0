"""The multipoint boundary-value problem of an impacting orbit between two ends, or closed on itself.

`MultipointProblem` binds a system, two ends and an impact sequence to the compiled core: residual and Jacobian, Newton's
solution at a given energy or quarter period, and the step along the family with everything that is known of the point where it lands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bvp.closures import ORIGIN, PERIODIC, EndsError, contact_of, deflated_motions, end_maps, free_translation, held_motions, parse_end
from bvp.dense import product
from bvp.kernels.extrema import Observed
from bvp.orbits import DIVERGED, GROWN, RESULT_INDEX, ROUNDS, SOLVED, UNSETTLED, Orbits, Solution
from bvp.smooth_flights import modal_energies
from bvp.system import ImpactSystem

__all__ = [
    "RESULT_INDEX", "EndsError", "MultipointProblem", "NotConverged", "Solution", "enough_pieces", "lost_digits", "observed_of",
]  # fmt: skip

GROWTH = 1e4
"""Growth of perturbations along a flight beyond which it is solved in pieces: it leaves 12 digits of the end."""

MOST_PIECES = 32
"""Most pieces of a flight. Near a saddle of the potential, where it falls off, perturbations grow without bound along a family."""

LARGEST = 700.0
"""Largest exponent of a growth that is a number."""


class NotConverged(RuntimeError):
    """Newton's corrections did not reach a solution; the message says how far they came."""


class MultipointProblem:
    """Orbits of a conservative system between two ends, or closed on themselves, with a given impact sequence.

    Parameters
    ----------
    system : ImpactSystem
        Undamped and elastic.
    ends : (str, str)
        Each "origin", "rest", "stop+", "stop-" ("stopa+" with several stops); or ("periodic", "periodic").
    sequence : sequence of str
        Contact letters of the inner impacts in order of time, e.g. ("+", "-"). For periodic orbits it is that of the full period, and its
        first impact is the start. A smooth periodic orbit without impacts starts where the sum of its modal displacements is largest.
    pieces : int
        Number of pieces of equal time in which each flight is solved; 1 for linear flights. More pieces keep the digits of flights along
        which perturbations grow.

    Raises
    ------
    EndsError
        For ends that the system does not have: `origin` without odd symmetry, an unknown stop, a system that loses energy.

    Attributes
    ----------
    hit : frozenset of int
        The stops that its orbits hit.
    held, free : (m + 1, n), (n - m - 1, n) float
        See `bvp.closures.held_motions` and `deflated_motions`.
    pairs : int
        m, the number of pairs of nontrivial multipliers.
    coordinates : int
        N + 2, those in which arclength is measured.
    drifts : bool
        Whether there is a motion that no spring and no stop that is hit resists.
    is_smooth : bool
        Whether the system has smooth forces.

    Notes
    -----
    The unknowns are y = (s, t_0, z_1, t_1, ..., z_k, t_k [, xi]), equation (30); N = 2 n modal coordinates a state.
    """

    def __init__(self, system: ImpactSystem, ends: tuple[str, str], sequence: Sequence[str], pieces: int = 1):
        if not system.is_conservative:
            raise EndsError(f"families of periodic orbits need a conservative system: {system.why_not_conservative()}")
        self.system = system
        self.ends = (str(ends[0]), str(ends[1]))
        self.sequence = tuple(sequence)
        self.modes = modes = system.modes
        self.size = size = 2 * system.degrees_of_freedom
        self.half = size // 2
        kinds = [parse_end(system, end) for end in self.ends]
        periodic = kinds[0][0] == PERIODIC
        if periodic != (kinds[1][0] == PERIODIC):
            raise EndsError(f"the ends {self.ends[0]}, {self.ends[1]} do not go together: a periodic orbit has two periodic ends")
        contacts = [contact_of(system, letter) for letter in self.sequence]
        self.is_smooth = system.smooth_forces is not None
        if periodic:
            if not contacts and not self.is_smooth:
                raise EndsError("periodic ends need at least one impact, where the orbit starts; received an empty sequence")
            closing = opening = contacts[0] if contacts else -1
            inner = contacts[1:]
        else:
            inner, closing, opening = contacts, kinds[1][1], kinds[0][1]
        self.pieces = pieces
        cuts = [-1] * (pieces - 1)
        inner = [node for impact in inner for node in (*cuts, impact)] + cuts
        self.inner = len(inner)
        self.periodic = periodic
        self.kinds = (kinds[0][0], kinds[1][0])
        self.quarters = 4 if periodic else 1 if (self.kinds[0] == ORIGIN) != (self.kinds[1] == ORIGIN) else 2
        self.contacts = np.array([*inner, closing, opening])

        self.start_map, self.start_offset = end_maps(modes, self.kinds[0], opening)[:2]
        self.end_map, self.end_offset = end_maps(modes, self.kinds[1], closing)[2:]
        self.parameters = self.start_map.shape[1]
        self.unknowns = self.parameters + 1 + self.inner * (size + 1) + int(periodic)
        self.tangent_size = (3 if self.is_smooth else 2) * self.unknowns
        self.coordinates = size + 2
        self.observed = observed_of(system)
        self._two_dof = self.half == 2

    @cached_property
    def orbits(self) -> Orbits:
        """What computes its orbits."""
        return Orbits(self)

    @property
    def core(self) -> Any:
        """The problem in the core."""
        return self.orbits.core

    hit = cached_property(lambda self: frozenset(self.modes.contact_stop[self.contacts[self.contacts >= 0]].tolist()))
    held = cached_property(lambda self: held_motions(self.system, self.hit))
    free = cached_property(lambda self: deflated_motions(self.system, self.hit))
    pairs = cached_property(lambda self: len(self.held) - 1)
    drifts = cached_property(lambda self: free_translation(self.system, self.hit) is not None)

    def __reduce__(self) -> tuple[Any, ...]:
        # The arrays that it works with follow from these, and are most of its size.
        return MultipointProblem, (self.system, self.ends, self.sequence, self.pieces)

    def refuse_drift(self) -> None:
        """Refuse ends that do not hold the place of a system that can drift: an orbit between them is not determined.

        Raises
        ------
        EndsError
            With the motion that nothing resists, and what holds it.
        """
        direction = None if ORIGIN in self.kinds else free_translation(self.system, self.hit)
        if direction is None:
            return
        moved = [f"{name} by {entry:.4g}" for name, entry in zip(self.system.coordinates, direction.tolist(), strict=True) if entry]
        instead = "an origin end, or a spring to the ground" if self.system.has_odd_symmetry else "a spring to the ground"
        raise EndsError(
            f"the ends {self.ends[0]}, {self.ends[1]} leave the system free to drift: no spring or stop that is hit resists a motion of "
            f"{', '.join(moved)}; expected {instead}"
        )

    # -- unknowns -------------------------------------------------------------------------------------------------------------

    def pack(self, start: ArrayLike, nodes: ArrayLike | None, flight_times: ArrayLike) -> np.ndarray:
        """Unknowns y (u,) from the start state (N,), the states after the inner impacts - None: by exact flight - and the flight times.

        With all nodes, the cuts of flights too, there are (k, N) states and (k + 1,) times."""
        start, times = np.array(start, float), np.array(flight_times, float)
        if len(times) != self.inner + 1:
            times = np.repeat(times / self.pieces, self.pieces)
        if nodes is None:
            nodes = self.orbits.nodes(start, times)
        elif self.pieces > 1:
            nodes = self._with_cuts(start, np.asarray(nodes, float), times)
        y = np.zeros(self.unknowns)
        y[: self.parameters] = product(self.start_map.T, start - self.start_offset)
        self.flight_times(y)[:] = times[: self.inner + 1]
        self.nodes(y)[:] = np.asarray(nodes, float)[: self.inner].reshape(self.inner, self.size)
        return y

    def _with_cuts(self, start: np.ndarray, impacts: np.ndarray, times: np.ndarray) -> np.ndarray:
        """All nodes (k, N), also from the states after the inner impacts alone: then the cuts are found by exact flight."""
        if len(impacts) == self.inner:
            return impacts
        nodes = np.empty((self.inner, self.size))
        # An orbit without impacts also ends at its start: on the way back from there perturbations have grown for half the time only.
        forwards = (self.inner + 1) // 2 if self.periodic and not self.sequence else self.inner
        for i in range(forwards):
            if (i + 1) % self.pieces:
                nodes[i] = self.orbits.path_state(nodes[i - 1] if i else start, float(times[i]))
            else:
                nodes[i] = impacts[i // self.pieces]
        for i in range(self.inner - 1, forwards - 1, -1):
            nodes[i] = self.orbits.path_state(nodes[i + 1] if i + 1 < self.inner else start, -float(times[i + 1]))
        return nodes

    def in_pieces_of(self, other: MultipointProblem, y: np.ndarray) -> np.ndarray:
        """The unknowns y (u,) of this problem in those of another one, which differs in its pieces."""
        if self.pieces == other.pieces:
            return np.array(y, float)
        if self.pieces == 1:
            return other.pack(self.start(y), self.impact_states(y), self.whole_flight_times(y))
        # From one cut to the next rounding grows less than along the whole flight.
        begins, times, states = np.vstack([self.start(y), self.nodes(y)]), self.flight_times(y).tolist(), []
        for first in range(0, self.inner + 1, self.pieces):
            for k in range(other.pieces):
                piece, rest = divmod(k * self.pieces, other.pieces)
                state = begins[first + piece]
                states.append(self.orbits.path_state(state, rest / other.pieces * times[first + piece]) if rest else state)
        return other.pack(states[0], states[1:], np.repeat(self.whole_flight_times(y) / other.pieces, other.pieces))

    def in_enough_pieces(self, y: np.ndarray) -> MultipointProblem:
        """The problem in as many pieces as the flights from y need for perturbations to grow by less than `GROWTH` along each, or
        `MOST_PIECES`."""
        more = enough_pieces(self.growth(y), self.pieces) if self.is_smooth else self.pieces
        return MultipointProblem(self.system, self.ends, self.sequence, more) if more > self.pieces else self

    def growth(self, y: np.ndarray) -> float:
        """The largest factor by which perturbations, relative to the size of the state, grow along a flight or a piece of one."""
        return self.orbits.growth(y)

    def flight_times(self, y: np.ndarray) -> np.ndarray:
        """Flight times (k + 1,)."""
        last = self.parameters + self.inner * (self.size + 1) + 1
        return y[self.parameters : last : self.size + 1]

    def nodes(self, y: np.ndarray) -> np.ndarray:
        """States after each inner impact, (k, N)."""
        inner = y[self.parameters + 1 : self.parameters + 1 + self.inner * (self.size + 1)]
        return inner.reshape(self.inner, self.size + 1)[:, : self.size]

    def whole_flight_times(self, y: np.ndarray) -> np.ndarray:
        """Flight times between impacts and ends, without cuts."""
        return self.flight_times(y) if self.pieces == 1 else self.flight_times(y).reshape(-1, self.pieces).sum(axis=1)

    def impact_states(self, y: np.ndarray) -> np.ndarray:
        """States after the inner impacts, without cuts."""
        return self.nodes(y)[self.pieces - 1 :: self.pieces]

    def start(self, y: np.ndarray) -> np.ndarray:
        """Start state (N,)."""
        return product(self.start_map, y[: self.parameters]) + self.start_offset

    def energy(self, y: np.ndarray) -> float:
        """h at the start."""
        return float(modal_energies(self.system, self.start(y)))

    def quarter_period(self, y: np.ndarray) -> float:
        """alpha = T/4."""
        return float(np.sum(self.flight_times(y))) / self.quarters

    def reach(self, solution: Solution) -> float:
        """A typical displacement: the smallest distance of a stop that is not at zero; without one, of an orbit."""
        gaps = [abs(bound) for stop in self.system.stops for bound in (stop.lower, stop.upper) if bound and math.isfinite(bound)]
        return min(gaps, default=0.0) or self.speed(solution) * self.duration(solution)

    def speed(self, solution: Solution) -> float:
        """A typical speed of an orbit: sqrt(2 h)."""
        return math.sqrt(2.0 * solution["energy"])

    def duration(self, solution: Solution) -> float:
        """A typical duration of its flights: the quarter period."""
        return solution["quarter_period"]

    def path_state(self, y: np.ndarray, time: float) -> np.ndarray:
        """State (N,) at a time of the first flight."""
        return self.orbits.path_state(self.start(y), float(time))

    def end_states(self, y: np.ndarray) -> np.ndarray:
        """State at the end of each flight, before the impact there, (k + 1, N)."""
        return self.orbits.end_states(y)

    # -- equations ------------------------------------------------------------------------------------------------------------

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (u - 1,)."""
        return self.orbits.residual(y)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), dense (u - 1, u): for switching and for tests; Newton's steps use the block structure."""
        return self.orbits.jacobian(y)

    def scales(self, y: np.ndarray) -> np.ndarray:
        """Typical size of each unknown at the orbit y, (u,): one scale each for displacements, velocities and times."""
        return self.orbits.scales(y)

    @property
    def curvature_blocks(self) -> list[np.ndarray]:
        """Indices of the unknowns of each flight, (k + 1) arrays: the state where it starts, and its time.

        The equations are sums over the flights, so no second derivative is by unknowns of two flights. The unfolding parameter of a
        periodic orbit acts on all flights, and is in no block."""
        every = np.arange(self.unknowns - int(self.periodic))
        return np.split(every, self.parameters + 1 + (self.size + 1) * np.arange(self.inner))

    # -- solution and step ----------------------------------------------------------------------------------------------------

    def solve(self, y: np.ndarray, *, energy: float | None = None, quarter_period: float | None = None) -> Solution:
        """Newton's solution near y: at a given energy, at a given quarter period, or the nearest one of the family.

        Raises
        ------
        NotConverged
            When the update does not shrink to rounding level.
        EndsError
            See `refuse_drift`.
        """
        self.refuse_drift()
        wanted = (math.nan if value is None else float(value) for value in (energy, quarter_period))
        outcome, change, previous, found = self.orbits.solve(y, *wanted)
        if outcome != SOLVED:
            reasons = {
                DIVERGED: "diverged",
                GROWN: f"grow ({previous:.1e} to {change:.1e} of the orbit's size)",
                UNSETTLED: f"did not settle in {ROUNDS} steps (last one {previous:.1e})",
            }
            limit = self.orbits.why_not_flown()
            raise NotConverged(f"Newton's corrections {reasons.get(outcome, 'did not settle')}" + (f"; {limit}" if limit else ""))
        return found

    def family_orbit_at(self, y: np.ndarray, along: np.ndarray, position: np.ndarray, near: float, most: int) -> np.ndarray | None:
        """The unknowns of the family's orbit at a position of the arclength's metric, to a distance `near`, after at most so many
        corrections from the orbit y of the family; None if it has none there. along (u,): direction of the family at y."""
        return self.orbits.meet_position(y, along, position, float(near), int(most))

    def correct(self, y: np.ndarray, row: np.ndarray, target: float, maximum: int) -> tuple[bool, float]:
        """Newton's corrections of y in place, held on row . y = target, `maximum` at most. Returns (whether they converged, scaled
        residual)."""
        found = self.orbits.correct(y, row, float(target), maximum)
        y[:] = found.y
        return found["converged"] == 1.0, found["residual"]

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, *, maximum: int = 12, full: bool = True) -> Solution | None:
        """Step by ds along the family from y with its tangent (see `Solution`; the end may be missing); None where Newton fails.

        With ds = 0, y itself is corrected (least norm) and its tangent turned like the one given (all zero: as it comes).
        `full` adds multipliers, admissibility and half-waves.
        """
        return self.orbits.step(y, tangent, float(ds), maximum, full)

    def orbit_at(self, y: np.ndarray) -> Solution:
        """The unknowns of an orbit as a solution, as they are.

        Raises
        ------
        NotConverged
            Where they are none.
        """
        found = self.step(y, np.zeros(2 * self.unknowns), 0.0, maximum=0)
        if found is None:
            raise NotConverged("the unknowns are no solution")
        return found


def enough_pieces(growth: float, pieces: int, most: int = MOST_PIECES, limit: float = GROWTH) -> int:
    """How many pieces flights need, `most` at most, of which the given ones grow by `growth`, to grow by less than a limit."""
    if not limit < growth < math.inf:
        return pieces
    return min(math.ceil(math.log(growth) / math.log(0.01 * GROWTH)) * pieces, most)


def lost_digits(problem: Any, y: np.ndarray) -> str:
    """How perturbations of an orbit y grow, in words, where that leaves too few digits; empty where it does not. problem: of any orbits."""
    growth = problem.growth(y) if problem.is_smooth or problem.ends is None else 0.0
    return f"perturbations of the orbit, and rounding, grow by a factor {growth:.2g} in one flight" if growth > GROWTH else ""


@lru_cache(maxsize=64)
def observed_of(system: ImpactSystem) -> Observed:
    """The functionals that are watched along each flight: the gap of every stop, and the velocities of absorber and primary.
    Shared by all who ask, and not to be written to."""
    modes = system.modes
    size = 2 * system.degrees_of_freedom
    n = system.degrees_of_freedom
    gap = np.array([product(modes.to_state[:n].T, np.asarray(stop.gap)) for stop in system.stops]).reshape(-1, size)
    velocity = np.zeros((0, size))
    if system.absorber is not None and system.primary is not None:
        velocity = modes.to_state[[n + system.absorber, n + system.primary]]
    row = np.concatenate([gap, velocity])
    rows = np.empty((len(row), 4, size))
    for k in range(4):
        rows[:, k] = row
        row = product(row, modes.matrix)
    bounds = np.repeat([[-np.inf], [np.inf]], len(system.stops), axis=1)
    bounds[(modes.contacts.side > 0.0).astype(int), modes.contact_stop] = modes.contacts.bound
    return Observed(rows, bounds)
