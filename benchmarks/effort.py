"""How much the benchmark measures: all of it, or enough for a look."""

from __future__ import annotations

from dataclasses import dataclass

from saltus.bench.cases import INNER

__all__ = ["FULL", "QUICK", "Effort"]


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Parameters
    ----------
    points : int
        Points of a run of saltus.
    repeats : int
        Runs of saltus.
    shot : dict of int to int
        Points by shooting for each number of inner impacts.
    rtols : dict of int to tuple of float
        Tolerances of the integrator for each number of inner impacts.
    differenced : int
        Most inner impacts for which the multipliers of shooting are computed.
    families : tuple of str
        Names of families that are followed as a whole.
    processes : int
        Repeats of a warm process.
    cold : bool
        Whether processes are run without compiled code too; saltus then compiles all that it needs.
    """

    points: int
    repeats: int
    shot: dict[int, int]
    rtols: dict[int, tuple[float, ...]]
    differenced: int
    families: tuple[str, ...]
    processes: int
    cold: bool


_RTOLS = (1e-6, 1e-9, 1e-12)

FULL = Effort(
    points=40,
    repeats=25,
    shot={0: 12, 2: 8, 4: 6, 8: 5, 64: 2},
    rtols={inner: _RTOLS for inner in INNER},
    differenced=64,
    families=("S13O00+", "S11O00-", "S73O33-", "U8353-"),
    processes=7,
    cold=True,
)
"""The figures of the page."""

QUICK = Effort(
    points=16,
    repeats=7,
    shot={0: 3, 2: 2, 4: 1, 8: 1, 64: 1},
    rtols={0: _RTOLS, 2: _RTOLS, 4: (1e-9, 1e-12), 8: (1e-12,), 64: (1e-12,)},
    differenced=8,
    families=("S13O00+", "S73O33-"),
    processes=2,
    cold=False,
)
"""Below a minute on a machine with nothing else to do and compiled code on disk."""
