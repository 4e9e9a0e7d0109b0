"""Hard cases of saltation: a published multiplier that the jump term makes, and every sign of it turned."""

import math

import numpy as np
from scipy.optimize import brentq

import benchmarks.saltation as module
from benchmarks.saltation import monodromy, saltation, saltation_matrix
from bvp.closures import cycle_of
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.orbits import backbone_segment
from tests.bvp.test_multipliers import attracting_cycle
from tests.hard.cases import hard
from tests.hard.digits import Closed
from tests.hard.mutants import mutants
from tests.lab.flights import LinearFlight


def oscillator(ratio):
    """x'' + 2 ratio x' + x = 0."""
    return ImpactSystem([[1.0]], [[2.0 * ratio]], [[1.0]], (Stop((1.0,), upper=9.0),))


def flight(system, t):
    """exp(A t) in (x, x')."""
    return system.modes.to_state @ LinearFlight(system).map(t) @ system.modes.from_state


def switched_multiplier(jump):
    """Multiplier of the cycle of an oscillator with damping 0.3 for |x| > 1 and -0.1 for |x| < 1; `jump` makes the matrix of a crossing.

    From its turn at x = r out to x = 1, on to x = -1, out to x = -r; the other half is its mirror image."""
    outside, inside = oscillator(0.3), oscillator(-0.1)

    def field(system, z):
        return np.array([z[1], -z[0] - system.damping[0, 0] * z[1]])

    def half(r):
        z, matrix = np.array([r, 0.0]), np.eye(2)
        for system, following, level in ((outside, inside, 1.0), (inside, outside, -1.0)):
            t = brentq(lambda t, system=system, z=z, level=level: (flight(system, t) @ z)[0] - level, 0.0, 2.2, xtol=1e-15)
            before = flight(system, t) @ z
            matrix = jump(np.eye(2), field(system, before), field(following, before), np.array([1.0, 0.0])) @ flight(system, t) @ matrix
            z = before
        t = brentq(lambda t, z=z: (flight(outside, t) @ z)[1], 0.0, 2.2, xtol=1e-15)
        return flight(outside, t) @ z, flight(outside, t) @ matrix

    r = brentq(lambda r: half(r)[0][0] + r, 1.2, 3.0, xtol=1e-15)
    end, matrix = half(r)
    flow, section = field(outside, end), np.array([0.0, 1.0])
    returned = (np.eye(2) - np.outer(flow, section) / (section @ flow)) @ matrix
    return float(np.max(np.abs(np.linalg.eigvals(returned))) ** 2)


PUBLISHED = 0.203639654


@hard(
    "an oscillator whose damping jumps from -0.1 to 0.3 at |x| = 1: without the jump term its multiplier would be 1",
    source="published: 0.203639654, and 1 exactly",
    limit=5e-10,
    what="both multipliers, absolute; the published digits",
)
def test_the_published_multiplier():
    def without(jump, coming, going, gradient):
        return jump

    assert abs(switched_multiplier(without) - 1.0) < 1e-12
    return abs(switched_multiplier(saltation) - PUBLISHED)


def one_cycle():
    """The backbone at alpha = 1.7: elastic; and a lossy cycle of an excited oscillator: restitution and damping."""
    problem, y = backbone_segment(vibro_impact_nes(), 1.7)
    return cycle_of(problem, problem.solve(y, quarter_period=1.7).y), attracting_cycle()[1]


def noticed(check, *arguments):
    """Whether a check fails, by its number or by an error."""
    try:
        return not check(*arguments) < 1e-6
    except (ArithmeticError, IndexError, ValueError, np.linalg.LinAlgError):
        return True


def turned_signs(function, names, check):
    """How many signs of a function were turned; each turn has to be noticed, and the function as it stands has not."""
    found = list(mutants(function, names))
    assert not noticed(check, found[0][1]), function
    silent = [line for line, mutant in found[1:] if not noticed(check, mutant)]
    assert not silent, silent
    return len(found) - 1


@hard(
    "every sign of the saltation matrix turned, one at a time: each is noticed",
    source="the published multiplier, the closed form of the backbone, Liouville's determinant, the flow that is kept",
    limit=0.0,
    what="signs whose turn is silent",
)
def test_every_sign_of_the_saltation_matrix(monkeypatch):
    """Mutation: each sign of R + (f+ - R f-) g/(g . f-) and of R turned, one at a time, is noticed by the closed form, Liouville's
    determinant and the published multiplier."""
    elastic, lossy = one_cycle()
    exact = Closed(elastic.system, 1.7)
    tau = float(exact.tau_half() ** 2 - 2)
    loss = np.trace(np.linalg.solve(lossy.system.mass, lossy.system.damping))
    shrunk = math.exp(-loss * lossy.period) * lossy.system.stops[0].restitution ** (2 * len(lossy.contact))

    def formula(mutant):
        return abs(switched_multiplier(mutant) - PUBLISHED)

    def matrix(mutant):
        monkeypatch.setattr(module, "saltation_matrix", mutant)
        flow = lossy.system.modes.matrix @ lossy.after[0]
        kept = monodromy(lossy)
        return (
            abs(np.trace(monodromy(elastic)) - 2.0 - tau)
            + abs(np.linalg.det(kept) / shrunk - 1.0)
            + np.linalg.norm(kept @ flow - flow) / np.linalg.norm(flow)
        )

    assert turned_signs(saltation, {}, formula) == 2
    assert turned_signs(saltation, {}, lambda mutant: matrix(_with(mutant))) == 2
    assert turned_signs(saltation_matrix, {}, matrix) == 2
    return 0.0


def _with(mutant):
    """`saltation_matrix` with another formula."""
    return next(mutants(saltation_matrix, {"saltation": mutant}))[1]
