"""Where `saltus continue` starts: a name, a family that begins at a linear mode, an orbit near a state, or an orbit of a file."""

from __future__ import annotations

import argparse
import os
import re
from typing import TYPE_CHECKING

from saltus import catalogues, compiling, options
from saltus.errors import BadInput, refusing

if TYPE_CHECKING:
    from branches.orbit import Orbit
    from saltus.scene import Scene

__all__ = ["name_or_orbit"]

_MODE = "mode:"

NO_STATE = (
    "--from simulate needs periodic loads or losses, without which no motion settles; expected --start U1,..,V1,.. with a state of "
    "zero speed, and with --in also --keep energy=H"
)


def name_or_orbit(arguments: argparse.Namespace, scene: Scene) -> str | Orbit:
    """The name of the command line, in full, or the orbit of its ``--from``.

    Raises
    ------
    BadInput
        Unless one of both is given; if the orbit belongs to another system than the scene.
    ValueError
        With one line, for what cannot be read or does not exist.
    """
    start = arguments.start
    if (start is None) == (arguments.name is None):
        received = "received neither" if start is None else f"received {arguments.name} and --from {start}"
        raise BadInput(f"{received}; expected NAME, such as S13O00+, or --from, such as --from mode:1")
    if start is None:
        return catalogues.named(arguments.name, arguments, scene)
    if arguments.catalogue is not None and not arguments.save:
        raise BadInput("--from looks nothing up in a catalogue; expected --save with --catalogue")
    energy = scene.bounds["energy"] if arguments.energy is None else arguments.energy
    if start.startswith(_MODE):
        from branches.naming.at_modes import orbit_at_mode

        return orbit_at_mode(start, scene.system, energy)
    if start == "simulate":
        from branches.naming.at_states import orbit_near

        if arguments.begin is None:
            raise BadInput(NO_STATE)
        return orbit_near(scene.system, *options.state_of("--start", arguments.begin, scene.system.coordinates))
    orbit = _orbit_of_file(start)
    if orbit.system.describe() != scene.system.describe():
        given = arguments.scene is not None or options.parameters_of(arguments)
        if given or arguments.save or arguments.energy is None:
            ways = "a scene with its system" if given else "--scene FILE with its system"
            energies = "" if given or arguments.save else ", or --energy LO:HI in place of the energies of the scene"
            raise BadInput(f"{start} has another system than the scene {arguments.scene or 'lee2009'}; expected {ways}{energies}")
    return orbit


def _orbit_of_file(text: str) -> Orbit:
    """The orbit that a file and the suffix behind it select: of a family, by default the orbit that it was started from."""
    from branches.naming.labels import Name, parse_suffix
    from branches.orbit import Orbit
    from branches.reading import read_start
    from saltus.families import select

    at = len(text) if os.path.exists(text) or "@" not in text else text.rindex("@")
    if not os.path.exists(text[:at]):
        named = re.fullmatch(r"(.+?):([A-Z]{2}[0-9]*)(?:,(\S+))?", text)
        if named and os.path.isfile(named[1]):
            return _orbit_at_event(named[1], named[2], named[3] or "")
        raise BadInput(f"no file {text[:at]!r}; expected mode:K, or a JSON file of saltus continue or saltus orbit")
    h, alpha = parse_suffix(text, at)
    found = read_start(text[:at])
    if isinstance(found, Orbit):
        if h is not None or alpha is not None:
            raise BadInput(f"{text[:at]} holds one orbit; expected no {text[at:]} behind it")
        return found
    if h is None and alpha is None:
        return found.orbit(found.start)
    return select(found, Name(family=text[:at], h=h, alpha=alpha), h, alpha)


def _orbit_at_event(source: str, event: str, family: str) -> Orbit:
    """An orbit of the family that begins at an event of the family of a file, next to the event."""
    from branches.naming.at_events import orbit_at_event
    from branches.orbit import Orbit
    from branches.reading import read_start

    found = read_start(source)
    if isinstance(found, Orbit):
        raise BadInput(f"{source} holds one orbit; expected no event behind it")
    compiling.prepare("continue")
    with refusing(f"{source}:{event}", (RuntimeError, ValueError)):
        return orbit_at_event(found, event, family)
