"""Command-line arguments: a parser with one-line errors, the types of values, and the options that several commands share."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

from saltus.errors import BadInput, nearest

if TYPE_CHECKING:
    from saltus.scene import Scene

__all__ = [
    "SHELLS",
    "OneLineParser",
    "Units",
    "add_filters",
    "add_parameters",
    "add_scene",
    "add_units",
    "completion_script",
    "energy_range",
    "filter_words",
    "filters_of",
    "given_filters",
    "joined_values",
    "nothing_fits",
    "number",
    "parameters_of",
    "positive",
    "scene_of",
    "units_of",
    "whole_above_zero",
]

SHELLS = ("bash", "zsh", "tcsh")
"""Shells that have completion."""

_LOOKS_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)

MOST = 10**15
"""Largest integer of an option: what counts beyond it has no end."""


class OneLineParser(argparse.ArgumentParser):
    """A parser that raises `BadInput` where argparse would print its usage and end the process."""

    def __init__(self, **options: Any) -> None:
        options.setdefault("allow_abbrev", False)
        super().__init__(**options)

    def error(self, message: str) -> NoReturn:
        """Raise what argparse found wrong."""
        message = message.replace("the following arguments are required: ", "missing: ").removeprefix("argument ")
        message = re.sub(r"ignored explicit argument (.*)", r"received \1, expected no value", message)
        message = re.sub(r"invalid choice: '(.*)' \(choose from (.*)\)", _one_of, message)
        raise BadInput(f"{message} (see {self.prog} --help)")

    def options(self) -> list[str]:
        """Return the options that the help shows."""
        return sorted(set(re.findall(r"--[a-z][a-z-]*", self.format_help())))

    def refuse(self, text: str, words: Sequence[str]) -> NoReturn:
        """Raise for a text, one of the words of the command line, that is no option and no argument of this parser."""
        option = text.partition("=")[0]
        if "--" in words and text.startswith("-") and text not in words[: words.index("--")]:
            after = "" if text == "--" else f" after --, where nothing is an option: expected {option} before --"
            raise BadInput(f"unexpected argument {text!r}{after} (see {self.prog} --help)")
        if not option.startswith("-"):
            raise BadInput(f"unexpected argument {text!r} (see {self.prog} --help)")
        raise BadInput(f"unknown option {option} of {self.prog}{nearest(option, self.options())}")


def _one_of(found: re.Match[str]) -> str:
    """The message of argparse about a text outside the choices, with the nearest choice added."""
    known = found[2].replace("'", "").split(", ")
    return f"received {found[1]!r}, expected one of {', '.join(known)}{nearest(found[1], known)}"


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for shell completion of a parser's commands and options, and of file names."""
    import shtab

    def complete_files(part: argparse.ArgumentParser) -> None:
        for action in part._actions:
            if isinstance(action, argparse._SubParsersAction):
                for inner in action.choices.values():
                    complete_files(inner)
            elif action.metavar == "FILE":
                action.complete = shtab.FILE  # type: ignore[attr-defined]

    complete_files(parser)
    return shtab.complete(parser, shell)


def joined_values(words: list[str]) -> list[str]:
    """Join an option with a value that looks like an option itself because it starts with a minus sign. Argparse would drop a value ``--``,
    so it is refused.

    Examples
    --------
    >>> joined_values(["continue", "S13+", "--energy", "-1:2", "--json", "-"])
    ['continue', 'S13+', '--energy=-1:2', '--json', '-']
    """
    joined: list[str] = []
    for text in words:
        if text.startswith("--") and text.endswith("=--") and "--" not in joined:
            raise BadInput(f"{text}: -- is not a value of an option")
        if joined and joined[-1].startswith("--") and "=" not in joined[-1] and _LOOKS_NEGATIVE.match(text):
            joined[-1] += "=" + text
        else:
            joined.append(text)
    return joined


