"""The parameters that vary along a family of forced orbits, and the equations that they keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.programs import evaluate_program
from bvp.texts import listed

__all__ = ["ParameterPath"]

_UPDATES = 50
_SETTLED = 1e-13
"""Largest update of Newton's method, relative to the value, that ends it."""

_HOLDS = 1e-9
"""Largest relative difference between a value and that of the equations at which they hold."""


@dataclass(frozen=True, eq=False)
class ParameterPath:
    """A system whose parameters move along a line: the first of `names` is free, and equations determine the others.

    Parameters
    ----------
    parametric : ParametricSystem
    names : sequence of str
        The released parameters. The first one is reported.
    keep : sequence of str
        Equations such as "F = 0.3*w**2", one less than there are names.
    values : mapping, optional
        Values that replace the defaults; afterwards those of all parameters.

    Raises
    ------
    ValueError
        For a name that is no parameter, a text that is no equation, another number of equations.
    """

    parametric: ParametricSystem
    names: Sequence[str]
    keep: Sequence[str] = ()
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "keep", tuple(self.keep))
        object.__setattr__(self, "values", self.parametric.at(self.values))
        if len(self.keep) != len(self.names) - 1:
            raise ValueError(f"{len(self.names)} released parameters need {len(self.names) - 1} equations; received {len(self.keep)}")
        self.parametric.equations(self.keep, self.names)

    @property
    def name(self) -> str:
        """The first released parameter."""
        return self.names[0]

    def at(self, value: float | None = None) -> ParameterPath:
        """The same at a value of the first parameter, by default its own. The other parameters are computed from the equations.

        Raises
        ------
        ValueError
            If the equations have no solution near the present values.

        Examples
        --------
        >>> stop = {"c": [1.0], "upper": 1.0}
        >>> system = ParametricSystem.from_description({
        ...     "parameters": {"F": 0.5, "w": 1.2}, "system": {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [stop]},
        ...     "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}]})
        >>> dict(ParameterPath(system, ["w", "F"], ["F = 0.3*w**2"]).at(2.0).values)
        {'F': 1.2, 'w': 2.0}
        """
        values = dict(self.values) if value is None else {**self.values, self.name: float(value)}
        others, count = self.names[1:], len(self.keep)
        program = self.parametric.equations(self.keep, self.names)
        for _ in range(_UPDATES if others else 0):
            out = evaluate_program(program, [values[name] for name in self.parametric.names])
            slopes = out[count:].reshape(count, len(self.names))[:, 1:]
            if not np.isfinite(out).all() or np.linalg.matrix_rank(slopes) < count:
                break
            update = -np.linalg.solve(slopes, out[:count])
            largest = max(abs(change) / max(abs(values[name]), 1e-300) for name, change in zip(others, update.tolist(), strict=True))
            values |= {name: values[name] + change for name, change in zip(others, update.tolist(), strict=True)}
            if largest <= _SETTLED or not update.any():
                return replace(self, values=values)
        if others:
            known = listed([f"{name} = {self.values[name]:g}" for name in others])
            where = f"{self.name} = {values[self.name]:g}"
            raise ValueError(f"{' and '.join(self.keep)} cannot be solved for {' and '.join(others)} at {where}, near {known}")
        return replace(self, values=values)

    def problem(self, sequence: Sequence[str], **options: Any) -> ForcedProblem:
        """The problem with an impact sequence. options: of `ForcedProblem`."""
        return ForcedProblem(self.parametric, sequence, self.names, keep=self.keep, values=self.values, **options)

    @property
    def start(self) -> list[float]:
        """The values of the released parameters."""
        return [self.values[name] for name in self.names]

    def through(self, problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
        """The problem in which an orbit of another one is followed along this path, and the orbit in its unknowns.

        Raises
        ------
        ValueError
            If the equations do not hold at the orbit.
        """
        values = problem.parameters(y)
        here = replace(self, values=values)
        for name, value in here.at().values.items():
            if abs(value - values[name]) > _HOLDS * max(abs(value), abs(values[name])):
                where = f"at the orbit, which has {here.name} = {values[here.name]:.10g} and {name} = {values[name]:.10g}"
                raise ValueError(f"{' and '.join(self.keep)} does not hold {where}; expected {name} = {value:.10g}, or another equation")
        made = here.problem(problem.sequence, load_periods=problem.load_periods, half=problem.half, pieces=problem.pieces)
        nodes, size = problem.nodes(y), 2 * problem.degrees_of_freedom
        return made, made.pack(nodes[:, :size], nodes[:, size], here.start, problem.flight_times(y))
