"""Forces given as Python functions: read as a formula where they are one, else called by the core (`bvp/core/collocation.hpp`).

A function is tried with a symbol first. What takes one, such as ``lambda w: w**3 + np.sin(w)``, becomes the text of a formula. All others,
such as tables and splines, are functions that sympy does not know, with a derivative and an energy that are functions too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from bvp.checks import InvalidSystem
from bvp.kernels.jets import CALLED, JetProgram
from bvp.programs import derivative

__all__ = ["CalledForce", "CalledForces", "FailedForce", "called_forces", "formula_of", "tried"]

_PROBES = np.array([-1.0, -0.3, -0.01, 0.01, 0.3, 1.0])
_AGREES = 1e-5
"""How near a derivative is to differences of the force."""

_LONGEST = 300
"""Operations of a formula that a function is read as. The recurrence of a Chebyshev series would have millions."""

_POINTS, _WEIGHTS = 0.5 * np.array([[1.0], [0.0]]) + 0.5 * np.array(np.polynomial.legendre.leggauss(20))
"""Gauss points of the interval from 0 to 1, (20,), and their weights."""

_numbers = count(1)


class FailedForce(Exception):
    """A force that is a Python function raised an error in a flight."""


class _Traced(NDArrayOperatorsMixin):
    """A symbol that numpy's functions and the operators take, or what they make of it: an expression of so many operations when written."""

    def __init__(self, expression: Any, size: int = 1):
        self.expression, self.size = expression, size

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        import sympy

        made = {
            "add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b, "divide": lambda a, b: a / b,
            "power": lambda a, b: a**b, "float_power": lambda a, b: a**b, "negative": lambda a: -a, "positive": lambda a: a,
            "square": lambda a: a**2, "sqrt": sympy.sqrt, "exp": sympy.exp, "log": sympy.log, "sin": sympy.sin, "cos": sympy.cos,
            "tan": sympy.tan, "sinh": sympy.sinh, "cosh": sympy.cosh, "tanh": sympy.tanh, "absolute": sympy.Abs, "sign": sympy.sign,
        }.get(ufunc.__name__)  # fmt: skip
        numbers = all(isinstance(part, _Traced | int | float) for part in inputs)
        size = 1 + sum(part.size for part in inputs if isinstance(part, _Traced))
        if method != "__call__" or options or made is None or not numbers or size > _LONGEST:
            return NotImplemented
        found = [part.expression if isinstance(part, _Traced) else sympy.Rational(repr(float(part))) for part in inputs]
        return _Traced(made(*found), size)


def formula_of(function: Callable[..., Any], names: Sequence[str]) -> str:
    """The text of a function of so many numbers, if it takes symbols; else an empty one.

    Examples
    --------
    >>> formula_of(lambda w: w**3 + 0.1 * np.tanh(w), ["w"]), formula_of(lambda w: float(w), ["w"])
    ('w**3 + tanh(w)/10', '')
    """
    import sympy

    symbols = [sympy.Symbol(name, real=True) for name in names]
    try:
        traced = function(*(_Traced(symbol) for symbol in symbols))
        if not isinstance(traced, _Traced):
            return ""
        check = sympy.lambdify(symbols, traced.expression, "numpy")
        for w in _PROBES.tolist():
            at = [w * (1.0 - 0.4 * k) for k in range(len(names))]
            if not math.isclose(check(*at), function(*at), rel_tol=1e-12, abs_tol=1e-300):
                return ""
    except Exception:
        return ""
    return str(traced.expression)