def number(text: str) -> float:
    """Read a number; NaN is none.

    Examples
    --------
    >>> number("nan")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received 'nan', expected a number
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number")
    return value


def positive(text: str) -> float:
    """Read a finite number above 0."""
    value = number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number above 0")
    return value


def whole_above_zero(text: str) -> int:
    """Read an integer above 0.

    Examples
    --------
    >>> whole_above_zero("99999999999999999999")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '99999999999999999999', expected an integer above 0, up to 1e15
    """
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected an integer above 0")
    if value > MOST:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected an integer above 0, up to 1e15")
    return value


def energy_range(text: str) -> tuple[float, float]:
    """Read a range of energies, ``LO:HI`` with 0 < LO < HI, both finite.

    Examples
    --------
    >>> energy_range("0.1:10")
    (0.1, 10.0)
    >>> energy_range("10:0.1")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '10:0.1', a reversed range, expected LO:HI with 0 < LO < HI
    """
    expected = "expected LO:HI with 0 < LO < HI"
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"received {text!r}, {expected}") from None
    faults = {
        "NaN is not an energy": math.isnan(low) or math.isnan(high),
        "a reversed range": low > high,
        "an empty range": low == high,
        "an energy that is not above 0": low <= 0.0,
        "an energy that is not finite": math.isinf(high),
    }
    for fault, found in faults.items():
        if found:
            raise argparse.ArgumentTypeError(f"received {text!r}, {fault}, {expected}")
    return low, high


_PARAMETERS = {
    "mu": "mass ratio, above 0",
    "sigma": "coupling stiffness, 0 or more",
    "lam": "viscous damping of the oscillator, 0 or more",
    "rho": "restitution, 0 to 1",
}
_FILTERS = ("label", "energy", "stable", "ends", "impacts")


def add_scene(parser: argparse.ArgumentParser, uses: tuple[str, ...] = ()) -> None:
    """Add ``--scene``, the parameters of the model, and ``--model``. `uses` names the tables of `saltus.scene.LOADS` that are used."""
    parser.set_defaults(scene_uses=uses)
    parser.add_argument("--scene", metavar="FILE", help="TOML file of the system and its bounds (default: lee2009)")
    add_parameters(parser)
    parser.add_argument("--model", action="store_true", help="print which model was chosen, and why")


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add the parameters of the model."""
    for name, meaning in _PARAMETERS.items():
        parser.add_argument(f"--{name}", metavar="X", type=number, help=f"{meaning}, instead of the scene's")


def scene_of(arguments: argparse.Namespace) -> Scene:
    """The scene of the command line. A scene with loads is refused if the command does not use loads."""
    from saltus.scene import load_scene

    scene = load_scene(arguments.scene, **parameters_of(arguments))
    scene.require_used(f"saltus {arguments.command}", getattr(arguments, "scene_uses", ()))
    return scene


def parameters_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the parameters of the model that were given in place of the scene's."""
    return {name: getattr(arguments, name) for name in _PARAMETERS if getattr(arguments, name, None) is not None}


