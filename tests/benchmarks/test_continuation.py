"""The continuation benchmark on small sizes: it measures what it claims, and the measured orbits are right. No time is asserted."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import backbone, cases, continuation
from benchmarks.__main__ import TASKS, main
from benchmarks.continuation import time_process
from benchmarks.following import BareFamily, RecordedFamily, compiled_calls, layers_of, timed_run
from benchmarks.measure import least_times, processor_time, run_python, spread, timed
from benchmarks.peers.shooting import PlainShooting, ShootingError, ShotOrbit
from benchmarks.points import FULL, QUICK, layers, points
from benchmarks.report import BEGIN, END, Table, check_page, show, write_page
from branches.family import Family
from branches.orbit import Orbit
from saltus.errors import BadInput


@pytest.fixture(scope="module")
def system():
    return cases.system()


@pytest.mark.parametrize("inner", cases.INNER)
def test_both_families_follow_the_closed_form(system, inner):
    """Oracle: the closed form of one impact a half period; and the points are the same with and without multipliers."""
    problem, y = cases.segment(system, inner)
    assert np.max(np.abs(problem.residual(y))) < 1e-12 * np.max(np.abs(y))
    runs = [timed_run(family, family.begin(y), 4) for family in (Family(problem), BareFamily(problem))]
    for run in runs:
        assert len(run.steps) == len(run.seconds) == len(run.clean) == 4
        assert all(cases.step_error(problem, step) < 1e-12 for step in run.steps)
        assert all(later.parameter > earlier.parameter for earlier, later in zip(run.steps, run.steps[1:], strict=False))
    for full, bare in zip(*(run.steps for run in runs), strict=True):
        np.testing.assert_allclose(full.y, bare.y, rtol=1e-9, atol=1e-11)


def test_the_error_sees_a_wrong_orbit(system):
    """Oracle: a known relative change of the energy, and of the velocities."""
    exact = backbone.origin_velocity(system, cases.ALPHA)
    energy = backbone.energy(system, cases.ALPHA)
    assert cases.closed_form_error(system, 2, energy, 5 * cases.ALPHA, exact) < 1e-14
    assert cases.closed_form_error(system, 2, energy * (1 + 1e-6), 5 * cases.ALPHA, exact) == pytest.approx(1e-6, rel=1e-6)
    assert cases.closed_form_error(system, 2, energy, 5 * cases.ALPHA, exact * (1 - 1e-6)) == pytest.approx(1e-6, rel=1e-6)
    assert cases.closed_form_error(system, 2, energy, 3 * cases.ALPHA, exact) > 0.1


@pytest.mark.parametrize("inner", (0, 2))
def test_shooting_agrees_with_the_closed_form_to_its_tolerance(system, inner):
    """Oracle: the closed form; the error of shooting shrinks with the tolerance of its integrator."""
    errors = []
    for rtol in (1e-6, 1e-9):
        method = PlainShooting(cases.MU, cases.SIGMA, inner, rtol)
        known = [
            ShotOrbit(backbone.origin_velocity(system, alpha), (2 * inner + 1) * alpha, 0) for alpha in (cases.ALPHA + 1e-3, cases.ALPHA)
        ]
        orbit = method.next_orbit(*known, 0.01)
        energy = method.energy(orbit.velocities)
        assert energy > backbone.energy(system, cases.ALPHA) * 1.01
        errors.append(cases.closed_form_error(system, inner, energy, orbit.duration, orbit.velocities))
        assert errors[-1] < 100.0 * rtol
    assert errors[1] < 0.01 * errors[0]


@pytest.mark.parametrize(
    ("start", "name", "value", "said"),
    [
        ([0.0, 1e-3], "rtol", 1e-6, "no impact in a time of 100"),
        ([1.4, 1.0], "flight", lambda x: (1.0, x**2 + 1.0, True), r"15 corrections do not converge \(the last is \S+\)"),
    ],
)
def test_shooting_that_fails_says_why(monkeypatch, start, name, value, said):
    """Oracles: a start that reaches no stop; a momentum at impacts that is above zero for any start."""
    method = PlainShooting(cases.MU, cases.SIGMA, 0, 1e-6)
    monkeypatch.setattr(method, name, value)
    monkeypatch.setattr(method, "gradient", lambda velocities, value: np.array([1.0, 1e3]))
    with pytest.raises(ShootingError, match=f"^{said}$"):
        method.correct(np.array(start), np.array([1.0, 0.0]))


def test_multipliers_of_shooting_are_those_of_the_orbit(system):
    """Oracle: the trace of the reduced period map from the half map, and a determinant of 1."""
    problem, y = cases.segment(system, 0)
    method = PlainShooting(cases.MU, cases.SIGMA, 0, 1e-11)
    orbit = ShotOrbit(backbone.origin_velocity(system, cases.ALPHA), cases.ALPHA, 0)
    matrix = method.monodromy(orbit)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-4)
    assert np.trace(matrix) - 2.0 == pytest.approx(Orbit(problem, Family(problem).begin(y).extra).tau, abs=1e-3)


def test_layers_sum_to_the_point(system):
    """Oracle: the sum of the layers is the total by construction."""
    parts = layers_of(*cases.segment(system, 2), points=8, repeats=2)
    layers = sum(part.value for part in (parts.compiled, parts.entering, parts.family, parts.engine))
    assert layers == pytest.approx(parts.total.least, rel=1e-9)
    assert parts.steps >= 1.0 and parts.iterations >= 1.0 and 0.0 < parts.compiled_calls <= 1.0


def test_compiled_calls_do_the_same_again(system):
    """Oracle: the advance itself; calling it once more gives the same numbers. Without room no step is taken."""
    problem, y = cases.segment(system, 2)
    family = Family(problem)
    recorded = RecordedFamily(problem)
    timed_run(recorded, recorded.begin(y), 8)
    expected = family._advance(*recorded.blocks[-1]).steps
    ((function, arguments),) = compiled_calls(family, recorded.blocks[-1:])
    for _ in range(2):
        assert function(*arguments)[0] == len(expected)
    np.testing.assert_array_equal(arguments[-7][0], expected[0].y)
    ((function, arguments),) = compiled_calls(family, recorded.blocks[-1:], room=0)
    assert function(*arguments)[0] == 0
    with pytest.raises(RuntimeError, match="none of 1 points came from a block of steps; ask for more points"):
        layers_of(problem, y, 1, 1)


def test_processes_run_and_failures_are_reported():
    """Oracle: the first run and the repeats of an interpreter that ends well, and one that does not."""
    assert [len(time_process(("-c", "pass"), repeats, cold=cold)) for repeats, cold in ((2, True), (1, False))] == [3, 2]
    with pytest.raises(RuntimeError, match="ended with code 3: no such thing"):
        run_python("-c", "import sys; print('no such thing', file=sys.stderr); sys.exit(3)")


def test_tables_of_a_point(system, monkeypatch):
    """Oracle: a row for each number of impacts and tolerance; the errors in it are those of the closed form."""
    monkeypatch.setattr(cases, "INNER", (0, 2))
    tiny = dataclasses.replace(QUICK, points=8, repeats=2, shot={0: 1, 2: 1}, rtols={0: (1e-6,), 2: (1e-6, 1e-9)}, differenced=0)
    table = points(tiny)
    assert [(row[0], row[6]) for row in table.rows] == [("0", "1e-06"), ("2", "1e-06"), ("2", "1e-09")]
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert all(float(row[5]) < 1e-12 < float(row[9]) < 1e-4 for row in table.rows)
    assert [row[7] == "not run" for row in table.rows] == [False, True, True]
    table = layers(tiny)
    assert [row[0] for row in table.rows] == ["0", "2"] and all(len(row) == len(table.columns) for row in table.rows)


def test_a_scope_has_each_number_of_impacts():
    """Oracle: the numbers of impacts that are measured."""
    for scope in (FULL, QUICK):
        assert set(scope.shot) == set(scope.rtols) == set(cases.INNER)


def test_spread():
    """Oracle: by hand."""
    assert spread([3.0, 1.0, 2.0, 10.0]) == (1.0, 2.5)
    assert spread([1.0]) == (1.0, 1.0)


def test_times_are_those_of_the_works():
    """Oracle: how often each work is done; a result is passed on."""
    done = []
    least = least_times({"one": lambda: done.append(1), "two": lambda: done.append(2)}, 0.0)
    assert set(least) == {"one", "two"} and min(done.count(1), done.count(2)) >= 6
    processor_time(lambda: done.append(3), 4)
    assert timed(divmod, 7, 2)[0] == (3, 1) and done.count(3) == 4


def test_a_page_keeps_all_but_what_is_between_its_marks(tmp_path):
    """Oracle: the text by hand."""
    page = tmp_path / "speed.md"
    page.write_text(f"# Title\n\n{BEGIN}\nold\n{END}\n\nafter\n")
    table = Table("T", ("a", "b"), [("1", "22")], ("A note.",))
    write_page(page, table.markdown())
    expected = f"# Title\n\n{BEGIN}\n### T\n\nA note.\n\n| a | b |\n| ---: | ---: |\n| 1 | 22 |\n{END}\n\nafter\n"
    assert page.read_text() == expected
    write_page(page, table.markdown())
    assert page.read_text() == expected
    assert [path.name for path in tmp_path.iterdir()] == ["speed.md"]


def test_a_table_in_the_terminal(capsys):
    """Oracle: its title, its note and every cell."""
    show(Table("Title", ("a", "b"), [("1", "22"), ("333", "4")], ("A note.",)))
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert lines[0] == ["Title"] and lines[1] == ["a", "b"] and lines[-3:] == [["1", "22"], ["333", "4"], ["A", "note."]]


@pytest.mark.parametrize("text", ("nothing", f"{END}\n{BEGIN}\n", f"{BEGIN}\n{BEGIN}\n{END}\n"))
def test_a_page_without_marks_is_refused(tmp_path, text):
    """Oracle: the page is as it was."""
    page = tmp_path / "speed.md"
    page.write_text(text)
    with pytest.raises(BadInput, match="no place for the tables"):
        check_page(page)
    assert page.read_text() == text


@pytest.mark.parametrize(
    ("words", "message"),
    (
        (["continuation", "--quik"], "unknown option --quik of python -m benchmarks continuation; nearest: --quick"),
        (["continuation", "fast"], "unexpected argument 'fast'"),
        (["continuation", "--only", "layer"], "unknown section 'layer'"),
        (["continuation", "--only"], "--only: expected one argument"),
        (["continuation", "--out", "no/such/page.md"], "cannot read no/such/page.md: No such file or directory"),
        (["continuation", "--out", "README.md", "--quick"], "expected no --only and no --quick"),
        (["building", "--workers", "0"], "'0', expected an integer above 0"),
        (["studies", "--runs", "many"], "'many', expected an integer above 0"),
        (["continuations"], "unknown task 'continuations', expected speed-error or continuation"),
        (["--quik"], "unknown option --quik of python -m benchmarks speed-error; nearest: --quick"),
    ),
)
def test_bad_input_is_one_line_and_nothing_is_measured(capsys, words, message):
    """Oracle: exit code 2, one line on standard error that names the mistake, nothing on standard output."""
    assert main(words) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1 and message in error


@pytest.mark.parametrize("task", TASKS)
def test_each_task_has_its_help(capsys, task):
    """Oracle: exit code 0, and the summary of the task in the help."""
    with pytest.raises(SystemExit) as ended:
        main([task, "--help"])
    out = " ".join(capsys.readouterr().out.split())
    assert ended.value.code == 0 and TASKS[task][1:] in out


def test_the_tasks_on_the_pages_exist(capsys):
    """Oracle: the help of each task that a page names, which has the options."""
    root = Path(__file__).parents[2]
    pages = [root / "README.md", root / "tests" / "README.md", *(root / "docs").rglob("*.md")]
    lines = [line for page in pages for line in re.findall(r"python -m benchmarks( [a-z][^`\n]*)?[`\n]", page.read_text(encoding="utf-8"))]
    assert len(lines) > 8
    for line in lines:
        words = line.split() or ["speed-error"]
        with pytest.raises(SystemExit):
            main([words[0], "--help"])
        assert set(re.findall(r"--[a-z-]+", line)) <= set(re.findall(r"--[a-z-]+", capsys.readouterr().out)), line


@pytest.fixture
def trivial_processes(monkeypatch):
    """Two processes that do nothing, as the only section."""
    monkeypatch.setattr(continuation, "SECTIONS", {"processes": continuation.processes})
    monkeypatch.setattr(continuation, "PROCESSES", (("first", ("-c", "pass")), ("second", ("-c", "pass"))))


def test_out_puts_the_tables_into_the_page(tmp_path, capsys, monkeypatch, trivial_processes):
    """Oracle: the page of the project, whose text around the marks stays; its tables are those printed."""
    source = (Path(__file__).parents[2] / "docs" / "reference" / "speed.md").read_text(encoding="utf-8")
    page = tmp_path / "speed.md"
    page.write_text(source, encoding="utf-8")
    monkeypatch.setattr(continuation, "FULL", QUICK)
    assert main(["continuation", "--out", str(page)]) == 0
    written = page.read_text(encoding="utf-8")
    assert written.partition(BEGIN)[0] == source.partition(BEGIN)[0] and written.partition(END)[2] == source.partition(END)[2]
    measured = written.partition(BEGIN)[2].partition(END)[0]
    assert measured.strip().startswith("Machine: ") and "### Whole processes, seconds" in measured
    second = next(line for line in capsys.readouterr().out.splitlines() if line.strip().startswith("second"))
    cells = [cell.strip() for line in measured.splitlines() if line.startswith("| second") for cell in line.strip("| ").split("|")]
    assert cells[2] in second
