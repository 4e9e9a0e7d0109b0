"""Starts in an end set at one energy, and a fast scan of those at the origin.

Two degrees of freedom with a stop. Each set of starts is a curve of states, a combination of two functions of one parameter. The starts at
the origin are a circle of velocities. The starts at rest are a conic of displacements inside the gap. The starts at a stop are an ellipse
of position along the stop and speed. If the system has odd symmetry, half of each is left out.

An orbit between two ends is a zero of one number along a curve. The fast scan looks for changes of its sign
between neighbouring angles whose motions hit the same stops. It can overlook zeros. A name is searched at many
energies, so the scan need not find every orbit at each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from saltus_core import Contacts, Curve, FarEnd, PlanarSystem, Starts

from branches.sequences import Ends, ImpactSequence
from bvp.checks import require_system
from bvp.dense import inner, length
from bvp.functions import asin, asinh, hypot, log
from bvp.system import ImpactSystem

__all__ = [
    "KINDS", "MOST_IMPACTS", "Path", "FROM_LINEAR_MODES", "Sampler", "ScannedSegment", "StartCurve", "curve_over_energy", "curves",
]  # fmt: skip

FROM_LINEAR_MODES = (
    "saltus continue --from mode:K and saltus build follow the families that begin at its linear modes, and "
    "--from simulate --start U1,..,V1,.. the family near a start of zero speed"
)
"""Advice if no scan can find them."""

KINDS = {"origin": FarEnd.ORIGIN, "rest": FarEnd.REST, "stop": FarEnd.STOP}

INSET = 1e-11
"""How far from a curve's end at a stop the scan begins. Nearer, the speed of the first impact is lost in rounding."""

MOST_IMPACTS = 200
"""Impacts that one start is followed through where no bound is given."""

OFFSET = 0.3
"""Parameter at which the full circle is cut. No symmetry singles it out."""


class Path(NamedTuple):
    """One start followed: its state (4,), contacts hit (k,), states after them (k, 4), flight times before them, instants (k,)."""

    start: np.ndarray
    contacts: np.ndarray
    nodes: np.ndarray
    durations: np.ndarray
    instants: np.ndarray

    @property
    def until_last(self) -> float:
        """Time from the start to the last impact followed."""
        return float(self.instants[-1]) if len(self.instants) else 0.0


class ScannedSegment(NamedTuple):
    """A motion from a start to a far end, as a scan finds it: nearly an orbit.

    ends, sequence: of its multipoint problem. start (4,), nodes (k, 4), flight_times (k + 1,): as `MultipointProblem.pack` takes them.
    parameter: what the scan varies, between low and high. residual: of the far end's condition.
    """

    ends: Ends
    sequence: ImpactSequence
    start: np.ndarray
    nodes: np.ndarray
    flight_times: np.ndarray
    parameter: float
    low: float
    high: float
    residual: float

    @property
    def alpha(self) -> float:
        """Quarter period of the orbit that it is part of."""
        return float(np.sum(self.flight_times)) / (1 if (self.ends[0] == "origin") != (self.ends[1] == "origin") else 2)


@dataclass(frozen=True, eq=False)
class StartCurve:
    """Starts of one kind, parametrised over an interval: at one energy, or with one direction over a range of energies.

    Parameters
    ----------
    end : str
        "origin", "rest", "stop+", "stop-".
    starts : Starts
        The system and this curve for the compiled core.
    low, high : float
        The parameter's range.
    singular : (bool, bool)
        Whether the curve ends at a stop there, so that the first impact's speed goes to zero.
    before : Path, optional
        For the image of a short piece of another curve (`branches.search.intervals`): the motion from that piece's middle up to
        and including the impact after which this curve starts.
    piece : (float, float)
        The original parameter where this curve's own is 0, and its derivative by it. With `before` that is the middle of the piece.
    has_mirror : bool
        Whether a start stands for its mirror image too, in a system with odd symmetry.
    most_impacts : int
        Impacts that one start is followed through where no bound is given.
    """

    end: str
    starts: Starts
    low: float
    high: float
    singular: tuple[bool, bool] = (False, False)
    before: Path | None = None
    piece: tuple[float, float] = (0.0, 1.0)
    has_mirror: bool = True
    most_impacts: int = MOST_IMPACTS

    def original(self, parameter: float) -> float:
        """Parameter of the start on the curve of starts that this one is an image of, or lies on."""
        return self.piece[0] + self.piece[1] * parameter


