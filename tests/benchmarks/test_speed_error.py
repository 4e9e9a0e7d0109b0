"""The results of a bench go into the page of the docs. Oracle: what was put in."""

import json

import pytest

from benchmarks.speed_error import PAGE_IN_DOCS, fill, main
from saltus.bench.tables import BEGIN, END, PageError, check_page
from saltus.commands.bench import DATA, GROWTH, PAGE, PRECISION


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "bench"
    folder.mkdir()
    for name, text in ((DATA, json.dumps({"effort": "full"})), (PAGE, "| a table |\n"), (PRECISION, "one"), (GROWTH, "two")):
        (folder / name).write_text(text)
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    return folder, page


def test_tables_and_pictures_come_into_the_page(results):
    folder, page = results
    fill(folder, page)
    assert page.read_text() == f"before\n{BEGIN}\n| a table |\n{END}\nafter\n"
    assert [(page.parent / "images" / name).read_text() for name in (PRECISION, GROWTH)] == ["one", "two"]


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
