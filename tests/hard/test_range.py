"""Hard cases of size: energies next to a threshold and 1e12, orbits of a thousand impacts, quarter periods of a thousand."""

import math

import mpmath as mp
import numpy as np
import pytest

import saltus
from benchmarks.backbone import Backbone
from bvp.closures import cycle_of
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.traced import traced
from tests.bvp.orbits import backbone_segment
from tests.hard.cases import hard, largest
from tests.hard.digits import Closed, relative, root

SYSTEM = vibro_impact_nes()
CLOSED_FORM = "closed form in 50 digits"


@hard(
    "energies 1e-6 above a threshold: the grazing of both linear modes, and the fold of S11O00- on both of its sides",
    source=CLOSED_FORM,
    limit=1e-13,
    what="energy at the quarter period that was solved for, relative; number of orbits exact",
)
def test_energies_next_to_a_threshold():
    """Solved for at the energy; the closed form is asked for the energy at the quarter period that comes out."""
    fold = next(e for e in traced("S11O00-").events if e.type == "SN")
    _, least = Backbone().where_tau_half_is(math.copysign(2.0, Backbone().tau_half(fold.alpha)), fold.alpha * 0.999, fold.alpha * 1.001)
    modes = SYSTEM.modes
    first, last = (0.5 * (modes.frequencies[k] / modes.contacts.gap[0, k]) ** 2 for k in (0, 1))
    worst = 0.0
    thresholds = (("S13O00+", first, 1, 1), ("S11O00-", last, -1, 2), ("S11O00-", least, 1, 2), ("S11O00-", last, 1, 1))
    for name, threshold, sign, count in thresholds:
        h = threshold * (1.0 + sign * 1e-6)
        orbits = traced(name).orbits_at(energy=h)
        assert len(orbits) == count, (name, h)
        worst = largest(worst, *(float(abs(orbit.h / Closed(SYSTEM, orbit.alpha).energy - 1)) for orbit in orbits))
        worst = largest(worst, *(abs(orbit.h / h - 1.0) for orbit in orbits))
    assert not traced("S11O00-").orbits_at(energy=least * (1.0 - 1e-6))
    return worst


@hard(
    "an energy of 1e12: S11O00-, followed to it and solved at it",
    source=CLOSED_FORM,
    limit=1e-14,
    what="velocities at the origin and energy, relative; tau, absolute",
)
def test_an_energy_of_1e12():
    branch = saltus.trace("S11O00-", SYSTEM, energy=(1.0, 1e12))
    assert branch.ended[1].text.startswith("EP at h = 1e+12") and branch.points["h"][-1] == pytest.approx(1e12, rel=1e-12)
    orbit = branch.orbits_at(energy=9.9e11)[0]
    exact = Closed(SYSTEM, orbit.alpha)
    sign = math.copysign(1.0, orbit.velocities[0] * float(exact.origin[0]))
    assert orbit.stable is True
    return largest(
        relative(sign * orbit.velocities, exact.origin),
        float(abs(orbit.h / exact.energy - 1)),
        float(abs(orbit.tau - (exact.tau_half() ** 2 - 2))),
    )


