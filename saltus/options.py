"""Command-line arguments: a parser with one-line errors, the types of values, and the options that several commands share."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

from bvp.expressions import normalised
from saltus.errors import BadInput, nearest

if TYPE_CHECKING:
    from saltus.outputs import Outputs
    from saltus.scene import Scene

__all__ = [
    "SHELLS",
    "OneLineParser",
    "Units",
    "ValueType",
    "add_filters",
    "add_scene",
    "add_set",
    "add_shared",
    "assignment",
    "completion_script",
    "energy_range",
    "filters_of",
    "finite",
    "finite_list",
    "marks",
    "names",
    "nothing_fits",
    "number",
    "parameter_lines",
    "parameters_of",
    "periods",
    "positive",
    "report_model",
    "rest_lines",
    "scene_of",
    "state_of",
    "value_range",
    "value_ranges",
    "whole_above_zero",
]

SHELLS = ("bash", "zsh", "tcsh")
"""Shells that have completion."""

MOST = 10**15
"""Largest integer of an option: what counts beyond it has no end."""


class OneLineParser(argparse.ArgumentParser):
    """A parser that raises `BadInput` where argparse would print its usage and end the process."""

    def __init__(self, **options: Any) -> None:
        options.setdefault("allow_abbrev", False)
        super().__init__(**options)
        # Argparse takes a value such as -1:2 for an option unless it looks like a negative number.
        self._negative_number_matcher = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Raise what argparse found wrong, with the nearest of the choices."""
        choice = re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message)
        if choice is not None:
            known = re.findall(r"[^', ]+", choice[2])
            message = f"{message[: choice.start()]}received {choice[1]!r}, expected one of {', '.join(known)}{nearest(choice[1], known)}"
        raise BadInput(f"{message.removeprefix('argument ')} (see {self.prog} --help)")

    def refuse(self, text: str) -> NoReturn:
        """Raise for a text that is no option and no argument of this parser."""
        option = text.partition("=")[0]
        known = re.findall(r"--[a-z][a-z-]*", self.format_help())
        # After two hyphens nothing is an option.
        if not option.startswith("-") or option in known:
            self.error(f"unexpected argument {text!r}")
        raise BadInput(f"unknown option {option} of {self.prog}{nearest(option, known)}")


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


@dataclass(frozen=True)
class ValueType:
    """The type of an option's value: how it is read, whether it fits, and what a message says was expected.

    Examples
    --------
    >>> energy_range("0.1:10"), whole_above_zero("7")
    ((0.1, 10.0), 7)
    >>> energy_range("10:0.1")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '10:0.1', expected LO:HI with 0 < LO < HI
    """

    read: Callable[[str], Any]
    fits: Callable[[Any], bool]
    expected: str

    def __call__(self, text: str) -> Any:
        with suppress(ValueError):
            value = self.read(text)
            if self.fits(value):
                return value
        raise argparse.ArgumentTypeError(f"received {text!r}, expected {self.expected}")


number = ValueType(float, lambda value: not math.isnan(value), "a number")
finite = ValueType(float, math.isfinite, "a finite number")
positive = ValueType(float, lambda value: 0.0 < value < math.inf, "a number above 0")
whole_above_zero = ValueType(int, lambda value: 1 <= value <= MOST, "an integer above 0, up to 1e15")
processes = ValueType(int, lambda value: 1 <= value <= 1024, "an integer from 1 to 1024")
periods = ValueType(int, lambda value: 1 <= value <= 10**9, "an integer above 0, up to 1e9")
energy_range = ValueType(
    lambda text: tuple(float(part) for part in text.split(":")),
    lambda ends: len(ends) == 2 and 0.0 < ends[0] < ends[1] < math.inf,
    "LO:HI with 0 < LO < HI",
)
value_range = ValueType(
    lambda text: tuple(float(part) for part in text.split(":")),
    lambda ends: len(ends) == 2 and ends[0] < ends[1] and all(map(math.isfinite, ends)),
    "LO:HI with LO < HI",
)
value_ranges = ValueType(
    lambda text: tuple(map(value_range, text.split(","))), lambda ranges: len(ranges) == 2, "LO:HI,LO:HI, two ranges with LO < HI"
)
finite_list = ValueType(
    lambda text: tuple(float(part) for part in text.split(",")), lambda values: all(map(math.isfinite, values)), "finite numbers"
)
marks = ValueType(
    lambda text: (normalised(text.rpartition("=")[0]).strip() or None, tuple(float(part) for part in text.rpartition("=")[2].split(","))),
    lambda pair: all(map(math.isfinite, pair[1])),
    "values X1,X2,.. of the parameter, or COLUMN=X1,X2,..",
)
names = ValueType(
    lambda text: tuple(part.strip() for part in normalised(text).split(",")), lambda found: all(found),
    "names of parameters, NAME1,NAME2,..",
)
_impacts = ValueType(
    lambda text: tuple(float(part) for part in (text.split(":") * 2)[: max(2, text.count(":") + 1)]),
    lambda ends: len(ends) == 2 and 0.0 <= ends[0] <= ends[1] < math.inf,
    "a number of impacts N, or LO:HI with 0 <= LO <= HI",
)

