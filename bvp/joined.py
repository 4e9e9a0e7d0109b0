"""Blocks of a free flight joined with the states of their loads (see `bvp.contact_modes`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bvp.blocks import Blocks, traceless
from bvp.numerics import exact_product

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Joined", "join"]

PARTICULAR_LIMIT = 30.0
"""Largest particular solution that is split off, in gaps, and in what the load moves without resonance: the digits that its difference can
lose."""


@dataclass(frozen=True, eq=False)
class Joined:
    """Blocks joined with loads: Z = states z + loads y, z = inside Z, (r, r') = position Z; `masters`: where the state of each load begins
    in Z."""

    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    inside: np.ndarray
    position: np.ndarray
    states: np.ndarray
    loads: np.ndarray
    masters: list[int]


def join(
    system: ImpactSystem, blocks: Blocks, basis: np.ndarray, loads: np.ndarray, frequency: np.ndarray, sizes: np.ndarray
) -> Joined:
    """Each block beside its loads, split where the particular solution is of the size of the gaps, joined where it is not."""
    m, count = basis.shape[1], len(loads)
    gaps = np.array([stop.gap for stop in system.stops])
    reach = np.array([max(abs(x) for x in (stop.lower, stop.upper) if np.isfinite(x)) for stop in system.stops])
    inverse = blocks.from_state[:, m:] @ _mass_inverse(blocks) if m else np.zeros((0, 0))
    drives = [exact_product(inverse, load) for load in loads]
    pieces: list[tuple[list[int], np.ndarray, list[int], list[float], np.ndarray]] = []
    particular = np.zeros((2 * m, 2 * count))
    for i, j in blocks.pairs:
        index = [i, j] if j >= 0 else list(range(i, i - j))
        own = blocks.matrix[np.ix_(index, index)]
        ratios = np.ones(len(index))
        joined = []
        for g in range(count):
            drive = drives[g][index]
            if not np.any(drive):
                continue
            solution = _sylvester(own, _generator(frequency[g]), drive)
            if solution is not None:
                moved = np.abs(gaps @ basis @ blocks.to_state[:m, index] @ solution) @ sizes[g]
                if np.all(moved <= PARTICULAR_LIMIT * reach) and _amplification(own, frequency[g]) <= PARTICULAR_LIMIT:
                    particular[np.ix_(index, [2 * g, 2 * g + 1])] = solution
                    continue
            joined.append(g)
        if joined:
            ratios = _ratios(own)
            own = own * ratios[:, None] / ratios
        whole = np.zeros((len(index) + 2 * len(joined),) * 2)
        whole[: len(index), : len(index)] = own
        units = []
        for k, g in enumerate(joined):
            # A block's load is told in units, powers of two, in which it moves the block at its own rates: bounds of a flight go with the
            # largest entry.
            rate = max(np.abs(own).max(), np.abs(_generator(frequency[g])).max())
            drive = ratios[:, None] * drives[g][index]
            units.append(2.0 ** float(np.round(np.log2(np.abs(drive).max() / rate))))
            at = slice(len(index) + 2 * k, len(index) + 2 * k + 2)
            whole[: len(index), at] = drive / units[k]
            whole[at, at] = _generator(frequency[g])
        pieces.append((index, ratios, joined, units, whole))
    pieces += [([], np.ones(0), [g], [1.0], _generator(frequency[g])) for g in range(count)]
    plain = not count
    size = sum(len(piece[-1]) for piece in pieces)
    matrix, inside = np.zeros((size, size)), np.zeros((2 * m, size))
    states, into = np.zeros((size, 2 * m)), np.zeros((size, 2 * count))
    pairs, masters, start = [], [], 0
    for index, ratios, joined, units, whole in pieces:
        width = len(whole)
        place = np.array(index) if plain else np.arange(start, start + width)
        pairs.append((place[0], place[1] if width == 2 else -width))
        matrix[np.ix_(place, place)] = whole
        inside[index, place[: len(index)]] = 1.0 / ratios
        states[place[: len(index)], index] = ratios
        into[place[: len(index)]] = -ratios[:, None] * particular[index]
        for k, g in enumerate(joined):
            for entry in range(2):
                into[place[len(index) + 2 * k + entry], 2 * g + entry] = units[k]
        if not index:
            masters.append(start)
            inside[:, place] += particular[:, 2 * joined[0] : 2 * joined[0] + 2]
        start += width
    layout = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    mean, delta = traceless(matrix, layout)
    return Joined(layout, mean, delta, matrix, inside, blocks.to_state @ inside, states, into, masters)


def _mass_inverse(blocks: Blocks) -> np.ndarray:
    """M^-1 of the reduced system, Phi Phi'."""
    return blocks.shapes @ blocks.shapes.T


def _ratios(block: np.ndarray) -> np.ndarray:
    """Units, powers of two, in which the two entries of a pair that turn each other into the other are alike."""
    if len(block) != 2 or block[0, 1] == 0.0 or block[1, 0] == 0.0:
        return np.ones(len(block))
    return np.array([1.0, 2.0 ** float(np.round(0.5 * np.log2(abs(block[0, 1] / block[1, 0]))))])


def _generator(frequency: float) -> np.ndarray:
    """S of a load: a rotation, or level and slope."""
    return np.array([[0.0, -frequency], [frequency, 0.0]]) if frequency > 0.0 else np.array([[0.0, 1.0], [0.0, 0.0]])


def _sylvester(block: np.ndarray, generator: np.ndarray, drive: np.ndarray) -> np.ndarray | None:
    """X with X S - B X = G; None where B and S share an eigenvalue to rounding."""
    size = len(block)
    operator = np.kron(np.eye(size), generator.T) - np.kron(block, np.eye(2))
    if np.linalg.cond(operator) > 1e14:
        return None
    return np.linalg.solve(operator, drive.ravel()).reshape(size, 2)


def _amplification(block: np.ndarray, frequency: float) -> float:
    """How near a load is to resonance with a block: the largest rate over the least distance of the rates; 1 for loads that do not turn."""
    if frequency == 0.0:
        return 1.0
    rates = np.linalg.eigvals(block)
    return float(max(np.abs(rates).max(), frequency) / max(np.abs(rates - 1j * frequency).min(), np.finfo(float).tiny))
