"""A self-excited oscillator with a vibro-impact absorber, and its periodic orbits with one impact in forty digits.

The damping of the oscillator is negative, and no load acts. So orbits scale with the gap, and the period alone determines them:
a state z after the impact with R E(T) z = s z, E(T) = exp(A T). s = 1 for an impact a period; s = -1 for two opposite ones, T being half of
the period. So det(R E(T) - s) = 0 relates T and the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mpmath as mp
import numpy as np

from branches.forced.branch import ForcedBranch
from branches.forced.tracing import follow_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem

DIGITS = 40

VALUES = {"mu": 0.1, "sigma": 0.1, "lam": 0.02, "c": 0.005, "rho": 0.7}


def self_excited_absorber(symmetric: bool, **values: float) -> ParametricSystem:
    """The absorber of the shipped scene with negative damping -lam of the oscillator. symmetric: two stops, else the upper one alone."""
    bounds = {"lower": -1.0, "upper": 1.0} if symmetric else {"upper": 1.0}
    return ParametricSystem.from_description(
        {
            "parameters": VALUES | values,
            "system": {
                "mass": [["mu", 0.0], [0.0, 1.0]],
                "damping": [["c", "-c"], ["-c", "c - lam"]],
                "stiffness": [["sigma", "-sigma"], ["-sigma", "1 + sigma"]],
                "stops": [{"c": [1.0, -1.0], "restitution": "rho", **bounds}],
            },
        }
    )


class OneImpact:
    """An orbit with one impact in the segment of duration T, at exact parameters. sign: s."""

    def __init__(self, values: Mapping[str, Any], time: Any, sign: int):
        mu, sigma, lam, c, rho = (mp.mpf(values[name]) for name in ("mu", "sigma", "lam", "c", "rho"))
        self.time, self.sign = mp.mpf(time), sign
        self.rates = mp.matrix(
            [
                [0, 0, 1, 0],
                [0, 0, 0, 1],
                [-sigma / mu, sigma / mu, -c / mu, c / mu],
                [sigma, -1 - sigma, c, lam - c],
            ]
        )
        share = (1 + rho) / (1 + mu)
        self.reset = mp.eye(4)
        for row, factor in ((2, -share), (3, mu * share)):
            self.reset[row, 2] += factor
            self.reset[row, 3] -= factor

    def flight(self, time: Any) -> mp.matrix:
        return mp.expm(self.rates * time)

    def closing(self) -> mp.mpf:
        """det(R E(T) - s)."""
        return mp.det(self.reset * self.flight(self.time) - self.sign * mp.eye(4))

    def state(self) -> mp.matrix:
        """The state (u1, u2, v1, v2) after the impact at u1 - u2 = 1: the null vector of R E(T) - s, without its last equation."""
        matrix = self.reset * self.flight(self.time) - self.sign * mp.eye(4)
        matrix[3, 0], matrix[3, 1], matrix[3, 2], matrix[3, 3] = 1, -1, 0, 0
        return mp.lu_solve(matrix, mp.matrix([0, 0, 0, 1]))

    def slope(self) -> mp.mpf:
        """p . d/dT (R E(T) - s) z with the left null vector p: zero where the derivative of the closing condition is."""
        flight = self.flight(self.time)
        transposed = (self.reset * flight - self.sign * mp.eye(4)).T
        for column in range(4):
            transposed[3, column] = 1
        left = mp.lu_solve(transposed, mp.matrix([0, 0, 0, 1]))
        return (left.T * self.reset * self.rates * flight * self.state())[0]

    def map(self) -> mp.matrix:
        """The derivative of the map over T, times s, (4, 4): a product of the saltation matrix and the flight."""
        flight = self.flight(self.time)
        arrival = flight * self.state()
        coming, going = self.rates * arrival, self.rates * self.reset * arrival
        jump, speed = going - self.reset * coming, coming[0] - coming[1]
        saltation = self.reset.copy()
        for row in range(4):
            saltation[row, 0] += jump[row] / speed
            saltation[row, 1] -= jump[row] / speed
        return self.sign * saltation * flight

    def gap(self, time: Any) -> tuple[mp.mpf, mp.mpf]:
        """u1 - u2 and its rate."""
        at = self.flight(time) * self.state()
        return at[0] - at[1], at[2] - at[3]


def exact_point(
    code: str, values: Mapping[str, float], time: float, sign: int, name: str, touch: float | None = None
) -> tuple[float, float]:
    """The value of a parameter and the duration T at a bifurcation or grazing near an orbit, the other parameters being exact.

    code: "SN": d/dT of the closing condition vanishes, too. "PD": -1 is a multiplier (of the half map: SB). "NS": a pair has the modulus
    one, so the remaining multiplier is the determinant, as another one is always 1. "GR": the gap is 1, and its rate 0, at the time touch.
    """

    def orbit(value: Any, time: Any) -> OneImpact:
        return OneImpact({**values, name: value}, time, sign)

    def conditions(value: Any, time: Any, *more: Any) -> tuple[Any, ...]:
        one = orbit(value, time)
        if code == "SN":
            return one.closing(), one.slope()
        if code == "GR":
            gap, rate = one.gap(more[0])
            return one.closing(), gap - 1, rate
        derivative = one.map()
        critical = -1 if code == "PD" else mp.det(derivative)
        return one.closing(), mp.det(derivative - critical * mp.eye(4))

    with mp.workdps(DIGITS):
        start = [mp.mpf(values[name]), mp.mpf(time), *([] if touch is None else [mp.mpf(touch)])]
        found = mp.findroot(conditions, start, tol=mp.mpf(10) ** -40)
        return float(found[0]), float(found[1])


def neutral_damping(values: Mapping[str, float]) -> float:
    """The value of lam near the given one at which a linear mode neither grows nor decays: the condition of Hurwitz for
    x^4 + a3 x^3 + a2 x^2 + a1 x + a0."""
    with mp.workdps(DIGITS):
        mu, sigma, c = (mp.mpf(values[name]) for name in ("mu", "sigma", "c"))

        def condition(lam: Any) -> Any:
            a3 = c / mu + c - lam
            a2 = sigma / mu + 1 + sigma - c * lam / mu
            a1 = (c - sigma * lam) / mu
            return a3 * a2 * a1 - a1**2 - a3**2 * sigma / mu

        return float(mp.findroot(condition, mp.mpf(values["lam"])))


def family(symmetric: bool, values: Mapping[str, float], time: float, interval: tuple[float, float]) -> ForcedBranch:
    """The family over lam through the orbit with one impact whose segment lasts about so long."""
    values = VALUES | dict(values)
    sign = -1 if symmetric else 1
    with mp.workdps(DIGITS):
        exact = mp.findroot(lambda t: OneImpact(values, t, sign).closing(), mp.mpf(time))
        state = OneImpact(values, exact, sign).state()
    problem = ForcedProblem(self_excited_absorber(symmetric, **values), ("+",), ("lam",), half=symmetric)
    start = problem.pack([np.array(state.tolist(), dtype=float).ravel()], [0.0], [values["lam"]], [float(exact)])
    return follow_response(problem, start, interval)
