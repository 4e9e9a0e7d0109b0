"""Second and third derivatives of the multipoint problem: differences of the Jacobian, and of a residual in many digits."""

from __future__ import annotations

from itertools import product
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.curvature import differences_along, third_differences
from bvp.forced import ForcedProblem
from bvp.forcing import Harmonic
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop

KINDS = ("period", "half", "sticking", "free", "origin stop", "rest origin", "stop rest", "closed")


def second_along(problem, y, a):
    """F''(y)[a, .] of a problem."""
    return problem.curvature.second_along(y, a)


def third(problem, y, a, b, c):
    """F'''(y)[a, b, c] of a problem."""
    return problem.curvature.third(y, a, b, c)


def description(n: int, kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """A system whose numbers all depend on the parameters a, b and c."""
    loses = kind in ("period", "half", "sticking", "free")
    row = [1.0, *rng.uniform(-0.6, 0.6, n - 1).round(2).tolist()]

    def symmetric(texts, off):
        return [[texts[i % len(texts)] if i == j else off[(i + j) % len(off)] for j in range(n)] for i in range(n)]

    bounds = {"upper": "a + b/4"} if kind in ("sticking", "closed") else {"upper": "a + b/4", "lower": "-a - b/4"}
    system: dict[str, Any] = {
        "mass": symmetric(["1 + a*b/3", "1.2", "b"], ["0.1*a", 0.05]),
        "stiffness": symmetric(["1 + exp(c - 1)", "2*b**2", "1.5 + a"], ["-b*c/5", -0.2]),
        "stops": [{"c": row, **bounds}],
    }
    found: dict[str, Any] = {"parameters": {"a": 0.9, "b": 1.1, "c": 0.8}, "system": system, "forces": []}
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
    return problem, random_unknowns(problem, rng)


def random_unknowns(problem, rng, size=1.0, times=(0.3, 1.5)):
    """Unknowns that are no orbit, from states of a size and flight times in a range, at the default parameters."""
    y = rng.uniform(-size, size, problem.unknowns)
    problem.released_values(y)[:] = [problem.values[name] for name in problem.released]
    lasting = rng.uniform(*times, problem.inner + 1)
    if problem.has_clock:
        problem.instants(y)[:] = 0.1 + problem.closing[1] * (np.cumsum(lasting) - lasting) / lasting.sum()
    else:
        problem.flight_times(y)[:] = lasting
    return with_rest(problem, y)


def with_rest(problem, y):
    """The velocities of stops that stick are zero."""
    n = problem.degrees_of_freedom
    for i, state in enumerate(problem.states(y)):
        for row in problem.contact_modes.made[problem.contact_modes.mode[i]].rows:
            state[n:] -= row * (row @ state[n:]) / (row @ row)
    return y


def directions(problem, count, rng):
    """Directions along which sticking stops rest."""
    return [with_rest(problem, rng.normal(size=problem.unknowns)) for _ in range(count)]


CASES = st.tuples(
    st.integers(1, 3), st.sampled_from(KINDS), st.integers(0, 3), st.sampled_from(["a", "b", "cb", "ac", "abc"]), st.integers(0, 10**6)
)


@settings(max_examples=16, deadline=None, derandomize=True)
@given(CASES)
def test_derivatives_are_differences_of_the_jacobian(case):
    """Oracle: extrapolated differences of the Jacobian, right to 1e-9; symmetry; complex directions."""
    n, kind, impacts, released, seed = case
    rng = np.random.default_rng(seed)
    problem, y = problem_of(n, kind, impacts, list(released), rng)
    a, b, c = directions(problem, 3, rng)
    along, there = second_along(problem, y, a), differences_along(problem, y, a)
    level = np.abs(there).max()
    assert along @ b == pytest.approx(there @ b, abs=1e-9 * level)
    assert along @ b == pytest.approx(second_along(problem, y, b) @ a, abs=1e-12 * level)
    assert problem.second_derivative(y, a, b) == pytest.approx(along @ b, abs=1e-12 * level)
    cubic = third_differences(problem, y, a, b, c)
    assert third(problem, y, a, b, c) == pytest.approx(cubic, abs=1e-7 * (level + np.abs(cubic).max()))
    both = second_along(problem, y, a + 2j * b)
    assert both.real == pytest.approx(along, abs=1e-12 * level)
    assert both.imag == pytest.approx(2.0 * second_along(problem, y, b), abs=1e-12 * level)
    known = third(problem, y, a, b, a) + 1j * third(problem, y, a, b, b)
    assert third(problem, y, a, b, a + 1j * b) == pytest.approx(known, abs=1e-12 * np.abs(known).max())


def many_digit_residual(problem, y):
    """The equations in mpmath, by exponentials of matrices. A row is (u, v, s, parameters, flight time)."""
    n, count = problem.degrees_of_freedom, len(problem.released)
    width, values = 2 * n + 1 + count, list(y[len(y) - count :])
    content = problem.parametric.description
    own = [list(y[i * (2 * n + 1) : (i + 1) * (2 * n + 1)]) for i in range(problem.inner + 1)]
    rows = []
    for i, (time, *state) in enumerate(own):
        lasting, begin = time, mp.mpf(0)
        if problem.has_clock:
            at = {name: mp.mpf(value) for name, value in problem.values.items()} | dict(zip(problem.released, values, strict=True))
            later = own[i + 1][0] if i < problem.inner else own[0][0] + (mp.mpf(1) / 2 if problem.half else 1)
            lasting, begin = (later - time) * 2 * mp.pi * problem.load_periods / at["w"], time
        rows.append([*state, begin, *values, lasting])

    def numbers(node):
        at = {name: mp.mpf(value) for name, value in problem.values.items()}
        at.update(zip(problem.released, node[2 * n + 1 : width], strict=True))

        def read(item):
            if isinstance(item, str):
                return sympy.lambdify(list(map(sympy.Symbol, at)), sympy.sympify(item), "mpmath")(*at.values())
            return [read(part) for part in item] if isinstance(item, list) else mp.mpf(item)

        return read, at

    def parts(node):
        read, at = numbers(node)
        system = content["system"]
        flexible = mp.matrix(read(system["mass"])) ** -1
        stiffness = mp.matrix(read(system["stiffness"]))
        damping = mp.matrix(read(system["damping"])) if "damping" in system else mp.zeros(n)
        gap = mp.matrix([read(system["stops"][0]["c"])])
        return read, at, flexible, stiffness, damping, gap

    def load_at(node, phase):
        read, at, *_ = parts(node)
        total = mp.zeros(n, 1)
        for force in content["forces"]:
            if "constant" in force:
                size = read(force["constant"])
            else:
                size = read(force["amplitude"]) * mp.cos(force["harmonic"] * phase + mp.mpf(force.get("phase", 0)))
            total += mp.matrix(read(force["load"])) * size
        return total

    def flown(node, i):
        read, at, flexible, stiffness, damping, gap = parts(node)
        rests = len(problem.contact_modes.made[problem.contact_modes.mode[i]].rows) > 0
        project = mp.eye(n)
        if rests:
            project -= flexible * gap.T * (gap * flexible * gap.T) ** -1 * gap
        harmonics = list(problem.parametric.layout.harmonics)
        size = 2 * n + 1 + 2 * len(harmonics)
        rates, start = mp.zeros(size), mp.zeros(size, 1)
        rates[:n, n : 2 * n] = project
        rates[n : 2 * n, :n], rates[n : 2 * n, n : 2 * n] = -project * flexible * stiffness, -project * flexible * damping
        velocity = project * mp.matrix(node[n : 2 * n])
        for r in range(n):
            start[r], start[n + r] = node[r], velocity[r]
        phase = 2 * mp.pi * problem.load_periods * node[2 * n]
        start[2 * n] = 1
        for force in content["forces"]:
            drive = project * flexible * mp.matrix(read(force["load"]))
            if "constant" in force:
                rates[n : 2 * n, 2 * n] += drive * read(force["constant"])
                continue
            at_h = 2 * n + 1 + 2 * harmonics.index(force["harmonic"])
            rates[n : 2 * n, at_h] += drive * read(force["amplitude"]) * mp.cos(mp.mpf(force.get("phase", 0)))
            rates[n : 2 * n, at_h + 1] -= drive * read(force["amplitude"]) * mp.sin(mp.mpf(force.get("phase", 0)))
        for h, k in enumerate(harmonics):
            place = 2 * n + 1 + 2 * h
            start[place], start[place + 1] = mp.cos(k * phase), mp.sin(k * phase)
            rates[place, place + 1], rates[place + 1, place] = -k * at["w"], k * at["w"]
        return list((mp.expm(rates * node[width], "taylor") * start)[: 2 * n])

    def struck(state, node, plastic=False):
        read, _, flexible, _, _, gap = parts(node)
        bounce = 0 if plastic else read(content["system"]["stops"][0].get("restitution", 1))
        kick = flexible * gap.T * (gap * mp.matrix(state[n:])) / (gap * flexible * gap.T)[0]
        return [*state[:n], *(mp.matrix(state[n:]) - (1 + bounce) * kick)]

    def distance(u, node, letter):
        read, *_, gap = parts(node)
        return (gap * mp.matrix(u))[0] - read(content["system"]["stops"][0]["upper" if letter == "+" else "lower"])

    def force_at(node):
        _, _, flexible, stiffness, damping, gap = parts(node)
        load = load_at(node, 2 * mp.pi * problem.load_periods * node[2 * n])
        pull = load - stiffness * mp.matrix(node[:n]) - damping * mp.matrix(node[n : 2 * n])
        return (gap * flexible * pull)[0] / (gap * flexible * gap.T)[0]

    letters = [problem.modes.contact_letters[c] if c >= 0 else None for c in problem.contacts]
    out = []
    for i, row in enumerate(rows):
        opens = problem.contact_modes.release[i] >= 0
        state = flown(row, i)
        hit = letters[i] is not None and not opens
        state = struck(state, row, plastic=i == problem.inner and bool(problem.ends) and problem.ends[0] != "periodic") if hit else state
        if i < problem.inner:
            after = rows[i + 1]
            out += [a - b for a, b in zip(state, after[: 2 * n], strict=True)]
            made = problem.contact_modes.made[problem.contact_modes.mode[i]]
            out.append(made.weight[0] * force_at(after) if opens else distance(after[:n], after, letters[i]))
    first = rows[0]
    _, at, flexible, stiffness, _, gap = parts(first)
    inertia = flexible**-1
    gradient = [*(stiffness * mp.matrix(first[:n])), *(inertia * mp.matrix(first[n : 2 * n]))]
    if not problem.ends or problem.ends[0] == "periodic":
        sign = -1 if problem.half else 1
        kick = y[len(y) - count - 1] if problem.ends else 0
        out += [a - sign * b + kick * g for a, b, g in zip(state, first, gradient, strict=False)]
        out.append(distance([sign * u for u in first[:n]], first, letters[problem.inner]) if letters[problem.inner] else first[2 * n])
    else:
        closing = []
        basis = np.linalg.qr(np.column_stack([problem.system.stops[0].gap, np.eye(n)]))[0][:, 1:]
        for end, x, node in ((problem.ends[0], first[: 2 * n], first), (problem.ends[1], state, rows[-1])):
            if end.startswith("stop"):
                rest = struck(x, node, plastic=True)[n:]
                closing += [distance(x[:n], node, end[-1]), *(mp.matrix(basis.T.tolist()) * mp.matrix(rest))]
            else:
                closing += x[:n] if end == "origin" else x[n:]
        out += closing
    at["energy"] = sum(g * x for g, x in zip(gradient, first, strict=False)) / 2
    at["quarter_period"] = sum(row[width] for row in rows) / getattr(problem, "quarters", 4)
    for equation in problem.keep:
        left, right = (sympy.sympify(side) for side in equation.split("="))
        out.append(sympy.lambdify(list(map(sympy.Symbol, at)), left - right, "mpmath")(*at.values()))
    return mp.matrix(out)


@pytest.mark.parametrize("kind", ["free", "closed", "period", "half", "origin stop"])
def test_derivatives_are_those_of_a_residual_in_many_digits(kind):
    """Oracle: see `require_derivatives_are_those_of_a_residual_in_many_digits`."""
    require_derivatives_are_those_of_a_residual_in_many_digits(kind)


def require_derivatives_are_those_of_a_residual_in_many_digits(kind):
    """Oracle: differences in 60 digits of a residual that is written again, with steps of 1e-15 along random directions."""
    rng = np.random.default_rng(len(kind))
    problem, y = problem_of(1 if kind == "free" else 2, kind, 1, ["b", "c"], rng)
    a, b, c = rng.normal(size=(3, problem.unknowns))
    exact = {2: problem.second_derivative(y, a, b), 3: third(problem, y, a, b, c)}
    twins = many_digit_derivatives(lambda place: many_digit_residual(problem, place), y, (a, b, c))
    assert twins[0] == pytest.approx(problem.residual(y), abs=1e-12)
    for order, found in exact.items():
        assert found == pytest.approx(twins[order], abs=1e-12 * np.abs(twins[order]).max())


def many_digit_derivatives(residual, y, directions):
    """A residual in mpmath (a matrix of one column) and its derivatives along no direction, the first, the first two, and so on."""
    step, found = mp.mpf(10) ** -15, []
    with mp.workdps(70):
        for order in range(len(directions) + 1):
            total = None
            for signs in product((1, -1), repeat=order):
                place = [mp.mpf(float(v)) for v in y]
                for sign, direction in zip(signs, directions, strict=False):
                    place = [v + sign * step * mp.mpf(float(d)) for v, d in zip(place, direction, strict=True)]
                value = residual(place) * int(np.prod(signs))
                total = value if total is None else total + value
            found.append(np.array((total / (2 * step) ** order).T.tolist()[0], dtype=float))
    return found


def test_forces_of_python_functions_are_differentiated_by_differences():
    """Oracle: the exact derivatives of the linear system, from which a weak spring differs by rounding."""
    stop = Stop((1.0,), upper=0.3, restitution=0.6)
    spring = Spring((1.0,), force=lambda w: 1e-16 * (np.sinh(w) - w))
    load = [Harmonic(1.1, [1.0])]
    linear, smooth = (
        ForcedProblem(ParametricSystem.of(ImpactSystem([[1.2]], [[0.3]], [[1.7]], [stop], springs=springs), load), ("+",), ("w",))
        for springs in ((), (spring,))
    )
    assert smooth.is_smooth and not smooth.curvature.is_exact and linear.curvature.is_exact
    rng = np.random.default_rng(3)
    y = linear.pack([[0.3, -0.7]], [0.2], [1.1], [3.1])
    a, b, c = rng.normal(size=(3, linear.unknowns))
    along, cubic = second_along(linear, y, a), third(linear, y, a, b, c)
    assert second_along(smooth, y, a) == pytest.approx(along, abs=1e-9 * np.abs(along).max())
    assert third(smooth, y, a, b, c) == pytest.approx(cubic, abs=1e-7 * np.abs(cubic).max())
    turned = third(smooth, y, a + 1j * b, b + 1j * a, c)
    known = third(linear, y, a + 1j * b, b + 1j * a, c)
    assert turned == pytest.approx(known, abs=1e-7 * np.abs(known).max())
