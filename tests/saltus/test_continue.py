"""`saltus continue` from end to end: the families that the closed form knows, those of the published figures, and other systems."""

import contextlib
import io
import json
import math
import re
import subprocess
import sys
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from benchmarks.backbone import Backbone
from saltus.__main__ import main


@cache
def reported(*words):
    """Exit code, standard output, standard error of a command, and the JSON that it wrote."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([*words, "--json", "-"])
    return code, json.loads(out.getvalue()) if out.getvalue() else None, err.getvalue()


def column(data, name):
    return np.array([point[name] for point in data["points"]])


def largest_error(data, backbone):
    """Largest relative difference from the closed form at any point: of h, and of the two initial velocities against the speed."""
    worst = 0.0
    for point in data["points"]:
        energy, velocities = backbone.energy(point["alpha"]), backbone.velocities(point["alpha"])
        sign = 1 if (point["velocities"][0] > 0) == (velocities[0] > 0) else -1
        size = mp.norm(mp.matrix(velocities))
        worst = max(worst, abs(point["h"] / energy - 1))
        worst = max(worst, *(abs(sign * a - b) / size for a, b in zip(point["velocities"], velocities, strict=True)))
    return float(worst)


def stability_faults(data, backbone):
    """Points whose stability is said and not so, and points where it is null although alpha decides it by a part in 1e9."""
    wrong, silent = [], []
    for i, point in enumerate(data["points"]):
        if point["stable"] is None:
            slow = backbone.impact_speed(point["alpha"]) < 1e-7 * math.sqrt(2.0 * point["h"])
            if not slow and backbone.stable(point["alpha"], 1e-8) is not None:
                silent.append((i, point["h"]))
        elif backbone.stable(point["alpha"]) is not point["stable"] and backbone.stable(point["alpha"], 1e-13) is not None:
            wrong.append((i, point["h"]))
    return wrong, silent


def changes(data):
    """Where the decided stability changes: pairs of indices of the points on both sides."""
    decided = [(i, point["stable"]) for i, point in enumerate(data["points"]) if point["stable"] is not None]
    return [(i, j) for (i, a), (j, b) in zip(decided, decided[1:], strict=False) if a is not b]


def types(data, *wanted):
    return [event for event in data["events"] if event["type"] in wanted]


# ---------------------------------------------------------------------------------------------------- the in-phase backbone


@pytest.mark.parametrize("name", ["S13O00+", "S11O00-"])
def test_backbones_are_the_closed_form(name):
    """Oracle: closed form in forty digits, with the relative error 1e-12 at every point; S11O00- is followed up to h = 1e4."""
    code, data, _ = reported("continue", name)
    assert code == 0 and len(data["points"]) > 100 and set(column(data, "label")) == {name}
    assert largest_error(data, Backbone()) < 1e-12
    assert name == "S13O00+" or math.isclose(column(data, "h").max(), 1e4, rel_tol=2e-10)


def test_in_phase_backbone_begins_at_the_grazing_of_the_linear_mode():
    """Oracle: the grazing energy w^2/(2 b^2) of the in-phase mode, 0.118507810593582, at a quarter of its period."""
    _, data, _ = reported("continue", "S13O00+")
    w, _, b = Backbone().modes[0]
    first = data["events"][0]
    assert first["type"] == "GR" and data["points"][0]["h"] == first["h"]
    assert abs(first["h"] / (w**2 / (2 * b**2)) - 1) < 1e-12 and abs(first["h"] / 0.118507810593582 - 1) < 1e-12
    assert abs(first["alpha"] / (mp.pi / (2 * w)) - 1) < 1e-10
    assert data["ended"][0]["reason"] == "EVENT" and "vanishes" in data["ended"][0]["text"]


def test_in_phase_backbone_ends_where_the_opposite_wall_is_touched():
    """Oracle: closed form: at the last alpha the gap coordinate reaches -1 and no further; the event names that wall."""
    _, data, _ = reported("continue", "S13O00+")
    last, backbone = data["events"][-1], Backbone()
    hit = "+" if data["branch"]["ends"][1] == "stop+" else "-"
    assert last["type"] == "GR" and last["stop"] == {"+": "-", "-": "+"}[hit] and f"touches stop {last['stop']}" in last["note"]
    alpha = mp.mpf(last["alpha"])
    g = backbone.half_period_sum(alpha)

    def gap(t):
        return sum(b * b * mp.sin(w * t) / (w * mp.cos(w * alpha)) for w, _, b in backbone.modes) / g

    turn = mp.findroot(lambda t: mp.diff(gap, t), 0.764)
    assert 0 < turn < alpha and abs(gap(turn) + 1) < 1e-9
    times = np.linspace(0.0, float(alpha), 2000)
    assert min(float(gap(t)) for t in times) > -1.0 - 1e-9 and max(float(gap(t)) for t in times[:-1]) < 1.0


def test_in_phase_backbone_has_one_change_of_stability_an_sb():
    """Oracle: tau_half of the closed form in forty digits."""
    _, data, _ = reported("continue", "S13O00+")
    backbone = Backbone()
    assert stability_faults(data, backbone) == ([], [])
    (before, after) = next(iter(changes(data)))
    assert len(changes(data)) == 1
    breaking = types(data, "SB", "BP", "SN", "PD")
    assert [event["type"] for event in breaking] == ["SB"]
    assert before <= breaking[0]["point"] <= after and after - before <= 2
    assert breaking[0]["breaks"] == "half-period symmetry"
    alpha, energy = backbone.where_tau_half_is(2 if backbone.tau_half(breaking[0]["alpha"]) > 0 else -2, 1.70, 1.72)
    assert abs(breaking[0]["alpha"] / alpha - 1) < 1e-10 and abs(breaking[0]["h"] / energy - 1) < 1e-9


def test_tau_half_is_that_of_the_closed_form():
    """Oracle: tau_half of the closed form in forty digits; each point, against what grazing magnifies."""
    compared = 0
    for name in "S13O00+", "S11O00-":
        _, data, _ = reported("continue", name)
        backbone = Backbone()
        for point in data["points"][::7]:
            if point["tau_half"] is None:
                continue
            expected = backbone.tau_half(point["alpha"])
            slow = float(backbone.impact_speed(point["alpha"])) / math.sqrt(2.0 * point["h"])
            assert abs(point["tau_half"] - expected) < 1e-11 * (1.0 + abs(expected)) / slow
            assert math.isclose(point["tau"], point["tau_half"] ** 2 - 2.0, rel_tol=1e-9, abs_tol=1e-9)
            compared += 1
    assert compared > 20


def test_a_process_of_its_own_computes_the_same():
    """Oracle: the same run inside this process."""
    command = [sys.executable, "-m", "saltus", "continue", "S13O00+", "--json", "-"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    _, data, err = reported("continue", "S13O00+")
    assert json.loads(done.stdout) == data and done.stderr == err


# ------------------------------------------------------------------------------------------------ the out-of-phase backbone

FOLD = 1.13584395619551, 0.0691164499682690


def test_out_of_phase_backbone_has_one_fold():
    """Oracle: closed form, dh/dalpha = 0 at alpha = 1.13584395619551 and h = 0.0691164499682690.

    A fold is known to 1e-10 in arclength, and its energy, which is stationary there, to rounding.
    """
    _, data, _ = reported("continue", "S11O00-")
    backbone = Backbone()
    with mp.workdps(40):
        alpha = mp.findroot(lambda a: mp.diff(backbone.energy, a), FOLD[0])
    assert abs(alpha / FOLD[0] - 1) < 1e-14
    folds = types(data, "SN")
    assert len(folds) == 1
    assert abs(folds[0]["alpha"] - float(alpha)) < 1e-10 and abs(folds[0]["h"] - FOLD[1]) < 1e-15
    low, high = folds[0]["bracket"]
    assert low <= folds[0]["arclength"] <= high and high - low < 2e-10


def test_out_of_phase_backbone_changes_stability_at_its_fold_alone():
    """Oracle: tau_half of the closed form; unstable from the fold to the grazing end at h = 0.0864921894064179, stable above."""
    _, data, _ = reported("continue", "S11O00-")
    assert stability_faults(data, Backbone()) == ([], [])
    fold = types(data, "SN")[0]
    h, alpha = column(data, "h").tolist(), column(data, "alpha").tolist()
    stable = [point["stable"] for point in data["points"]]
    for i, (a, said) in enumerate(zip(alpha, stable, strict=True)):
        if i not in [event["point"] for event in data["events"]]:
            assert said is (a < fold["alpha"]), (h[i], said)
    assert len(changes(data)) == 1 and not types(data, "SB", "BP")
    grazing = types(data, "GR")
    assert len(grazing) == 1 and abs(grazing[0]["h"] - 0.0864921894064179) < 1e-13
    undecided = [i for i, said in enumerate(stable) if said is None]
    assert set(undecided) <= {event["point"] for event in types(data, "GR", "SN", "PD")}


def test_resonances_of_the_backbones_are_where_the_closed_form_has_them():
    """Oracle: tau_half^2 - 2 = 2 cos(2 pi p/q) in the closed form; period doubling where tau_half = 0."""
    count = 0
    for name in "S13O00+", "S11O00-":
        _, data, _ = reported("continue", name)
        for event in types(data, "RT", "PD"):
            p, q = event["p_q"] or (1, 2)
            tau_half = math.copysign(2.0 * abs(math.cos(math.pi * p / q)), Backbone().tau_half(event["alpha"]))
            if event["type"] == "PD":
                tau_half = 0.0
            alpha, energy = Backbone().where_tau_half_is(tau_half, event["alpha"] * (1 - 1e-4), event["alpha"] * (1 + 1e-4))
            assert abs(event["alpha"] - alpha) < 2e-10 and abs(event["h"] / energy - 1) < 1e-9, event
            count += 1
    assert count >= 10


# --------------------------------------------------------------------------------------------------------- published families


def at_energy(data, energy):
    """Quarter periods at an energy, interpolated between the points on both sides of it."""
    h, alpha = column(data, "h"), column(data, "alpha")
    sides = [i for i in range(len(h) - 1) if (h[i] - energy) * (h[i + 1] - energy) <= 0.0]
    return [alpha[i] + (energy - h[i]) / (h[i + 1] - h[i]) * (alpha[i + 1] - alpha[i]) for i in sides]


@pytest.mark.parametrize(("name", "energy", "alpha", "digits"), [("S73O33-", 7.3348, 1.64595, 1e-5), ("U8353-", 1.9458, 4.9065, 1e-4)])
def test_published_families(name, energy, alpha, digits):
    """Oracle: Figs 7(b) and 7(c) of the paper, as many digits as they give; the states of the branch.

    At an IO the absorber has no velocity at an end where u = 0. At each end of the family an impact has no speed, or a stop is touched.
    """
    code, data, _ = reported("continue", name)
    assert code == 0 and data["branch"]["label"] == name
    assert min(abs(a - alpha) for a in at_energy(data, energy)) < digits
    code, orbit, _ = reported("orbit", name, "--energy", str(energy))
    assert code == 0 and orbit["orbit"]["label"] == name and abs(orbit["orbit"]["alpha"] - alpha) < digits
    assert types(data, "IO")
    for event in types(data, "IO"):
        point = data["points"][event["point"]]
        assert abs(point["velocities"][0]) < 1e-8 * math.hypot(*point["velocities"]) and event["status"] == "located"
        assert max(map(abs, point["start"]["u"])) == 0.0
    for place, ended in zip((0, -1), data["ended"], strict=True):
        event = data["events"][place]
        assert ended["reason"] == "EVENT" and event["type"] == "GR" and event["stop"] in ("+", "-")
        assert ended["text"].startswith("GR at h = ")
        slowest = min(data["points"][event["point"]]["impact_speeds"]) / math.sqrt(2.0 * event["h"])
        assert slowest > -1e-8 and ("touches" in event["note"] or slowest < 1e-8)


def test_without_the_reference_point_two_families_are_listed(tmp_path):
    """Oracle: two families carry S73O33-, near alpha = 1.646 and near 4.866; the reference point of the scene chooses the first."""
    scene = tmp_path / "unpinned.toml"
    system = '[system]\nmodel = "vibro_impact_nes"\nmu = 0.1\nsigma = 0.1\n'
    scene.write_text(system + "[bounds]\nenergy = [0.05, 1e4]\nquarter_period = 10.0\nimpacts = 16\n")
    code, data, err = reported("continue", "S73O33-", "--scene", str(scene))
    suffixes = re.findall(r"S73O33-@h=([0-9.e+-]+),alpha=([0-9.]+)", err)
    assert code == 2 and data is None and len(err.splitlines()) == 1 and "2 families" in err
    assert sorted(round(float(alpha), 2) for _, alpha in suffixes) == [1.65, 4.87]
    for h, alpha in suffixes:
        words = "continue", f"S73O33-@h={h},alpha={alpha}", "--scene", str(scene), "--points", "12"
        code, data, _ = reported(*words)
        assert code == 0 and min(abs(a - float(alpha)) for a in column(data, "alpha")) < 1e-3
    assert abs(column(reported("continue", "S73O33-")[1], "alpha")[0] - 1.646) < 1e-3


def test_the_seven_fold_cover_bifurcates_where_the_closed_form_says():
    """Oracle: S73O33- leaves the seven-fold cover of S11O00- where that has tau_half = 2 cos(6 pi/7): h = 0.840488860361179.

    The energy of the family is least there: the branch point is the fold, and it is reported once.
    """
    _, data, _ = reported("continue", "S73O33-")
    alpha, energy = Backbone().where_tau_half_is(2 * mp.cos(6 * mp.pi / 7), 0.2351, 0.2352)
    assert abs(energy - 0.840488860361179) < 1e-14
    born = types(data, "BP", "SN")
    assert [event["type"] for event in born] == ["BP"]
    assert abs(born[0]["h"] / energy - 1) < 1e-9 and abs(born[0]["alpha"] / (7 * alpha) - 1) < 1e-9


# -------------------------------------------------------------------------------------------------------------- other systems


@pytest.mark.parametrize("name", ["S13O00+", "S11O00-"])
def test_the_same_commands_on_another_system(name):
    """Oracle: closed form at mu = 0.37, sigma = 0.81: energies, velocities, stability, and one fold on each family."""
    code, data, _ = reported("continue", name, "--mu", "0.37", "--sigma", "0.81")
    backbone = Backbone(0.37, 0.81)
    assert code == 0 and data["system"]["mu"] == 0.37
    assert largest_error(data, backbone) < 1e-12
    assert stability_faults(data, backbone) == ([], [])
    assert [event["type"] for event in types(data, "SN", "SB", "BP")] == ["SN"]
    mode = backbone.modes[0 if name == "S13O00+" else 1]
    grazing = [event for event in types(data, "GR") if "vanishes" in event["note"]]
    assert len(grazing) == 1 and abs(grazing[0]["h"] / (mode[0] ** 2 / (2 * mode[2] ** 2)) - 1) < 1e-12
    assert set(column(data, "label")) == {name} and {event["label"] for event in data["events"]} == {name}


RANDOM = np.random.default_rng(20091868).uniform(0.02, 2.0, (6, 2)).round(3)


def check_backbone(mu, sigma):
    """Compare a backbone with its closed form; sigma = 0 is the free impact damper, whose relative motion has no stiffness.

    Several families may have the name then: the first is taken by the suffix that the program gives.
    """
    options = "--mu", str(mu), "--sigma", str(sigma), "--energy", "0.2:50"
    name = "S11O00-"
    code, data, err = reported("continue", name, *options)
    if code == 2:
        name = re.search(r"choose one of (\S+)", err)[1]
        code, data, err = reported("continue", name, *options)
    assert code == 0, err
    if sigma > 0.0:
        assert largest_error(data, Backbone(mu, sigma)) < 1e-12
        assert stability_faults(data, Backbone(mu, sigma)) == ([], [])
    else:
        for point in data["points"]:  # two modes: the LO with frequency 1, the free NES
            b = 1.0 / math.sqrt(mu)
            g = b * b * point["alpha"] + math.tan(point["alpha"])
            expected = (b * b + 1.0 / math.cos(point["alpha"]) ** 2) / (2.0 * g * g)
            assert math.isclose(point["h"], expected, rel_tol=1e-12)


@pytest.mark.parametrize(("mu", "sigma"), [*map(tuple, RANDOM[:2]), (0.1, 0.0)])
def test_random_and_extreme_systems(mu, sigma):
    """Oracle: see `require_random_and_extreme_systems`."""
    require_random_and_extreme_systems(mu, sigma)


def require_random_and_extreme_systems(mu, sigma):
    """Oracle: closed form."""
    check_backbone(mu, sigma)


# ------------------------------------------------------------------------------------------------------------ the command line


def test_each_line_has_what_was_asked_for():
    """Oracle: the events of the record: point number, type, label, energy, quarter period, stability, largest multiplier."""
    _, data, err = reported("continue", "S73O33-")
    lines = [line.split() for line in err.splitlines() if re.match(r" *-?\d+  [A-Z]{2} ", line)]
    assert len(lines) == len(data["events"])
    words = {True: "yes", False: "no", None: "undecided"}
    for event in data["events"]:
        line = next(line for line in lines if int(line[0]) == event["number"] and line[1] == event["type"])
        assert line[2] == event["label"] and line[5] == words[event["stable"]]
        assert math.isclose(float(line[3]), event["h"], rel_tol=1e-12) and math.isclose(float(line[4]), event["alpha"], rel_tol=1e-12)
        assert line[6] == "unbounded" if event["multiplier"] is None else math.isclose(float(line[6]), event["multiplier"], rel_tol=1e-7)
    assert err.startswith("start  ") and sum(line.startswith("end    ") for line in err.splitlines()) == 2


@pytest.mark.parametrize("name", ["S13O00+@h=0.5", "S11O00-@h=0.08,alpha=1.29", "S11O00-@h=0.08,alpha=0.91", "S11O00-"])
@pytest.mark.parametrize(("direction", "sign"), [("up", 1), ("down", -1)])
def test_the_first_step_goes_the_way_that_was_asked_for(name, direction, sign):
    """Oracle: the energies of the start and of the first step, on both sides of a fold; the other side says that it was not asked for."""
    code, data, _ = reported("continue", name, "--direction", direction, "--points", "3")
    h = column(data, "h")
    assert code == 0 and sign * (h[1] - h[0]) > 0.0
    assert any("not asked for" in end["text"] for end in data["ended"])


@pytest.mark.parametrize("points", [1, 2, 3, 7, 50])
def test_points_are_counted_in_total(points):
    """Oracle: the number asked for; it is the reason of the end."""
    code, data, _ = reported("continue", "S13O00+", "--points", str(points))
    assert code == 0 and len(data["points"]) == points
    assert any(end["reason"] == "POINTS" for end in data["ended"])


@pytest.mark.parametrize("bounds", ["0.2:0.7", "0.5:0.5000000001", "14.5:14.55", "1e11:1e12"])
def test_the_family_ends_on_the_bounds_of_the_energy(bounds):
    """Oracle: the bounds, to the 1e-10 in arclength to which events are located."""
    name = "S11O00-" if "e" in bounds else "S13O00+"
    code, data, _ = reported("continue", name, "--energy", bounds)
    low, high = map(float, bounds.split(":"))
    h = column(data, "h")
    assert code == 0 and math.isclose(h.min(), low, rel_tol=2e-10) and math.isclose(h.max(), high, rel_tol=2e-10)
    assert [event["type"] for event in (data["events"][0], data["events"][-1])] == ["EP", "EP"]
    assert largest_error(data, Backbone()) < 1e-12


def test_a_narrow_range_near_grazing_has_the_family():
    """Oracle: the family begins at 0.118507810593582, so it passes 0.1185079 to 0.1186."""
    code, data, err = reported("continue", "S13O00+", "--energy", "0.1185079:0.1186")
    assert code == 0, err
    h = column(data, "h")
    assert math.isclose(h.min(), 0.1185079, rel_tol=2e-10) and math.isclose(h.max(), 0.1186, rel_tol=2e-10)


def test_the_event_to_stop_at_is_the_last():
    """Oracle: closed form: going down the unstable part of S11O00- the fold is met before anything else."""
    code, data, _ = reported("continue", "S11O00-@h=0.08,alpha=1.29", "--direction", "down", "--stop-at", "SN")
    assert code == 0 and [event["type"] for event in data["events"]] == ["SN"]
    assert any(end["reason"] == "STOP_AT" for end in data["ended"])
    assert abs(data["events"][0]["h"] - FOLD[1]) < 1e-14


@pytest.mark.parametrize("name", ["S13", "S13O"])
def test_unfinished_labels_match_all_that_fit(name):
    """Oracle: see `require_unfinished_labels_match_all_that_fit`."""
    require_unfinished_labels_match_all_that_fit(name)


def require_unfinished_labels_match_all_that_fit(name):
    """Oracle: the answer is a family whose label begins so, or the list of the families that do."""
    code, data, err = reported("continue", name, "--energy", "0.05:1", "--points", "5")
    labels = [data["branch"]["label"]] if code == 0 else re.findall(r"([SU]\S+?)@h=", err.partition("choose one of")[2])
    stem = re.match(r"[SU]\d+", name)[0]
    assert labels and code in (0, 2) and all(label.startswith(stem) for label in labels), err
    assert code == 0 or len(err.splitlines()) == 1


def test_multipliers_that_are_not_reliable_are_reported(monkeypatch):
    """Oracle: the quality of the points; no point is doubtful here, so the limit is lowered for the test."""
    monkeypatch.setattr("branches.orbit.PAIRING_LIMIT", 1e-30)
    code, data, err = reported("continue", "S13O00+", "--energy", "0.2:0.3")
    doubtful = sum(not point["quality"]["reliable"] for point in data["points"])
    assert code == 0 and doubtful > 10
    assert re.search(rf"warning  the multipliers of {doubtful} of {len(data['points'])} points are not reliable", err)
    code, _, err = reported("orbit", "S13O00+", "--energy", "0.25")
    assert code == 0 and "NOT RELIABLE" in err


def test_lost_trivial_multipliers_are_reported(monkeypatch):
    """Oracle: the quality of the points; none is lost here, so the limit is lowered for the test."""
    monkeypatch.setattr("bvp.multipliers.TRIVIAL_LOST", 1e-30)
    code, data, err = reported("continue", "S13O00+", "--energy", "0.2:0.31")
    lost = sum(point["quality"]["trivial"] >= 1e-30 for point in data["points"])
    assert code == 0 and lost > 10
    assert f"the trivial multiplier of {lost} of {len(data['points'])} points is lost, between h = 0.2" in err


@pytest.mark.parametrize("words", ["--mu 1e300", "--sigma 1e300", "--sigma 1e-300", "--sigma 1e-320"])
def test_absurd_systems_give_one_line_or_an_answer(words):
    """Oracle: see `require_absurd_systems_give_one_line_or_an_answer`."""
    require_absurd_systems_give_one_line_or_an_answer(words)


def require_absurd_systems_give_one_line_or_an_answer(words):
    """Oracle: the exit code, and one line on standard error where there is no answer."""
    code = "import sys; from saltus.__main__ import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "continue", "S11O00-@h=1", *words.split(), "--points", "5", "--csv", "-"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode in (0, 2) and "Traceback" not in done.stderr and "Warning" not in done.stderr, done.stderr
    assert done.returncode == 0 or len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("S11O00-@h=0.075,alpha=0.975", 0.072, 0.08),
        ("S11O00-@h=0.075,alpha=0.975", 0.0749, 0.0751),
        ("periodic:+-:d56c77fd", 0.1, 0.1001),
    ],
)
def test_pieces_of_a_cut_family_are_reported(name, low, high):
    """Closed form: between its fold and its grazing S11O00- has two orbits at each energy, so a range there cuts it into two pieces, a
    range between two points of the family, too. d56c77fd falls and rises between two ends at one quarter period: again two."""
    code, data, said = reported("continue", name, "--energy", f"{low}:{high}")
    (other,) = data["branch"]["others"]
    assert code == 0 and sorted(other[side]["h"] for side in ("from", "to")) == pytest.approx([low, high], rel=1e-12)
    assert f"cut    the range of energies cuts {data['branch']['id']} into 2 pieces" in said
