"""One periodic orbit: its impacts, multipliers, quality, and its motion at any time."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from branches.stability import Described, describe
from bvp.checks import Frozen
from bvp.closures import Cycle, cycle_of
from bvp.multipoint import MultipointProblem, Solution
from bvp.summary import brief

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes

    from bvp.system import ImpactSystem

__all__ = ["Impact", "Orbit"]


class Impact(NamedTuple):
    """One impact: time in [0, T), the contact's letter, the speed of approach along the gap coordinate."""

    time: float
    stop: str
    speed: float


@brief
@dataclass(frozen=True, eq=False)
class Orbit:
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
    """`saltus.methods` adds it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "solution", self.solution.frozen())

    @property
    def system(self) -> ImpactSystem:
        """The system it is an orbit of."""
        return self.problem.system

    @property
    def ends(self) -> tuple[str, str]:
        """Kinds of the two ends of the solved segment."""
        return self.problem.ends

    @property
    def sequence(self) -> str:
        """Contacts hit inside the solved segment."""
        return "".join(self.problem.sequence)

    @cached_property
    def described(self) -> Described:
        """Label, stability and multipliers."""
        return Described(Frozen(describe(self.problem, [self.solution]).columns))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        stable = {True: "stable", False: "unstable", None: "stability undecided"}[self.stable]
        title = f"Orbit {self.label or '(no label)'}: {'-'.join(self.ends)}, sequence {self.sequence or '(none)'}"
        place = f"h = {self.h:.10g}, alpha = {self.alpha:.10g}, residual {self.residual:.1e}"
        largest = max(map(abs, self.multipliers), default=0.0)
        return title, [("place", place), ("stability", f"{stable}, largest multiplier {largest:.6g}")]

    def _get(self, name: str) -> Any:
        return self.described.columns[name][0]

    @property
    def label(self) -> str:
        """Label of the grammar, "" outside it."""
        return str(self._get("label"))

    @property
    def h(self) -> float:
        """Energy."""
        return float(self._get("h"))

    @property
    def alpha(self) -> float:
        """Quarter period T/4."""
        return float(self._get("alpha"))

    @property
    def period(self) -> float:
        """T."""
        return 4.0 * self.alpha

    @property
    def residual(self) -> float:
        """Residual of the multipoint problem, scaled by the state."""
        return float(self._get("residual"))

    @property
    def velocities(self) -> np.ndarray | None:
        """Initial velocities (n,) at zero displacement; None where the orbit does not start at an origin."""
        values = self._get("velocities")
        return None if np.isnan(values).any() else values

    @property
    def impact_speeds(self) -> np.ndarray:
        """Speeds of approach at the impacts of the solved segment, those at its ends included."""
        return self._get("impact_speeds")

    @property
    def multipliers(self) -> np.ndarray:
        """Nontrivial Floquet multipliers of the full period, (2n-2,) complex."""
        return self._get("multipliers")

    @property
    def tau(self) -> float:
        """Trace of the reduced full-period map (n = 2), NaN where unbounded or not defined."""
        return float(self._get("tau"))

    @property
    def tau_half(self) -> float:
        """Trace of the reduced half map composed with u -> -u; NaN for orbits without half-period symmetry."""
        return float(self._get("tau_half"))

    @property
    def stable(self) -> bool | None:
        """Whether it is linearly stable; None where neither it nor the family around it decides that by more than its own error."""
        code = int(self._get("stable"))
        return self.on_family if code < 0 else bool(code)

    @property
    def quality(self) -> dict[str, Any]:
        """How well the multipliers keep what is known: trivial, pairing, reliable."""
        return {name: self._get(name).item() for name in ("trivial", "pairing", "reliable")}

    @cached_property
    def cycle(self) -> Cycle:
        """The whole period, impact by impact."""
        return cycle_of(self.problem, self.solution.y)

    @property
    def impacts(self) -> list[Impact]:
        """Impacts over one period in order of time."""
        cycle = self.cycle
        return [Impact(float(t), s, float(v)) for t, s, v in zip(cycle.times, cycle.letters, cycle.speeds, strict=True)]

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (m, n) at any times (m,); at an impact the velocity is the one after it."""
        return self.cycle.sample(times)
