"""The runs of one block: as many as possible in one compiled call, the others one by one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bvp.damped import Mover
from bvp.motion import Motion, MotionStatus
from bvp.swift import CLEARED, DECLINED, FULL_COUNT, swift_numbers, swift_runs, with_restitution
from bvp.system import ImpactSystem
from transitions.extents import extents
from transitions.sharing import Sharing, sharing_of
from transitions.study.endings import Ending
from transitions.study.plan import CLEAR, FRACTIONS, IMPULSIVE, Plan
from transitions.study.tail import spent_to_rest

__all__ = ["Starts", "block_columns", "results_of", "run_block"]

BALANCE = 1e-12
"""Error of the energy balance above which a run of the compiled call is done again by the general one."""

KEPT = 16
"""Systems whose phases are kept."""

OF_MODEL = ("mu", "sigma", "lam")
"""Parameters that the modes depend on."""


class Starts(NamedTuple):
    """Where the runs of a block start that are on orbits.

    Attributes
    ----------
    states : (b, 2n) ndarray
        (u, v); NaN for the runs that start otherwise, or whose family has no orbit at their energy.
    leaving : (b,) ndarray of str
        The contact that the start has just left, "" for none.
    """

    states: np.ndarray
    leaving: np.ndarray


def results_of(plan: Plan) -> tuple[str, ...]:
    """The names of the results of each run, in natural units.

    h; nes_share and lo_share, of the initial energy; time_50, .. (NaN: not reached); impacts; last_impact (NaN: none); a peak for each
    coordinate; sticking_time; duration; balance_error, of the initial energy; ended, the code of an `Ending`.
    """
    names = ImpactSystem.from_description(plan.system).coordinates
    times = (f"time_{round(100 * fraction)}" for fraction in FRACTIONS)
    peaks = (f"peak_{name}" for name in names)
    return ("h", "nes_share", "lo_share", *times, "impacts", "last_impact", *peaks, "sticking_time", "duration", "balance_error", "ended")


def block_columns(plan: Plan) -> tuple[str, ...]:
    """The columns of a block: the varied parameters as "given.NAME", then the results."""
    return (*(f"given.{name}" for name in plan.names), *results_of(plan))


class _Made(NamedTuple):
    """A system with restitution as the scene has it, its shares, and its numbers for the compiled call (None where it has none)."""

    system: ImpactSystem
    sharing: Sharing
    numbers: np.ndarray | None


@lru_cache(maxsize=64)
def _made(description: str, nes: tuple[int, ...], lo: tuple[int, ...]) -> _Made:
    system = ImpactSystem.from_description(json.loads(description))
    sharing = sharing_of(system, nes, lo)
    return _Made(system, sharing, swift_numbers(system, sharing.dampers))


class _Movers:
    """Movers of the systems of a block, the last few of them kept."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._kept: dict[tuple[str, float | None], Mover] = {}

    def get(self, description: str, restitution: float | None, sharing: Sharing) -> Mover:
        """That of a system, with another restitution than the scene's where one is given."""
        key = (description, restitution)
        if key not in self._kept:
            plain = json.loads(description)
            system = ImpactSystem.from_description(plain if restitution is None else {**plain, "rho": restitution})
            if len(self._kept) >= KEPT:
                self._kept.clear()
            self._kept[key] = Mover(system, list(self._plan.forces), sharing.dampers)
        return self._kept[key]


