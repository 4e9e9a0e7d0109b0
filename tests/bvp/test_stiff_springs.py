"""Springs whose power grows without bound. Oracles: quadrature in many digits, closed forms, and the system with stops itself."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from bvp.checks import InvalidSystem
from bvp.parameters import ParametricSystem
from bvp.stiff_springs import effective_clearance, stiff_limit
from bvp.system import ImpactSystem, Stop


@pytest.mark.parametrize(
    ("power", "stiffness", "mass", "speed"), [(1.0, 4.0, 1.0, 3.0), (3.0, 1.0, 0.09, 2.5), (41.0, 1.0, 0.09, 0.3), (2001.0, 7.0, 0.5, 9.0)]
)
def test_the_effective_clearance_turns_a_motion_at_the_same_time(power, stiffness, mass, speed):
    """Oracle: the time from w = 0 to the turning point, by quadrature in 30 digits of dt = dw/w', substituted at the turning point."""
    with mp.workdps(30):
        n = mp.mpf(power) + 1
        turn = (n * mass * mp.mpf(speed) ** 2 / (2 * mp.mpf(stiffness))) ** (1 / n)

        # w = turn (1 - y^2): the integrand has no singularity at the turning point
        def rate(y):
            return mp.sqrt(-mp.expm1(n * mp.log1p(-y * y))) / y if 0 < y < 1 else mp.sqrt(n) if y == 0 else mp.mpf(1)

        time = mp.quad(lambda y: 2 * turn / (speed * rate(y)), [0, 0.01, 0.1, 1])
        exact = float(time * speed)
    # lgamma has an absolute rounding error of some eps.
    assert abs(effective_clearance(power, stiffness, mass, speed) / exact - 1.0) < 1e-14


def parametric(**changes) -> ParametricSystem:
    """A sink in a cavity of half width 0.5, with a stiff spring or another one."""
    spring = {"between": ["u1", "u2"], "stiffness": "2**(2/x + 1)", "power": "2/x + 1"} | changes
    system = {"mass": [[0.1, 0.0], [0.0, 1.0]], "stiffness": [[0.1, -0.1], [-0.1, 1.1]], "springs": [spring]}
    return ParametricSystem.from_description({"parameters": {"x": 0.1}, "system": system})


def test_a_stiff_spring_becomes_a_stop_at_its_wall():
    """Oracle: k w^p = (2 w)^p has its wall at 1/2; the system with that stop."""
    found, (spring,) = stiff_limit(parametric(), "x")
    stop = Stop((1.0, -1.0), -0.5, 0.5)
    wanted = ImpactSystem(np.diag([0.1, 1.0]), np.zeros((2, 2)), [[0.1, -0.1], [-0.1, 1.1]], (stop,))
    assert found is not None and found.smooth_forces is None
    for name in ("mass", "damping", "stiffness"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name))
    (own,) = found.stops
    assert own.gap == stop.gap and abs(own.upper - 0.5) < 1e-15 and own.lower == -own.upper and own.restitution == 1.0
    assert spring.power == 21.0 and abs(spring.mass - 1.0 / 11.0) < 1e-16 and abs(spring.force(0.5) - 1.0) < 1e-14
    # its energy at the turning point is that of the speed
    assert abs(0.5 * spring.mass * spring.speed(0.6) ** 2 / (1.2**21 * 0.6 / 22.0) - 1.0) < 1e-14
    assert stiff_limit(parametric(power="3 + x", stiffness=1.0), "x")[0] is None


def test_what_has_no_limit_is_refused():
    """Oracle: the words."""
    with pytest.raises(InvalidSystem, match="has no wall"):
        stiff_limit(parametric(stiffness="exp(-1/x**2)"), "x")
    with pytest.raises(InvalidSystem, match="grows without bound"):
        description = parametric().describe()
        description["system"]["stiffness"] = [["1/x", 0.0], [0.0, 1.0]]
        stiff_limit(ParametricSystem.from_description(description), "x")
    with pytest.raises(InvalidSystem, match="the system has no limit: k grows without bound"):
        spring = {"on": "u1", "stiffness": "k", "power": 3.0}
        system = {"mass": [[1.0]], "stiffness": [[1.0]], "springs": [spring]}
        stiff_limit(ParametricSystem({"parameters": {"k": 2.0}, "system": system}).in_reciprocal("k"), "1/k")
    assert math.isfinite(parametric().values["x"])
