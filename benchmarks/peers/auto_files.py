"""The text files of AUTO-07p: writing its constants and the first orbit, and reading its table and points."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bvp.closures import contact_of
from bvp.forced import ForcedProblem
from bvp.forcing import Harmonic
from bvp.multipoint import MultipointProblem

__all__ = ["EQUATIONS", "AutoError", "AutoPoint", "AutoRun", "AutoSettings", "constants_text", "last_lines", "read_run", "start_text"]

EQUATIONS = {MultipointProblem: "flights", ForcedProblem: "forced_flights"}
"""Name of the equations of each kind of problem, and so of all its files."""

_TYPES = {1: "BP", 5: "LP", 6: "BP", 9: "EP", -4: "UZ", 4: "UZ", -9: "MX"}
_FAILED = "MX"
_ENDS = {"stop+": 0, "stop-": 0, "origin": 1, "rest": 2}
_DIGITS = 2e-10  # relative error of a number in AUTO's table


class AutoError(RuntimeError):
    """AUTO failed; the message quotes its last lines."""


@dataclass(frozen=True)
class AutoSettings:
    """How AUTO discretises and follows."""

    intervals: int = 4  # NTST, 1 or more
    collocation: int = 7  # NCOL, 2 to 7
    tolerance: float = 1e-12  # EPSL and EPSU, of Newton's method, relative
    special_tolerance: float = 1e-12  # EPSS, relative, of located points
    step: float = 0.02  # DS, pseudo-arclength between points in AUTO's own norm; its sign is that of the first change of the energy
    points: int = 100  # NMX
    folds: bool = False  # whether folds are located
    adapt: int = 0  # IAD: number of points after which the mesh is adapted; 0 for never


@dataclass(frozen=True, eq=False)
class AutoPoint:
    """An orbit that AUTO found."""

    type: str  # "" for an ordinary point, LP for a fold, BP, UZ, EP
    h: float  # of a forced orbit w
    flight_times: np.ndarray  # (k + 1,)
    nodes: np.ndarray  # (k + 1, 2 n) u and u' where each flight begins; of a forced orbit (k + 1, 2 n + 1), the time is the last

    @property
    def velocities(self) -> np.ndarray:
        """Velocities (2,) at the origin."""
        return self.nodes[0, 2:]

    def quarter_period(self, problem: MultipointProblem) -> float:
        """alpha."""
        return float(np.sum(self.flight_times)) / problem.quarters

    def unknowns(self, problem: MultipointProblem | ForcedProblem) -> np.ndarray:
        """The orbit as unknowns of the multipoint problem."""
        if isinstance(problem, ForcedProblem):
            period = 2.0 * math.pi * problem.load_periods / self.h
            return problem.pack(self.nodes[:, :-1], self.nodes[:, -1] / period, [self.h])
        states = self.nodes @ problem.modes.from_state.T
        return problem.pack(states[0], states[1:], self.flight_times)


@dataclass(frozen=True, eq=False)
class AutoRun:
    """Result of a run of AUTO."""

    seconds: float  # AUTO's "Total Time": reading, following and writing, without compiling and starting
    count: int  # number of points, including the first one
    points: list[AutoPoint]  # empty if AUTO kept none
    processor: float = math.nan  # seconds of the whole call, with compiling and starting; NaN if unknown

    @property
    def folds(self) -> list[AutoPoint]:
        """The located folds."""
        return [point for point in self.points if point.type == "LP"]


def start_text(problem: MultipointProblem | ForcedProblem, y: np.ndarray, keep: bool) -> str:
    """The file with the parameters and the first orbit y that the equations read. keep: whether points are kept."""
    rows = _forced_start(problem, y, keep) if isinstance(problem, ForcedProblem) else _start(problem, y, keep)
    return "".join(" ".join(repr(x) for x in row) + "\n" for row in rows)


def _start(problem: MultipointProblem, y: np.ndarray, keep: bool) -> list[Sequence[float]]:
    """Rows of the file flights.start: h, mu, sigma, the end, whether points are kept; flight times; sides; states at the starts of the
    flights."""
    system = problem.system
    parameters = system.describe()
    if parameters.get("model") != "vibro_impact_nes":
        raise ValueError("the equations for AUTO are those of the linear oscillator with a vibro-impact sink; received another system")
    if problem.ends[0] != "origin" or problem.ends[1] not in _ENDS:
        raise ValueError(f"the equations for AUTO begin at an origin; received the ends {problem.ends[0]} {problem.ends[1]}")
    states = np.vstack([problem.start(y)[None], problem.nodes(y)]) @ system.modes.to_state.T
    last = 1.0 if problem.ends[1] == "stop+" else -1.0
    sides = [1.0 if letter == "+" else -1.0 for letter in problem.sequence] + [last]
    first = [problem.energy(y), float(parameters["mu"]), float(parameters["sigma"]), _ENDS[problem.ends[1]], int(keep)]
    return [[float(x) for x in row] for row in (first, problem.flight_times(y), sides, states.ravel())]


def _forced_start(problem: ForcedProblem, y: np.ndarray, keep: bool) -> list[Sequence[float]]:
    """Rows of the file forced_flights.start, as its equations list them."""
    at = problem.parameters(y)
    system, n = problem.parametric.system(at), problem.degrees_of_freedom
    forces = problem.parametric.forces(at)
    if problem.released != ("w",) or problem.half or not problem.sequence or len(forces) != 1 or not isinstance(forces[0], Harmonic):
        raise ValueError("the equations for AUTO are those of orbits with impacts over a full period, of one harmonic load, in w")
    inverse = np.linalg.inv(system.mass)
    nodes, period = problem.nodes(y), problem.period(y)
    rates = -inverse @ np.hstack([system.stiffness, system.damping])
    waves = [inverse @ force for force in (forces[0].cosine, forces[0].sine)]
    impacts = []
    for letter in [*problem.sequence[1:], problem.sequence[0]]:
        contact = contact_of(system, letter)
        stop = system.stops[int(system.modes.contact_stop[contact])]
        row = np.array(stop.gap)
        bound = stop.upper if system.modes.contacts.side[contact] > 0.0 else stop.lower
        impacts.append([*row, bound, *(inverse @ row / (row @ inverse @ row)), 1.0 + stop.restitution])
    states = np.column_stack([nodes[:, : 2 * n], nodes[:, 2 * n] * period])
    sizes: Sequence[float] = [n, problem.inner + 1, int(keep), problem.load_periods]
    rows = [[at["w"]], problem.flight_times(y), *rates, [*waves[0], *waves[1], forces[0].frequency / at["w"]], *impacts, states.ravel()]
    return [sizes, *[[float(x) for x in row] for row in rows]]


def constants_text(problem: MultipointProblem | ForcedProblem, settings: AutoSettings) -> str:
    """The file of AUTO's constants. The energy, or the frequency, and all flight times are free."""
    flights = problem.inner + 1
    size = 2 * problem.system.degrees_of_freedom + isinstance(problem, ForcedProblem)
    free = [1, *range(21, 21 + flights)]
    step = abs(settings.step)
    return f"""\
NDIM={size * flights}, IPS=4, IRS=0, ILP={int(settings.folds)}
ICP={free}
NTST={settings.intervals}, NCOL={settings.collocation}, IAD={settings.adapt}, ISP=0, ISW=1, IPLT=0, NBC={(size + 1) * flights}, NINT=0
NMX={settings.points}, NPR=0, MXBF=0, IID=0, ITMX=9, ITNW=7, NWTN=3, JAC=1
EPSL={settings.tolerance!r}, EPSU={settings.tolerance!r}, EPSS={settings.special_tolerance!r}
DS={settings.step!r}, DSMIN={step * 1e-3!r}, DSMAX={step!r}, IADS=0
NPAR={20 + 2 * flights}
"""