assignment = ValueType(
    lambda text: (normalised(text.partition("=")[0]), float(text.partition("=")[2])),
    lambda pair: pair[0] != "" and math.isfinite(pair[1]),
    "NAME=VALUE, a name and a finite number",
)

_PARAMETERS = {
    "mu": "mass ratio, above 0",
    "sigma": "coupling stiffness, 0 or more",
    "lam": "viscous damping of the oscillator, 0 or more",
    "rho": "restitution, 0 to 1",
    "n": "of smooth_wall, whose walls have the force w^(2 n + 1)",
}
_FILTERS = ("label", "energy", "stable", "ends", "impacts")

_SHARED: dict[str, dict[str, Any]] = {
    "max-quarter-period": {"metavar": "A", "type": positive, "help": "longest quarter period alpha (default: the scene's)"},
    "max-impacts": {"metavar": "K", "type": whole_above_zero, "help": "most impacts in half a period (default: any number)"},
    "workers": {"metavar": "N", "type": processes, "help": "number of processes (default: one for each core)"},
    "dask": {"metavar": "ADDRESS", "help": "use a Dask cluster instead of processes"},
    "frequency": {
        "metavar": "AXIS",
        "choices": ("index", "fundamental"),
        "default": "index",
        "help": "axis of the figure: index (default) is m 2 pi/T, where m is the number of half-waves of the NES; fundamental is 2 pi/T",
    },
    "clearance": {"metavar": "D", "type": positive, "default": 1.0, "help": "scale lengths by this clearance, and energies by its square"},
    "natural-frequency": {
        "metavar": "W",
        "type": positive,
        "default": 1.0,
        "help": "scale times and frequencies for this frequency of the oscillator alone, in rad/s",
    },
}
"""Options of several commands."""


def add_shared(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options that several commands have."""
    for name in names:
        parser.add_argument(f"--{name}", **_SHARED[name])


def add_scene(parser: argparse.ArgumentParser, uses: tuple[str, ...] = (), *, model: bool = True) -> None:
    """Add ``--scene``, the parameters of the model, and, with `model`, ``--model``. `uses` names the tables of `saltus.scene.LOADS` that
    are used."""
    parser.set_defaults(scene_uses=uses)
    parser.add_argument("--scene", metavar="FILE", help="TOML file of the system and its bounds (default: lee2009)")
    for name, meaning in _PARAMETERS.items():
        parser.add_argument(f"--{name}", metavar="X", type=number, help=f"{meaning}, instead of the scene's")
    add_set(parser)
    if model:
        parser.add_argument("--model", action="store_true", help="print which model was chosen, and why")


def add_set(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``, which can be repeated."""
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", type=assignment, help="value of a parameter, instead of the scene's; repeatable"
    )


def scene_of(arguments: argparse.Namespace) -> Scene:
    """The scene of the command line. A scene with loads is refused if the command does not use loads, unless they are constant and the
    system is conservative: then they are part of its energy."""
    from saltus.scene import load_scene

    scene = load_scene(arguments.scene, **parameters_of(arguments))
    if "forces" not in arguments.scene_uses:
        scene = scene.about_rest
    scene.require_used(f"saltus {arguments.command}", arguments.scene_uses)
    return scene


