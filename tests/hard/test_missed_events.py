"""Hard cases of the next impact: random systems and starts of which none is missed and none invented, and chattering at rho = 0.999."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from bvp.forcing import Constant
from bvp.motion import EventKind
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop
from tests.hard import sweeping
from tests.hard.cases import hard, largest
from tests.hard.sweeping import Exponentials, Verdicts, random_cases
from tests.lab.paths import ImpactStatus, next_impact

SOURCE = "each decided by a bound in doubles, or in integers of 500 bits (tests/hard/sweeping.py)"


@hard(
    "next impact of 2,000 random starts (n = 2 ... 5, several stops, damped and not, grazing and leaving drawn on purpose)",
    source=SOURCE,
    limit=1e-13,
    what="distance from the stop at a hit's time, of the sizes that make it up; none missed, none invented",
)
def test_none_is_missed_and_none_invented():
    """The same with 100,000 starts runs in tests/full."""
    verdicts = Verdicts()
    verdicts.judge(random_cases(np.random.default_rng(2), 100, 20))
    assert not verdicts.missed, [text for _, text in verdicts.missed]
    assert not verdicts.invented, [text for _, text in verdicts.invented]
    assert sum(verdicts.kinds.values()) == 2000 and min(verdicts.kinds[kind] for kind in ("HIT", "NONE", "TOUCH")) > 20
    assert verdicts.near > 60
    return verdicts.distance


def sampled(system, u, v, horizon, leaving):
    """What a program finds that looks at the stops every 0.02."""
    motion = Exponentials(system)
    found = next_impact(system, u, v, horizon, leaving)
    z = np.concatenate([u, v])
    for t in np.arange(0.02, horizon, 0.02):
        far = motion.distances(motion.flow(z, t))
        if np.min(far) < 0.0:
            late = found.status is ImpactStatus.HIT and abs(found.time - t) > 0.02
            return replace(found, status=ImpactStatus.HIT, time=t, contact=motion.letters[int(np.argmin(far))]) if late else found
    return replace(found, status=ImpactStatus.NONE, time=horizon, contact="")


def hasty(system, u, v, horizon, leaving):
    """What a program finds that takes a touch for a hit."""
    found = next_impact(system, u, v, horizon, leaving)
    return replace(found, status=ImpactStatus.HIT) if found.status is ImpactStatus.TOUCH else found


def early(system, u, v, horizon, leaving):
    """What a program finds that is wrong by 1e-9 in its times."""
    found = next_impact(system, u, v, horizon, leaving)
    return replace(found, time=found.time * (1.0 - 1e-9)) if found.status is ImpactStatus.HIT else found


def doubled(system, u, v, horizon, leaving):
    """What a program finds that hits each stop a little before it is there."""
    found = next_impact(system, u, v, horizon, leaving)
    return replace(found, time=0.5 * found.time) if found.status is ImpactStatus.HIT else found


@pytest.mark.parametrize(("wrong", "how"), [(sampled, "missed"), (hasty, "missed"), (doubled, "invented"), (early, "distance")])
def test_the_check_notices(monkeypatch, wrong, how):
    """Mutation: programs that sample, that hit what they touch, that hit nothing, that are late."""
    monkeypatch.setattr(sweeping, "next_impact", wrong)
    verdicts = Verdicts()
    verdicts.judge(random_cases(np.random.default_rng(3), 12, 12))
    assert verdicts.distance > 1e-11 if how == "distance" else getattr(verdicts, how)


@hard(
    "chattering with rho = 0.999: a particle under a constant load comes to rest after bounces without number",
    source="closed form: 2 v rho/(g (1 - rho)) after the first impact",
    limit=1e-11,
    what="time of the rest, relative; loss at the stop, relative",
)
def test_chattering():
    """The bounces that are followed, and the sum of the others by their series; to an end at which the stop holds."""
    worst = 0.0
    rho = 0.999
    for gravity in (1.0, 9.81):
        ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], (Stop((1.0,), 0.0, restitution=rho),))
        motion = simulate(ball, [0.5], [0.0], 3000.0, forces=Constant([-gravity]))
        assert motion.kinds[-1] == EventKind.STICK.value
        exact = (1 + 2 * mp.mpf(rho) / (1 - mp.mpf(rho))) / mp.sqrt(mp.mpf(gravity))
        worst = largest(worst, float(abs(motion.times[-1] / exact - 1)), abs(motion.dissipated["stop a"] / (0.5 * gravity) - 1.0))
    return worst
