"""Loads f(t) of M u'' + C u' + K u = f(t), the terms of the energy budget (the power of each load and each damper), and synthetic
accelerograms.

A load is constant, harmonic, or a sampled record that is linear between its samples. Each is a fixed load times the state y of a small
linear system of its own, y' = S y, so a forced flight is a free flight of a larger system and needs no time step. Of a record, level and
slope are set anew at each sample; between samples its flight is exact.

A synthetic accelerogram is white noise through two filters of the ground, under an envelope. A layer of ground with frequency w_g and
damping z_g shakes as a(t) = -(2 z_g w_g x' + w_g^2 x), x'' + 2 z_g w_g x' + w_g^2 x = -n(t), for white noise n in the rock below (Kanai
1957, Tajimi 1960). A second filter, y'' + 2 z_f w_f y' + w_f^2 y = a, gives y''. It removes frequencies far below w_f, so that the
velocity does not drift (Clough & Penzien, Dynamics of Structures, 1975). The envelope rises as the square of time, stays constant, and
decays exponentially (Jennings, Housner & Tsai, 1968). The noise is constant over each step. For such noise the filters are exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import EPSILON, finite_numbers, is_finite, reals, require_system
from bvp.texts import brief, shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = [
    "BudgetTerms", "Constant", "Force", "Forcing", "Ground", "Harmonic", "Record", "budget_terms", "damping_across", "filtered",
    "forcing_of", "ground_load", "record_text", "split_damping", "synthetic_record",
]  # fmt: skip

@brief
@dataclass(frozen=True, eq=False)
class Constant:
    """A constant load, f = load.

    Parameters
    ----------
    load : (n,) array_like
        A force on each coordinate.
    """

    load: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "load", finite_numbers(self.load, "load", None))


@brief
@dataclass(frozen=True, eq=False)
class Harmonic:
    """A harmonic load, f = cosine cos(frequency t) + sine sin(frequency t).

    Parameters
    ----------
    frequency : float
        In radians a unit of time, > 0.
    cosine, sine : (n,) array_like, optional
        Forces on each coordinate; at least one is given, the other is zero.
    """

    frequency: float
    cosine: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sine: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not (is_finite(self.frequency) and self.frequency > 0.0):
            raise ValueError(f"frequency is a finite number above 0 (a load of frequency 0 is Constant); received {shown(self.frequency)}")
        parts = [finite_numbers(part, name, None) for name, part in (("cosine", self.cosine), ("sine", self.sine)) if np.size(part)]
        if not parts or len({len(part) for part in parts}) > 1:
            raise ValueError("a harmonic load has cosine, sine or both, of one length")
        zero = np.zeros(len(parts[0]))
        object.__setattr__(self, "cosine", zero if not np.size(self.cosine) else parts[0])
        object.__setattr__(self, "sine", zero if not np.size(self.sine) else parts[-1])


@brief
@dataclass(frozen=True, eq=False)
class Record:
    """A load with a sampled course, f = load s(t), with s linear between samples and 0 before the first and after the last of them.

    Parameters
    ----------
    load : (n,) array_like
        Force on each coordinate for s = 1.
    times, values : (k,) array_like
        Samples of s, k >= 2, at ascending times.
    """

    load: np.ndarray
    times: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        for name in ("load", "times", "values"):
            object.__setattr__(self, name, finite_numbers(getattr(self, name), name, None))
        if len(self.times) != len(self.values) or len(self.times) < 2:
            raise ValueError(f"a record has as many values as times, at least 2; received {len(self.values)} and {len(self.times)}")
        wrong = np.flatnonzero(np.diff(self.times) <= 0.0)
        if len(wrong):
            raise ValueError(f"the times of a record ascend; received {self.times[wrong[0]]:g} before {self.times[wrong[0] + 1]:g}")


Force = Constant | Harmonic | Record


def ground_load(system: ImpactSystem, direction: Any = None) -> np.ndarray:
    """Load (n,) of a unit acceleration of the ground, -M r, in displacements relative to the ground.

    Parameters
    ----------
    system : ImpactSystem
    direction : (n,) array_like, optional
        r, what each coordinate moves by where the structure moves by 1; ones by default.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> ground_load(vibro_impact_nes(mu=0.1))
    array([-0.1, -1. ])
    """
    require_system(system, smooth=True)
    r = finite_numbers(np.ones(system.degrees_of_freedom) if direction is None else direction, "direction", system.degrees_of_freedom)
    return -(system.mass @ r)


@dataclass(frozen=True, eq=False)
class Forcing:
    """All loads on a system: f(t) = sum_g loads[g] y_g(t), each y_g of two entries.

    Attributes
    ----------
    loads : (G, n, 2) ndarray
    frequency : (G,) ndarray
        Above 0: y = (cos, sin)(frequency t). 0: y = (level, slope), with level' = slope.
    breaks : (K,) ndarray
        Ascending, the first 0: instants at which levels and slopes are set anew.
    levels : (K, G, 2) ndarray
        Level and slope from each break on (zero for harmonics).
    sizes : (G, 2) ndarray
        Largest |y|.
    """

    loads: np.ndarray
    frequency: np.ndarray
    breaks: np.ndarray
    levels: np.ndarray
    sizes: np.ndarray


def forcing_of(forces: Any, n: int) -> Forcing:
    """The loads on a system of n coordinates from one load, a list of them or None; ValueError for anything else."""
    if forces is None:
        forces = ()
    if isinstance(forces, Constant | Harmonic | Record):
        forces = (forces,)
    if not isinstance(forces, Sequence) or not all(isinstance(force, Constant | Harmonic | Record) for force in forces):
        raise ValueError(f"forces is a list of Constant, Harmonic and Record loads; received {shown(forces)}")
    count = len(forces)
    records = [force for force in forces if isinstance(force, Record)]
    breaks = np.unique(np.concatenate([[0.0], *(record.times[record.times > 0.0] for record in records)]))
    loads, frequency = np.zeros((count, n, 2)), np.zeros(count)
    levels, sizes = np.zeros((len(breaks), count, 2)), np.ones((count, 2))
    for g, force in enumerate(forces):
        columns = [force.cosine, force.sine] if isinstance(force, Harmonic) else [force.load]
        for k, column in enumerate(columns):
            if len(column) != n:
                raise ValueError(f"a load has an entry for each of {n} coordinates; received {len(column)}")
            loads[g, :, k] = column
        if isinstance(force, Harmonic):
            frequency[g] = force.frequency
            continue
        sizes[g, 1] = 0.0
        if isinstance(force, Constant):
            levels[:, g, 0] = 1.0
            continue
        slopes = np.diff(force.values) / np.diff(force.times)
        at = np.searchsorted(force.times, breaks, side="right") - 1
        inside = (at >= 0) & (at < len(slopes))
        first = at[inside]
        levels[inside, g, 0] = force.values[first] + slopes[first] * (breaks[inside] - force.times[first])
        levels[inside, g, 1] = slopes[first]
        sizes[g] = np.abs(force.values).max(), np.abs(slopes).max()
    return Forcing(loads, frequency, breaks, levels, sizes)


@dataclass(frozen=True, eq=False)
class BudgetTerms:
    """The terms of the energy budget that a run sums over its flights: integrals of weight (a . y)(b . v) or weight (b . v)^2.

    Attributes
    ----------
    velocity : (R, n) ndarray
        b.
    load : (R,) int64 ndarray
        Index among the 2 G entries y of the loads, or -1 where the square of b . v is integrated.
    weight : (R,) ndarray
    part : (R,) int64 ndarray
        The sum that it goes to: 0 .. dampers - 1, then the stops, then the work of the loads.
    dampers : tuple of str
    """

    velocity: np.ndarray
    load: np.ndarray
    weight: np.ndarray
    part: np.ndarray
    dampers: tuple[str, ...]


def budget_terms(dampers: dict[str, np.ndarray], forcing: Forcing, stops: int) -> BudgetTerms:
    """The terms of named parts of the damping matrix and of the work of the loads; v'Cv goes by the eigenvectors of C's symmetric part."""
    rows: list[tuple[np.ndarray, int, float, int]] = []
    for k, matrix in enumerate(dampers.values()):
        values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        rounding = 8.0 * len(values) * EPSILON * np.abs(values).max()
        rows += [(vector, -1, value, k) for value, vector in zip(values, vectors.T, strict=True) if abs(value) > rounding]
    n = len(next(iter(dampers.values())))
    columns = forcing.loads.transpose(0, 2, 1).reshape(-1, n)
    rows += [(column, k, 1.0, len(dampers) + stops) for k, column in enumerate(columns) if np.any(column)]
    velocity, load, weight, part = zip(*rows, strict=True) if rows else ((), (), (), ())
    return BudgetTerms(
        np.array(velocity, dtype=float).reshape(-1, n),
        np.array(load, dtype=np.int64),
        np.array(weight, dtype=float),
        np.array(part, dtype=np.int64),
        tuple(dampers),
    )


def split_damping(system: ImpactSystem, dampers: Mapping[str, Any] | None = None) -> dict[str, np.ndarray]:
    """Split the damping matrix C into named parts: those given, or "gaps", the sum of the dampers across the gaps, and "rest".

    A gap between two coordinates, c = (.. a .. b ..), has the damper d c c' that explains the entry C_ij = d a b; one of a single
    coordinate, c = (.. a ..), the damper from there to the ground, a^2 d = sum_j C_ij. What would be negative, or is asymmetric, or belongs
    to a gap of more coordinates, stays with the rest.

    Raises
    ------
    ValueError
        If a given part has another shape, or the parts do not sum to C.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> split_damping(vibro_impact_nes(lam=0.01))["rest"]
    array([[0.  , 0.  ],
           [0.  , 0.01]])
    """
    damping = np.array(system.damping)
    if dampers is not None:
        parts = {str(name): reals(part) for name, part in dampers.items()}
        for name, part in parts.items():
            if part.shape != damping.shape or not np.all(np.isfinite(part)):
                raise ValueError(f"damper {name!r} is a finite matrix of shape {damping.shape}; received shape {part.shape}")
        total = sum(parts.values(), np.zeros_like(damping))
        residual = np.abs(total - damping)
        if np.any(residual > 1e-14 * np.abs(damping).max(initial=0.0)):
            i, j = np.unravel_index(int(np.argmax(residual)), residual.shape)
            raise ValueError(f"the dampers sum to the damping matrix; entry {i + 1},{j + 1} is {damping[i, j]:g}, theirs {total[i, j]:g}")
        return parts or {"all": total}
    gaps = damping_across(damping, [np.array(stop.gap) for stop in system.stops])
    return {"gaps": gaps, "rest": damping - gaps}


def damping_across(damping: np.ndarray, rows: Sequence[np.ndarray]) -> np.ndarray:
    """The part (n, n) of a damping matrix that dampers along the rows (n,) explain, as in `split_damping`."""
    gaps = np.zeros_like(damping)
    seen: list[np.ndarray] = []
    for row in rows:
        if any(abs(abs(row @ other) - np.linalg.norm(row) * np.linalg.norm(other)) <= 1e-12 * (row @ row) for other in seen):
            continue
        seen.append(row)
        at = np.flatnonzero(row)
        left = damping - gaps
        if len(at) == 2 and left[at[0], at[1]] == left[at[1], at[0]]:
            coefficient = left[at[0], at[1]] / (row[at[0]] * row[at[1]])
        elif len(at) == 1:
            coefficient = left[at[0]].sum() / row[at[0]] ** 2
        else:
            continue
        if coefficient > 0.0:
            gaps += coefficient * np.outer(row, row)
    return gaps


@brief
@dataclass(frozen=True)
class Ground:
    """The ground of a synthetic record: frequencies (rad/s) and damping ratios of two filters. The defaults are those of firm soil."""

    frequency: float = 15.0
    damping: float = 0.6
    low_frequency: float = 1.5
    low_damping: float = 0.6

    def __post_init__(self) -> None:
        _require_positive("the ground", **vars(self))


def _require_positive(what: str, **values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise ValueError(f"{name} of {what} is a finite number above 0; received {shown(value)}")


def filtered(noise: np.ndarray, step: float, ground: Ground) -> np.ndarray:
    """The acceleration (m,) at the times 0, step, ... of ground at rest at time 0, for noise (m,) that is constant over each step."""
    from scipy.signal import lsim

    w, z, v, y = ground.frequency, ground.damping, ground.low_frequency, ground.low_damping
    # states x, x', y, y'
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-w * w, -2.0 * z * w, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-w * w, -2.0 * z * w, -v * v, -2.0 * y * v],
        ]
    )
    inputs = np.array([[0.0], [-1.0], [0.0], [0.0]])
    return lsim((matrix, inputs, matrix[3:], np.zeros((1, 1))), noise, step * np.arange(len(noise)), interp=False)[1]


def synthetic_record(
    seed: int,
    *,
    duration: float = 20.0,
    step: float = 0.02,
    peak: float = 3.0,
    ground: Ground | None = None,
    rise: float = 2.0,
    decay_from: float = 8.0,
    decay: float = 3.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Times and accelerations of a synthetic record.

    Parameters
    ----------
    seed : int
        Seed of the noise. The same seed gives the same record.
    duration, step : float
        The record has a sample at 0, step, ..., duration.
    peak : float
        Largest acceleration.
    ground : Ground, optional
    rise, decay_from, decay : float
        The envelope is (t/rise)^2 up to `rise`, 1 up to `decay_from`, then exp(-(t - decay_from)/decay).

    Returns
    -------
    times, accelerations : (m,) ndarray

    Raises
    ------
    ValueError
        For values that are not finite and above 0, or a record of fewer than two samples.

    Examples
    --------
    >>> times, accelerations = synthetic_record(1)
    >>> len(times), float(times[-1]), float(abs(accelerations).max())
    (1001, 20.0, 3.0)
    """
    _require_positive("a record", duration=duration, step=step, peak=peak, rise=rise, decay_from=decay_from, decay=decay)
    count = round(duration / step)
    if count < 1:
        raise ValueError(f"a record of {duration:g} in steps of {step:g} has one sample; expected two at least")
    times = np.linspace(0.0, duration, count + 1)
    # RandomState: its streams stay the same in all versions of numpy.
    noise = np.random.RandomState(seed).standard_normal(count + 1)
    envelope = np.where(times < rise, (times / rise) ** 2, np.exp(-np.maximum(times - decay_from, 0.0) / decay))
    shaped = filtered(noise * envelope, step, ground or Ground())
    return times, peak * (shaped / np.abs(shaped).max())


def record_text(times: np.ndarray, accelerations: np.ndarray, remark: str = "") -> str:
    """A record as CSV: columns time and acceleration, to a millionth of the unit.

    Parameters
    ----------
    times, accelerations : (j,) array_like
    remark : str, optional
        A first line, after #.

    Examples
    --------
    >>> print(record_text(np.array([0.0, 0.02]), np.array([0.0, -1.5]), "by hand"), end="")
    # by hand
    time,acceleration
    0,0.000000
    0.02,-1.500000
    """
    rows = [f"{time:.10g},{value + 0.0:.6f}" for time, value in zip(times, accelerations, strict=True)]
    return "\n".join([*([f"# {remark}"] if remark else []), "time,acceleration", *rows]) + "\n"
