"""The statistics of a study, from its blocks one after the other: memory does not grow with the number of runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from transitions.study.runs import Ending
from transitions.study.study import Study

__all__ = ["Summary", "quartiles", "summarise"]

_BITS = 16
_ROUNDS = 64 // _BITS


@dataclass(frozen=True)
class Summary:
    """What the command says of a study."""

    runs: int
    impacts: int
    endings: Mapping[Ending, int]  # number of runs with each ending
    balance_error: float  # the largest; nan where no run has one
    quartiles: Mapping[str, np.ndarray]  # (5,) least, quartile, median, quartile, largest of each result that some run has


def summarise(study: Study) -> Summary:
    """The statistics of a study's finished runs."""
    impacts, worst = 0, np.nan
    counts: Counter[int] = Counter()
    for part in study.parts():
        impacts += int(part["impacts"].sum())
        counts.update(part["ended"].tolist())
        worst = np.fmax(worst, np.fmax.reduce(part["balance_error"]))
    endings = {ending: counts[ending.code] for ending in Ending if ending.code in counts}
    names = [name for name in study.names if name not in ("ended", "balance_error")]
    return Summary(len(study), impacts, endings, float(worst), quartiles(study.parts, names))


def quartiles(parts: Callable[[], Iterable[Mapping[str, np.ndarray]]], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Least value, quartile, median, quartile and largest value of each column, as `numpy.quantile` gives them for its finite values.

    A value is found by the digits of its place in the order of all doubles, 16 bits in each reading of the parts: the number of values
    that share the digits found so far says which digit is next.

    Parameters
    ----------
    parts : callable
        Gives the columns in parts, the same each time.
    names : sequence of str
        The columns.

    Returns
    -------
    dict
        (5,) ndarrays by name. A column without a finite value is left out.

    Examples
    --------
    >>> quartiles(lambda: [{"x": np.array([3.0, 1.0])}, {"x": np.array([2.0, np.nan])}], ["x"])
    {'x': array([1. , 1.5, 2. , 2.5, 3. ])}
    """
    mask = np.uint64((1 << _BITS) - 1)
    found = {name: np.zeros(10, dtype=np.uint64) for name in names}
    ranks: dict[str, np.ndarray] = {}
    places: dict[str, np.ndarray] = {}
    for step in range(_ROUNDS):
        below = np.uint64(64 - _BITS * (step + 1))
        tallies = {name: {high: np.zeros(1 << _BITS, dtype=np.int64) for high in values.tolist()} for name, values in found.items()}
        for part in parts():
            for name, tally in tallies.items():
                digits = _places(part[name].astype(float)) >> below
                for high, counts in tally.items():
                    same = digits[digits >> np.uint64(_BITS) == high] if step else digits
                    np.add.at(counts, (same & mask).astype(np.int64), 1)
        if not step:
            # Each quantile lies between two values next to each other in the order. A rank is the number of values before one.
            totals = {name: tallies[name][0].sum() for name in names}
            places = {name: np.linspace(0.0, total - 1.0, 5) for name, total in totals.items() if total}
            ranks = {name: np.concatenate([np.floor(at), np.ceil(at)]).astype(np.int64) for name, at in places.items()}
            found = {name: found[name] for name in places}
        for name, values in found.items():
            for k, high in enumerate(values.tolist()):
                sums = np.cumsum(tallies[name][high])
                digit = int(np.searchsorted(sums, ranks[name][k], side="right"))
                ranks[name][k] -= sums[digit - 1] if digit else 0
                values[k] = (high << _BITS) | digit
    out: dict[str, np.ndarray] = {}
    for name, at in places.items():
        lower, upper = _values(found[name]).reshape(2, -1)
        # As numpy does, from the nearer end.
        part = at - np.floor(at)
        out[name] = np.where(part < 0.5, lower + (upper - lower) * part, upper - (upper - lower) * (1.0 - part))
    return out


_SIGN = np.uint64(1 << 63)


def _places(values: np.ndarray) -> np.ndarray:
    """The finite values as integers (uint64) in the same order."""
    bits = (values[np.isfinite(values)] + 0.0).view(np.uint64)  # + 0.0: both zeros are one
    return np.where(bits >= _SIGN, ~bits, bits | _SIGN)


def _values(places: np.ndarray) -> np.ndarray:
    return np.where(places >= _SIGN, places & ~_SIGN, ~places).view(np.float64)
