"""The multipoint problem of an orbit under periodic loads, in any released parameters.

`ForcedProblem` binds a system with parameters, a closure and an impact sequence to the compiled kernels of `bvp.kernels.forced`: residual
and Jacobian, and the step along the family.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bvp.blocks import Matrices
from bvp.checks import require_system
from bvp.closures import EndsError
from bvp.contact_sequence import CLOSES, OPENS, ContactEvent, parse_contact_sequence, require_bounces, require_half, require_pressing
from bvp.forced_metric import forced_metric, forced_position
from bvp.forced_modes import ForcedMode, ModeTable
from bvp.kernels.extrema import Observed
from bvp.kernels.forced import LoadedSegment, ReleasedEntries, fly_loaded, forced_step, set_parameters
from bvp.kernels.forced_sticking import Unstuck, contact_force
from bvp.kernels.loaded_paths import Watched, forced_observe, make_extended
from bvp.kernels.loads import Loads
from bvp.kernels.multipoint import CLOSED, PERIODIC, RESULT, UNFOLDED, Factor, make_factor
from bvp.kernels.newton import LINEARISED, set_scale
from bvp.kernels.step import CompiledProblem, Landing, Request
from bvp.kernels.undamped import Renewal, make_renewal, renew_free_flight
from bvp.multipliers import sort_multipliers
from bvp.multipoint import GROWTH, MOST_PIECES, NotConverged, Solution, enough_pieces
from bvp.parameters import ParametricSystem
from bvp.programs import scratch_size
from bvp.smooth_flights import why_not_flown
from bvp.stroboscopic import OrbitMultipliers
from bvp.system import ImpactSystem

if TYPE_CHECKING:
    from bvp.curvature import Curvature
    from bvp.smooth_forces import SmoothForces

__all__ = ["ForcedProblem", "dense_jacobian"]

GRAZING = 1e-11
"""Impact speed, over the largest velocity, below which an impact grazes: a located grazing has one of rounding, about 1e-12."""

_OTHER = 1e-3
"""Relative change of a parameter at which the symmetry of the system is looked at."""

_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_int64)
"""A function that kernels can call."""


class ForcedProblem:
    """Periodic orbits of a system under periodic loads, with a given impact sequence, in released parameters.

    Parameters
    ----------
    parametric : ParametricSystem
        Its loads have a base frequency.
    sequence : sequence of str
        Contact letters of the impacts in order of time: of the full period, or of half of it. Empty: the response without impacts.
    released : sequence of str
        Names of the parameters that vary along the family.
    load_periods : int
        p, the number of periods of the base frequency in one of the orbit. Without harmonic loads the period is free.
    half : bool
        Solve half a period of an orbit with x(t + T/2) = -x(t).
    values : mapping, optional
        Values of the parameters that replace the defaults.
    keep : sequence of str
        Equations of parameters that hold along the family, such as "F = 0.3*w**2": one less than there are released parameters.
    pieces : int
        Number of pieces of equal time in which the flight of a response without impacts is solved: see
        `bvp.multipoint.MultipointProblem`.

    Raises
    ------
    EndsError
        For a half period of a system or of loads without odd symmetry, or of an even p; for an unknown stop.
    ValueError
        For parameters that the system lacks, loads without a common period, and an orbit that no load and no loss determines.

    Notes
    -----
    The unknowns are y = (z_0, t_0, z_1, t_1, ..., z_k, t_k) of nodes z = (u, v, s, parameters): s is the time as a fraction of the period.
    """

    def __init__(
        self,
        parametric: ParametricSystem,
        sequence: Sequence[str],
        released: Sequence[str],
        *,
        load_periods: int = 1,
        half: bool = False,
        values: Mapping[str, float] | None = None,
        keep: Sequence[str] = (),
        pieces: int = 1,
    ):
        self.parametric = parametric
        self.pieces = pieces
        self.values = parametric.at(values)
        self.system = system = parametric.system_along(self.values, released)
        require_system(system, smooth=True)
        for a, b, bound in system.repeated_stops() if len(system.stops) > 1 else ():
            raise EndsError(
                f"stops {a.name} and {b.name} end the same gap at the same place, {bound:g} of stop {a.name}; "
                "expected one of them where a parameter varies"
            )
        self.is_smooth = system.smooth_forces is not None
        self.sequence = tuple(sequence)
        self.released = tuple(released)
        self._located = self.released[:1]
        self.load_periods, self.half = load_periods, half
        layout = parametric.layout
        self.has_clock = bool(layout.harmonics)
        self._require_determined()
        self.degrees_of_freedom = n = system.degrees_of_freedom
        found = parametric.program(self.released)
        varies = len(found.rows) > 0 and int(found.rows[0]) < layout.stiffness.stop
        count = len(self.released)
        self.size = size = 2 * n + 1 + count
        self.coordinates = size + 1
        self.modes = modes = system.modes
        self.events = events = self._events()
        self.sequence = tuple(event.symbol for event in events) or self.sequence
        first = layout.restitution.start
        changing = [row - first for row in found.rows.tolist() if row in range(layout.size)[layout.restitution]]
        require_bounces(system, events, self.has_clock, changing)
        self.contacts = np.array(self._contacts([event.contact for event in events]))
        self.inner = len(self.contacts) - 2
        closed, quarters, *kinds = self._closure()
        self.unknowns = (self.inner + 1) * (size + 1) + int(closed == UNFOLDED)
        nodes = self.inner + 2
        gap, rate, push = (np.zeros((nodes, size)) for _ in range(3))
        changes = count if varies else 0
        side, entries = np.zeros(nodes), np.full((nodes, 2), -1, dtype=np.int64)
        releases = [event.is_release for event in (*events[1:], *events[:1], *events[:1])] if events else [False] * nodes
        for i, contact in enumerate(self.contacts.tolist()):
            if contact >= 0 and not releases[i]:
                stop = int(modes.contact_stop[contact])
                gap[i, :n] = rate[i, n : 2 * n] = system.stops[stop].gap
                side[i] = modes.contacts.side[contact]
                bounds = layout.upper if side[i] > 0.0 else layout.lower
                entries[i] = bounds.start + stop, layout.restitution.start + stop
        self.impacts = np.flatnonzero([not event.is_release for event in events])  # nodes
        constant = range(layout.size)[layout.constant]
        loaded = np.any(parametric.entries(self.values)[layout.constant]) or any(row in constant for row in found.rows.tolist())
        harmonics = np.array([*([0.0] if loaded else []), *layout.harmonics], dtype=float)
        loads = Loads(harmonics, np.zeros((1 + count, len(harmonics), 2, 2 * n)), np.zeros(1 + count), float(load_periods))
        metric = forced_metric(self)
        forces = None
        if self.is_smooth:
            from bvp.released_forces import released_forces

            self.smooth_forces = parametric.smooth_forces(self.values, self.released)
            forces = released_forces(self.smooth_forces)
        bouncing = [*changing, *(stop for stop, one in enumerate(system.stops) if one.restitution > 0.0)]
        rows = np.array([stop.gap for stop in system.stops]).reshape(-1, n)
        # Contact forces are in units of length: accelerations of their gaps over the square of the fastest frequency.
        units = (metric[0] / metric[n]) ** 2 * np.einsum("si,is->s", rows, np.linalg.solve(system.mass, rows.T))
        self._table = table = ModeTable(system, events, nodes, size, changes, loads, units, forces, bouncing)
        self._renew = _CALLBACK(self._renewed) if varies or self._leaves_unseen else None
        address = ctypes.cast(self._renew, ctypes.c_void_p).value if self._renew is not None else 0
        # The user's equations can name what a free orbit has besides its parameters.
        known = np.array([*(self.values[name] for name in parametric.names), *(0.0 for _ in self.conserved)])
        at = known[: len(parametric.names)]
        places = np.array([part.start for part in (layout.restitution, layout.constant, layout.cosine, layout.sine)], dtype=np.int64)
        needed = count if self.conserved else count - 1
        if len(keep) != needed:
            raise ValueError(f"{count} released parameters need {needed} equations to keep; received {len(keep)}")
        self.keep = tuple(keep)
        kept = parametric.equations(self.keep, self.released, self.conserved)
        scratch = np.zeros(max(found.scratch, scratch_size(kept, len(known))))
        of_parameters = ReleasedEntries(
            found.program, at, found.columns, found.rows, scratch, np.zeros(len(found.program.outputs)),
            parametric.entries(self.values), np.zeros((count, layout.size)), places, layout.frequency.start, int(address or 0),
        )  # fmt: skip
        shape = np.array([self.inner, closed, quarters, *kinds], dtype=np.int64)
        self.segment = LoadedSegment(
            table.flight, table.arrays.drive[0], table.arrays.drive_slope[0], gap, rate, push, np.zeros((changes, nodes, size)),
            np.zeros(nodes), np.zeros(nodes), side, np.eye(size), np.zeros(size), self._end_rows(), entries,
            np.array([-1.0 if half else 1.0, (0.5 if half else 1.0) * self.has_clock]), metric,
            of_parameters, kept, known, np.zeros(len(kept.outputs)), np.zeros(size), shape, table.kind,
        )  # fmt: skip
        stops = np.array([modes.contact_stop[contact] if contact >= 0 else -1 for contact in self.contacts], dtype=np.int64)
        bounds = np.array([np.arange(part.start, part.stop) for part in (layout.lower, layout.upper)], dtype=np.int64)
        sizes = table.arrays.pairs.shape[1], 2 * n, len(harmonics), len(system.stops)
        gaps = table.stops
        plain, joined = make_extended(*sizes, False), make_extended(*sizes, True)
        if self.is_smooth:  # its rows are on (u, v)
            plain = plain._replace(observed=Observed(np.zeros((len(gaps), 4, 2 * n)), np.zeros((2, len(gaps)))))
        self._watched = Watched(gaps, stops, bounds, plain, joined)
        table.write(system, table.made, gap, push)
        self._modes_at: tuple[float, ...] = ()
        self._factor = make_factor(self.segment)
        self._zero = np.zeros(2 * self.unknowns)
        self.tangent_size = (3 if self.is_smooth else 2) * self.unknowns
        self._nothing = np.zeros(1)

    periodic = True
    """Whether a closed orbit is solved from an impact on, and not a segment between two reversals."""

    ends: tuple[str, str] | None = None
    """The ends of the solved segment of a free orbit; None of a forced one."""

    energy: float = 0.0
    """A typical energy of free orbits; 0 of forced ones."""

    conserved: tuple[str, ...] = ()
    """What the user's equations can name besides parameters."""

    smooth_forces: SmoothForces | None = None
    """The smooth forces, in which the released parameters are symbols."""

    def _require_determined(self) -> None:
        """Refuse a system whose orbits are not isolated at given parameters, and a half period where there is none."""
        if not self.has_clock and (not self.sequence or self.system.is_conservative):
            missing = "damping, restitution below 1 or a harmonic load" if self.sequence else "an impact"
            raise ValueError(f"an orbit without harmonic loads is determined by its impacts and losses; expected {missing}")
        if self.half:
            layout = self.parametric.layout
            loads = (
                self.parametric.entries(self.values)[layout.constant],
                self.parametric.derivatives(self.values, self.released)[layout.constant],
            )
            require_half(self.system, layout.harmonics, any(map(np.any, loads)), self.load_periods)
            for name in self.released:
                if not self._stays_odd(name):
                    raise EndsError(f"{name} breaks the odd symmetry that a half period needs")

    def _stays_odd(self, name: str) -> bool:
        """Whether the system has odd symmetry at other values of a parameter, too."""
        value = self.values[name]
        for other in (value + _OTHER * (abs(value) or 1.0), value - _OTHER * (abs(value) or 1.0)):
            try:
                return bool(self.parametric.system({**self.values, name: other}).has_odd_symmetry)
            except ValueError:  # beyond the domain of the parameter
                continue
        return True

    def _events(self) -> tuple[ContactEvent, ...]:
        """The events of the sequence; () where no stop can stick."""
        events = parse_contact_sequence(self.system, self.sequence, self.half)
        require_pressing(self.system, events)
        return events

    def violation(self, y: np.ndarray) -> str | None:
        """Why the system cannot have the parameters of y, or its orbits not these events; None if it can."""
        at = self.parameters(y)
        try:
            found = self.parametric.violation(at)
            if found is None:
                require_pressing(self.parametric.system(at), self.events)
        except EndsError as error:
            return str(error).partition(";")[0]
        return self._why_no_flight(y) if found is None and self.is_smooth else found

    def _why_no_flight(self, y: np.ndarray) -> str | None:
        """Where and why a flight of y with smooth forces cannot be computed."""
        self.residual(y)
        failed = np.flatnonzero(~np.isfinite(self._factor.before).all(axis=1))
        if not len(failed):
            return None
        i = int(failed[0])
        return f"flight {i + 1} of an orbit: {why_not_flown(self.segment.flight, np.append(self.nodes(y)[i], self.flight_times(y)[i]))}"

    def _contacts(self, hit: Sequence[int]) -> list[int]:
        """The contact at each node after the first one, then that at the first; -1: none."""
        if not hit:
            return [-1] * (self.pieces + 1)
        # The last impact of the segment is the first of the orbit, or its mirror image.
        return [*hit[1:], int(self.modes.contact_opposite[hit[0]]) if self.half else hit[0], hit[0]]

    def _closure(self) -> tuple[int, int, int, int]:
        """How the segment closes, for the kernels: CLOSED or UNFOLDED, quarter periods solved, kinds of its ends."""
        return CLOSED, 4, PERIODIC, PERIODIC

    def _end_rows(self) -> np.ndarray:
        """The rows of the end conditions."""
        return np.zeros((0, 2 * self.degrees_of_freedom))

    def sibling(self, sequence: Sequence[str], **changes: Any) -> ForcedProblem:
        """The problem with another sequence. changes: keywords of the constructor that differ."""
        options = {"load_periods": self.load_periods, "half": self.half, "values": self.values, "keep": self.keep}
        options["pieces"] = 1 if sequence else self.pieces
        return ForcedProblem(self.parametric, sequence, self.released, **{**options, **changes})

    def _renewed(self, _: int) -> None:
        """Compute all that depends on masses, dampers and springs anew, at the parameters that the kernels have just evaluated. NaN where
        the system cannot have them: a step does not converge there."""
        released, n = self.segment.released, self.degrees_of_freedom
        at = tuple(released.values.tolist())
        if at == self._modes_at:
            return
        segment, layout = self.segment, self.parametric.layout
        if self.is_undamped:
            renewed = renew_free_flight(segment, self._renewal)
            self._modes_at = at if renewed else ()
            if not renewed:
                self._table.arrays.delta[0] = math.nan
            return
        try:
            system, made = self._modes_at_values(at, released.entries)
            self._table.write(system, made, segment.gap, segment.push)
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            self._table.arrays.matrix[0] = math.nan
            self._modes_at = ()
            return
        self._modes_at = at
        if not self._table.arrays.change.shape[1]:
            return
        for j, slopes in enumerate(released.slopes):
            parts = [slopes[part].reshape(n, n) for part in (layout.mass, layout.damping, layout.stiffness)]
            self._table.write_slopes(system, j, parts, segment.gap, segment.push_slope[j])

    @cached_property
    def is_undamped(self) -> bool:
        """Whether the system has linear springs and no dampers, and no stop sticks."""
        layout, damping = self.parametric.layout, self.segment.released.entries[self.parametric.layout.damping]
        varies = np.isin(self.segment.released.rows, range(layout.size)[layout.damping]).any()
        return not (self.is_smooth or varies or damping.any() or self._leaves_unseen) and isinstance(self._table.kind, Unstuck)

    @cached_property
    def _renewal(self) -> Renewal:
        """Work of `renew_free_flight`."""
        layout = self.parametric.layout
        renewal: Renewal = make_renewal(self.degrees_of_freedom, layout.mass.start, layout.stiffness.start)
        return renewal

    def modes_at(self, at: tuple[float, ...], entries: np.ndarray) -> tuple[list[ForcedMode], np.ndarray]:
        """The contact modes at values of all parameters, whose entries are known, and the masses."""
        system, made = self._modes_at_values(at, entries)
        return made, system.mass

    def _modes_at_values(self, at: tuple[float, ...], entries: np.ndarray) -> tuple[Any, list[ForcedMode]]:
        """The system at values of all parameters, and its contact modes."""
        system, made = self._table.modes_at(at, lambda values: self._system_at(values, entries))
        if not self.is_smooth:  # no stop sticks there
            require_pressing(system, self.events)
        return system, made

    def _system_at(self, at: tuple[float, ...], entries: np.ndarray) -> Matrices:
        """The system at values of all parameters, whose entries are known; beside smooth forces only its matrices."""
        if not self.released:
            return self.system
        values = dict(zip(self.parametric.names, at, strict=True))
        domains = [(values[name], *self.parametric.domain(name)) for name in self._located] if self._leaves_unseen else []
        if domains and all(low <= value <= high for value, low, high in domains):
            return self.parametric.system(values)
        # A step beyond the domain of such a parameter locates its end, if its limits are known: matrices can go on there.
        layout, n = self.parametric.layout, self.degrees_of_freedom
        mass, damping, stiffness = (entries[part].reshape(n, n) for part in (layout.mass, layout.damping, layout.stiffness))
        return Matrices(mass, damping, stiffness) if self.is_smooth else ImpactSystem(mass, damping, stiffness, self.system.stops)

    @cached_property
    def _leaves_unseen(self) -> bool:
        return self.parametric.leaves_unseen(self.released, self._located)

    def locate_domains(self, names: Sequence[str]) -> None:
        """Let steps go beyond the domains of these released parameters, by default of the first one: test functions locate their ends."""
        self._located = tuple(names)
        for name in ("_leaves_unseen", "is_undamped"):
            self.__dict__.pop(name, None)

    def position(self, y: np.ndarray) -> np.ndarray:
        """The first node in the coordinates of arclength, (N + 1,)."""
        return forced_position(self.segment.scale, 2 * self.degrees_of_freedom, y)

    def mirrored(self, symbol: str) -> str:
        """A symbol of the sequence at the opposite contact of its stop."""
        letters, opposite = self.modes.contact_letters, self.modes.contact_opposite
        letter = symbol.rstrip(CLOSES + OPENS)
        return letters[int(opposite[letters.index(letter)])] + symbol[len(letter) :]

    # -- unknowns -------------------------------------------------------------------------------------------------------------

    def pack(self, states: ArrayLike, fractions: ArrayLike, parameters: ArrayLike, flight_times: ArrayLike | None = None) -> np.ndarray:
        """Unknowns y (u,) from the states (u, v) after each impact (k + 1, 2 n), the times of these impacts as fractions of the period,
        ascending, (k + 1,), and the released parameters (m,). Without a clock the flight times (k + 1,) take the place of the fractions,
        which are zeros."""
        y = np.zeros(self.unknowns)
        nodes, times = self.nodes(y), np.asarray(fractions, float)
        nodes[:, : 2 * self.degrees_of_freedom] = states
        nodes[:, 2 * self.degrees_of_freedom] = times
        nodes[:, 2 * self.degrees_of_freedom + 1 :] = parameters
        if flight_times is None:
            flight_times = np.diff([*times, times[0] + self.segment.closing[1]]) * self.period(y)
        self.flight_times(y)[:] = flight_times
        return y

    def nodes(self, y: np.ndarray) -> np.ndarray:
        """Nodes (k + 1, N), a view of y."""
        return self._rows(y)[:, : self.size]

    def flight_times(self, y: np.ndarray) -> np.ndarray:
        """Flight times (k + 1,), a view of y."""
        return self._rows(y)[:, self.size]

    def _rows(self, y: np.ndarray) -> np.ndarray:
        """Each node with its flight time, (k + 1, N + 1), a view of y."""
        return y[: (self.inner + 1) * (self.size + 1)].reshape(self.inner + 1, self.size + 1)

    def cut(self, y: np.ndarray, count: int, part: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A part of an orbit without impacts, from its start, in flights of equal time: states (count, 2 n), fractions and flight times
        (count,), for `pack`."""
        nodes, lasting, size = self.nodes(y), self.flight_times(y), 2 * self.degrees_of_freedom
        time = part * float(np.sum(lasting)) / count
        states, fractions = np.empty((count, size)), np.empty(count)
        for k in range(count):
            flight = min(int(k * part * len(lasting) / count + 1e-9), len(lasting) - 1)
            ahead = k * time - flight * lasting[0]
            near = abs(ahead) <= 1e-9 * lasting[0]
            states[k], fractions[k] = (nodes[flight, :size], nodes[flight, size]) if near else self.fly(nodes[flight], ahead, flight)
        return states, fractions, np.full(count, time)

    def in_pieces(self, pieces: int, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
        """The problem with another number of pieces, and the unknowns y (u,) there."""
        if pieces == self.pieces:
            return self, np.array(y, float)
        other = self.sibling(self.sequence, pieces=pieces)
        states, fractions, times = self.cut(y, pieces)
        return other, other.pack(states, fractions, self.nodes(y)[0, 2 * self.degrees_of_freedom + 1 :], times)

    most_pieces = 8 * MOST_PIECES
    """Most pieces of a flight, which is a period of loads, or half of it."""

    def enough_pieces(self, y: np.ndarray, limit: float = GROWTH) -> int:
        """How many pieces the flights from y need for perturbations to grow by less than a limit along each, `most_pieces` at most."""
        return enough_pieces(self.growth(y), self.pieces, self.most_pieces, limit) if self.can_be_cut else self.pieces

    @property
    def can_be_cut(self) -> bool:
        """Whether flights can be solved in pieces: those of a response, from impact to impact, cannot."""
        return not self.sequence

    def fly(self, node: np.ndarray, time: float, flight: int = 0) -> tuple[np.ndarray, float]:
        """The state (u, v) and the fraction of the period to which a node (N,) flies as in a flight of the orbit."""
        size = 2 * self.degrees_of_freedom
        set_parameters(self.segment, np.array(node, float))
        out = self.flown(node, time, flight)[0]
        return out[:size].copy(), float(out[size])

    def flown(self, node: np.ndarray, time: float, flight: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The node at a time of a flight (N,), its derivatives by the first one (N, N) and its rate (N,), at the parameters that the
        kernels have evaluated last."""
        out, jacobian, rate = np.empty(self.size), np.empty((self.size, self.size)), np.empty(self.size)
        fly_loaded(self._table.flight_in(flight), np.array(node), float(time), out, jacobian, rate)
        return out, jacobian, rate

    def contact_force(self, node: np.ndarray, flight: int, contact: int) -> float:
        """The force of a contact that sticks in a flight of the orbit, at a node (N,), equation (43): positive where it presses."""
        set_parameters(self.segment, np.array(node, float))
        sticking = self._table.arrays
        mode, stop = int(sticking.mode[flight]), int(self.modes.contact_stop[contact])
        return contact_force(sticking, self.segment.flight.loads, mode, stop, np.array(node, float), np.empty(self.size))

    def parameters(self, y: np.ndarray) -> dict[str, float]:
        """All parameters at y."""
        moved = y[2 * self.degrees_of_freedom + 1 : self.size].tolist()
        return self.values | dict(zip(self.released, moved, strict=True))

    def restitution(self, y: np.ndarray, contact: int) -> float:
        """The restitution of a contact at y; 0 below rounding, as in the kernels."""
        entries = self.parametric.entries(self.parameters(y))[self.parametric.layout.restitution]
        return (1.0 + float(entries[self.modes.contact_stop[contact]])) - 1.0

    def known_values(self, y: np.ndarray) -> dict[str, float]:
        """The values of all names that equations can have, at y."""
        return self.parameters(y)

    def period(self, y: np.ndarray) -> float:
        """T."""
        if not self.has_clock:
            return float(np.sum(self.flight_times(y))) * (2.0 if self.half else 1.0)
        frequency = float(self.parametric.entries(self.parameters(y))[self.parametric.layout.frequency][0])
        return 2.0 * math.pi * self.load_periods / frequency

    def reach(self, solution: Solution) -> float:
        """A typical displacement: the unit of arclength."""
        return float(self.segment.scale[0])

    def speed(self, solution: Solution) -> float:
        """A typical speed of an orbit."""
        return float(self.scales(solution.y)[self.degrees_of_freedom])

    def duration(self, solution: Solution) -> float:
        """A typical duration of its flights: the period."""
        return solution["quarter_period"]

    # -- equations ------------------------------------------------------------------------------------------------------------

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (u - 1,)."""
        # The kernel of steps contains these functions: another one for them alone would take as long to compile.
        self._factor.scale[:] = 1.0
        self._stepped(y, self._zero, Request(0.0, math.nan, LINEARISED))
        return self._factor.work[6, : self.unknowns - 1].copy()

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), dense (u - 1, u): for switching and for tests; Newton's steps use the block structure."""
        self.residual(y)
        return dense_jacobian(self._factor, self.size + 1)

    def scales(self, y: np.ndarray, *, evaluated: bool = False) -> np.ndarray:
        """Typical size of each unknown at the orbit y, (u,). evaluated: y is the orbit that was evaluated last."""
        if not evaluated:
            self.residual(y)
        set_scale(self.segment, np.array(y, float), self._factor)
        return self._factor.scale.copy()

    @property
    def curvature_blocks(self) -> list[np.ndarray]:
        """Indices of the unknowns of each flight, (k + 1) arrays: the node where it starts, and its time. No second derivative of the
        equations is by unknowns of two flights."""
        return np.split(np.arange((self.inner + 1) * (self.size + 1)), self.inner + 1)

    def second_derivative(self, y: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """F''(y)[a, b], (u - 1,): see `bvp.curvature.Curvature.second_along`."""
        found: np.ndarray = self.curvature.second_along(y, a) @ b
        return found

    @cached_property
    def curvature(self) -> Curvature:
        """The derivatives of higher order."""
        from bvp.curvature import Curvature

        return Curvature(self)

    @property
    def contact_modes(self) -> ModeTable:
        """The contact modes of the flights."""
        return self._table

    # -- solution and step ----------------------------------------------------------------------------------------------------

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, *, maximum: int = 12) -> Solution | None:
        """Step by ds along the family from y with its tangent (see `Solution`; the end may be missing); None where Newton fails.

        With ds = 0, y itself is corrected (least norm) and its tangent turned like the one given (all zero: as it comes)."""
        return self._take(y, tangent, Request(ds, math.nan, maximum))

    def scaled_residual(self, y: np.ndarray) -> float:
        """The largest residual at y, each in its own unit: of a solution below 1e-12."""
        landing, _ = self._stepped(y, np.zeros(2 * self.unknowns), Request(0.0, math.nan, 0))
        return float(landing.result[RESULT.index("residual")])

    def compiled(self, *, full: bool = True) -> CompiledProblem:
        """The problem for a compiled function that takes steps of its own."""
        metric, result = np.empty((4, self.coordinates)), np.empty(len(RESULT))
        landing = Landing(self._zero[: self.unknowns], self._zero, result)
        request, factor = Request(0.0, 0.0, 0), self._factor
        step = forced_step.entry(self.segment, factor, landing.y, self._zero, request, metric, landing).address
        observe = forced_observe.entry(self.segment, self._watched, landing.y, factor.before, self._nothing, result).address
        addresses = np.array([step, observe if full else 0])
        return CompiledProblem(addresses, self.segment, factor, self._watched, self._nothing)

    def solve(self, y: np.ndarray) -> Solution:
        """Newton's solution near y at the parameter's value there.

        Raises
        ------
        NotConverged
            When the corrections do not shrink to rounding level.
        """
        row = self._factor.work[5, : self.unknowns]
        row[:] = 0.0
        row[2 * self.degrees_of_freedom + 1] = 1.0
        found = self._take(y, self._zero, Request(0.0, float(y[2 * self.degrees_of_freedom + 1]), 30))
        if found is None:
            raise NotConverged("Newton's corrections did not settle")
        return found

    def _take(self, y: np.ndarray, tangent: np.ndarray, request: Any) -> Solution | None:
        landing, position = self._stepped(y, tangent, request)
        if landing.result[0] != 1.0:
            return None
        ends = self._factor.before.copy()
        self._observe(landing.y, ends, landing.result)
        return Solution(landing.y, landing.tangent, position, ends, landing.result)

    def _stepped(self, y: np.ndarray, tangent: np.ndarray, request: Request) -> tuple[Landing, np.ndarray]:
        """What the kernel of steps leaves for a request, and the position of the new point."""
        landing = Landing(np.empty(self.unknowns), np.empty(self.tangent_size), np.full(len(RESULT), np.nan))
        metric = np.empty((4, self.coordinates))
        forced_step(self.segment, self._factor, np.array(y, float), np.array(tangent, float), request, metric, landing)
        return landing, metric[0]

    def _observe(self, y: np.ndarray, ends: np.ndarray, result: np.ndarray) -> None:
        """Fill the entries of a result that belong to the paths of the flights."""
        forced_observe(self.segment, self._watched, y, ends, self._nothing, result)

    def impact_speeds(self, y: np.ndarray) -> np.ndarray:
        """Speed of approach at each node of an orbit y, in the order of the sequence, (k + 1,), 0 at releases; without impacts (0,)."""
        self.residual(y)
        return np.roll(self._approach(), 1) if self.sequence else np.zeros(0)

    def losses(self, y: np.ndarray) -> np.ndarray:
        """Kinetic energy lost at the impact that ends each flight of an orbit y, (k + 1,)."""
        self.residual(y)
        size, n = 2 * self.degrees_of_freedom, self.degrees_of_freedom
        before = self._factor.before[:, n:size]
        after = np.roll(self.nodes(y)[:, n:size], -1, axis=0)
        after[-1] *= self.segment.closing[0]
        mass = self.segment.released.entries[self.parametric.layout.mass].reshape(n, n)
        lost: np.ndarray = 0.5 * np.einsum("ij,jk,ik->i", before - after, mass, before + after)
        return lost

    def _approach(self) -> np.ndarray:
        """Speed of approach of the impact that ends each flight of the orbit that was evaluated last, (k + 1,)."""
        segment, n, nodes = self.segment, self.degrees_of_freedom, self.inner + 1
        speeds: np.ndarray = segment.side[:nodes] * np.sum(segment.gap[:nodes, :n] * self._factor.before[:, n : 2 * n], axis=1)
        return speeds

    def growth(self, y: np.ndarray) -> float:
        """See `MultipointProblem.growth`."""
        self.residual(y)
        displacement, velocity, _ = set_scale(self.segment, np.array(y, float), self._factor)
        sizes = np.repeat([displacement, velocity], self.degrees_of_freedom)
        return float(np.max(np.abs(self._factor.flights[:, : len(sizes), : len(sizes)]) * sizes / sizes[:, None]))

    @cached_property
    def _orbit_multipliers(self) -> OrbitMultipliers:
        impacts = (self.impacts - 1) % (self.inner + 1) if self.sequence else self.impacts[:0]
        return OrbitMultipliers(self.system, self.events, self.segment, impacts)

    def multipliers(self, y: np.ndarray, *, evaluated: bool = False) -> np.ndarray:
        """The 2 n multipliers of the stroboscopic map of an orbit y, by modulus descending; of half a period those of x -> -x over it.

        They are those of the saddle-point matrix, in which each impact keeps the equation of its time. An impact takes the velocities f-
        and the directions along the stop to f+ and their reflections. Nothing is divided by its speed. NaN where an impact grazes.
        evaluated: y is the orbit that was evaluated last."""
        if not evaluated:
            self.residual(y)
        found = self._orbit_multipliers.values(np.array(y, float), self._factor, GRAZING)
        return np.full(2 * self.degrees_of_freedom, complex(math.nan, math.nan)) if found is None else sort_multipliers(found)

    def period_multipliers(self, y: np.ndarray) -> np.ndarray:
        """Those of the map over the full period of the orbit."""
        return self.of_period(self.multipliers(y))

    def of_period(self, multipliers: np.ndarray) -> np.ndarray:
        """Multipliers of the full period from `multipliers` of the solved segment: of half a period their squares."""
        with np.errstate(over="ignore", invalid="ignore"):  # of those without bound
            return multipliers**2 if self.half else multipliers


def dense_jacobian(factor: Factor, rows: int) -> np.ndarray:
    """The Jacobian that `fill` wrote into the factor arrays, (u - 1, u). rows: equations of a flight."""
    inner, unknowns = len(factor.window) // rows, factor.closing.shape[1]
    out = np.zeros((unknowns - 1, unknowns))
    for i in range(inner):
        base = max(0, (i - 1) * rows)
        width = min(factor.window.shape[1], unknowns - base)
        out[i * rows : (i + 1) * rows, base : base + width] = factor.window[i * rows : (i + 1) * rows, :width]
    out[inner * rows :] = factor.closing
    return out
