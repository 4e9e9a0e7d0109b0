"""Checks of values that a user passes in, and read-only forms of values that a user gets back.

Each refusal is one line that says what was received and what was expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

import numpy as np

from bvp.texts import shown

__all__ = [
    "EPSILON", "SMALLEST", "Frozen", "InvalidSystem", "checked_energy_range", "checked_number", "finite_numbers", "is_finite",
    "is_whole", "read_only", "real", "reals", "refuse_unknown", "require_branch", "require_motion", "require_system", "square",
]  # fmt: skip

EPSILON = float(np.finfo(float).eps)

ASYMMETRY = 64.0 * EPSILON
"""Part of two entries, or of the root of the product of their diagonal entries, by which they differ in a symmetric matrix: numbers that
were computed in two ways, or written in fifteen digits."""

SMALLEST, LARGEST = 1e-25, 1e25
"""Sizes that masses, gap rows and bounds may have, and the largest of a stiffness: the fourth powers of frequencies, and products with
them, stay inside floats. A stiffness or damping may be as small as it likes."""


class InvalidSystem(ValueError):
    """The description of a system cannot be: the message says in one line what was received and what was expected."""


def real(value: Any) -> float:
    """A number as a float.

    Raises
    ------
    TypeError, ValueError
        For what is no number, such as text, bytes and other buffers, and booleans; for a number beyond floats.

    Examples
    --------
    >>> real(10**400)
    Traceback (most recent call last):
    ValueError: beyond all floats
    """
    kind = type(value)
    if kind is float:
        return value
    # float() also reads text and buffers, which have no __float__ of their own.
    if isinstance(value, (str, bool)) or not (hasattr(kind, "__float__") or hasattr(kind, "__index__")):
        raise TypeError(f"expected a number; received {shown(value)}")
    if isinstance(value, (np.generic, np.ndarray)) and value.dtype.kind not in "iufO":
        raise TypeError(f"expected a number; received {shown(value)}")
    try:
        return float(value)
    except OverflowError:
        raise ValueError("beyond all floats") from None


def is_finite(value: Any) -> bool:
    """Whether a value is a finite number that a float can hold.

    Examples
    --------
    >>> is_finite(1), is_finite(10**400), is_finite(b"1"), is_finite(math.inf)
    (True, False, False, False)
    """
    try:
        return math.isfinite(real(value))
    except (TypeError, ValueError):
        return False


def is_whole(value: Any, least: int, most: int) -> bool:
    """Whether a value is an integer from `least` to `most`, of Python or of numpy. A boolean is none.

    Examples
    --------
    >>> is_whole(3, 1, 5), is_whole(np.int8(5), 1, 5), is_whole(0, 1, 5), is_whole(3.0, 1, 5), is_whole(True, 1, 5)
    (True, True, False, False, False)
    """
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and least <= int(value) <= most


def reals(value: Any, *, flat: bool = False) -> np.ndarray:
    """Numbers, in nested lists or an array, as a new array of floats; errors as for `real`. `flat`: nested lists are refused.

    Examples
    --------
    >>> reals([[1, 2]])
    array([[1., 2.]])
    >>> reals([0.0, True])
    Traceback (most recent call last):
    TypeError: expected numbers; received [0.0, True]
    >>> reals([[1, 2]], flat=True)
    Traceback (most recent call last):
    ValueError: expected a list of numbers that is not nested; received [[1, 2]]
    """
    array = value if isinstance(value, np.ndarray) else np.array(value, dtype=object)
    if array.dtype.kind not in "iufO":
        raise TypeError(f"expected numbers; received {shown(value)}")
    if array.dtype.kind == "O":
        try:
            array = np.array([real(entry) for entry in array.ravel()], dtype=float).reshape(array.shape)
        except TypeError:
            raise TypeError(f"expected numbers; received {shown(value)}") from None
    if _holds_bytes(value):
        raise TypeError(f"expected numbers; received {shown(value)}")
    if flat and array.ndim != 1:
        raise ValueError(f"expected a list of numbers that is not nested; received {shown(value)}")
    return np.array(array, dtype=float)


def _holds_bytes(value: Any) -> bool:
    """Whether there are bytes, which numpy reads as numbers, at any depth of lists."""
    if isinstance(value, list | tuple):
        return any(type(entry) is not float and _holds_bytes(entry) for entry in value)
    return isinstance(value, bytearray | memoryview) or getattr(value, "typecode", "") in ("b", "B")


def finite_numbers(value: Any, what: str, *shape: int | None) -> np.ndarray:
    """An array of finite numbers of a given shape, None where any length will do; a single number is a list of one.

    Raises
    ------
    ValueError

    Examples
    --------
    >>> finite_numbers([1, "x"], "u", 2)
    Traceback (most recent call last):
    ValueError: u is a list of 2 finite numbers; received [1, 'x']
    """
    try:
        array = np.atleast_1d(reals(value))
    except (TypeError, ValueError):
        array = np.full(1, math.nan)
    fits = array.ndim == len(shape) and all(length in (None, own) for length, own in zip(shape, array.shape, strict=True))
    if fits and np.isfinite(array).all():
        return array
    size = "" if shape[-1] is None else f"{shape[-1]} "
    kind = f"a list of {size}" if len(shape) == 1 else f"an array (m, {shape[-1]}) of "
    raise ValueError(f"{what} is {kind}finite numbers; received {shown(value)}")


def checked_energy_range(value: Any, *, positive: bool = False) -> tuple[float, float]:
    """A range (LO, HI) of energies with 0 <= LO < HI; where it has to be positive, LO is above 0 and HI finite.

    Raises
    ------
    ValueError
        For another range, and for what is none.

    Examples
    --------
    >>> checked_energy_range([0, math.inf])
    (0.0, inf)
    >>> checked_energy_range([0, 1], positive=True)
    Traceback (most recent call last):
    ValueError: energy range 0:1: expected 0 < LO < HI < inf
    """
    try:
        low, high = reals(value, flat=True).tolist()
    except (TypeError, ValueError):
        raise ValueError(f"energy range {shown(value)}: expected two numbers (LO, HI)") from None
    if not 0.0 <= low < high or (positive and not 0.0 < low < high < math.inf):
        wrong = " is empty or reversed;" if low >= high else ":"
        raise ValueError(f"energy range {low:.15g}:{high:.15g}{wrong} expected {'0 < LO < HI < inf' if positive else '0 <= LO < HI'}")
    return low, high


def checked_number(value: Any, what: str, least: float = 0.0) -> float:
    """A float that is not NaN. Refused as well is a finite number that is too small or too large to compute with; 0 and infinity pass.

    Examples
    --------
    >>> checked_number(1e-300, "mu", SMALLEST)
    Traceback (most recent call last):
    bvp.checks.InvalidSystem: mu is too small to compute with; received 1e-300, expected a size from 1e-25 to 1e+25
    """
    try:
        result = real(value)
    except (TypeError, ValueError):
        raise InvalidSystem(f"{what} is a number; received {shown(value)}") from None
    if math.isnan(result):
        raise InvalidSystem(f"{what} is a number; received NaN")
    if result and math.isfinite(result) and not least <= abs(result) <= LARGEST:
        kind = "small" if abs(result) < least else "large"
        expected = f"a size from {least:g} to {LARGEST:g}"
        raise InvalidSystem(f"{what} is too {kind} to compute with; received {result:g}, expected {expected}")
    return result


def square(value: Any, name: str, size: int | None = None, *, symmetric: bool = True) -> np.ndarray:
    """A finite (size, size) float matrix, copied; where it has to be symmetric, to `ASYMMETRY`, its symmetric part."""
    try:
        matrix = reals(value)
    except (TypeError, ValueError):
        raise InvalidSystem(f"{name} is a square matrix of numbers; received {shown(value)}") from None
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise InvalidSystem(f"{name} is a square matrix; received shape {matrix.shape}")
    if size is not None and matrix.shape[0] != size:
        raise InvalidSystem(f"{name} is {size} by {size} like mass; received {matrix.shape[0]} by {matrix.shape[1]}")
    sizes = np.abs(matrix)
    if not sizes.max() < np.inf:
        i, j = np.argwhere(~np.isfinite(matrix))[0]
        raise InvalidSystem(f"{name} holds finite numbers; entry ({i + 1}, {j + 1}) is {matrix[i, j]}")
    ordinary = ((SMALLEST <= sizes) & (sizes <= LARGEST) | (sizes == 0.0)).all()
    for i, j in () if ordinary else np.argwhere(matrix):
        checked_number(float(matrix[i, j]), f"entry ({i + 1}, {j + 1}) of {name}", SMALLEST if name == "mass" and i == j else 0.0)
    if not symmetric:
        return matrix
    defect = np.abs(matrix - matrix.T)
    if defect.any():
        # A matrix that is summed from elements has the rounding of its diagonal, which its other entries may be smaller than.
        roots = np.sqrt(np.diag(sizes))
        size = np.maximum(np.maximum(sizes, sizes.T), np.outer(roots, roots))
        part = np.divide(defect, size, out=np.zeros_like(size), where=defect > 0.0)
        i, j = np.unravel_index(int(np.argmax(part)), part.shape)
        if part[i, j] > ASYMMETRY:
            here, there = (f"{entry:.15g}" for entry in (matrix[i, j], matrix[j, i]))
            raise InvalidSystem(f"{name} must be symmetric; entry ({i + 1}, {j + 1}) is {here} and ({j + 1}, {i + 1}) is {there}")
    return 0.5 * (matrix + matrix.T)


def refuse_unknown(given: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    """Name the first unknown key and the nearest known one."""
    for key in given:
        if key not in known:
            near = get_close_matches(str(key), known, 1, 0.0)
            raise InvalidSystem(f"unknown key {shown(key)} in {where}; nearest known: {near[0] if near else ', '.join(known)}")


def require_system(system: Any, *, conservative: str = "", two_dof: str = "", advice: str = "", smooth: bool = False) -> None:
    """Refuse what is no `bvp.system.ImpactSystem`, for which a scene or a name is easily taken, and systems that a method does not cover.

    Parameters
    ----------
    conservative, two_dof : str
        Beginning of the message if the method needs a conservative system, or two degrees of freedom and one stop. Empty: it does not.
    advice : str
        End of the message on degrees of freedom and stops.
    smooth : bool
        Whether the method uses springs and dampers that are not linear. Else a system with one is refused.

    Raises
    ------
    TypeError
        For an object that is no system.
    ValueError
        For a system that is not covered.
    """
    if not hasattr(system, "describe"):
        raise TypeError(f"the system is {shown(system)}, expected an ImpactSystem such as vibro_impact_nes(mu=0.1, sigma=0.1)")
    reason = system.why_not_conservative() if conservative else None
    if reason is not None:
        instead = "; its motion is for saltus run" if system.has_potential else ""
        raise ValueError(f"{conservative} need a conservative system: {reason}{instead}")
    reason = None if smooth else system.why_not_linear()
    if reason is not None:
        raise ValueError(f"{reason}, and this computation has linear flights only; expected linear springs and dampers between stops")
    if two_dof and system.degrees_of_freedom != 2:
        raise ValueError(f"{two_dof} two degrees of freedom; this system has {system.degrees_of_freedom}{advice and ': ' + advice}")
    if two_dof and len(system.stops) != 1:
        raise ValueError(f"{two_dof} a system with one stop; this one has {len(system.stops)}{advice and ': ' + advice}")


def require_branch(branch: Any) -> None:
    """Refuse what is no `branches.branch.Branch`, such as its name, with a TypeError."""
    if not hasattr(branch, "unknowns"):
        raise TypeError(f'the branch is {shown(branch)}, expected a Branch such as saltus.trace("S13+")')


def require_motion(motion: Any) -> None:
    """Refuse what is no `bvp.motion.Motion`, with a TypeError."""
    if not hasattr(motion, "flights"):
        raise TypeError(f"the motion is {shown(motion)}, expected a Motion such as saltus.simulate(system, u, v, duration)")


def read_only(array: np.ndarray) -> np.ndarray:
    """A view of the array that is read-only for good. A read-only buffer owns the view, so numpy refuses to make it writable again.

    Examples
    --------
    >>> read_only(np.zeros(2))[0] = 1.0
    Traceback (most recent call last):
    ValueError: assignment destination is read-only
    >>> read_only(np.zeros(2)).setflags(write=True)
    Traceback (most recent call last):
    ValueError: cannot set WRITEABLE flag to True of this array
    """
    if isinstance(array.base, memoryview) and not array.flags.writeable:
        return array
    return np.asarray(memoryview(array).toreadonly())  # type: ignore[arg-type]


class Frozen(dict[str, Any]):
    """A dict that cannot be changed; its arrays cannot either. `dict(frozen)` and `frozen | other` are ordinary dicts.

    Examples
    --------
    >>> frozen = Frozen({"h": np.ones(3)})
    >>> frozen["h"] = 2.0
    Traceback (most recent call last):
    TypeError: these data cannot be changed; expected a change of a copy, dict(data)
    >>> frozen["h"].flags.writeable, dict(frozen | {"h": 2.0})
    (False, {'h': 2.0})
    """

    def __init__(self, *content: Any) -> None:
        super().__init__({key: read_only(value) if isinstance(value, np.ndarray) else value for key, value in dict(*content).items()})

    def __reduce__(self) -> tuple[type[Frozen], tuple[dict[str, Any]]]:
        return Frozen, (dict(self),)

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("these data cannot be changed; expected a change of a copy, dict(data)")

    __setitem__ = __delitem__ = clear = pop = popitem = setdefault = update = __ior__ = _refuse
