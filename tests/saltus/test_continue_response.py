"""`saltus continue --in NAME`: starts, switches, files, messages, exit codes."""

import csv
import math

import numpy as np
import pytest

import saltus
from tests.saltus.running import read_branch, read_json, refused, run
from tests.saltus.test_bad_input import BEATING, DAMPED, FORCED, ONE_SIDED, PUSHED

pytestmark = pytest.mark.usefixtures("folder")

ABSORBER = ("continue", "--scene", "absorber", "--in", "w", "--range", "0.7:2.2")
SMALL = ("--set", "s=-0.2", "--start=-0.66,0", "--in", "s", "--range", "-0.4:0.1")


@pytest.fixture
def scene(folder):
    def write(text):
        (folder / "scene.toml").write_text(text, encoding="utf-8")
        return "scene.toml"

    return write


def events(record, k=0):
    return [event["id"] for event in record["branches"][k]["events"]]


def test_the_orbit_that_a_simulation_settles_on_is_followed_and_switched(capsys):
    """Oracle: design section 9: PD at s = -0.0685756522788391, GR at the amplitude of the steady motion; the doubled family."""
    words = "continue", "--scene", "impact_oscillator", "--from", "simulate", *SMALL, "--uz=-0.1,0"
    code, out, err = run(capsys, *words, "--json", "a.json", "--csv", "a.csv", "--plot", "a.png")
    assert code == 0, err
    assert out.splitlines()[0].startswith("start  a periodic motion of period 1 with 1 impacts")
    record = read_json("a.json")
    assert record["kind"] == "response" and record["parameter"] == "s"
    found = {event["id"]: event["values"]["s"] for event in record["branches"][0]["events"]}
    assert found["PD1"] == pytest.approx(-0.0685756522788391, abs=1e-13)
    assert sorted(value for name, value in found.items() if name.startswith("UZ")) == pytest.approx([-0.1, 0.0], abs=1e-9)
    with open("a.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    points = record["branches"][0]["points"]
    assert [float(row["max.x"]) for row in rows] == [point["max.x"] for point in points]
    code, out, err = run(capsys, "continue", "--from", "a.json:PD", "--json", "b.json", "--points", "30")
    assert code == 0 and "period 2 of the loads" in out, err
    assert read_json("b.json")["branches"][0]["load_periods"] == 2
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--range=-0.3:-0.1", "--json", "c.json")
    points = read_json("c.json")["branches"][0]["points"]
    assert code == 0 and min(point["s"] for point in points) == pytest.approx(-0.3) and max(p["s"] for p in points) == pytest.approx(-0.1)
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--in", "r", "--range", "0.75:0.85", "--points", "40")
    assert code == 0 and "r = 0.75" in out


def test_no_file_waits_for_an_id(capsys, monkeypatch):
    """Oracle: the id of the branch, which the same orbits of another range have; to follow the full family for a file is an error here."""
    words = "continue", "--scene", "impact_oscillator", "--from", "simulate", *SMALL
    with monkeypatch.context() as patched:
        patched.setattr("branches.forced.branch.full_response", None)
        assert run(capsys, *words, "--json", "a.json", "--csv", "a.csv")[0] == 0
        assert run(capsys, *words, "--range=-0.2:0", "--json", "b.json")[0] == 0
        assert run(capsys, "continue", "--from", "a.json:PD", "--json", "c.json", "--points", "30")[0] == 0
    one, other = (saltus.read_responses(name)[0] for name in ("a.json", "b.json"))
    assert read_json("a.json")["branches"][0]["id"] is None and one.known_id is None
    assert one.id == other.id and one.known_id == one.id
    saltus.save_responses([one], "d.json")
    assert saltus.read_responses("d.json")[0].known_id == read_json("d.json")["branches"][0]["id"] == one.id


def test_the_response_from_rest_ends_where_impacts_begin(capsys):
    """Oracle: the family of two impacts, followed from a simulation, ends at the same grazing; its symmetry is kept."""
    code, out, err = run(capsys, *ABSORBER, "--from", "rest", "--json", "rest.json")
    assert code == 0, err
    assert out.startswith("note   the response without impacts at w = 1 is no orbit: ")
    rest = read_json("rest.json")
    assert len(rest["branches"]) == 2 and all(branch["half"] and branch["sequence"] == "" for branch in rest["branches"])
    grazings = [event for branch in rest["branches"] for event in branch["events"] if event["type"] == "GR"]
    assert [event["neighbours"][0]["persists"] for event in grazings] == [True, False]
    # Symmetric orbits and those with one impact in the whole period have the same symbols.
    assert grazings[0]["neighbours"] == 2 * [{"sequence": "+", "persists": True}] and grazings[0]["symmetric"] == [True, False]
    both = "symmetric orbits with sequence + begin here (the motion persists); sequence + begins here (the motion persists)"
    assert both in out and both in run(capsys, "show", "rest.json")[1]
    code, out, err = run(capsys, *ABSORBER, "--from", "simulate", "--json", "two.json", "--plot", "two.png", "--y", "speed")
    assert code == 0 and "solved over half of the period" in out, err
    two = read_json("two.json")
    ends = [event["values"]["w"] for event in (two["branches"][0]["events"][-1], rest["branches"][1]["events"][0])]
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    assert "the response without impacts begins here (nonsmooth fold" in out
    code, out, err = run(capsys, "continue", "--from", "rest.json:2.GR1", "--uz", "1.5")
    assert code == 0 and "solved over half the period" in out and "w = 0.9873255" in out and "UZ1" in out, err
    code, out, err = run(capsys, "continue", "--from", "two.json:GR1", "--json", "many.json")
    assert code == 0 and "SB1" in events(read_json("many.json")), err
    code, out, err = run(capsys, "continue", "--from", "many.json:SB", "--json", "broken.json")
    assert code == 0 and len(read_json("broken.json")["branches"]) == 2, err
    refused(run(capsys, "continue", "--from", "rest.json:GR"), "rest.json:GR: matches GR1, 2.GR1; expected one of them")
    refused(run(capsys, "continue", "--from", "rest.json:PD1"), "has no event PD1", "it has EP1, GR1, 2.GR1, 2.EP1")
    refused(run(capsys, "continue", "--from", "rest.json:EP1"), "no other family begins at EP1", "PD, SB, BP, GR, LB")
    refused(run(capsys, "continue", "--from", "rest.json", "--range", "5:6"), "the range 5:6 has no point of the branch")
    refused(run(capsys, "continue", "--from", "rest.json", "--scene", "bouncing_ball"), "rest.json has another system")
    refused(run(capsys, "continue", "--from", "none.json", "--in", "w", "--range", "1:2"), "no file none.json", "FILE[:EVENT]")


@pytest.mark.parametrize("start", ["rest", "simulate"])
@pytest.mark.parametrize(
    ("c", "name", "interval"),
    [*((c, "A", "0.05:2") for c in (400.0, 1e4, 4e6, 4e8)), (1e6, "c", "1e3:1e7"), (1e6, "k", "0.5:3"), (1e6, "w", "0.5:2")],
)
def test_an_overdamped_response_is_followed(capsys, c, start, name, interval):
    """Oracle: the amplitude A/sqrt((k - w^2)^2 + c^2 w^2) of the linear response. It rounds by the slow rate k/c."""
    words = "--scene", "damped_impact_oscillator", "--set", f"c={c:g}", "--from", start, "--in", name, "--range", interval
    assert run(capsys, "continue", *words, "--json", "a.json")[0] == 0
    branch = read_branch("a.json")
    assert [event["type"] for event in branch["events"]] == ["EP", "EP"]
    for point in branch["points"]:
        exact = point["A"] / math.hypot(point["k"] - point["w"] ** 2, point["c"] * point["w"])
        assert point["max.x"] == pytest.approx(exact, rel=1e-12 + 1e-16 * c if name == "A" else 1e-9)


def test_an_overdamped_response_that_cannot_be_isolated_is_refused_once(capsys):
    """Oracle: the slow motion changes by 2 pi k/(c w) in a period."""
    words = "continue", "--scene", "damped_impact_oscillator", "--set", "c=4e10", "--in", "A", "--range", "0.05:2", "--from"
    err = refused(run(capsys, *words, "rest"), "no response without impacts at A = 0.1", "changes by a part 1.6e-10 in its period")
    assert err.count("isolated") == 1
    assert refused(run(capsys, *words, "simulate"), "changes by a part 1.6e-10 in its period").count("isolated") == 1


def test_an_overdamped_oscillator_at_a_stop_at_zero(capsys):
    """Oracle: the response about its rest at -d, with the amplitude of the linear response. It rounds by the slow rate k/c."""
    words = "--scene", "oscillator_at_wall", "--set", "c=1e5", "--in", "A", "--range", "0.1:2", "--json", "a.json", "--from"
    for start in (("rest",), ("simulate", "--start=-1,0", "--transient", "200")):
        assert run(capsys, "continue", *words, *start)[0] == 0
        for point in read_branch("a.json")["points"]:
            assert point["max.x"] == pytest.approx(1.0 + point["A"] / math.hypot(1.0 - 0.64, 0.8e5), rel=1e-11)
    refused(run(capsys, "continue", *words, "simulate"), "it has not settled yet; allow more periods (after 64", "more are expected")


def test_an_undamped_resonance_is_unbounded(capsys):
    """Oracle: x'' + x = cos(w t): unbounded at w = 1; elsewhere in range it reaches the stop before it is."""
    words = "continue", "--scene", "impact_oscillator", "--set", "w=1", "--set", "s=5", "--from", "rest", "--in", "w"
    code, out, err = run(capsys, *words, "--range", "0.5:1.5")
    assert code == 0, err
    assert out.startswith("note   the response without impacts is unbounded at w = 1: the load has the frequency of an undamped mode")
    assert "sequence + begins here" in out


@pytest.mark.parametrize("stop", [5.0])
def test_no_step_leads_over_a_resonance(capsys, stop):
    """Oracle: see `require_no_step_leads_over_a_resonance`."""
    require_no_step_leads_over_a_resonance(capsys, stop)


def require_no_step_leads_over_a_resonance(capsys, stop):
    """Oracle: the amplitude 1/(1 - w^2) reaches the stop at w^2 = 1 - 1/s and 1 + 1/s, however near to the resonance this is. At w = 1/2
    free motion has half the period of the load, and the response is bounded."""
    words = "continue", "--scene", "impact_oscillator", "--set", "w=0.8", "--set", f"s={stop}", "--from", "rest", "--in", "w"
    code, out, err = run(capsys, *words, "--range", "0.5:1.5", "--json", "a.json")
    assert code == 0 and out.startswith("note   the response without impacts is not isolated at w = 0.5"), (out, err)
    below, above = (
        next(event["values"]["w"] for event in branch["events"] if event["type"] == "GR") for branch in read_json("a.json")["branches"]
    )
    assert below == pytest.approx(math.sqrt(1.0 - 1.0 / stop), rel=1e-13) and above == pytest.approx(math.sqrt(1.0 + 1.0 / stop), rel=1e-13)


def test_a_response_that_grazes_at_the_start_is_followed_once(capsys):
    """Oracle: COCO's oscillator grazes at A = 0.1 exactly, the scene's value; both families are on the lower side."""
    words = "continue", "--scene", "damped_impact_oscillator", "--from", "rest", "--in", "A", "--range", "0.05:0.2"
    code, out, err = run(capsys, *words, "--json", "a.json")
    assert code == 0 and "sequence + begins here (nonsmooth fold" in out, err
    (branch,) = read_json("a.json")["branches"]
    assert branch["events"][-1]["type"] == "GR" and branch["events"][-1]["values"]["A"] == pytest.approx(0.1, abs=1e-12)


def test_what_is_no_orbit_ends_with_1(capsys):
    code, out, err = run(capsys, "continue", "--scene", "impact_oscillator", "--from", "simulate", "--in", "s", "--range", "-1:1")
    assert code == 1 and out == "" and err.startswith("saltus: chaotic motion")


LINEAR = ("--scene", "impact_oscillator", "--set", "s=50", "--start", "0.3,0", "--in", "s", "--range", "10:60")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--set", "w=1.4142135623730951", *LINEAR, "--transient", "3000"), "saltus: probably quasiperiodic motion (a torus)"),
        (("--set", "w=1.4142135623730951", *LINEAR, "--transient", "64"), "saltus: it has not settled yet; allow more periods (after 64"),
        (
            ("--scene", "bouncing_ball", "--set", "Gamma=0.5", "--in", "Gamma", "--range", "0.1:1"),
            "saltus: rest: it sticks to its stops for ever",
        ),
    ],
)
def test_what_a_simulation_finds_is_reported_with_its_rate(capsys, words, expected):
    """Oracle: an undamped linear oscillator keeps its own frequency; a ball rests on a table that accelerates less than gravity."""
    code, out, err = run(capsys, "continue", "--from", "simulate", *words)
    assert code == 1 and out == "" and err.startswith(expected) and "growth" in err


