"""The backbone of a response: a conservative family over its own frequency, with the measures of a response as ordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from branches.branch import Branch
from branches.forced.branch import ForcedBranch
from bvp.harmonics import sizes
from bvp.system import ImpactSystem
from transitions.sweep.figure import Curve

__all__ = ["backbone"]

_SAME = 1e-12
"""Relative difference of masses and springs that rounding can make."""


def backbone(family: Branch, responses: Sequence[ForcedBranch], y: str) -> Curve:
    """The curve of a family in the energy beside responses in the frequency of their load: at 2 pi/T it has the size of its orbits.

    Parameters
    ----------
    family : Branch
        Of a system with the masses, springs and bounds of the responses.
    responses : sequence of ForcedBranch
    y : str
        The measure: max:NAME or rms:NAME.

    Returns
    -------
    Curve
        NaN beyond the frequencies of the responses.

    Raises
    ------
    ValueError
        In one line, for what has no backbone.
    """
    kind, _, name = y.partition(":")
    if kind not in ("max", "rms"):
        raise ValueError(f"a backbone has no {y} as a response has it; expected --y max:.. or rms:..")
    problem, parameter = responses[0].problem, responses[0].name
    for branch in responses:
        for point in branch.unknowns[[0, -1]]:
            values = problem.parameters(point)
            base = problem.parametric.entries(values)[problem.parametric.layout.frequency] if problem.has_clock else np.zeros(1)
            if abs(float(base[0]) - values[parameter]) > _SAME * abs(values[parameter]):
                raise ValueError(f"the responses are over {parameter}, which is not the frequency of their load; expected one, such as w")
    _require_same(family.system, problem.parametric.system(problem.parameters(responses[0].unknowns[0])))
    frequencies = family.points["frequency"]
    lowest, highest = (f(f(branch.parameter) for branch in responses) for f in (min, max))
    inside = (frequencies >= lowest) & (frequencies <= highest)
    if not inside.any():
        has = f"{frequencies.min():.6g} to {frequencies.max():.6g}"
        raise ValueError(f"the family has 2 pi/T = {has}, and the responses have {parameter} = {lowest:.6g} to {highest:.6g}")
    c, heights = family.system.coordinates.index(name), np.full(len(family), math.nan)
    for i in np.flatnonzero(inside).tolist():
        heights[i] = sizes(family.problem, family.orbit(i).solution.y)[kind == "rms"][c]
    return Curve(frequencies, heights, family.points["stable"] == 1)


def _require_same(family: ImpactSystem, system: ImpactSystem) -> None:
    """Refuse a family of another system. Dampers, loads and restitution can differ."""
    if family.coordinates != system.coordinates:
        mine, others = (", ".join(one.coordinates) for one in (system, family))
        raise ValueError(f"the family has the coordinates {others}; expected {mine}, as the responses have")
    for what in ("mass", "stiffness"):
        one, other = (np.asarray(getattr(each, what)) for each in (family, system))
        if np.abs(one - other).max() > _SAME * np.abs(other).max():
            raise ValueError(f"the family has another {what} matrix than the responses")
    bounds = [[(stop.gap, stop.lower, stop.upper) for stop in each.stops] for each in (family, system)]
    if bounds[0] != bounds[1]:
        raise ValueError("the family has other stops than the responses")
    forces = [each.describe().get("springs") for each in (family, system)]
    if forces[0] != forces[1]:
        raise ValueError("the family has other springs than the responses")
