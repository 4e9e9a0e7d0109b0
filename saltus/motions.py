"""One damped motion of a scene with all that is told of it: shares, peaks, stages, and the same with the sink locked."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus.errors import one_line

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from bvp.motion import Motion
    from bvp.system import ImpactSystem
    from saltus.motion_start import Start
    from saltus.scene import Scene
    from transitions.extents import Extents
    from transitions.sharing import Sharing
    from transitions.stage import Stage
    from transitions.start_family import StartFamily
    from transitions.transition import Transition

__all__ = ["NOT_ASKED", "Told", "Watched", "default_duration", "run_locked", "run_scene", "tell_stages"]

MOST_SAMPLES = 400_000
"""Samples of the record that stages are told from, which bounds the work and the memory. A longer motion has a coarser record, where that
still shows what moves, and else stages as far as these go."""

NOT_ASKED = "expected --stages, --catalogue FILE or --plot FILE for them"
"""Why there are no stages where nobody asked for them."""

MOST_IN_A_HURRY = 500_000
"""Events of the longest motion whose peaks are computed after an interrupt, which takes about a second."""

FINEST = 64
"""How many times more samples than by default are tried where the record is too coarse."""


@dataclass(frozen=True, eq=False)
class Watched:
    """Displacements, gaps and drifts with their extents.

    Attributes
    ----------
    coordinates, gaps, drifts : dict of str to int
        Index of each in `extents`.
    """

    coordinates: dict[str, int]
    gaps: dict[str, int]
    drifts: dict[str, int]
    extents: Extents


@dataclass(frozen=True, eq=False)
class Told:
    """A motion and what is told of it.

    Attributes
    ----------
    sharing : Sharing
    watched : Watched or None
        None where an interrupt came before it was computed.
    reference : float
        The energy that shares are fractions of: the initial one; where there was none, what came in.
    shown : transitions.transition.Transition or None
        Its record and stages, where they can be told.
    why_no_stages : str
        Why they cannot, or not to the end.
    began : transitions.start_family.StartFamily or None
        The family that it starts on, and how long it keeps the impact sequence of that.
    """

    motion: Motion
    sharing: Sharing
    watched: Watched | None
    reference: float
    shown: Transition | None = None
    why_no_stages: str = ""
    began: StartFamily | None = None

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt came before all was computed but the stages."""
        return self.watched is None or self.motion.status.name == "INTERRUPTED"

    @property
    def stages(self) -> Sequence[Stage] | None:
        """Its stages, None where they cannot be told."""
        return None if self.shown is None else self.shown.stages

    @property
    def shares_of(self) -> str:
        """What shares are fractions of."""
        return "initial energy" if self.motion.initial_energy > 0.0 else "energy that came in"

    @property
    def shares(self) -> tuple[float, float]:
        """(NES, LO) dissipated over the whole motion."""
        nes, lo = self.sharing.totals(self.motion.dissipated)
        return (nes / self.reference, lo / self.reference) if self.reference > 0.0 else (0.0, 0.0)


def default_duration(scene: Scene) -> float | None:
    """The end of the longest record among the scene's loads, None where there is none."""
    from bvp.forcing import Record

    return max((float(force.times[-1]) for force in scene.forces if isinstance(force, Record)), default=None)


def run_scene(
    scene: Scene, start: Start, duration: float, max_impacts: int, on_progress: Callable[[float], object] | None = None
) -> Told:
    """Run a scene from a start; `on_progress` as of `bvp.run.run`.

    Raises
    ------
    ValueError
        Where the start lies beyond a stop.
    """
    from transitions.sharing import sharing_of

    shared = sharing_of(scene.system, scene.nes, scene.lo)
    told = _told(scene.system, shared, scene.forces, start.u, start.v, duration, max_impacts, start.leaving, scene.nes, on_progress)
    return replace(told, began=_began(start, told.motion))


def _began(start: Start, motion: Motion) -> StartFamily | None:
    """The family that a motion starts on, None where it starts on none."""
    from bvp.motion import EventKind
    from transitions.start_family import start_family

    if start.on is None or start.branch is None:
        return None
    rows = np.flatnonzero(motion.kinds == EventKind.IMPACT.value).tolist()
    letters = motion.system.modes.contact_letters
    impacts = [(float(motion.times[k]), letters[int(motion.contacts[k])]) for k in rows]
    end = motion.duration if motion.clear_from is None else None
    return start_family(start.branch.id, start.name, start.on, (start.u, start.v), impacts, end)


