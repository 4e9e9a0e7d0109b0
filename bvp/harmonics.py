"""Harmonic content and size of a periodic orbit, from samples of its path.

The Fourier series of its displacements is u = a_0 + sum a_k cos(2 pi k t/T - phi_k). The integrals over each flight are Gauss sums on
panels, exact to rounding: on a panel of a linear flight, and on a Taylor step of a smooth one, the integrand is smooth. The symmetries of
the ends unfold the solved segment to the period, so no flight is computed beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bvp.closures import ORIGIN
from bvp.forced import ForcedProblem
from bvp.kernels.flight import fastest_rate
from bvp.kernels.sources import ORDER
from bvp.multipoint import MultipointProblem
from bvp.released import ReleasedProblem
from bvp.smooth_flights import loaded_steps, sample_path, smooth_steps

__all__ = ["harmonics", "sizes"]

_nodes, _weights = np.polynomial.legendre.leggauss(ORDER + 2)
_PLACES, _WEIGHTS = 0.5 * (1.0 + _nodes), 0.5 * _weights
"""Gauss's rule on [0, 1]."""

_PHASE = 10.0
"""Largest phase on a panel. A harmonic differs from its polynomial of degree ORDER + 3 by the Bessel function of this order and one more
at half of it, below 1e-16; the rule is exact for the product of this polynomial and a Taylor step."""

Samples = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Times (m,), weights of the integral (m,) and displacements (m, n) along a flight."""


def harmonics(problem: MultipointProblem | ForcedProblem, y: np.ndarray, highest: int) -> np.ndarray:
    """The amplitudes of the harmonics of an orbit's own frequency 2 pi/T.

    Parameters
    ----------
    problem : MultipointProblem or ForcedProblem
    y : (u,) float
        A solution.
    highest : int
        Number K of the highest harmonic.

    Returns
    -------
    (K + 1, n) ndarray
        Row 0 has the means, row k >= 1 the amplitudes a_k >= 0 of each coordinate. The amplitude of a linear flight is that of its
        exact solution, of a smooth one that of its Taylor steps.

    Raises
    ------
    RuntimeError
        If a flight cannot be computed: the message says where and why.

    Examples
    --------
    An orbit with an impact in each half period has odd harmonics alone.

    >>> from bvp.multipoint import MultipointProblem
    >>> from bvp.system import vibro_impact_nes
    >>> problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    >>> y = problem.solve(problem.pack([0.0, 0.0, 0.9, 0.6], [], [1.7]), quarter_period=1.7).y
    >>> harmonics(problem, y, 3).round(6)
    array([[0.      , 0.      ],
           [1.781052, 1.039891],
           [0.      , 0.      ],
           [0.118656, 0.013641]])
    """
    if isinstance(problem, ReleasedProblem):
        problem, y = problem.orbit_problem(y)
    orders = np.arange(highest + 1)
    odd = (orders % 2)[:, None]
    if isinstance(problem, ForcedProblem):
        period = problem.period(y)
        sums = _integrals(_forced_flights(problem, y, 2.0 * math.pi * highest / period), 2.0 * math.pi * orders / period)
        if problem.half:
            sums = 2.0 * odd * sums
    else:
        period = 4.0 / problem.quarters * float(np.sum(problem.flight_times(y)))
        sums = _integrals(_free_flights(problem, y, 2.0 * math.pi * highest / period), 2.0 * math.pi * orders / period)
        if not problem.periodic:
            # The orbit is odd in time about an origin, and even about another end. Of a quarter of it u(t + T/2) = -u(t).
            sums = 2.0 * (1j * sums.imag if problem.kinds[0] == ORIGIN else sums.real)
            if problem.quarters == 1:
                sums = 2.0 * odd * sums
    found = 2.0 * np.abs(sums) / period
    found[0] = sums[0].real / period
    return found


_SERIES = np.linalg.inv(np.polynomial.legendre.legvander(_nodes, ORDER + 1))
"""From the samples on a panel to the Legendre series through them, which is exact to rounding for a phase of `_PHASE`."""


def sizes(problem: MultipointProblem, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest displacements (n,) of a conservative orbit, and their root mean squares (n,) over the period.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        A solution.

    Raises
    ------
    RuntimeError
        If a flight cannot be computed: the message says where and why.
    """
    legendre = np.polynomial.legendre
    largest, squares = np.zeros(problem.half), np.zeros(problem.half)
    for _, weights, u in _free_flights(problem, y, 0.0):
        squares += weights @ u**2
        for panel in u.reshape(-1, len(_PLACES), problem.half):
            for c, series in enumerate((_SERIES @ panel).T):
                turns = legendre.legroots(legendre.legder(series)) if np.any(series[1:]) else np.zeros(0)
                inside = turns.real[(np.abs(turns.imag) < 1e-6) & (np.abs(turns.real) < 1.0)]
                largest[c] = max(largest[c], np.abs(legendre.legval(np.array([-1.0, *inside, 1.0]), series)).max())
    return largest, np.sqrt(squares / float(np.sum(problem.flight_times(y))))


