"""Events of a catalogue's families at which the graph says nothing: neither an edge nor a dead end."""

import math

from branches.sequences import impacts_per_period, parse_ends, parse_sequence

SAME = 1e-8
"""Relative difference of the energies of one grazing orbit on two families."""


def unanswered(catalogue, rows, bounds=None, longest=math.inf):
    """Grazings, branch points and symmetry breakings of families without edge or dead end; with bounds also the period doublings and
    q-tuplings whose new orbits lie within them. longest: quarter period up to which events are asked; families beyond a build's bounds are
    kept as neighbours, and their own neighbours are not.

    One grazing orbit is unfolded once, for all the families that meet there.
    """
    edges = catalogue.edges()
    known = [(edge.h, edge.alpha) for edge in edges if edge.type == "GR"]
    own = {(id, event) for edge in edges for id, event in ((edge.source, edge.source_event), (edge.target, edge.target_event))}

    def is_asked(row, event):
        if bounds is None or event.type in ("GR", "BP", "SB"):
            return event.type in ("GR", "BP", "SB")
        times = {"PD": 2, "RT": event.p_q[1] if event.p_q else 0}.get(event.type, 0)
        impacts = impacts_per_period(parse_sequence(row.sequence), parse_ends(row.ends))
        return times > 0 and bounds.holds(alpha=times * event.alpha, impacts=times * impacts)

    def is_known(event):
        return event.type == "GR" and any(abs(event.h / h - 1.0) < SAME and _is_multiple(event.alpha, alpha) for h, alpha in known)

    low, high = (0.0, math.inf) if bounds is None else bounds.energy
    return [
        (row.id, event.id, event.h, event.alpha)
        for row in rows
        for event in catalogue.events(row.id)
        if low <= event.h <= high and event.alpha <= longest and is_asked(row, event)
        if (row.id, event.id) not in own and not is_known(event)
    ]


def _is_multiple(one, other):
    cover = max(one, other) / min(one, other)
    return abs(cover - round(cover)) < 1e-7
