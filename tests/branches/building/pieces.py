"""Two runs along one family: whether their events are the same on the piece that both cover."""

import math

import numpy as np

TOLERANCE, LABEL = 1e-9, 1e-7
"""Relative difference of the energies, and of the quarter periods, of one event in two runs: a zero of a test function, and a change of
the label. That is where a velocity gets a double zero, which rounding shows to its square root, 1.5e-8."""

MARGIN = 1e-4
"""Distance from an end of the common piece, relative to its length, within which an event may be on one side or the other."""


def differences(branch, start, run):
    """The events that only one of two runs has, as (type, p_q, h, alpha): those missing in the second, and those added in it.

    branch, start: a run and the place of one of its points. run: one that was started there. Ends (EP) are no events of the family.
    """
    own = [(_key(event), float(event.arclength - branch.points["arclength"][start])) for event in branch.events if event.type != "EP"]
    other = [(_key(event), float(event.arclength - run.points["arclength"][run.start])) for event in run.events if event.type != "EP"]
    piece = -math.inf, math.inf
    closed = branch.ended[0].reason == "CLOSED" and run.ended[0].reason == "CLOSED"
    if not closed:
        (first, last), (low, high) = _reach(branch, start), _reach(run, run.start)
        if not _alike(branch, start, run):
            other = [(key, -place) for key, place in other]
            low, high = -high, -low
        if branch.ended[0].reason == "CLOSED":  # the piece may pass the seam
            length = last - first
            own = [(key, place + turn * length) for key, place in own for turn in (-1, 0, 1)]
            first, last = -math.inf, math.inf
        piece = max(first, low), min(last, high)
    own, other = (_inside(events, piece) for events in (own, other))
    missing = [key for key, certain in _unmatched(own, other) if certain]
    added = [key for key, certain in _unmatched(other, own) if certain]
    return missing, added


def _key(event):
    return event.type, tuple(event.p_q or ()), event.h, event.alpha


def _reach(run, place):
    length = run.points["arclength"]
    return float(length[0] - length[place]), float(length[-1] - length[place])


def _alike(branch, start, run):
    """Whether both are in one order, by the states of their next points."""

    def away(run, place):
        states = np.hstack([run.points["start_u"], run.points["start_v"]])
        ahead = place + 1 if place + 1 < len(run) else place
        behind = place - 1 if place > 0 else place
        return states[ahead] - states[behind]

    return float(away(branch, start) @ away(run, run.start)) > 0.0


def _inside(events, piece):
    margin = MARGIN * (piece[1] - piece[0]) if math.isfinite(piece[1] - piece[0]) else 0.0
    low, high = piece
    return [
        (key, low + margin <= place <= high - margin) for key, place in events if low - margin <= place <= high + margin
    ]


def _unmatched(ones, others):
    """Those of one list that have no partner in the other. A family can have an event twice: those certainly on the piece come first."""
    left = [key for key, _ in others]
    out = []
    for key, certain in sorted(ones, key=lambda pair: not pair[1]):
        partner = next((other for other in left if _same(key, other)), None)
        if partner is None:
            out.append((key, certain))
        else:
            left.remove(partner)
    return out


def _same(one, other):
    tolerance = LABEL if one[0] == "LB" else TOLERANCE
    return one[:2] == other[:2] and all(abs(a - b) <= tolerance * abs(a) for a, b in zip(one[2:], other[2:], strict=True))