def curves(system: ImpactSystem, end: str, energy: float) -> list[StartCurve]:
    """The curves of all starts of a kind ("origin", "rest" or "stop") at an energy, up to the mirror image. The list is empty if the energy
    is too low for the end set.

    Raises
    ------
    ValueError
        For rest or stop ends if no stiffness acts along the stop: the set of starts is unbounded.
    """
    if end == "origin":
        speed = math.sqrt(2.0 * energy)
        coefficients = np.zeros((3, 4))
        coefficients[1, 2] = coefficients[2, 3] = speed
        return [StartCurve("origin", _starts(system, coefficients, Curve.TRIGONOMETRIC, -1), OFFSET, OFFSET + math.pi)]
    # Displacements q = w normal + s across: V = (a w^2 + 2 b w s + c s^2)/2.
    modes = system.modes
    gap = modes.contacts.gap[0, :2]
    normal = gap / inner(gap, gap)
    across = _across(gap)
    a, b, c = (inner(modes.squares * x, y) for x, y in ((normal, normal), (normal, across), (across, across)))
    if c <= 1e-12 * float(np.max(np.abs(modes.squares))):
        raise ValueError(f"the ends rest and stop need a positive stiffness along the stop; received {c:.3g}")
    stiffness = a - b * b / c
    if abs(stiffness) <= 1e-12 * float(np.max(np.abs(modes.squares))) * inner(normal, normal):
        stiffness = 0.0
    slide = normal - b / c * across
    if end == "rest":
        return _rest(system, energy, stiffness, c, slide, across)
    out = []
    for contact, letter in enumerate(modes.contact_letters):
        if system.has_odd_symmetry and modes.contacts.side[contact] < 0.0:
            continue
        bound = float(modes.contacts.bound[contact])
        left = energy - 0.5 * stiffness * bound * bound
        if left <= 0.0:
            continue
        coefficients = np.zeros((3, 4))
        coefficients[0, :2] = bound * slide
        coefficients[2, :2] = math.sqrt(2.0 * left / c) * across
        coefficients[1, 2:] = -modes.contacts.side[contact] * math.sqrt(2.0 * left) * gap / length(gap)
        starts = _starts(system, coefficients, Curve.TRIGONOMETRIC, contact)
        out.append(StartCurve("stop" + letter, starts, -0.5 * math.pi, 0.5 * math.pi, (True, True)))
    return out


def curve_over_energy(system: ImpactSystem, start: np.ndarray, energy: tuple[float, float], longest: float) -> StartCurve:
    """The multiples of a modal state at the origin, over a range of energies h. The parameter is half of log h, from 0.

    start (4,) has energy 1. longest: time that each start is followed. `StartCurve.angle` is log h."""
    coefficients = np.zeros((3, 4))
    # cosh and sinh together are the exponential function; there is no cancellation from 0 on.
    coefficients[1:] = math.sqrt(energy[0]) * start
    gap, stop = system.modes.contacts.gap[0, :2], system.stops[0]
    passages = longest * math.sqrt(2.0 * energy[1] * inner(gap, gap)) / (stop.upper - stop.lower)
    return StartCurve(
        "origin", _starts(system, coefficients, Curve.HYPERBOLIC, -1), 0.0, 0.5 * log(energy[1] / energy[0]),
        piece=(log(energy[0]), 2.0), has_mirror=False, most_impacts=MOST_IMPACTS + 2 * math.ceil(passages),
    )  # fmt: skip


