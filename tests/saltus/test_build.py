"""`saltus build`: a very small catalogue by two processes, browsed; bad input in one line."""

import json
import multiprocessing
import re

import numpy as np
import pytest
from scipy.linalg import expm

import saltus
from benchmarks.backbone import Backbone
from branches.catalogue import Catalogue
from saltus.terminal import ProgressBar
from tests.saltus.running import reported

SMALL = "--energy 0.06:0.4 --max-quarter-period 1.9 --max-impacts 2"


def test_a_small_build_is_browsed(tmp_path):
    """Oracle: the catalogue's own check, and the backbones of Lee et al. 2009 in its list."""
    path = tmp_path / "small.sqlite"
    code, out, err = reported(f"build {SMALL} --workers 2 --catalogue {path} --json {tmp_path}/report.json")
    assert (code, err) == (0, "") and "complete" in out
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["complete"] and report["bounds"]["quarter_period"] == 1.9 and report["failed"] == []
    code, out, err = reported(f"list --catalogue {path}")
    assert code == 0 and "S13O00+" in out and "S11O00-" in out
    assert reported(f"check --catalogue {path}")[0] == 0
    code, out, err = reported(f"build {SMALL} --catalogue {path}")
    assert code == 0 and f"done   {report['families']} families" in out
    other = SMALL.replace("impacts 2", "impacts 3")
    code, out, err = reported(f"build {other} --catalogue {path}")
    assert code == 2 and not out and err.count("\n") == 1 and "up to 2 impacts" in err and "up to 3 impacts" in err


def test_names_come_with_other_bounds(tmp_path):
    """Oracle: the same bounds without names; the scene names S95E22-, whose quarter period is 8.2, and at these
    energies U11+, and the two backbones. A scene without names has none."""
    plain, named = (tmp_path / f"{name}.sqlite" for name in ("plain", "named"))
    bounds = "--energy 0.3:0.5 --max-quarter-period 1.75 --max-impacts 1 --workers 1"
    assert reported(f"build {bounds} --catalogue {plain}")[0] == 0
    code, out, _ = reported(f"build {bounds} --named --catalogue {named}")
    assert code == 0 and "and 4 names" in out
    with Catalogue(plain) as few, Catalogue(named) as more:
        ids = [{row.id for row in one.families()} for one in (few, more)]
        assert ids[0] < ids[1] and more.find("S95E22-").id in ids[1] - ids[0]
        assert all(row.alpha[0] <= 1.75 for row in few.families())
    code, out, err = reported("build --scene three_mass_chain --named --energy 0.1:1 --max-quarter-period 2 --max-impacts 1")
    assert code == 2 and not out and "the scene has no table [names]" in err


def test_the_summary_says_what_fifty_digits_cost(tmp_path, monkeypatch):
    """Oracle: the report of the build, changed."""
    from branches.building import build as building

    real = building.build

    def build(*arguments):
        return real(*arguments) | {"digits": {"orbits": 12, "seconds": 3.25}, "missed": ["x: between two points"]}

    monkeypatch.setattr(building, "build", build)
    bounds = "--energy 0.051:0.055 --max-quarter-period 2 --max-impacts 1"
    code, out, err = reported(f"build {bounds} --workers 1 --catalogue {tmp_path}/a.sqlite")
    assert (code, err) == (0, "")
    assert "12 orbits solved in fifty digits to decide stability, in 3.2 s" in out and "1 event missed" in out


def test_another_system_builds_just_as_well(tmp_path):
    """Oracle: the catalogue's own check; the out-of-phase backbone is there from its fold on, which is at another energy."""
    path = tmp_path / "other.sqlite"
    bounds = "--mu 0.37 --sigma 0.81 --energy 0.41:0.9 --max-quarter-period 1.5 --max-impacts 2"
    assert reported(f"build {bounds} --workers 1 --catalogue {path}")[0] == 0
    assert reported(f"check --catalogue {path}")[0] == 0
    families = json.loads(reported(f"list --catalogue {path} --json -")[1])["families"]
    fold = next(family["h"][0] for family in families if family["label"] == "S11O00-")
    expected = saltus.trace("S11O00-", saltus.vibro_impact_nes(mu=0.37, sigma=0.81), energy=(0.41, 0.9)).points["h"].min()
    assert abs(fold / expected - 1.0) < 1e-9
    code, out, err = reported(f"build --energy 0.41:0.9 --max-quarter-period 1.5 --max-impacts 2 --catalogue {path}")
    assert code == 2 and err.count("\n") == 1 and "mu is" in err


