"""How much the bench measures: all of it, or enough for a look."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FULL", "QUICK", "Effort"]


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes
    ----------
    name : str
    tasks, methods : tuple of str or None
        Names; None for all.
    tolerances : tuple of float
        Of methods that have one, loose to tight.
    repeat : float
        Seconds for which a work is repeated; its least time counts.
    limit : float
        Seconds after which a work is given up, and the tighter settings of its method with it.
    start : float
        Seconds that the first work of a fresh process may take longer: kernels that are not on disk yet are compiled in it.
    impacts, degrees : tuple of int
        Inner impacts, and degrees of freedom, for which the growth of a point's cost is measured.
    periods : tuple of float
        Longest quarter periods for which the growth of a discovery's cost is measured.
    """

    name: str
    tasks: tuple[str, ...] | None
    methods: tuple[str, ...] | None
    tolerances: tuple[float, ...]
    repeat: float
    limit: float
    start: float
    impacts: tuple[int, ...]
    degrees: tuple[int, ...]
    periods: tuple[float, ...]


FULL = Effort(
    "full", None, None, tuple(10.0**-k for k in range(3, 14, 2)), 0.3, 30.0, 300.0,
    (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000), (2, 3, 5, 8, 12, 20, 32, 50), (1.8, 2.5, 3.2, 4.0, 5.1),
)  # fmt: skip
"""The figures of the page."""

QUICK = Effort(
    "quick", ("S13O00+", "U8353-", "located"),
    ("saltus", "saltus, short steps", "saltus, saddle-point matrix", "solve_ivp DOP853", "nonsmooth time (the paper's)", "solve_bvp",
     "AUTO-07p"),
    (1e-4, 1e-8, 1e-12), 0.05, 2.0, 300.0, (1, 8, 64, 1000), (2, 8, 50), (1.8, 3.2),
)  # fmt: skip
"""Below a minute on a machine with nothing else to do and compiled code on disk."""
