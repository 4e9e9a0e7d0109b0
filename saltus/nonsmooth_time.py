"""`saltus orbit --method nstt`: an orbit once more, by the reference paper's own method, in place of the exact one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from branches.orbit import Impact, Orbit
from bvp.nonsmooth_time import TOLERANCE, NonsmoothTimeOrbit, NotMatched, StandsStill, solve_nonsmooth_time, why_not
from saltus.errors import BadInput

__all__ = ["ApproximateOrbit", "approximate"]

_DIGITS = range(3, 9)  # a guess that is better than this is no guess
_AWAY = 0.01  # impacts that are off by this part of the quarter period are those of another orbit


@dataclass(frozen=True, eq=False)
class ApproximateOrbit(Orbit):
    """An orbit as shooting in nonsmooth time has it; `problem` and `solution` are the exact one that was asked for.

    Parameters
    ----------
    found : NonsmoothTimeOrbit
    digits : int
        Significant digits of the exact velocities that shooting was started with.

    Notes
    -----
    The method gives no multipliers: none are listed, and stability is undecided. Label, ends and word are those of the exact orbit, whose
    impacts it has been found to have, at the same stops in the same order.
    """

    found: NonsmoothTimeOrbit
    digits: int

    @property
    def h(self) -> float:
        return self.found.h

    @property
    def alpha(self) -> float:
        return self.found.quarter_period

    @property
    def residual(self) -> float:
        return self.found.mismatch

    @property
    def velocities(self) -> np.ndarray:
        return self.found.velocities

    @property
    def impact_speeds(self) -> np.ndarray:
        return np.array([impact.speed for impact in self.found.half])

    @property
    def multipliers(self) -> np.ndarray:
        return np.empty(0, dtype=complex)

    @property
    def tau(self) -> float:
        return math.nan

    @property
    def tau_half(self) -> float:
        return math.nan

    @property
    def stable(self) -> bool | None:
        return None

    @property
    def quality(self) -> dict[str, Any]:
        return {
            "trivial": math.nan,
            "pairing": math.nan,
            "reliable": False,
            "approximate": True,
            "method": "nstt",
            "integrator": self.found.integrator,
            "tolerance": self.found.tolerance,
            "integrator_tolerance": self.found.integrator_tolerance,
            "drift": self.found.drift,
            "corrections": self.found.corrections,
        }

    @property
    def impacts(self) -> list[Impact]:
        return [Impact(*impact) for impact in self.found.impacts]

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.found.sample(times)


def approximate(orbit: Orbit, tolerance: float) -> ApproximateOrbit:
    """Find an orbit by shooting in nonsmooth time, at its quarter period, from its velocities rounded to a few digits.

    Parameters
    ----------
    orbit : Orbit
        The exact one.
    tolerance : float
        Of the matching at the half period.

    Raises
    ------
    BadInput
        For an orbit that the method has not: where no end is an origin, and where nothing reverses it.
    NotMatched
        Where shooting does not come to this orbit.
    """
    reason = why_not(orbit.system)
    if orbit.velocities is None and reason is None:
        reason = f"its ends are {orbit.ends[0]} {orbit.ends[1]}"
    if reason is not None:
        raise BadInput(
            f"--method nstt has no orbit {orbit.label or orbit.word}: {reason}; expected one that starts at u = 0 and is there again after "
            "half its period, or --method exact"
        )
    velocities = orbit.velocities
    assert velocities is not None
    failure: NotMatched | None = None
    for digits in _DIGITS:
        guess = [float(f"{value:.{digits - 1}e}") for value in velocities]
        try:
            found = solve_nonsmooth_time(orbit.system, orbit.alpha, guess, tolerance=max(tolerance, TOLERANCE))
            _compare(found, orbit)
            if tolerance < TOLERANCE:  # where it is going is known now, and was cheap to find
                found = solve_nonsmooth_time(orbit.system, orbit.alpha, found.velocities, tolerance=tolerance)
                _compare(found, orbit)
        except StandsStill as error:  # a nearer guess would end there, too
            raise NotMatched(f"--method nstt does not match {orbit.label}: {error}") from None
        except NotMatched as error:
            failure = error
        else:
            return ApproximateOrbit(orbit.problem, orbit.solution, found, digits)
    assert failure is not None
    raise NotMatched(f"--method nstt does not come to {orbit.label}, from its velocities to {_DIGITS[-1]} digits: {failure}")


def _compare(found: NonsmoothTimeOrbit, orbit: Orbit) -> None:
    """Refuse another orbit than the one that was asked for."""
    here, there = found.impacts, orbit.impacts
    if [impact[1] for impact in here] != [impact.stop for impact in there]:
        raise NotMatched(f"it ends on another orbit, with {len(here)} impacts in a period and not the {len(there)} of this one")
    away = max(abs(a[0] - b.time) for a, b in zip(here, there, strict=True))
    if away > _AWAY * orbit.alpha:
        raise NotMatched(f"it ends on another orbit, whose impacts come up to {away:.2g} earlier or later")
