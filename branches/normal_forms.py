"""Normal forms of the events of a family in the energy."""

from __future__ import annotations

from collections.abc import Iterable

from branches.branch import Branch
from branches.events import FREE_NORMAL_FORMS, BranchEvent
from branches.orbit import Orbit
from bvp.kernels.hook import NotInterpretedError, interpreted

__all__ = ["normal_form_at", "with_normal_forms"]

_FEW = 1000
"""Flights of a first run, times n^3, up to which it takes longer to compile the kernels than to run them in Python."""


def with_normal_forms(branch: Branch, known: Iterable[BranchEvent] = ()) -> Branch:
    """A branch whose folds, broken symmetries and period doublings have their coefficients.

    Parameters
    ----------
    branch : Branch
    known : iterable of BranchEvent
        Those that have them already, in any order and with any id.

    Examples
    --------
    >>> import saltus
    >>> branch = with_normal_forms(saltus.trace("S13O00+", saltus.vibro_impact_nes(mu=0.1, sigma=0.1), energy=(0.2, 1.0)))
    >>> branch.event("SB1").normal_form
    'subcritical 1.267'
    """
    forms = {(event.type, event.h, event.alpha): event for event in known}
    events, new = [], []
    for k, event in enumerate(branch.events):
        same = forms.get((event.type, event.h, event.alpha))
        if same is not None:
            event = event._replace(coefficient=same.coefficient, criticality=same.criticality)
        elif event.type in FREE_NORMAL_FORMS and event.coefficient is None:
            new.append(k)
        events.append(event)
    for k in new:
        events[k] = normal_form_at(branch.orbit(events[k].point), events[k], len(new))
    return branch.of_same_orbits(events=tuple(events))


def normal_form_at(orbit: Orbit, event: BranchEvent, count: int = 1) -> BranchEvent:
    """An event with the coefficient of its normal form, where it has one. orbit: the one at the event. count: how many events of the
    family are known to need one."""
    if event.type not in FREE_NORMAL_FORMS:
        return event
    from branches.released.criticality import free_criticality

    problem = orbit.problem
    try:
        with interpreted(count * (problem.inner + 1) * problem.half**3 <= _FEW):
            found = free_criticality(orbit, event.type)
    except NotInterpretedError:
        found = free_criticality(orbit, event.type)
    return event if found is None else event._replace(coefficient=found.coefficient, criticality=found.kind)
