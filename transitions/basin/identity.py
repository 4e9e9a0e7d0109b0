"""Attractors as continued families: a settled motion is solved as an orbit, and compared with those that are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from branches.admissible import unphysical
from branches.forced.branch import ForcedBranch
from branches.forced.identity import canonical_letters, closure_name, is_odd
from branches.forced.primitive import full_period, primitive_orbit
from bvp.closures import EndsError
from bvp.contact_sequence import joined_sequence
from bvp.forced import ForcedProblem
from bvp.motion import MotionStatus
from bvp.multipoint import NotConverged
from bvp.simulate import Simulator
from transitions.basin.record import Attractor, AttractorKind, FamilyOrbit, Saddle
from transitions.response.path import ParameterPath
from transitions.response.starting import NoOrbit, settled_orbit
from transitions.sweep.returns import largest_exponent
from transitions.sweep.settle import Settled, SettledKind

__all__ = [
    "attractor_of", "is_stable", "is_unstable", "mirrored", "mirrored_orbit", "named_by",
    "orbits_at", "saddle_of", "same_states", "states_later", "strobe_states",
]  # fmt: skip

SAME = 1e-6
"""Largest distance of two states at phase 0, beside the largest entry of both, with which two periodic motions are one."""

_STABLE = 1e-9
"""How far inside or outside the unit circle a multiplier certainly is."""

_AGREES = 1e-9
"""Largest relative difference of a parameter of a solved orbit from that of the basin."""

_ROUNDING = 1e-12
"""Part of a period that is rounding."""


def _family_name(problem: ForcedProblem, y: np.ndarray) -> str:
    """The beginning of the id of an orbit's family, `closure:sequence`: that of its primitive orbit."""
    primitive, _ = primitive_orbit(problem, y)
    return f"{closure_name(primitive)}:{canonical_letters(primitive)}"


def is_unstable(multipliers: np.ndarray) -> bool:
    """Whether one of them is certainly outside the unit circle."""
    return bool(np.all(np.isfinite(multipliers)) and np.abs(multipliers).max() > 1.0 + _STABLE)


def is_stable(multipliers: np.ndarray) -> bool:
    """Whether all of them are certainly inside the unit circle."""
    return bool(np.all(np.isfinite(multipliers)) and np.all(np.abs(multipliers) < 1.0 - _STABLE))


def strobe_states(problem: ForcedProblem, y: np.ndarray, phase: float = 0.0) -> np.ndarray:
    """The states (p, 2n) of an orbit at a phase of the loads, in each of its p periods; NaN where a stop is in the summed bounces before it
    sticks."""
    if problem.half:
        problem, y = full_period(problem, y)
    p, size, period = problem.load_periods, 2 * problem.degrees_of_freedom, problem.period(y)
    nodes, times = problem.nodes(y), problem.flight_times(y)
    found = np.full((p, size), math.nan)
    for k in range(p):
        at = (phase / (2.0 * math.pi) + k) / p
        for i, node in enumerate(nodes):
            later = (at - float(node[size])) % 1.0
            time = (later if later < 1.0 - _ROUNDING else 0.0) * period  # just before a node is at it
            if time <= times[i]:
                found[k] = problem.fly(node, time, i)[0]
                break
    return found


def same_states(one: np.ndarray, other: np.ndarray, slack: float = SAME) -> bool:
    """Whether two sets of states at phase 0, (p, 2n), are those of one periodic motion, begun in any of its periods."""
    if one.shape != other.shape:
        return False
    size = max(float(np.nanmax(np.abs(one), initial=0.0)), float(np.nanmax(np.abs(other), initial=0.0)), 1e-300)
    return any(bool(np.nanmax(np.abs(np.roll(one, k, axis=0) - other), initial=0.0) <= slack * size) for k in range(len(one)))


def states_later(path: ParameterPath, states: np.ndarray, time: float) -> np.ndarray:
    """The states (p, 2n) of motions that begin in some at phase 0, a time later; NaN where a simulation ends before."""
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    n, simulator = system.degrees_of_freedom, Simulator(system, list(forces))
    found = np.full(states.shape, math.nan)
    for k, state in enumerate(states):
        motion = simulator.run(state[:n], state[n:], time)
        if motion.status is MotionStatus.DURATION_REACHED:
            found[k] = motion.final
    return found


def mirrored(path: ParameterPath, states: np.ndarray, period: float) -> np.ndarray | None:
    """The states at phase 0, (p, 2n), of the mirror image x(t) -> -x(t + pi/w) of a periodic motion; None where the system is not odd, or
    an end of the simulation prevents it."""
    if not is_odd(path.problem(())):
        return None
    found = -states_later(path, states, 0.5 * period)
    return found if np.all(np.isfinite(found)) else None


