"""The runs of one block. Those of one linear system are one compiled call; motions with smooth forces are run one by one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from bvp.closures import contact_of
from bvp.forcing import Force
from bvp.motion import STATUS, MotionStatus
from bvp.simulate import BeyondStop, Simulator, energies_of, run_linear
from bvp.system import ImpactSystem
from transitions.sharing import Sharing, sharing_of
from transitions.study.plan import CLEAR, FRACTIONS, IMPULSIVE, StudyPlan

__all__ = ["Ending", "Starts", "block_columns", "results_of", "run_block", "spent_to_rest"]

OF_MODEL = ("mu", "sigma", "lam")
"""Parameters that the modes depend on."""


class Ending(Enum):
    """How a run ended; the text says it, and what to do next."""

    CLEAR = (0, "no impact is possible any more")
    DURATION = (1, "the duration was reached")
    LONGEST = (2, "impacts are still possible at the longest time; allow a longer one")
    IMPACTS_FULL = (3, MotionStatus.IMPACTS_FULL.value)
    SIMULTANEOUS = (4, MotionStatus.SIMULTANEOUS.value)
    OUTSIDE = (5, MotionStatus.OUTSIDE.value)
    UNDECIDED = (6, MotionStatus.UNDECIDED.value)
    EXHAUSTED = (7, MotionStatus.EXHAUSTED.value)
    NO_ORBIT = (8, "the starting family has no orbit at this energy; choose energies at which it has")
    PIERCED = (9, MotionStatus.PIERCED.value)
    UNRESOLVED = (10, MotionStatus.UNRESOLVED.value)

    def __init__(self, code: int, text: str) -> None:
        self.code = code
        self.text = text


class Starts(NamedTuple):
    """The starts on orbits of the runs of a block: states (b, 2n) u and v, NaN for a run that starts elsewhere or whose family has no orbit
    at its energy; and the contact (b,) that the start has just left, "" for none."""

    states: np.ndarray
    leaving: np.ndarray


def results_of(plan: StudyPlan) -> tuple[str, ...]:
    """The names of the results of each run, in natural units.

    h; nes_share and lo_share, of the initial energy; time_50, .. (NaN: not reached); impacts; last_impact (NaN: none); a peak for each
    coordinate; sticking_time; duration; balance_error, of the initial energy; ended, the code of an `Ending`.
    """
    times = (f"time_{round(100 * fraction)}" for fraction in FRACTIONS)
    peaks = (f"peak_{name}" for name in ImpactSystem.from_description(plan.system).coordinates)
    return ("h", "nes_share", "lo_share", *times, "impacts", "last_impact", *peaks, "sticking_time", "duration", "balance_error", "ended")


def block_columns(plan: StudyPlan) -> tuple[str, ...]:
    """The columns of a block: the varied parameters as "given.NAME", then the results."""
    return (*(f"given.{name}" for name in plan.names), *results_of(plan))


def run_block(plan: StudyPlan, given: Mapping[str, np.ndarray], starts: Starts | None = None) -> dict[str, np.ndarray]:
    """Run some of the runs of a plan: the columns of `block_columns`, (b,) each. They depend on the arguments alone.

    `given` are the varied parameters of each run (`StudyPlan.values`), `starts` the starts on the orbit of a family.
    """
    count = len(next(iter(given.values())))
    model = [name for name in OF_MODEL if name in given]
    rho = given.get("rho")
    # The numbers of a system are made once for all runs that share it.
    distinct, which = np.unique(np.stack([given[name] for name in model] + [np.zeros(count)], axis=1), axis=0, return_inverse=True)
    plain = dict(plan.system) if rho is None else {**plan.system, "rho": 1.0}
    descriptions = [json.dumps({**plain, **dict(zip(model, map(float, row), strict=False))}) for row in distinct]
    systems = [_system_of(description, plan.nes, plan.lo, tuple(plan.forces)) for description in descriptions]
    runs = _Runs(plan, systems, which.ravel(), rho, *_states(plan, given, systems, which.ravel(), starts), {})
    ended = np.where(np.isfinite(runs.energies), _WAITING, Ending.NO_ORBIT.code)
    runs.out.update({name: np.full(count, np.nan) for name in results_of(plan)})
    runs.out.update(h=runs.energies.copy(), impacts=np.zeros(count), ended=ended)
    (_run_linear if systems[0].system.smooth_forces is None else _run_smooth)(runs)
    runs.out.update(impacts=runs.out["impacts"].astype(np.int32), ended=runs.out["ended"].astype(np.int8))
    return {**{f"given.{name}": np.asarray(values) for name, values in given.items()}, **runs.out}


_WAITING = -1.0  # in place of the code of an ending, for a run that is not done


class _System(NamedTuple):
    """A system of the study, its description, its shares, and a simulator of its motions."""

    description: dict[str, Any]
    system: ImpactSystem
    sharing: Sharing
    simulator: Simulator


@lru_cache(maxsize=64)
def _system_of(description: str, nes: tuple[int, ...], lo: tuple[int, ...], forces: tuple[Force, ...]) -> _System:
    plain = json.loads(description)
    system = ImpactSystem.from_description(plain)
    sharing = sharing_of(system, nes, lo)
    return _System(plain, system, sharing, Simulator(system, list(forces), sharing.dampers))


@dataclass(frozen=True, eq=False)
class _Runs:
    """The runs of a block."""

    plan: StudyPlan
    systems: list[_System]
    which: np.ndarray  # (b,) the system of each run, apart from its restitution
    rho: np.ndarray | None  # (b,) the restitution; None if it does not vary
    states: np.ndarray  # (b, 2n) starts
    energies: np.ndarray  # (b,) NaN for none
    leaving: np.ndarray  # (b,) the contact that the start has just left
    out: dict[str, np.ndarray]  # the results, in the order of `results_of`

    def write(self, some: Any, *results: Any) -> None:
        """Write the results of one run or of several, in the order of `results_of`, without h."""
        for name, values in zip(tuple(self.out)[1:], results, strict=True):
            self.out[name][some] = values


def _states(
    plan: StudyPlan, given: Mapping[str, np.ndarray], systems: list[_System], which: np.ndarray, starts: Starts | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The start of each run, (b, 2n), its energy, and the contact that it has just left."""
    count, n = len(which), systems[0].system.degrees_of_freedom
    every = {**{key: np.full(count, value) for key, value in plan.fixed.items() if isinstance(value, float)}, **given}
    scale = every.get("clearance", np.ones(count)) if plan.units == "physical" else np.ones(count)
    direction = np.zeros(n)
    direction[list(plan.lo)] = 1.0
    states, leaving = np.zeros((count, 2 * n)), np.full(count, "", dtype="<U2")
    if "impulse" in every:
        states[:, n:] = (every["impulse"] / scale)[:, None] * direction
    elif "energy" in every:
        masses = np.array([direction @ one.system.mass @ direction for one in systems])
        states[:, n:] = np.sqrt(2.0 * every["energy"] / scale**2 / masses[which])[:, None] * direction
    if starts is not None:
        index = every["family"].astype(np.int64) if "family" in every else np.zeros(count, dtype=np.int64)
        on = np.array([name != IMPULSIVE for name in plan.families])[index]
        states[on] = starts.states[on]
        leaving[on] = starts.leaving[on]
    energies = np.empty(count)
    for k in np.unique(which):
        energies[which == k] = energies_of(systems[k].system, states[which == k])
    return states, energies, leaving


