"""Responses of systems with smooth forces. Oracle: harmonic balance, with folds and broken symmetry as roots of its own equations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from transitions.response.measures import measures_along
from transitions.response.tracing import trace_response

DUFFING = ParametricSystem.from_description(
    {
        "parameters": {"F": 0.3, "w": 1.2},
        "system": {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], "springs": [{"c": [1.0], "stiffness": 1.0, "power": 3}]},
        "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}],
    }
)
ORDERS = np.arange(1, 32, 2)
ANGLES = 2.0 * math.pi * np.arange(256) / 256.0
BASIS = np.hstack([np.cos(np.outer(ANGLES, ORDERS)), np.sin(np.outer(ANGLES, ORDERS))])


def balance(found, w, amplitude=0.3):
    """Harmonic balance of x'' + 0.1 x' + x + x^3 = F cos wt: residual and its derivatives by the coefficients and by w."""
    count = len(ORDERS)
    one = np.diag(ORDERS.astype(float))
    linear = np.block([[np.eye(count) - (w * one) ** 2, 0.1 * w * one], [-0.1 * w * one, np.eye(count) - (w * one) ** 2]])
    by_w = np.block([[-2.0 * w * one**2, 0.1 * one], [-0.1 * one, -2.0 * w * one**2]]) @ found
    x, project = BASIS @ found, BASIS.T / 128.0
    load = np.zeros(2 * count)
    load[0] = amplitude
    return linear @ found + project @ x**3 - load, linear + project @ (3.0 * x[:, None] ** 2 * BASIS), by_w


def response(w, guess):
    found = guess.copy()
    for _ in range(50):
        residual, slope, _ = balance(found, w)
        change = np.linalg.solve(slope, -residual)
        found += change
        if np.abs(change).max() < 1e-15:
            break
    return found


def fold(w, guess):
    """The w at which the balance is singular: bordered equations, with differences of the null vector's equation."""
    found = guess.copy()
    _, _, right = np.linalg.svd(balance(found, w)[1])
    border = right[-1]

    def test(coefficients, value):
        slope = balance(coefficients, value)[1]
        size = len(coefficients)
        matrix = np.block([[slope, border[:, None]], [border[None, :], np.zeros((1, 1))]])
        return float(np.linalg.solve(matrix, np.append(np.zeros(size), 1.0))[-1])

    for _ in range(30):
        residual, slope, by_w = balance(found, w)
        here, h, size = test(found, w), 1e-6, len(found)
        row = np.array([(test(found + h * e, w) - test(found - h * e, w)) / (2.0 * h) for e in np.eye(size)])
        last = (test(found, w + h) - test(found, w - h)) / (2.0 * h)
        change = np.linalg.solve(np.block([[slope, by_w[:, None]], [row[None, :], np.array([[last]])]]), -np.append(residual, here))
        found, w = found + change[:-1], w + change[-1]
        if np.abs(change).max() < 1e-14:
            break
    return w, found


@pytest.fixture(scope="module")
def traced():
    (branch,) = trace_response(DUFFING, "w", (1.0, 2.2), values={"w": 2.0}, start="rest")
    return branch


def coefficients(branch, y):
    """Those of an orbit, from its own samples over half a period."""
    problem, size = branch.problem, len(ANGLES) // 2
    period = problem.period(y)
    node = problem.nodes(y)[0]
    half = np.array([problem.fly(node, period * k / len(ANGLES))[0][0] for k in range(size)])
    return BASIS.T @ np.concatenate([half, -half]) / 128.0


def test_the_folds_of_the_duffing_oscillator(traced):
    folds = [event for event in traced.events if event.type == "SN"]
    assert traced.problem.half and len(folds) == 2
    for event in folds:
        nearest = int(np.argmin(np.abs(traced.arclength - event.arclength)))
        w, _ = fold(event.values["w"], coefficients(traced, traced.unknowns[nearest]))
        assert abs(w - event.values["w"]) < 1e-9