def attractor_of(path: ParameterPath, settled: Settled) -> Attractor | None:
    """The attractor that a motion has settled to; None if it has not settled. A torus and chaos have one state yet.

    A periodic motion is solved as an orbit. Where that fails, the simulated one is taken, with a note."""
    sequence = joined_sequence(settled.stops) if settled.period else ""
    common = {
        "period": settled.period, "sequence": sequence, "states": settled.states, "sticking": settled.sticking,
        "multipliers": settled.multipliers, "exponent": settled.exponent,
    }  # fmt: skip
    if settled.kind in (SettledKind.TORUS, SettledKind.CHAOS):
        kind = AttractorKind.TORUS if settled.kind is SettledKind.TORUS else AttractorKind.CHAOS
        return Attractor(kind=kind, family=kind.value, **common)  # type: ignore[arg-type]
    if settled.kind is SettledKind.AT_REST or (settled.kind is SettledKind.PERIODIC and settled.sticking):
        family = f"sticking:{joined_sequence(settled.sticking)}"
        return Attractor(kind=AttractorKind.STICKING, family=family, **common)  # type: ignore[arg-type]
    if settled.kind is not SettledKind.PERIODIC:
        return None
    plain = Attractor(kind=AttractorKind.PERIODIC, family=f"period-{settled.period}:{sequence}", **common)  # type: ignore[arg-type]
    try:
        orbit = settled_orbit(path, settled)
    except NoOrbit as error:
        return replace(plain, note=str(error).rpartition("; ")[2])
    multipliers = orbit.problem.period_multipliers(orbit.y).astype(complex)
    exponent = plain.exponent
    if np.all(np.isfinite(multipliers)):
        exponent = largest_exponent(multipliers, settled.period * settled.period_of_loads)
    if not orbit.problem.sequence:  # the simulated states of a motion that decays to rest depend on its start
        plain = replace(plain, states=strobe_states(orbit.problem, orbit.y))
    return replace(
        plain, family=_family_name(orbit.problem, orbit.y), problem=orbit.problem, unknowns=orbit.y, multipliers=multipliers,
        exponent=exponent,
    )  # fmt: skip


def orbits_at(branches: Sequence[ForcedBranch], values: dict[str, float]) -> list[FamilyOrbit]:
    """The orbits of some branches at the values of all parameters: solved between the points on both sides.

    Raises
    ------
    ValueError
        If a branch has other values of a parameter there.
    """
    found: list[FamilyOrbit] = []
    for number, branch in enumerate(branches, 1):
        value = values[branch.name]
        off = branch.parameter - value
        for i in np.flatnonzero((off[:-1] * off[1:] <= 0.0) & (off[:-1] != off[1:])).tolist():
            part = off[i] / (off[i] - off[i + 1])
            guess = branch.unknowns[i] + part * (branch.unknowns[i + 1] - branch.unknowns[i])
            guess[branch.problem.place] = value
            try:
                solution = branch.problem.solve(guess)
            except NotConverged:
                continue
            at = branch.problem.parameters(solution.y)
            for name, wanted in values.items():
                if abs(at[name] - wanted) > _AGREES * max(abs(wanted), 1.0):
                    where = f"{branch.name} = {value:.10g}"
                    raise ValueError(f"branch {number} has {name} = {at[name]:.10g} at {where}, expected {wanted:.10g}")
            states = strobe_states(branch.problem, solution.y)
            known = any(one.branch == number and same_states(one.states, states) for one in found)
            if not known and unphysical(branch.problem, solution) is None:
                multipliers = branch.problem.period_multipliers(solution.y).astype(complex)
                id = branch.known_id or _family_name(branch.problem, solution.y)
                found.append(FamilyOrbit(id, number, states, multipliers, branch.problem, solution.y))
    return found


def named_by(path: ParameterPath, attractor: Attractor, orbits: Sequence[FamilyOrbit], period: float) -> Attractor:
    """The attractor with the family of the orbit that it is, or whose mirror image it is; as it was where there is none."""
    if attractor.kind is AttractorKind.PERIODIC and orbits:
        for image in (False, True):
            states = mirrored(path, attractor.states, period) if image else attractor.states
            same = [orbit for orbit in orbits if states is not None and same_states(orbit.states, states)]
            if same:
                return replace(attractor, family=same[0].family, branch=same[0].branch)
    return attractor


def saddle_of(problem: ForcedProblem, y: np.ndarray, phase: float, family: str | None = None, branch: int = 0) -> Saddle:
    """An unstable orbit as a saddle, with its states at a phase."""
    multipliers = problem.period_multipliers(y).astype(complex)
    return Saddle(family or _family_name(problem, y), branch, strobe_states(problem, y, phase), multipliers, problem, y)


def mirrored_orbit(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray] | None:
    """The mirror image x(t) -> -x(t + pi/w) of an orbit that is solved over its full period; None where there is none, or where the orbit
    is its own."""
    if problem.half or not problem.has_clock or not is_odd(problem):
        return None
    size = 2 * problem.degrees_of_freedom
    image = problem.sibling([problem.mirrored(symbol) for symbol in problem.sequence])
    nodes = problem.nodes(y)
    # Half a period of the loads earlier or later: one of both keeps the fractions in order, and no fraction has to be below 1.
    fractions = nodes[:, size] + 0.5 / problem.load_periods
    guess = image.pack(-nodes[:, :size], fractions, nodes[0, size + 1 :], problem.flight_times(y))
    try:
        return image, image.solve(guess).y
    except (NotConverged, EndsError):
        return None
