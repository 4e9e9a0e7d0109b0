"""A fast scan of starts at the origin: changes of sign of the residual at the far end, between neighbouring angles.

Two degrees of freedom: the starts at an energy are a circle, and an orbit between two ends is a zero of one number along it
(`bvp.kernels.shooting`). Two neighbouring angles bracket a zero if their motions hit the same stops. The scan can miss zeros. A name is
searched at many energies, so it need not find every orbit at each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.search.starts import START_FROM_A_STATE, ScannedSegment
from bvp.checks import require_two_dof
from bvp.kernels.impact import work_array
from bvp.kernels.multipoint import ORIGIN, REST, STOP
from bvp.kernels.shooting import EndSet, ScanLimits, Scanned, scan_starts

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Sampler", "origin_starts"]

CROSSINGS = 6
"""Crossings searched in one flight. A longer flight between impacts has more."""

NARROWINGS = 6
"""Steps that narrow a bracket before Newton's method takes over, by the secant and by halving."""


def origin_starts(energy: float, angles: np.ndarray) -> np.ndarray:
    """Modal states (M, 4) at the origin with an energy. The angle is that of the modal velocities."""
    speed = np.sqrt(2.0 * energy)
    out = np.zeros((angles.size, 4))
    out[:, 2] = speed * np.cos(angles)
    out[:, 3] = speed * np.sin(angles)
    return out


class Sampler:
    """Scans one system from the origin to a far end of one kind.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one stop with odd symmetry.
    end : str
        "origin", "rest" or "stop".
    quarter_period : float
        Longest quarter period.
    impacts : sequence of int
        Numbers of impacts inside the segment.

    Raises
    ------
    ValueError
        For another number of degrees of freedom or several stops.
    """

    def __init__(self, system: ImpactSystem, end: str, quarter_period: float, impacts: Sequence[int]):
        require_two_dof(system, "orbits are found by their names on", START_FROM_A_STATE)
        self.end = end
        self.kind = {"origin": ORIGIN, "rest": REST, "stop": STOP}[end]
        self.longest = quarter_period * (2.0 if end == "origin" else 1.0)
        self.impacts = impacts
        self.modes = modes = system.modes
        gap = modes.contact_gap[0]
        across = np.array([-gap[1], gap[0]]) / np.hypot(gap[0], gap[1])
        transverse = np.concatenate([across, np.zeros(2)] if self.kind == ORIGIN else [np.zeros(2), across])
        self.transverse = np.ascontiguousarray(np.array([transverse, transverse]))
        row = gap if self.kind == ORIGIN else modes.contact_rate[0]
        self.functional = np.ascontiguousarray(np.array([row, row @ modes.matrix, row @ modes.matrix @ modes.matrix]))
        self.work = work_array(4, len(modes.contact_side))

    def follow(self, starts: np.ndarray, impacts: Sequence[int], nodes: bool = False) -> tuple[np.ndarray, ...]:
        """Follow starts (M, 4) through up to K = max(impacts) impacts.

        Returns
        -------
        sequences : (M, K + 1) int
            Contacts hit, -1 after the last.
        times, residuals : (M, K + 1, C) float
            Of the crossings after each number of `impacts`, NaN if there is none.
        states, instants : (M, K, 4), (M, K) float
            After each impact, and their times; empty unless `nodes`.
        """
        wanted = np.zeros(max(impacts) + 1, dtype=np.int64)
        wanted[list(impacts)] = 1
        most, count, modes = max(impacts), len(starts), self.modes
        crossings = 1 if self.kind == STOP else CROSSINGS
        sequences = np.full((count, most + 1), -1, dtype=np.int64)
        times = np.full((count, most + 1, crossings), np.nan)
        residuals = np.full((count, most + 1, crossings), np.nan)
        ends, status = np.empty(count), np.empty(count, dtype=np.int64)
        kept = count if nodes else 0
        states, instants = np.zeros((kept, most, 4)), np.zeros((kept, most))
        end, limits = EndSet(self.kind, self.transverse, self.functional), ScanLimits(wanted, most, self.longest)
        found = Scanned(sequences, times, residuals, ends, status, states, instants)
        scan_starts(modes.flight, modes.contacts, end, starts, limits, found, self.work)
        return sequences, times, residuals, states, instants

    def segments(self, energy: float, angles: int | np.ndarray) -> Iterator[ScannedSegment]:
        """The segment of each change of sign between neighbouring angles (M,), in order of the impacts and angles.

        A number of angles stands for as many in half a turn. The other half is its mirror image."""
        if isinstance(angles, int):
            angles = (np.arange(angles + 1) + 0.5) * (np.pi / angles)
        sequences, _, residuals, _, _ = self.follow(origin_starts(energy, angles), self.impacts)
        # A number for each sequence: beyond 38 impacts it needs Python's integers.
        dtype = object if sequences.shape[1] > 38 else np.int64
        code = np.cumsum((sequences + 1) * 3 ** np.arange(sequences.shape[1], dtype=dtype), axis=1)
        for k in self.impacts:
            hits = k if self.kind == STOP else k - 1
            same = np.ones(len(angles) - 1, bool) if hits < 0 else code[:-1, hits] == code[1:, hits]
            for c in range(residuals.shape[2]):
                for i in np.flatnonzero(same & (residuals[:-1, k, c] * residuals[1:, k, c] <= 0.0)):
                    segment = self._narrowed(energy, k, c, float(angles[i]), float(angles[i + 1]))
                    if segment is not None:
                        yield segment

    def _narrowed(self, energy: float, k: int, c: int, low: float, high: float) -> ScannedSegment | None:
        """The segment of the zero of the c-th crossing after k impacts between two angles; None if it has other impacts."""
        sequences, _, residuals, _, _ = self.follow(origin_starts(energy, np.array([low, high])), [k])
        f_low, f_high = residuals[0, k, c], residuals[1, k, c]
        hits = k + 1 if self.kind == STOP else k
        key = tuple(sequences[0, :hits])
        for _ in range(NARROWINGS):
            middle = 0.5 * (low + high)
            guess = low - f_low * (high - low) / (f_high - f_low) if f_high != f_low else middle
            points = np.array(sorted({middle, min(max(guess, low), high)}))
            sequences, _, residuals, _, _ = self.follow(origin_starts(energy, points), [k])
            for point, sequence, f in zip(points.tolist(), sequences, residuals[:, k, c], strict=True):
                if tuple(sequence[:hits]) != key or not np.isfinite(f) or not low <= point <= high:
                    continue
                if f * f_low > 0.0:
                    low, f_low = point, f
                else:
                    high, f_high = point, f
        best, residual = (low, f_low) if abs(f_low) < abs(f_high) else (high, f_high)
        start = origin_starts(energy, np.array([best]))
        sequences, times, _, states, instants = self.follow(start, [k], nodes=True)
        if -1 in sequences[0, :k] or not np.isfinite(times[0, k, c]):
            return None
        letters = [self.modes.contact_letters[contact] for contact in sequences[0]]
        end = self.end if self.kind != STOP else "stop" + letters[k]
        stamps = np.concatenate([[0.0], instants[0, :k], [times[0, k, c]]])
        return ScannedSegment(("origin", end), tuple(letters[:k]), start[0], states[0, :k], np.diff(stamps), best, low, high, abs(residual))
