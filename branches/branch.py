"""A branch: a followed family of periodic orbits, with its events and its ends. Operations on branches are in other modules."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from branches.events import BranchEvent, DigitWork, Ended
from branches.full_family import FullFamily, Piece, full_family
from branches.orbit import OfProblem, Orbit
from bvp.checks import Frozen, is_finite, real
from bvp.dense import product
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.texts import brief, listed, shown, span

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

__all__ = ["Branch", "BranchEvent", "Ended"]


@brief
@dataclass(frozen=True, eq=False)
class Branch(OfProblem):
    """A family of periodic orbits, in order of arclength.

    Parameters
    ----------
    problem : MultipointProblem
    points : dict of str to ndarray
        Columns of length N: h, alpha, frequency (2 pi/T), frequency_index (m 2 pi/T), arclength, stable (1, 0, -1 undecided), tau,
        tau_half, label, half_waves (m), residual, velocities (N, n), start_u, start_v (N, n), flight_times (N, k+1),
        impact_speeds, multipliers (N, 2 m) complex, trivial, pairing, reliable; others by `with_columns`. NaN: does not exist, or
        grows without bound. They cannot be written to.
    events : tuple of BranchEvent
    ended : (Ended, Ended)
        At the first point and at the last.
    start : int
        Index of the point that it was started from.
    energy : (float, float)
        The range of energies in which it was followed.
    cover : int
        After a switch at a crossing with the k-fold cover of an orbit of this branch: k; else 0.
    digit_work : DigitWork
        What it took to decide stability where double precision does not (see `branches.between_events`).

    Examples
    --------
    >>> import saltus
    >>> branch = saltus.trace("S13O00+", saltus.vibro_impact_nes(mu=0.1, sigma=0.1), energy=(0.2, 1.0))
    >>> branch.label, [event.type for event in branch.events if event.type != "RT"]
    ('S13O00+', ['EP', 'SB', 'EP'])
    """

    problem: MultipointProblem
    points: dict[str, np.ndarray]
    events: tuple[BranchEvent, ...]
    ended: tuple[Ended, Ended]
    start: int = 0
    energy: tuple[float, float] = (0.0, math.inf)
    cover: int = 0
    digit_work: DigitWork = DigitWork()

    # Operations of modules that know this one; the package `saltus` adds them.
    save: ClassVar[Callable[..., None]]
    trace: ClassVar[Callable[..., Branch]]
    switch: ClassVar[Callable[..., list[Branch]]]
    neighbours: ClassVar[Callable[..., list[Any]]]
    plot: ClassVar[Callable[..., Axes]]
    to_dataframe: ClassVar[Callable[..., pandas.DataFrame]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", Frozen(self.points))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        h, alpha = (span(name, self.points[name]) for name in ("h", "alpha"))
        events = listed([event.id for event in self.events])
        title = f"Branch {self.label or '(no label)'}: {'-'.join(self.ends)}, sequence {self.sequence or '(none)'}, {len(self)} points"
        return title, [("range", f"{h}; {alpha}"), ("events", events)]

    def __len__(self) -> int:
        return len(self.points["h"])

    @cached_property
    def label(self) -> str:
        """The label of the orbit that it was started from."""
        return str(self.points["label"][self.start])

    @cached_property
    def aliases(self) -> list[dict[str, Any]]:
        """Intervals of arclength with one label each, in order."""
        labels, arclength = self.points["label"], self.points["arclength"]
        out: list[dict[str, Any]] = []
        for label, s in zip(labels, arclength, strict=True):
            if not out or out[-1]["label"] != label:
                out.append({"label": str(label), "from": float(s), "to": float(s)})
            out[-1]["to"] = float(s)
        return out

    @cached_property
    def full_family(self) -> FullFamily:
        """The family beyond the branch: what identifies it, and the other pieces that a range of energies cut off."""
        return full_family(self, self.__dict__.get("wider"))

    @cached_property
    def id(self) -> str:
        """`ends:sequence:hash` of the family, which does not depend on how it was reached or cut: see `branches.full_family`."""
        return self.full_family.ids[0]

    def known_within(self, wider: Branch) -> Branch:
        """This branch, with a wider branch of its family known. Its id is then found without following the family again."""
        self.__dict__["wider"] = wider
        return self

    def known_as(self, id: str) -> Branch:
        """This branch, with the id of its family known. The family is not followed for it."""
        self.__dict__["id"] = id
        return self

    def only_columns(self, names: Iterable[str]) -> Branch:
        """This branch with some columns of its points alone, and its full family known."""
        part = replace(self, points={name: self.points[name] for name in names})
        part.__dict__["full_family"] = self.full_family
        return part

    def with_columns(self, columns: Mapping[str, np.ndarray]) -> Branch:
        """This branch with more columns of its points. What is known of its family is kept."""
        return self.of_same_orbits(points={**self.points, **columns})

    def of_same_orbits(self, **changes: Any) -> Branch:
        """This branch with other attributes, but the same orbits. What is known of its family is kept."""
        found = replace(self, **changes)
        found.__dict__.update({name: value for name, value in self.__dict__.items() if name in ("id", "full_family", "wider")})
        return found

    @property
    def is_closed(self) -> bool:
        """Whether it is back at its first orbit, or at the image of it, so that nothing of its family is missing."""
        return all(end.reason in ("CLOSED", "IMAGE") for end in self.ended)

    @property
    def others(self) -> tuple[Piece, ...]:
        """The other pieces into which the range of energies cuts the family, each with (h, alpha) of its first and last orbit."""
        return self.full_family.others

    def unknowns(self, i: int) -> np.ndarray:
        """Unknowns of the multipoint problem near point i: exact start and flight times, nodes by exact flight.

        Raises
        ------
        IndexError
            For a point that the branch does not have.
        TypeError
            If it is not an integer.
        """
        try:
            i = operator.index(i)
        except TypeError:
            raise TypeError(f"a point is an integer; received {shown(i)}, expected 0 to {len(self) - 1}") from None
        if not -len(self) <= i < len(self):
            raise IndexError(f"point {shown(i)} does not exist: the branch has {len(self)} points, 0 to {len(self) - 1}")
        start = product(self.system.modes.from_state, np.concatenate([self.points["start_u"][i], self.points["start_v"][i]]))
        return self.problem.pack(start, None, self.points["flight_times"][i].copy())

    def orbit(self, i: int) -> Orbit:
        """The orbit at point i.

        Raises
        ------
        IndexError
            For a point that the branch does not have.
        """
        y = self.unknowns(i)
        # The saved orbit is taken as it stands where its residual allows: at a branch point the equations are singular, and Newton
        # would move it. Where the nodes of a long unstable segment have lost digits by propagation, they are corrected.
        saved = self.problem.step(y, np.zeros(2 * self.problem.unknowns), 0.0, maximum=0)
        problem = self.problem.in_enough_pieces(y) if saved is None else self.problem
        y = self.problem.in_pieces_of(problem, y)
        solution = problem.solve(y, energy=float(self.points["h"][i])) if saved is None else saved
        stable = int(self.points["stable"][i])
        return Orbit(problem, solution, on_family=bool(stable) if stable >= 0 else None)

    def orbit_between(self, i: int, part: float, **asked: float) -> Orbit | None:
        """The orbit between points i and i + 1 at an energy or a quarter period; None where the corrector fails.

        Parameters
        ----------
        i : int
        part : float
            Where it is sought from: 0 at point i, 1 at the next.
        **asked
            ``energy`` or ``quarter_period``.
        """
        guess = (1.0 - part) * self.unknowns(i) + part * self.unknowns(i + 1)
        try:
            solution = self.problem.solve(guess, **asked)
        except NotConverged:
            return None
        first, second = self.points["stable"][i].item(), self.points["stable"][i + 1].item()
        return Orbit(self.problem, solution, on_family=bool(first) if first == second and first >= 0 else None)

    def orbits_at(self, *, energy: float | None = None, alpha: float | None = None) -> list[Orbit]:
        """All orbits of the branch at an energy or at a quarter period, in order of arclength.

        Parameters
        ----------
        energy, alpha : float, optional
            The energy h or the quarter period alpha, one of them.

        Returns
        -------
        list of Orbit
            Empty where the branch does not reach it.

        Raises
        ------
        ValueError
            Unless one of them is given, a finite number above 0.
        """
        if (energy is None) == (alpha is None):
            raise ValueError("give one of energy and alpha")
        name, quantity = ("h", "energy h") if energy is not None else ("alpha", "quarter period alpha")
        asked = energy if energy is not None else alpha
        if not is_finite(asked) or not real(asked) > 0.0:
            raise ValueError(f"the {quantity} is a finite number above 0; received {shown(asked)}")
        value = real(asked)
        difference = self.points[name] - value
        out: list[Orbit] = []
        for i in range(len(self) - 1):
            if difference[i] * difference[i + 1] > 0.0 or (difference[i + 1] == 0.0 and i + 2 < len(self)):
                continue
            fraction = difference[i] / (difference[i] - difference[i + 1]) if difference[i] != difference[i + 1] else 0.0
            orbit = self.orbit_between(i, fraction, **({"energy": value} if name == "h" else {"quarter_period": value}))
            if orbit is not None and not any(np.allclose(orbit.solution.y, other.solution.y, rtol=1e-9, atol=1e-12) for other in out):
                out.append(orbit)
        nearest = int(np.argmin(np.abs(difference)))
        if not out and abs(difference[nearest]) <= 1e-10 * abs(value):
            out.append(self.orbit(nearest))
        return out

    def orbit_at(self, *, energy: float | None = None, alpha: float | None = None) -> Orbit:
        """The one orbit at an energy or a quarter period; `energy` and `alpha` as for `orbits_at`.

        Raises
        ------
        ValueError
            Where there is none, or where there are several: the message lists them.
        """
        found = self.orbits_at(energy=energy, alpha=alpha)
        asked = f"h = {energy:g}" if energy is not None else f"alpha = {alpha:g}"
        if not found:
            name = "h" if energy is not None else "alpha"
            low, high = self.points[name].min(), self.points[name].max()
            raise ValueError(f"no orbit of {self.label or self.id} at {asked}: it was followed over {low:.6g} <= {name} <= {high:.6g}")
        if len(found) > 1:
            listed = "; ".join(f"h = {orbit.h:.10g}, alpha = {orbit.alpha:.10g}" for orbit in found)
            raise ValueError(f"{len(found)} orbits of {self.label or self.id} at {asked}: {listed}")
        return found[0]

    def event(self, name: BranchEvent | str) -> BranchEvent:
        """The event with an id such as "GR1"; an event as it is.

        Raises
        ------
        ValueError
            Where there is none: the message lists those that there are.
        TypeError
            For what is neither an event nor an id.
        """
        if isinstance(name, BranchEvent):
            return name
        if not isinstance(name, str):
            raise TypeError(f"an event is one of branch.events or its id; received {shown(name)}")
        known = {item.id: item for item in self.events}
        if name not in known:
            raise ValueError(f"no event {name!r} on this branch; it has {', '.join(known) or 'none'}")
        return known[name]
