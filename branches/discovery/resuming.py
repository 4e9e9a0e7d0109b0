"""Going on with a scan where floating-point numbers do not tell the starts apart any more.

Motions that part fast enough leave an interval of starts that cannot be split again and is undecided at one of its flights. The flights
before that one are decided: over such an interval the states after its impacts are a short smooth curve. That curve is scanned in its
place, with its own parameter. Its states have errors as large as their rounding, as each state that is followed has. Along the curve these
errors only change which start a state belongs to, and across it they shrink as fast as motions part, so that an orbit through the true
curve has a neighbour through this one, and Newton's method, which holds all states at once, goes from one to the other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from branches.discovery.scan import Opening, follow_start
from branches.discovery.starts import QUADRATIC, Curve
from bvp.kernels.follow import COLUMNS, CONTACT, DERIVATIVE, follow
from bvp.kernels.verdict import ENDLESS

__all__ = ["resumed"]

NARROW = 1e-12
"""Intervals wider than this, as a part of the curve or of 1, are open for another reason than rounding."""

OVERLAP = 5e-15
"""How far the image goes on beyond the interval on either side, in the parameter of either: that much rounding can move it."""

STRETCHED = 10.0
"""Images that are not this much longer than their interval, as a part of their states, are as narrow as it."""


def resumed(curve: Curve, opening: Opening, longest: float) -> Curve | None:
    """The states after the last decided impact of an open interval, as a curve of starts.

    Parameters
    ----------
    curve : Curve
        What was scanned.
    opening : Opening
        What stayed open of it.
    longest : float
        Time from the first start of all that is searched.

    Returns
    -------
    Curve or None
        None where the interval is open for another reason than rounding, so that its image would be so as well.
    """
    gone = 0 if curve.before is None else len(curve.before.contacts)
    since = 0.0 if curve.before is None else float(curve.before.instants[-1])
    flight = opening.flight - gone
    if flight < 1 or opening.reason == ENDLESS or opening.width > NARROW * max(1.0, abs(opening.parameter)):
        return None
    half = 0.5 * opening.width
    middle = opening.parameter + half
    work = np.zeros((16, 16))
    samples = []
    for parameter in (opening.parameter, middle, opening.parameter + opening.width):
        record = np.zeros((flight + 2, COLUMNS))
        if follow(curve.flow, parameter, longest - since, flight, record, work) <= flight:
            return None
        samples.append(record)
    low, here, high = samples
    if any(np.any(record[:flight, CONTACT] != here[:flight, CONTACT]) for record in samples):
        return None
    state, rate = here[flight, :4], here[flight, DERIVATIVE : DERIVATIVE + 4]
    bend = (high[flight, DERIVATIVE : DERIVATIVE + 4] - low[flight, DERIVATIVE : DERIVATIVE + 4]) / opening.width
    # By this parameter the state moves as fast as it is large, as the kernels expect of starts: their rounding is the parameter's.
    scale = float(np.max(np.abs(state)) / np.max(np.abs(rate)))
    if STRETCHED * scale > 1.0:
        return None
    reach = (half + OVERLAP * max(1.0, abs(middle))) / scale + OVERLAP
    flow = curve.flow._replace(
        start=np.array([state, scale * rate, 0.5 * scale * scale * bend]),
        shape=np.array([QUADRATIC, int(here[flight - 1, CONTACT])], dtype=np.int64),
    )
    path = follow_start(curve, middle, opening.flight, longest)
    if not path.instants[-1] < longest:
        return None
    before = path._replace(contacts=path.contacts[: opening.flight])
    piece = (curve.angle(middle), curve.piece[1] * scale)
    return replace(curve, flow=flow, low=-reach, high=reach, singular=(False, False), before=before, piece=piece)
