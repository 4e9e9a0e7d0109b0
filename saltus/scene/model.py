"""The automatic choice of a model for a system, with its reasons: results that the system cannot have are not computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = ["explain", "explain_motion", "explain_search", "explain_section"]

_PARTS = {1: "full", 2: "half", 4: "quarter"}


def explain(system: ImpactSystem, name: str) -> list[str]:
    """Say which model is chosen for the orbits of a name, and why.

    Parameters
    ----------
    system : bvp.system.ImpactSystem
    name : str
        The name of an orbit or family; its label or id gives the ends of the solved segment.

    Returns
    -------
    list of str
        Lines ``reason -> choice``.

    Raises
    ------
    ValueError
        If the name does not parse.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> print("\\n".join(explain(vibro_impact_nes(), "S13O00+")))
    undamped -> real modes: free flight is a sum of sines and cosines, exact to rounding
    elastic stops -> momentum and energy are kept, nothing sticks: sticking is not modelled
    symmetric with an impact at the quarter -> quarter-period problem between the ends origin and stop
    the ends fix the phase -> no phase condition
    reversible, and energy varies along the family -> no unfolding parameter
    >>> explain(vibro_impact_nes(rho=0.7), "S13O00+")
    ['restitution 0.7 of stop a loses energy -> no family of periodic orbits without forcing']
    """
    from branches.naming.labels import parse_name

    parsed = parse_name(name)
    why = system.why_not_conservative()
    if why is not None:
        return [f"{why} -> no family of periodic orbits without forcing"]
    lines = _of_system(system)
    label = parsed.label
    if label is None:
        return lines + _of_ends(parsed.family or "")
    if label.kind == "L":
        return [*lines, "a linear mode has no impacts -> it is known in closed form, no boundary-value problem"]
    if label.kind == "U":
        problem = "unsymmetric -> half-period problem between two ends origin"
    elif label.parity == "E":
        problem = "symmetric without an impact at the quarter -> quarter-period problem between the ends origin and rest"
    elif label.parity == "O" or label.sign is not None:
        problem = "symmetric with an impact at the quarter -> quarter-period problem between the ends origin and stop"
    else:
        problem = "symmetric -> quarter-period problem between an end origin and an end rest (E) or stop (O)"
    return [*lines, problem, *_REVERSIBLE]


def explain_search(system: ImpactSystem) -> list[str]:
    """Explain the model for a search for orbits of all kinds, in lines like those of `explain`.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> explain_search(vibro_impact_nes(sigma=0.0))[1]
    'a rigid-body mode has frequency 0 -> it moves uniformly, without any division by the frequency'
    """
    why = system.why_not_conservative()
    if why is not None:
        return [f"{why} -> no family of periodic orbits without forcing"]
    if system.has_odd_symmetry:
        choice = "mirror images are one orbit, and orbits with half-period symmetry are solved over a quarter period"
    else:
        choice = "no ends at the origin, and every orbit is solved over half a period"
    return [*_of_system(system), f"{'equal' if system.has_odd_symmetry else 'unequal'} gaps on both sides -> {choice}", *_REVERSIBLE]


def explain_motion(system: ImpactSystem, forces: Sequence[Force] = ()) -> list[str]:
    """Say which model is chosen for one motion, and why. The lines are as of `explain`.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> print("\\n".join(explain_motion(vibro_impact_nes(lam=0.01, rho=0.7))))
    damped -> complex modes: free flight is a sum of decaying exponentials, exact to rounding
    restitution below 1 -> bounces that accumulate are summed to their end, and a contact that is pressed sticks, with one coordinate less
    no loads -> no particular solution
    """
    modes = "damped -> complex modes: free flight is a sum of decaying exponentials, exact to rounding"
    lines = [modes] if system.damping.any() else _of_undamped_flight(system)
    if all(stop.restitution == 1.0 for stop in system.stops):
        lines.append(_ELASTIC)
    else:
        how = "bounces that accumulate are summed to their end, and a contact that is pressed sticks, with one coordinate less"
        lines.append(f"restitution below 1 -> {how}")
    kinds = ", ".join(dict.fromkeys(type(force).__name__.lower() for force in forces))
    choice = f"{kinds} -> each load is the state of a linear system of its own, and the flight with it exact" if kinds else ""
    return [*lines, choice or "no loads -> no particular solution"]


def explain_section(system: ImpactSystem) -> list[str]:
    """Say which model is chosen for a Poincare section, and why. The lines are as of `explain`.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> explain_section(vibro_impact_nes())[-1]
    'energy is kept -> the section is a map that keeps areas'
    >>> explain_section(vibro_impact_nes(rho=0.7))
    ['restitution 0.7 of stop a loses energy -> energy falls: the section is that of motions, not of an energy surface']
    """
    why = system.why_not_conservative()
    if why is not None:
        return [f"{why} -> energy falls: the section is that of motions, not of an energy surface"]
    return [*_of_system(system), "energy is kept -> the section is a map that keeps areas"]


_ELASTIC = "elastic stops -> momentum and energy are kept, nothing sticks: sticking is not modelled"


def _of_system(system: ImpactSystem) -> list[str]:
    """List the computations that a conservative system does not need, with reasons."""
    return [*_of_undamped_flight(system), _ELASTIC]


def _of_undamped_flight(system: ImpactSystem) -> list[str]:
    lines = ["undamped -> real modes: free flight is a sum of sines and cosines, exact to rounding"]
    if (system.modes.frequencies == 0.0).any():
        lines.append("a rigid-body mode has frequency 0 -> it moves uniformly, without any division by the frequency")
    return lines


_REVERSIBLE = [
    "the ends fix the phase -> no phase condition",
    "reversible, and energy varies along the family -> no unfolding parameter",
]


def _of_ends(family: str) -> list[str]:
    """Explain the problem that a family's id names."""
    from branches.sequences import PERIODIC, segments_per_period, split_family_id

    ends = split_family_id(family)[0]
    if ends == PERIODIC:
        return [
            "the orbit has no reversal -> full-period problem that closes on itself, with a phase condition",
            "conservative, so periodic orbits are not isolated -> one unfolding parameter, zero on solutions",
        ]
    part = _PARTS[segments_per_period(ends)]
    return [f"the orbit reverses at its ends -> {part}-period problem between the ends {ends[0]} and {ends[1]}", *_REVERSIBLE]
