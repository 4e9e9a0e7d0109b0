"""Long cases of tests/saltus/test_continue_harmonics.py."""

import numpy as np

from tests.saltus import test_continue_harmonics as origin
from tests.saltus.running import read_branch, run
from tests.saltus.test_continue_smooth_response import DUFFING

pytestmark = origin.pytestmark


FREE = """
[system]
mass = [[1.0]]
stiffness = [[1.0]]
[[springs]]
on = "u1"
stiffness = 1.0
power = 3.0
[bounds]
energy = [1e-4, 20.0]
quarter_period = 8.0
impacts = 0
"""


def test_a_backbone_is_drawn_beside_the_response(capsys, folder):
    """Oracle: max |x| and frequency of the Duffing oscillator by K(m); the figure; what is refused."""
    from scipy.special import ellipk

    from branches.reading import read_branch as read
    from transitions.response.backbone import backbone
    from transitions.response.files import read_responses

    (folder / "driven.toml").write_text(DUFFING.replace("F = 7.0", "F = 0.3").replace("w = 0.99", "w = 2.0"), encoding="utf-8")
    (folder / "free.toml").write_text(FREE, encoding="utf-8")
    assert run(capsys, "continue", "--scene", "free.toml", "--from", "mode:1", "--json", "b.json")[0] == 0
    words = ("continue", "--scene", "driven.toml", "--from", "rest")
    assert run(capsys, *words, "--in", "w", "--range", "1.9:2.1", "--json", "r.json")[0] == 0
    code, out, err = run(capsys, "plot", "r.json", "--beside", "b.json", "--plot", "f.png")
    assert code == 0 and not err and (folder / "f.png").stat().st_size > 10_000
    curve = backbone(read("b.json"), read_responses("r.json"), "max:u1")
    kept = np.isfinite(curve.y)
    x, size = curve.x[kept], curve.y[kept]
    rate = np.sqrt(1.0 + size**2)
    assert len(x) > 5 and x.min() >= 1.9 and x.max() <= 2.1
    assert np.abs(0.5 * np.pi * rate / ellipk(size**2 / (2.0 * rate**2)) / x - 1.0).max() < 1e-13
    assert run(capsys, *words, "--in", "F", "--range", "0.2:0.3", "--json", "s.json")[0] == 0
    (folder / "other.toml").write_text(FREE.replace("stiffness = 1.0", "stiffness = 2.0"), encoding="utf-8")
    assert run(capsys, "continue", "--scene", "other.toml", "--from", "mode:1", "--points", "9", "--json", "o.json")[0] == 0
    for line, expected in (
        ("r.json --beside b.json", "expected --plot FILE"),
        ("r.json --beside b.json --y period --plot g.png", "expected --y max:.. or rms:.."),
        ("r.json --beside b.json --x max:u1 --plot g.png", "a backbone is over the frequency"),
        ("s.json --beside b.json --plot g.png", "over F, which is not the frequency"),
        ("r.json --beside o.json --plot g.png", "other springs"),
        ("r.json --beside none.json --plot g.png", "cannot read none.json"),
    ):
        code, _, err = run(capsys, "plot", *line.split())
        assert code == 2 and expected in err and len(err.splitlines()) == 1, (line, err)


def test_a_response_has_the_columns_and_its_file_can_be_tabled_again(capsys, folder):
    """Oracle: Parseval's equation with the root mean square of the same file; the same columns from the file of responses."""
    (folder / "scene.toml").write_text(DUFFING, encoding="utf-8")
    words = ("continue", "--scene", "scene.toml", "--from", "rest", "--in", "w", "--range", "0.98:1.0", "--harmonics", "15")
    code, _, err = run(capsys, *words, "--json", "a.json", "--csv", "a.csv", "--plot", "a.png")
    assert code == 0 and not err and (folder / "a.png").stat().st_size > 10_000
    for point in read_branch("a.json")["points"]:
        squares = [point[f"harmonic.u1.{k}"] ** 2 for k in range(16)]
        assert abs(squares[0] + 0.5 * sum(squares[1:]) - point["rms.u1"] ** 2) < 1e-9
    assert run(capsys, "plot", "a.json", "--harmonics", "15", "--csv", "b.csv")[0] == 0
    assert (folder / "a.csv").read_text() == (folder / "b.csv").read_text()
