"""The families that the reference paper names, found once for the tests that look at them."""

from functools import cache

import saltus
from branches.naming.families import resolve
from branches.naming.search import search_bounds
from branches.orbit import Orbit
from branches.tracing import follow_family

SCENE = saltus.load_scene()
SYSTEM = SCENE.system

NAMES = {
    # the paper's name: energy, quarter period, the label as it is counted, impacts in half a period, stable
    "S11-": (0.8, 0.2411533495, "S11O00-", 1, True),
    "S13+": (0.58875, 1.6999998712, "S13O00+", 1, True),
    "U44-": (0.06, 5.105638027, "U4401-", 1, True),
    "U2201+": (0.105, 3.369353626, "U2201+", 1, True),
    "U3201-": (0.13, 3.257946588, "U3201-", 1, True),
    "U5511+": (0.13, 8.878477228, "U5511+", 2, True),
    "U4421+": (0.2, 6.957167798, "U4421+", 3, False),
    "U5421-": (0.29, 6.565671255, "U5421-", 3, True),
    "S55O11-": (0.19, 4.898574014, "S55O11-", 3, True),
    "U4520-": (0.228, 4.989057822, "U4520-", 2, True),
    "S95E22-": (0.345, 8.155490135, "S95E22-", 4, True),
    "U11+": (0.48, 1.690299947, "U1101+", 1, False),
    "U21+": (0.53, 1.645307867, "U1101+", 1, True),
    "U21-": (0.58, 1.618571762, "U2101-", 1, True),
    "S73E33-": (1.0, 4.867916732, "S73E33-", 6, False),
    "U5231-": (1.16, 3.254190402, "U5231-", 4, True),
    "U8344-": (1.2, 4.890542841, "U8344-", 8, True),
    "U(15)578-": (1.475, 8.179191205, "U(14)578-", 15, False),
    "S31O11-": (1.5, 1.637633000, "S33O11-", 3, True),
    "U8353-": (1.9458, 4.906500042, "U8353-", 8, False),
    "U4122-": (2.5, 1.641876865, "U4122-", 4, True),
    "S73O33-": (7.3348, 1.645952182, "S73O33-", 7, True),
}


@cache
def found(name):
    """The orbit that a name resolves to in the shipped scene."""
    orbit, _ = resolve(name, SYSTEM, reference_points=SCENE.reference_points, limits=search_bounds(SCENE.bounds), energy=SCENE.energy)
    return orbit


@cache
def family(name):
    """The family of a name, up to h = 100."""
    orbit = found(name)
    return follow_family(orbit.problem, orbit.solution.y, energy=(0.05, 100.0))


def orbit_of(name):
    """The orbit of a name at the energy of the table."""
    h, alpha = NAMES[name][:2]
    if abs(found(name).h / h - 1.0) < 1e-12:
        return Orbit(found(name).problem, found(name).solution)
    return min(family(name).orbits_at(energy=h), key=lambda orbit: abs(orbit.alpha - alpha))


def event(branch, kind, h):
    """The event of a type that is nearest in energy."""
    return min((e for e in branch.events if e.type == kind), key=lambda e: abs(e.h - h))
