"""The speed-error benchmark. Oracles: closed forms, a second method in many digits, the equations themselves. No time is asserted."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest

import saltus
from benchmarks import cases
from benchmarks.__main__ import main
from benchmarks.backbone import DIGITS, Backbone
from benchmarks.peers.auto import Auto07p
from benchmarks.peers.collocation import Collocation
from benchmarks.peers.integrators import INTEGRATORS, Integrator, PeriodShooting
from benchmarks.peers.nonsmooth_time import NonsmoothTime
from benchmarks.peers.shooting import ShootingError
from benchmarks.report import BEGIN, END, check_page
from benchmarks.speed_error.command import DATA, FILES, GROWTH, METHODS, PRECISION, ROWS, fill, measure, read_results
from benchmarks.speed_error.exact import EXACT
from benchmarks.speed_error.methods import SHORT_STEP, Answer, OrbitAnswer
from benchmarks.speed_error.references import reference_orbit, reference_run
from benchmarks.speed_error.results import best_rows, tables
from benchmarks.speed_error.rows import FULL, QUICK, Effort, RowFile, growth
from benchmarks.speed_error.tasks import IN_PHASE, OUT_OF_PHASE, TASKS, OrbitTask, multiplier_error
from saltus.errors import BadInput
from saltus.outputs import WriteFailure
from tests.benchmarks.methods import Absent, Astray, Failing, Interrupted, Plain
from tests.branches.many_digits import ManyDigits

TINY = Effort("tiny", None, None, (1e-2, 1e-4), 0.0, 60.0, 300.0, (1, 2), (2, 3), (1.8,))
ORBITS = [task for task in TASKS.values() if isinstance(task, OrbitTask)]


# -- reference values ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", [IN_PHASE, OUT_OF_PHASE], ids=lambda task: task.name)
def test_orbits_in_digits_are_the_closed_form(task):
    """Oracle: the closed form of one impact a half period, which shares nothing with the multipoint equations."""
    exact, found = task.exact(), reference_orbit(task.problem, task.unknowns(), task.alpha)
    with mp.workdps(DIGITS):
        assert abs(found.h / exact.h - 1) < mp.mpf(10) ** -35
        for a, b in zip(found.velocities, exact.velocities, strict=True):
            assert abs(a / b - 1) < mp.mpf(10) ** -35
        for a, b in zip(found.multipliers, exact.multipliers, strict=True):
            assert abs(a / b - 1) < mp.mpf(10) ** -33


@pytest.mark.parametrize("task", [task for task in ORBITS if not task.closed], ids=lambda task: task.name)
def test_orbits_in_digits_are_those_of_single_shooting(task):
    """Oracle: single shooting over the whole period in fifty digits, next to the same orbit in double precision; it may lie apart from that
    along the family by some units of rounding, so that its trace is another one by as much."""
    from branches.orbit import Orbit

    orbit = Orbit(task.problem, task.problem.solve(task.unknowns(), quarter_period=task.alpha))
    other = ManyDigits(orbit)
    exact = task.exact()
    assert exact.residual < mp.mpf(10) ** -40
    # The trace changes by up to 1e4 as much as the orbit.
    assert abs(float(abs(mp.re(sum(exact.multipliers))) - 2 - other.margin)) < 1e-8


def test_a_reference_orbit_sees_wrong_equations():
    """Oracle: a start from which Newton's corrections settle on no orbit of the sequence is refused, and other ends are."""
    problem, y = IN_PHASE.problem, IN_PHASE.unknowns()
    with pytest.raises(ArithmeticError, match="did not settle"):
        reference_orbit(problem, 3.0 * y, IN_PHASE.alpha)
    other = saltus.trace("S13O00+", energy=(0.5, 0.6)).problem.__class__(saltus.vibro_impact_nes(), ("rest", "rest"), ("+",))
    with pytest.raises(ValueError, match="start at the origin"):
        reference_orbit(other, np.ones(other.unknowns), 1.0)


def test_a_reference_run_is_the_closed_form_where_nothing_is_lost():
    """Oracle: S13O00+ hits at 1.65, 4.95, ...; its start is rounded to double precision."""
    task = IN_PHASE
    velocities = np.array([float(v) for v in task.exact().velocities])
    found = reference_run(task.system, velocities, 6)
    assert float(found.time) == pytest.approx(11 * task.alpha, rel=1e-14)
    assert float(found.energy) == pytest.approx(float(task.exact().h), rel=1e-14)
    u = np.array([float(x) for x in found.state[:2]])
    assert u[0] - u[1] == pytest.approx(-1.0, abs=1e-14)


