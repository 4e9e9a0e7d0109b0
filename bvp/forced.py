"""The multipoint problem of an orbit under periodic loads, in any released parameters.

`ForcedProblem` binds a system with parameters, a closure and an impact sequence to the compiled core: residual and Jacobian, and the step
along the family.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bvp.checks import require_system
from bvp.closures import PERIODIC, EndsError
from bvp.contact_sequence import CLOSES, OPENS, ContactEvent, parse_contact_sequence, require_bounces, require_half, require_pressing
from bvp.forced_metric import forced_metric
from bvp.forced_modes import ForcedMode, ModeTable
from bvp.forced_orbits import core_problem, force_rows
from bvp.multipliers import sort_multipliers
from bvp.multipoint import GROWTH, MOST_PIECES, NotConverged, Solution, enough_pieces
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from bvp.smooth_flights import why_not_complete
from bvp.system import ImpactSystem

if TYPE_CHECKING:
    from bvp.curvature import Curvature
    from bvp.smooth_forces import SmoothForces

__all__ = ["Flights", "ForcedProblem"]

_OTHER = 1e-3
"""Relative change of a parameter at which the symmetry of the system is looked at."""


class Flights(NamedTuple):
    """The flights of an orbit, or what is shown of them.

    begins (k + 1, 2 n + 1): states (u, v) and fractions of the period where they begin, behind a chatter. times (k + 1,): how long they
    last. ends (k + 1, 2 n): states before the events."""

    begins: np.ndarray
    times: np.ndarray
    ends: np.ndarray


class Place(NamedTuple):
    """A place of a flight: a number of entries there - the state (u, v), the fraction of the period, and the contact force of a stop that
    sticks, equation (43) - and their derivatives by the time since the begin, by state and fraction there, and by the released parameters.
    """

    values: np.ndarray  # (2 n + 2,)
    rates: np.ndarray  # (2 n + 2,)
    slopes: np.ndarray  # (2 n + 2, 2 n + 1 + m)


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
    The unknowns are y = (s_0, z_0, ..., s_k, z_k [, xi], parameters), equation (39), with states z = (u, v) after each event, and their
    times s as fractions of the period; without harmonic loads the flight times take the place of s. A node that begins a chatter is that
    before its first impact. See `states`, `instants`, `flight_times` and `flights`.
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
        self.located = self.released[:1]
        self.load_periods, self.half = load_periods, half
        layout = parametric.layout
        self.has_clock = bool(layout.harmonics)
        self._require_determined()
        self.degrees_of_freedom = n = system.degrees_of_freedom
        rows = parametric.program(self.released).rows
        self.varies = len(rows) > 0 and int(rows[0]) < layout.stiffness.stop
        count = len(self.released)
        self.size = size = 2 * n
        self.coordinates = size + 2 + count
        self.modes = modes = system.modes
        self.events = events = self._events()
        self.sequence = tuple(event.symbol for event in events) or self.sequence
        first = layout.restitution.start
        changing = [row - first for row in rows.tolist() if row in range(layout.size)[layout.restitution]]
        require_bounces(system, events, self.has_clock, changing)
        self.contacts = np.array(self._contacts([event.contact for event in events]))
        self.inner = len(self.contacts) - 2
        self.unfolds, self.quarters, *kinds = self._closure()
        self.kinds: tuple[int, int] = (kinds[0], kinds[1])
        self.end_rows = self._end_rows()
        self.closing = (-1.0 if half else 1.0, (0.5 if half else 1.0) * self.has_clock)
        self.unknowns = (self.inner + 1) * (size + 1) + int(self.unfolds) + count
        self.place = self.unknowns - count
        nodes = self.inner + 2
        self.gap, self.rate, self.side = np.zeros((nodes, size)), np.zeros((nodes, size)), np.zeros(nodes)
        self.entries_of_nodes = np.full((nodes, 2), -1, dtype=np.int64)
        releases = [event.is_release for event in (*events[1:], *events[:1], *events[:1])] if events else [False] * nodes
        for i, contact in enumerate(self.contacts.tolist()):
            if contact >= 0 and not releases[i]:
                stop = int(modes.contact_stop[contact])
                self.gap[i, :n] = self.rate[i, n:] = system.stops[stop].gap
                self.side[i] = modes.contacts.side[contact]
                bounds = layout.upper if self.side[i] > 0.0 else layout.lower
                self.entries_of_nodes[i] = bounds.start + stop, layout.restitution.start + stop
        self.impacts = np.flatnonzero([not event.is_release for event in events])  # nodes
        constant = range(layout.size)[layout.constant]
        self.has_constant_loads = bool(
            np.any(parametric.entries(self.values)[layout.constant]) or any(row in constant for row in rows.tolist())
        )
        self.units = units = forced_metric(self)
        if self.is_smooth:
            self.smooth_forces = parametric.smooth_forces(self.values, self.released)
        bouncing = [*changing, *(stop for stop, one in enumerate(system.stops) if one.restitution > 0.0)]
        gaps = np.array([stop.gap for stop in system.stops]).reshape(-1, n)
        # Contact forces are in units of length: accelerations of their gaps over the square of the fastest frequency.
        lengths = (units[0] / units[n]) ** 2 * np.einsum("si,is->s", gaps, np.linalg.solve(system.mass, gaps.T))
        self.contact_modes = ModeTable(system, events, nodes, lengths, self.is_smooth, bouncing)
        needed = count if self.conserved else count - 1
        if len(keep) != needed:
            raise ValueError(f"{count} released parameters need {needed} equations to keep; received {len(keep)}")
        self.keep = tuple(keep)
        parametric.equations(self.keep, self.released, self.conserved, 0)  # what cannot be read is refused
        self.tangent_size = (3 if self.is_smooth else 2) * self.unknowns

    @cached_property
    def core(self) -> Any:
        """The problem in the core."""
        return core_problem(self)

    @cached_property
    def push(self) -> np.ndarray:
        """What an impact at each node adds to a state, for each unit of speed (k + 2, 2 n), with the masses at `values`."""
        return self.contact_modes.pushes(self.system, self.contact_modes.made, self.gap)

    located: tuple[str, ...]
    """The released parameters whose domains' ends are located: steps can go beyond them."""

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
        return (self.why_not_flown(y) or None) if found is None and self.is_smooth else found

    def why_not_flown(self, y: np.ndarray) -> str:
        """Where and why a flight of y with smooth forces cannot be computed; empty where all can."""
        flight, path = self.core.failure(_numbers(y))
        assert self.smooth_forces is not None or path is None
        called = self.smooth_forces is not None and self.smooth_forces.is_called
        return "" if path is None else f"flight {flight + 1} of an orbit: {why_not_complete(path, called)}"

    def _contacts(self, hit: Sequence[int]) -> list[int]:
        """The contact at each node after the first one, then that at the first; -1: none."""
        if not hit:
            return [-1] * (self.pieces + 1)
        # The last impact of the segment is the first of the orbit, or its mirror image.
        return [*hit[1:], int(self.modes.contact_opposite[hit[0]]) if self.half else hit[0], hit[0]]

    def _closure(self) -> tuple[bool, int, int, int]:
        """How the segment closes: whether with a kick, quarter periods solved, kinds of its ends."""
        return False, 4, PERIODIC, PERIODIC

    def _end_rows(self) -> np.ndarray:
        """The rows of the end conditions."""
        return np.zeros((0, 2 * self.degrees_of_freedom))

    def sibling(self, sequence: Sequence[str], **changes: Any) -> ForcedProblem:
        """The problem with another sequence. changes: keywords of the constructor that differ."""
        options = {"load_periods": self.load_periods, "half": self.half, "values": self.values, "keep": self.keep}
        options["pieces"] = 1 if sequence else self.pieces
        return ForcedProblem(self.parametric, sequence, self.released, **{**options, **changes})

    @property
    def is_undamped(self) -> bool:
        """Whether the system has linear springs and no dampers, and no stop sticks."""
        layout, rows = self.parametric.layout, self.parametric.program(self.released).rows
        varies = np.isin(rows, range(layout.size)[layout.damping]).any()
        return not (self.is_smooth or varies or self.system.damping.any()) and len(self.contact_modes.made) == 1

    def modes_at(self, at: tuple[float, ...], entries: np.ndarray) -> tuple[list[ForcedMode], np.ndarray]:
        """The contact modes at values of all parameters, whose entries are known, and the masses."""
        system, made = self.contact_modes.modes_at(at, lambda values: self._system_at(entries))
        require_pressing(system, self.events)
        return made, system.mass

    def _system_at(self, entries: np.ndarray) -> ImpactSystem:
        """The linear system with the masses, dampers and springs of some entries."""
        layout, n = self.parametric.layout, self.degrees_of_freedom
        mass, damping, stiffness = (entries[part].reshape(n, n) for part in (layout.mass, layout.damping, layout.stiffness))
        return ImpactSystem(mass, damping, stiffness, self.system.stops)

    def locate_domains(self, names: Sequence[str]) -> None:
        """Let steps go beyond the domains of these released parameters, by default of the first one: test functions locate their ends."""
        self.located = tuple(names)
        self.__dict__.pop("core", None)

    def position(self, y: np.ndarray) -> np.ndarray:
        """The first node in the coordinates of arclength, (2 n + 2 + m,)."""
        found: np.ndarray = self.core.course(_numbers(y), np.zeros(self.unknowns))[0]
        return found

    def mirrored(self, symbol: str) -> str:
        """A symbol of the sequence at the opposite contact of its stop."""
        letters, opposite = self.modes.contact_letters, self.modes.contact_opposite
        letter = symbol.rstrip(CLOSES + OPENS)
        return letters[int(opposite[letters.index(letter)])] + symbol[len(letter) :]

    # -- unknowns -------------------------------------------------------------------------------------------------------------

    def pack(self, states: ArrayLike, fractions: ArrayLike, parameters: ArrayLike, flight_times: ArrayLike | None = None) -> np.ndarray:
        """Unknowns y (u,) from the states (u, v) where flights begin (k + 1, 2 n), their times as fractions of the period, ascending,
        (k + 1,), and the released parameters (m,). Without a clock the flight times (k + 1,) take the place of the fractions. With them a
        chatter begins where the flight before it ends."""
        y = np.zeros(self.unknowns)
        nodes, y[self.place :] = self.rows(y), parameters
        nodes[:, 1:] = states
        nodes[:, 0] = fractions if self.has_clock or flight_times is None else flight_times
        chatters = np.flatnonzero(self._begins_behind_chatter()).tolist() if self.contact_modes.sums_chatter else []
        if chatters:
            begins, period, (sign, part) = nodes.copy(), self.period(y), self.closing
            ends = np.append(begins[1:, 0], begins[0, 0] + part)
            times = (ends - begins[:, 0]) * period if flight_times is None else np.asarray(flight_times, dtype=float)
            for i in chatters:
                before = [*begins[i - 1, 1:], begins[i - 1, 0]]
                found = self.core.fly(y[self.place :], (i - 1) % len(nodes), _numbers(before), float(times[i - 1]))[0]
                nodes[i, 1:], nodes[i, 0] = found[: self.size] * (sign if i == 0 else 1.0), found[self.size] - (part if i == 0 else 0.0)
        return y

    def rows(self, y: np.ndarray) -> np.ndarray:
        """Each node with its time first, (k + 1, 2 n + 1), a view of y."""
        return y[: (self.inner + 1) * (self.size + 1)].reshape(self.inner + 1, self.size + 1)

    def _begins_behind_chatter(self) -> np.ndarray:
        """Whether each flight begins behind a chatter, (k + 1,)."""
        return np.roll(self.contact_modes.summed[: self.inner + 1], 1) == 1

    def states(self, y: np.ndarray) -> np.ndarray:
        """The states (u, v) after each event, (k + 1, 2 n), a view of y."""
        return self.rows(y)[:, 1:]

    def instants(self, y: np.ndarray) -> np.ndarray:
        """Their times as fractions of the period, (k + 1,), a view of y; without a clock zeros."""
        return self.rows(y)[:, 0] if self.has_clock else np.zeros(self.inner + 1)

    def released_values(self, y: np.ndarray) -> np.ndarray:
        """The released parameters (m,), a view of y."""
        return y[self.place :]

    def nodes(self, y: np.ndarray) -> np.ndarray:
        """Where flights begin, behind a chatter: rows (u, v, s, parameters), (k + 1, 2 n + 1 + m)."""
        begins = np.column_stack([self.states(y), self.instants(y), np.tile(self.released_values(y), (self.inner + 1, 1))])
        if self.contact_modes.sums_chatter:
            # A chatter that begins without speed, where it vanishes, is not summed.
            found = self.core.flights(_numbers(y))[0]
            summed = self._begins_behind_chatter() & np.isfinite(found).all(axis=1)
            begins[summed, : self.size + 1] = found[summed]
        return begins

    def flight_times(self, y: np.ndarray) -> np.ndarray:
        """Flight times (k + 1,), without the chatter before them; without a clock a view of y."""
        times = self.rows(y)[:, 0]
        if not self.has_clock:
            return times
        begins = self.nodes(y)[:, self.size] if self.contact_modes.sums_chatter else times
        return (np.append(times[1:], times[0] + self.closing[1]) - begins) * self.period(y)

    def flights(self, y: np.ndarray) -> Flights:
        """All flights of y."""
        return Flights(*self.core.flights(_numbers(y)))

    def end_states(self, y: np.ndarray) -> np.ndarray:
        """State at the end of each flight, before the event there, (k + 1, 2 n)."""
        return self.flights(y).ends

    def cut(self, y: np.ndarray, count: int, part: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A part of an orbit without impacts, from its start, in flights of equal time: states (count, 2 n), fractions and flight times
        (count,), for `pack`."""
        nodes, lasting, size = self.nodes(y), self.flight_times(y), self.size
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
        return other, other.pack(states, fractions, self.released_values(y), times)

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
        """The state (u, v) and the fraction of the period to which a node (a row of `nodes`) flies as in a flight of the orbit."""
        size = self.size
        found = self.core.fly(_numbers(node[size + 1 :]), flight, _numbers(node[: size + 1]), float(time))[0]
        return found[:size], float(found[size])

    def flown(self, node: np.ndarray, time: float, flight: int, stop: int | None = None) -> Place:
        """The same place with its derivatives. stop: whose contact force is wanted, that sticks in the flight."""
        size, row = self.size, -1
        if stop is not None:
            row = int(force_rows(self)[self.contact_modes.mode[flight], stop])
        found = self.core.fly(_numbers(node[size + 1 :]), flight, _numbers(node[: size + 1]), float(time), row, True)
        return Place(found[0], found[1][:, 0], found[1][:, 1:])

    def gradient(self, y: np.ndarray, flight: int, by_node: np.ndarray, by_time: float = 0.0) -> np.ndarray:
        """The derivatives (u,) by the unknowns of a number whose derivatives are known by the begin of a flight (2 n + 1 + m,), as of
        `Place.slopes`, and by its duration."""
        size, found, rows = self.size, np.zeros(self.unknowns), self.inner + 1
        at = flight * (size + 1)
        by_node = np.array(by_node, dtype=float)
        if self.has_clock and by_time:
            # The duration is the difference of the times of the next node, and of the begin.
            period = self.period(y)
            begin = self.nodes(y)[flight, size]
            end = self.instants(y)[flight + 1] if flight + 1 < rows else self.instants(y)[0] + self.closing[1]
            slopes = self.parametric.derivatives(self.parameters(y), self.released)[self.parametric.layout.frequency][0]
            frequency = self.parametric.entries(self.parameters(y))[self.parametric.layout.frequency][0]
            by_node[size] -= by_time * period
            by_node[size + 1 :] -= by_time * (end - begin) * period / frequency * slopes
            found[(flight + 1) % rows * (size + 1)] += by_time * period
        if self._begins_behind_chatter()[flight]:
            by_begin = by_node[: size + 1] @ self.core.begin_slopes(_numbers(y), flight)
            by_node = np.concatenate([by_begin[: size + 1], by_begin[size + 1 :] + by_node[size + 1 :]])
        found[at + 1 : at + 1 + size] += by_node[:size]
        found[at] += by_node[size] if self.has_clock else by_time
        found[self.place :] += by_node[size + 1 :]
        return found

    def landed(self, y: np.ndarray, flight: int, state: np.ndarray) -> np.ndarray:
        """A state (u, v) after the impact that ends a flight, at the parameters of y."""
        values = self.parameters(y)
        entries = self.parametric.entries(values)
        made, mass = self.modes_at(tuple(values[name] for name in self.parametric.names), entries)
        row, kept = self.gap[flight, : self.degrees_of_freedom], made[self.contact_modes.kept[flight]]
        along = kept.inverse @ row if len(kept.rows) else np.linalg.solve(mass, row)
        rebound = 1.0 + entries[self.entries_of_nodes[flight, 1]] if self.entries_of_nodes[flight, 1] >= 0 else 1.0
        found = np.array(state, dtype=float)
        found[self.degrees_of_freedom :] -= along / (row @ along) * rebound * (row @ found[self.degrees_of_freedom :])
        return found

    def contact_force(self, node: np.ndarray, flight: int, contact: int) -> float:
        """The force of a contact that sticks in a flight of the orbit, at a node (a row of `nodes`), equation (43): positive where it
        presses."""
        size, stop = self.size, int(self.modes.contact_stop[contact])
        row = int(force_rows(self)[self.contact_modes.mode[flight], stop])
        return float(self.core.fly(_numbers(node[size + 1 :]), flight, _numbers(node[: size + 1]), 0.0, row)[0][size + 1])

    def parameters(self, y: np.ndarray) -> dict[str, float]:
        """All parameters at y."""
        return self.values | dict(zip(self.released, self.released_values(y).tolist(), strict=True))

    def restitution(self, y: np.ndarray, contact: int) -> float:
        """The restitution of a contact at y; 0 below rounding, as in the core."""
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
        return float(self.units[0])

    def speed(self, solution: Solution) -> float:
        """A typical speed of an orbit."""
        return float(self.scales(solution.y)[1 + self.degrees_of_freedom])

    def duration(self, solution: Solution) -> float:
        """A typical duration of its flights: the period."""
        return solution["quarter_period"]

    # -- equations ------------------------------------------------------------------------------------------------------------

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (u - 1,)."""
        found: np.ndarray = self.core.residual(_numbers(y))
        return found

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), dense (u - 1, u): for switching and for tests; Newton's steps use the block structure."""
        found: np.ndarray = self.core.jacobian(_numbers(y))
        return found

    def scales(self, y: np.ndarray) -> np.ndarray:
        """Typical size of each unknown at the orbit y, (u,)."""
        found: np.ndarray = self.core.scales(_numbers(y))
        return found

    @property
    def curvature_blocks(self) -> list[np.ndarray]:
        """Indices of the states, (k + 1) arrays. No second derivative of the equations is by states of two nodes."""
        width = self.size + 1
        return [np.arange(i * width + 1, (i + 1) * width) for i in range(self.inner + 1)]

    def second_derivative(self, y: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """F''(y)[a, b], (u - 1,): see `bvp.curvature.Curvature.second_along`."""
        found: np.ndarray = self.curvature.second_along(y, a) @ b
        return found

    @cached_property
    def curvature(self) -> Curvature:
        """The derivatives of higher order."""
        from bvp.curvature import Curvature

        return Curvature(self)

    # -- solution and step ----------------------------------------------------------------------------------------------------

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, *, maximum: int = 12) -> Solution | None:
        """Step by ds along the family from y with its tangent (see `Solution`; the end may be missing); None where Newton fails.

        With ds = 0, y itself is corrected (least norm) and its tangent turned like the one given (all zero: as it comes)."""
        out = self._empty()
        found = self.core.step(
            _numbers(y), _numbers(tangent), float(ds), maximum, True, out.y, out.tangent, out.position, out.ends, out.result
        )
        return out if found else None

    def _empty(self) -> Solution:
        """Arrays for a solution."""
        sizes = self.unknowns, self.tangent_size, self.coordinates, (self.inner + 1, self.size), len(RESULT_INDEX)
        return Solution(*[np.empty(size) for size in sizes])

    def scaled_residual(self, y: np.ndarray) -> float:
        """The largest residual at y, each in its own unit: of a solution below 1e-12."""
        out = self._empty()
        zero = np.zeros(2 * self.unknowns)
        self.core.step(_numbers(y), zero, 0.0, 0, False, out.y, out.tangent, out.position, out.ends, out.result)
        return out["residual"]

    def solve(self, y: np.ndarray) -> Solution:
        """Newton's solution near y at the parameter's value there.

        Raises
        ------
        NotConverged
            When the corrections do not shrink to rounding level.
        """
        out, row = self._empty(), np.zeros(self.unknowns)
        row[self.place] = 1.0
        target = float(y[self.place])
        found = self.core.correct(_numbers(y), row, target, 30, out.y, out.tangent, out.position, out.ends, out.result)
        if not found:
            raise NotConverged("Newton's corrections did not settle")
        self.core.observe(out.y, out.ends, out.result)
        return out

    def observed(self, y: np.ndarray, flights: Flights | None = None) -> np.ndarray:
        """What is seen of an orbit as it stands, named by `bvp.orbits.RESULT_INDEX`: its clearance, its slowest impact, and its shortest
        flight. flights: those that are looked at, where these are not all of the orbit's."""
        result = np.full(len(RESULT_INDEX), math.nan)
        shown = self.flights(y) if flights is None else flights
        self.core.observe_flights(_numbers(y), *map(_numbers, shown), result)
        return result

    def as_it_is(self, y: np.ndarray) -> Solution:
        """An orbit as it stands, with what its paths and impacts show: near a singular point Newton's method would move it."""
        flights = self.flights(y)
        result = self.observed(y, flights)
        result[RESULT_INDEX["quarter_period"]] = self.period(y)
        return Solution(np.array(y), np.zeros(2 * y.size), self.position(y), flights.ends, result)

    def impact_speeds(self, y: np.ndarray) -> np.ndarray:
        """Speed of approach at each node of an orbit y, in the order of the sequence, (k + 1,), 0 at releases; without impacts (0,)."""
        return np.roll(self.approach(self.end_states(y)), 1) if self.sequence else np.zeros(0)

    def approach(self, ends: np.ndarray) -> np.ndarray:
        """Speed of approach of the impact that ends each flight (k + 1,), from the states there."""
        n, nodes = self.degrees_of_freedom, self.inner + 1
        speeds: np.ndarray = self.side[:nodes] * np.sum(self.gap[:nodes, :n] * ends[:, n:], axis=1)
        return speeds

    def losses(self, y: np.ndarray) -> np.ndarray:
        """Kinetic energy lost at the impact that ends each flight of an orbit y, (k + 1,)."""
        n, (begins, _, ends) = self.degrees_of_freedom, self.flights(y)
        before, after = ends[:, n:], np.roll(begins[:, n : 2 * n], -1, axis=0)
        after[-1] *= self.closing[0]
        mass = self.parametric.entries(self.parameters(y))[self.parametric.layout.mass].reshape(n, n)
        lost: np.ndarray = 0.5 * np.einsum("ij,jk,ik->i", before - after, mass, before + after)
        return lost

    def growth(self, y: np.ndarray) -> float:
        """See `MultipointProblem.growth`."""
        found: float = self.core.growth(_numbers(y))
        return found

    def multipliers(self, y: np.ndarray) -> np.ndarray:
        """The 2 n multipliers of the stroboscopic map of an orbit y, by modulus descending; of half a period those of x -> -x over it.
        NaN where an impact grazes."""
        real, imaginary = self.core.multipliers(_numbers(y))
        found: np.ndarray = real + 1j * imaginary
        return found if np.isnan(found).any() else sort_multipliers(found)

    def period_multipliers(self, y: np.ndarray) -> np.ndarray:
        """Those of the map over the full period of the orbit."""
        return self.of_period(self.multipliers(y))

    def of_period(self, multipliers: np.ndarray) -> np.ndarray:
        """Multipliers of the full period from `multipliers` of the solved segment: of half a period their squares."""
        with np.errstate(over="ignore", invalid="ignore"):  # of those without bound
            return multipliers**2 if self.half else multipliers


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)
