"""One degree of freedom, the simplest system with stops: x'' + w^2 x = 0 between stops. It has no nontrivial multipliers.

Oracle: closed forms. With the amplitude A = sqrt(2 h)/w of the free motion, a flight from x = -a to x = b takes (asin(b/A) + asin(a/A))/w.
So h = w^2/(2 sin^2(w alpha)) for |x| < 1, and h = w^2/(2 cos^2(2 w alpha)) for x < 1.
"""

import csv
import json
import math

import numpy as np
import pytest

import saltus
from branches.tracing import follow_family
from bvp.many_digits import orbit_in_digits
from bvp.multipoint import MultipointProblem
from bvp.stability import stability
from tests.saltus.running import reported

SCENE = """title = "a mass on a spring"
source = "a test"
[system]
mass = [[1.0]]
stiffness = [[{stiffness!r}]]
[[stops]]
c = [1.0]
{lower}
upper = 1.0
[bounds]
energy = [0.1, 20.0]
quarter_period = 5.0
impacts = 3
"""


def scene_of(folder, lower, stiffness=1.0):
    path = folder / "scene.toml"
    path.write_text(SCENE.format(stiffness=stiffness, lower="" if lower is None else f"lower = {lower}"), encoding="utf-8")
    return path


def oscillator(lower=-1.0, stiffness=1.0):
    return saltus.ImpactSystem([[1.0]], [[0.0]], [[stiffness]], (saltus.Stop((1.0,), lower, 1.0),))


def quarter_period(h, lower, w):
    """Of the orbit with energy h, the impacts counted that it has."""
    amplitude = math.sqrt(2.0 * h) / w
    quarters = [math.asin(min(1.0, bound / amplitude)) / w for bound in (1.0, math.inf if lower is None else -lower)]
    return 0.5 * sum(quarters)


def test_a_family_in_the_mass(tmp_path):
    """Oracle: the quarter period asin(1/A)/w at each mass; the multipliers are 1."""
    scene, path = scene_of(tmp_path, -1.0), tmp_path / "a.csv"
    text = scene.read_text().replace("[system]", "[parameters]\nm = 0.1\n[system]").replace("[[1.0]]", '[["m"]]', 1)
    scene.write_text(text)
    code, _, err = reported(f"continue --from mode:1 --scene {scene} --in m --range 0.05:0.11 --keep energy=0.8 --csv {path}")
    assert (code, err) == (0, ""), err
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    masses, quarters = (np.array([float(row[name]) for row in rows]) for name in ("m", "alpha"))
    assert len(rows) > 5 and np.ptp(masses) > 0.05
    assert np.abs(quarters / (np.sqrt(masses) * math.asin(1.0 / math.sqrt(1.6))) - 1.0).max() < 1e-12


@pytest.mark.parametrize("lower", [-1.0, None, -0.7])
@pytest.mark.parametrize("w", [1.0, 1.7])
def test_a_build_has_every_orbit_of_the_closed_form(tmp_path, lower, w):
    """Oracle: the period as a function of the energy; the grazings at w^2 d^2/2 of each bound d; stable, without multipliers."""
    scene, path = scene_of(tmp_path, lower, w * w), tmp_path / "a.sqlite"
    code, out, err = reported(f"build --scene {scene} --workers 1 --catalogue {path}")
    assert (code, err) == (0, ""), err
    assert reported(f"check --catalogue {path}")[0] == 0
    grazings = sorted({0.5 * (w * bound) ** 2 for bound in (1.0, lower or 1.0)})
    with saltus.Catalogue(path) as catalogue:
        branches = sorted((catalogue.branch(row.id) for row in catalogue.families()), key=lambda branch: branch.points["h"].min())
        kinds = [kind for _, kind in catalogue.graph().nodes(data="kind")]
    assert len(branches) == len(grazings) and kinds.count("linear mode") == 1
    for branch, low, high in zip(branches, grazings, [*grazings[1:], 20.0], strict=True):
        points = branch.points
        assert points["h"].min() == pytest.approx(low, rel=1e-12) and points["h"].max() == pytest.approx(high, rel=1e-12)
        # next to a grazing the period changes as the square root of the energy
        for h, alpha in zip(points["h"], points["alpha"], strict=True):
            near = min(abs(h / grazing - 1.0) for grazing in grazings)
            assert alpha == pytest.approx(quarter_period(h, lower, w), rel=1e-12 if near > 1e-6 else 1e-7)
        assert (points["stable"] == 1).all() and points["multipliers"].shape == (len(branch), 0) and points["reliable"].all()
        assert {event.type for event in branch.events} <= {"GR", "EP"} and all(event.multiplier == 1.0 for event in branch.events)


