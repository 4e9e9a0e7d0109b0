"""Growing work on executors: the order in which it is taken, and that nothing but the time depends on who works."""

import random
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import pytest

from branches.building.frontier import Frontier


class Serial(Executor):
    """Works at once, in the caller's thread."""

    def submit(self, function, /, *args, **keywords):
        future = Future()
        try:
            future.set_result(function(*args, **keywords))
        except BaseException as error:
            future.set_exception(error)
        return future


def divisors(n):
    return [n // d for d in range(2, 6) if n // d > 0]


def explore(executor, ahead, work=divisors, start=(1000, 777)):
    """All numbers reached, each class n mod 7 being one family that is found once."""
    families, taken = {}, []
    frontier = Frontier(executor, work, lambda n: n % 7 in families, ahead)
    frontier.extend(start)
    for seed, result in frontier:
        taken.append((seed, result))
        if result is not None:
            families[seed % 7] = seed
            frontier.extend(result)
    return taken


def test_the_order_is_that_of_the_queue_for_any_number_of_workers():
    def slowly(n):
        time.sleep(random.random() * 2e-3)
        return divisors(n)

    expected = explore(Serial(), 1)
    assert len({seed % 7 for seed, result in expected if result is not None}) == sum(result is not None for _, result in expected)
    for workers, ahead in ((1, 1), (2, 3), (8, 40)):
        with ThreadPoolExecutor(workers) as pool:
            assert explore(pool, ahead, slowly) == expected


def test_what_became_known_while_it_was_worked_on_is_taken_without_result():
    taken = explore(Serial(), 100, start=(8, 1))
    assert taken[:2] == [(8, divisors(8)), (1, None)]


def test_what_its_elders_may_make_known_is_not_worked_on_ahead_of_them():
    worked = []

    def work(n):
        worked.append(n)
        return divisors(n)

    def taken(kin):
        worked.clear()
        families, out = set(), []
        frontier = Frontier(Serial(), work, lambda n: n % 7 in families, 6, *kin)
        frontier.extend((1000, 777, 41))
        for seed, result in frontier:
            out.append((seed, result))
            if result is not None:
                families.add(seed % 7)
                frontier.extend(result)
        return out, list(worked)

    plain, wasteful = taken(())
    apart, needed = taken([lambda n: n % 7])
    assert apart == plain
    assert sorted(needed) == sorted(n for n, result in plain if result is not None)
    assert len(wasteful) > len(needed)


def test_an_error_of_the_work_is_raised_at_its_turn_and_the_rest_cancelled():
    def fail(n):
        if n == 2:
            raise ArithmeticError("no orbit")
        return []

    frontier = Frontier(Serial(), fail, lambda n: False, 3)
    frontier.extend([1, 2, 3])
    results = iter(frontier)
    assert next(results) == (1, [])
    with pytest.raises(ArithmeticError, match="no orbit"):
        next(results)