@hard(
    "an orbit of 2,000 impacts in a period, primitive: an impact oscillator beside a free one, 1000 of its half periods to 7 of the other",
    source="closed form: u1 = sin(w1 t)/sin(w1 a) between impacts 2 a apart, u2 = sin(w2 t)",
    limit=1e-11,
    what="velocities at the origin, relative; residual below 1e-12",
)
def test_a_thousand_impacts_in_a_primitive_orbit():
    w1, w2, count, waves = 1.3, 0.011, 1000, 7
    half = math.pi * waves / w2
    alpha = half / count / 2.0
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([w1**2, w2**2]), (Stop((1.0, 0.0), -1.0, 1.0),))
    modes = system.modes
    rate = mp.mpf(w1) / mp.sin(mp.mpf(w1) * mp.mpf(alpha))
    start = np.array([0.0, 0.0, float(rate), 3.0])
    times = alpha * (2.0 * np.arange(count) + 1.0)
    signs = (-1.0) ** np.arange(count)
    arrive = w1 / math.tan(w1 * alpha)
    nodes = np.column_stack([signs, 3.0 / w2 * np.sin(w2 * times), -signs * arrive, 3.0 * np.cos(w2 * times)]) @ modes.from_state.T
    problem = MultipointProblem(system, ("origin", "origin"), tuple("+-" * (count // 2)))
    y = problem.pack(modes.from_state @ start, nodes, [alpha] + [2.0 * alpha] * (count - 1) + [alpha])
    # A family by the size of u2: the corrector may move along it, so only what that size does not change is compared.
    solution = problem.solve(y * (1.0 + 1e-6 * np.cos(np.arange(len(y)))))
    v = (modes.to_state @ problem.start(solution.y))[2:]
    assert solution["residual"] < 1e-12 and len(cycle_of(problem, solution.y).contact) == 2 * count
    worst = float(abs(v[0] / rate - 1))
    nodes = modes.to_state @ problem.nodes(solution.y).T
    size = v[1] / w2 / (3.0 / w2)
    return largest(worst, float(np.max(np.abs(nodes[1] - size * 3.0 / w2 * np.sin(w2 * times))) / (size * 3.0 / w2)))


@hard(
    "1,000 half periods of S13O00+ as one orbit, solved from a start shaken by 1e-6",
    source=CLOSED_FORM,
    limit=1e-12,
    what="velocities at the origin, relative; multipliers, relative, over the number of impacts",
)
def test_a_thousand_turns():
    """At alpha = 1.7, elliptic: rounding of the angle of the multipliers is what grows with the number of impacts."""
    count, alpha = 1000, 1.7
    problem, y = backbone_segment(SYSTEM, alpha, impacts=count)
    solution = problem.solve(y * (1.0 + 1e-6 * np.cos(np.arange(len(y)))), quarter_period=alpha * count)
    exact = Closed(SYSTEM, alpha)
    velocities = (SYSTEM.modes.to_state @ problem.start(solution.y))[2:]
    found = saddle_point_multipliers(cycle_of(problem, solution.y))
    assert found.reliable
    with mp.workdps(50):
        angle = mp.acos(exact.tau_half() / 2) * 2 * count
    value = complex(mp.cos(angle), mp.sin(angle))
    return largest(relative(velocities, exact.origin), min(abs(value - x) for x in found.values) / count)


@hard(
    "quarter periods of 1e3: an absorber that flies free, or on a spring of 1e-12 or 1e-8, beside a mode that turns 640 times",
    source=CLOSED_FORM,
    limit=1e-10,
    what="velocities at the origin, energy, relative; multipliers, relative to the largest",
)
def test_quarter_periods_of_a_thousand():
    """An angle of 4000 is known to 4e-13, and the multipliers, up to 2e5, magnify it."""
    systems = [vibro_impact_nes(0.1, 0.0), vibro_impact_nes(0.1, 1e-12), vibro_impact_nes(0.1, 1e-8)]
    worst, count = 0.0, 0
    for system in systems:
        for alpha in (999.0, 1000.0, 1001.3):
            exact = Closed(system, alpha)
            lowest = max(abs(float(exact.gap(t))) for t in np.linspace(-alpha, alpha, 4001)[1:-1])
            problem, y = backbone_segment(system, alpha)
            solution = problem.solve(y * (1.0 + 1e-9), quarter_period=alpha)
            velocities = (system.modes.to_state @ problem.start(solution.y))[2:]
            found = saddle_point_multipliers(cycle_of(problem, solution.y))
            values = exact.multipliers()
            assert (solution["clearance"] > 0.0) == (lowest < 1.0)
            count += lowest < 1.0
            worst = largest(
                worst,
                relative(velocities, exact.origin),
                float(abs(solution["energy"] / exact.energy - 1)),
                abs(found.trace - np.sum(values)) / np.max(np.abs(values)),
            )
    assert count >= 6
    return worst


def test_the_root_finder_of_this_folder():
    """The oracle's own check: sqrt 2 to 40 digits."""
    assert abs(root(lambda x: x * x - 2, 1, 2) - mp.mpf(2) ** mp.mpf("0.5")) < mp.mpf(10) ** -14
