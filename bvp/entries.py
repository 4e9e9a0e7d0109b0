"""The numbers that describe a system and its periodic loads, as one vector of entries, and the base frequency of loads.

The loads are f(t) = constant + sum over k of (cosine_k cos(k w t) + sine_k sin(k w t)), with the base frequency w and the harmonics k.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from bvp.checks import ASYMMETRY, EPSILON, InvalidSystem

__all__ = ["LARGEST_HARMONIC", "EntryLayout", "base_frequency", "entries_of", "exact"]

LARGEST_HARMONIC = 1000
"""Largest multiple k of the base frequency that a load can have. Frequencies whose ratio needs larger integers are incommensurate."""


@dataclass(frozen=True)
class EntryLayout:
    """Where the E entries are, for n coordinates, S stops and H harmonics. Each matrix is stored row by row.

    Parameters
    ----------
    degrees_of_freedom, stops : int
    harmonics : tuple of int
        The H multiples k of the base frequency, ascending.

    Attributes
    ----------
    mass, damping, stiffness : slice
        n^2 entries each.
    lower, upper, restitution : slice
        S entries each. A bound that is absent is -inf or inf.
    constant : slice
        n entries, the constant load.
    cosine, sine : slice
        H n entries each, harmonic by harmonic.
    frequency : slice
        One entry, the base frequency w; 0 if no load is harmonic.
    size : int
        E.

    Examples
    --------
    >>> layout = EntryLayout(2, 1, (1, 3))
    >>> layout.stiffness, layout.restitution, layout.cosine, layout.frequency, layout.size
    (slice(8, 12, None), slice(14, 15, None), slice(17, 21, None), slice(25, 26, None), 26)
    """

    degrees_of_freedom: int
    stops: int
    harmonics: tuple[int, ...] = ()

    def _slice(self, index: int) -> slice:
        n, count = self.degrees_of_freedom, len(self.harmonics)
        lengths = [n * n] * 3 + [self.stops] * 3 + [n, count * n, count * n, 1]
        first = sum(lengths[:index])
        return slice(first, first + lengths[index])

    mass = property(lambda self: self._slice(0))
    damping = property(lambda self: self._slice(1))
    stiffness = property(lambda self: self._slice(2))
    lower = property(lambda self: self._slice(3))
    upper = property(lambda self: self._slice(4))
    restitution = property(lambda self: self._slice(5))
    constant = property(lambda self: self._slice(6))
    cosine = property(lambda self: self._slice(7))
    sine = property(lambda self: self._slice(8))
    frequency = property(lambda self: self._slice(9))

    @property
    def size(self) -> int:
        return int(self.frequency.stop)


def exact(value: Any) -> Any:
    """A float or an integer as the sympy number that equals it; an expression as it is."""
    import sympy

    if isinstance(value, int | float):
        return sympy.Rational(value) if math.isfinite(value) else sympy.Float(value)
    return value


def base_frequency(frequencies: Sequence[Any], texts: Sequence[str] = ()) -> tuple[Any, tuple[int, ...]]:
    """The largest w of which all frequencies are integer multiples, and the multiples.

    Parameters
    ----------
    frequencies : sequence of float or sympy expression
        Of loads, above 0.
    texts : sequence of str, optional
        How messages show them.

    Returns
    -------
    w : float or sympy expression
    multiples : tuple of int

    Raises
    ------
    ValueError
        If the ratio of two frequencies is no ratio of integers up to `LARGEST_HARMONIC`, also not for all values of the parameters.

    Examples
    --------
    >>> import sympy
    >>> a = sympy.Symbol("a")
    >>> base_frequency([2 * a, 3 * a]), base_frequency([1.4, 2.1]), base_frequency([0.3])
    ((a, (2, 3)), (0.7, (2, 3)), (0.3, (1,)))
    >>> base_frequency([1.0, 2**0.5])
    Traceback (most recent call last):
    ValueError: the load frequencies 1 and 1.41421 are incommensurate: their sum has no period; expected multiples of one base frequency w
    """
    first = frequencies[0]
    ratios: list[Fraction] = []
    for k, frequency in enumerate(frequencies):
        ratio = _ratio(frequency, first)
        if ratio is None:
            shown = [texts[i] if texts else f"{frequencies[i]:.6g}" for i in (0, k)]
            raise ValueError(
                f"the load frequencies {shown[0]} and {shown[1]} are incommensurate: their sum has no period; "
                "expected multiples of one base frequency w"
            )
        ratios.append(ratio)
    common = math.lcm(*(ratio.denominator for ratio in ratios))
    multiples = [int(ratio * common) for ratio in ratios]
    shared = math.gcd(*multiples)
    multiples = [multiple // shared for multiple in multiples]
    if max(multiples) > LARGEST_HARMONIC:
        k = multiples.index(max(multiples))
        shown = [texts[i] if texts else f"{frequencies[i]:.6g}" for i in (0, k)]
        raise ValueError(
            f"the load frequencies {shown[0]} and {shown[1]} are incommensurate: they would be the multiples {multiples[0]} and "
            f"{multiples[k]} of a base frequency, expected at most {LARGEST_HARMONIC}"
        )
    return first / multiples[0] if multiples[0] > 1 else first, tuple(multiples)


def _ratio(frequency: Any, first: Any) -> Fraction | None:
    """The ratio of two frequencies as one of integers, to rounding; None if it is none."""
    if isinstance(frequency, float) and isinstance(first, float):
        value = frequency / first
    else:
        import sympy

        ratio = sympy.cancel(exact(frequency) / exact(first))
        if ratio.free_symbols:
            # Roots of products, such as sqrt(k/m), can be divided where their parts are positive.
            ratio = sympy.simplify(ratio.xreplace({symbol: sympy.Dummy(positive=True) for symbol in ratio.free_symbols}))
        if not ratio.is_number:
            return None
        value = float(ratio)
    if not 0.0 < value < math.inf:
        return None
    found = Fraction(value).limit_denominator(LARGEST_HARMONIC)
    return found if abs(found - Fraction(value)) <= 4.0 * EPSILON * value else None


def entries_of(parts: Mapping[str, Any], loads: Sequence[Mapping[str, Any]]) -> tuple[EntryLayout, list[Any]]:
    """The layout and the entries, each a float or a sympy expression.

    Parameters
    ----------
    parts : mapping
        ``mass``, ``damping``, ``stiffness``: n lists of n. ``stops``: (row, lower, upper, restitution) of each.
    loads : sequence of mapping
        ``constant`` (n), or ``cosine`` (n), ``sine`` (n) and ``frequency``, with ``text``, which shows the frequency in messages.

    Raises
    ------
    ValueError
        If the loads have no base frequency.
    """
    n, stops = len(parts["mass"]), parts["stops"]
    harmonic = [load for load in loads if "frequency" in load]
    base: Any = 0.0
    multiples: tuple[int, ...] = ()
    if harmonic:
        base, multiples = base_frequency([load["frequency"] for load in harmonic], [load["text"] for load in harmonic])
    layout = EntryLayout(n, len(stops), tuple(sorted(set(multiples))))
    entries = _symmetric(parts["mass"], "mass") + sum(map(list, parts["damping"]), []) + _symmetric(parts["stiffness"], "stiffness")
    entries += [stop[k] for k in (1, 2, 3) for stop in stops]
    entries += _total([load["constant"] for load in loads if "constant" in load], n)
    for part in ("cosine", "sine"):
        for k in layout.harmonics:
            entries += _total([load[part] for load, multiple in zip(harmonic, multiples, strict=True) if multiple == k], n)
    return layout, [*entries, base]


def _total(rows: Sequence[Sequence[Any]], n: int) -> list[Any]:
    """The sum of rows (n)."""
    return [_sum([row[i] for row in rows]) for i in range(n)]


def _sum(terms: Sequence[Any]) -> Any:
    return math.fsum(terms) if all(isinstance(term, int | float) for term in terms) else sum(map(exact, terms))


def _equal_to_rounding(here: Any, there: Any) -> bool:
    """Whether two expressions are equal, or differ by rounding of their numbers at each of some values of the parameters."""
    import sympy

    symbols = sorted(here.free_symbols | there.free_symbols, key=str)
    if not symbols or sympy.simplify(here - there) == 0:
        return True
    for places in _PLACES:
        values = {symbol: sympy.Rational(places[k % len(places)]) + k // len(places) for k, symbol in enumerate(symbols)}
        one, other = (sympy.N(expression.subs(values), 30) for expression in (here, there))
        if not (one.is_finite and other.is_finite and abs(one - other) <= ASYMMETRY * max(abs(one), abs(other))):
            return False
    return True


_PLACES = (("0.737", "1.319", "2.083"), ("1.151", "0.613", "1.787"), ("2.459", "1.931", "0.557"))
"""Values of the parameters at which two expressions are compared."""


def _symmetric(matrix: Sequence[Sequence[Any]], name: str) -> list[Any]:
    """The entries, row by row, of a matrix that has to be symmetric for all values of the parameters."""
    n = len(matrix)
    rows = [list(row) for row in matrix]
    for i in range(n):
        for j in range(i):
            if isinstance(matrix[i][j], int | float) and isinstance(matrix[j][i], int | float):
                rows[i][j] = rows[j][i] = 0.5 * (float(matrix[i][j]) + float(matrix[j][i]))
                continue

            here, there = exact(matrix[i][j]), exact(matrix[j][i])
            if here != there and not _equal_to_rounding(here, there):
                raise InvalidSystem(f"{name} must be symmetric; entry ({j + 1}, {i + 1}) is {there} and ({i + 1}, {j + 1}) is {here}")
            # what differs by rounding, as in `bvp.checks.square`
            rows[i][j] = rows[j][i] = matrix[j][i] if here.free_symbols else 0.5 * (float(here) + float(there))
    return sum(rows, [])