@dataclass(frozen=True)
class Units:
    """The natural units, expressed in the units of the results.

    Attributes
    ----------
    length : float
        The clearance.
    frequency : float
        The natural frequency of the oscillator alone, in rad/s; energies are those of an oscillator of unit mass.

    Examples
    --------
    >>> metres = Units(0.02, 10.0)
    >>> round(metres.time, 12), round(metres.speed, 12), round(metres.energy, 12)
    (0.1, 0.2, 0.04)
    """

    length: float = 1.0
    frequency: float = 1.0

    @property
    def time(self) -> float:
        """Unit of time."""
        return 1.0 / self.frequency

    @property
    def speed(self) -> float:
        """Unit of velocity."""
        return self.length * self.frequency

    @property
    def energy(self) -> float:
        """Unit of energy."""
        return self.speed**2


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add ``--clearance`` and ``--natural-frequency``."""
    parser.add_argument(
        "--clearance", metavar="D", type=positive, default=1.0, help="scale lengths by this clearance, and energies by its square"
    )
    parser.add_argument(
        "--natural-frequency", metavar="W", type=positive, default=1.0, help="print times for this frequency of the oscillator, in rad/s"
    )


def units_of(arguments: argparse.Namespace) -> Units:
    """The units asked for."""
    return Units(arguments.clearance, arguments.natural_frequency)


def add_filters(parser: argparse.ArgumentParser, *, shown: bool = False) -> None:
    """Add ``--label``, ``--energy``, ``--stable``, ``--ends`` and ``--impacts``. With `shown`, ``--energy`` can also be the range of
    energies that are shown."""
    parser.add_argument("--label", metavar="LABEL", help="families with this label: S13O00+, U83, or with a wildcard 'U8*'")
    if shown:
        meaning = "those that cross the energy H; or the energies shown, LO:HI (default: all that the families have)"
        parser.add_argument("--energy", metavar="H|LO:HI", type=_energy_or_range, help=meaning)
    else:
        parser.add_argument("--energy", metavar="H", type=positive, help="families that cross this energy")
    parser.add_argument("--stable", action="store_true", help="families that are stable somewhere (with --label and --energy: there)")
    parser.add_argument("--ends", metavar="ENDS", help="families between these ends: origin-origin, origin-stop, rest-stop+, periodic")
    parser.add_argument("--impacts", metavar="N|LO:HI", type=_impacts, help="families with this number of impacts in half a period")


def filters_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the filters asked for, as `Catalogue.families` takes them."""
    filters = {name: getattr(arguments, name) for name in _FILTERS}
    return {**filters, "energy": None if isinstance(arguments.energy, tuple) else arguments.energy}


def given_filters(filters: dict[str, Any]) -> dict[str, Any]:
    """Those of the filters that leave something out.

    Examples
    --------
    >>> given_filters({"label": "U8*", "energy": None, "stable": False})
    {'label': 'U8*'}
    """
    return {name: value for name, value in filters.items() if value not in (None, False)}


def filter_words(filters: dict[str, Any]) -> str:
    """The filters as options of the command line.

    Examples
    --------
    >>> filter_words({"label": "U8*", "energy": None, "stable": True, "impacts": (2.0, 3.5)})
    '--label U8* --stable --impacts 2:3.5'
    """
    parts = []
    for name, value in given_filters(filters).items():
        text = "" if value is True else " " + (":".join(f"{part:g}" for part in value) if isinstance(value, tuple) else f"{value}")
        parts.append(f"--{name}{text}")
    return " ".join(parts)


def nothing_fits(place: str, count: int, filters: dict[str, Any], names: Sequence[str] = ()) -> BadInput:
    """The error if none of the `count` families of a catalogue passes the filters.

    Examples
    --------
    >>> print(nothing_fits("lee2009.sqlite", 7, {"label": "U8*"}))
    no family of lee2009.sqlite fits --label U8*; saltus list shows those that there are
    """
    if not count:
        return BadInput(f"{place} has no family; expected one that saltus build or saltus continue --save has filled")
    given = " ".join(part for part in (*names, filter_words(filters)) if part)
    return BadInput(f"no family of {place} fits {given}; saltus list shows those that there are")


def _energy_or_range(text: str) -> float | tuple[float, float]:
    return energy_range(text) if ":" in text else positive(text)


def _impacts(text: str) -> tuple[float, float]:
    """Read a number or a range of impacts.

    Examples
    --------
    >>> _impacts("3"), _impacts("0:2.5")
    ((3.0, 3.0), (0.0, 2.5))
    >>> _impacts("5:1")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '5:1', expected a number of impacts N, or LO:HI with 0 <= LO <= HI
    """
    found = re.fullmatch(r"(\d+(?:\.5|\.0)?)(?::(\d+(?:\.5|\.0)?))?", text)
    low, high = (float(found[1]), float(found[2] or found[1])) if found else (1.0, 0.0)
    if low > high:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number of impacts N, or LO:HI with 0 <= LO <= HI")
    return low, high
