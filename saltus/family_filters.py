"""The options that choose families of a catalogue, shared by the commands that list and export them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

from saltus.arguments import energy_range, positive
from saltus.errors import BadInput

__all__ = ["add_arguments", "from_arguments", "nothing_fits", "told", "words"]

_NAMES = ("label", "energy", "stable", "ends", "impacts")


def add_arguments(parser: argparse.ArgumentParser, *, shown: bool = False) -> None:
    """Add ``--label``, ``--energy``, ``--stable``, ``--ends`` and ``--impacts``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    shown : bool
        Whether ``--energy`` can also be a range LO:HI, of the energies shown, which is no filter of families.
    """
    parser.add_argument("--label", metavar="LABEL", help="those with such a label: S13O00+, U83, or with wildcards 'U8*'")
    if shown:
        words = "those that cross the energy H; or the energies shown, LO:HI (default: all that the families have)"
        parser.add_argument("--energy", metavar="H|LO:HI", type=lambda text: (energy_range if ":" in text else positive)(text), help=words)
    else:
        parser.add_argument("--energy", metavar="H", type=positive, help="those that cross this energy")
    parser.add_argument("--stable", action="store_true", help="those that are stable somewhere (with --label and --energy: there)")
    parser.add_argument("--ends", metavar="ENDS", help="those between such ends: origin-origin, origin-stop, rest-stop+, periodic")
    parser.add_argument("--impacts", metavar="N|LO:HI", type=_impacts, help="those with so many impacts in half a period")


def from_arguments(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the filters asked for, as `Catalogue.families` takes them."""
    filters = {name: getattr(arguments, name) for name in _NAMES}
    return {**filters, "energy": None if isinstance(arguments.energy, tuple) else arguments.energy}


def told(filters: dict[str, Any]) -> dict[str, Any]:
    """Those of the filters that leave something out.

    Examples
    --------
    >>> told({"label": "U8*", "energy": None, "stable": False})
    {'label': 'U8*'}
    """
    return {name: value for name, value in filters.items() if value not in (None, False)}


def words(filters: dict[str, Any]) -> str:
    """The filters as options of the command line.

    Examples
    --------
    >>> words({"label": "U8*", "energy": None, "stable": True, "impacts": (2.0, 3.5)})
    '--label U8* --stable --impacts 2:3.5'
    """
    parts = []
    for name, value in told(filters).items():
        text = "" if value is True else " " + (":".join(f"{part:g}" for part in value) if isinstance(value, tuple) else f"{value}")
        parts.append(f"--{name}{text}")
    return " ".join(parts)


def nothing_fits(place: str, count: int, filters: dict[str, Any], names: Sequence[str] = ()) -> BadInput:
    """The error that says that no family is left of those, so many, that a place holds.

    Examples
    --------
    >>> print(nothing_fits("lee2009.sqlite", 7, {"label": "U8*"}))
    no family of lee2009.sqlite fits --label U8*; saltus list shows those that there are
    """
    if not count:
        return BadInput(f"{place} holds no family; expected one that saltus build or saltus continue --save has filled")
    asked = " ".join(part for part in (*names, words(filters)) if part)
    return BadInput(f"no family of {place} fits {asked}; saltus list shows those that there are")


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