def _run_linear(runs: _Runs) -> None:
    """Do the runs of linear systems."""
    plan, until_clear = runs.plan, runs.plan.until == CLEAR
    waiting = runs.out["ended"] == _WAITING
    for k in np.unique(runs.which[waiting]).tolist():
        some, (_, system, sharing, simulator) = np.flatnonzero(waiting & (runs.which == k)), runs.systems[k]
        letters, initial = runs.leaving[some], runs.energies[some]
        contacts = {letter: contact_of(system, letter) if letter else -1 for letter in np.unique(letters).tolist()}
        summary, final, modal = run_linear(
            simulator.table, runs.states[some], initial, np.full(len(some), plan.impacts), plan.duration, np.array(FRACTIONS),
            restitution=None if runs.rho is None else runs.rho[some], leaving=np.array([contacts[letter] for letter in letters.tolist()]),
            with_peaks=True, to_rest=until_clear,
        )  # fmt: skip
        reason, time, impacts, _, last, clear_from, sticking, rested, _ = summary[:, :9].T
        parts = len(simulator.parts)
        spent, work = summary[:, 9 : 9 + parts].copy(), summary[:, 9 + parts]
        times = summary[:, 10 + parts : 10 + parts + len(FRACTIONS) * (parts + 2) : parts + 2]
        energy = np.where(rested > 0.0, 0.0, energies_of(system, final, modal))
        statuses = [STATUS[code] for code in reason.astype(int).tolist()]
        reached = np.array([status is MotionStatus.DURATION_REACHED for status in statuses])
        clear = reached & ~np.isnan(clear_from) & until_clear
        for b in np.flatnonzero(clear & ~(rested > 0.0)).tolist():
            rest = spent_to_rest(system, simulator.dampers, final[b])
            if rest is not None:
                spent[b] += [rest.get(part, 0.0) for part in simulator.parts]
                energy[b] = 0.0
        total = spent.sum(axis=1)
        incoming = np.where(initial > 0.0, initial, total + energy)
        whole = np.where(incoming > 0.0, incoming, 1.0)
        error = np.abs(initial + work - total - energy) / whole
        own = np.array([part in sharing.nes_parts for part in simulator.parts])
        over = Ending.LONGEST if until_clear else Ending.DURATION
        ended = [over if status is MotionStatus.DURATION_REACHED else Ending[status.name] for status in statuses]
        codes = np.where(clear, Ending.CLEAR.code, [ending.code for ending in ended])
        duration = np.where(clear, np.nan_to_num(last, nan=0.0), time)
        begun = codes != Ending.OUTSIDE.code
        runs.out["ended"][some] = codes
        runs.write(some[begun], *(column[begun] for column in (
            spent[:, own].sum(axis=1) / whole, spent[:, ~own].sum(axis=1) / whole, *times.T, impacts, last,
            *summary[:, summary.shape[1] - final.shape[1] // 2 :].T, sticking, duration, error, codes,
        )))  # fmt: skip


def _run_smooth(runs: _Runs) -> None:
    """Do the runs of systems with smooth forces. Runs of one system are done together, except starts on a stop."""
    plan, n = runs.plan, runs.systems[0].system.degrees_of_freedom
    groups: dict[tuple[int, float | None, str], list[int]] = {}
    for b in np.flatnonzero(runs.out["ended"] == _WAITING).tolist():
        restitution = None if runs.rho is None else float(runs.rho[b])
        groups.setdefault((int(runs.which[b]), restitution, str(runs.leaving[b])), []).append(b)
    for (k, restitution, contact), some in groups.items():
        description, system, sharing, simulator = runs.systems[k]
        if restitution is not None:
            system = ImpactSystem.from_description({**description, "rho": restitution})
            simulator = Simulator(system, list(plan.forces), sharing.dampers)
        if not contact:
            batch = simulator.run_many(runs.states[some], plan.duration, plan.impacts, FRACTIONS, with_peaks=True)
            for i, b in enumerate(some):
                row = SimpleNamespace(**{name: getattr(batch, name)[i] for name in _RESULTS})
                _write_smooth(runs, b, simulator, sharing, row, batch.marks[i, :, 0])
            continue
        for b in some:
            try:
                motion = simulator.run(runs.states[b, :n], runs.states[b, n:], plan.duration, plan.impacts, contact, FRACTIONS)
            except BeyondStop:
                runs.out["ended"][b] = Ending.OUTSIDE.code
                continue
            _write_smooth(runs, b, simulator, sharing, motion, [mark.time for mark in motion.marks])


_RESULTS = (
    "status", "duration", "impacts", "last_impact", "clear_from", "sticking_time", "initial_energy", "energy", "totals", "final", "peaks",
)  # fmt: skip
"""What is taken of a `Motion`, or of a row of a `Batch`."""


def _write_smooth(runs: _Runs, b: int, simulator: Simulator, sharing: Sharing, run: Any, times: Any) -> None:
    """Write the results of one run, a `Motion` or a row of a `Batch`. A missing time of a fraction is None or NaN."""
    if run.status is not MotionStatus.DURATION_REACHED:
        ended = Ending[run.status.name]
    elif runs.plan.until != CLEAR:
        ended = Ending.DURATION
    else:
        ended = Ending.LONGEST if run.clear_from is None or math.isnan(run.clear_from) else Ending.CLEAR
    if ended is Ending.OUTSIDE:
        runs.out["ended"][b] = ended.code
        return
    spent, energy = dict(zip(simulator.parts, run.totals[:-1].tolist(), strict=True)), run.energy
    incoming = run.initial_energy if run.initial_energy > 0.0 else math.fsum([*spent.values(), energy])
    if ended is Ending.CLEAR:
        rest = spent_to_rest(simulator.system, simulator.dampers, run.final)
        if rest is not None:
            spent = {part: value + rest.get(part, 0.0) for part, value in spent.items()}
            energy = 0.0
    shares = [value / incoming if incoming > 0.0 else 0.0 for value in sharing.totals(spent)]
    last_impact = math.nan if run.last_impact is None else run.last_impact
    duration = (last_impact if run.impacts else 0.0) if ended is Ending.CLEAR else run.duration
    balance = abs(math.fsum([run.initial_energy, run.totals[-1], *(-value for value in spent.values()), -energy]))
    error = balance / incoming if incoming > 0.0 else balance
    fractions = np.array(times, dtype=float)
    runs.write(b, *shares, *fractions, run.impacts, last_impact, *run.peaks, run.sticking_time, duration, error, ended.code)


def spent_to_rest(system: ImpactSystem, dampers: Mapping[str, Any], state: np.ndarray) -> dict[str, float] | None:
    """The energy that each damper dissipates in free motion from a state (2n,) to infinite time, without impacts; None if a part of the
    motion does not come to rest. `dampers` are parts (n, n) of the damping matrix.

    x' = A x; the integral of v'C v is x'P x with A'P + P A = -[0 0; 0 C] (Lyapunov).

    Examples
    --------
    All of the energy:

    >>> from bvp.system import vibro_impact_nes
    >>> system = vibro_impact_nes(lam=0.1)
    >>> round(spent_to_rest(system, {"all": system.damping}, np.array([0.0, 0.0, 0.0, 2.0]))["all"], 12)
    2.0
    """
    from scipy.linalg import solve_continuous_lyapunov

    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ system.stiffness, -inverse @ system.damping]])
    rates = np.linalg.eigvals(matrix)
    if not np.all(rates.real < -1e-9 * np.abs(rates).max()):
        return None
    out = {}
    for name, damper in dampers.items():
        taken = np.zeros((2 * n, 2 * n))
        taken[n:, n:] = 0.5 * (np.asarray(damper) + np.asarray(damper).T)
        out[name] = float(state @ solve_continuous_lyapunov(matrix.T, -taken) @ state) if np.any(taken) else 0.0
    return out