def run_block(plan: Plan, given: Mapping[str, np.ndarray], starts: Starts | None = None) -> dict[str, np.ndarray]:
    """Run some of the runs of a plan.

    Parameters
    ----------
    plan : Plan
    given : mapping of str to (b,) ndarray
        The varied parameters of each (`Plan.values`).
    starts : Starts, optional
        For runs that start on the orbit of a family.

    Returns
    -------
    dict of str to (b,) ndarray
        The columns of `block_columns`; it depends on the arguments alone.
    """
    count = len(next(iter(given.values())))
    every = {**{key: np.full(count, value) for key, value in plan.fixed.items() if isinstance(value, float)}, **given}
    clearance = every.get("clearance", np.ones(count))
    scale = clearance if plan.units == "physical" else np.ones(count)
    model = [name for name in OF_MODEL if name in given]
    rho = given.get("rho")
    # Runs of one system stand together: its numbers are made once.
    distinct, which = np.unique(np.stack([given[name] for name in model] + [np.zeros(count)], axis=1), axis=0, return_inverse=True)
    which = which.ravel()
    plain = dict(plan.system) if rho is None else {**plan.system, "rho": 1.0}
    descriptions = [json.dumps({**plain, **dict(zip(model, map(float, row), strict=False))}) for row in distinct]
    made = [_made(description, plan.nes, plan.lo) for description in descriptions]
    states, energies, leaving = _states(plan, every, scale, made, which, starts)
    out = {name: np.full(count, np.nan) for name in results_of(plan)}
    out["h"] = energies
    there = np.isfinite(energies)
    out["impacts"], out["ended"] = np.zeros(count), np.where(there, -1.0, Ending.NO_ORBIT.code)
    if not plan.forces:
        _compiled(plan, made, which, rho, states, energies, there, out)
    movers = _Movers(plan)
    for b in np.flatnonzero(out["ended"] == -1.0).tolist():
        one = made[which[b]]
        mover = movers.get(descriptions[which[b]], None if rho is None else float(rho[b]), one.sharing)
        _one(plan, mover, one.sharing, states[b], str(leaving[b]), b, out)
    return {**{f"given.{name}": np.asarray(values) for name, values in given.items()}, **_narrow(out)}


