"""One periodic orbit, and the columns that describe many orbits: label, stability, multipliers and their accuracy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from branches.naming.labels import ImpossibleLabelError, Label
from bvp.checks import Frozen, read_only
from bvp.closures import ORIGIN, PERIODIC, STOP, Cycle, cycle_of
from bvp.dense import product
from bvp.multipliers import PAIRING_LIMIT, TRIVIAL_LIMIT, floquet_multipliers
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from bvp.stability import balance, decide, half_map_multipliers, roundings, stability
from bvp.system import ImpactSystem
from bvp.texts import brief

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Impact", "OfProblem", "Orbit", "impact_speeds", "label_at", "orbit_columns", "stacked"]

GRAZING = 1e-8
"""An impact slower than this, relative to sqrt(2 h), grazes: multipliers are unbounded there and given as NaN."""

AGREED = 1e-6
"""How well the traces of the half map and of the saddle-point matrix agree, relative, where both are to be trusted."""

FAR = 4.0
"""|tau|, or the modulus of a multiplier, beyond which an orbit is unstable if two methods agree. Beside a grazing the rounding of the
largest entry of the half map can cover the smaller ones, so the entries alone do not decide."""


class Impact(NamedTuple):
    """One impact: time in [0, T), the contact's letter, the speed of approach along the gap coordinate."""

    time: float
    stop: str
    speed: float


class OfProblem:
    """What an orbit and a family have from their problem."""

    problem: MultipointProblem

    @property
    def system(self) -> ImpactSystem:
        """The system it belongs to."""
        return self.problem.system

    @property
    def ends(self) -> tuple[str, str]:
        """Kinds of the two ends of each solved segment."""
        return self.problem.ends

    @property
    def sequence(self) -> str:
        """Contacts hit inside each solved segment."""
        return "".join(self.problem.sequence)


@brief
@dataclass(frozen=True, eq=False)
class Orbit(OfProblem):
    """A periodic orbit, an exact solution of its multipoint problem.

    Parameters
    ----------
    problem : MultipointProblem
    solution : Solution
        Its arrays cannot be written to.
    on_family : bool, optional
        Stability of the family between the events around the orbit, where it is known: it decides where the orbit alone does not.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> from bvp.multipoint import MultipointProblem
    >>> problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    >>> guess = problem.pack([0.0, 0.0, 0.9, 0.6], [], [1.7])
    >>> orbit = Orbit(problem, problem.solve(guess, quarter_period=1.7))
    >>> orbit.label, round(orbit.h, 12), orbit.stable
    ('S13O00+', 0.588748128566, True)
    """

    problem: MultipointProblem
    solution: Solution
    on_family: bool | None = field(default=None, kw_only=True)

    plot: ClassVar[Callable[..., Axes]]
    """The package `saltus` adds it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "solution", Solution(*(read_only(getattr(self.solution, item.name)) for item in fields(Solution))))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        stable = {True: "stable", False: "unstable", None: "stability undecided"}[self.stable]
        title = f"Orbit {self.label or '(no label)'}: {'-'.join(self.ends)}, sequence {self.sequence or '(none)'}"
        place = f"h = {self.h:.10g}, alpha = {self.alpha:.10g}, residual {self.residual:.1e}"
        largest = f"largest multiplier {max(map(abs, self.multipliers)):.6g}" if self.multipliers.size else "no nontrivial multipliers"
        return title, [("place", place), ("stability", f"{stable}, {largest}")]

    @cached_property
    def columns(self) -> Mapping[str, np.ndarray]:
        """What is known of the orbit, as `orbit_columns` of length 1."""
        return Frozen(orbit_columns(self.problem, [self.solution]))

    @property
    def label(self) -> str:
        """Label of the grammar, "" outside it."""
        return str(self.columns["label"][0])

    @property
    def h(self) -> float:
        """Energy."""
        return float(self.columns["h"][0])

    @property
    def alpha(self) -> float:
        """Quarter period T/4."""
        return float(self.columns["alpha"][0])

    @property
    def period(self) -> float:
        """Period T."""
        return 4.0 * self.alpha

    @property
    def residual(self) -> float:
        """Residual of the multipoint problem, scaled by the state."""
        return float(self.columns["residual"][0])

    @property
    def velocities(self) -> np.ndarray | None:
        """Initial velocities (n,) at zero displacement; None where the orbit does not start at an origin."""
        values = self.columns["velocities"][0]
        return None if np.isnan(values).any() else values

    @property
    def impact_speeds(self) -> np.ndarray:
        """Speeds of approach at the impacts of the solved segment, those at its ends included."""
        return self.columns["impact_speeds"][0]

    @property
    def multipliers(self) -> np.ndarray:
        """Nontrivial Floquet multipliers of the full period, (2 m,) complex for m pairs."""
        return self.columns["multipliers"][0]

    @property
    def tau(self) -> float:
        """Trace of the reduced full-period map (n = 2), NaN where unbounded or not defined."""
        return float(self.columns["tau"][0])

    @property
    def tau_half(self) -> float:
        """Trace of the reduced half map composed with u -> -u; NaN for orbits without half-period symmetry."""
        return float(self.columns["tau_half"][0])

    @property
    def stable(self) -> bool | None:
        """Whether it is linearly stable; None where neither it nor the family around it decides that by more than its own error."""
        code = int(self.columns["stable"][0])
        return self.on_family if code < 0 else bool(code)

    @property
    def quality(self) -> dict[str, Any]:
        """How well the multipliers keep what is known: trivial, pairing, reliable."""
        return {name: self.columns[name][0].item() for name in ("trivial", "pairing", "reliable")}

    @cached_property
    def cycle(self) -> Cycle:
        """The full period, impact by impact."""
        return cycle_of(self.problem, self.solution.y)

    @property
    def impacts(self) -> list[Impact]:
        """Impacts over one period in order of time."""
        cycle = self.cycle
        times = cycle.times[cycle.contact >= 0]
        return [Impact(float(t), s, float(v)) for t, s, v in zip(times, cycle.letters, cycle.speeds, strict=True)]

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (m, n) at any times (m,); at an impact the velocity is the one after it."""
        return self.cycle.sample(times)


