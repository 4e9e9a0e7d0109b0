"""The shares of three sinks in docs/how-to/smooth.md. Oracles: simulations; of the cubic sink DOP853; closed forms at small energies."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bvp.simulate import Simulator
from saltus import load_scene
from transitions.sharing import sharing_of
from transitions.study.runs import spent_to_rest

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "smooth.md"
SCENES = (("lee2009", {"rho": 0.7}), ("smooth_wall", {"lam_nes": 0.01}), ("cubic_nes", {"lam_nes": 0.01}))


def table():
    rows = re.findall(r"^\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", PAGE.read_text(), re.MULTILINE)
    return [tuple(map(float, row)) for row in rows]


@pytest.mark.parametrize(("energy", "shares"), [(row[0], row[1:]) for row in table()])
def test_the_shares_of_the_page(energy, shares):
    """Oracle: the simulation of each motion alone; the page has three digits."""
    for (name, values), share in zip(SCENES, shares, strict=True):
        scene = load_scene(name, lam=0.01, **values)
        shared = sharing_of(scene.system, scene.nes, scene.lo)
        motion = Simulator(scene.system, dampers=shared.dampers).run([0.0, 0.0], [0.0, np.sqrt(2.0 * energy)], 500.0)
        assert shared.totals(motion.dissipated)[0] / energy == pytest.approx(share, abs=5.1e-4)


def test_the_page_has_the_table():
    assert [row[0] for row in table()] == [0.0001, 0.01, 0.1, 1.0, 10.0]


def test_the_share_of_the_cubic_sink_by_a_second_integrator():
    """Oracle: DOP853 with the energy that the damper of the sink takes, above its threshold."""

    def rate(_, x):
        w, speed = x[0] - x[1], x[2] - x[3]
        push = w**3 + 0.01 * speed
        return [x[2], x[3], -push / 0.05, push - x[1] - 0.01 * x[3], 0.01 * speed**2]

    spent = solve_ivp(rate, (0.0, 500.0), [0.0, 0.0, 0.0, np.sqrt(0.02), 0.0], "DOP853", rtol=1e-11, atol=1e-13).y[4, -1]
    assert spent / 0.01 == pytest.approx(table()[1][3], abs=5.1e-4)


def test_the_share_of_a_tuned_absorber():
    """Oracle: the energy that each damper of the linear part takes, by Lyapunov's equation."""
    system = load_scene("smooth_wall", lam=0.01, lam_nes=0.01).system
    gaps = 0.01 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    spent = spent_to_rest(system, {"gaps": gaps, "rest": system.damping - gaps}, np.array([0.0, 0.0, 0.0, np.sqrt(2e-4)]))
    assert spent["gaps"] / 1e-4 == pytest.approx(table()[0][2], abs=5.1e-4)