class CalledForce:
    """A force of elongations, or of an elongation and its rate, that no formula is known of.

    Parameters
    ----------
    function : callable
        Of one number, or of two; it may take arrays.
    slopes : sequence of callables
        Its derivatives; none: by a complex step.
    energy : callable or None
        Of the elongation; None: the integral of the force.
    place : str
        The spring or damper, for messages.

    Raises
    ------
    InvalidSystem
        For a function that fails, or whose values or derivatives are not such.
    """

    def __init__(self, function: Callable[..., Any], slopes: Sequence[Callable[..., Any]], energy: Any, place: str, arguments: int):
        self.place, self.arguments = place, arguments
        self.function = self._checked(function, "force")
        rest, near = self.function(*self._at(np.zeros(1))), tried(self.function, *self._at(_PROBES))
        if 0.0 < abs(rest[0]) <= 1e-13 * np.nanmax(np.abs(near), initial=0.0):  # rounding, as of an interpolation
            own = self.function
            self.function = lambda *arrays: own(*arrays) - rest[0]
        found = [self._checked(slope, "slope") for slope in slopes] or [self._complex_step(function, k) for k in range(arguments)]
        if len(found) != arguments:
            raise InvalidSystem(f"slope of {place} has one derivative by each of w and w_dot; received {len(found)}")
        self.slopes = found
        for k, slope in enumerate(found):
            self._compare(slope, self.function, k, "slope", "the force")
        self.energy = self._checked(energy, "energy") if energy is not None else self._integral
        if energy is not None:
            self._compare(self.function, self.energy, 0, "force", "the energy")
        self.symbol, self.stored = _symbolic(self)

    def _at(self, w: np.ndarray) -> list[np.ndarray]:
        return [w, 0.6 * w][: self.arguments]

    def _checked(self, function: Any, what: str) -> Callable[..., Any]:
        """The function for arrays of any shape. It is called with a vector, if it takes one, else for each number."""
        place = self.place
        if not callable(function):
            raise InvalidSystem(f"the {what} of {place} is a function; received {function!r}")
        try:
            rest = np.asarray(function(*[0.0] * self.arguments), dtype=float)
        except Exception as error:
            raise InvalidSystem(f"the {what} of {place} fails at rest, w = 0: {type(error).__name__}: {error}") from error
        if rest.size != 1:
            raise InvalidSystem(f"the {what} of {place} is one number for one elongation; received an array of shape {rest.shape}")
        if not np.isfinite(rest):
            raise InvalidSystem(f"the {what} of {place} is {float(rest.ravel()[0])} at rest, w = 0; expected a finite number")

        def each(*arrays: np.ndarray) -> np.ndarray:
            return np.array([float(function(*numbers)) for numbers in zip(*(a.tolist() for a in arrays), strict=True)])

        vector = function
        try:
            inside = self._at(_PROBES[np.isfinite(tried(each, *self._at(_PROBES)))])
            given, single = np.asarray(function(*inside)), each(*inside)
            if given.shape != single.shape or not np.allclose(given, single, 1e-12, 0.0):
                vector = each
        except Exception:
            vector = each

        def of_arrays(*arrays: Any) -> np.ndarray:
            if all(isinstance(a, np.ndarray) and a.ndim == 1 for a in arrays):
                return np.asarray(vector(*arrays), dtype=float)
            shaped = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in arrays))
            return np.asarray(vector(*(a.ravel() for a in shaped)), dtype=float).reshape(shaped[0].shape)

        return of_arrays

    def _complex_step(self, function: Callable[..., Any], k: int) -> Callable[..., Any]:
        """The derivative by argument k, exact to rounding, of a function that takes complex numbers."""

        def slope(*arrays: np.ndarray) -> Any:
            moved = [np.asarray(a, dtype=complex) + (1e-200j if j == k else 0.0) for j, a in enumerate(arrays)]
            found = np.asarray(function(*moved))
            if not np.iscomplexobj(found):
                raise TypeError("it gives real numbers")
            return found.imag / 1e-200

        import warnings

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                if not np.all(np.isfinite(slope(*self._at(np.zeros(2))))):
                    raise ValueError
        except Exception:
            raise InvalidSystem(
                f"the derivative of the force of {self.place} is not known: it takes no arrays of complex numbers; expected slope = .., "
                f"a function of the same {'numbers' if self.arguments > 1 else 'number'}"
            ) from None
        return lambda *arrays: slope(*np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in arrays)))

    def _compare(self, slope: Callable[..., Any], function: Callable[..., Any], k: int, name: str, other: str) -> None:
        """Refuse a derivative that is unlike the differences of its function."""
        at, h = self._at(_PROBES), 1e-5
        high, low = ([a + (sign * h if j == k else 0.0) for j, a in enumerate(at)] for sign in (1.0, -1.0))
        with np.errstate(all="ignore"):
            differences, given = (tried(function, *high) - tried(function, *low)) / (2.0 * h), tried(slope, *at)
        scale = np.nanmax(np.abs(differences), initial=0.0) + np.abs(given)
        wrong = np.abs(given - differences) > _AGREES * scale + 1e-300
        if np.any(wrong):
            i = int(np.argmax(wrong))
            given_there, expected = f"{given[i]:.6g} at w = {_PROBES[i]:g}", f"differences of {other} give {differences[i]:.6g}"
            raise InvalidSystem(f"the {name} of {self.place} is {given_there}, where {expected}")

    def _integral(self, w: Any) -> np.ndarray:
        """The integral of the force from 0, by Gauss quadrature over parts that are halved until it stays."""
        w = np.asarray(w, dtype=float)
        before = None
        for parts in (1, 2, 4, 8, 16, 32, 64, 128, 256, 512):
            x = ((np.arange(parts)[:, None] + _POINTS) / parts).ravel()
            values = self.function(w[..., None] * x)
            total = w * (values @ np.tile(_WEIGHTS, parts)) / parts
            size = np.abs(w) * np.max(np.abs(values), axis=-1, initial=0.0)
            if before is not None and not np.any(np.abs(total - before) > 4e-16 * math.sqrt(parts) * size):
                return np.asarray(total)
            before = total
        raise InvalidSystem(f"the energy of {self.place} is not known to rounding, as its force is not smooth enough; expected energy = ..")