def test_a_damped_reference_run_keeps_the_balance_of_energies():
    """Oracle: an integrator of the motion with its dissipation, run by run of the tolerance; and restitution at each impact."""
    system = saltus.vibro_impact_nes(mu=0.1, sigma=0.1, lam=0.05, rho=0.8)
    found = reference_run(system, np.array([2.9, 4.4]), 5)
    integrator = Integrator(system, "DOP853", 1e-13)
    y, now = np.array([[0.0], [0.0], [2.9], [4.4]]), 0.0
    for _ in range(5):
        duration, y, hit = integrator.flight(y, 1e3)
        assert hit
        y, now = integrator.impact(y), now + duration
    assert float(found.time) == pytest.approx(now, rel=1e-11)
    np.testing.assert_allclose([float(x) for x in found.state], y[:, 0], rtol=1e-10)


def test_special_points_of_the_closed_form():
    """Oracle: at the fold, where dh/dalpha = 0, the trace of the half map is 2; the published values are near."""
    backbone = Backbone()
    with mp.workdps(DIGITS):
        alpha, h = backbone.fold(1.05, 1.2)
        assert abs(backbone.tau_half(alpha) - 2) < mp.mpf(10) ** -30
        assert abs(h - mp.mpf("0.0691164499")) < 1e-9
        alpha, h = backbone.symmetry_breaking(1.7, 1.73)
        assert abs(backbone.tau_half(alpha) + 2) < mp.mpf(10) ** -30


# -- methods --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", EXACT, ids=lambda method: method.name)
@pytest.mark.parametrize("task", ORBITS, ids=lambda task: task.name)
def test_orbits_of_saltus(task, method):
    """Oracle: the closed form or fifty digits. U8353- and U(16)588- change a thousand times as much as their quarter period."""
    answer = method.prepare(task, None).once()
    errors = task.errors(answer)
    bound = 1e-13 if task.closed else 1e-11
    assert errors.orbit < bound and errors.energy < bound and errors.located is None
    if method.route == "none":
        assert errors.multipliers is None
    elif method.route != "saltation":
        assert errors.multipliers < (1e-11 if task.closed else 1e-6)


@pytest.mark.parametrize("method", EXACT[:3], ids=lambda method: method.name)
def test_points_along_a_family_are_all_right(method):
    """Oracle: the closed form at each point's own quarter period. Layers sum to the point; short steps stay near. A family has no
    test functions but the fold where only orbits are followed."""
    answer = method.prepare(IN_PHASE, None).measured()
    errors = IN_PHASE.errors(answer)
    assert max(errors.orbit, errors.energy, 0.0 if method.route == "none" else errors.multipliers) < 1e-12
    if method.route == "none":
        return
    if method is EXACT[1]:
        assert 0.0 < math.log(answer.orbits[-1].energy / answer.orbits[0].energy) < answer.points * SHORT_STEP
        return
    assert answer.points > 8 and len(answer.orbits) == 4 and len({orbit.alpha for orbit in answer.orbits}) == 4
    layers = {name: seconds for name, (seconds, _) in answer.layers.items()}
    assert layers.pop("total") == pytest.approx(sum(layers.values()), rel=1e-9)


def test_the_run_and_the_special_points_of_saltus():
    """Oracle: the run in fifty digits, here of its first 50 impacts; roots of the closed form."""
    short = replace(TASKS["damped"], impacts=50)
    errors = short.errors(EXACT[0].prepare(short, None).once())
    assert errors.orbit < 1e-12 and errors.energy < 1e-12
    task = TASKS["located"]
    assert task.errors(EXACT[0].prepare(task, None).once()).located < 1e-9


@pytest.mark.parametrize("method", INTEGRATORS[:3], ids=lambda method: method.integrator)
def test_integrators_come_nearer_with_their_tolerance(method):
    """Oracle: see `require_integrators_come_nearer_with_their_tolerance`."""
    require_integrators_come_nearer_with_their_tolerance(method)


def require_integrators_come_nearer_with_their_tolerance(method):
    """Oracle: the closed form; orbit, energy, multipliers and located points within a few hundred tolerances."""
    for task in (IN_PHASE, TASKS["located"]):
        for rtol in (1e-5, 1e-9):
            errors = task.errors(method.prepare(task, rtol).once())
            known = [error for error in errors if error is not None]
            assert known and max(known) < 300.0 * rtol