def label_at(problem: MultipointProblem, result: Any) -> Label | None:
    """The label of an orbit from its result entries.

    None for an orbit outside the grammar (no origin start, no absorber named), and where a velocity that is zero to rounding contradicts
    the counts.
    """
    if problem.kinds[0] != ORIGIN or result[RESULT_INDEX["waves_absorber"]] < 0:
        return None
    m, n, p, q = (int(result[RESULT_INDEX[name]]) for name in ("waves_absorber", "waves_primary", "first_quarter", "second_quarter"))
    parity = {ORIGIN: None, STOP: "O"}.get(problem.kinds[1], "E")
    kind, sign = "U" if parity is None else "S", "+" if result[RESULT_INDEX["in_phase"]] == 1.0 else "-"
    try:
        # Without stops a label counts half-waves alone.
        return Label(kind, m, n, parity, p, q, sign) if problem.system.stops else Label(kind, m, n, sign=sign)
    except ImpossibleLabelError:
        return None


def stacked(solutions: Sequence[Solution]) -> Solution:
    """Many solutions of one problem as one whose arrays have a row for each."""
    names = ("y", "tangent", "position", "ends", "result")
    return Solution(*(np.array([getattr(solution, name) for solution in solutions]) for name in names))


def orbit_columns(
    problem: MultipointProblem, solutions: Sequence[Solution] | Solution, arclength: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """What is known of each orbit of a family: label, stability, multipliers, and how reliable they are.

    Parameters
    ----------
    problem : MultipointProblem
    solutions : sequence of N Solution, or those `stacked`
    arclength : (N,) float, optional
        0 by default.

    Returns
    -------
    dict of str to ndarray
        Columns of length N, see `branches.branch.Branch`.
    """
    rows = solutions if isinstance(solutions, Solution) else stacked(solutions)
    count, n, size = len(rows.y), problem.half, problem.size
    entry = dict(zip(RESULT_INDEX, rows.result.T, strict=True))
    starts = product(rows.y[:, : problem.parameters], problem.start_map.T) + problem.start_offset
    physical = product(starts, problem.modes.to_state.T)
    last = problem.parameters + problem.inner * (size + 1) + 1
    waves = np.maximum(entry["waves_absorber"].astype(int), 1)
    frequency = 2.0 * np.pi / (4.0 * entry["quarter_period"])
    speeds = impact_speeds(problem, starts, rows.ends)
    grazing = np.min(np.abs(speeds), axis=1, initial=np.inf) < GRAZING * np.sqrt(2.0 * entry["energy"])
    columns = {
        "h": entry["energy"],
        "alpha": entry["quarter_period"],
        "frequency": frequency,
        "frequency_index": waves * 2.0 * np.pi / (4.0 * entry["quarter_period"]),
        "arclength": np.zeros(count) if arclength is None else np.asarray(arclength, float),
        "label": np.array([str(label_at(problem, result) or "") for result in rows.result]),
        "half_waves": waves,
        "residual": entry["residual"],
        "start_u": physical[:, :n],
        "start_v": physical[:, n:],
        "velocities": physical[:, n:].copy() if problem.kinds[0] == ORIGIN else np.full((count, n), np.nan),
        "flight_times": rows.y[:, problem.parameters : last : size + 1].reshape(count, -1, problem.pieces).sum(axis=2),
        "impact_speeds": speeds,
    }
    if n == 2:
        return columns | _two_dof_stability(problem, rows.result, grazing, np.concatenate([starts[:, None], rows.ends], axis=1))
    return columns | _general_stability(problem, rows, grazing)


def impact_speeds(problem: MultipointProblem, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Speeds of approach (N, m) at the m impacts of a segment in order of time, those at its ends included, from the states at its start
    (N, 2 n) and at the end of each flight (N, k + 1, 2 n)."""
    side, rate, contact = problem.modes.contacts.side, problem.modes.contacts.rate, problem.contacts.tolist()
    hits = problem.inner + (problem.kinds[1] in (STOP, PERIODIC))
    speeds = [side[contact[i]] * product(ends[:, i], rate[contact[i]]) for i in range(hits) if contact[i] >= 0]
    if problem.kinds[0] == STOP:
        speeds.insert(0, -side[contact[-1]] * product(starts, rate[contact[-1]]))
    return np.array(speeds).reshape(-1, len(ends)).T


def _two_dof_stability(
    problem: MultipointProblem, results: np.ndarray, grazing: np.ndarray, states: np.ndarray
) -> dict[str, np.ndarray]:
    """Two degrees of freedom: everything is in the results; the states (N, k + 2, 4) give the units of the half map."""
    entry = dict(zip(RESULT_INDEX, results.T, strict=True))
    a, b, c, d = (entry[name] for name in "abcd")
    trace, trivial = entry["trace"], entry["trivial"]
    multipliers = np.empty((len(results), 2), complex)
    multipliers[:, 0] = entry["larger_real"] + 1j * entry["larger_imaginary"]
    multipliers[:, 1] = entry["smaller_real"] + 1j * entry["smaller_imaginary"]
    pairing = np.abs(entry["determinant"] - 1.0)
    tau_half = np.full(len(results), np.nan)
    if problem.quarters == 4:
        tau = trace
        error = roundings(problem.inner, entry["branching"]) * (1.0 + np.abs(trace)) + trivial + pairing
        stable = np.where(np.abs(tau) < 2.0 - error, 1, np.where(np.abs(tau) > 2.0 + error, 0, -1))
        agreed = np.ones(len(results), bool)
    else:
        tau = 2.0 + 4.0 * b * c
        if problem.quarters == 1:
            tau_half, tau = tau, tau * tau - 2.0
        if problem.hit:
            sizes = np.max(np.abs(states), axis=1)
            rate = np.max(sizes[:, 2:], axis=1) / np.max(sizes[:, :2], axis=1)
        else:  # its ends can be at rest or at the origin
            rate = np.pi / (2.0 * entry["quarter_period"])
        a, b, c, d = (value * factor for value, factor in zip((a, b, c, d), balance(problem, rate), strict=True))
        stable = decide(a, b, c, d, entry["magnified"], problem.inner, entry["branching"])
        agreed = np.abs(tau - trace) <= AGREED * (1.0 + np.abs(tau))
        stable = np.where((stable < 0) & agreed & (np.abs(tau) > FAR), 0, stable)
    if problem.drifts:
        stable = np.ones_like(stable)  # the only pair is that of the translation
    bounded = ~grazing & np.isfinite(trace)
    largest = np.maximum(1.0, np.abs(multipliers[:, 0]))
    return {
        "multipliers": np.where(bounded[:, None], multipliers, np.nan),
        "tau": np.where(bounded, tau, np.nan),
        "tau_half": np.where(bounded, tau_half, np.nan),
        "stable": np.where(bounded, stable, -1).astype(np.int8),
        "trivial": np.where(bounded, trivial, np.nan),
        "pairing": np.where(bounded, pairing, np.nan),
        "reliable": bounded & agreed & (trivial < TRIVIAL_LIMIT * largest) & (pairing < PAIRING_LIMIT),
    }


def _general_stability(problem: MultipointProblem, rows: Solution, grazing: np.ndarray) -> dict[str, np.ndarray]:
    """Any number of degrees of freedom: orbit by orbit."""
    count = len(rows.y)
    columns: dict[str, np.ndarray] = {name: np.full(count, np.nan) for name in ("tau", "tau_half", "trivial", "pairing")}
    columns["multipliers"] = np.full((count, 2 * problem.pairs), np.nan, complex)
    # Without nontrivial multipliers none grows at a grazing.
    columns["stable"] = np.full(count, -1 if problem.pairs else 1, np.int8)
    columns["reliable"] = np.full(count, problem.pairs == 0)
    for i in np.flatnonzero(~grazing):
        solution = Solution(rows.y[i], rows.tangent[i], rows.position[i], rows.ends[i], rows.result[i])
        if problem.is_smooth and not problem.periodic:
            values, defect = half_map_multipliers(problem, solution)
            pairing = float(np.max(np.abs(values * values[::-1] - 1.0), initial=0.0))
            found: tuple[Any, ...] = values, defect, pairing, defect < TRIVIAL_LIMIT and pairing < PAIRING_LIMIT
        else:
            of_cycle = floquet_multipliers(cycle_of(problem, solution.y))
            found = of_cycle.values, of_cycle.trivial, of_cycle.pairing, of_cycle.reliable
        for name, value in zip(("multipliers", "trivial", "pairing", "reliable"), found, strict=True):
            columns[name][i] = value
        stable = stability(problem, solution).stable
        if stable is None and columns["reliable"][i] and np.max(np.abs(columns["multipliers"][i]), initial=0.0) > FAR:
            stable = False
        columns["stable"][i] = -1 if stable is None else int(stable)
    return columns
