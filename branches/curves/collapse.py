"""Where a curve of doubled orbits, or of orbits without symmetry, ends at the orbits that they emanate from.

A curve SN of doubled orbits ends at a generalised period doubling, one of orbits without symmetry at a degenerate pitchfork. One of
another bifurcation ends where that meets the doubling, or the symmetry breaking, of the single orbits. A curve of their grazings ends
where the doubling, or the symmetry breaking, grazes itself. There the equations of the wider problem are singular, and steps fail nearby.
The point is located on the curve PD, or SB, of the single orbits, where it is regular.
"""

from __future__ import annotations

import math

import numpy as np

from branches.curves.ends import BLURRED, REACH, End, Follow, ending, is_singular, singular_event
from branches.curves.free import FOLD, names_quarter_period
from branches.curves.record import BifurcationCurve
from branches.curves.single_orbits import APART, apart_from_single, narrowed, widened, without_grazing
from branches.curves.touch_at_rest import touch_at_rest

__all__ = ["with_collapsed_ends"]

_ROOT = 1.5e-8
"""The root of rounding, to which the equations of the wider orbits determine the point."""

_MEETINGS = {"SB": ("R2",), "PD": ("FF",), "NS": ("FF", "PN")}
"""The events of the single orbits at which another curve than of folds or grazings ends."""


def with_collapsed_ends(curve: BifurcationCurve, follow: Follow) -> BifurcationCurve:
    """A curve whose ends at the orbits that it emanates from are located there.

    Parameters
    ----------
    curve : BifurcationCurve
    follow : callable
        Gives the curve PD or SB of the single orbits near a place.
    """
    free = curve.free
    if curve.closed or (free is not None and free.symmetry == FOLD and names_quarter_period(curve.plane) and not free.in_energy):
        return curve
    for last in (False, True):
        end = _collapse(curve, last, follow) or touch_at_rest(curve, last, follow)
        curve = curve if end is None else ending(curve, last, end)
    return curve


def _collapse(curve: BifurcationCurve, last: bool, follow: Follow) -> End | None:
    """The end at the single orbits; None where there is none."""
    place = len(curve) - 1 if last else 0
    if not is_singular(curve, last):
        return None
    singular = singular_event(curve, last)
    unknowns = curve.unknowns[:, : curve.plane.size]
    narrow = narrowed(*without_grazing(curve, unknowns[place]))
    if narrow is None or narrow.apart > APART:
        return None
    near = narrow.apart < BLURRED
    if singular is not None and singular.status == "located" and not near:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    wanted = _MEETINGS.get(curve.code) or {"PD": ("GPD", "PD-GR"), "SB": ("DP", "SB-GR")}[narrow.code]
    here = curve.parameters[place]
    found = [(float(np.abs(base.parameters[event.point] / here - 1.0).max()), event) for event in base.events if event.type in wanted]
    distance, event = min(found, key=lambda one: one[0], default=(math.inf, None))
    # The orbits part from their image as the root of the distance from a doubling. On a grazing they do in proportion to that from its end.
    reach = narrow.apart if near and curve.grazing is not None else narrow.apart**2
    if event is None or not distance <= REACH * reach + _ROOT:
        return None
    rows = unknowns[::-1] if last else unknowns
    blurred = next((k for k, y in enumerate(rows) if not apart_from_single(*without_grazing(curve, y)) < BLURRED), len(curve))
    left = min(max(blurred, int(any(event.point == place for event in curve.events))), len(curve) - 1)
    whole = widened(base.plane.problem, base.unknowns[event.point, : base.plane.size], curve.plane.problem, rows[left])
    words = "are symmetric" if base.code == "SB" else "are those of half the period, traversed twice"
    named = {
        "GPD": ": generalised period doubling", "DP": ": degenerate pitchfork",
        "PD-GR": ": their doubling grazes", "SB-GR": ": their symmetry breaking grazes",
    }  # fmt: skip
    note = f"the orbits {words}{named.get(event.type, f', with {event.note}')}"
    return None if whole is None else End(base, event, whole, left, note)