def _integrals(flights: Iterator[Samples], rates: np.ndarray) -> np.ndarray:
    """The integrals of u exp(-i rate t), (K + 1, n)."""
    return sum(np.exp(-1j * np.outer(rates, times)) @ (weights[:, None] * u) for times, weights, u in flights)


def _panels(length: float, rate: float, fastest: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) and weights (m,) of Gauss's rule on so many panels of an interval that the phase on each is small enough. What decays at
    the fastest rate acts beside the start alone: there a panel is halved until it is short."""
    edges = np.linspace(0.0, length, (math.ceil(rate * length / _PHASE) or 1) + 1)
    halvings = math.ceil(math.log2(max(1.0, fastest * edges[1] / _PHASE)))
    edges = np.insert(edges, 1, edges[1] * 2.0 ** np.arange(-halvings, 0))
    lengths = np.diff(edges)[:, None]
    return (edges[:-1, None] + lengths * _PLACES).ravel(), (lengths * _WEIGHTS).ravel()


def _along_steps(begin: float, edges: np.ndarray, coefficients: np.ndarray, rate: float) -> Iterator[Samples]:
    """The samples of the Taylor steps of a flight: displacements from coefficients (S, ORDER + 1, n)."""
    for at, length, polynomial in zip(edges[:-1], np.diff(edges), coefficients, strict=True):
        times, weights = _panels(float(length), rate)
        yield begin + at + times, weights, np.polynomial.polynomial.polyval(times, polynomial).T


def _free_flights(problem: MultipointProblem, y: np.ndarray, rate: float) -> Iterator[Samples]:
    """The samples of the flights of a conservative orbit, for harmonics up to a rate."""
    modes, n, begin = problem.modes, problem.half, 0.0
    shapes = modes.to_state[:n]
    for state, duration in zip([problem.start(y), *problem.nodes(y)], problem.flight_times(y).tolist(), strict=True):
        if problem.is_smooth:
            edges, coefficients = smooth_steps(problem.orbits.flight, state, duration)
            yield from _along_steps(begin, edges, coefficients @ shapes.T, rate)
        else:
            times, weights = _panels(duration, rate + fastest_rate(modes.flight))
            states = np.empty((len(times), 2 * n))
            sample_path(problem.system, np.zeros(1), state[None], times, states)
            yield begin + times, weights, states @ shapes.T
        begin += duration


def _forced_flights(problem: ForcedProblem, y: np.ndarray, rate: float) -> Iterator[Samples]:
    """The samples of the flights of a forced orbit, for harmonics up to a rate."""
    n, begin = problem.degrees_of_freedom, 0.0
    turning, fastest = (0.0, 0.0) if problem.is_smooth else _own_rates(problem, y)
    for i, (node, duration) in enumerate(zip(problem.nodes(y), problem.flight_times(y).tolist(), strict=True)):
        if problem.is_smooth:
            edges, coefficients = loaded_steps(problem, node, duration, i)
            yield from _along_steps(begin, edges, coefficients[..., :n], rate)
        else:
            times, weights = _panels(duration, rate + turning, fastest)
            yield begin + times, weights, np.array([problem.fly(node, time, i)[0][:n] for time in times.tolist()])
        begin += duration


def _own_rates(problem: ForcedProblem, y: np.ndarray) -> tuple[float, float]:
    """How fast linear flights under loads turn or grow, and their fastest rate."""
    parameters = problem.parameters(y)
    layout, own = problem.parametric.layout, np.linalg.eigvals(problem.parametric.system(parameters).modes.matrix)
    base = float(problem.parametric.entries(parameters)[layout.frequency][0]) if problem.has_clock else 0.0
    turning = np.maximum(np.abs(own.imag), own.real).max() + base * max(layout.harmonics, default=0)
    return float(turning), float(np.abs(own).max())