def _states(
    plan: Plan, every: Mapping[str, np.ndarray], scale: np.ndarray, made: list[_Made], which: np.ndarray, starts: Starts | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The start of each run, (b, 2n), its energy, and the contact that it has just left."""
    count, n = len(which), made[0].system.degrees_of_freedom
    blow = np.zeros(n)
    blow[list(plan.lo)] = 1.0
    states, leaving = np.zeros((count, 2 * n)), np.full(count, "", dtype="<U2")
    if "impulse" in every:
        states[:, n:] = (every["impulse"] / scale)[:, None] * blow
    elif "energy" in every:
        masses = np.array([blow @ one.system.mass @ blow for one in made])
        states[:, n:] = np.sqrt(2.0 * every["energy"] / scale**2 / masses[which])[:, None] * blow
    if starts is not None:
        names = plan.families
        index = every["family"].astype(np.int64) if "family" in every else np.zeros(count, dtype=np.int64)
        on = np.array([name != IMPULSIVE for name in names])[index]
        states[on] = starts.states[on]
        leaving[on] = starts.leaving[on]
    mass, stiffness = (np.array([getattr(one.system, key) for one in made])[which] for key in ("mass", "stiffness"))
    u, v = states[:, :n], states[:, n:]
    energies = 0.5 * (np.einsum("bi,bij,bj->b", v, mass, v) + np.einsum("bi,bij,bj->b", u, stiffness, u))
    return states, energies, leaving


def _compiled(
    plan: Plan, made: list[_Made], which: np.ndarray, rho: np.ndarray | None, states: np.ndarray, energies: np.ndarray, there: np.ndarray,
    out: dict[str, np.ndarray],
) -> None:  # fmt: skip
    """Fill in the runs that the compiled call takes."""
    some = np.flatnonzero(there & np.array([one.numbers is not None for one in made])[which] & (energies > 0.0))
    if rho is not None:
        some = some[rho[some] > 0.0]
    if not len(some):
        return
    if rho is None:
        used, system = np.unique(which[some], return_inverse=True)
        table = np.array([made[k].numbers for k in used])
    else:
        pairs, system = np.unique(np.stack([which[some], rho[some]], axis=1), axis=0, return_inverse=True)
        table = np.array([with_restitution(_numbers(made[int(k)]), float(r)) for k, r in pairs])
    runs = swift_runs(
        table, system.ravel(), states[some], energies[some], duration=plan.duration, to_rest=plan.until == CLEAR,
        max_impacts=plan.impacts, fractions=FRACTIONS,
    )  # fmt: skip
    error = np.abs(runs.balance) / runs.initial_energy
    good = (runs.reason != DECLINED) & (error <= BALANCE)
    some, error = some[good], error[good]
    spent, reason = runs.dissipated[good] / energies[some, None], runs.reason[good]
    names = ("gaps", "rest", *(f"stop {stop.name}" for stop in made[0].system.stops))
    own = np.array([name in made[0].sharing.nes_parts for name in names])
    out["nes_share"][some], out["lo_share"][some] = spent[:, own].sum(axis=1), spent[:, ~own].sum(axis=1)
    for k, fraction in enumerate(FRACTIONS):
        out[f"time_{round(100 * fraction)}"][some] = runs.times[good, k]
    out["impacts"][some], out["last_impact"][some] = runs.impacts[good], runs.last_impact[good]
    for k, name in enumerate(made[0].system.coordinates):
        out[f"peak_{name}"][some] = runs.peaks[good, k]
    out["sticking_time"][some] = 0.0
    timed = Ending.LONGEST.code if plan.until == CLEAR else Ending.DURATION.code
    clear = (reason == CLEARED) & (plan.until == CLEAR)
    out["ended"][some] = np.where(clear, Ending.CLEAR.code, np.where(reason == FULL_COUNT, Ending.IMPACTS_FULL.code, timed))
    out["duration"][some] = np.where(clear, np.nan_to_num(runs.last_impact[good], nan=0.0), runs.duration[good])
    out["balance_error"][some] = error


def _numbers(made: _Made) -> np.ndarray:
    assert made.numbers is not None
    return made.numbers


def _one(plan: Plan, mover: Mover, sharing: Sharing, state: np.ndarray, leaving: str, b: int, out: dict[str, np.ndarray]) -> None:
    """Fill in one run of the general kind."""
    n = mover.system.degrees_of_freedom
    motion = mover.run(state[:n], state[n:], plan.duration, plan.impacts, leaving or None, FRACTIONS)
    ended = _ending(plan, motion)
    out["ended"][b] = ended.code
    if ended is Ending.OUTSIDE:
        return
    spent, energy = dict(motion.dissipated), motion.energy
    if ended is Ending.CLEAR:
        rest = spent_to_rest(mover.system, mover.dampers, motion.final)
        if rest is not None:
            spent = {part: value + rest.get(part, 0.0) for part, value in spent.items()}
            energy = 0.0
    came = motion.initial_energy if motion.initial_energy > 0.0 else math.fsum([*motion.dissipated.values(), motion.energy])
    nes, lo = sharing.totals(spent)
    out["nes_share"][b], out["lo_share"][b] = (nes / came, lo / came) if came > 0.0 else (0.0, 0.0)
    for mark in motion.marks:
        out[f"time_{round(100 * mark.fraction)}"][b] = np.nan if mark.time is None else mark.time
    out["impacts"][b] = motion.impacts
    out["last_impact"][b] = np.nan if motion.last_impact is None else motion.last_impact
    for name, peak in zip(mover.system.coordinates, extents(motion).peaks, strict=True):
        out[f"peak_{name}"][b] = peak
    out["sticking_time"][b] = motion.held_time
    out["duration"][b] = (motion.last_impact or 0.0) if ended is Ending.CLEAR else motion.duration
    balance = math.fsum([motion.initial_energy, motion.work, *(-value for value in spent.values()), -energy])
    out["balance_error"][b] = abs(balance) / came if came > 0.0 else abs(balance)


def _ending(plan: Plan, motion: Motion) -> Ending:
    if motion.status is not MotionStatus.DURATION_REACHED:
        return Ending[motion.status.name]
    if plan.until != CLEAR:
        return Ending.DURATION
    return Ending.LONGEST if motion.clear_from is None else Ending.CLEAR


def _narrow(out: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Counts and codes as whole numbers, in few bytes."""
    return {**out, "impacts": out["impacts"].astype(np.int32), "ended": out["ended"].astype(np.int8)}