def test_amplitudes_and_energies(traced):
    """Oracle: harmonic balance; what the damper takes is the work of the load."""
    measures = measures_along(traced)
    assert np.abs(measures.work - measures.dissipated.sum(axis=1)).max() < 1e-13
    for i in range(0, len(traced), max(1, len(traced) // 8)):
        w = float(traced.parameter[i])
        start = coefficients(traced, traced.unknowns[i])
        found = response(w, start)
        assert np.abs(found - start).max() < 1e-10
        x, v = BASIS @ found, BASIS @ (w * np.concatenate([ORDERS, ORDERS]) * np.concatenate([found[len(ORDERS) :], -found[: len(ORDERS)]]))
        assert abs(measures.rms[i, 0] - math.sqrt(np.mean(x**2))) < 1e-10
        assert abs(measures.work[i] - 0.1 * np.mean(v**2) * 2.0 * math.pi / w) < 1e-10
        fine = np.linspace(0.0, 2.0 * math.pi, 20001)
        every = np.outer(fine, ORDERS)
        largest = np.abs(np.hstack([np.cos(every), np.sin(every)]) @ found).max()
        assert -1e-12 < measures.peaks[i, 0] - largest < 1e-6


def test_the_symmetry_breaks_where_even_harmonics_are_neutral():
    """Oracle: with x of odd harmonics the linearised balance of even ones is singular there."""
    (branch,) = trace_response(DUFFING, "w", (0.8, 1.0), values={"F": 7.0, "w": 0.99}, start="rest")
    (event,) = (event for event in branch.events if event.type == "SB")
    even = np.arange(2, 41, 2)
    basis = np.hstack([np.ones((256, 1)), np.cos(np.outer(ANGLES, even)), np.sin(np.outer(ANGLES, even))])

    def determinant(w):
        nearest = int(np.argmin(np.abs(branch.arclength - event.arclength)))
        guess = coefficients(branch, branch.unknowns[nearest])
        for _ in range(30):
            residual, slope, _ = balance(guess, w, 7.0)
            guess -= np.linalg.solve(slope, residual)
        one = np.diag(even.astype(float))
        linear = np.block([[np.eye(len(even)) - (w * one) ** 2, 0.1 * w * one], [-0.1 * w * one, np.eye(len(even)) - (w * one) ** 2]])
        whole = np.eye(1 + 2 * len(even))
        whole[1:, 1:] = linear
        project = basis.T / 128.0
        project[0] *= 0.5
        sign, size = np.linalg.slogdet(whole + project @ (3.0 * (BASIS @ guess)[:, None] ** 2 * basis))
        return sign * math.exp(size - reference) if reference else size

    reference = 0.0
    reference = determinant(event.values["w"] + 1e-3)
    low, high = event.values["w"] - 1e-8, event.values["w"] + 1e-8
    assert determinant(low) * determinant(high) < 0.0


def test_an_end_says_how_perturbations_grow(monkeypatch):
    """Oracle: the multipliers of half the period of a pendulum that stays near its upper equilibrium, in one flight. In pieces the family
    goes on."""
    pendulum = ParametricSystem.from_description(
        {
            "parameters": {"w": 1.0},
            "system": {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[0.0]], "springs": [{"c": [1.0], "potential": "1-cos(w)"}]},
            "forces": [{"load": [1.0], "amplitude": 0.3, "harmonic": 1}],
        }
    )
    assert trace_response(pendulum, "w", (0.1, 2.0), start="rest")[0].ended[0].reason == "EVENT"
    monkeypatch.setattr(ForcedProblem, "most_pieces", 1)
    branch = trace_response(pendulum, "w", (0.1, 2.0), start="rest")[0]
    assert branch.ended[0].reason == "MINIMUM_STEP" and branch.problem.half
    growth = float(branch.ended[0].text.partition("grow by a factor ")[2].split()[0])
    assert abs(branch.problem.multipliers(branch.unknowns[0])[0]) < growth < 1e6