def _rest(system: ImpactSystem, energy: float, stiffness: float, along: float, slide: np.ndarray, across: np.ndarray) -> list[StartCurve]:
    """Curves of starts at rest inside the gap.

    The potential energy 2 V = stiffness w^2 + along s^2 is constant. w is the gap coordinate, and s is the distance along the stop from
    the point where the force along the stop is zero. The curve is an ellipse, two lines or a hyperbola, by the sign of `stiffness`."""
    stop = system.stops[0]
    size = math.sqrt(2.0 * energy / along)
    branches = (1.0,) if system.has_odd_symmetry else (1.0, -1.0)
    out = []
    if stiffness > 0.0:
        reach = math.sqrt(2.0 * energy / stiffness)
        coefficients = np.zeros((3, 4))
        coefficients[1, :2] = size * across
        coefficients[2, :2] = reach * slide
        starts = _starts(system, coefficients, Curve.TRIGONOMETRIC, -1)
        lower, upper = stop.lower / reach, stop.upper / reach
        if upper <= -1.0 or lower >= 1.0:
            return []
        first = asin(lower) if lower > -1.0 else None
        last = asin(upper) if upper < 1.0 else None
        if first is None and last is None:
            turn = math.pi if system.has_odd_symmetry else 2.0 * math.pi
            return [StartCurve("rest", starts, OFFSET, OFFSET + turn)]
        if first is not None and last is not None:
            out.append(StartCurve("rest", starts, first, last, (True, True)))
            if len(branches) == 2:
                out.append(StartCurve("rest", starts, math.pi - last, math.pi - first, (True, True)))
            return out
        if last is not None:
            return [StartCurve("rest", starts, math.pi - last, 2.0 * math.pi + last, (True, True))]
        assert first is not None
        return [StartCurve("rest", starts, first, math.pi - first, (True, True))]
    for branch in branches:
        coefficients = np.zeros((3, 4))
        if stiffness == 0.0:
            coefficients[0, :2] = branch * size * across
            coefficients[2, :2] = slide
            shape, low, high = Curve.LINEAR, stop.lower, stop.upper
        else:
            reach = math.sqrt(-2.0 * energy / stiffness)
            coefficients[1, :2] = branch * size * across
            coefficients[2, :2] = reach * slide
            shape, low, high = Curve.HYPERBOLIC, asinh(stop.lower / reach), asinh(stop.upper / reach)
        out.append(StartCurve("rest", _starts(system, coefficients, shape, -1), low, high, (True, True)))
    return out


def _across(gap: np.ndarray) -> np.ndarray:
    """Unit vector along the stop, in modal coordinates."""
    return np.array([-gap[1], gap[0]]) / hypot(gap[0], gap[1])


def planar_system(system: ImpactSystem) -> PlanarSystem:
    """A system of two degrees of freedom and one stop, for the compiled core."""
    modes, stop = system.modes, system.stops[0]
    contacts = modes.contacts
    rows = contacts.gap, contacts.rate, contacts.acceleration, contacts.side, contacts.bound, contacts.push, contacts.restitution
    return PlanarSystem(modes.squares.tolist(), Contacts(*map(np.ascontiguousarray, rows)), stop.lower, stop.upper)


def _starts(system: ImpactSystem, coefficients: np.ndarray, shape: Curve, contact: int) -> Starts:
    return Starts(planar_system(system), coefficients.tolist(), shape, contact)


CROSSINGS = 6
"""Crossings searched in one flight. A longer flight between impacts has more."""

NARROWINGS = 6
"""Steps that narrow a bracket before Newton's method takes over, by the secant and by halving."""


