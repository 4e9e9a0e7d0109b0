"""Stability against many digits: what is said to be stable or unstable is so, and what is left open is close to the limit.

Oracle: `tests.branches.many_digits`, which solves the orbit next to each point anew and has |tau| - 2 to thirty digits and more.
"""

from functools import cache

import numpy as np
import pytest

from branches.orbit import Orbit, orbit_columns
from tests.branches.many_digits import ManyDigits
from tests.branches.paper_names import NAMES, family

DIGITS = 150
"""Digits in which orbits are solved: those with |tau| - 2 near 1e-40 need more than twice so many."""

NEAR = 1e-6
OPEN = 1e-8
"""How far from the limit an undecided orbit may be at most."""

SAMPLED = ("S11-", "U44-", "U11+", "U(15)578-", "S31O11-", "U4122-", "S73O33-", "U8344-", "S55O11-", "no reversal", "rest and stop")


@cache
def branch_of(name):
    if name == "no reversal":
        source = family("U11+")
        breaking = next(e for e in source.events if e.type == "SB" and e.breaks == "reversal")
        return source.switch(breaking, energy=(0.05, 100.0))[0]
    if name == "rest and stop":
        source = family("S31O11-")
        root = next(e for e in source.events if e.type == "RT" and e.p_q == [1, 3])
        return next(born for born in source.switch(root, energy=(0.05, 100.0)) if born.ends[0] != "origin")
    return family(name)


