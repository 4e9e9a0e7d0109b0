"""Springs k |w|^p sign w whose power grows without bound: the stops that they become, and the rigid wall like which a stiff one acts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import InvalidSystem
from bvp.smooth_forces import linear_part, smooth_forces
from bvp.springs import Spring, element_from
from bvp.system import ImpactSystem

if TYPE_CHECKING:
    from bvp.parameters import ParametricSystem

__all__ = ["StiffSpring", "effective_clearance", "force_along", "stiff_limit"]


@dataclass(frozen=True)
class StiffSpring:
    """A spring k |w|^p sign w along w = row . u, at one value of the parameter on which it depends.

    Parameters
    ----------
    row : (n,) float
    stiffness, power : float
        k and p.
    mass : float
        Reduced mass m = 1/(row M^-1 row) of an impact along w.
    """

    row: np.ndarray
    stiffness: float
    power: float
    mass: float

    def force(self, w: float) -> float:
        """The size of the force at w."""
        return self.stiffness * abs(w) ** self.power

    def speed(self, w: float) -> float:
        """The relative speed V of a motion without other forces that turns at w, where its energy m V^2/2 is that of the spring."""
        return math.sqrt(2.0 * self.force(w) * abs(w) / ((self.power + 1.0) * self.mass))

    def clearance(self, speed: float) -> float:
        """See `effective_clearance`."""
        return effective_clearance(self.power, self.stiffness, self.mass, speed)


def effective_clearance(power: float, stiffness: float, mass: float, speed: float) -> float:
    """The distance d of the rigid wall that a motion against a spring k w^p turns at as late: theory, equations (46) and (47).

    Parameters
    ----------
    power, stiffness : float
        p and k; the spring is stiff beyond w = k^(-1/p).
    mass, speed : float
        Reduced mass m and relative speed V of the impact, above 0.

    Examples
    --------
    A harmonic spring turns the motion after a quarter of its period, (pi/2) sqrt(m/k): V times that is d.

    >>> abs(effective_clearance(1.0, 4.0, 1.0, 3.0) - 3.0 * math.pi / 4.0) < 1e-14
    True
    """
    n = power + 1.0
    turn = (n * mass * speed * speed / (2.0 * stiffness)) ** (1.0 / n)
    return turn * math.sqrt(math.pi) * math.exp(math.lgamma(1.0 + 1.0 / n) - math.lgamma(0.5 + 1.0 / n))


def force_along(spring: Spring, coordinates: Sequence[str], displacements: np.ndarray) -> np.ndarray:
    """The force (m,) of a spring at displacements (m,) along its row. Its linear part counts, though it may be in K.

    Examples
    --------
    >>> force_along(Spring((1.0, -1.0), stiffness=2.0, power=3), ("x", "y"), np.array([-1.0, 0.5])).tolist()
    [-2.0, 0.25]
    """
    spring, row = element_from(Spring, {**spring.describe(), "nonlinear_only": False}, coordinates), np.array(spring.row)
    u = np.outer(displacements, row / (row @ row))
    forces = smooth_forces([spring], [], coordinates)
    acting = u @ linear_part([spring], coordinates) + (0.0 if forces is None else forces.acting(u, np.zeros_like(u)))
    along: np.ndarray = acting @ row / (row @ row)
    return along


def stiff_limit(
    parametric: ParametricSystem, name: str, values: Mapping[str, float] | None = None
) -> tuple[ImpactSystem | None, list[StiffSpring]]:
    """The system where a parameter goes to 0 from above, and the springs that become its last stops, at values of the parameters.

    A spring k |w|^p whose power p grows without bound becomes an elastic stop at the limit of k^(-1/p). Without such a spring there is no
    system.

    Raises
    ------
    InvalidSystem
        Where another part of the system has no limit.
    """
    import sympy

    description, (symbol,) = parametric.description_in([name], values)
    at, system = {symbol: sympy.Float(parametric.at(values)[name], 40)}, parametric.system(values)
    inverse = np.linalg.inv(system.mass)
    stops, stiff, springs = [], [], []
    for spring in description.get("springs", ()):
        power, stiffness = (sympy.sympify(spring.get(key, 1.0)) for key in ("power", "stiffness"))
        if sympy.limit(power, symbol, 0, "+") != sympy.oo:
            springs.append(_limits(spring, symbol))
            continue
        bound = sympy.exp(-sympy.limit(sympy.log(stiffness) / power, symbol, 0, "+"))
        if not (bound.is_number and bound.is_finite and bound > 0):
            raise InvalidSystem(f"the spring with the power {power} has no wall at {name} = 0: its stiffness is {stiffness}")
        row = np.array(element_from(Spring, {**spring, "power": 3.0, "stiffness": 1.0}, system.coordinates).row)
        stops.append({"c": row.tolist(), "lower": -float(bound), "upper": float(bound)})
        stiff.append(StiffSpring(row, float(stiffness.xreplace(at)), float(power.xreplace(at)), 1.0 / float(row @ inverse @ row)))
    if not stiff:
        return None, []
    rest = _limits({key: value for key, value in description.items() if key != "springs"}, symbol)
    rest["stops"] = [*rest.get("stops", ()), *stops]
    return ImpactSystem.from_description({**rest, "springs": springs} if springs else rest), stiff


def _limits(node: Any, symbol: Any) -> Any:
    """A description with the limits of its expressions."""
    import sympy

    if isinstance(node, Mapping):
        return {key: _limits(value, symbol) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_limits(value, symbol) for value in node]
    if not isinstance(node, sympy.Expr):
        return node
    limit = sympy.limit(node, symbol, 0, "+")
    if not (limit.is_number and limit.is_finite):
        # The parameter 1/k is the symbol of that name.
        name = str(symbol).removeprefix("1/")
        words = node if name == str(symbol) else node.xreplace({symbol: 1 / sympy.Symbol(name)})
        raise InvalidSystem(f"the system has no limit: {words} grows without bound")
    return float(limit)