def tried(function: Callable[..., Any], *arrays: np.ndarray) -> np.ndarray:
    """The values of a function at each of some numbers; NaN where it fails, as beyond a table."""
    found = np.full(arrays[0].shape, np.nan)
    for k in range(len(found)):
        with suppress(Exception):
            found[k] = function(*(a[k : k + 1] for a in arrays))[0]
    return found


def _symbolic(force: CalledForce) -> Any:
    """A function of sympy for a force; its derivatives and its energy are others."""
    number = next(_numbers)
    slopes = [_function(f"called_slope_{number}_{k}", slope, ()) for k, slope in enumerate(force.slopes)]
    own = _function(f"called_force_{number}", force.function, slopes)
    return own, _function(f"called_energy_{number}", force.energy, [own])


def _function(name: str, values: Callable[..., Any], slopes: Sequence[Any]) -> Any:
    import sympy

    def evaluate(cls: Any, *arguments: Any) -> Any:
        if all(argument.is_number for argument in arguments):
            return sympy.Float(float(values(*(np.array(float(argument)) for argument in arguments))))
        return None

    def fdiff(self: Any, argindex: int = 1) -> Any:
        if not slopes:
            raise InvalidSystem("a force given as a Python function has no second derivative here")
        return slopes[argindex - 1](*self.args)

    return type(name, (sympy.Function,), {"eval": classmethod(evaluate), "fdiff": fdiff, "called": staticmethod(values), "is_real": True})


class CalledForces(NamedTuple):
    """Forces that are called, of I inputs, with their derivatives.

    program: the registers are the inputs, forces, derivatives by inputs, derivatives by parameters. write: fills the rows below the inputs
    in the first columns of an array (R, K), as many as its second argument. energies: of the inputs, the potential and, with parameters,
    its derivatives. Both take other values of the parameters as their last argument.
    """

    program: JetProgram  # without an address
    write: Callable[[np.ndarray, int], None]
    energies: Callable[[np.ndarray], list[float]]


def called_forces(
    forces: Sequence[Any], inputs: Sequence[Any], potential: Any, parameters: Sequence[Any], values: Sequence[float],
    compiled: Callable[..., Any],
) -> CalledForces:  # fmt: skip
    """The functions of forces that are called, of their derivatives and of their energy.

    compiled: makes a function of arrays from symbols and an expression.
    """
    slopes = [(f, i, derivative(force, w)) for f, force in enumerate(forces) for i, w in enumerate(inputs) if force.has(w)]
    changes = [(f, j, derivative(force, p)) for f, force in enumerate(forces) for j, p in enumerate(parameters) if force.has(p)]
    known, size = (*inputs, *parameters), len(inputs)
    results = [compiled(known, each) for each in (*forces, *(s[2] for s in slopes), *(c[2] for c in changes))]
    energies = [] if potential is None else [potential, *(derivative(potential, symbol) for symbol in known)]
    stored = [compiled(known, each) for each in (energies if parameters else energies[:1])]
    numbers, first = np.array(values, dtype=float), size + len(forces)

    def write(array: np.ndarray, columns: int, given: np.ndarray = numbers) -> None:
        at = [*array[:size, :columns], *given]
        with np.errstate(all="ignore"), _named(array[:size, 0]):
            for k, function in enumerate(results):
                array[size + k, :columns] = function(*at)

    def energy(at: np.ndarray, given: np.ndarray = numbers) -> list[float]:
        with np.errstate(all="ignore"), _named(at):
            return [float(function(*at, *given)) for function in stored]

    program = JetProgram(
        np.array([[CALLED, size, 0, 0]], dtype=np.int64), numbers, np.arange(size, first, dtype=np.int64),
        np.array([[f, i, first + k] for k, (f, i, _) in enumerate(slopes)], dtype=np.int64).reshape(-1, 3),
        np.array([[f, j, first + len(slopes) + k] for k, (f, j, _) in enumerate(changes)], dtype=np.int64).reshape(-1, 3),
        size + len(results),
    )  # fmt: skip
    return CalledForces(program, write, energy)


@contextmanager
def _named(at: np.ndarray) -> Iterator[None]:
    """Errors inside become a `FailedForce` that names the elongations."""
    try:
        yield
    except Exception as error:
        where = ", ".join(f"{x:.6g}" for x in at.tolist())
        raise FailedForce(f"a force given as a Python function fails at {where}: {type(error).__name__}: {error}") from error