@pytest.mark.parametrize(
    ("bounds", "expected"),
    [
        ("--energy 0.5:4 --max-quarter-period 1e-3 --max-impacts 3", "no orbit has so short a quarter period; the shortest"),
        (
            "--energy 0.055:0.05500001 --max-quarter-period 2 --max-impacts 1",
            "at h = 0.055 and at h = 0.05500001 no orbit within the impacts",
        ),
        ("--energy 0.01:0.02 --max-quarter-period 2 --max-impacts 1", "no motion reaches a stop below h = 0.05"),
    ],
)
def test_bounds_in_which_nothing_lies(tmp_path, bounds, expected):
    """Oracle: sigma/2, below which nothing impacts; U44-, the lowest family known, from h = 0.0585 on; and the closed form of S11O00-,
    the orbit with the shortest quarter period, at the highest energy."""
    code, out, err = reported(f"build {bounds} --workers 1 --catalogue {tmp_path}/a.sqlite")
    assert code == 0 and not err and "0 families" in out
    assert f"nothing lies inside the bounds: {expected}" in out and f": h {bounds.split()[1].replace(':', ' to ')}, " in out
    if "4 " in bounds:
        alpha = float(out.rpartition("energy is ")[2].partition(" ")[0])
        assert "(S11O00-, h = 4)" in out and abs(Backbone().energy(alpha) / 4.0 - 1.0) < 1e-4


def test_an_interrupted_build_says_that_what_was_finished_is_kept(tmp_path, monkeypatch):
    """Oracle: exit code 130 and one line; the file opens with the families that were finished; the same command ends well."""
    path = tmp_path / "small.sqlite"

    def interrupt(self, count, words=""):
        if count >= 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(ProgressBar, "update", interrupt)
        code, _, err = reported(f"build {SMALL} --workers 1 --catalogue {path}")
    assert code == 130 and err.count("\n") == 1 and "keeps what was finished" in err and str(path) in err
    code, out, _ = reported(f"list --catalogue {path}")
    assert code == 0 and "2 of 2 families" in out
    assert reported(f"build {SMALL} --workers 1 --catalogue {path}")[0] == 0


def test_a_worker_that_is_killed_is_reported(tmp_path, monkeypatch):
    """Oracle: exit code 1 and one line that says what to do; the same command ends well."""
    path = tmp_path / "small.sqlite"
    killed = []

    def kill(self, count, words=""):
        if not killed:
            killed.append(True)
            for worker in multiprocessing.active_children():
                worker.kill()

    with monkeypatch.context() as patched:
        patched.setattr(ProgressBar, "update", kill)
        code, _, err = reported(f"build {SMALL} --workers 1 --catalogue {path}")
    assert code == 1 and err.count("\n") == 1 and "a worker process was killed" in err and "the same command goes on" in err
    assert reported(f"build {SMALL} --workers 1 --catalogue {path}")[0] == 0


PLAIN = """title = "the reference system, and what it may have beside it"
source = "a test"
[system]
mass = {mass}
stiffness = {stiffness}
[[stops]]
c = {gap}
lower = -1.0
upper = 1.0
{more}
[bounds]
energy = [0.06, 0.4]
quarter_period = 1.9
impacts = 2
"""


def beside(folder, name, oscillators=(), more=""):
    """A scene of the reference system with oscillators of these frequencies, which nothing couples to it; its path."""
    size = 2 + len(oscillators)
    mass, stiffness = ([[0.0] * size for _ in range(size)] for _ in range(2))
    mass[0][0], mass[1][1] = 0.1, 1.0
    stiffness[0][0], stiffness[0][1], stiffness[1][0], stiffness[1][1] = 0.1, -0.1, -0.1, 1.1
    for i, frequency in enumerate(oscillators, 2):
        mass[i][i], stiffness[i][i] = 1.0, frequency**2
    path = folder / f"{name}.toml"
    path.write_text(PLAIN.format(mass=mass, stiffness=stiffness, gap=[1.0, -1.0] + [0.0] * (size - 2), more=more))
    return path


