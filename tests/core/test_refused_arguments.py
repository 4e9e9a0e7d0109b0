"""Arguments of every function of the core that cannot be right: it refuses them in one sentence, or answers; no process ends.

Oracle: the names of the module, each of which has a call that succeeds. Sizes, types, orders and numbers are changed one at a time.
"""

import numpy as np
import pytest
import saltus_core as core

from tests.core import bound
from tests.core.test_repeated_calls import pairs

REFUSED = (TypeError, ValueError, RuntimeError, IndexError, OverflowError)

WHOLE = (-1, -2, 0, 7, 10**6, 2**31 - 1, 2**40)
REAL = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300)


def others(value):
    """What is given in the place of an argument."""
    if isinstance(value, np.ndarray):
        yield from (None, "x", value.tolist(), value.astype(complex), np.zeros(value.shape, np.float32))
        yield from (value[..., None], value.ravel()[:0])
        yield from (np.zeros((0,) * value.ndim, value.dtype), np.zeros([n + 1 for n in value.shape], value.dtype))
        for axis in range(value.ndim):
            yield np.ascontiguousarray(np.repeat(value, 2, axis))
            yield np.ascontiguousarray(np.take(value, range(value.shape[axis] - 1), axis))
            yield np.take(value, np.zeros(0, dtype=int), axis)
        yield np.repeat(value, 2, -1)[..., ::2]
        kept = value.copy()
        kept.flags.writeable = False
        yield kept
        numbers = REAL if value.dtype.kind in "fc" else (-1, -2, 5, 10**6, -(2**40), 2**62)
        yield from (np.full_like(value, number) for number in numbers)
    elif isinstance(value, list | tuple):
        yield from (None, 1.0, [], [*value, *value], list(value[:-1]), ["x"], [None] * len(value))
        for k, entry in enumerate(value):
            yield from ([*value[:k], other, *value[k + 1 :]] for other in others(entry))
    elif isinstance(value, bool):
        yield from (None, 2, "x")
    elif isinstance(value, int):
        yield from (None, "x", 0.5, *WHOLE)
    elif isinstance(value, float):
        yield from (None, "x", *REAL)
    elif isinstance(value, complex):
        yield from (None, "x", complex(np.nan, np.nan))
    else:
        yield from (None, "x", 1)


def attempt(function, arguments, named):
    try:
        function(*arguments)
    except REFUSED as error:
        # The binding's own refusals list the types that it takes.
        text = str(error)
        assert "\n" not in text or "incompatible function arguments" in text, (named, text)


def try_all(holder, name, arguments):
    """One call that succeeds, then those with one argument changed."""
    function, named = getattr(holder, name), f"{getattr(holder, '__name__', type(holder).__name__)}.{name}"
    function(*arguments)
    for k, value in enumerate(arguments):
        for other in others(value):
            attempt(function, (*arguments[:k], other, *arguments[k + 1 :]), named)
    if arguments:
        with pytest.raises(TypeError):
            function()


def public(place):
    return {name for name in dir(place) if not name.startswith("_")}


def test_functions():
    """Oracle: no public name of the module is left out."""
    tried = set()
    orbit = pairs()[0][0]
    for holder, name, arguments in bound.function_calls(orbit):
        try_all(holder, name, arguments)
        tried.add((getattr(holder, "__name__", type(holder).__name__).removeprefix("saltus_core."), name))
    for place in (core, core.double_double, core.quad_double, core.complex, core.jets):
        short = place.__name__.removeprefix("saltus_core.")
        functions = {name for name in public(place) if type(getattr(place, name)).__name__ == "nb_func"}
        assert {(short, name) for name in functions} <= tried
    methods = {"AnyProblem", "OrbitProblem", "ForcedProblem", "OrbitFamily", "Chain"}  # below
    for name in public(core):
        kind = getattr(core, name)
        if type(kind).__name__ == "nb_type" and name not in methods:
            called = {x for x in public(kind) if type(getattr(kind, x)).__name__ == "nb_method"}
            assert {(name, x) for x in called} <= tried


