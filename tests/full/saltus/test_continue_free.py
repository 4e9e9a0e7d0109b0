"""Long cases of tests/saltus/test_continue_free.py."""

import pytest

from tests.saltus import test_continue_free as origin
from tests.saltus.running import run
from tests.saltus.test_continue_free import rows_of

pytestmark = origin.pytestmark


CHAIN = """
[parameters]
k = 0.7
d = 1.1
m = 1.0

[system]
mass = [["m", 0, 0], [0, 0.8, 0], [0, 0, 1.3]]
stiffness = [["1 + k", "-k", 0], ["-k", "k + 0.9", -0.9], [0, -0.9, 1.6]]

[[stops]]
c = [1, 0, 0]
lower = "-d"
upper = "d"

[bounds]
energy = [0.01, 100]
quarter_period = 10
impacts = 4
"""


def test_a_chain_of_a_scene_in_a_stiffness_and_a_mass(capsys, folder):
    """Oracle: in a gap all lengths of a linear system grow together, and the energy with their square. The files without an id are read:
    for an id a family is followed much farther."""
    (folder / "scene.toml").write_text(CHAIN, encoding="utf-8")
    scene = "--scene", "scene.toml", "--from", "mode:3", "--model"
    for name, span in (("k", "0.6:0.8"), ("m", "0.9:1.1")):
        code, out, err = run(capsys, "continue", *scene, "--in", name, "--range", span, "--keep", "energy=4", "--csv", "a.csv")
        assert code == 0 and "model  " in out, err
        points = rows_of("a.csv")
        assert {round(float(point["h"]), 12) for point in points} == {4.0}
        assert points[0]["multipliers.4.re"] and "multipliers.5.re" not in points[0]
    code, _, err = run(capsys, "continue", *scene, "--in", "d", "--range", "1:1.3", "--keep", "energy = 4*(d/1.1)**2", "--csv", "a.csv")
    assert code == 0, err
    alpha = [float(point["alpha"]) for point in rows_of("a.csv")]
    assert alpha == pytest.approx([alpha[0]] * len(alpha), rel=1e-12)


def test_a_family_ends_where_the_system_cannot_have_the_parameter(capsys, folder):
    (folder / "scene.toml").write_text(CHAIN.replace('["m", 0, 0]', '["2 - m", 0, 0]'), encoding="utf-8")
    words = "--scene", "scene.toml", "--from", "mode:3", "--in", "m", "--range", "0.5:3", "--keep", "quarter_period=0.5"
    code, out, err = run(capsys, "continue", *words)
    assert code == 0 and ("end    the system ends at m = 1.99" in out or "end    GR" in out), err
