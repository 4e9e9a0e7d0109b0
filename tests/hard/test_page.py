"""The page of the hard cases lists every case, with an error within what its test allows."""

import json
import math
from pathlib import Path

import pytest

import benchmarks.hard_cases as script
from benchmarks.hard_cases import main, old_errors, page
from tests.docs.pages import page as read
from tests.hard.cases import HEADINGS, RECORD, all_cases, hard, largest

TEXT = read("hard_cases.md")


def test_every_case_is_on_the_page():
    """Oracle: the tests themselves."""
    cases, errors = all_cases(), old_errors(TEXT)
    assert {case.heading for case in cases} == set(HEADINGS) and len(cases) > 25
    for case in cases:
        assert (case.heading, case.text) in errors, f"{case.text}: not on the page, run python -m benchmarks.hard_cases"
        assert 0.0 <= errors[case.heading, case.text] <= case.limit
    lines = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.startswith("| case |")]
    assert len(lines) == len(cases)


def test_the_page_is_what_is_written():
    """Oracle: writing it again from its own numbers changes nothing."""
    where = TEXT.partition("python -m benchmarks.hard_cases -->\n\n")[2].partition("\n")[0]
    assert page(TEXT, old_errors(TEXT), [where, ""]).replace(f"{where} \n", f"{where}\n") == TEXT


@pytest.mark.parametrize("code", [0, 1])
def test_the_script_writes_what_was_measured(monkeypatch, tmp_path, code, capsys):
    """Oracle: the errors told to it; with --quick the others stay, and where a test fails so does the whole page."""
    copy = tmp_path / "hard_cases.md"
    copy.write_text(TEXT, encoding="utf-8")
    case = all_cases()[0]

    def call(command, cwd, env):
        lines = [json.dumps([case.heading, case.text, error]) for error in (1e-12, 3e-12, 2e-12)]
        Path(env[RECORD]).write_text("\n".join(lines) + "\n", encoding="utf-8")
        assert "tests/full/test_missed_events.py" not in command
        return code

    monkeypatch.setattr(script.subprocess, "call", call)
    monkeypatch.setattr(script, "PAGE", copy)
    monkeypatch.setattr(script, "ROOT", tmp_path)
    assert main(["--quick"]) == code
    text = copy.read_text(encoding="utf-8")
    expected = old_errors(TEXT) | ({} if code else {(case.heading, case.text): 3e-12})
    assert old_errors(text) == expected and (text == TEXT) == (code == 1)
    assert ("stays as it is" in capsys.readouterr().err) == (code == 1)


@pytest.mark.parametrize("errors", [(math.nan, 0.0), (0.0, math.nan), (0.0, 2e-9), (math.inf,)])
def test_a_case_fails_on_an_error_that_is_too_large_or_no_number(monkeypatch, errors):
    """Oracle: `max(0.0, nan)` is 0.0, so that a NaN behind a number would pass."""
    monkeypatch.setattr("tests.hard.cases.CASES", [])
    monkeypatch.delenv(RECORD, raising=False)
    measured = hard("a case", source="none", limit=1e-9, what="nothing")(lambda: largest(*errors))
    with pytest.raises(AssertionError, match="a case"):
        measured()
