"""The runs of one block: as many as possible in one compiled call, the others one by one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bvp.damped import BeyondStop, Mover
from bvp.motion import Batch, Motion, MotionStatus
from bvp.swift import CLEARED, DECLINED, FULL_COUNT, swift_numbers, swift_runs, with_restitution
from bvp.system import ImpactSystem
from transitions.sharing import Sharing, sharing_of
from transitions.study.endings import Ending
from transitions.study.plan import CLEAR, FRACTIONS, IMPULSIVE, Plan
from transitions.study.tail import spent_to_rest

__all__ = ["Starts", "block_columns", "results_of", "run_block"]

BALANCE = 1e-12
"""Error of the energy balance above which a run of the compiled call is done again by the general one."""

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
    _general(plan, made, descriptions, which, rho, states, leaving, out)
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


def _general(
    plan: Plan, made: list[_Made], descriptions: list[str], which: np.ndarray, rho: np.ndarray | None, states: np.ndarray,
    leaving: np.ndarray, out: dict[str, np.ndarray],
) -> None:  # fmt: skip
    """Fill in the runs that are left: those of one system together, but for starts on a stop."""
    groups: dict[tuple[int, float | None, str], list[int]] = {}
    for b in np.flatnonzero(out["ended"] == -1.0).tolist():
        groups.setdefault((int(which[b]), None if rho is None else float(rho[b]), str(leaving[b])), []).append(b)
    for (k, restitution, contact), runs in groups.items():
        plain = json.loads(descriptions[k])
        system = ImpactSystem.from_description(plain if restitution is None else {**plain, "rho": restitution})
        mover = Mover(system, list(plan.forces), made[k].sharing.dampers)
        if not contact:
            batch = mover.run_many(states[runs], plan.duration, plan.impacts, FRACTIONS, with_peaks=True)
            for i, b in enumerate(runs):
                _fill(plan, mover, made[k].sharing, _of_batch(batch, i), b, out)
            continue
        n = system.degrees_of_freedom
        for b in runs:
            try:
                motion = mover.run(states[b, :n], states[b, n:], plan.duration, plan.impacts, contact, FRACTIONS)
            except BeyondStop:
                out["ended"][b] = Ending.OUTSIDE.code
                continue
            _fill(plan, mover, made[k].sharing, _of_motion(motion), b, out)


class _Run(NamedTuple):
    """What is left of one general run; NaN for a time that there is none of."""

    status: MotionStatus
    duration: float
    impacts: int
    last_impact: float
    clear: bool
    held_time: float
    initial_energy: float
    energy: float
    totals: np.ndarray
    times: np.ndarray
    final: np.ndarray
    peaks: np.ndarray


def _of_batch(batch: Batch, i: int) -> _Run:
    assert batch.peaks is not None
    return _Run(
        batch.status[i], float(batch.duration[i]), int(batch.impacts[i]), float(batch.last_impact[i]), not np.isnan(batch.clear_from[i]),
        float(batch.held_time[i]), float(batch.initial_energy[i]), float(batch.energy[i]), batch.totals[i], batch.marks[i, :, 0],
        batch.final[i], batch.peaks[i],
    )  # fmt: skip


def _of_motion(motion: Motion) -> _Run:
    times = np.array([np.nan if mark.time is None else mark.time for mark in motion.marks] or [np.nan] * len(FRACTIONS))
    last = np.nan if motion.last_impact is None else motion.last_impact
    return _Run(
        motion.status, motion.duration, motion.impacts, last, motion.clear_from is not None, motion.held_time, motion.initial_energy,
        motion.energy, motion.totals, times, motion.final, motion.peaks,
    )  # fmt: skip


def _fill(plan: Plan, mover: Mover, sharing: Sharing, run: _Run, b: int, out: dict[str, np.ndarray]) -> None:
    """The results of one general run."""
    ended = _ending(plan, run)
    out["ended"][b] = ended.code
    if ended is Ending.OUTSIDE:
        return
    spent, energy = dict(zip(mover.parts, run.totals[:-1].tolist(), strict=True)), run.energy
    came = run.initial_energy if run.initial_energy > 0.0 else math.fsum([*spent.values(), energy])
    if ended is Ending.CLEAR:
        rest = spent_to_rest(mover.system, mover.dampers, run.final)
        if rest is not None:
            spent = {part: value + rest.get(part, 0.0) for part, value in spent.items()}
            energy = 0.0
    nes, lo = sharing.totals(spent)
    out["nes_share"][b], out["lo_share"][b] = (nes / came, lo / came) if came > 0.0 else (0.0, 0.0)
    for fraction, time in zip(FRACTIONS, run.times, strict=True):
        out[f"time_{round(100 * fraction)}"][b] = time
    out["impacts"][b], out["last_impact"][b] = run.impacts, run.last_impact
    for name, peak in zip(mover.system.coordinates, run.peaks, strict=True):
        out[f"peak_{name}"][b] = peak
    out["sticking_time"][b] = run.held_time
    out["duration"][b] = (run.last_impact if run.impacts else 0.0) if ended is Ending.CLEAR else run.duration
    balance = math.fsum([run.initial_energy, run.totals[-1], *(-value for value in spent.values()), -energy])
    out["balance_error"][b] = abs(balance) / came if came > 0.0 else abs(balance)


def _ending(plan: Plan, run: _Run) -> Ending:
    if run.status is not MotionStatus.DURATION_REACHED:
        return Ending[run.status.name]
    if plan.until != CLEAR:
        return Ending.DURATION
    return Ending.CLEAR if run.clear else Ending.LONGEST


def _narrow(out: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Counts and codes as whole numbers, in few bytes."""
    return {**out, "impacts": out["impacts"].astype(np.int32), "ended": out["ended"].astype(np.int8)}