def test_problems():
    for orbit, _ in pairs():
        try_problem(orbit)


def try_problem(orbit):
    seen = set()
    holder = bound.make_problem(orbit.problem)
    for _, method, arguments in bound.problem_calls(orbit):
        try_all(holder, method, arguments)
        seen.add(method)
    assert seen == {x for x in public(core.OrbitProblem) if type(getattr(core.OrbitProblem, x)).__name__ == "nb_method"}
    for fold_only in (False, True):
        holder = bound.make_family(orbit.problem, fold_only)
        for _, method, arguments in bound.family_calls(orbit, fold_only):
            try_all(holder, method, arguments)
    for given in (False, True):
        holder = bound.make_chain(orbit, given)
        for _, method, arguments in bound.chain_calls(orbit, given):
            try_all(holder, method, arguments)


def test_orbits_under_loads():
    kind, arguments = bound.make_forced()
    holder, seen = kind(*arguments), set()
    for _, method, given in bound.forced_calls():
        try_all(holder, method, given)
        seen.add(method)
    assert seen == {x for x in public(kind) if type(getattr(kind, x)).__name__ == "nb_method"}
    for k, value in enumerate(arguments):
        for other in others(value):
            try:
                made = kind(*arguments[:k], other, *arguments[k + 1 :])
            except REFUSED:
                continue
            for _, method, given in bound.forced_calls():
                attempt(getattr(made, method), given, (kind, k))


def constructions(orbit):
    """The classes of problems, with arguments that they take."""
    problem = orbit.problem
    half, size = problem.half, problem.size
    flight, contacts = bound.core_of(problem.system.modes)
    observed = problem.observed
    yield core.OrbitProblem, (
        flight, contacts, np.array(problem.contacts, dtype=np.int64), tuple(map(int, problem.kinds)), problem.quarters,
        problem.modes.pace, *(np.ascontiguousarray(x, dtype=float) for x in (
            problem.start_map, problem.start_offset, problem.end_map, problem.end_offset, observed.rows.reshape(-1, size),
            *observed.bounds, problem.held, problem.free.reshape(-1, half))),
        True,
    )  # fmt: skip
    bounds, count = (-1.0, 1.0, 3.0, 2e-13), bound.count_of(problem, 1)
    yield core.OrbitFamily, (bound.make_problem(problem), [0, 1], [1e-5, 1e-5], *bounds, [-1.0], count, 12)
    yield core.Chain, (flight, contacts, np.zeros((0, half)), True, True, False)


def test_objects_of_wrong_parts():
    """What is made in spite of a changed part is asked for all that it computes."""
    for orbit, _ in pairs():
        make_wrongly(orbit)


def make_wrongly(orbit):
    for kind, arguments in constructions(orbit):
        kind(*arguments)
        calls = {core.OrbitProblem: bound.problem_calls, core.OrbitFamily: bound.family_calls, core.Chain: bound.chain_calls}[kind]
        for k, value in enumerate(arguments):
            for other in others(value):
                try:
                    made = kind(*arguments[:k], other, *arguments[k + 1 :])
                except REFUSED:
                    continue
                for _, method, given in calls(orbit):
                    attempt(getattr(made, method), given, (kind, k))


def test_results_in_arrays_of_another_kind_are_not_lost():
    """An array that is filled has to be the one that the caller has: what would have to be copied is refused."""
    flight = bound.core_of(pairs()[0][0].problem.system.modes)[0]
    rows, z = np.zeros((3, flight.size)), np.ones(flight.size)
    for times in (np.zeros(9, np.float32), np.zeros(18)[::2], [0.0] * 9):
        with pytest.raises(TypeError, match="incompatible function arguments"):
            core.crossing_times(flight, rows, z, 5.0, times)