class Sampler:
    """Scans one system, which must be two-dof with one stop, from the origin to a far end of one kind: "origin", "rest" or "stop".

    quarter_period: the longest. impacts: numbers of impacts inside the segment.
    """

    def __init__(self, system: ImpactSystem, end: str, quarter_period: float, impacts: Sequence[int]):
        require_system(system, two_dof="orbits are found by their names on", advice=FROM_LINEAR_MODES)
        self.end = end
        self.kind = KINDS[end]
        self.longest = quarter_period * (2.0 if end == "origin" else 1.0)
        self.impacts = impacts
        self.modes = system.modes
        self.system = planar_system(system)

    def follow(self, energy: float, angles: np.ndarray, impacts: Sequence[int], nodes: bool = False) -> tuple[np.ndarray, ...]:
        """Follow starts at the origin through up to K = max(impacts) impacts. Their modal velocities have these angles (M,).

        Returns
        -------
        starts : (M, 4) float
            Modal states at the origin.
        sequences : (M, K + 1) int
            Contacts hit, -1 after the last.
        times, residuals : (M, K + 1, C) float
            Of the crossings after each number of `impacts`, NaN if there is none.
        states, instants : (M, K, 4), (M, K) float
            After each impact, and their times; empty unless `nodes`.
        """
        most, count = max(impacts), len(angles)
        speed = np.sqrt(2.0 * energy)
        starts = np.column_stack([np.zeros((count, 2)), speed * np.cos(angles), speed * np.sin(angles)])
        crossings = 1 if self.kind == FarEnd.STOP else CROSSINGS
        sequences = np.full((count, most + 1), -1, dtype=np.int64)
        times, residuals = (np.full((count * (most + 1), crossings), np.nan) for _ in range(2))
        kept = count if nodes else 0
        states, instants = np.zeros((kept * most, 4)), np.zeros((kept, most))
        wanted = [k in impacts for k in range(most + 1)]
        self.system.scan(self.kind, starts, wanted, self.longest, sequences, times, residuals, states, instants)
        shape = count, most + 1, crossings
        return starts, sequences, times.reshape(shape), residuals.reshape(shape), states.reshape(kept, most, 4), instants

    def segments(self, energy: float, angles: int | np.ndarray) -> Iterator[ScannedSegment]:
        """The segment of each change of sign between neighbouring angles (M,), in order of the impacts and angles.

        A number of angles stands for as many in half a turn. The other half is its mirror image."""
        if isinstance(angles, int):
            angles = (np.arange(angles + 1) + 0.5) * (np.pi / angles)
        _, sequences, _, residuals, _, _ = self.follow(energy, angles, self.impacts)
        # A number for each sequence: beyond 38 impacts it needs Python's integers.
        dtype = object if sequences.shape[1] > 38 else np.int64
        code = np.cumsum((sequences + 1) * 3 ** np.arange(sequences.shape[1], dtype=dtype), axis=1)
        for k in self.impacts:
            hits = k if self.kind == FarEnd.STOP else k - 1
            same = np.ones(len(angles) - 1, bool) if hits < 0 else code[:-1, hits] == code[1:, hits]
            for c in range(residuals.shape[2]):
                for i in np.flatnonzero(same & (residuals[:-1, k, c] * residuals[1:, k, c] <= 0.0)):
                    segment = self._narrowed(energy, k, c, float(angles[i]), float(angles[i + 1]))
                    if segment is not None:
                        yield segment

    def _narrowed(self, energy: float, k: int, c: int, low: float, high: float) -> ScannedSegment | None:
        """The segment of the zero of the c-th crossing after k impacts between two angles; None if it has other impacts."""
        _, sequences, _, residuals, _, _ = self.follow(energy, np.array([low, high]), [k])
        f_low, f_high = residuals[0, k, c], residuals[1, k, c]
        hits = k + 1 if self.kind == FarEnd.STOP else k
        key = tuple(sequences[0, :hits])
        for _ in range(NARROWINGS):
            middle = 0.5 * (low + high)
            guess = low - f_low * (high - low) / (f_high - f_low) if f_high != f_low else middle
            points = np.array(sorted({middle, min(max(guess, low), high)}))
            _, sequences, _, residuals, _, _ = self.follow(energy, points, [k])
            for point, sequence, f in zip(points.tolist(), sequences, residuals[:, k, c], strict=True):
                if tuple(sequence[:hits]) != key or not np.isfinite(f) or not low <= point <= high:
                    continue
                if f * f_low > 0.0:
                    low, f_low = point, f
                else:
                    high, f_high = point, f
        best, residual = (low, f_low) if abs(f_low) < abs(f_high) else (high, f_high)
        start, sequences, times, _, states, instants = self.follow(energy, np.array([best]), [k], nodes=True)
        if -1 in sequences[0, :k] or not np.isfinite(times[0, k, c]):
            return None
        letters = [self.modes.contact_letters[contact] for contact in sequences[0]]
        end = self.end if self.kind != FarEnd.STOP else "stop" + letters[k]
        stamps = np.concatenate([[0.0], instants[0, :k], [times[0, k, c]]])
        return ScannedSegment(("origin", end), tuple(letters[:k]), start[0], states[0, :k], np.diff(stamps), best, low, high, abs(residual))