def test_files_figures_and_tables(tmp_path):
    """Oracle: h = 1/(2 sin^2 alpha) in each file; a file is a start again."""
    scene = scene_of(tmp_path, -1.0)
    names = {kind: tmp_path / f"a.{kind}" for kind in ("json", "csv", "npz", "mat")}
    files = " ".join(f"--{kind} {name}" for kind, name in names.items())
    code, out, err = reported(f"continue --from mode:1 --scene {scene} {files} --plot {tmp_path}/a.png")
    assert (code, err) == (0, "") and "unbounded" not in out and "warning" not in out
    rows = [row.split() for row in out.splitlines() if row.startswith(" ")]
    assert [row[1:2] + row[4:6] for row in rows[1:]] == [["EP", "yes", "1"], ["GR", "yes", "1"]]
    data = json.loads(names["json"].read_text())
    assert all(point["multipliers"] == [] and point["stable"] is True for point in data["points"])
    for point in data["points"][1:]:
        assert point["h"] == pytest.approx(0.5 / math.sin(point["alpha"]) ** 2, rel=1e-12)
    assert np.load(names["npz"])["h"] == pytest.approx([point["h"] for point in data["points"]], rel=0, abs=0)
    code, out, err = reported(f"continue --from {names['json']}@h=2.0 --scene {scene} --points 5 --save --catalogue {tmp_path}/a.sqlite")
    assert (code, err) == (0, "")
    id, place = data["branch"]["id"], f"--scene {scene} --catalogue {tmp_path}/a.sqlite"
    code, out, err = reported(f"orbit {id} --energy 2.0 {place} --json {tmp_path}/orbit.json --plot {tmp_path}/orbit.png")
    assert (code, err) == (0, "") and "stable   yes" in out
    assert json.loads((tmp_path / "orbit.json").read_text())["orbit"]["alpha"] == pytest.approx(math.pi / 6.0, rel=1e-12)
    assert reported(f"export fep {place} --plot {tmp_path}/fep.png --csv {tmp_path}/fep.csv")[0] == 0


CLOSURES = {
    "a quarter": (("origin", "stop+"), (), lambda speed: [0.0, math.hypot(1.0, speed)], 1),
    "a half": (("stop+", "stop-"), (), lambda speed: [1.0, -speed], 2),
    "periodic": (("periodic", "periodic"), ("+", "-"), lambda speed: [1.0, -speed], 2),
}


@pytest.mark.parametrize(("ends", "sequence", "start", "quarters"), CLOSURES.values(), ids=CLOSURES)
def test_each_closure_is_stable_without_multipliers(ends, sequence, start, quarters):
    """Oracle: the closed form along the family, whatever closes the orbit. No test function takes a grazing for a bifurcation."""
    system, alpha = oscillator(), 0.6
    problem = MultipointProblem(system, ends, sequence)
    flights = [quarters * alpha] * (len(sequence) or 1)
    speed = 1.0 / math.tan(alpha)
    nodes = [[-1.0, speed]] if sequence else None
    solution = problem.solve(problem.pack(start(speed), nodes, flights), quarter_period=alpha)
    found = stability(problem, solution)
    assert found.stable is True and found.tau.shape == found.nu.shape == (0,) and (found.tau_half is not None) is (quarters == 1)
    assert orbit_in_digits(problem, solution.y).stable is True
    branch = follow_family(problem, solution.y, energy=(0.3, 20.0))
    assert sorted(event.type for event in branch.events if event.type != "EP") == ["GR"]
    assert branch.points["h"][1:-1] == pytest.approx(0.5 / np.sin(branch.points["alpha"][1:-1]) ** 2, rel=1e-12)
    assert (branch.points["stable"] == 1).all() and "no nontrivial multipliers" in str(branch.orbit(3))


def test_a_free_mass_between_two_stops():
    """Oracle: its speed is 1/alpha."""
    problem = MultipointProblem(oscillator(stiffness=0.0), ("origin", "stop+"), ())
    branch = follow_family(problem, problem.pack([0.0, 2.0], None, [0.5]), energy=(0.1, 20.0))
    assert branch.points["h"] == pytest.approx(0.5 / branch.points["alpha"] ** 2, rel=1e-12)
    assert (branch.points["stable"] == 1).all() and {event.type for event in branch.events} == {"EP"}
