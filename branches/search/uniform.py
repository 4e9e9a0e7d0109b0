"""Finding orbits at given energies: scan the starts of an end, keep the changes of sign of what misses the far end, polish.

Two degrees of freedom: the starts at an energy are a curve (an angle), and an orbit between two ends is a zero of one number
along it (`bvp.kernels.shooting`). Each zero is polished as an exact solution of its multipoint problem. It is dropped only if it is
none: it does not converge, pierces a stop, or is another orbit run through several times.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.search.orbits import Found, accept
from branches.search.scope import START_FROM_A_STATE, require_one_stop, require_two_degrees
from bvp.kernels.impact import work_array
from bvp.kernels.multipoint import ORIGIN, REST, STOP
from bvp.kernels.shooting import scan_starts
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Scanner"]

CROSSINGS = 6
"""Crossings kept in one flight; a longer flight between impacts has more, and they are counted as not searched."""


class Scanner:
    """Searches one system, from the origin, for orbits with a far end of one kind.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one stop with odd symmetry.
    end : str
        "origin", "rest" or "stop".
    quarter_period : float
        Longest quarter period searched.

    Raises
    ------
    ValueError
        For another number of degrees of freedom, several stops, or no odd symmetry.
    """

    def __init__(self, system: ImpactSystem, end: str, quarter_period: float):
        require_two_degrees(system, "orbits are found by their names on", START_FROM_A_STATE)
        require_one_stop(system, "orbits are found by their names on")
        self.system = system
        self.end = end
        self.kind = {"origin": ORIGIN, "rest": REST, "stop": STOP}[end]
        self.longest = quarter_period * (2.0 if end == "origin" else 1.0)
        modes = system.modes
        self.modes = modes
        gap = modes.contact_gap[0]
        across = np.array([-gap[1], gap[0]]) / np.hypot(gap[0], gap[1])
        transverse = np.zeros(4)
        transverse[:2] = across if self.kind == ORIGIN else 0.0
        transverse[2:] = 0.0 if self.kind == ORIGIN else across
        self.transverse = np.ascontiguousarray(np.array([transverse, transverse]))
        row = gap if self.kind == ORIGIN else modes.contact_rate[0]
        self.functional = np.ascontiguousarray(np.array([row, row @ modes.matrix, row @ modes.matrix @ modes.matrix]))
        self.work = work_array(4, len(modes.contact_side))
        self.problems: dict[tuple[str, tuple[str, ...]], MultipointProblem] = {}

    def starts(self, energy: float, angles: np.ndarray) -> np.ndarray:
        """Start states (M, 4) at the origin with that energy; the angle is that of the modal velocities."""
        speed = np.sqrt(2.0 * energy)
        out = np.zeros((angles.size, 4))
        out[:, 2] = speed * np.cos(angles)
        out[:, 3] = speed * np.sin(angles)
        return out

    def follow(self, starts: np.ndarray, impacts: Sequence[int], nodes: bool = False) -> tuple[np.ndarray, ...]:
        """Words (M, K+1), times and misses (M, K+1, C) after each number of `impacts`, status (M,), and the nodes and their
        instants if `nodes`."""
        wanted = np.zeros(max(impacts) + 1, dtype=np.int64)
        wanted[list(impacts)] = 1
        most = max(impacts)
        count = len(starts)
        modes = self.modes
        crossings = 1 if self.kind == STOP else CROSSINGS
        sequence = np.full((count, most + 1), -1, dtype=np.int64)
        times = np.full((count, most + 1, crossings), np.nan)
        values = np.full((count, most + 1, crossings), np.nan)
        ends = np.empty(count)
        status = np.empty(count, dtype=np.int64)
        kept = count if nodes else 0
        states = np.zeros((kept, most, 4))
        instants = np.zeros((kept, most))
        scan_starts(
            modes.flight, modes.contacts, self.kind, self.transverse, self.functional, starts, wanted, most, self.longest, sequence, times,
            values, ends, status, states, instants, self.work,
        )  # fmt: skip
        return sequence, times, values, status, states, instants

    def brackets(self, energy: float, angles: np.ndarray, impacts: Sequence[int]) -> list[tuple[int, int, float, float]]:
        """(k, crossing, angle, angle) between which the miss after k impacts changes sign with the same sequence on both sides."""
        sequence, _, values, _, _, _ = self.follow(self.starts(energy, angles), impacts)
        code = np.cumsum((sequence + 1) * 3 ** np.arange(sequence.shape[1], dtype=object), axis=1) if sequence.shape[1] > 38 else None
        if code is None:
            code = np.cumsum((sequence + 1) * 3 ** np.arange(sequence.shape[1]), axis=1)
        out = []
        for k in impacts:
            hits = k if self.kind == STOP else k - 1
            same = np.ones(len(angles) - 1, bool) if hits < 0 else code[:-1, hits] == code[1:, hits]
            for c in range(values.shape[2]):
                product = values[:-1, k, c] * values[1:, k, c]
                for i in np.flatnonzero(same & (product <= 0.0)):
                    out.append((k, c, float(angles[i]), float(angles[i + 1])))
        return out

    def polish(self, energy: float, bracket: tuple[int, int, float, float]) -> Found | None:
        """The orbit in a bracket, if it is one."""
        k, c, low, high = bracket
        sequence, _, values, _, _, _ = self.follow(self.starts(energy, np.array([low, high])), [k])
        f_low, f_high = values[0, k, c], values[1, k, c]
        key = tuple(sequence[0, : k + 1] if self.kind == STOP else sequence[0, :k])
        for _ in range(6):
            middle = 0.5 * (low + high)
            guess = low - f_low * (high - low) / (f_high - f_low) if f_high != f_low else middle
            points = np.array(sorted({middle, min(max(guess, low), high)}))
            sequence, _, values, _, _, _ = self.follow(self.starts(energy, points), [k])
            for i, point in enumerate(points):
                f = values[i, k, c]
                if tuple(sequence[i, : len(key)]) != key or not np.isfinite(f):
                    continue
                if not low <= point <= high:
                    continue
                if f * f_low > 0.0:
                    low, f_low = float(point), f
                else:
                    high, f_high = float(point), f
        best = low if abs(f_low) < abs(f_high) else high
        sequence, times, values, _, states, instants = self.follow(self.starts(energy, np.array([best])), [k], nodes=True)
        letters = self.modes.contact_letters
        inner = tuple(letters[contact] for contact in sequence[0, :k])
        if -1 in sequence[0, :k] or not np.isfinite(times[0, k, c]):
            return None
        end = self.end if self.kind != STOP else "stop" + letters[sequence[0, k]]
        problem = self.problem(end, inner)
        stamps = np.concatenate([[0.0], instants[0, :k], [times[0, k, c]]])
        y = problem.pack(self.starts(energy, np.array([best]))[0], states[0, :k], np.diff(stamps))
        try:
            solution = problem.solve(y, energy=energy)
        except NotConverged:
            return None
        return accept(problem, solution)

    def problem(self, end: str, sequence: tuple[str, ...]) -> MultipointProblem:
        """The multipoint problem between the origin and an end, made once for each sequence."""
        key = (end, sequence)
        if key not in self.problems:
            self.problems[key] = MultipointProblem(self.system, ("origin", end), sequence)
        return self.problems[key]

    def orbits(self, energy: float, angles: int, impacts: Sequence[int]) -> Iterator[Found]:
        """Orbits at an energy from a scan with so many angles over half a turn (the other half is its mirror image)."""
        grid = (np.arange(angles + 1) + 0.5) * (np.pi / angles)
        for bracket in self.brackets(energy, grid, impacts):
            found = self.polish(energy, bracket)
            if found is not None:
                yield found
