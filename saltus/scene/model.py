"""Which model is chosen for a system, and why, in lines ``reason -> choice``: results that the system cannot have are not computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bvp.forcing import Force
    from bvp.parameters import ParametricSystem
    from bvp.system import ImpactSystem

__all__ = ["explain", "explain_motion", "explain_response", "explain_search", "explain_section"]

_UNDAMPED = "undamped -> real modes: free flight is a sum of sines and cosines, exact to rounding"
_RIGID = "a rigid-body mode has frequency 0 -> it moves uniformly, without any division by the frequency"
_ELASTIC = "elastic stops -> momentum and energy are kept, nothing sticks: sticking is not modelled"
_REVERSIBLE = [
    "the ends fix the phase -> no phase condition",
    "reversible, and energy varies along the family -> no unfolding parameter",
]
_PARTS = {1: "full", 2: "half", 4: "quarter"}


def explain(system: ImpactSystem, name: str | tuple[str, str]) -> list[str]:
    """The model for the orbits of a label or of a family's id, or between two ends. Raises `ValueError` if the name does not parse.

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
    from branches.naming.labels import Name, parse_name
    from branches.sequences import PERIODIC, segments_per_period, split_family_id

    parsed = parse_name(name) if isinstance(name, str) else Name()
    why = system.why_not_conservative()
    if why is not None:
        return [f"{why} -> no family of periodic orbits without forcing"]
    lines = _of_system(system)
    label = parsed.label
    if label is None:
        ends = split_family_id(parsed.family or "")[0] if isinstance(name, str) else name
        if ends == PERIODIC:
            return [
                *lines,
                "the orbit has no reversal -> full-period problem that closes on itself, with a phase condition",
                "conservative, so periodic orbits are not isolated -> one unfolding parameter, zero on solutions",
            ]
        part = _PARTS[segments_per_period(ends)]
        problem = f"the orbit reverses at its ends -> {part}-period problem between the ends {ends[0]} and {ends[1]}"
    elif label.kind == "L":
        return [*lines, "a linear mode has no impacts -> it is known in closed form, no boundary-value problem"]
    elif label.kind == "U":
        problem = "unsymmetric -> half-period problem between two ends origin"
    elif label.parity == "E":
        problem = "symmetric without an impact at the quarter -> quarter-period problem between the ends origin and rest"
    elif label.parity == "O" or label.sign is not None:
        problem = "symmetric with an impact at the quarter -> quarter-period problem between the ends origin and stop"
    else:
        problem = "symmetric -> quarter-period problem between an end origin and an end rest (E) or stop (O)"
    return [*lines, problem, *_REVERSIBLE]


def explain_search(system: ImpactSystem) -> list[str]:
    """The model for a search for orbits of all kinds.

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
        how = "mirror images are one orbit, and orbits with half-period symmetry are solved over a quarter period"
        choice = f"{'equal gaps on both sides' if system.stops else 'odd springs'} -> {how}"
    else:
        reason = "unequal gaps on both sides" if (system.why_not_odd() or "").startswith("stop") else "springs that are not odd"
        choice = f"{reason} -> no ends at the origin, and every orbit is solved over half a period"
    return [*_of_system(system), choice, *_REVERSIBLE]


def explain_motion(system: ImpactSystem, forces: Sequence[Force] = ()) -> list[str]:
    """The model for one motion.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> print("\\n".join(explain_motion(vibro_impact_nes(lam=0.01, rho=0.7))))
    damped -> complex modes: free flight is a sum of decaying exponentials, exact to rounding
    restitution below 1 -> bounces that accumulate are summed to their end, and a contact that is pressed sticks, with one coordinate less
    no loads -> no particular solution
    """
    lines, linear = _of_system(system), system.why_not_linear() is None
    if linear and system.damping.any():
        lines = ["damped -> complex modes: free flight is a sum of decaying exponentials, exact to rounding", _ELASTIC]
    if any(stop.restitution < 1.0 for stop in system.stops):
        how = "bounces that accumulate are summed to their end, and a contact that is pressed sticks, with one coordinate less"
        lines[-1] = f"restitution below 1 -> {how}"
    kinds = ", ".join(dict.fromkeys(type(force).__name__.lower() for force in forces))
    flight = "the flight with it exact" if linear else "part of the Taylor series of the flight"
    choice = f"{kinds} -> each load is the state of a linear system of its own, and {flight}" if kinds else ""
    return [*lines, choice or "no loads -> no particular solution"]


def explain_response(parametric: ParametricSystem, values: Mapping[str, float] | None = None) -> list[str]:
    """The model for a family of forced or self-excited orbits, at values of the parameters.

    Examples
    --------
    >>> from bvp.parameters import ParametricSystem
    >>> stop = {"c": [1.0], "lower": -1.0, "upper": 1.0}
    >>> system = {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [stop]}
    >>> load = {"load": [1.0], "amplitude": 0.5, "frequency": 1.2}
    >>> print("\\n".join(explain_response(ParametricSystem.from_description({"system": system, "forces": [load]}))[2:]))
    harmonic -> each load is the state of a linear system of its own, and the flight with it exact
    periodic loads -> the period is a multiple of theirs; the times of impacts are unknowns, and all multipliers count
    equal gaps on both sides, odd loads -> an orbit with half-period symmetry is solved over half a period
    """
    system, layout = parametric.system(values), parametric.layout
    clock = "periodic loads -> the period is a multiple of theirs; the times of impacts are unknowns, and all multipliers count"
    if not layout.harmonics:
        clock = "no periodic load -> the period is free, with a phase condition; one multiplier is 1"
    lines = [*explain_motion(system, parametric.forces(values)), clock]
    if system.has_odd_symmetry and all(k % 2 for k in layout.harmonics) and not parametric.entries(values)[layout.constant].any():
        lines.append("equal gaps on both sides, odd loads -> an orbit with half-period symmetry is solved over half a period")
    return lines


def explain_section(system: ImpactSystem) -> list[str]:
    """The model for a Poincare section.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> explain_section(vibro_impact_nes())[-1]
    'energy is kept -> the section is a map that keeps areas'
    """
    why = system.why_not_conservative()
    if why is not None:
        return [f"{why} -> energy falls: the section is that of motions, not of an energy surface"]
    return [*_of_system(system), "energy is kept -> the section is a map that keeps areas"]


def _of_system(system: ImpactSystem) -> list[str]:
    """The computations that an undamped elastic system does not need."""
    from bvp.modes import undamped_modes

    contacts = [_ELASTIC] if system.stops else ["no stops -> no impacts"]
    reason = system.why_not_linear()
    if reason is not None:
        return [f"{reason} -> free flight is a Taylor series in time, each step confirmed by its defect", *contacts]
    # Not `system.modes`, which needs the kernels: `saltus show` loads none.
    squares, _ = undamped_modes(system.mass, system.stiffness)
    return [_UNDAMPED, *([_RIGID] if (squares == 0.0).any() else []), *contacts]