def report_model(arguments: argparse.Namespace, files: Outputs, explain: str, *of: Any) -> None:
    """Say which model was chosen, and why, by a function of `saltus.scene.model`, if ``--model`` asks for it."""
    if arguments.model:
        from saltus.scene import model

        files.report(f"model  {line}" for line in getattr(model, explain)(*of))


def rest_lines(scene: Scene) -> list[str]:
    """The line that says from where displacements and energies count, if it is not the origin of the scene's coordinates."""
    if scene.rest is None or not scene.rest.place.any():
        return []
    place = ", ".join(f"{name} = {value:.10g}" for name, value in zip(scene.system.coordinates, scene.rest.place.tolist(), strict=True))
    return [f"rest   {place}: displacements count from there, and energies from the potential there, {scene.rest.energy:.10g}"]


def parameters_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the parameters that were given in place of the scene's."""
    found = {name: getattr(arguments, name) for name in _PARAMETERS if getattr(arguments, name, None) is not None}
    for name, value in getattr(arguments, "set", None) or ():
        if name in found:
            raise BadInput(f"{name} is given twice, {found[name]:g} and {value:g}; expected one value")
        found[name] = value
    return found


def state_of(option: str, given: Sequence[float], coordinates: Sequence[str]) -> tuple[Sequence[float], Sequence[float]]:
    """The displacements and the velocities of a state. One that has not both for each coordinate is refused."""
    n = len(coordinates)
    if len(given) != 2 * n:
        names = ",".join([*coordinates, *(f"{name}'" for name in coordinates)])
        raise BadInput(f"{option} has {len(given)} numbers, expected {2 * n}: {names}")
    return given[:n], given[n:]


def parameter_lines(scene: Scene) -> list[str]:
    """The line with the values of the parameters, if the scene has a table of them."""
    if scene.parametric is None or not scene.parametric.has_table:
        return []
    return ["at       " + ", ".join(f"{name} = {value:.10g}" for name, value in scene.parameters.items())]


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


def add_filters(parser: argparse.ArgumentParser, *, shown: bool = False) -> None:
    """Add ``--label``, ``--energy``, ``--stable``, ``--ends`` and ``--impacts``. With `shown`, ``--energy`` can also be the range of
    energies that are shown."""
    parser.add_argument("--label", metavar="LABEL", help="families with this label: S13O00+, U83, or with a wildcard 'U8*'")
    if shown:
        parser.add_argument(
            "--energy",
            metavar="H|LO:HI",
            type=lambda text: energy_range(text) if ":" in text else positive(text),
            help="those that cross the energy H; or the energies shown, LO:HI (default: all that the families have)",
        )
    else:
        parser.add_argument("--energy", metavar="H", type=positive, help="families that cross this energy")
    parser.add_argument("--stable", action="store_true", help="families that are stable somewhere (with --label and --energy: there)")
    parser.add_argument("--ends", metavar="ENDS", help="families between these ends: origin-origin, origin-stop, rest-stop+, periodic")
    parser.add_argument("--impacts", metavar="N|LO:HI", type=_impacts, help="families with this number of impacts in half a period")


def filters_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """The filters that leave something out, as `Catalogue.families` takes them."""
    filters = {name: getattr(arguments, name) for name in _FILTERS}
    if isinstance(arguments.energy, tuple):
        del filters["energy"]
    return {name: value for name, value in filters.items() if value not in (None, False)}


def nothing_fits(place: str, count: int, filters: dict[str, Any], names: Sequence[str] = ()) -> BadInput:
    """The error if none of the `count` families of a catalogue passes the filters.

    Examples
    --------
    >>> print(nothing_fits("lee2009.sqlite", 7, {"label": "U8*", "stable": True, "impacts": (2.0, 3.5)}))
    no family of lee2009.sqlite fits --label U8* --stable --impacts 2:3.5; saltus list shows those that there are
    """
    if not count:
        return BadInput(f"{place} has no family; expected one that saltus build or saltus continue --save has filled")
    given = list(names)
    for name, value in filters.items():
        text = ":".join(f"{part:g}" for part in value) if isinstance(value, tuple) else str(value)
        given.append(f"--{name}" if value is True else f"--{name} {text}")
    return BadInput(f"no family of {place} fits {' '.join(given)}; saltus list shows those that there are")