def built(folder, scene):
    """The families of the catalogue that is built of a scene, by ids without hashes and letters of stops; graph, report, output."""
    path = folder / "built.sqlite"
    path.unlink(missing_ok=True)
    code, out, err = reported(f"build --scene {scene} --workers 1 --catalogue {path} --json {folder}/report.json")
    assert (code, err) == (0, ""), err
    assert reported(f"check --catalogue {path}")[0] == 0
    with saltus.Catalogue(path) as catalogue:
        families = sorted((re.sub("a([+-])", r"\1", row.id.rpartition(":")[0]), *row.h, *row.alpha) for row in catalogue.families())
        graph = catalogue.graph()
    assert sum(kind == "linear mode" for _, kind in graph.nodes(data="kind")) >= 2
    return families, graph, json.loads((folder / "report.json").read_text()), out


FAR = "[[stops]]\nc = {gap}\nlower = -70.0\nupper = 70.0"


@pytest.mark.parametrize(("oscillators", "more"), [((0.15,), "")])
def test_what_is_beside_changes_no_family(tmp_path, oscillators, more):
    """Oracle: see `require_what_is_beside_changes_no_family`."""
    require_what_is_beside_changes_no_family(tmp_path, oscillators, more)


def require_what_is_beside_changes_no_family(tmp_path, oscillators, more):
    """Oracle: the families of the reference system, which the search of energies finds: all of them meet those of the linear modes. Slow
    oscillators that are coupled to nothing and stops that nothing reaches change none, in sequences, energies and quarter periods."""
    families, _, report, out = built(tmp_path, beside(tmp_path, "alone"))
    assert report["complete"] and "energies searched" in out and len(families) == 7
    more_families, graph, more_report, out = built(tmp_path, beside(tmp_path, "beside", oscillators, more))
    assert [id for id, *_ in more_families] == [id for id, *_ in families] and graph.number_of_edges() >= 7
    assert [row for _, *row in more_families] == [pytest.approx(row, rel=1e-9) for _, *row in families]
    last = max(name for name, kind in graph.nodes(data="kind") if kind == "linear mode")
    code, out_of_tree, err = reported(f"tree {last} --scene {tmp_path}/beside.toml --catalogue {tmp_path}/built.sqlite")
    assert code == 0 and out_of_tree.startswith(f"{last} (linear mode)  h 0:"), err
    assert not more_report["complete"] and more_report["open"] == [[0.06, 0.4]] and more_report["failed"] == []
    assert "families that begin at linear modes, and those that they meet" in out


def test_what_cannot_be_built_of_linear_modes(tmp_path):
    """Oracle: one line with what was received and expected; the energies at which the modes touch their stop, (w d / b)^2 / 2."""
    scene = beside(tmp_path, "named", (0.15,), '[names]\n"S13+" = {}')
    code, out, err = reported(f"build --scene {scene} --catalogue {tmp_path}/a.sqlite")
    assert code == 2 and not out and err.count("\n") == 1 and "the scene names S13+" in err and "expected no [names]" in err
    still = tmp_path / "still.toml"
    free, unit = [[0.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]]
    still.write_text(PLAIN.format(mass=unit, stiffness=free, gap=[1.0, -1.0], more=FAR.format(gap=[1.0, 0.0])))
    code, out, err = reported(f"build --scene {still} --catalogue {tmp_path}/a.sqlite")
    assert code == 2 and not out and err.count("\n") == 1 and "no linear mode of the system reaches a stop" in err
    more = "[[stops]]\nc = [0.0, 1.0]\nlower = 1.0\n"
    still.write_text(PLAIN.format(mass=unit, stiffness=[[1.0, 0.0], [0.0, 2.0]], gap=[1.0, -1.0], more=more))
    code, out, err = reported(f"build --scene {still} --catalogue {tmp_path}/a.sqlite")
    assert code == 2 and not out and err.count("\n") == 1 and "the rest position lies beyond stop" in err
    scene = beside(tmp_path, "beside", (0.15,))
    code, out, err = reported(f"build --scene {scene} --energy 0.01:0.02 --workers 1 --catalogue {tmp_path}/b.sqlite")
    assert (code, err) == (0, "") and "L2 at h = 0.118508, quarter period 1.83" in out
    for command in (f"discover --energy 0.3 --scene {scene}", f"continue S13+ --scene {scene}"):
        code, out, err = reported(command)
        assert code == 2 and not out and err.count("\n") == 1
        assert "two degrees of freedom; this system has 3: saltus continue --from mode:K and saltus build follow" in err