def read_run(output: str, table: str, points: str, flights: int) -> AutoRun:
    """Read the output and the files of a run.

    Parameters
    ----------
    output : str
        Its standard output, with the line "Total Time".
    table : str
        The file b.flights: for each point a line with its type and its numbers to eleven digits.
    points : str
        The file flights.points: every point that was computed, with all digits; "" if no points are wanted.
    flights : int
        Number of flights k + 1.

    Raises
    ------
    AutoError
        If the time is missing, AUTO did not converge, or a point of the table is not among the points.
    """
    found = re.search(r"Total Time\s+(\S+)", output)
    if found is None:
        raise AutoError(f"AUTO printed no time: {last_lines(output)}")
    columns, rows = _read_table(table)
    kinds = [_TYPES.get(int(row[2]), "") for row in rows]
    if not rows or _FAILED in kinds:
        raise AutoError(f"AUTO did not converge after {max(len(rows) - 1, 0)} points: {last_lines(output)}")
    if not points:
        return AutoRun(float(found[1]), len(rows), [])
    known = [(float(row[columns["PAR(1)"]]), float(row[columns["PAR(21)"]])) for row in rows]
    return AutoRun(float(found[1]), len(rows), _match(kinds, np.array(known), points, flights))


def _read_table(table: str) -> tuple[dict[str, int], list[list[str]]]:
    """Column numbers of the file b.flights by name, and its rows."""
    columns: dict[str, int] = {}
    rows = []
    for line in table.splitlines():
        words = line.replace("MAX U(", "MAX_U(").split()
        if words[:4] == ["0", "PT", "TY", "LAB"]:
            columns = {word: i for i, word in enumerate(words)}
        elif words and words[0] != "0":
            rows.append(words)
    if not {"PAR(1)", "PAR(21)"} <= set(columns):
        heading = ", ".join(columns) or "no heading"
        raise AutoError(f"AUTO's table lacks the energy PAR(1) or the first flight time PAR(21); it has {heading}")
    return columns, rows


def _match(kinds: Sequence[str], known: np.ndarray, points: str, flights: int) -> list[AutoPoint]:
    """Find the points of the table among all computed points, by the eleven digits of the energy and the first flight time.

    AUTO computes them in order, some of them twice and some on the way to a special point.
    """
    rows = np.array([line.split() for line in points.splitlines()], dtype=float)
    out = []
    at = 0
    for kind, values in zip(kinds, known, strict=True):
        away = np.max(np.abs(rows[at:, :2] / values - 1.0), axis=1)
        same = np.flatnonzero(away <= _DIGITS)
        if not len(same):
            raise AutoError(f"the point h = {values[0]:.10g} of AUTO's table is not among the points that it kept")
        at += int(same[0])
        row = rows[at]
        out.append(AutoPoint(kind, float(row[0]), row[1 : 1 + flights], row[1 + flights :].reshape(flights, -1)))
    return out


def last_lines(*texts: str) -> str:
    """The last two lines of the output."""
    lines = [line.strip() for text in texts for line in text.splitlines() if line.strip()]
    return " / ".join(lines[-2:]) or "no output"
