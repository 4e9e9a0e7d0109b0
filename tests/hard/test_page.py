"""The page of the hard cases lists every case, with an error within what its test allows."""

import json
import math
import re
from pathlib import Path

import pytest

import benchmarks.hard_cases as script
from benchmarks.__main__ import main
from benchmarks.hard_cases import old_errors
from tests.docs.pages import page as read
from tests.hard.cases import HEADINGS, RECORD, all_cases, hard, largest

TEXT = read("hard_cases.md")


def test_every_case_is_on_the_page():
    """Oracle: the tests themselves: their order, words and limits; the page adds one number to each, which is within the limit."""
    cases = all_cases()
    assert {case.heading for case in cases} == set(HEADINGS) and len(cases) > 25
    lines = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.startswith("| case |")]
    assert len(lines) == len(cases)
    for line, case in zip(lines, cases, strict=True):
        *words, measured, allowed = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        expected = [part.replace("|", "\\|") for part in (case.text, case.source, case.what)]
        assert words == expected, f"{case.text}: not on the page, run python -m benchmarks hard-cases"
        assert float(allowed) == case.limit and 0.0 <= float(measured) <= case.limit


@pytest.mark.parametrize("code", [0, 1])
def test_the_script_writes_what_was_measured(monkeypatch, tmp_path, code, capsys):
    """Oracle: the recorded errors. With --quick the others stay; if a test fails, the page stays as it is."""
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
    assert main(["hard-cases", "--quick"]) == code
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