def sample(branch, count):
    """Points that are undecided, those that are nearly marginal, and others: of each at most `count`, spread over them."""
    stable, tau = branch.points["stable"], branch.points["tau"]
    bounded = np.isfinite(tau)
    undecided = np.flatnonzero(bounded & (stable == -1))
    marginal = np.flatnonzero(bounded & (stable != -1) & (np.abs(np.abs(tau) - 2.0) < NEAR))
    others = np.setdiff1d(np.flatnonzero(bounded & (stable != -1)), marginal)[:: max(1, len(branch) // 3)]
    chosen = [part[np.linspace(0, len(part) - 1, min(count, len(part))).astype(int)] for part in (undecided, marginal, others)]
    return [int(i) for part in chosen for i in part]


def beside_events(branch, count):
    """Orbits of the family, by steps of 1e-7 and 1e-9 on both sides of where a multiplier passes its limit, with what is said of them."""
    out = []
    for event in [e for e in branch.events if e.type in ("SN", "SB", "PD", "BP")][:count]:
        at = branch.orbit(event.point).solution
        tangent = tangent_at(branch, event.point) if event.type == "BP" else at.tangent
        for step in (-1e-7, 1e-7, -1e-9, 1e-9):
            beside = branch.problem.step(at.y, tangent, step)
            # at a branch point an orbit can be off by more than so short a step
            if beside is not None and np.linalg.norm(beside.position - at.position) < 2.0 * abs(step):
                out.append((Orbit(branch.problem, beside), int(orbit_columns(branch.problem, [beside])["stable"][0])))
    return out


def tangent_at(branch, i):
    """Tangent of a branch at a point, from the parabola through it and its neighbours that are no events: at a branch point the equations
    give none."""
    events = {event.point for event in branch.events} - {i}
    first = next(k for k in range(i - 1, -1, -1) if k not in events)
    last = next(k for k in range(i + 1, len(branch)) if k not in events)
    (before, here, after), s = (branch.unknowns(k) for k in (first, i, last)), branch.points["arclength"]
    a, b = s[i] - s[first], s[last] - s[i]
    along = ((here - before) / a * b + (after - here) / b * a) / (a + b)
    return np.concatenate([along, np.zeros_like(along)])


def contradictions(cases):
    """Those of the orbits whose stability is another in fifty digits than is said, and how many were settled."""
    wrong, settled = [], 0
    for orbit, stable in cases:
        try:
            exact = ManyDigits(orbit, DIGITS)
        except ArithmeticError:
            # At a branch point no single orbit is next: nothing may be said there.
            if stable != -1:
                wrong.append((orbit.h, stable, "no single orbit"))
            continue
        settled += 1
        assert exact.residual < 1e-40 and exact.moved < 1e-7 * max(1.0, float(max(map(abs, exact.state))))
        right = abs(exact.margin) < OPEN if stable == -1 else (exact.margin < 0) == (stable == 1)
        if not right:
            wrong.append((orbit.h, stable, float(exact.margin)))
    return wrong, settled


@pytest.mark.parametrize("name", SAMPLED[::3])
def test_none_contradicts(name):
    """Oracle: the sign of |tau| - 2 in fifty digits. More families, points and events are in tests/full."""
    require_none_contradicts(name, 3, 1)


def require_none_contradicts(name, points, events):
    """Oracle: the sign of |tau| - 2 in fifty digits, at so many points of each kind and next to so many events."""
    branch = branch_of(name)
    cases = [(branch.orbit(i), int(branch.points["stable"][i])) for i in sample(branch, points - (branch.problem.inner > 10))]
    cases += beside_events(branch, events)
    wrong, settled = contradictions(cases)
    assert not wrong
    assert settled >= 3


def test_all_kinds_are_in_the_sample():
    """Oracle: counts: undecided, stable and unstable orbits nearer than 1e-6 to the limit."""
    kinds = {-1: 0, 0: 0, 1: 0}
    for name in SAMPLED:
        branch = branch_of(name)
        near = [i for i in sample(branch, 5) if abs(abs(branch.points["tau"][i]) - 2.0) < NEAR]
        for stable in branch.points["stable"][near]:
            kinds[int(stable)] += 1
    assert min(kinds.values()) >= 8 and sum(kinds.values()) >= 40, kinds


def test_a_wrong_answer_is_seen():
    """Oracle: the answers turned round."""
    branch = branch_of("S73O33-")
    cases = [(branch.orbit(i), 1 - int(branch.points["stable"][i])) for i in sample(branch, 4) if branch.points["stable"][i] != -1]
    wrong, settled = contradictions(cases)
    assert len(wrong) == settled == len(cases) > 4
    far = next(i for i in range(len(branch)) if branch.points["tau"][i] > 2.1)
    assert contradictions([(branch.orbit(far), -1)])[0]


@pytest.mark.parametrize(("name", "mirrored"), [("U11+", True)])
def test_next_to_a_branch_point_nothing_wrong_is_said(name, mirrored):
    """Oracle: see `require_next_to_a_branch_point_nothing_wrong_is_said`."""
    require_next_to_a_branch_point_nothing_wrong_is_said(name, mirrored)


def require_next_to_a_branch_point_nothing_wrong_is_said(name, mirrored):
    """Oracle: fifty digits; where the other side of the branch point has the same orbits, mirrored, they are as stable.

    There the solution itself is known to rounding over the smallest pivot only."""
    branch = branch_of(name)
    event = next(e for e in branch.events if e.type == "BP")
    at = branch.orbit(event.point).solution
    cases = []
    for distance in (1e-3, 1e-5, 1e-7):
        said = []
        for step in (-distance, distance):
            beside = branch.problem.step(at.y, tangent_at(branch, event.point), step)
            if beside is not None:
                said.append(int(orbit_columns(branch.problem, [beside])["stable"][0]))
                cases.append((Orbit(branch.problem, beside), said[-1]))
        assert not (mirrored and {0, 1} <= set(said))
    assert not contradictions(cases)[0]


def test_against_the_closed_form():
    """Oracle: tau_half of the backbone in forty digits: |tau| - 2 is tau_half^2 - 4 there."""
    from benchmarks.backbone import Backbone

    branch = family("S11-")
    for i in range(3, len(branch), len(branch) // 4):
        expected = Backbone().tau_half(branch.points["alpha"][i]) ** 2 - 2
        assert abs(ManyDigits(branch.orbit(i)).margin - (abs(expected) - 2)) < 1e-12 * (1 + abs(expected))


def test_what_is_undecided_is_at_an_event_or_grazes():
    """Oracle: the events of the families of the paper, each once, with those of the sample."""
    families = {branch.id: branch for branch in (*map(family, NAMES), *map(branch_of, SAMPLED))}
    assert sum(map(len, families.values())) > 2500
    for branch in families.values():
        events = [event for event in branch.events if event.type in ("SN", "BP", "SB", "PD")]
        at = {event.point for event in events} | set(np.flatnonzero(np.isnan(branch.points["tau"])).tolist())
        assert set(np.flatnonzero(branch.points["stable"] < 0).tolist()) <= at
