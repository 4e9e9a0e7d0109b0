"""Contact modes: the free motion, and the motion while some of the stops stick. All use the same flight kernels.

While the stops S stick, their gaps w_S = c_S . u are constant, and u = T r + U w_S with T a basis of c_S u = 0 and
U = M^-1 c' (c M^-1 c')^-1: the reduced motion T'MT r'' + T'CT r' + T'KT r = T'(f - K U w_S) has one degree of freedom less for each
sticking stop. Kinetic energy keeps r and w apart. These gaps and the loads are states y' = S y of their own. With X S - B X = G,
z = z~ + X y takes z' = B z + G y to z~' = B z~: the particular solution is X y. Where it would be large beside the gaps - a load at
resonance, or on a coordinate that hardly resists - the difference z - X y would cancel, and the block and the load share one larger block
instead, whose exponential has no such limit.

The contact force of a sticking stop is a linear function of the state. It takes the place of the contact's distance: the stop releases
at the next zero of the force.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import saltus_core

from bvp.blocks import Blocks, exact_product, traceless
from bvp.checks import EPSILON
from bvp.dense import inner, orthonormal, product, solve
from bvp.forcing import BudgetTerms, Forcing
from bvp.kernels.contact_mode import ContactModes
from bvp.modes import balanced, modal_impulse, reduced_blocks, two_parts

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["ContactModeTable", "contact_mode_of"]

NEVER = 1e300
"""Bound of a gap that cannot be reached."""


def contact_mode_of(system: ImpactSystem, sticking: int, forcing: Forcing, terms: BudgetTerms) -> dict[str, np.ndarray]:
    """The mode in which the contacts of the bits of `sticking` stick.

    Returns
    -------
    dict of ndarray
        The arrays of `bvp.kernels.contact_mode.ContactModes` from `pairs` to `second`, without their first dimension, for N states Z.
        (u, v) = leave Z, and Z = enter (u, v, y), where velocities across a gap that is constant are dropped. `to_modes` and `from_modes`
        are the same for the modal coordinates (q, p) of the system without dampers and stops, u = Phi q and v = Phi p. In these a motion
        goes from mode to mode: a free translation of any size is one of them, and takes no digits from the others. `push` is 0 while a
        contact sticks.

    Raises
    ------
    RuntimeError
        Where an eigenvalue iteration does not converge, or the gaps of sticking stops depend on each other.
    """
    n = system.degrees_of_freedom
    modes = system.modes
    contacts = [c for c in range(len(modes.contacts.side)) if sticking >> c & 1]
    rows = np.array([system.stops[modes.contact_stop[c]].gap for c in contacts]).reshape(-1, n)
    k = len(contacts)
    inverse_rows = solve(system.mass, rows.T)
    compliance = product(rows, inverse_rows)
    if k and np.linalg.cond(compliance) > 1e12:
        raise RuntimeError("stops stick whose gaps depend on each other")
    basis = orthonormal(rows.T)[:, k:] if k else np.eye(n)
    basis = np.where(np.abs(basis) <= 8.0 * n * EPSILON, 0.0, basis)
    lift = solve(compliance, inverse_rows.T).T if k else np.zeros((n, 0))
    blocks, left = _blocks(system, basis, k)
    m = n - k
    loads = np.concatenate([np.zeros((k, m, 2)), np.einsum("nm,gnk->gmk", basis, forcing.loads)])
    noise = product(np.abs(basis).T, np.abs(system.stiffness), np.abs(lift))
    frozen = product(basis.T, system.stiffness, lift)
    loads[:k, :, 0] = -np.where(np.abs(frozen) <= 8.0 * n * EPSILON * noise, 0.0, frozen).T
    frequency = np.concatenate([np.zeros(k), forcing.frequency])
    bounds = [abs(modes.contacts.bound[c]) for c in contacts]
    sizes = np.concatenate([np.array([[bound, 0.0] for bound in bounds]).reshape(-1, 2), forcing.sizes])
    layout = join(system, blocks, basis, loads, frequency, sizes)
    size = len(layout.matrix)
    reduced = np.zeros((2 * n, 2 * m))
    reduced[:n, :m] = reduced[n:, m:] = basis
    loaded, fixed = 2 * len(forcing.loads), np.array(layout.load_states[:k], dtype=int)
    leave = product(reduced, layout.position)
    leave[:n, fixed] += lift
    down = np.zeros((2 * m, 2 * n))
    down[:m, :n] = down[m:, n:] = left
    none = np.zeros((2 * m, loaded))
    shapes, weights = np.kron(np.eye(2), modes.shapes), np.kron(np.eye(2), product(modes.shapes.T, system.mass))
    levels = np.zeros((2, 2 * k + loaded, 2 * n + loaded))  # y of the sticking stops and loads, from (u, v, y) and from (q, p, y)
    levels[0, : 2 * k : 2, :n], levels[1, : 2 * k : 2, :n] = rows, exact_product(rows, modes.shapes)
    levels[:, 2 * k :, 2 * n :] = np.eye(loaded)
    enter = product(layout.states, np.hstack([product(blocks.from_state, down), none])) + product(layout.loads, levels[0])
    to_modes = product(_snapped(exact_product(weights, reduced, blocks.to_state)), layout.inside)
    to_modes[:n, fixed] += exact_product(weights[:n, :n], lift)
    from_modes = np.hstack([_snapped(exact_product(blocks.from_state, down, shapes)), none])
    from_modes = product(layout.states, from_modes) + product(layout.loads, levels[1])
    outer = np.zeros((loaded, size))
    for g, begin in enumerate(layout.load_states[k:]):
        outer[2 * g, begin] = outer[2 * g + 1, begin + 1] = 1.0
    gap, rate = np.zeros((len(modes.contacts.side), size)), np.zeros((len(modes.contacts.side), size))
    acceleration = np.zeros_like(gap)
    side, bound = modes.contacts.side.copy(), modes.contacts.bound.copy()
    closed = {int(modes.contact_stop[c]) for c in contacts}
    press = solve(compliance, _free_acceleration(system, inverse_rows, forcing, to_modes, outer)) if k else gap[:0]
    for c in range(len(side)):
        if c in contacts:
            gap[c] = side[c] * press[contacts.index(c)]
            rate[c] = product(gap[c], layout.matrix)
            acceleration[c] = product(rate[c], layout.matrix)
            side[c], bound[c] = -1.0, 0.0
        elif int(modes.contact_stop[c]) in closed or not _moves(system, rows, modes.contact_stop[c]):
            side[c], bound[c] = 1.0, NEVER
        else:
            row = np.array(system.stops[modes.contact_stop[c]].gap)
            modal = exact_product(row, modes.shapes)
            gap[c] = np.where(exact_product(modal, to_modes[:n]) == 0.0, 0.0, product(row, leave[:n]))
            rate[c] = np.where(exact_product(modal, to_modes[n:]) == 0.0, 0.0, product(row, leave[n:]))
            acceleration[c] = product(rate[c], layout.matrix)
    push, push_rest = np.zeros_like(gap), np.zeros_like(gap)
    for c in range(len(side)):
        if c not in contacts and bound[c] != NEVER:
            participation = exact_product(np.array(system.stops[modes.contact_stop[c]].gap), basis, blocks.shapes)
            jump = product(blocks.shapes, participation) / inner(participation, participation)
            clear = exact_product(from_modes[:, n : 2 * n], weights[n:, n:], basis, jump) == 0.0
            push[c] = balanced(np.where(clear, 0.0, product(enter[:, n : 2 * n], product(basis, jump))), rate[c])
            exact = None if k else modal_impulse(system, modes, product(rate[c], layout.states))
            if exact is not None:
                near, rest = two_parts(exact)
                push[c], push_rest[c] = product(layout.states, near), product(layout.states, rest)
    second = product(terms.velocity, leave[n:])
    first = np.where((terms.load < 0)[:, None], second, outer[terms.load] if len(outer) else second)
    arrays = {
        **{"pairs": layout.pairs, "mean": layout.mean, "delta": layout.delta, "matrix": layout.matrix},
        **{"leave": leave, "enter": enter, "to_modes": to_modes, "from_modes": from_modes},
        **{"gap": gap, "rate": rate, "acceleration": acceleration, "side": side, "bound": bound},
        **{"push": push, "push_rest": push_rest, "first": first, "second": second},
    }
    return {name: np.ascontiguousarray(array + 0) for name, array in arrays.items()}


def _blocks(system: ImpactSystem, basis: np.ndarray, count: int) -> tuple[Blocks, np.ndarray]:
    """The blocks of the reduced system and the map r = left u; the free system keeps its own modes."""
    if not count:
        return system.modes, np.eye(len(basis))
    mass, damping = (product(basis.T, matrix, basis) for matrix in (system.mass, system.damping))
    stiffness = exact_product(basis.T, system.stiffness, basis)
    m = len(mass)
    if not m:
        none = np.zeros((0, 0))
        return Blocks("uncoupled", none, np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0), none, none, none), basis.T
    blocks = reduced_blocks(system, basis, mass, damping, stiffness)
    return blocks, solve(0.5 * (mass + mass.T), product(basis.T, system.mass))


def _free_acceleration(
    system: ImpactSystem, inverse_rows: np.ndarray, forcing: Forcing, to_modes: np.ndarray, outer: np.ndarray
) -> np.ndarray:
    """Rows of c_S . M^-1 (f - C v - K u), which the sticking stops have to take away."""
    shapes = system.modes.shapes
    stiffness, damping = exact_product(system.stiffness, shapes), exact_product(system.damping, shapes)
    stiffness = np.where(system.modes.squares == 0.0, 0.0, stiffness)
    pull = exact_product(inverse_rows.T, np.hstack([stiffness, damping]))
    force = -exact_product(pull, to_modes)
    if len(outer):
        force = force + product(exact_product(inverse_rows.T, np.concatenate(list(forcing.loads), axis=1)), outer)
    return force


def _snapped(matrix: np.ndarray) -> np.ndarray:
    """The matrix with entries within rounding of -1, 0 or 1 set to exactly these. A state that is transformed to the free mode and back
    then keeps its value exactly."""
    nearest = np.round(matrix)
    return np.where((np.abs(matrix - nearest) <= 16.0 * len(matrix) * EPSILON) & (np.abs(nearest) <= 1.0), nearest, matrix)


def _moves(system: ImpactSystem, rows: np.ndarray, stop: int) -> bool:
    """Whether the gap of a stop can still change while the stops with the gap rows `rows` stick."""
    if not len(rows):
        return True
    row = np.array(system.stops[stop].gap)
    left = row - product(np.linalg.lstsq(rows.T, row, rcond=None)[0], rows)
    return bool(np.abs(left).max() > 1e-12 * np.abs(row).max())


class ContactModeTable:
    """The contact modes of a system under its loads that a run has met so far, stacked for the kernels. A run adds a mode when it first
    enters it."""

    def __init__(self, system: ImpactSystem, forcing: Forcing, terms: BudgetTerms) -> None:
        self.system, self.forcing, self.terms = system, forcing, terms
        self.modes = {0: self._mode(0)}

    def _mode(self, sticking: int) -> dict[str, np.ndarray]:
        return contact_mode_of(self.system, sticking, self.forcing, self.terms)

    def add(self, sticking: int) -> None:
        """Add the contact mode in which the contacts of the bit set `sticking` stick."""
        self.modes[sticking] = self._mode(sticking)
        self.__dict__.pop("stacked", None)
        if "_in_core" in self.__dict__:
            _ = self.core

    @property
    def core(self) -> saltus_core.ContactModes:
        """The contact modes as the compiled core has them, each in its own size and all in the same order. `add` adds to them, and what an
        interrupt has left out is made up for."""
        for sticking in list(self.modes)[len(self._in_core) :]:
            self._add_to_core(sticking)
        return self._in_core

    @cached_property
    def _in_core(self) -> saltus_core.ContactModes:
        """Those that the core has so far: at first none."""
        every = self._of_all
        levels = every["levels"]
        coordinates, dampers, stops = every["shape"].tolist()
        return saltus_core.ContactModes(
            coordinates, dampers, stops, every["contact_mass"], np.array(every["contact_stop"], dtype=np.int64),
            np.array(self.terms.part, dtype=np.int64), np.array(every["frequency"], dtype=float), np.array(every["breaks"], dtype=float),
            np.ascontiguousarray(levels[:, :, 0]), np.ascontiguousarray(levels[:, :, 1]),
        )  # fmt: skip

    def _add_to_core(self, sticking: int) -> None:
        mode, restitution = self.modes[sticking], np.array(self.system.modes.contacts.restitution, dtype=float)
        size = len(mode["matrix"])
        flight = saltus_core.LinearFlight(*(mode[name] for name in ("pairs", "mean", "delta", "matrix")), np.zeros(size))
        rows = (mode[name] for name in ("gap", "rate", "acceleration", "side", "bound", "push"))
        maps = (mode[name] for name in ("push_rest", "leave", "enter", "to_modes", "from_modes", "first", "second"))
        self._in_core.add(sticking, flight, saltus_core.Contacts(*rows, restitution), *maps, np.array(self.terms.weight, dtype=float))

    def entered(self, sticking: int, x: np.ndarray) -> np.ndarray:
        """The state of a contact mode from x = (u, v, y)."""
        z: np.ndarray = product(self.modes[sticking]["enter"], x)
        return z

    @cached_property
    def stacked(self) -> ContactModes:
        """All modes in arrays of one size, that of the largest mode. A smaller mode is padded with states that stay 0."""
        modes = list(self.modes.values())
        count = max(len(mode["pairs"]) for mode in modes)
        size = max(len(mode["matrix"]) + (len(mode["pairs"]) < count) for mode in modes)
        stacked = {}
        for name, first in modes[0].items():
            shape = list(first.shape)
            if name in ("pairs", "mean", "delta"):
                shape[0] = count
            if name in ("matrix", "enter", "from_modes"):
                shape[0] = size
            if name not in ("pairs", "mean", "delta", "enter", "from_modes", "side", "bound"):
                shape[-1] = size
            array = np.zeros((len(modes), *shape), dtype=first.dtype)
            if name == "pairs":  # a mode with fewer blocks gets blocks of size one that act on the last padded state only
                array[:] = size - 1, -1
            for k, mode in enumerate(modes):
                array[k][tuple(slice(length) for length in mode[name].shape)] = mode[name]
            stacked[name] = array
        return ContactModes(**stacked, **self._of_all, weight=self.terms.weight, part=self.terms.part)

    @property
    def _of_all(self) -> dict[str, np.ndarray]:
        """The arrays that the modes have in common, besides the terms of the budget."""
        contacts = self.system.modes
        reduced = np.array([1.0 / inner(row, solve(self.system.mass, row)) for row in (np.array(s.gap) for s in self.system.stops)])
        return {
            "sticking": np.array(list(self.modes), dtype=np.int64),
            "restitution": contacts.contacts.restitution,
            "contact_mass": reduced[contacts.contact_stop],
            "contact_stop": contacts.contact_stop,
            "frequency": self.forcing.frequency,
            "breaks": self.forcing.breaks,
            "levels": self.forcing.levels,
            "shape": np.array([len(self.system.mass), len(self.terms.dampers), len(self.system.stops)], dtype=np.int64),
        }


PARTICULAR_LIMIT = 30.0
"""Largest size of a particular solution that is split off, relative to the gaps and to the response far from resonance. A larger one would
lose digits in the difference z - X y."""

Group = list[tuple[int, np.ndarray]]
"""Loads with the factors (2, 2) by which they act, as of `_groups`."""


class Joined(NamedTuple):
    """Blocks joined with loads: Z = states z + loads y, z = inside Z, (r, r') = position Z; `load_states`: where the state of each load
    begins in Z."""

    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    inside: np.ndarray
    position: np.ndarray
    states: np.ndarray
    loads: np.ndarray
    load_states: list[int]


def join(
    system: ImpactSystem, blocks: Blocks, basis: np.ndarray, loads: np.ndarray, frequency: np.ndarray, sizes: np.ndarray
) -> Joined:
    """Combine the blocks with the loads. A load is split off by its particular solution if that is no larger than a few gaps; else the load
    and its block become one larger block. Of two real rates far apart the slow one alone joins it: a fast one follows each load."""
    m, count = basis.shape[1], len(loads)
    gaps = np.array([stop.gap for stop in system.stops])
    reach = np.array([max(abs(x) for x in (stop.lower, stop.upper) if np.isfinite(x)) for stop in system.stops])
    inverse = product(blocks.from_state[:, m:], blocks.shapes, blocks.shapes.T) if m else np.zeros((0, 0))
    drives = [exact_product(inverse, load) for load in loads]
    pieces: list[tuple[list[int], np.ndarray, np.ndarray, list[Group], list[np.ndarray], np.ndarray]] = []
    particular = np.zeros((2 * m, 2 * count))
    pace = _pace(system, frequency)
    whole = [[i, j] if j >= 0 else list(range(i, i - j)) for i, j in blocks.pairs]
    # A part of a block: its indices, the part's coordinates as columns and the rows that give them, and whether it is a fast rate.
    todo = [(index, np.eye(len(index)), np.eye(len(index)), False) for index in reversed(whole)]
    while todo:
        index, columns, rows, fast = todo.pop()
        own = product(rows, blocks.matrix[np.ix_(index, index)], columns)
        joined = []
        for g in range(count):
            drive = product(rows, drives[g][index])
            if not np.any(drive):
                continue
            solution = _sylvester(own, _generator(frequency[g]), drive)
            if solution is not None:
                moved = product(np.abs(product(gaps, basis, blocks.to_state[:m, index], columns, solution)), sizes[g])
                if fast or (np.all(moved <= PARTICULAR_LIMIT * reach) and _amplification(own, frequency[g]) <= PARTICULAR_LIMIT):
                    particular[np.ix_(index, [2 * g, 2 * g + 1])] += product(columns, solution)
                    continue
            joined.append(g)
        apart = _rates_apart(own, pace) if joined and len(own) == 2 else None
        if apart is not None:
            particular[index] = 0.0
            todo += [(index, apart[0][:, r : r + 1], apart[1][r : r + 1], r == 1) for r in range(2)]
            continue
        if joined:
            ratios = _ratios(own, pace)
            own, columns, rows = own * ratios[:, None] / ratios, columns / ratios, ratios[:, None] * rows
        groups = _groups(joined, frequency, [product(rows, drive[index]) for drive in drives])
        joint = np.zeros((len(own) + 2 * len(groups),) * 2)
        joint[: len(own), : len(own)] = own
        units = []
        for k, group in enumerate(groups):
            # The units of a block's load are powers of two, in which it moves the block at its own rates: bounds of a flight grow with
            # the largest entry. So are those of level and slope.
            lead = group[0][0]
            entries = np.array([1.0, 1.0 if frequency[lead] > 0.0 else 1.0 / pace])
            generator = _generator(frequency[lead]) * entries[:, None] / entries
            rate = max(np.abs(own).max(), np.abs(generator).max())
            drive = product(rows, drives[lead][index])
            units.append(entries * 2.0 ** float(np.round(np.log2(np.abs(drive / entries).max() / rate))))
            at = slice(len(own) + 2 * k, len(own) + 2 * k + 2)
            joint[: len(own), at] = drive / units[k]
            joint[at, at] = generator
        pieces.append((index, columns, rows, groups, units, joint))
    pieces += [([], np.eye(0), np.eye(0), [[(g, np.eye(2))]], [np.ones(2)], _generator(frequency[g])) for g in range(count)]
    size = sum(len(piece[-1]) for piece in pieces)
    matrix, inside = np.zeros((size, size)), np.zeros((2 * m, size))
    states, into = np.zeros((size, 2 * m)), np.zeros((size, 2 * count))
    pairs, load_states, start = [], [], 0
    for index, columns, rows, groups, units, joint in pieces:
        width, size = len(joint), len(rows)
        place = list(range(start, start + width)) if count else index
        pairs.append((place[0], place[1] if width == 2 else -width))
        matrix[np.ix_(place, place)] = joint
        inside[np.ix_(index, place[:size])] = columns
        states[np.ix_(place[:size], index)] = rows
        into[place[:size]] = product(-rows, particular[index])
        for k, group in enumerate(groups):
            for g, turn in group:
                into[place[size + 2 * k : size + 2 * k + 2], 2 * g : 2 * g + 2] = units[k][:, None] * turn
        if not index:
            load_states.append(start)
            own_load = groups[0][0][0]
            inside[:, place] += particular[:, 2 * own_load : 2 * own_load + 2]
        start += width
    layout = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    mean, delta = traceless(matrix, layout)
    return Joined(layout, mean, delta, matrix, inside, product(blocks.to_state, inside), states, into, load_states)


def _pace(system: ImpactSystem, frequency: np.ndarray) -> float:
    """The slowest natural frequency but 0, to a power of two; without one that of the loads; 1 if nothing has one.

    Bounds of a flight grow with it, so that a stiff spring or a strong damper elsewhere must not set it."""
    for rates in (np.sqrt(np.abs(system.modes.squares)), frequency):
        if np.any(rates > 0.0):
            return 2.0 ** float(np.round(np.log2(rates[rates > 0.0].min())))
    return 1.0


def _groups(joined: list[int], frequency: np.ndarray, drives: list[np.ndarray]) -> list[Group]:
    """Loads that act on a block as one: harmonic ones of one frequency along one direction are multiples of the strongest, which leads.

    A multiple is a complex number, as a matrix (2, 2) on the states of the load: a turn by the difference of the phases, and a factor."""
    groups: list[Group] = []
    for g in sorted(joined, key=lambda g: -float(np.abs(drives[g]).max())):
        own = drives[g] @ [1.0, -1.0j]
        for group in groups:
            lead = drives[group[0][0]] @ [1.0, -1.0j]
            factor = complex(np.vdot(lead, own) / np.vdot(lead, lead).real)
            same = frequency[g] == frequency[group[0][0]] > 0.0
            if same and np.abs(own - factor * lead).max() <= 4.0 * EPSILON * np.abs(own).max():
                group.append((g, np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])))
                break
        else:
            groups.append([(g, np.eye(2))])
    return groups


def _rates_apart(block: np.ndarray, pace: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The vectors of the slow and the fast rate of a 2 x 2 block, as columns, and their inverse; None where no real rate is fast beside the
    other and beside the pace."""
    (a, b), (c, d) = block
    mean, product = 0.5 * (a + d), a * d - b * c
    if not (2.0 * abs(product) < mean * mean and abs(mean) > PARTICULAR_LIMIT * pace):
        return None
    fast = mean + np.copysign(np.sqrt(mean * mean - product), mean)
    columns = [(b, rate - a) if abs(rate - a) >= abs(rate - d) else (rate - d, c) for rate in (product / fast, fast)]
    (p, q), (r, s) = (np.array(column) / np.abs(column).max() for column in columns)
    return np.array([[p, r], [q, s]]), np.array([[s, -r], [-q, p]]) / (p * s - q * r)


def _ratios(block: np.ndarray, pace: float) -> np.ndarray:
    """Powers of two that balance the two off-diagonal entries of a 2 x 2 block; if one of them is 0, the other is the pace."""
    if len(block) == 2 and block[0, 1] != 0.0 and block[1, 0] == 0.0:
        return np.array([1.0, 2.0 ** float(np.round(np.log2(abs(block[0, 1]) / pace)))])
    if len(block) != 2 or block[0, 1] == 0.0 or block[1, 0] == 0.0:
        return np.ones(len(block))
    return np.array([1.0, 2.0 ** float(np.round(0.5 * np.log2(abs(block[0, 1] / block[1, 0]))))])


def _generator(frequency: float) -> np.ndarray:
    """S of a load: a rotation, or level and slope."""
    return np.array([[0.0, -frequency], [frequency, 0.0]]) if frequency > 0.0 else np.array([[0.0, 1.0], [0.0, 0.0]])


def _sylvester(block: np.ndarray, generator: np.ndarray, drive: np.ndarray) -> np.ndarray | None:
    """X with X S - B X = G; None where B and S share an eigenvalue to rounding."""
    size = len(block)
    operator = np.kron(np.eye(size), generator.T) - np.kron(block, np.eye(2))
    try:
        inverse = np.linalg.inv(operator)
    except np.linalg.LinAlgError:
        return None
    # A condition number that does not change with units: the rates of one block can be far apart.
    if not np.abs(np.linalg.eigvals(np.abs(inverse) @ np.abs(operator))).max() <= 1e14:
        return None
    return np.linalg.solve(operator, drive.ravel()).reshape(size, 2)


def _amplification(block: np.ndarray, frequency: float) -> float:
    """How near a load is to resonance with a block: the largest ratio of a rate to its distance; 1 for loads that do not turn."""
    if frequency == 0.0:
        return 1.0
    rates = np.linalg.eigvals(block)
    return float((np.maximum(np.abs(rates), frequency) / np.maximum(np.abs(rates - 1j * frequency), np.finfo(float).tiny)).max())
