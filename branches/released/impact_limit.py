"""The impacting orbit at the limit of a family whose springs become stops: from the contacts of the last smooth orbit.

A contact is a turning point of a stiff spring at which its force exceeds all others. There the motion is turned as by a rigid wall at the
effective clearance of the contact (`bvp.stiff_springs`). In units of that clearance the smooth orbit is nearly an impacting one of another
energy. It is corrected there, and followed to its own energy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import saltus_core as core

from branches.admissible import unphysical
from branches.orbit import Orbit
from branches.order import in_tied_order
from branches.released.branch import ReleasedBranch
from bvp.closures import STOP, EndsError
from bvp.multipoint import MultipointProblem, NotConverged, Solution
from bvp.parameters import ParametricSystem
from bvp.stiff_springs import StiffSpring, stiff_limit
from bvp.system import ImpactSystem
from bvp.texts import brief

__all__ = ["NEAREST", "Contact", "ImpactLimit", "impact_limit", "impact_limits"]

NEAREST = 0.005
"""The least value of 1/n at which smooth orbits stand for the limit: the terms that are left out are of its square, 2.5e-5."""

_AT_END = 1e-9
"""Part of a flight within which a turning point is that at its begin or end: at rest a gap turns there to rounding."""

_CERTAIN = 10.0
"""How many times the other forces that of a contact is where the contact is certain."""

_ROUNDS, _SETTLED = 20, 1e-13
"""Most corrections of the effective clearance, each of which leaves about a hundredth of its error, and the last relative one."""

_ENERGIES = 9
"""Energies through which the impacting orbit is followed to its own."""


class Contact(NamedTuple):
    """A contact of a smooth orbit: its time in the solved segment, the letter of the stop that it becomes, its speed V, whether its force
    is ten times the others, and its state (2 n,), displacements and velocities."""

    time: float
    letter: str
    speed: float
    certain: bool
    state: np.ndarray


@brief
@dataclass(frozen=True, eq=False)
class ImpactLimit:
    """The impacting orbit to which a family leads.

    Parameters
    ----------
    orbit : Orbit
        At the limit, with the energy of the smooth orbit.
    smooth : Orbit
        The last smooth orbit.
    name, value : str, float
        The parameter that goes to zero, and its value at the smooth orbit.
    contacts : tuple of Contact
        Of the smooth orbit.
    clearance : float
        The effective clearance d, with the impact speeds of `scaled`; its mean over the impacts of a period.
    scaled : Orbit
        The impacting orbit with the energy h/d^2. Its quarter period is that of the smooth orbit but for terms of the order 1/n^2, where no
        other force depends on lengths and all contacts have one speed.
    """

    orbit: Orbit
    smooth: Orbit
    name: str
    value: float
    contacts: tuple[Contact, ...]
    clearance: float
    scaled: Orbit

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"ImpactLimit at {self.name} = 0", [("orbit", repr(self.orbit).splitlines()[0]), ("clearance", f"{self.clearance:.10g}")]


@lru_cache(maxsize=64)
def impact_limits(branch: ReleasedBranch) -> tuple[ImpactLimit | str, ...]:
    """The impacting orbits to which the ends of a branch lead, or why an end leads to none.

    A branch in 1/n leads to them where it was followed to the least value `NEAREST`.
    """
    if not branch.name.startswith("1/") or branch.interval[0] != NEAREST:
        return ()
    found: list[ImpactLimit | str] = []
    for i in {0, len(branch) - 1}:
        if abs(branch.parameter[i] - NEAREST) < 1e-9:
            try:
                values = branch.problem.parameters(branch.unknowns[i])
                found.append(impact_limit(branch.problem.parametric, branch.name, branch.orbit(i), values))
            except (EndsError, NotConverged) as error:
                found.append(str(error))
    return tuple(found)


def impact_limit(parametric: ParametricSystem, name: str, orbit: Orbit, values: dict[str, float]) -> ImpactLimit:
    """The impacting orbit at the limit 0 of a parameter, from a smooth orbit near it.

    Parameters
    ----------
    parametric : ParametricSystem
        With the parameter `name`, such as 1/n.
    orbit : Orbit
        Of the system at `values`.

    Raises
    ------
    EndsError
        If no spring becomes a stop, and for an orbit without contacts.
    NotConverged
        If no impacting orbit was found.
    """
    system, springs = stiff_limit(parametric, name, values)
    if system is None:
        raise EndsError(f"no spring becomes a stop at {name} = 0: expected a power that grows without bound there")
    contacts = tuple(_contacts(orbit, system, springs))
    if not contacts:
        raise EndsError(f"the orbit at {name} = {values[name]:.6g} has no contact: it is the same at {name} = 0")
    clearance = float(np.mean([_spring(contact.letter, system, springs).clearance(contact.speed) for contact in contacts]))
    limit, guess = _guess(orbit, system, springs, contacts, clearance)
    where = f"at the limit {name} = 0, {'-'.join(limit.ends)}, sequence {''.join(limit.sequence) or '(none)'}"
    try:
        solution, clearance = _at_clearance(limit, guess, clearance, orbit.h, springs)
        solutions = [solution]
        for energy in np.geomspace(orbit.h / clearance**2, orbit.h, _ENERGIES)[1:].tolist():
            solutions.append(limit.solve(solutions[-1].y, energy=energy))
    except NotConverged as error:
        slow = [contact for contact in contacts if not contact.certain]
        more = f"; {len(slow)} of {len(contacts)} contacts are slow, so a grazing may be near" if slow else ""
        raise NotConverged(f"no impacting orbit was found {where}: {error}{more}") from None
    scaled, last = (Orbit(limit, limit.orbit_at(one.y)) for one in (solutions[0], solutions[-1]))
    for one in (scaled, last):
        why = unphysical(limit, one.solution)
        if why is not None:
            raise NotConverged(f"the solution {where} is no orbit: {why}")
    return ImpactLimit(last, orbit, name, values[name], contacts, clearance, scaled)


def _at_clearance(
    limit: MultipointProblem, guess: np.ndarray, clearance: float, energy: float, springs: Sequence[StiffSpring]
) -> tuple[Solution, float]:
    """The impacting orbit with the energy h/d^2, and d: the mean effective clearance at d times its impact speeds, theory (48).

    The turning point of a contact is nearly enough for a first d. The work of the other forces during the contact changes its speed.
    """
    for _ in range(_ROUNDS):
        solution = limit.solve(guess, energy=energy / clearance**2)
        found = [
            _spring(impact.stop, limit.system, springs).clearance(clearance * impact.speed)
            for impact in Orbit(limit, solution).impacts
            if _stop(impact.stop, limit.system) >= len(limit.system.stops) - len(springs)
        ]
        change, clearance, guess = float(np.mean(found)) / clearance - 1.0, float(np.mean(found)), solution.y
        if abs(change) < _SETTLED:
            return limit.solve(guess, energy=energy / clearance**2), clearance
    raise NotConverged(f"the effective clearance changes by {abs(change):.1e} still")


def _letter(system: ImpactSystem, stop: int, side: float) -> str:
    """The contact of a stop on one side."""
    modes = system.modes
    return modes.contact_letters[int(np.flatnonzero((modes.contact_stop == stop) & (modes.contacts.side == side))[0])]


def _stop(letter: str, system: ImpactSystem) -> int:
    """The number of the stop of a contact."""
    return int(system.modes.contact_stop[system.modes.contact_letters.index(letter)])


def _spring(letter: str, system: ImpactSystem, springs: Sequence[StiffSpring]) -> StiffSpring:
    """The spring of a contact. The stops that springs become are the last ones of the limit."""
    return springs[_stop(letter, system) - len(system.stops)]


def _contacts(orbit: Orbit, limit: ImpactSystem, springs: Sequence[StiffSpring]) -> Iterator[Contact]:
    """The contacts of a smooth orbit in the solved segment, in order of time."""
    problem, y = orbit.problem, orbit.solution.y
    system, modes, flight = problem.system, problem.modes, problem.orbits.flight
    n, first = system.degrees_of_freedom, len(system.stops)
    starts, times = [problem.start(y), *problem.nodes(y)], problem.flight_times(y)
    begins = np.concatenate([[0.0], np.cumsum(times)])
    rows = [np.concatenate([spring.row, np.zeros(n)]) @ modes.to_state for spring in springs]
    for i, (z, duration) in enumerate(zip(starts, times.tolist(), strict=True)):
        path = core.path(flight, np.ascontiguousarray(z), duration)
        # A closed orbit ends where it starts, and a flight where the next one does.
        edges = [0.0, duration] if i == problem.inner and not problem.periodic else [0.0]
        found: list[tuple[float, Contact]] = []
        for k, (spring, gap) in enumerate(zip(springs, rows, strict=True)):
            derivatives = np.array([gap @ np.linalg.matrix_power(modes.matrix, order) for order in (1, 2, 3)])
            turns = path.crossings(derivatives)
            if turns is None:
                raise NotConverged(f"the turning points of a spring could not be found in flight {i + 1}")
            near = _AT_END * duration
            for time in [*(time for time in turns.tolist() if near < time < duration - near), *edges]:
                state, change = path.motion(time)
                w, bend = float(gap @ state), float(derivatives[0] @ change)
                if time in edges and abs(float(derivatives[0] @ state)) > near * abs(bend):
                    continue
                push, side = spring.force(w) / spring.mass, 1.0 if w > 0.0 else -1.0
                others = abs(bend + side * push)
                if push > others:
                    certain, place = push > _CERTAIN * others, modes.to_state @ state
                    found.append((time, Contact(float(begins[i]) + time, _letter(limit, first + k, side), spring.speed(w), certain, place)))
        yield from (contact for _, contact in in_tied_order(found, lambda one: one[0], lambda one: one[1].letter))


def _guess(
    orbit: Orbit, system: ImpactSystem, springs: Sequence[StiffSpring], contacts: Sequence[Contact], clearance: float
) -> tuple[MultipointProblem, np.ndarray]:
    """The problem of the impacting orbit, and unknowns near it, in units of the effective clearance."""
    smooth, y = orbit.problem, orbit.solution.y
    old, modes, n = smooth.modes, system.modes, system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)

    def known(contact: int) -> str:
        return _letter(system, int(old.contact_stop[contact]), float(old.contacts.side[contact]))

    def behind(contact: Contact) -> np.ndarray:
        """The state (2 n,) after the impact."""
        spring, of = _spring(contact.letter, system, springs), modes.contact_letters.index(contact.letter)
        along = inverse @ spring.row * spring.mass  # moves w by 1
        u, v = contact.state[:n] / clearance, contact.state[n:] / clearance
        speed = float(modes.contacts.side[of]) * contact.speed / clearance
        return np.concatenate([u + along * (modes.contacts.bound[of] - spring.row @ u), v - along * speed])

    *times, total = np.cumsum(smooth.flight_times(y)).tolist()
    nodes = [(node @ old.to_state.T) / clearance for node in smooth.nodes(y)]
    impacts = [
        (time, known(int(contact)), node) for time, contact, node in zip(times, smooth.contacts, nodes, strict=False) if contact >= 0
    ]
    ends = [end if kind != STOP else f"stop{known(int(smooth.contacts[smooth.inner + 1 - k]))}"
            for k, (end, kind) in enumerate(zip(smooth.ends, smooth.kinds, strict=True))]  # fmt: skip
    begin, start = 0.0, (smooth.start(y) @ old.to_state.T) / clearance
    if smooth.periodic and smooth.sequence:
        impacts.append((begin, known(int(smooth.contacts[smooth.inner])), start))
    for contact in contacts:
        if contact.time == begin and not smooth.periodic:
            ends[0], start = f"stop{contact.letter}", behind(contact)
        elif contact.time == total:
            ends[1] = f"stop{contact.letter}"
        else:
            impacts.append((contact.time, contact.letter, behind(contact)))
    impacts.sort(key=lambda one: one[0])
    problem = MultipointProblem(system, (ends[0], ends[1]), [name for _, name, _ in impacts])
    if smooth.periodic:  # it starts at its first impact
        (begin, _, start), *impacts = impacts
    flights = np.diff([begin, *(time for time, _, _ in impacts), begin + total])
    states = np.array([state for _, _, state in impacts]).reshape(len(impacts), 2 * n) @ modes.from_state.T
    return problem, problem.pack(modes.from_state @ start, states, flights)
