"""The matrices that are singular at bifurcations of free orbits, with their exact derivatives.

A critical perturbation of an orbit between two reversing ends is symmetric or antisymmetric about each end. It solves the flights of the
multipoint problem, linearised at fixed parameters, with the rows of the end where it is symmetric, and with those of `Turned` where it is
antisymmetric:

    SN  symmetric about both ends        SB, PD  antisymmetric about one end, or about both

A symmetric perturbation leaves the instant of the reversal at its end, and an antisymmetric one too, unless that end is an impact: the
impact moves to the instant t + dt, its image to t - dt. There the perturbation has one condition more. Otherwise the duration of the
segment is kept.

A perturbation that is antisymmetric about both ends is determined up to a shift in time, and keeps the energy, so that one of its
conditions follows from the others. The shift is excluded, and a freedom is added that only a change of the energy can use.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from branches.curves.pencils import CONSTANT, NONE_FREED, OTHER, OWN, Freed, MatrixRows, RowsCondition, whole_rows
from branches.curves.plane import ParameterPlane
from bvp.closures import ORIGIN, REST, STOP
from bvp.released import ReleasedProblem
from continuation.curves import Linearised, SingularCondition

__all__ = [
    "BOTH", "FOLD", "SYMMETRIES", "Breaking", "Fold", "FreeKind", "Symmetry", "Turned", "free_condition", "names_quarter_period",
    "smallest_singular", "with_rows_of_one",
]  # fmt: skip

Symmetry = tuple[bool, bool]
"""Whether a perturbation is antisymmetric about the start, and about the far end."""

FOLD: Symmetry = (False, False)
"""That of a fold."""

BOTH: Symmetry = (True, True)
SYMMETRIES: tuple[Symmetry, ...] = (BOTH, (False, True), (True, False))
"""Those that break a symmetry of an orbit between two ends."""


class FreeKind(NamedTuple):
    """What is critical on a curve of free orbits: the symmetry of the perturbation; whether the orbits are symmetric in half the period
    that is solved for; whether a fold is one in the energy, see `free_condition`."""

    symmetry: Symmetry
    doubled: bool = False
    in_energy: bool = False


class Turned(ReleasedProblem):
    """The problem of a family with the end conditions of antisymmetric perturbations. It is linearised, and never solved.

    Those are, of a perturbation (du, dv) of the state at

        origin  dv = 0        rest  du = 0        stop  c . dv = 0, and du = 0 across c

    At a stop c . du = 0 is a condition, too, which the problem of the family has.
    """

    def __init__(self, problem: ReleasedProblem):
        super().__init__(
            problem.parametric, problem.ends, problem.sequence, problem.released, problem.keep, values=problem.values, energy=problem.energy
        )
        self.contact_modes.share_known(problem.contact_modes)  # the modes at the same parameters

    def _contacts(self, hit: Sequence[int]) -> list[int]:
        # The state before the impact at an end is the one that has conditions.
        return [*super()._contacts(hit)[:-2], -1, -1]

    def _closure(self) -> tuple[bool, int, int, int]:
        return False, self.structure.quarters, REST, REST

    def _end_rows(self) -> np.ndarray:
        # Those of a symmetric perturbation, with displacements and velocities exchanged. At a stop the one across the gap comes last.
        n = self.degrees_of_freedom
        rows = np.split(np.roll(super()._end_rows(), n, axis=1), 2)
        kinds = self.structure.kinds
        return np.vstack([np.roll(part, -1, axis=0) if kind == STOP else part for part, kind in zip(rows, kinds, strict=True)])


def free_condition(plane: ParameterPlane, code: str, symmetry: Symmetry = FOLD, in_energy: bool = False) -> SingularCondition:
    """The condition of a bifurcation of free orbits.

    Parameters
    ----------
    plane : ParameterPlane
        Its problem is a `ReleasedProblem`.
    code : {"SN", "SB", "PD"}
    symmetry : (bool, bool)
        Whether the critical perturbation is antisymmetric about the start, and about the far end. (False, False) for SN, and for orbits
        closed on themselves.
    in_energy : bool
        Of a fold: see `Fold`.

    Raises
    ------
    ValueError
        For a symmetry that the event cannot have.
    """
    problem = plane.problem
    assert isinstance(problem, ReleasedProblem)
    if code == "SN":
        return Fold(plane, in_energy).condition
    if problem.structure.periodic:
        if code != "PD":
            raise ValueError("an orbit without a reversal has no symmetry that can break")
        return _doubling(plane)
    if symmetry == FOLD:
        raise ValueError(f"a perturbation that is symmetric about both ends breaks no symmetry; expected another one for {code}")
    return Breaking(plane).condition(symmetry)


class Fold:
    """The critical matrix of a fold.

    Parameters
    ----------
    plane : ParameterPlane
    in_energy : bool
        At fixed parameters of the system. Else the surface of orbits has a fold over the plane: these are two folds where the plane, or an
        equation of the user, has the quarter period.
    """

    def __init__(self, plane: ParameterPlane, in_energy: bool = False):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self._plane, self.problem, self.size = plane, problem, plane.size
        self._energy: ReleasedProblem | None = None
        if in_energy and names_quarter_period(plane):
            self._energy = problem.sibling(problem.sequence, keep=(*problem.keep[:-1], "energy = 1"))
            self._energy.contact_modes.share_known(problem.contact_modes)
            self._rows = _parameter_rows(problem)

    def matrix(self, at: Linearised) -> np.ndarray:
        """The matrix, (u, u)."""
        if self._energy is None:
            return at.extra
        return np.vstack([at.jacobian[: self.size - len(self._rows) - 1], self._rows, self._energy.jacobian(at.y)[-1]])

    @property
    def condition(self) -> SingularCondition:
        """The condition that it is singular."""
        energy, none = self._energy, np.zeros((self.size, self.size))
        if energy is None:
            return RowsCondition(self._plane, whole_rows(self._plane, False), 1.0)

        def along(at: Linearised, parts: np.ndarray, own: np.ndarray) -> np.ndarray:
            found, count, direction = none.copy(), self.size - len(self._rows) - 1, parts[0]
            found[:count] = self.problem.curvature.second_along(at.y, direction)[:count]
            found[-1] = energy.curvature.second_along(at.y, direction)[-1]
            return found

        return SingularCondition(lambda at: (self.matrix(at), none), along, 1.0)


def names_quarter_period(plane: ParameterPlane) -> bool:
    """Whether the plane, or an equation that holds on it, has the quarter period."""
    return "quarter_period" in plane.names or any("quarter_period" in text for text in plane.problem.keep)


def _parameter_rows(problem: ReleasedProblem) -> np.ndarray:
    """The rows of perturbations at fixed parameters, (m, u)."""
    return np.eye(len(problem.released), problem.unknowns, problem.place)


def _doubling(plane: ParameterPlane) -> RowsCondition:
    """Of orbits closed on themselves: the state after the period is that before it with the other sign."""
    problem, size = plane.problem, plane.size
    assert isinstance(problem, ReleasedProblem)
    rows = whole_rows(plane, True)
    fixed_rows = np.vstack([_parameter_rows(problem), np.eye(1, size, problem.place - 1)])
    rows.source[size - len(fixed_rows) :, 0] = CONSTANT
    rows.constant[size - len(fixed_rows) :] = fixed_rows
    return RowsCondition(plane, rows, -1.0)


class Breaking:
    """The critical matrices of orbits between two ends, by the symmetry of the perturbation.

    Parameters
    ----------
    plane : ParameterPlane
    """

    def __init__(self, plane: ParameterPlane):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self.plane, self.problem = plane, problem
        turned = Turned(problem)
        self._rows = {symmetry: _breaking_rows(turned, symmetry) for symmetry in SYMMETRIES}
        self._turned = turned
        self._at: tuple[Linearised | None, np.ndarray] = None, np.zeros(0)

    def condition(self, symmetry: Symmetry) -> SingularCondition:
        """The condition that the matrix is singular."""
        return RowsCondition(self.plane, self._rows[symmetry], 1.0)

    def matrix(self, at: Linearised, symmetry: Symmetry) -> np.ndarray:
        """The matrix, (u, u)."""
        if self._at[0] is not at:
            self._at = at, self._turned.jacobian(at.y)
        return self._rows[symmetry].matrix(self.problem, at, self._at[1])


def _breaking_rows(turned: Turned, symmetry: Symmetry) -> MatrixRows:
    """The rows of the flights, of the end conditions, of times, and of the parameters: those of the problem of the family, of the one with
    turned ends, or constant."""
    n, width, size, k = turned.degrees_of_freedom, turned.size + 1, turned.unknowns, turned.inner
    first = k * width
    source, row, ends = [OWN] * first, list(range(first)), []
    constants = np.zeros((size, size))
    times = np.arange(k + 1) * width

    def constant(columns: np.ndarray | int) -> None:
        constants[len(row), columns] = 1.0
        source.append(CONSTANT)
        row.append(0)

    kinds = turned.structure.kinds
    moved = [symmetry[end] and kinds[end] == STOP for end in (0, 1)]
    for end in (0, 1):
        ends.append(len(row))
        source += [OTHER if symmetry[end] else OWN] * n
        row += range(first + end * n, first + (end + 1) * n)
        if moved[end]:
            source.append(OWN)
            row.append(first + end * n)  # c . du = 0
    if not any(moved):
        constant(times)
    if symmetry == BOTH and not all(moved):
        constant(times[0] if not moved[0] else times[-1])  # excludes a shift
    # The column of the first parameter, which does not change, is that of the freedom.
    for j in range(int(symmetry == BOTH), len(turned.released)):
        constant(turned.place + j)
    freed = _freed(turned, ends) if symmetry == BOTH else NONE_FREED
    return MatrixRows(np.array([source, row]).T.copy(), constants, False, turned, freed)


def _freed(problem: ReleasedProblem, ends: Sequence[int]) -> Freed:
    """Where the column of the first parameter changes the energy at an end, and which row excludes a shift of states. ends: where the rows
    of each end begin.

    This column and this row are multiplied by numbers that vanish where the matrix is singular, so that their derivatives do not matter."""
    n, kinds = problem.degrees_of_freedom, problem.structure.kinds
    # Velocities are not zero at an origin, nor displacements at rest.
    kept = [n if kind == ORIGIN else 0 for kind in kinds]
    if kinds[0] == kinds[1] == STOP:
        return Freed(problem.place, ((ends[0] + n - 1, -1), (ends[1] + n - 1, -1)), None)
    far = kinds[1] != STOP
    places = (None, (ends[1], kept[1])) if far else ((ends[0], kept[0]), None)
    shift = None
    if STOP not in kinds and problem.inner == 0:
        shift = 2 * n + 1, kept[0], n - kept[0]
    return Freed(problem.place, places, shift)


def smallest_singular(condition: SingularCondition, at: Linearised, scale: np.ndarray) -> tuple[float, float]:
    """The smallest singular value of a condition's matrix, and the next one, with columns in units of the unknowns and rows of length 1."""
    matrix, _ = condition.matrix(at, np.zeros(condition.own), scale)
    found = np.linalg.svd(with_rows_of_one(matrix), compute_uv=False)
    return float(found[-1]), float(found[-2])


def with_rows_of_one(matrix: np.ndarray) -> np.ndarray:
    """A matrix with rows of length 1; those of zeros stay."""
    lengths = np.linalg.norm(matrix, axis=1)
    found: np.ndarray = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return found
