"""The results of a bench go into the page of the docs. Oracle: what was put in."""

import json

import pytest

from benchmarks.speed_error import PAGE_IN_DOCS, fill, main
from saltus.bench.tables import BEGIN, END, PageError, check_page
from saltus.commands.bench import DATA, GROWTH, PRECISION


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "bench"
    folder.mkdir()
    errors = {"orbit": 2e-14, "energy": 3e-14, "multipliers": 4e-15, "located": None}
    one = {"task": "S13O00+", "method": "saltus", "setting": None, "errors": errors, "seconds": 1.25e-5, "failed": None}
    row = {**one, "first": 2.0, "memory": 2**28, "points": 32, "repeats": 1, "layers": None}
    (folder / DATA).write_text(json.dumps({"effort": "full", "machine": ["Machine: a good one."], "skipped": {}, "rows": [row]}))
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    return folder, page


def test_tables_and_pictures_come_into_the_page(results):
    folder, page = results
    fill(folder, page)
    text = page.read_text()
    assert text.startswith(f"before\n{BEGIN}\nMachine: a good one.\n") and text.endswith(f"{END}\nafter\n") and "old" not in text
    assert "| saltus |  | 12.5 | 2e-14 | 3e-14 | 4e-15 | - | 1 | 2 | 256 |" in text
    for name in (PRECISION, GROWTH):
        assert (page.parent / "images" / name).read_bytes().startswith(b"\x89PNG")


def test_a_quick_look_and_no_results_are_refused(results, capsys):
    folder, page = results
    before = page.read_text()
    (folder / DATA).write_text(json.dumps({"effort": "quick"}))
    with pytest.raises(PageError, match="results of a quick bench"):
        fill(folder, page)
    assert main([str(folder / "none"), "--page", str(page)]) == 2
    assert "cannot read the results" in capsys.readouterr().err
    assert page.read_text() == before


def test_the_page_has_its_place():
    check_page(PAGE_IN_DOCS)
