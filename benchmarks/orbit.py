"""`python -m benchmarks orbit NAME`: an orbit by the paper's nonsmooth time transformation, compared with the exact one."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from benchmarks.peers import nonsmooth_time as paper
from benchmarks.peers.nonsmooth_time import LEAST_TOLERANCE, TOLERANCE, NonsmoothTimeOrbit, NotMatched, Stagnates
from benchmarks.report import Table, show, watched
from saltus.errors import DONE, BadInput
from saltus.options import positive

if TYPE_CHECKING:
    from branches.orbit import Orbit

__all__ = ["add_arguments", "compare", "nonsmooth_time_orbit", "run"]

DIGITS = range(3, 9)
"""Significant digits of the velocities that shooting starts from: as few as lead to the wanted orbit."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the task."""
    parser.add_argument("name", metavar="NAME", help="name of the family: S13O00+, U8353-, ...")
    parser.add_argument("--energy", metavar="H", type=positive, help="the orbit at this energy h")
    parser.add_argument("--alpha", metavar="A", type=positive, help="the orbit with this quarter period")
    parser.add_argument(
        "--tolerance", metavar="EPS", type=positive, default=TOLERANCE, help="matching at half a period, from 1e-13 (default: 1e-6)"
    )
    parser.add_argument("--scene", metavar="FILE", help="TOML file of the scene (default: lee2009)")
    parser.add_argument("--json", metavar="FILE", help="write the comparison as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the task; return the exit code."""
    if arguments.tolerance < LEAST_TOLERANCE:
        raise BadInput(f"--tolerance: received {arguments.tolerance:g}, expected {LEAST_TOLERANCE:g} or more: less is below rounding")
    import saltus
    from branches.files import write_text
    from branches.naming.labels import parse_name
    from saltus.families import agreed, select
    from saltus.outputs import check_writable

    if arguments.json is not None:
        check_writable(arguments.json)
    name = parse_name(arguments.name)
    energy = agreed(arguments.name, "h", name.h, "--energy", arguments.energy)
    alpha = agreed(arguments.name, "alpha", name.alpha, "--alpha", arguments.alpha)
    if energy is None and alpha is None:
        raise BadInput(f"an orbit of {name} needs --energy H or --alpha A")
    scene = saltus.load_scene(arguments.scene)
    low, high = scene.bounds["energy"]
    if energy is not None:
        low, high = min(low, 0.9 * energy), max(high, 1.1 * energy)
    orbit = select(saltus.trace(arguments.name, scene=scene, energy=(low, high)), name, energy, alpha)
    found, digits = nonsmooth_time_orbit(orbit, arguments.tolerance)
    table, record = compare(orbit, found, digits)
    show(table)
    if arguments.json is not None:
        write_text(arguments.json, json.dumps(record, indent=1, allow_nan=False) + "\n")
        print(f"wrote  {arguments.json}")
    return DONE


def nonsmooth_time_orbit(orbit: Orbit, tolerance: float) -> tuple[NonsmoothTimeOrbit, int]:
    """Find an orbit by shooting in nonsmooth time, at the quarter period of an exact orbit, from its velocities rounded to a few digits.

    Returns the orbit and the number of digits. `tolerance` is that of the matching at the half period.

    Raises
    ------
    BadInput
        If the method does not apply to the orbit: no end is an origin, or nothing reverses it.
    NotMatched
        If shooting does not reach this orbit.
    """
    reason = paper.why_not(orbit.system)
    if orbit.velocities is None and reason is None:
        reason = f"its ends are {orbit.ends[0]} {orbit.ends[1]}"
    if reason is not None:
        name = orbit.label or orbit.sequence
        raise BadInput(f"the method has no orbit {name}: {reason}; expected u = 0 at the start and at half the period")
    assert orbit.velocities is not None
    expected = [(impact.time, impact.stop) for impact in orbit.impacts if impact.time < 2.0 * orbit.alpha]
    failure: NotMatched | None = None
    for digits in watched(DIGITS, "shooting in nonsmooth time, from velocities to {} digits".format):
        found = None
        velocities = [float(f"{value:.{digits - 1}e}") for value in orbit.velocities]
        try:
            # A loose tolerance shows cheaply where shooting goes.
            for allowed in sorted({max(tolerance, TOLERANCE), tolerance}, reverse=True):
                found = paper.solve_nonsmooth_time(orbit.system, orbit.alpha, velocities, tolerance=allowed)
                paper.check_impacts(found, expected)
                velocities = found.velocities.tolist()
        except Stagnates as error:
            # A closer start would stagnate as well.
            raise NotMatched(f"{orbit.label}: {error}") from None
        except NotMatched as error:
            failure = error
        else:
            assert found is not None
            return found, digits
    raise NotMatched(f"{orbit.label}, from its velocities to {DIGITS[-1]} digits: {failure}")


def compare(orbit: Orbit, found: NonsmoothTimeOrbit, digits: int) -> tuple[Table, dict[str, Any]]:
    """Compare an orbit with the exact one: as a table, and as a record for JSON."""
    rows = list(_quantities(orbit, found))
    record = {
        "schema": 1, "label": orbit.label, "alpha": found.quarter_period, "tolerance": found.tolerance,
        "integrator": found.integrator, "integrator_tolerance": found.integrator_tolerance, "mismatch": found.mismatch,
        "drift": found.drift, "corrections": found.corrections, "digits": digits,
        "quantities": [{"name": name, "exact": exact, "found": value} for name, exact, value in rows],
    }  # fmt: skip
    notes = (
        f"{orbit.label} at alpha = {found.quarter_period:.15g}, from its velocities to {digits} digits in {found.corrections} corrections.",
        f"Integrator {found.integrator}; mismatch {found.mismatch:.1e} of {found.tolerance:.1e}; relative energy drift {found.drift:.1e}.",
    )
    cells = [(name, f"{exact:.15g}", f"{value:.15g}", f"{value - exact:.1e}") for name, exact, value in rows]
    return Table("Shooting in nonsmooth time", ("quantity", "exact", "nonsmooth time", "difference"), cells, notes), record


def _quantities(orbit: Orbit, found: NonsmoothTimeOrbit) -> Iterator[tuple[str, float, float]]:
    """Name, exact value and value of each quantity."""
    yield "h", orbit.h, found.h
    assert orbit.velocities is not None
    for index, (exact, value) in enumerate(zip(orbit.velocities, found.velocities, strict=True), start=1):
        yield f"u{index}' at the start", float(exact), float(value)
    for impact, (time, contact, speed) in zip(orbit.impacts, found.impacts, strict=True):
        yield f"time of impact {contact}", impact.time, time
        yield f"speed of impact {contact}", impact.speed, speed
