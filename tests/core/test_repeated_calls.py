"""What a call finds depends neither on calls before it nor on other threads. Oracle: a new object that is called once; to the last bit."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

import numpy as np
import pytest
import saltus_core as core

from tests.core import bound
from tests.core.test_problem import orbits


@cache
def pairs():
    """For some closures and numbers of states two orbits of one family."""
    found = []
    for problem, y in orbits(4):
        known = problem.solve(y)
        ahead = problem.step(known.y, known.tangent, 0.02)
        if ahead is not None:
            found.append(tuple(bound.Orbit.of(problem, each) for each in (known, ahead)))
    return found


def flat(values):
    """All numbers of a result, as one array."""
    if isinstance(values, list | tuple):
        return np.concatenate([np.zeros(0), *map(flat, values)])
    return np.atleast_1d(np.asarray(values, dtype=complex)).ravel()


def outcome(holder, method, arguments):
    """What a method returns, and the arrays that it got, which may be filled."""
    found = getattr(holder, method)(*arguments)
    return flat([found, *(a for a in arguments if isinstance(a, np.ndarray) and a.dtype == float)])


KINDS = {
    "problem": (lambda orbit: bound.make_problem(orbit.problem), bound.problem_calls),
    "family": (lambda orbit: bound.make_family(orbit.problem), bound.family_calls),
    "fold": (lambda orbit: bound.make_family(orbit.problem, True), lambda orbit: bound.family_calls(orbit, True)),
    "chain": (bound.make_chain, bound.chain_calls),
    "given chain": (lambda orbit: bound.make_chain(orbit, True), lambda orbit: bound.chain_calls(orbit, True)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_call_finds_the_same_after_any_other_call(kind):
    make, calls = KINDS[kind]
    compared = 0
    for first, second in pairs():
        alone = {name: outcome(make(second), method, arguments) for name, method, arguments in calls(second)}
        for name, method, arguments in calls(first):
            holder = make(second)
            outcome(holder, method, arguments)
            for after, wanted, given in calls(second):
                np.testing.assert_array_equal(outcome(holder, wanted, given), alone[after], err_msg=f"{after} after {name}")
                compared += 1
    assert compared > 30


@pytest.mark.parametrize("kind", ["problem", "family", "fold"])
def test_threads_share_an_object(kind):
    make, calls = KINDS[kind]
    for first, second in pairs()[::3]:
        holder = make(first)
        work = [call for _ in range(4) for orbit in (first, second) for call in calls(orbit)]
        alone = [outcome(holder, method, arguments) for _, method, arguments in work]
        again = [call for _ in range(4) for orbit in (first, second) for call in calls(orbit)]
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(partial(outcome, holder), *zip(*(call[1:] for call in again), strict=True)))
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, other)


def numbers_of(scan):
    return scan.counts, [(x.theta, x.flight, x.residual) for x in scan.crossings], [x.theta for x in scan.openings]


def test_a_search_at_work_refuses_other_threads():
    """Oracle: the same scan alone. What another thread asks meanwhile is refused in one sentence, or answered before or after."""
    _, _, place, curve = bound.search_parts()
    alone, scan = bound.make_scan(), bound.make_scan()
    for each in (alone, scan):
        each.begin(curve.low + 0.01, curve.high - 0.01, place, 100_000)
    assert alone.go(10**9)

    def ask():
        try:
            return scan.counts["starts"] >= 2
        except RuntimeError as error:
            return str(error) == "another thread is at work with this search"

    with ThreadPoolExecutor(1) as pool:
        work = pool.submit(scan.go, 10**9)
        asked = [ask() for _ in itertools.takewhile(lambda _: not work.done(), itertools.count())]
    assert work.result() and all(asked)
    assert numbers_of(scan) == numbers_of(alone)


def test_parts_of_a_scan_are_the_scan():
    """Oracle: the scan in one part. Records of starts are used again."""
    whole, parts = bound.scanned(10**9), bound.scanned(3)
    assert numbers_of(whole) == numbers_of(parts) and len(whole.crossings) > 0
    for one, other in zip(*(list(scan.take_arcs(0, 0, 0.0)) for scan in (whole, parts)), strict=True):
        assert isinstance(one, core.Arc)
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.rates, other.rates)


def test_a_step_without_a_direction_corrects_the_orbit():
    """Oracle: the step of length 0. There was no direction to step along, so the length counted from an earlier call's."""
    for orbit, _ in pairs():
        still = np.zeros_like(orbit.tangent)
        one, other = (orbit.problem.step(orbit.y, still, ds) for ds in (0.01, 0.0))
        np.testing.assert_array_equal(one.y, other.y)
        np.testing.assert_array_equal(one.tangent, other.tangent)
