"""A stage of a motion, the family that the motion starts on, and the changes between stages: as data and in words."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from branches.orbit import Orbit
from bvp.texts import shown

__all__ = [
    "Change", "Companion", "Follows", "Leaving", "Stage", "StartFamily", "changes", "counted_label", "leaving", "stage_from_data",
    "stages_as_data", "start_family",
]  # fmt: skip

_SAME_STATE = 1e-6  # relative distance of two states of one orbit that is computed twice


def counted_label(called: str, label: str) -> str:
    """The label counted on an orbit of a family, if it differs from the name of the family; else "".

    Examples
    --------
    >>> counted_label("S95E22-", "S75E22-"), counted_label("S75E22-", "S75E22-")
    ('S75E22-', '')
    """
    return label if label != called else ""


@dataclass(frozen=True)
class Follows:
    """The family that a stage follows.

    Parameters
    ----------
    family, label : str
        Id, and the label of its orbit in the middle of the stage ("" outside the grammar of labels).
    harmonic : int
        The harmonic k 2 pi/T that the ridge is at.
    deviation : float
        Mean distance of the ridge from the harmonic, in octaves.
    share : float
        Share of the orbit's amplitude that the harmonic has, mean over the stage.
    impacts : int
        In a period of the orbit; 0 for a linear mode, or a family of smooth motion.
    harmonics : tuple of int
        Rising: this one, and the others with a fifth both of the orbit's amplitude and of the motion's.
    others : tuple of str
        Ids of the other families that fit as well (`transitions.following.best_of`). Spectrum and impacts do not distinguish them. This
        family is named because it has the fewest impacts in a period.
    name : str
        A name in place of the label. The family of the start has one name in all stages.
    """

    family: str
    label: str
    harmonic: int
    deviation: float
    share: float
    impacts: int
    harmonics: tuple[int, ...]
    others: tuple[str, ...]
    name: str = ""

    @property
    def called(self) -> str:
        """Its name in messages: the name given by the user, else its label, else its id."""
        return self.name or self.label or self.family

    @property
    def counted(self) -> str:
        """Its label, if that differs from its name; else ""."""
        return counted_label(self.called, self.label)

    @property
    def beside(self) -> str:
        """The other harmonics in words, such as " with harmonics 3, 5"."""
        rest = [str(k) for k in self.harmonics if k != self.harmonic]
        return f" with harmonic{'s' * (len(rest) > 1)} {', '.join(rest)}" if rest else ""


@dataclass(frozen=True)
class Companion:
    """Another ridge during at least half of a stage. Its mean frequency and amplitude are relative to the stage (0 if missing)."""

    ratio: float
    amplitude: float


@dataclass(frozen=True)
class Stage:
    """An interval in which one ridge of the spectrum is the largest.

    Parameters
    ----------
    start, end : float
        Times.
    periods : float
        Number of periods of the ridge.
    frequency : float
        Angular, geometric mean over the stage.
    frequencies, energies : (float, float)
        Lowest and highest in the stage; the energy is the total.
    share : float
        Share of the relative motion's amplitude that the ridge has, mean over the stage.
    dissipated_nes, dissipated_lo : float
        Energies dissipated in the stage.
    impacts : int
        Number of impacts in the stage.
    companions : tuple of Companion
        Strongest first.
    follows : Follows or None
        None if the ridge is at no harmonic with a fifth of an orbit's amplitude, or if no families were given.
    why : str
        Why it does not follow the family that the motion starts on; "" if it does, or if the motion starts on none.
    """

    start: float
    end: float
    periods: float
    frequency: float
    frequencies: tuple[float, float]
    energies: tuple[float, float]
    share: float
    dissipated_nes: float
    dissipated_lo: float
    impacts: int
    companions: tuple[Companion, ...]
    follows: Follows | None
    why: str = ""

    @property
    def text(self) -> str:
        """The family that it follows, in words."""
        why = f": {self.why}" if self.why else ""
        if self.follows is None:
            return f"follows no family{why}"
        follows = self.follows
        counted = f" (counted {follows.counted} here)" if follows.counted else ""
        which = f"harmonic {follows.harmonic} of {follows.called}{counted}{follows.beside}"
        count = len(follows.others)
        return which + (f" ({count} other{'s fit' if count > 1 else ' fits'} as well)" if count else "") + why


@dataclass(frozen=True)
class Change:
    """The beginning (kind "capture") or end ("escape") of following a family, which is described as in `Follows`."""

    time: float
    kind: str
    family: str
    label: str
    harmonic: int
    name: str = ""


def changes(stages: Sequence[Stage]) -> list[Change]:
    """The captures and escapes between stages, in order of time.

    Between two successive stages that follow the same harmonic of the same family there is neither.

    Parameters
    ----------
    stages : sequence of Stage
        As `saltus.stages_of` returns them; a TypeError for anything else.
    """
    if not isinstance(stages, Sequence) or not all(isinstance(stage, Stage) for stage in stages):
        raise TypeError(f"the stages are {shown(stages)}, expected a list of those that saltus.stages_of gives")
    followed = [None if stage.follows is None else (stage.follows.family, stage.follows.harmonic) for stage in stages]
    out: list[Change] = []
    for i, stage in enumerate(stages):
        follows = stage.follows
        if follows is None:
            continue
        what = (follows.family, follows.label, follows.harmonic, follows.name)
        if i == 0 or followed[i - 1] != followed[i]:
            out.append(Change(stage.start, "capture", *what))
        if i + 1 < len(stages) and followed[i + 1] != followed[i]:
            out.append(Change(stage.end, "escape", *what))
    return out


def stages_as_data(stages: Sequence[Stage]) -> list[dict[str, Any]]:
    """Stages as plain data for JSON; ``follows`` is null if a stage follows no family."""
    return json.loads(json.dumps([asdict(stage) for stage in stages]))


def stage_from_data(data: dict[str, Any]) -> Stage:
    """A stage from an item of `stages_as_data`; KeyError or TypeError for anything else."""
    follows = data["follows"]
    changed = {
        "companions": tuple(Companion(**item) for item in data["companions"]),
        "follows": follows and Follows(**{**follows, "harmonics": tuple(follows["harmonics"]), "others": tuple(follows["others"])}),
    }
    return Stage(**{**data, "frequencies": tuple(data["frequencies"]), "energies": tuple(data["energies"]), **changed})


class Leaving(NamedTuple):
    """The first impact of a motion that differs from its orbit: number (from 1), time, stop, and the stop of the orbit."""

    impact: int
    time: float
    stop: str
    expected: str


@dataclass(frozen=True)
class StartFamily:
    """The family that a motion starts on.

    Parameters
    ----------
    family, name, label : str
        Id; the name of the family ("" for its id); the computed label of the orbit at the start ("" outside the grammar of labels).
    end : float
        Time up to which the motion keeps the impact sequence of the orbit: the first impact at another stop, else the last impact, else
        the end of a motion with more impacts to come.
    impacts : int
        Number of impacts up to there.
    left : Leaving or None
        The first impact at another stop.
    """

    family: str
    name: str
    label: str
    end: float
    impacts: int
    left: Leaving | None = None

    @property
    def called(self) -> str:
        """Its name, or its id if it has none."""
        return self.name or self.family

    @property
    def explained(self) -> str:
        """The name, with the computed label if that differs.

        Examples
        --------
        >>> StartFamily("a:b:c", "S95E22-", "S75E22-", 9.0, 3).explained
        'S95E22- (counted S75E22- at the start)'
        """
        label = counted_label(self.called, self.label)
        return f"{self.called} (counted {label} at the start)" if label else self.called

    @property
    def kept(self) -> str:
        """The number of impacts that keep the impact sequence, in words."""
        return f"{self.impacts} impact{'s' * (self.impacts != 1)} in its impact sequence" if self.impacts else "no impact"


def start_family(
    family: str, name: str, orbit: Orbit, state: tuple[np.ndarray, np.ndarray], impacts: Sequence[tuple[float, str]], end: float | None
) -> StartFamily:
    """The family of a start, and how long the motion keeps the impact sequence of its orbit.

    `state` is the start of the motion, as for `_impacts_from`; `impacts` are times and stops of the motion's impacts. `end` is the end of
    the motion, None if no impact is possible after the last one.
    """
    left = leaving(_impacts_from(orbit, *state), impacts)
    if left is not None:
        return StartFamily(family, name, orbit.label, left.time, left.impact - 1, left)
    last = impacts[-1][0] if impacts else 0.0
    return StartFamily(family, name, orbit.label, last if end is None else end, len(impacts))


def _impacts_from(orbit: Orbit, u: np.ndarray, v: np.ndarray) -> list[tuple[float, str]]:
    """Times and stops of an orbit's impacts over one period, in order of time, from a state at one of its ends.

    The state is the orbit's at time 0 or half a period later, or the mirror image of one of these if the system has odd symmetry. Of a
    mirror image the impacts are those of the mirrored orbit. An impact at the state, to rounding, is the last one.
    """
    from branches.sequences import mirror

    wanted = np.concatenate([u, v])
    begins = (0.0, 0.5 * orbit.period)
    states = dict(zip(begins, np.hstack(orbit.sample(np.array(begins))), strict=True))
    candidates = list(itertools.product((1.0, -1.0) if orbit.system.has_odd_symmetry else (1.0,), begins))
    distances = np.array([np.linalg.norm(wanted - sign * states[begin]) for sign, begin in candidates])
    near = distances <= _SAME_STATE * np.linalg.norm(wanted)
    sign, begin = candidates[int(np.argmax(near) if near.any() else np.argmin(distances))]
    stops = tuple(impact.stop for impact in orbit.impacts)
    times = np.mod([impact.time - begin - _SAME_STATE * orbit.period for impact in orbit.impacts], orbit.period)
    return sorted(zip(times.tolist(), stops if sign > 0.0 else mirror(stops), strict=True))


def leaving(orbit: Sequence[tuple[float, str]], impacts: Sequence[tuple[float, str]]) -> Leaving | None:
    """The first impact of a motion at another stop than the orbit's; None if the motion keeps the sequence.

    Both lists contain times and stops from the start of the motion. The list of the orbit covers one period. An impact at time 0 counts
    as the last one of the period: the motion starts after it.

    Examples
    --------
    >>> leaving([(1.0, "+"), (3.0, "-")], [(1.0, "+"), (1.9, "+"), (2.5, "-")])
    Leaving(impact=2, time=1.9, stop='+', expected='-')
    >>> leaving([(0.0, "+"), (3.0, "-")], [(2.8, "-"), (5.0, "+"), (7.0, "-")])
    """
    cycle = [stop for time, stop in orbit if time > 0.0] + [stop for time, stop in orbit if time <= 0.0]
    for k, (time, stop) in enumerate(impacts):
        expected = cycle[k % len(cycle)] if cycle else "none"
        if stop != expected:
            return Leaving(k + 1, time, stop, expected)
    return None