def test_the_period_that_a_simulation_finds_is_followed(capsys):
    """Oracle: behind the period doubling of design section 9 the motion has two impacts in two periods."""
    words = "continue", "--scene", "impact_oscillator", "--set", "s=-0.05", *SMALL[2:]
    code, out, err = run(capsys, *words, "--from", "simulate", "--points", "3")
    assert code == 0 and "a periodic motion of period 2 with 2 impacts" in out and "period 2 of the loads; 3 points" in out, err


CASES = [
    ("--in omega --range 0.7:2", ["--in omega: no such parameter", "mu, sigma"]),
    ("--in F --range 1:2", ["--range 1:2 has not the start's value F = 0.3", "--set F=VALUE"]),
    ("--in w", ["--range LO:HI is required"]),
    ("--in w --range 2:1", ["LO:HI with LO < HI"]),
    ("--in w --range 0.7:2 --start 5,0,0,0", ["the start lies beyond stop", "expected -1 to 1"]),
    ("--in w --range 0.7:2 --start 5,0", ["--start has 2 numbers, expected 4: u1,u2,u1',u2'"]),
    ("--in w --range 0.7:2 --y max:u3", ["--y: unknown column 'max:u3'; nearest: max:u"]),
    ("--in w --range 0.7:2 --x maxx:u2", ["--x: unknown column 'maxx:u2'; nearest: max:u2"]),
    ("--in w --range 0.7:2 --x speed", ["--x speed is a curve for each impact; expected speed:1"]),
    ("--in w --range 0.7:2 --uz max:u3=1", ["--uz: unknown column 'max:u3'"]),
    ("--in w --range 0.7:2 --energy 1:2", ["--energy belongs to families in the energy", "--range"]),
    ("--in w --range 0.7:2 --uz 1,x", ["received '1,x', expected values X1,X2,.. of the parameter"]),
    ("--in w --range 0.7:2 S13O00+", ["S13O00+ is a free orbit, and the scene has [[forces]]", "--from simulate"]),
]


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_bad_input(capsys, words, expected):
    refused(run(capsys, "continue", "--scene", "absorber", "--from", "simulate", *words.split()), *expected)