def test_shooting_finds_a_wrong_saltation_matrix():
    """Oracle: the fifty digits; without the jump term the multipliers of U8353- are others."""
    task = TASKS["U8353-"]

    class Wrong(Integrator):
        def impact(self, y):
            return self.restitution @ y

    velocities = task.start_velocities(task.unknowns())
    errors = []
    for kind in (Integrator, Wrong):
        integrator = kind(task.system, "DOP853", 1e-12)
        matrix = PeriodShooting(integrator, "origin", 8).monodromy(velocities, 4.0 * task.alpha)
        errors.append(abs(np.trace(matrix) - 2.0 - float(sum(task.exact().multipliers))))
    assert errors[0] < 1e-6 < 1.0 < errors[1]


def failing(*given, **options):
    """An integrator that stops, in place of scipy's."""
    return SimpleNamespace(success=False, message="the step is too small")


@pytest.mark.parametrize(
    ("velocities", "alpha", "replaced", "said"),
    [
        ([0.0, 1e-3], 1.65, {}, "no impact in a time of 100"),
        ([30.0, 1.0], 1e-3, {}, "the impacts come too late"),
        ([30.0, 1.0], 1.65, {"benchmarks.peers.integrators.solve_ivp": failing}, "the integration failed: the step is too small"),
        ([30.0, 1.0], 1.65, {"benchmarks.peers.integrators.CORRECTIONS": 1}, r"1 corrections do not converge \(the last is \S+\)"),
    ],
)
def test_shooting_over_a_period_that_fails_says_why(monkeypatch, velocities, alpha, replaced, said):
    """Oracles: a start that reaches no stop, and one that reaches it after the end; what is put in place of the integrator."""
    for name, value in replaced.items():
        monkeypatch.setattr(name, value)
    shooting = PeriodShooting(Integrator(IN_PHASE.system, "DOP853", 1e-8), "stop+", 1)
    with pytest.raises(ShootingError, match=f"^{said}$"):
        shooting.solve(np.array(velocities), alpha)


@pytest.mark.parametrize(
    ("method", "task", "most", "factor"),
    [
        (Collocation(), IN_PHASE, 1e-5, 0.1),
        (Collocation(), TASKS["U8353-"], 1e-5, 0.1),
        (NonsmoothTime(), IN_PHASE, 1e-4, 1.0),  # at the paper's matching of 1e-6 the energy is right to a hundred times that
    ],
)
def test_collocation_and_the_nonsmooth_method_come_nearer_with_their_tolerance(method, task, most, factor):
    """Oracle: the closed form, and fifty digits for 8 inner impacts."""
    loose, tight = (task.errors(method.prepare(task, tolerance).once()) for tolerance in (1e-4, 1e-6))
    assert loose.multipliers is None and tight.multipliers is None
    assert tight.energy < most and tight.energy < factor * loose.energy and loose.energy < 1e-2


@pytest.mark.skipif(Auto07p().missing() is not None, reason=f"AUTO-07p cannot be used: {Auto07p().missing()}")
def test_auto_as_a_method():
    """Oracle: the closed form, of orbits and of the fold."""
    method = Auto07p()
    answer = method.prepare(IN_PHASE, 2.0).once()
    errors = IN_PHASE.errors(answer)
    assert len(answer.orbits) > 2 and errors.orbit < 1e-10 and errors.energy < 1e-10 and errors.multipliers is None
    task = TASKS["located"]
    answer = method.prepare(task, 4.0).measured()
    assert set(answer.located) == {"SN"} and task.errors(answer).located < 1e-8