def test_a_family_of_a_mode_that_grazes_outside_the_energies_is_built(tmp_path):
    """Oracle: the family that `saltus continue --from mode:1` follows from its grazing at h = 0.1823 through the energies 0.2 to 0.3."""
    bounds = "--energy 0.2:0.3 --max-quarter-period 3.6 --max-impacts 1"
    assert reported(f"build --scene three_mass_chain {bounds} --workers 1 --catalogue {tmp_path}/a.sqlite")[0] == 0
    families = json.loads(reported(f"list --scene three_mass_chain --catalogue {tmp_path}/a.sqlite --json -")[1])["families"]
    branch = json.loads(reported("continue --scene three_mass_chain --from mode:1 --json -")[1])
    (family,) = [family for family in families if family["id"] == branch["branch"]["id"]]
    assert family["h"] == [pytest.approx(0.2), pytest.approx(0.3)]


TWO_STOPS = """title = "a chain of three masses between a stop at its end and one at its start"
source = "a test"
[system]
mass = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
stiffness = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
[[stops]]
c = [0.0, 0.0, 1.0]
upper = 1.0
[[stops]]
c = [1.0, 0.0, 0.0]
lower = -0.6
[bounds]
energy = [0.05, 0.4]
quarter_period = 4.0
impacts = 2
"""


def flown_round(orbit):
    """The largest error of an orbit that starts in the middle of its longest flight: gaps at its impacts, its return after the period, and
    how far any stop is passed between. By the exponential of the matrix of M u'' + K u = 0, and v <- v - 2 (c . v)/(c . M^-1 c) M^-1 c."""
    system, n, period = orbit.system, orbit.system.degrees_of_freedom, orbit.period
    inverse = np.linalg.inv(system.mass)
    field = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ system.stiffness, np.zeros((n, n))]])
    walls = {"a+": (np.array([0.0, 0.0, 1.0]), 1.0), "b-": (np.array([-1.0, 0.0, 0.0]), 0.6)}
    times = np.array([impact.time for impact in orbit.impacts])
    flights = np.diff(np.append(times, times[0] + period))
    longest = int(np.argmax(flights))
    begun = times[longest] + 0.5 * flights[longest]
    start = state = np.concatenate([part[0] for part in orbit.sample(np.array([begun]))])
    errors, now = [], 0.0
    for impact in sorted(orbit.impacts, key=lambda impact: (impact.time - begun) % period):
        time = (impact.time - begun) % period
        pieces = expm(field * (time - now) / 50)
        for _ in range(50):
            state = pieces @ state
            errors += [row @ state[:n] - bound for row, bound in walls.values()]
        row, bound = walls[impact.stop]
        errors.append(abs(row @ state[:n] - bound))
        push = inverse @ row
        state = np.concatenate([state[:n], state[n:] - 2.0 * (row @ state[n:]) / (row @ push) * push])
        now = time
    state = expm(field * (period - now)) @ state
    return max(*errors, *np.abs(state - start))


def test_families_that_hit_two_stops(tmp_path):
    """Oracle: matrix exponentials and the law of restitution, for orbits of each family that hits both stops, to 1e-10; `saltus check`.
    A rounding error grows by the multipliers: orbits with a multiplier above 1e4 are left out."""
    scene, place = tmp_path / "two.toml", tmp_path / "two.sqlite"
    scene.write_text(TWO_STOPS)
    code, _, err = reported(f"build --scene {scene} --workers 1 --catalogue {place}")
    assert (code, err) == (0, "")
    assert reported(f"check --scene {scene} --catalogue {place}")[0] == 0
    both, closed = 0, 0
    with saltus.Catalogue(place) as catalogue:
        for row in catalogue.families():
            branch = catalogue.branch(row.id)
            letters = [{impact.stop for impact in branch.orbit(k).impacts} for k in range(0, len(branch), 5)]
            both += {"a+", "b-"} in letters
            for k, hit in zip(range(0, len(branch), 5), letters, strict=True):
                values = branch.orbit(k).multipliers
                if hit == {"a+", "b-"} and np.all(np.isfinite(values)) and np.max(np.abs(values)) < 1e4:
                    assert flown_round(branch.orbit(k)) < 1e-10, (row.id, k)
                    closed += 1
    assert both >= 5 and closed > 3 * both