def test_bad_input_of_starts(capsys):
    for start in ("rest", "simulate"):
        refused(run(capsys, "continue", "--scene", "absorber", "--from", start, "--range", "0.7:2"), "--in NAME is required", "mu, sigma")
    refused(run(capsys, *ABSORBER), "--from is required with --in: rest, simulate")
    refused(run(capsys, *ABSORBER, "--from", "rest", "--start", "0,0,0,0"), "--start is an option of a simulation")
    refused(run(capsys, "continue", "S13O00+", "--range", "1:2"), "--range is an option of a response; expected --in NAME")


def test_scenes_without_a_response_are_refused(capsys, scene):
    words = "continue", "--from", "rest", "--range", "0.5:2"
    refused(run(capsys, *words, "--in", "rho"), "the response to periodic loads, and the scene has no load")
    refused(run(capsys, *words, "--in", "w", "--scene", scene(BEATING)), "1.0 and 1.4142135 are incommensurate")
    refused(run(capsys, *words, "--in", "f", "--scene", scene(PUSHED)), "constant", "expected a load with amplitude")
    refused(run(capsys, "continue", "S13O00+", "--scene", scene(FORCED)), "without loads", "[[forces]]", "--in NAME", "saltus run")
    refused(run(capsys, "continue", "S11O00+", "--scene", scene(DAMPED)), "conservative", "damping acts on", "--in NAME")
    unused = ONE_SIDED.replace("[system]", "[parameters]\nzz = 1.0\n[system]")
    refused(run(capsys, *words, "--in", "zz", "--scene", scene(unused)), "zz", "used nowhere")
    load = '[parameters]\nw = 1.0\n[[forces]]\non = "u1"\namplitude = 0.1\nharmonic = 1\n'
    twice = ONE_SIDED.replace("[system]", "[system]\ndamping = [[0.1]]") + "[[stops]]\nc = [-2.0]\nlower = -1.0\n" + load
    refused(run(capsys, *words, "--in", "w", "--scene", scene(twice)), "stops a and b end the same gap at the same place, 0.5 of stop a")


