"""Springs and dampers that act along a row of coordinates, linear or not. The input is checked on construction.

Their linear parts belong to the matrices K and C of the system. What is left are its smooth forces (`bvp.smooth_forces`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, fields
from difflib import get_close_matches
from typing import Any, ClassVar, cast

import numpy as np

from bvp.checks import Frozen, InvalidSystem, checked_number, refuse_unknown
from bvp.texts import shown

__all__ = ["LARGEST_POWER", "Damper", "Element", "Spring", "element_from", "is_nonlinear", "is_symbolic"]

MOST_COEFFICIENTS = 64
"""Largest degree of a force given as a polynomial."""

LARGEST_POWER = 10_000.0
"""Largest power of a force: a wall."""


@dataclass(frozen=True, kw_only=True)
class Element:
    """What springs and dampers share. The numbers can be sympy expressions of parameters, which are not checked."""

    row: tuple[float, ...] = field(default=(), kw_only=False)
    power: Any = 1.0
    polynomial: tuple[Any, ...] = ()
    force: str | Callable[..., Any] = ""
    slope: Any = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    nonlinear_only: bool = False
    coordinates: InitVar[Sequence[str]] = ()
    called: Any = field(default=None, init=False, repr=False, compare=False)
    """The force that is a Python function, if no formula is known of it (`bvp.called_forces.CalledForce`)."""

    kind: ClassVar[str]
    factor: ClassVar[str]
    """The attribute that is multiplied with the power."""
    laws: ClassVar[tuple[str, ...]]

    def __post_init__(self, coordinates: Sequence[str]) -> None:
        row = _numbers(self.row, f"the row of a {self.kind}")
        if row and not any(row):
            raise InvalidSystem(f"the row of a {self.kind} is zero: no coordinate moves along it")
        object.__setattr__(self, "row", row)
        place = self.place(coordinates)
        given = [law for law in self.laws if getattr(self, law) not in (None, (), [], "")]
        if len(given) != 1:
            raise InvalidSystem(f"{place} has one of {', '.join(self.laws)}; received {' and '.join(given) or 'none'}")
        if callable(self.force):
            self._take_function(place)
        elif self.slope is not None or getattr(self, "energy", None) is not None:
            raise InvalidSystem(f"slope and energy of {place} go with a force that is a Python function; received {' and '.join(given)}")
        for law in ("potential", "force"):
            text = getattr(self, law, "")
            if not isinstance(text, str) and self.called is None:
                raise InvalidSystem(f"the {law} of {place} is a text; received {shown(text)}")
        if not row and given != ["potential"]:
            raise InvalidSystem(f"a {self.kind} with {given[0]} acts between two coordinates or on one; received neither")
        if not isinstance(self.parameters, Mapping):
            raise InvalidSystem(f"the parameters of {place} are numbers by name; received {shown(self.parameters)}")
        if not isinstance(self.nonlinear_only, bool):
            raise InvalidSystem(f"nonlinear_only of {place} is true or false; received {shown(self.nonlinear_only)}")
        power = _number(self.power, f"the power of {place}")
        if not is_symbolic(power) and not 1.0 <= power <= LARGEST_POWER:
            raise InvalidSystem(f"the power of {place} is from 1 to {LARGEST_POWER:g}; received {power:.12g}")
        if given != [self.factor] and (is_symbolic(power) or power != 1.0):
            raise InvalidSystem(f"the power of {place} goes with {self.factor}; received {given[0]}")
        polynomial = _numbers(self.polynomial, f"the polynomial of {place}")
        if len(polynomial) > MOST_COEFFICIENTS:
            raise InvalidSystem(
                f"the polynomial of {place} has at most {MOST_COEFFICIENTS} coefficients, of w, w^2, ..; received {len(polynomial)}"
            )
        numbers = {name: _number(value, f"parameter {name} of {place}") for name, value in self.parameters.items()}
        for name, value in (("power", power), ("polynomial", polynomial), ("parameters", Frozen(numbers))):
            object.__setattr__(self, name, value)
        if given == [self.factor]:
            value = _number(getattr(self, self.factor), f"{self.factor} of {place}")
            object.__setattr__(self, self.factor, value)

    def _take_function(self, place: str) -> None:
        """Take a force that is a Python function: as a formula where it is one, else as it is."""
        from bvp.called_forces import CalledForce, formula_of

        names = ["w", "w_dot"][: 1 if self.kind == "spring" else 2]
        if not self.row:
            raise InvalidSystem(f"a {self.kind} whose force is a Python function acts between two coordinates or on one; received neither")
        formula = formula_of(self.force, names) if callable(self.force) else ""
        if formula:
            for name in ("force", "slope", "energy"):
                if hasattr(self, name):
                    object.__setattr__(self, name, formula if name == "force" else None)
            return
        slopes = () if self.slope is None else tuple(self.slope) if isinstance(self.slope, Sequence) else (self.slope,)
        energy = getattr(self, "energy", None)
        object.__setattr__(self, "called", CalledForce(cast(Any, self.force), slopes, energy, place, len(names)))

    @property
    def text(self) -> Any:
        """The expression of the law, or the Python function, or an empty text."""
        return self.force

    def coefficients(self) -> dict[int, Any]:
        """The coefficients of the force by the power of w, if it is a polynomial that is given as one; else none."""
        if self.polynomial:
            return {k: value for k, value in enumerate(self.polynomial, 1) if is_symbolic(value) or value != 0.0}
        value = getattr(self, self.factor)
        if value is None or is_symbolic(self.power) or self.power % 2.0 != 1.0:
            return {}
        return {int(self.power): value}

    def place(self, coordinates: Sequence[str] = ()) -> str:
        """The element in words: which coordinates it is on."""
        moved = [k for k, entry in enumerate(self.row) if entry]
        names = [coordinates[k] if k < len(coordinates) else f"u{k + 1}" for k in moved]
        if len(moved) == 1:
            return f"the {self.kind} on {names[0]}"
        if len(moved) == 2:
            return f"the {self.kind} between {names[0]} and {names[1]}"
        return f"the {self.kind} on {', '.join(names)}" if names else f"the {self.kind} of all coordinates"

    def describe(self) -> dict[str, Any]:
        """The element as plain data; `element_from` is the inverse."""
        found: dict[str, Any] = {"c": list(self.row)} if self.row else {}
        if self.parameters:
            found["parameters"] = dict(self.parameters)
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name not in ("row", "parameters", "called") and value != item.default:
                found[item.name] = list(value) if isinstance(value, tuple) else value
        return found


@dataclass(frozen=True, kw_only=True)
class Spring(Element):
    """A spring along w = row . u, or the potential of all coordinates. It adds row f(w) to the left-hand side of M u'' + C u' + K u = 0.

    One law is given: `stiffness`, `polynomial`, `potential` or `force`.

    Parameters
    ----------
    row : sequence of n floats
        Row of w = row . u: u1 - u2 between two coordinates, u1 on one of them. None for a potential of the coordinates.
    stiffness : float
        k of the force k |w|^p sign w, in units of force over displacement to the power p.
    power : float
        p, real, from 1; default 1.
    polynomial : sequence of floats
        c_1, c_2, .. of the force c_1 w + c_2 w^2 + ..
    potential : str
        Expression in w, or in the coordinates if there is no row. The force is its derivative.
    force : str or callable
        Expression in w, or in the coordinates. The spring may then have no potential. Or a Python function of w, which may take arrays.
    slope : callable, optional
        Derivative of a force that is a Python function. If it is not given, the function must take complex numbers.
    energy : callable, optional
        Integral of such a force. If it is not given, it is computed by Gauss quadrature.
    parameters : mapping of str to float
        Values of the other names in an expression.
    nonlinear_only : bool
        Whether the linear part of the force is left out, as it is part of K already.
    coordinates : sequence of n str
        Names for messages.

    Raises
    ------
    InvalidSystem
        For no law or two, for a power below 1, for what is no finite number.

    Examples
    --------
    >>> Spring((1.0, -1.0), stiffness=1.0, power=3).place(("x", "y"))
    'the spring between x and y'
    >>> Spring((1.0,), stiffness=1.0, power=0.5)
    Traceback (most recent call last):
    bvp.checks.InvalidSystem: the power of the spring on u1 is from 1 to 10000; received 0.5
    """

    stiffness: Any = None
    potential: str = ""
    energy: Any = None

    kind = "spring"
    factor = "stiffness"
    laws = ("stiffness", "polynomial", "potential", "force")

    @property
    def text(self) -> Any:
        return self.potential or self.force


@dataclass(frozen=True, kw_only=True)
class Damper(Element):
    """A damper along w = row . u. It adds row f(w') to the left-hand side of M u'' + C u' + K u = 0.

    One law is given: `damping`, `polynomial` or `force`.

    Parameters
    ----------
    row : sequence of n floats
        Row of w = row . u.
    damping : float
        c of the force c |w'|^p sign w', in units of force over speed to the power p.
    power : float
        p, real, from 1; default 1.
    polynomial : sequence of floats
        c_1, c_2, .. of the force c_1 w' + c_2 w'^2 + ..
    force : str or callable
        Expression in w and its rate w_dot, or in coordinates and their rates, such as u1_dot. Or a Python function of w and w_dot.
    slope : sequence of two callables, optional
        Derivatives of such a function by w and by w_dot. If they are not given, it must take complex numbers.
    parameters : mapping of str to float
        Values of the other names in the expression.
    nonlinear_only : bool
        Whether the linear part of the force is left out, as it is part of C already.
    coordinates : sequence of n str
        Names for messages.

    Raises
    ------
    InvalidSystem
        As for `Spring`.

    Examples
    --------
    >>> Damper((1.0, 0.0), force="0.1*(w**2 - 1)*w_dot").describe()
    {'c': [1.0, 0.0], 'force': '0.1*(w**2 - 1)*w_dot'}
    """

    damping: Any = None

    kind = "damper"
    factor = "damping"
    laws = ("damping", "polynomial", "force")


_WITH_FUNCTIONS = ("slope", "energy")
"""Keys that go with a Python function: never the nearest ones of a file."""


def require_keys(cls: type[Element], entry: Any) -> list[str]:
    """The keywords of a spring or damper, from a table. Refuses what is no table, and unknown keys, as `element_from` does."""
    if not isinstance(entry, Mapping):
        raise InvalidSystem(f"a {cls.kind} is a table of keys and values; received {shown(entry)}")
    own = [item.name for item in fields(cls) if item.name not in ("row", "called")]
    unknown = {key: value for key, value in entry.items() if key not in own}
    refuse_unknown(unknown, ("between", "on", "c", *(key for key in own if key not in _WITH_FUNCTIONS)), f"a {cls.kind}")
    return own


def element_from(cls: type[Element], entry: Any, coordinates: Sequence[str]) -> Any:
    """A spring or damper from a table.

    Parameters
    ----------
    cls : Spring or Damper
    entry : mapping
        The keywords of the class; the row as ``c``, or by ``between``, two names of coordinates, or ``on``, one of them.
    coordinates : sequence of n str

    Raises
    ------
    InvalidSystem
        For an unknown key or coordinate, with the nearest known one.

    Examples
    --------
    >>> element_from(Spring, {"between": ["x", "y"], "stiffness": 2.0, "power": 3}, ["x", "y"]).row
    (1.0, -1.0)
    """
    own = require_keys(cls, entry)
    places = [key for key in ("between", "on", "c") if key in entry]
    if len(places) > 1:
        raise InvalidSystem(f"a {cls.kind} acts between two coordinates, on one, or along a row c; received {' and '.join(places)}")
    row: Any = ()
    if "c" in entry:
        row = entry["c"]
    elif places:
        names = [entry["on"]] if "on" in entry else entry["between"]
        if not isinstance(names, Sequence) or isinstance(names, str) or len(names) != (1 if "on" in entry else 2):
            raise InvalidSystem(f"between of a {cls.kind} is two coordinates; received {shown(names)}")
        row = [0.0] * len(coordinates)
        for name, sign in zip(names, (1.0, -1.0), strict=False):
            if name not in coordinates:
                near = get_close_matches(str(name), coordinates, 1, 0.0)
                raise InvalidSystem(f"a {cls.kind} acts on {shown(name)}, which is no coordinate; nearest: {near[0] if near else 'none'}")
            row[coordinates.index(name)] += sign
    return cls(row, coordinates=coordinates, **{key: value for key, value in entry.items() if key in own})


def is_symbolic(value: Any) -> bool:
    """Whether a number is an expression of parameters."""
    return bool(getattr(value, "free_symbols", None))


def is_nonlinear(element: Element) -> bool:
    """Whether a spring or damper has a part that is not linear. That of a text is not looked at."""
    coefficients = element.coefficients()
    return not coefficients or set(coefficients) != {1}


def _number(value: Any, what: str) -> Any:
    """A finite number as a float; an expression of parameters as it is."""
    if is_symbolic(value):
        return value
    number = checked_number(value, what)
    if abs(number) == float("inf"):
        raise InvalidSystem(f"{what} is finite; received {number}")
    return number


def _numbers(values: Any, what: str) -> tuple[Any, ...]:
    """Finite numbers, or expressions of parameters."""
    if isinstance(values, (str, bytes)) or not isinstance(values, (Sequence, np.ndarray)):
        raise InvalidSystem(f"{what} is a list of numbers; received {shown(values)}")
    return tuple(_number(value, f"an entry of {what}") for value in values)
