"""Second and third derivatives of the multipoint problem: differences of the Jacobian, and of a residual in many digits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.curvature import differences_along, second, second_along, third, third_differences
from bvp.expansion import expanded
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem

KINDS = ("period", "half", "sticking", "free", "origin stop", "rest origin", "stop rest", "closed")


def description(n, kind, rng):
    """A system whose numbers all depend on the parameters a, b and c."""
    loses = kind in ("period", "half", "sticking", "free")
    row = [1.0, *rng.uniform(-0.6, 0.6, n - 1).round(2).tolist()]

    def symmetric(texts, off):
        return [[texts[i % len(texts)] if i == j else off[(i + j) % len(off)] for j in range(n)] for i in range(n)]

    bounds = {"upper": "a + b/4"} if kind in ("sticking", "closed") else {"upper": "a + b/4", "lower": "-a - b/4"}
    system = {
        "mass": symmetric(["1 + a*b/3", "1.2", "b"], ["0.1*a", 0.05]),
        "stiffness": symmetric(["1 + exp(c - 1)", "2*b**2", "1.5 + a"], ["-b*c/5", -0.2]),
        "stops": [{"c": row, **bounds}],
    }
    found = {"parameters": {"a": 0.9, "b": 1.1, "c": 0.8}, "system": system, "forces": []}
    if loses:
        system["damping"] = symmetric(["0.1*c", 0.05, "a**2/10"], ["-0.02*b", 0.01])
        system["stops"][0]["restitution"] = 0.0 if kind == "sticking" else "a*c**2/2"
    if loses and kind != "free":
        last = [0.0] * (n - 1) + [1.0]
        found["parameters"]["w"] = 1.3
        found["forces"] = [
            {"load": last, "amplitude": "a*c**2", "harmonic": 1, "phase": 0.4},
            {"load": row, "amplitude": "b/3", "harmonic": 3},
        ]
        if kind == "sticking":
            found["forces"].append({"load": last, "constant": "c/5"})
    return found


def problem_of(n, kind, impacts, released, rng):
    """A problem, and unknowns that are no orbit."""
    parametric = ParametricSystem.from_description(description(n, kind, rng))
    keep = ["b = a**2*c", "c = sin(a)*b"][: len(released) - 1]
    if kind in ("period", "half", "sticking", "free"):
        sequence = "+=+"[: max(2, impacts)] if kind == "sticking" else "+-+"[:impacts]
        parts = ["+=", "+"][: max(1, impacts)] if kind == "sticking" else list(sequence or "+" * (kind == "free"))
        problem = ForcedProblem(parametric, parts, released, half=kind == "half", load_periods=3 if kind == "half" else 2, keep=keep)
    else:
        ends = ("periodic", "periodic") if kind == "closed" else tuple(end.replace("stop", "stop+") for end in kind.split())
        keep = ["energy = b*c", "quarter_period*a = 1 + energy**2", "c = b*a**2"][: len(released)]
        inside = "+++"[: max(1, impacts)] if kind == "closed" else "-+-"[:impacts]
        problem = ReleasedProblem(parametric, ends, list(inside), released, keep)
    y = rng.uniform(-1.0, 1.0, problem.unknowns)
    problem.flight_times(y)[:] = rng.uniform(0.3, 1.5, problem.inner + 1)
    problem.nodes(y)[:, 2 * n + 1 :] = [problem.values[name] for name in problem.released]
    return problem, with_rest(problem, y)


def with_rest(problem, y):
    """The velocities of stops that stick are zero."""
    n = problem.degrees_of_freedom
    for i, node in enumerate(problem.nodes(y)):
        for row in problem.contact_modes.sticking(i)[0]:
            node[n : 2 * n] -= row * (row @ node[n : 2 * n]) / (row @ row)
    return y


def directions(problem, count, rng):
    """Directions along which all nodes have the same parameters, and sticking stops rest."""
    found = []
    for _ in range(count):
        a = rng.normal(size=problem.unknowns)
        nodes = problem.nodes(a)
        nodes[:, 2 * problem.degrees_of_freedom + 1 :] = nodes[0, 2 * problem.degrees_of_freedom + 1 :]
        found.append(with_rest(problem, a))
    return found


CASES = st.tuples(
    st.integers(1, 3), st.sampled_from(KINDS), st.integers(0, 3), st.sampled_from(["a", "b", "cb", "ac", "abc"]), st.integers(0, 10**6)
)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(CASES)
def test_derivatives_are_differences_of_the_jacobian(case):
    """Oracle: the compiled residual and Jacobian; extrapolated differences of the Jacobian, right to 1e-9; symmetry."""
    n, kind, impacts, released, seed = case
    rng = np.random.default_rng(seed)
    problem, y = problem_of(n, kind, impacts, list(released), rng)
    a, b, c = directions(problem, 3, rng)
    size = 1.0 + np.abs(problem.jacobian(y)).max()
    found = expanded(problem, y, (a, b, c))
    assert found[0] == pytest.approx(problem.residual(y), abs=1e-12)
    assert found[2] == pytest.approx(problem.jacobian(y) @ b, abs=1e-12 * size)
    along, there = second_along(problem, y, a), differences_along(problem, y, a)
    level = np.abs(there).max()
    assert along @ b == pytest.approx(there @ b, abs=1e-9 * level)
    assert along @ c == pytest.approx(found[5], abs=1e-12 * level)
    assert along @ b == pytest.approx(second_along(problem, y, b) @ a, abs=1e-12 * level)
    assert second(problem, y, a, b) == pytest.approx(along @ b, abs=1e-12 * level)
    cubic = third_differences(problem, y, a, b, c)
    assert third(problem, y, a, b, c) == pytest.approx(cubic, abs=1e-7 * (level + np.abs(cubic).max()))