def test_a_file_of_responses_is_shown_drawn_and_laid_over_a_sweep(capsys, folder):
    """Oracle: the sweep settles on the stable parts of the branch."""
    words = "--scene", "impact_oscillator", "--set", "s=-0.2"
    simulated = "--from", "simulate", "--start=-0.66,0", "--in", "s", "--range=-0.4:-0.1"
    code, _, err = run(capsys, "continue", *words, *simulated, "--json", "a.json")
    assert code == 0, err
    code, out, _ = run(capsys, "show", "a.json", "--plot", "b.png")
    assert code == 0 and out.startswith("branch 1: sequence +; period 1 of the loads") and (folder / "b.png").exists()
    assert run(capsys, "plot", "a.json", "--y", "phase:1", "--plot", "c.png", "--csv", "c.csv")[0] == 0
    refused(run(capsys, "plot", "a.json", "--y", "fase:1", "--plot", "c.png"), "unknown column 'fase:1'; nearest: phase:1")
    refused(run(capsys, "plot", "a.json", "--plot", "a.txt"), "png, pdf or svg")
    swept = "sweep", "--in", "s", "--range=-0.4:-0.1", "--points", "3", "--start=-0.9,0", "--plot", "d.png", "--over", "a.json"
    assert run(capsys, *swept, *words)[0] == 0 and (folder / "d.png").exists()
    refused(run(capsys, *swept, *words, "--set", "r=0.7"), "--over a.json has another system or other parameters")
    refused(run(capsys, *swept, *words, "--y", "impacts"), "--over: a response has no impacts as a sweep has it")
    refused(run(capsys, "sweep", *words, "--in", "w", "--range", "2:3", "--plot", "d.png", "--over", "a.json"), "is over s, expected w")
    refused(run(capsys, "sweep", *words, "--in", "s", "--range=-0.4:-0.1", "--over", "a.json"), "--over draws on the figure")
    (folder / "e.json").write_text("{}", encoding="utf-8")
    refused(run(capsys, *swept[:-1], "e.json", *words), "e.json holds no response")


