"""The test functions of a curve of bifurcations: where it leaves the range or the orbits, and points of codimension two."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import saltus_core as core

from branches.admissible import GRAZING, describe_grazing
from branches.curves.plane import ParameterPlane
from branches.forced.family import ForcedFamily
from branches.forced.primitive import apart_from_image, image_sign
from bvp.criticality import NormalForms
from bvp.forced import ForcedProblem
from bvp.multipoint import Solution
from continuation.curves import Held, Linearised, Null
from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction

__all__ = [
    "ANYWHERE", "NAMES", "BifurcationMonitor", "CurvePoint", "Window", "has_pair", "meeting_of", "pair_product", "window_tests",
    "window_values",
]  # fmt: skip

Window = tuple[tuple[float, float], tuple[float, float]]
"""The ranges of the two parameters."""

ANYWHERE: Window = (-math.inf, math.inf), (-math.inf, math.inf)

_ON_CIRCLE = 1e-6
"""How far from 1 the modulus of a multiplier can be where a pair is on the unit circle."""

NAMES = {
    "CP": "cusp: two folds meet",
    "GPD": "generalised period doubling: its criticality changes",
    "DP": "degenerate pitchfork: the criticality of the symmetry breaking changes",
    "GH": "Bautin point: the criticality of the Neimark-Sacker bifurcation changes",
    "R1": "1:1 resonance: two multipliers are 1",
    "R2": "1:2 resonance: two multipliers are -1",
    "R3": "1:3 resonance: a pair is exp(+-2 pi i/3)",
    "R4": "1:4 resonance: a pair is +-i",
    "FN": "fold-NS: a multiplier is 1, a pair is on the unit circle",
    "FF": "fold-flip: multipliers are 1 and -1",
    "PN": "flip-NS: a multiplier is -1, a pair is on the unit circle",
    "NN": "two pairs are on the unit circle",
}
"""Points of codimension two, by code."""


class CurvePoint(NamedTuple):
    """An orbit on a curve. solution: as a point of its problem. multipliers (2 n,). coefficient: of the normal form; nan where it is not
    known. cosine: of the angle of the pair (NS)."""

    solution: Solution
    multipliers: np.ndarray
    coefficient: float
    cosine: float


def window_tests(plane: ParameterPlane, window: Window) -> tuple[TestFunction, ...]:
    """The guards of a range, and of the domains of the parameters."""
    found = []
    for name, asked, domain in zip(plane.names, window, plane.domains, strict=True):
        for side, inside in (("lowest", asked[0] >= domain[0]), ("highest", asked[1] <= domain[1])):
            text = f"{side} value of {name} asked for" if inside else f"{name} leaves its domain here"
            found.append(TestFunction("EP", "guard", True, text))
    return tuple(found)


def window_values(plane: ParameterPlane, parameters: np.ndarray, window: Window) -> list[float]:
    """Their values."""
    found = []
    for value, asked, domain in zip(parameters.tolist(), window, plane.domains, strict=True):
        low, high = max(asked[0], domain[0]), min(asked[1], domain[1])
        found.append(value - low if low > -math.inf else 1.0)
        found.append(high - value if high < math.inf else 1.0)
    return found


def fold_coefficient(null: Null, scale: np.ndarray, sizes: np.ndarray) -> float:
    """W F''[V, V] of a fold, where W has length 1, and V in units of the orbit's sizes (u,). Its sign is that of W, which is kept along the
    curve. scale: sizes of the unknowns in which V is given."""
    m, left = len(null.shifted), null.left[:, 0]
    v = null.right[:m, 0] * scale[:m]
    part = v / sizes[:m]
    return float(left[:m] @ (null.along @ v)) / (math.sqrt(float(left @ left)) * float(part @ part))


class BifurcationMonitor:
    """The test functions of a curve of SN, PD, SB or NS of forced orbits.

    Parameters
    ----------
    plane : ParameterPlane
    code : {"SN", "PD", "SB", "NS"}
    window : ((float, float), (float, float))
        Ranges of the two parameters.
    """

    def __init__(self, plane: ParameterPlane, code: str, window: Window):
        self.plane, self.code, self.window = plane, code, window
        self._forms = NormalForms(plane.problem)
        # Of a free period one multiplier is 1 for all orbits.
        self._trivial = () if plane.problem.has_clock else (1.0,)
        self.tests = (
            *window_tests(plane, window),
            *GRAZING.values(),
            *(TestFunction(name, "crossing", name in _ENDS.get(code, ()), NAMES[name], name == "CP") for name in _CODES[code]),
        )
        # The tori of orbits without symmetry, or of twice the period, go through the orbits that these emanate from.
        self._goes_back = code == "NS" and image_sign(plane.problem) != 0.0
        if self._goes_back:
            self.tests += (TestFunction("PN", "crossing", True, _GOES_BACK),)

    def values(self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[Sequence[float], Any]:
        """See `continuation.curves.Monitor`."""
        problem, null = self.plane.problem, held.extra
        solution, multipliers = problem.as_it_is(at.y), problem.multipliers(at.y)
        guards = [solution["clearance"], solution["speed"], solution["flight"]]
        cosine = float(own[0]) if len(own) else math.nan
        found: list[float]
        coefficient = math.nan
        if self.code == "NS":
            critical = complex(cosine, math.sqrt(max(0.0, 1.0 - cosine * cosine)))
            if critical.imag > _APART:  # behind 1:1 and 1:2 the pair is real, and bounds no torus
                coefficient = self._coefficient(at, null, scale, critical)
            others = _rest_tests(_without(multipliers, (*self._trivial, critical, critical.conjugate())))
            # The coefficient has poles where another multiplier is 1.
            regular = coefficient * _bounded(others[0]) * (1.0 - cosine)
            found = [regular, cosine - 1.0, cosine + 1.0, cosine + 0.5, cosine, *others]
        else:
            right, left = null.right[:, 0], null.left[:, 0]
            double = float(left @ (null.shifted @ right)) / math.sqrt((left @ left) * (right @ right))
            others = _rest_tests(_without(multipliers, (*self._trivial, 1.0 if self.code == "SN" else -1.0)))
            found = [double, others[1 if self.code == "SN" else 0], others[2]]
            if self.code == "SN":
                bend = fold_coefficient(null, scale, self.plane.scales(at.y))
                found.insert(0, bend)
                coefficient = abs(bend)
            else:
                coefficient = self._coefficient(at, null, scale, -1.0)
                # It has poles where another multiplier is 1, and where two are critical.
                found.insert(0, coefficient * _bounded(others[0]) * double)
        if self._goes_back:
            times = problem.flight_times(at.y)
            found.append(float(times[0] - times[len(times) // 2]))
        values = [*window_values(self.plane, at.parameters, self.window), *guards, *found]
        return values, CurvePoint(solution, multipliers, coefficient, cosine)

    def _coefficient(self, at: Linearised, null: Null, scale: np.ndarray, multiplier: complex) -> float:
        """The cubic coefficient of the normal form; nan where rounding decides its sign."""
        m = len(null.shifted)
        right, left = null.right[:m, 0], null.left[:m, 0]
        if self.code == "NS":
            # The null vectors of the pair's companion form, of which each of the two multipliers is a combination.
            right, left = right - multiplier * null.right[m:, 0], left + multiplier * null.left[m:, 0]
        value, error = self._forms.cubic_of_pencil(null.y, right * scale, left, self.code, multiplier)
        return value if abs(value) > error else math.nan

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """What an event is."""
        test = self.tests[index]
        point: CurvePoint = at.extra
        data: dict[str, Any] = {"stop": None, "note": test.label}
        if test.code == "GR":
            verb = next(verb for verb, kind in GRAZING.items() if kind == test)
            data.update(describe_grazing(self.plane.problem, point.solution, verb))
            if verb == "merge" and (met := meeting_of(self.plane.problem, point.solution)) is not None:
                return met
            return EventDetails(f"{self.code}-GR", True, data)
        if test.label == _GOES_BACK:
            if apart_from_image(self.plane.problem, at.y) > _NEARLY:
                return None
            # Where the pair is 1, too, the multipliers of the half map are 1 and -1.
            return EventDetails("FF" if 1.0 - point.cosine < _NEARLY else "PN", True, data)
        if test.code in _NEED_PAIR[self.code] and not has_pair(point.multipliers, point.cosine):
            return None
        return EventDetails(test.code, test.terminal, data)


def meeting_of(problem: ForcedProblem, solution: Solution) -> EventDetails | None:
    """What it is that two impacts at different stops come at the same instant: they exchange their order (LB), or restitution does not
    define what follows (EP). None for events at one stop."""
    found = ForcedFamily(problem).merging(solution, {"stop": None, "note": ""})
    if found.code == "GR":
        return None
    # The states are continuous there, and the multipliers are not: each order has a saltation of its own.
    note = str(found.data["note"]).replace("the family continues", "the multipliers can jump there, so the curve ends")
    return EventDetails(found.code, True, {**found.data, "note": note})


_GOES_BACK = "the orbits have the symmetry there, or half the period: the curve goes back as its image"

_APART = 1e-4
"""Imaginary part of a multiplier of the pair below which both are one, and their coefficient is rounding: it has a pole where they meet."""

_NEARLY = 1e-4
"""Difference of an orbit that is located from its image, and of a cosine from 1, that is zero: where the equations are singular, too."""

_CODES = {
    "SN": ("CP", "R1", "FF", "FN"),
    "PD": ("GPD", "R2", "FF", "PN"),
    "SB": ("DP", "R2", "FF", "PN"),
    "NS": ("GH", "R1", "R2", "R3", "R4", "FN", "PN", "NN"),
}
"""Points of codimension two on each curve, in the order of their test functions."""

_NEED_PAIR = {"SN": ("FN",), "PD": ("PN",), "SB": ("PN",), "NS": ("NN",)}
"""Those whose test function vanishes for two real multipliers with the product 1, too."""

_ENDS = {"NS": ("R1", "R2")}
"""Those that a curve cannot pass."""


def _without(multipliers: np.ndarray, values: Sequence[complex]) -> list[complex]:
    """The multipliers without the ones that are nearest to some values."""
    rest: list[complex] = multipliers.tolist()
    for value in values:
        if rest:
            rest.remove(min(rest, key=lambda one: abs(one - value)))
    return rest


def _bounded(value: float) -> float:
    """A number with the sign and the zeros of another one, between -1 and 1."""
    return value / (1.0 + abs(value))


def _rest_tests(rest: Sequence[complex]) -> list[float]:
    """Bounded products over multipliers: of 1 - mu, of 1 + mu, and of 1 - mu_i mu_j over pairs."""
    return [_product([1.0 - mu for mu in rest]), _product([1.0 + mu for mu in rest]), pair_product(rest)]


def _product(factors: Sequence[complex]) -> float:
    """A number between -1 and 1 with the sign and the zeros of a product: see `bvp/core/stroboscopic.hpp`."""
    whole = np.array(factors, dtype=complex)
    return float(core.bounded_product(np.ascontiguousarray(whole.real), np.ascontiguousarray(whole.imag)))


def pair_product(multipliers: Sequence[complex]) -> float:
    """The bounded product of 1 - mu_i mu_j over pairs of those that are finite; nan where there is no pair."""
    known = [mu for mu in multipliers if cmath.isfinite(mu)]
    return _product([1.0 - a * b for a, b in combinations(known, 2)]) if len(known) > 1 else math.nan


def has_pair(multipliers: np.ndarray, known: float) -> bool:
    """Whether a pair is on the unit circle, besides the one whose cosine is known."""
    upper = multipliers[multipliers.imag > 0.0]
    if not math.isnan(known) and len(upper):
        upper = np.delete(upper, int(np.argmin(np.abs(upper.real - known))))
    return bool(len(upper) and np.min(np.abs(np.abs(upper) - 1.0)) < _ON_CIRCLE)