def test_errors_see_what_is_wrong():
    """Oracle: known relative changes."""
    exact = IN_PHASE.exact()
    velocities = np.array([float(v) for v in exact.velocities])
    multipliers = np.array([complex(value) for value in exact.multipliers])
    right = IN_PHASE.errors(Answer(orbits=(OrbitAnswer(1.65, float(exact.h), velocities, np.zeros(0), multipliers),)))
    assert max(right[:3]) < 1e-15 and right.located is None
    wrong = IN_PHASE.errors(Answer(orbits=(OrbitAnswer(1.65, 1.001 * float(exact.h), velocities * 1.01, None, multipliers * 1.1),)))
    assert wrong[:3] == pytest.approx((1e-2, 1e-3, 1e-1), rel=1e-6)
    assert multiplier_error(multipliers[:1], exact.multipliers) == float("inf")
    located = TASKS["located"]
    alpha, h = (float(x) for x in located.exact()["SN"])
    assert located.errors(Answer()).located is None
    assert located.errors(Answer(located={"SN": (alpha, h)})).located < 1e-15
    assert located.errors(Answer(located={"SN": (alpha, h), "SB": (1.001 * float(located.exact()["SB"][0]), 1.0)})).located > 1e-3
    good = OrbitAnswer(1.65, float(exact.h), velocities)
    for wrong in (replace(good, energy=math.nan), replace(good, velocities=velocities * math.nan)):
        for orbits in ((good, wrong), (wrong, good)):
            with pytest.raises(ArithmeticError, match="not a number"):
                IN_PHASE.errors(Answer(orbits=orbits))


def test_an_effort_names_what_there_is():
    """Oracle: the tasks and methods; a name of none would be passed over in silence."""
    for effort in (QUICK, FULL):
        assert set(effort.tasks or ()) <= set(TASKS) and set(effort.methods or ()) <= set(METHODS)


# -- growth -----------------------------------------------------------------------------------------------------------------------


def test_the_chain_is_the_reference_system_with_more_masses():
    """Oracle: the reference system; the closed form holds for any number of masses."""
    two, reference = cases.chain(2), cases.system()
    np.testing.assert_array_equal(two.stiffness, reference.stiffness)
    np.testing.assert_array_equal(two.mass, reference.mass)
    system = cases.chain(9)
    problem, y = cases.segment(system, 0, cases.physical_period(system))
    step = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    velocities = (system.modes.to_state @ problem.start(step.y))[9:]
    assert cases.closed_form_error(system, 0, step["energy"], problem.quarter_period(step.y), velocities) < 1e-13


def test_rows_of_growth():
    """Oracle: the sizes that were asked for, and residuals at rounding level."""
    rows = list(growth(TINY))
    assert [(row["growth"], row["value"]) for row in rows] == [
        ("impacts", 1), ("impacts", 2), ("degrees of freedom", 2), ("degrees of freedom", 3), ("quarter period", 1.8),
    ]  # fmt: skip
    assert all(row["residual"] < 1e-12 for row in rows[:-1])
    assert rows[-1]["complete"] and rows[-1]["orbits"] > 0


# -- the command --------------------------------------------------------------------------------------------------------------------


def rows_in(folder):
    return [json.loads(line) for line in (folder / ROWS).read_text().splitlines()]


def test_a_tiny_run(tmp_path, capsys):
    """Oracle: what each method does by construction: the error it was given, the failure it raises, the reason for which it is absent."""
    code = measure(tmp_path, TINY, [IN_PHASE], [EXACT[0], Plain(), Failing(), Absent()])
    out, err = capsys.readouterr()
    names = "saltus", "plain, off by 1e-02", "plain, off by 1e-04", "failing, off by 1e-02", "failing, off by 1e-04"
    growths = "1 inner impacts", "2 inner impacts", "2 degrees of freedom", "3 degrees of freedom", "discovery to quarter period 1.8"
    lines = [f"S13O00+, {name}" for name in names] + [f"growth, {name}" for name in growths]
    assert code == 0 and [line.strip() for line in err.splitlines()] == lines
    assert "skipped  absent: the program absent is not installed" in out
    record = json.loads((tmp_path / DATA).read_text())
    assert record["schema"] == 3 and record["skipped"] == {"absent": "the program absent is not installed"}
    assert any("cores" in line for line in record["machine"])
    rows = [row for row in record["rows"] if "task" in row]
    assert record["rows"] == rows_in(tmp_path)
    assert [(row["method"], row["setting"]) for row in rows] == [
        ("saltus", None), ("plain", 1e-2), ("plain", 1e-4), ("failing", 1e-2), ("failing", 1e-4),
    ]  # fmt: skip
    own, first, second, failed, after = rows
    assert own["failed"] is None
    assert own["errors"]["orbit"] < 1e-12 and own["layers"] and own["memory"] > 1e6
    assert first["errors"]["energy"] == pytest.approx(1e-2) and second["errors"]["energy"] == pytest.approx(1e-4)
    assert first["errors"]["orbit"] is None and first["first"] is not None and second["first"] is None
    assert failed["failed"] == "it does not converge" and failed["seconds"] is None
    assert after["failed"] is None and after["errors"]["energy"] == pytest.approx(1e-4)
    assert sum("growth" in row for row in record["rows"]) == 5
    for picture in (PRECISION, GROWTH):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    assert "S13O00+, quarter period 1.65" in out and "plain" in out