def test_a_family_goes_on_where_impacts_exchange_their_order(capsys):
    """Oracle: behind the exchange a simulation settles on the family's orbit, with the impacts in the other order."""
    words = "continue", "--scene", "forced_chain", "--from", "simulate", "--in", "w", "--range", "0.5:0.7"
    code, _, err = run(capsys, *words, "--uz", "0.68", "--json", "a.json")
    assert code == 0, err
    first, second = read_json("a.json")["branches"][:2]
    assert first["events"][-1]["type"] == "LB" and (first["sequence"], second["sequence"]) == ("a+b+", "b+a+")
    before, behind = first["points"][-1], second["points"][0]
    assert before["w"] < behind["w"] < before["w"] + 0.01
    assert np.ptp(before["phase"]) < 1e-7 < np.ptp(behind["phase"])
    marked = next(event["point"] for event in second["events"] if event["type"] == "UZ")
    fraction, *state = second["points"][marked]["unknowns"][:7]  # others attract, too
    start = f"--start={','.join(map(repr, state))}", "--phase", 2.0 * math.pi * fraction
    code, _, err = run(capsys, *words, "--set", "w=0.68", *start, "--points", "3", "--json", "b.json")
    assert code == 0, err
    (branch,) = read_json("b.json")["branches"]
    settled, followed = branch["points"][branch["start"]], second["points"][marked]
    assert settled["stable"] and followed["stable"]
    assert settled["max.x1"] == pytest.approx(followed["max.x1"], rel=1e-9)
    assert settled["speed"] == pytest.approx(followed["speed"], rel=1e-9)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--in", "w,A"], ["--in w,A needs 1 equation --keep; received 0"]),
        (["--in", "w", "--keep", "A = w"], ["--in w needs no --keep, and one with --in w,NAME; received 1"]),
        (["--in", "w,A", "--keep", "A = w", "--keep", "c = w"], ["needs 1 equation --keep; received 2"]),
        (["--in", "w,w", "--keep", "A = w"], ["--in w,w: a parameter is given twice"]),
        (["--in", "w,B", "--keep", "B = w"], ["--in B: no such parameter", "A"]),
        (["--in", "w,", "--keep", "B = w"], ["received 'w,', expected names of parameters, NAME1,NAME2"]),
        (["--in", "w,A", "--keep", "A = amplitude"], ["the equation 'A = amplitude' has the name amplitude, which is no parameter"]),
        (["--in", "w,A", "--keep", "A + w"], ["an equation is LEFT = RIGHT", "received 'A + w'"]),
        (["--in", "w,A", "--keep", "A**2 + w**2 = 0"], ["A**2 + w**2 = 0 cannot be solved for A at w = 1, near A = 0.1"]),
        (["--in", "w,A", "--keep", "w = 1"], ["w = 1 cannot be solved for A"]),
        (["--in", "w,A", "--keep", "A = 1/(w - 1)"], ["cannot be solved for A at w = 1"]),
        (["--in", "w,e", "--keep", "e = 1.2*w"], ["restitution", "1.2"]),
    ],
)
def test_bad_equations(capsys, words, expected):
    refused(run(capsys, "continue", "--scene", "damped_impact_oscillator", "--from", "rest", "--range", "0.5:2", *words), *expected)


