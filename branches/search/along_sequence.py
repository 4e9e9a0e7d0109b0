"""Orbits at one energy that have a given impact sequence between given ends.

A complete scan of all starts takes long where a half period has many impacts. If the sequence is known, the starts that hit its first
impacts are a few short pieces of the curve of starts, those that hit one impact more are pieces of these, and so on. Each piece is found by
some starts, closer together at its ends, and halvings of its borders. The last pieces are scanned completely. A piece that is narrow beside
the piece before can be overlooked. A family has orbits at many energies, so that the search need not find all of them at each.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from branches.search.intervals import segment_limits, segments
from branches.search.orbit_search import Found, OrbitSearch, kept_problems
from branches.search.starts import StartCurve, curves
from branches.sequences import Ends, ImpactSequence, mirror
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem

__all__ = ["orbits_with_sequence"]

BUDGET = 100_000
"""Most starts that the scan of one piece follows."""

SHARP = 0.05
"""Part of a piece's length to which its borders are halved."""

HALVINGS = 40


def orbits_with_sequence(
    system: ImpactSystem, energy: float, ends: Ends, sequence: ImpactSequence, quarter_period: float, density: int
) -> list[Found]:
    """Orbits with these ends and this impact sequence, or an image of them; two degrees of freedom and one stop.

    Parameters
    ----------
    system, energy, quarter_period
        As for `branches.search.discovery.discover_orbits`.
    ends, sequence
        Of the orbits.
    density : int
        Starts in each piece of a curve of starts.
    """
    signs = (False, True) if system.has_odd_symmetry else (False,)
    images = dict.fromkeys(
        (mirror(between), mirror(hits)) if mirrored else (between, hits)
        for (between, hits), mirrored in product(((ends, sequence), (ends[::-1], sequence[::-1])), signs)
    )
    search = OrbitSearch(system, kept_problems(system))
    for between, hits in images:
        first, far = ("stop" if end.startswith("stop") else end for end in between)
        limits = {far: segment_limits(first, far, quarter_period, None)[:1] + (len(hits),)}
        wanted = hits + ((between[1].removeprefix("stop"),) if far == "stop" else ())
        contacts = [system.modes.contact_letters.index(letter) for letter in wanted]
        for curve in curves(system, first, energy):
            if curve.end == between[0]:
                pieces = _pieces(curve, contacts, limits[far][0], density)
                found = (segment for segment, _ in segments(system, pieces, limits, BUDGET, Counter(), []))
                own = [segment for segment in found if (segment.ends, segment.sequence) in images]
                search.solve(own, partial(MultipointProblem.solve, energy=energy))
    return [orbits[0] for group in search.found.values() for orbits in group]


def _pieces(curve: StartCurve, contacts: list[int], longest: float, density: int) -> list[StartCurve]:
    """The pieces of a curve whose starts hit these contacts first, within a time."""

    def hits(parameter: float, count: int) -> bool:
        flights = curve.starts.follow(parameter, longest, math.inf, count)
        return [flight.contact for flight in flights[:count]] == contacts[:count]

    parts_of = 0.5 - 0.5 * np.cos(math.pi * (np.arange(density) + 0.5) / density)
    pieces = [(curve.low, curve.high)]
    for count in range(1, len(contacts) + 1):
        parts = []
        for low, high in pieces:
            places = [low, *(low + (high - low) * parts_of).tolist(), high]
            inside = [False, *(hits(place, count) for place in places[1:-1]), False]
            for i in range(1, density + 1):
                if inside[i] and not inside[i - 1]:
                    j = next(k for k in range(i, density + 1) if not inside[k + 1])
                    borders = [(places[i], places[i - 1]), (places[j], places[j + 1])]
                    for _ in range(HALVINGS):
                        (within, _), (within_high, _) = borders
                        if sum(abs(good - bad) for good, bad in borders) <= SHARP * (within_high - within):
                            break
                        middles = [0.5 * (good + bad) for good, bad in borders]
                        borders = [
                            (middle, bad) if hits(middle, count) else (good, middle)
                            for middle, (good, bad) in zip(middles, borders, strict=True)
                        ]
                    parts.append((borders[0][1], borders[1][1]))
        pieces = parts
    singular = [(curve.singular[0] and low == curve.low, curve.singular[1] and high == curve.high) for low, high in pieces]
    return [replace(curve, low=low, high=high, singular=ends) for (low, high), ends in zip(pieces, singular, strict=True)]
