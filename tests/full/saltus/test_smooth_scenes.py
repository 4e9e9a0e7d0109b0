"""Long cases of tests/saltus/test_smooth_scenes.py."""

import pytest

from tests.saltus import test_smooth_scenes as origin
from tests.saltus.running import read_branch, read_json, run
from tests.saltus.test_smooth_scenes import require_a_catalogue_is_built_of_smooth_families

pytestmark = origin.pytestmark


@pytest.mark.parametrize(
    ("scene", "bounds", "orbits"),
    [
        ("duffing_pair", ("--energy", "0.8:1", "--max-quarter-period", "1.6"), 2),
        ("cubic_and_stops", ("--energy", "1.9:2", "--max-quarter-period", "1", "--max-impacts", "1"), 1),
    ],
)
def test_a_catalogue_is_built_of_smooth_families(capsys, scene, bounds, orbits):
    """Oracle: see `require_a_catalogue_is_built_of_smooth_families`."""
    require_a_catalogue_is_built_of_smooth_families(capsys, scene, bounds, orbits)


def test_a_family_is_followed_to_its_impacts(capsys, folder):
    """Oracle: the impacting orbit of the reference scene with this energy, by the command that follows it."""
    arguments = ("--scene", "smooth_wall", "--in", "1/n", "--range", "0:0.12")
    code, out, _ = run(capsys, "continue", "S13+@h=5", *arguments, "--json", "a.json", "--csv", "a.csv", "--plot", "a.svg")
    assert code == 0 and "note   of 2 orbits" in out and "limit  1/n = 0: S13O00+, origin-stop+, sequence (none), h = 5" in out
    branch = read_branch("a.json")
    (limit,) = branch["limits"]
    assert run(capsys, "orbit", "S13O00+", "--energy", "5", "--json", "b.json")[0] == 0
    assert abs(limit["orbit"]["orbit"]["alpha"] / read_json("b.json")["orbit"]["alpha"] - 1.0) < 1e-11
    assert abs(min(point["1/n"] for point in branch["points"]) / 0.005 - 1.0) < 1e-9
    assert "1/n" in (folder / "a.csv").read_text().splitlines()[0] and 'id="response-limits"' in (folder / "a.svg").read_text()
    # The file shows the same again.
    code, again, _ = run(capsys, "show", "a.json")
    assert code == 0 and out[out.index("branch 1") : out.index("wrote")] == again


@pytest.mark.parametrize(
    ("words", "energy"),
    [
        ("S11- --scene cubic_nes --energy 1e-5:30 --plot a.png", (1e-5, 30.0)),
        ("S13+ --scene smooth_wall --n 10 --energy 0.02:60 --plot a.png", (0.02, 60.0)),
    ],
)
def test_families_are_followed_over_many_energies(capsys, folder, words, energy):
    """Oracle: the energies asked for, and the energy of each point from its start velocities: the springs are at rest there."""
    code, _, err = run(capsys, "continue", *words.split(), "--json", "a.json")
    points = read_json("a.json")["points"]
    assert code == 0 and not err and (folder / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (min(point["h"] for point in points), max(point["h"] for point in points)) == pytest.approx(energy, rel=1e-9)
    ratio = 0.05 if "cubic" in words else 0.1
    for point in points:
        u, v = point["velocities"]
        assert abs((ratio * u * u + v * v) / (2.0 * point["h"]) - 1.0) < 1e-12