def test_equations_need_their_parameters(capsys):
    refused(run(capsys, "continue", "S13O00+", "--keep", "A = w"), "--keep is an option of a response; expected --in NAME")


def test_a_simulated_motion_that_sticks_is_followed(capsys):
    """Oracle: without damping and at half of the natural frequency the contact force at the impact is zero at s = 0 exactly."""
    words = "--scene", "impact_oscillator", "--set", "r=0", "--set", "s=-0.5", "--set", "w=0.5"
    started = "--from", "simulate", "--start=-0.6,0", "--in", "s", "--range=-0.6:0.2"
    code, out, err = run(capsys, "continue", *words, *started, "--json", "a.json")
    assert code == 0, err
    assert out.splitlines()[2].startswith("branch 1: sequence +=; period 1 of the loads")
    event = read_json("a.json")["branches"][0]["events"][-1]
    assert event["type"] == "GR" and abs(event["values"]["s"]) < 1e-10 and event["neighbours"][0]["sequence"] == "++="
    code, out, err = run(capsys, "continue", "--from", "a.json:GR", "--json", "b.json", "--points", "20")
    assert code == 0, err
    assert out.startswith("branch 1: sequence ++=")
    assert run(capsys, "show", "b.json")[0] == 0
    code, out, err = run(capsys, "continue", *("r=0.4" if word == "r=0" else word for word in words), *started)
    assert code == 0 and "without end" not in err, err
    assert out.splitlines()[2].partition(";")[0].endswith("+=")
    code, out, err = run(capsys, "continue", "--from", "a.json", "--in", "r", "--range", "0:0.1")
    assert code == 0 and "highest value of r asked for" in out, err


def test_the_families_behind_events_are_followed(capsys):
    """Oracle: branch by branch, the same values of the events; what is not followed is said."""
    words = "continue", "--scene", "absorber", "--from", "rest", "--in", "w", "--range", "0.98:2.2", "--set", "w=2"
    code, out, err = run(capsys, *words, "--through", "GR", "--json", "a.json")
    assert code == 0, err
    found = read_json("a.json")["branches"]
    assert [len(branch["sequence"]) for branch in found if branch["half"]] == [0, 1, 2]
    assert "left " not in out
    code, out, _ = run(capsys, *words, "--json", "b.json")
    code, _, err = run(capsys, "continue", "--from", "b.json:GR1", "--json", "c.json")
    assert code == 0, err
    second = read_json("c.json")["branches"][0]
    assert [event["values"]["w"] for event in second["events"]] == [event["values"]["w"] for event in found[1]["events"]]
    code, out, _ = run(capsys, *words, "--through", "GR", "--branches", "1")
    assert code == 0 and "left   1 starts were not followed, with 1 families; --branches N allows more" in out
    refused(run(capsys, *words, "--through", "GR,XY"), "--through XY: no family begins at such an event; expected some of GR, SB, PD, BP")
    refused(run(capsys, *words, "--branches", "3"), "--branches is the largest number of families with --through")
    refused(run(capsys, "continue", "S11O00-", "--through", "GR"), "--through is an option of a response")
