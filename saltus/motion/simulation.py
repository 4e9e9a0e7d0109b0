"""One damped motion of a scene: its start, its simulation, and what is computed from it: energy shares, peaks, stages, empirical modes.

The motion starts on an orbit of the undamped system, with an impulsive velocity, in a given state, or at rest.
"""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus import catalogues
from saltus.errors import BadInput, one_line
from saltus.families import agreed, called, family_named, impulsive_place, select, start_of
from saltus.options import finite, finite_list, positive, state_of

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from bvp.forcing import Force
    from bvp.motion import Motion
    from bvp.system import ImpactSystem
    from saltus.options import Units
    from saltus.scene import Scene
    from transitions.families import Families
    from transitions.frequencies import IntrinsicModes
    from transitions.sharing import Sharing
    from transitions.stage import Stage, StartFamily
    from transitions.transition import Transition

__all__ = [
    "ImpactTable", "MotionReport", "NOT_ASKED", "Start", "add_arguments", "impact_table", "modes_of_motion", "run_locked", "run_scene",
    "start_of_motion", "with_stages",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Start:
    """The state at time 0."""

    kind: str  # orbit, impulsive, state, impulse or rest
    u: np.ndarray  # (n,)
    v: np.ndarray  # (n,)
    leaving: str | None = None  # the contact that the state has just left, where it is on a stop
    on: Orbit | None = None  # the orbit that it is on
    branch: Branch | None = None  # its family
    name: str = ""  # name of the family: the name given by the user if it is a complete label; "": use its id

    @property
    def text(self) -> str:
        """What it is, in words."""
        where = ""
        if self.on is not None and self.branch is not None:
            counted = f" (counted {self.on.label})" if self.on.label not in ("", self.name) else ""
            where = f"{self.name or self.branch.id}{counted} at h = {self.on.h:.10g}, alpha = {self.on.alpha:.10g}"
        return {
            "orbit": f"on {where}",
            "impulsive": "impulsive: the oscillator's velocity alone" + (f", on {where}" if where else ""),
            "state": "the state that was given",
            "impulse": "the oscillator's velocity alone",
            "rest": "at rest",
        }[self.kind]

    def record(self) -> dict[str, Any]:
        """As JSON has it, without the state."""
        on = None
        if self.on is not None and self.branch is not None:
            on = {"name": self.name, "label": self.on.label, "family": self.branch.id, "h": self.on.h, "alpha": self.on.alpha}
        return {"kind": self.kind, "on": on}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the motion starts."""
    parser.add_argument("--on", metavar="NAME", help="start on the orbit of this family of the undamped elastic system, at --energy")
    parser.add_argument("--energy", metavar="H", type=positive, help="energy h of the orbit, or of the impulsive start")
    parser.add_argument(
        "--impulsive",
        action="store_true",
        help="start with the oscillator's velocity alone, at --energy; with --on at the energy of the family's impulsive orbit",
    )
    parser.add_argument("--impulse", metavar="V", type=finite, help="start at rest, except for this velocity of the oscillator")
    parser.add_argument("--state", metavar="U1,..,V1,..", type=finite_list, help="start with these displacements, then velocities")


def start_of_motion(arguments: argparse.Namespace, scene: Scene) -> Start:
    """The start given by the options; BadInput for options that do not go together or that the scene cannot satisfy."""
    alone = True if arguments.impulsive and arguments.on is None else None
    options = {"--on": arguments.on, "--state": arguments.state, "--impulse": arguments.impulse, "--impulsive": alone}
    given = [option for option, value in options.items() if value is not None]
    if len(given) > 1:
        raise BadInput(f"{' and '.join(given)} each say where the motion starts: expected one of them")
    if arguments.energy is not None and given not in (["--on"], ["--impulsive"]):
        raise BadInput(f"--energy {arguments.energy:g} is the energy of --on NAME or --impulsive; expected one of these")
    zero = np.zeros(scene.system.degrees_of_freedom)
    if arguments.state is not None:
        u, v = state_of("--state", arguments.state, scene.system.coordinates)
        return Start("state", np.array(u), np.array(v))
    if arguments.impulse is not None:
        return Start("impulse", zero, arguments.impulse * _oscillator_velocity(scene))
    if arguments.on is not None:
        return _on_a_family(arguments, scene.underlying)
    if arguments.impulsive:
        if arguments.energy is None:
            raise BadInput("which impulsive start? expected --energy H")
        return Start("impulsive", zero, _impulsive(scene, arguments.energy))
    if scene.forces:
        return Start("rest", zero, zero.copy())
    raise BadInput("where does the motion start? expected --on NAME --energy H, --impulsive --energy H, --impulse V or --state U1,..,V1,..")


def _oscillator_velocity(scene: Scene) -> np.ndarray:
    """Unit velocity of every LO coordinate."""
    if not scene.lo:
        raise BadInput("the scene does not say which coordinate is the oscillator's; expected LO under [coordinates], or --state")
    return np.eye(scene.system.degrees_of_freedom)[list(scene.lo)].sum(axis=0)


def _impulsive(scene: Scene, energy: float) -> np.ndarray:
    """The velocity of the LO alone that has an energy."""
    velocity = _oscillator_velocity(scene)
    return velocity * math.sqrt(2.0 * energy / float(velocity @ scene.system.mass @ velocity))


def _on_a_family(arguments: argparse.Namespace, scene: Scene) -> Start:
    """A start on an orbit of a family of the undamped elastic system."""
    from branches.naming.labels import parse_name
    from branches.naming.search import label_without_stops

    text = catalogues.named(arguments.on, arguments, scene)
    name = parse_name(text) if scene.system.stops else label_without_stops(parse_name(text))
    energy = agreed(arguments.on, "h", name.h, "--energy", arguments.energy)
    if energy is None and name.alpha is None and not arguments.impulsive:
        raise BadInput(f"an orbit of {name} needs --energy H, or {arguments.on}@alpha=A")
    branch = family_named(text, scene, energy, arguments)
    if arguments.impulsive:
        h, alpha = impulsive_place(branch, name, energy, name.alpha)
        on = min(branch.orbits_at(energy=h), key=lambda orbit: abs(orbit.alpha - alpha), default=None)
        rest = np.zeros(scene.system.degrees_of_freedom)
        return Start("impulsive", rest, _impulsive(scene, h), None, on, branch, "" if on is None else called(name, on))
    orbit = select(branch, name, energy, name.alpha)
    return Start("orbit", *start_of(orbit), orbit, branch, called(name, orbit))


ImpactTable = dict[str, np.ndarray]

MOST_SAMPLES = 400_000
"""Most samples of the record from which stages are computed. A longer motion has a coarser record where that still shows what moves, and
else stages up to an earlier time."""

NOT_ASKED = "expected --stages, --catalogue FILE or --plot FILE for them"
"""Note for a report without stages because the user did not ask for them."""

MOST_IN_A_HURRY = 500_000
"""Events of the longest motion whose peaks are computed after an interrupt, which takes about a second."""

FINEST = 64
"""How many times more samples than by default are tried where the record is too coarse."""


@dataclass(frozen=True, eq=False)
class MotionReport:
    """A motion and the results computed from it."""

    motion: Motion
    sharing: Sharing
    # Peak, its time and root mean square of each of the displacements, gaps and drifts; None if an interrupt came before.
    peaks: dict[str, dict[str, tuple[float, float, float]]] | None
    reference: float  # the energy that shares are fractions of: the initial one; where there was none, what came in
    shown: Transition | None = None  # its record and stages, where they can be computed
    why_no_stages: str = ""  # why they cannot, or not to the end
    began: StartFamily | None = None  # the family that it starts on, and how long it keeps the impact sequence of that family

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt came before all was computed but the stages."""
        return self.peaks is None or self.motion.status.name == "INTERRUPTED"

    @property
    def stages(self) -> Sequence[Stage] | None:
        """Its stages, None where they cannot be computed."""
        return None if self.shown is None else self.shown.stages

    @property
    def shares_of(self) -> str:
        """What shares are fractions of."""
        return "initial energy" if self.motion.initial_energy > 0.0 else "energy that came in"

    @property
    def shares(self) -> tuple[float, float]:
        """(NES, LO) dissipated over the full motion."""
        nes, lo = self.sharing.totals(self.motion.dissipated)
        return (nes / self.reference, lo / self.reference) if self.reference > 0.0 else (0.0, 0.0)


def run_scene(
    scene: Scene, start: Start, duration: float, max_impacts: int, on_progress: Callable[[float], object] | None = None
) -> MotionReport:
    """Simulate a scene from a start; a ValueError if that lies beyond a stop. `on_progress` receives the time reached, as in
    `bvp.simulate.simulate`."""
    from transitions.sharing import sharing_of

    sharing, state = sharing_of(scene.system, scene.nes, scene.lo), (start.u, start.v)
    report = _simulate(scene.system, scene.forces, state, start.leaving, sharing, scene.nes, duration, max_impacts, on_progress)
    if start.on is None or start.branch is None:
        return report
    from saltus.options import Units
    from transitions.stage import start_family

    motion, impacts = report.motion, impact_table(report.motion, Units())
    end = motion.duration if motion.clear_from is None else None
    times_and_stops = list(zip(impacts["time"].tolist(), impacts["stop"].tolist(), strict=True))
    return replace(report, began=start_family(start.branch.id, start.name, start.on, (start.u, start.v), times_and_stops, end))


def impact_table(motion: Motion, units: Units) -> ImpactTable:
    """The impacts of a motion, a column each of their entries."""
    from bvp.motion import EventKind

    modes = motion.system.modes
    rows = np.flatnonzero(motion.kinds == EventKind.IMPACT.value)
    contacts = motion.contacts[rows]
    speeds = motion.speeds[rows] * units.speed
    return {
        "time": motion.times[rows] * units.time,
        "stop": np.array(modes.contact_letters, dtype=str)[contacts],
        "speed": speeds,
        "speed_after": np.asarray(modes.contacts.restitution, dtype=float)[contacts] * speeds,
        "energy_lost": motion.losses[rows] * units.energy,
    }


def run_locked(
    scene: Scene, start: Start, duration: float, max_impacts: int, on_progress: Callable[[float], object] | None = None
) -> MotionReport:
    """The same with the NES locked, from the displacements and velocities of the other coordinates. A ValueError if the NES cannot be
    locked, or the start lies beyond a stop that stays."""
    from transitions.sharing import lock, sharing_of

    system, forces = lock(scene.system, scene.nes, scene.forces)
    kept = [k for k in range(scene.system.degrees_of_freedom) if k not in scene.nes]
    state = start.u[kept], start.v[kept]
    return _simulate(system, forces, state, None, sharing_of(system), (), duration, max_impacts, on_progress)


def _simulate(
    system: ImpactSystem,
    forces: Sequence[Force],
    state: tuple[np.ndarray, np.ndarray],
    leaving: str | None,
    sharing: Sharing,
    nes: tuple[int, ...],
    duration: float,
    max_impacts: int,
    on_progress: Callable[[float], object] | None,
) -> MotionReport:
    """Simulate the motion and compute its peaks, also for the part before an interrupt. For `on_progress` each of these is a half."""
    from bvp.motion import MotionStatus
    from bvp.simulate import simulate
    from transitions.record import drift_rows, extents

    u, v = state
    show = on_progress or (lambda time: None)
    try:
        motion = simulate(
            system, u, v, duration, max_impacts, leaving, forces=list(forces), dampers=sharing.dampers,
            on_progress=lambda time: show(0.5 * time),
        )  # fmt: skip
    except KeyboardInterrupt as error:
        # The error carries the part of the motion that was computed before the interrupt.
        if not hasattr(error, "motion"):
            raise
        motion = replace(error.motion, status=MotionStatus.INTERRUPTED)
    peaks: dict[str, dict[str, tuple[float, float, float]]] | None = None
    if motion.status is MotionStatus.UNRESOLVED:
        peaks = {"displacements": {}, "gaps": {}, "drifts": {}}  # those of a motion that runs away have no meaning
    elif motion.status is not MotionStatus.INTERRUPTED or len(motion.times) <= MOST_IN_A_HURRY:
        rows = {
            "displacements": dict(zip(system.coordinates, np.eye(system.degrees_of_freedom), strict=True)),
            "gaps": {f"gap {stop.name}": np.array(stop.gap) for stop in system.stops},
            "drifts": drift_rows(system, nes),
        }
        with contextlib.suppress(KeyboardInterrupt):
            wanted = [row for group in rows.values() for row in group.values()]
            found = extents(motion, wanted, lambda part: show(0.5 * duration * (1.0 + part)))
            each = zip(found.peaks.tolist(), found.times.tolist(), found.rms.tolist(), strict=True)
            peaks = {group: {name: next(each) for name in names} for group, names in rows.items()}
    # A motion from rest has no initial energy: its percentages refer to the energy that the loads supplied.
    supplied = math.fsum([*motion.dissipated.values(), motion.energy])
    return MotionReport(motion, sharing, peaks, motion.initial_energy if motion.initial_energy > 0.0 else supplied)


def with_stages(
    report: MotionReport, scene: Scene, start: Start, catalogue: Catalogue | None, on_progress: Callable[[float], object] | None = None
) -> MotionReport:
    """Add the record and the stages to a report, if they can be computed; `transitions.stages.stages_of` describes `on_progress`.

    The stages use the linear modes, if all springs are linear, and the families of the catalogue. Without a catalogue they use the family
    that the motion starts on, if any."""
    from transitions.families import families_of, modes_of, relative
    from transitions.record import sampled, samples_of
    from transitions.spectrum import TooCoarse
    from transitions.stages import stages_of
    from transitions.transition import Transition

    gap, notes = relative(scene.system), list[str]()
    families: Families | None = None
    if catalogue is not None:
        families = families_of(catalogue, gap)
    elif start.branch is not None:
        families = families_of([start.branch], gap)
    elif scene.system.why_not_linear() is None:
        families = modes_of(scene.underlying.system)
    else:
        notes.append("compared with no family: springs that are not linear leave no linear modes; expected --catalogue FILE or --on NAME")
    span = report.motion.duration
    wanted = samples_of(report.motion, span)
    samples = min(MOST_SAMPLES, wanted)
    finest = FINEST * wanted / span  # a unit of time
    while True:
        try:
            record = sampled(report.motion, report.sharing, samples, span)
            stages = tuple(stages_of(record, gap, families, start=report.began, on_progress=on_progress))
        except TooCoarse as error:
            # Twice as fine: with more samples, or, where these are as many as there can be, over half of the time.
            if 2.0 * samples / span > finest:
                return replace(report, why_no_stages=one_line(error))
            if samples < MOST_SAMPLES:
                samples = min(MOST_SAMPLES, 2 * samples)
            else:
                span *= 0.5
        except ValueError as error:
            return replace(report, why_no_stages=one_line(error))
        else:
            if span < report.motion.duration:
                notes.append(f"computed up to time {span:.6g}, of which the record has {samples} samples")
            shown = Transition(scene.system, record, gap, stages, start=report.began)
            return replace(report, shown=shown, why_no_stages="; ".join(notes))


def modes_of_motion(report: MotionReport) -> IntrinsicModes | None:
    """The empirical modes of the relative displacement over the record that the stages are computed from; None where there is no record."""
    from transitions.frequencies import decompose

    if report.shown is None:
        return None
    record = report.shown.record
    return decompose(record.times, record.along(report.shown.gap)[0])
