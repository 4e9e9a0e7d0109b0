"""Tables in a terminal: nothing is left out, no number or name is cut, ids stay distinct. Oracles: the cells; the width."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from branches.catalogue import Catalogue
from saltus.terminal import short_id, table_lines, with_short_ids, wrapped
from tests.branches.catalogue.families import real

ROOT = Path(__file__).parents[2]
HEAD = ("label", "id", "energy h", "points", "remark")
ROWS = [
    ("S13O00+", "origin-origin:" + "+-" * 30 + ":01234567", "0.11850781059374", "203", "a touch of 0.7644 after its start"),
    ("U(15)578-", "origin-origin:" + "+-" * 30 + ":01234568", "0.25:1.75", "1", ""),
    ("S11O00-", "origin-stop+::01234567", "14.5537010891", "57", "half-period symmetry breaks"),
    ("-", "L11+", "", "", "1 turn"),
]


@pytest.mark.parametrize("width", range(30, 180, 7))
def test_columns_fit(width):
    """Oracle: the cells. Numbers and labels are whole, ids keep their hash, and no word of a text is lost."""
    rows = ROWS[:3]
    lines = table_lines(HEAD, rows, width=width, columns="lirrt")
    assert all(len(line) <= width and line == line.rstrip() for line in lines)
    head = next(k for k, line in enumerate(lines) if line.startswith("S13O00+"))
    assert sorted(" ".join(lines[:head]).split()) == sorted(" ".join(HEAD).split())
    text = "\n".join(lines)
    for label, id, h, points, remark in rows:
        for cell in (label, h, points, *remark.split()):
            assert cell in text.split()
        assert re.search(rf"(^|\s){re.escape(id[0])}\S*{id[-9:]}(\s|$)", text)


def test_texts_wrap_in_their_column():
    """Oracle: the columns of the first line."""
    row = ("S11O00-", "origin-stop+::01234567", "1.5", "2", "half-period symmetry breaks")
    lines = table_lines(HEAD, [row], width=70, columns="lirrt")
    at = lines[0].index("remark")
    assert [line[at:] for line in lines] == ["remark", "half-period", "symmetry breaks"]
    assert "origin-stop+::01234567" in lines[1] and not lines[2][:at].strip()


def test_without_a_width_nothing_is_shortened():
    """Oracle: the cells."""
    lines = table_lines(HEAD, ROWS, columns="lirrt")
    assert len(lines) == 5
    for line, row in zip(lines[1:], ROWS, strict=True):
        assert line.split() == " ".join(row).split()


def test_what_is_not_an_id_stays():
    """Oracle: the texts."""
    assert short_id("L11+", 1) == "L11+" and short_id("dead end:origin-stop+::01234567:GR1", 12).startswith("dead end:")
    line = "├─ GR2 fold at h 0.14: U5512+  origin-origin:+-+-+-+-:5cc402b7  (elsewhere in this tree)"
    assert with_short_ids(line, 200) == line and with_short_ids(line, None) == line
    assert with_short_ids(line, 80) == "├─ GR2 fold at h 0.14: U5512+  origin-origin…:5cc402b7  (elsewhere in this tree)"
    assert wrapped([line], None, 4) == [line] and all(len(part) <= 40 for part in wrapped([line], 40, 4))


def terminal(columns, *words):
    """What a command prints in a terminal of its own."""
    pty = pytest.importorskip("pty")
    leader, follower = pty.openpty()
    environment = {**os.environ, "COLUMNS": str(columns), "TERM": "xterm", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "saltus", *map(str, words)]
    process = subprocess.Popen(command, stdout=follower, stderr=subprocess.DEVNULL, env=environment, cwd=ROOT)
    os.close(follower)
    text = b""
    while True:
        try:
            piece = os.read(leader, 4096)
        except OSError:
            break
        if not piece:
            break
        text += piece
    os.close(leader)
    assert process.wait() == 0
    return text.decode().replace("\r\n", "\n")


@pytest.mark.parametrize("columns", [60])
def test_the_commands_fit_the_terminal(catalogue, columns):
    """Oracle: see `require_the_commands_fit_the_terminal`."""
    require_the_commands_fit_the_terminal(catalogue, columns)


def require_the_commands_fit_the_terminal(catalogue, columns):
    """Oracle: what they print elsewhere, word by word but for ids, which keep their hash, and for remarks."""
    with Catalogue(catalogue) as kept:
        rows = kept.families()
        events = kept.events(real()[0].id)
    text = terminal(columns, "list", "--catalogue", catalogue)
    assert max(map(len, text.splitlines())) <= columns
    for row in rows:
        assert f"{row.id[-9:]} " in text and f"{row.h[0]:.5g}:{row.h[1]:.5g}" in text.split() and str(row.points) in text.split()
    for head in ("label", "id", "impacts", "energy h", "quarter alpha", "stable", "points", "events", "other labels"):
        assert head in text
    text = terminal(columns, "show", "S13+", "--catalogue", catalogue)
    assert max(map(len, text.splitlines())) <= columns
    plain = " ".join(text.split())
    for event in events:
        assert f"{event.h:.14g}" in plain and f"{event.alpha:.14g}" in plain
    assert all(said in plain for _, said in next(row.ended for row in rows if row.id == real()[0].id)) and "|multiplier|" in plain
    assert "model reversible, and energy varies along the family -> no unfolding parameter" in plain
    assert real()[3].id[-9:] in plain


@pytest.mark.parametrize("columns", [60])
def test_a_discovery_fits_the_terminal(catalogue, columns):
    """Oracle: see `require_a_discovery_fits_the_terminal`."""
    require_a_discovery_fits_the_terminal(catalogue, columns)


def require_a_discovery_fits_the_terminal(catalogue, columns):
    """Oracle: the orbits of the four families, from their branches."""
    words = ("discover", "--energy", "0.5", "--max-quarter-period", "2", "--max-impacts", "4", "--catalogue", catalogue)
    text = terminal(columns, *words)
    assert max(map(len, text.splitlines())) <= columns
    for branch in real():
        for orbit in branch.orbits_at(energy=0.5):
            assert f"{orbit.alpha:.8g}" in text.split() and branch.id[-9:] in text
    for head in ("label", "ends", "sequence", "impacts", "alpha", "velocities", "slowest impact", "tau", "stable", "family"):
        assert head in text