def run_locked(
    scene: Scene, start: Start, duration: float, max_impacts: int, on_progress: Callable[[float], object] | None = None
) -> Told:
    """The same with the NES locked, from the displacements and velocities of the other coordinates.

    Raises
    ------
    ValueError
        Where the NES cannot be locked, or the start lies beyond a stop that stays.
    """
    from transitions.locked import lock
    from transitions.sharing import sharing_of

    system, forces = lock(scene.system, scene.nes, scene.forces)
    kept = [k for k in range(scene.system.degrees_of_freedom) if k not in scene.nes]
    return _told(system, sharing_of(system), forces, start.u[kept], start.v[kept], duration, max_impacts, None, (), on_progress)


def _told(
    system: ImpactSystem,
    shared: Sharing,
    forces: Any,
    u: np.ndarray,
    v: np.ndarray,
    duration: float,
    max_impacts: int,
    leaving: str | None,
    nes: tuple[int, ...],
    on_progress: Callable[[float], object] | None,
) -> Told:
    from bvp.motion import MotionStatus
    from bvp.run import run

    watched = None
    try:
        motion = run(
            system, u, v, duration, max_impacts, leaving, forces=list(forces), dampers=shared.dampers, on_progress=on_progress
        )
    except KeyboardInterrupt as error:
        # What was computed before travels with the error.
        if not hasattr(error, "motion"):
            raise
        motion = replace(error.motion, status=MotionStatus.INTERRUPTED)
    if motion.status is not MotionStatus.INTERRUPTED or len(motion.times) <= MOST_IN_A_HURRY:
        with contextlib.suppress(KeyboardInterrupt):
            watched = _watched(motion, nes)
    came_in = math.fsum([*motion.dissipated.values(), motion.energy])
    return Told(motion, shared, watched, motion.initial_energy if motion.initial_energy > 0.0 else came_in)


def _watched(motion: Motion, nes: tuple[int, ...]) -> Watched:
    from transitions.drifts import drift_rows
    from transitions.extents import extents

    system = motion.system
    gap_rows = {f"gap {stop.name}": np.array(stop.gap) for stop in system.stops}
    drifts = drift_rows(system, nes)
    rows = np.array([*np.eye(system.degrees_of_freedom), *gap_rows.values(), *drifts.values()])
    n, m = system.degrees_of_freedom, len(gap_rows)
    return Watched(
        {name: k for k, name in enumerate(system.coordinates)},
        {name: n + k for k, name in enumerate(gap_rows)},
        {name: n + m + k for k, name in enumerate(drifts)},
        extents(motion, rows),
    )


def tell_stages(
    told: Told, scene: Scene, start: Start, catalogue: Catalogue | None, on_progress: Callable[[float], object] | None = None
) -> Told:
    """The same with its record and stages, where they can be told; `on_progress` as of `transitions.stages.stages_of`.

    The families are those of the catalogue; else the one that the motion starts on, where it starts on one; and the linear modes."""
    from transitions.families import families_of, modes_of, relative
    from transitions.sampled import sampled, samples_of
    from transitions.spectrum import TooCoarse
    from transitions.stages import stages_of
    from transitions.transition import Transition

    gap = relative(scene.system)
    if catalogue is not None:
        families = families_of(catalogue, gap)
    elif start.branch is not None:
        families = families_of([start.branch], gap)
    else:
        families = modes_of(scene.underlying.system)
    span = told.motion.duration
    wanted = samples_of(told.motion, span)
    samples = min(MOST_SAMPLES, wanted)
    finest = FINEST * wanted / span  # a unit of time
    while True:
        try:
            shown = Transition(scene.system, sampled(told.motion, told.sharing, samples, span), gap, start=told.began)
            stages = stages_of(shown.record, gap, families, start=told.began, on_progress=on_progress)
        except TooCoarse as error:
            # Twice as fine: with more samples, or, where these are as many as there can be, over half of the time.
            if 2.0 * samples / span > finest:
                return replace(told, why_no_stages=one_line(error))
            if samples < MOST_SAMPLES:
                samples = min(MOST_SAMPLES, 2 * samples)
            else:
                span *= 0.5
        except ValueError as error:
            return replace(told, why_no_stages=one_line(error))
        else:
            note = "" if span == told.motion.duration else f"told up to time {span:.6g}, of which the record has {samples} samples"
            return replace(told, shown=shown.with_stages(stages), why_no_stages=note)