def test_an_answer_without_an_orbit_near_it_is_a_row_too(tmp_path, capsys):
    """Oracle: a start thirty times too large, from which no orbit of the sequence is found in fifty digits."""
    assert measure(tmp_path, replace(TINY, impacts=(), degrees=(), periods=()), [TASKS["U8353-"]], [Astray()]) == 0
    rows = rows_in(tmp_path)
    assert len(rows) == 2 and all(row["failed"].startswith("its error is unknown") for row in rows)
    assert all(error is None for row in rows for error in row["errors"].values())


def test_an_interrupted_run_keeps_its_rows(tmp_path, capsys):
    """Oracle: the rows of the method before the interruption, exit code 130, and the older results as they were."""
    (tmp_path / DATA).write_text("older")
    assert measure(tmp_path, TINY, [IN_PHASE], [Plain(), Interrupted()]) == 130
    assert [row["method"] for row in rows_in(tmp_path)] == ["plain", "plain"]
    assert (tmp_path / DATA).read_text() == "older"
    err = capsys.readouterr().err
    assert "interrupted" in err and f"{tmp_path / ROWS} keeps the 2 finished rows" in err


@pytest.mark.parametrize("ending", [signal.SIGKILL], ids=lambda ending: ending.name)
def test_a_run_that_is_ended_from_outside_keeps_its_rows(tmp_path, ending):
    """Oracle: see `require_a_run_that_is_ended_from_outside_keeps_its_rows`."""
    require_a_run_that_is_ended_from_outside_keeps_its_rows(tmp_path, ending)


def require_a_run_that_is_ended_from_outside_keeps_its_rows(tmp_path, ending):
    """Oracle: a process of its own, ended after its first row: the rows are there, and none of its workers stays."""
    words = [sys.executable, "-m", "benchmarks", "--quick", "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(Path(saltus.__file__).parents[1])}
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in the background have it ignored
    )  # fmt: skip
    rows, patience = tmp_path / ROWS, time.monotonic() + 300.0
    while not (rows.exists() and rows.read_text().count("\n") >= 1):
        assert process.poll() is None and time.monotonic() < patience
        time.sleep(0.05)
    process.send_signal(ending)
    # The pipes close when the last worker has ended too.
    _, err = process.communicate(timeout=120)
    assert len(rows_in(tmp_path)) >= 1 and not (tmp_path / DATA).exists()
    if ending == signal.SIGINT:
        assert process.returncode == 130 and "interrupted" in err.splitlines()[-1] and "Traceback" not in err


def test_a_folder_that_cannot_be_written_is_found_before_the_work(tmp_path, capsys):
    """Oracle: exit code 2, one line, and nothing started: not even the machine is described."""
    file = tmp_path / "file"
    file.write_text("")
    assert main(["speed-error", "--quick", "--out", str(file)]) == 2
    out, err = capsys.readouterr()
    assert not out and err == f"python -m benchmarks: --out {file}: it is a file, expected a folder\n"
    for name in FILES:
        folder = tmp_path / f"with {name}"
        (folder / name).mkdir(parents=True)
        assert main(["--out", str(folder)]) == 2
        out, err = capsys.readouterr()
        assert not out and err == f"python -m benchmarks: cannot write {folder / name}: it is a directory, expected a file\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_is_reported():
    """Oracle: the device that has no room: one error that says so, also where the file is closed after it."""
    rows = RowFile("/dev/full")
    with pytest.raises(WriteFailure, match="/dev/full: no space"):
        try:
            rows.add({"task": "one"})
        finally:
            rows.close()
    assert not rows.rows


# -- the report ---------------------------------------------------------------------------------------------------------------------


def row(method, setting, energy, seconds=1.0, failed=None):
    errors = {"orbit": None, "energy": energy, "multipliers": None, "located": None}
    known = {"task": "S13O00+", "method": method, "setting": setting, "errors": errors, "seconds": seconds}
    return {**known, "failed": failed, "first": None, "memory": None, "points": 1, "repeats": 1, "layers": None}


