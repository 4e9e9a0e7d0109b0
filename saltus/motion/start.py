"""The start of a damped motion: an orbit of the undamped system, an impulsive velocity, a given state, or rest."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from saltus import catalogues
from saltus.errors import BadInput
from saltus.families import TOLERANCE, agreed, family_of, has_label, select, start_of
from saltus.options import ValueType, finite, positive

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.naming.labels import Name
    from branches.orbit import Orbit
    from saltus.scene import Scene

__all__ = ["Start", "add_arguments", "start_of_motion"]


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


state = ValueType(
    lambda text: tuple(float(part) for part in text.split(",")), lambda values: all(map(math.isfinite, values)), "finite numbers"
)


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
    parser.add_argument("--state", metavar="U1,..,V1,..", type=state, help="start with these displacements, then velocities")


def start_of_motion(arguments: argparse.Namespace, scene: Scene) -> Start:
    """The start given by the options; BadInput for options that do not go together or that the scene cannot satisfy."""
    alone = True if arguments.impulsive and arguments.on is None else None
    options = {"--on": arguments.on, "--state": arguments.state, "--impulse": arguments.impulse, "--impulsive": alone}
    given = [option for option, value in options.items() if value is not None]
    if len(given) > 1:
        raise BadInput(f"{' and '.join(given)} each say where the motion starts: expected one of them")
    if arguments.energy is not None and given not in (["--on"], ["--impulsive"]):
        raise BadInput(f"--energy {arguments.energy:g} is the energy of --on NAME or --impulsive; expected one of these")
    n = scene.system.degrees_of_freedom
    zero = np.zeros(n)
    if arguments.state is not None:
        if len(arguments.state) != 2 * n:
            names = scene.system.coordinates
            listed = ",".join([*names, *(f"{name}'" for name in names)])
            raise BadInput(f"--state has {len(arguments.state)} numbers, expected {2 * n}: {listed}")
        return Start("state", np.array(arguments.state[:n]), np.array(arguments.state[n:]))
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

    text = catalogues.named(arguments.on, arguments, scene)
    name = parse_name(text)
    energy = agreed(arguments.on, "h", name.h, "--energy", arguments.energy)
    if energy is None and name.alpha is None and not arguments.impulsive:
        raise BadInput(f"an orbit of {name} needs --energy H, or {arguments.on}@alpha=A")
    branch = family_of(text, scene, energy, arguments)
    if arguments.impulsive:
        h, alpha = _impulsive_orbit(branch, name, energy)
        on = min(branch.orbits_at(energy=h), key=lambda orbit: abs(orbit.alpha - alpha), default=None)
        rest = np.zeros(scene.system.degrees_of_freedom)
        return Start("impulsive", rest, _impulsive(scene, h), None, on, branch, "" if on is None else _called(name, on))
    orbit = select(branch, name, energy, name.alpha)
    return Start("orbit", *start_of(orbit), orbit, branch, _called(name, orbit))


def _called(name: Name, orbit: Orbit) -> str:
    """The name of the family of a start: the label that was asked for, or the label of the orbit where an incomplete label or an id was."""
    if name.label is None or (not name.label.is_complete and has_label(orbit, name)):
        return orbit.label
    return str(name.label)


def _impulsive_orbit(branch: Branch, name: Name, energy: float | None) -> tuple[float, float]:
    """Energy and quarter period of a family's impulsive orbit. If there are several, the given values select one.

    A family that folds back on itself passes through the same orbit twice. Both passes count as one orbit."""
    found = [event for event in branch.events if event.type == "IO"]
    found = [
        event
        for k, event in enumerate(found)
        if not any(abs(event.h / other.h - 1.0) < 1e-9 and abs(event.alpha / other.alpha - 1.0) < 1e-9 for other in found[:k])
    ]
    listed = " ".join(f"@h={event.h:.10g},alpha={event.alpha:.10g}" for event in found)
    near = [
        event
        for event in found
        if all(wish is None or abs(value / wish - 1.0) <= TOLERANCE for value, wish in ((event.h, energy), (event.alpha, name.alpha)))
    ]
    if len(near) != 1:
        which = "no impulsive orbit" if not found else f"{len(near)} impulsive orbits"
        asked = "" if energy is None and name.alpha is None else " with these values"
        raise BadInput(f"{name} has {which}{asked}{f', expected one of {listed}' if found else ''}")
    return near[0].h, near[0].alpha
