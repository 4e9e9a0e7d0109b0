"""The page of the hard cases lists every case, with an error within what its test allows."""

from benchmarks.hard_cases import old_errors, page
from tests.docs.pages import page as read
from tests.hard.cases import HEADINGS, all_cases

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