def test_each_method_is_in_the_table_at_its_least_error():
    """Oracle: rows made by hand."""
    rows = [
        row("saltus", None, 1e-14, 1e-5), row("a", 1e-3, 1e-4), row("a", 1e-9, 1e-8, 2.0), row("a", 1e-12, 1e-7, 9.0),
        row("b", 1e-3, None, None, "not done in 3 s"),
    ]  # fmt: skip
    assert [(best["method"], best["setting"]) for best in best_rows(rows, "S13O00+")] == [("saltus", None), ("a", 1e-9), ("b", 1e-3)]
    table, digits = tables(rows, [IN_PHASE], {"a": "rtol", "b": "rtol"})
    assert [cells[1:] for cells in digits.rows] == [("saltus", *["10"] * 4), ("a", "1000000", "2000000", "-", "-")]
    own, a, b = table.rows
    assert own[2] == "10" and a[1] == "rtol 1e-09" and a[table.columns.index("to saltus")] == "200000"
    assert b[2] == "not done in 3 s"
    assert len({len(cells) for cells in table.rows} | {len(table.columns)}) == 1


def test_the_continuation_program_is_compared_at_both_step_lengths():
    """Oracle: rows made by hand; a setting whose error is too large does not count."""
    rows = [
        row("saltus", None, 1e-14, 1e-5), row("saltus, short steps", None, 1e-14, 5e-6),
        row("AUTO-07p", 1.0, 1e-9, 5e-5), row("AUTO-07p", 2.0, 1e-13, 1e-4),
    ]  # fmt: skip
    beside = tables(rows, [IN_PHASE], {})[-1]
    assert [(cells[1], cells[-2], cells[-1]) for cells in beside.rows] == [("saltus", "2", "10"), ("saltus, short steps", "2", "20")]


# -- the page -------------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def results(tmp_path):
    """A folder with the results of a full run of one row and one discovery, and a page. The data have schema 1."""
    folder = tmp_path / "bench"
    folder.mkdir()
    errors = {"orbit": 2e-14, "energy": 3e-14, "multipliers": 4e-15, "located": None}
    one = {"task": "S13O00+", "method": "saltus", "setting": None, "errors": errors, "seconds": 1.25e-5, "failed": None}
    rows = [
        {**one, "first": 2.0, "memory": 2**28, "points": 32, "repeats": 1, "layers": None},
        {"growth": "quarter period", "value": 1.8, "seconds": 0.25, "orbits": 7, "settled": True},
    ]
    (folder / DATA).write_text(
        json.dumps({"schema": 1, "effort": "full", "machine": ["Machine: a good one."], "skipped": {}, "rows": rows})
    )
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    return folder, page


def test_tables_and_figures_come_into_the_page(results):
    """Oracle: the numbers of the results."""
    folder, page = results
    assert main(["--out", str(folder), "--fill", str(page)]) == 0
    text = page.read_text()
    assert text.startswith(f"before\n{BEGIN}\nMachine: a good one.\n") and text.endswith(f"{END}\nafter\n") and "old" not in text
    assert "| saltus |  | 12.5 | 2e-14 | 3e-14 | 4e-15 | - | 1 | 2 | 256 |" in text
    assert "| 1.8 | 0.25 | 7 | yes |" in text
    for name in (PRECISION, GROWTH):
        assert (page.parent / "images" / name).read_bytes().startswith(b"\x89PNG")


def test_results_of_schema_1_are_read(results):
    """Oracle: the key of schema 1 and the one of schema 2."""
    row = read_results(results[0])["rows"][1]
    assert row["complete"] is True and "settled" not in row


def test_a_quick_run_and_no_results_are_refused(results, capsys):
    """Oracle: the message, and the page as it was."""
    folder, page = results
    before = page.read_text()
    (folder / DATA).write_text(json.dumps({"effort": "quick"}))
    with pytest.raises(BadInput, match="results of a quick run"):
        fill(folder, page)
    assert main(["speed-error", "--out", str(folder / "none"), "--fill", str(page)]) == 2
    assert "cannot read the results" in capsys.readouterr().err
    assert page.read_text() == before


def test_the_page_of_the_docs_has_a_place_for_the_tables():
    """Oracle: the marks; `check_page` raises without them."""
    page = Path(__file__).parents[2] / "docs" / "reference" / "speed_error.md"
    check_page(page)
    assert page.read_text(encoding="utf-8").index(BEGIN) < page.read_text(encoding="utf-8").index(END)
