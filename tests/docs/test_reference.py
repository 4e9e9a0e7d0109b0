"""The reference pages against the program: commands, events, exit codes, files, public names, and the paths that the pages name."""

import argparse
import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import saltus
from branches.tracing import EVENT_TYPES
from saltus import errors
from saltus.__main__ import COMMANDS, OneLineParser, main
from saltus.outputs import KINDS
from tests.docs.pages import page, table

ROOT = Path(__file__).parents[2]


def parsers():
    """The parser of each command; `export` has one for each WHAT."""
    found = {}
    for name in COMMANDS:
        parser = OneLineParser(prog=f"saltus {name}")
        importlib.import_module("saltus.commands." + name.replace("continue", "continue_")).add_arguments(parser)
        inner = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
        parts = dict.items(inner[0].choices) if inner else []
        found |= {f"{name} {what}": part for what, part in parts} if inner else {name: parser}
    return found


PARSERS = parsers()


def options(parser):
    """The options that the help of a parser lists."""
    shown = [action for action in parser._actions if action.help != argparse.SUPPRESS and action.dest != "help"]
    return {option for action in shown for option in action.option_strings}


def section(command):
    """The text of the section of a command."""
    found = re.search(rf"^###? (?:[\w ]+, )?{command}(?:, [\w ]+)?\n(.*?)(?=^##|\Z)", page("commands.md"), re.MULTILINE | re.DOTALL)
    assert found, command
    return found[1]


@pytest.mark.parametrize("command", PARSERS)
def test_a_command_is_listed_with_its_options(command):
    """Oracle: argparse."""
    text = section(command)
    rows = re.findall(r"^\| `(--[a-z-]+)", text, re.MULTILINE)
    also = re.findall(r"`(--[a-z-]+)`", text.partition("Also: ")[2])
    assert set(rows + also) == options(PARSERS[command]) and len(rows + also) == len(set(rows + also))
    positional = {action.metavar for action in PARSERS[command]._actions if not action.option_strings and action.help != argparse.SUPPRESS}
    assert set(re.findall(r"^\| `([A-Z]+)`", text, re.MULTILINE)) == positional


def test_every_command_has_one_grammar_for_its_files():
    """Oracle: the kinds of output files. No command has another option for one of these."""
    for command, parser in PARSERS.items():
        files = {action.option_strings[0][2:] for action in parser._actions if action.metavar == "FILE" and action.option_strings}
        assert files <= {*KINDS, "catalogue", "scene", "branches", "data"}, command
        assert command in ("study", "gallery", "compile") or files & {*KINDS}


def test_the_options_of_many_commands_are_explained():
    """Oracle: the options that are under "Also" somewhere."""
    shared = set(re.findall(r"`(--[a-z-]+)", page("commands.md").partition("## Options of many commands")[2].partition("\n## ")[0]))
    also = {option for command in PARSERS for option in re.findall(r"`(--[a-z-]+)`", section(command).partition("Also: ")[2])}
    assert also <= shared


def test_the_events_are_those_of_the_program():
    """Oracle: `EVENT_TYPES`."""
    assert {cells[0] for cells in table(page("output.md"), "Events")} == set(EVENT_TYPES)


def test_the_exit_codes_are_those_of_the_program():
    """Oracle: the constants."""
    codes = [int(cells[0]) for cells in table(page("output.md"), "Exit codes")]
    assert codes == [errors.DONE, errors.FAILED, errors.BAD_INPUT, errors.INTERRUPTED]


def test_every_public_name_is_explained():
    """Oracle: `dir(saltus)`."""
    cells = re.findall(r"^\| (`.*?) \|", page("python.md"), re.MULTILINE)
    named = [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]
    assert sorted(named) == sorted(dir(saltus))


def test_the_new_names_of_renamed_calls_exist():
    """Oracle: `dir(saltus)`."""
    new = " ".join(cells[1] for cells in table(page("changes.md"), "Python"))
    assert len(set(re.findall(r"`saltus\.(\w+)`", new)) & set(dir(saltus))) == len(set(re.findall(r"`saltus\.(\w+)`", new))) > 20


def test_the_new_names_of_renamed_options_exist():
    """Oracle: argparse."""
    for cells in table(page("changes.md"), "Commands and options"):
        for command in re.findall(r"`saltus ((?:export )?\w+) ", cells[1]):
            assert set(re.findall(r"--[a-z]+", cells[1])) <= options(PARSERS[command]), cells[1]


def keys(title):
    """The keys in the first column of the tables under a heading of the page of files."""
    part = page("files.md").partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([\w, ]+?) \|.*\n(?!\|---)", part, re.MULTILINE)
    return [key for row in rows for key in row.split(", ")]


def record(tmp_path, capsys, *words):
    """The JSON of a command."""
    path = tmp_path / "record.json"
    assert main([*words, "--json", str(path)]) == 0
    capsys.readouterr()
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("title", "words", "parts"),
    [
        ("Branch", "continue S13O00+ --energy 0.1:1 --harmonics 2", ("branch", "points", "events")),
        ("Discover", "discover --energy 1 --max-quarter-period 2 --max-impacts 2", ("counts", "orbits")),
    ],
)
def test_the_keys_of_a_file_are_listed(tmp_path, capsys, title, words, parts):
    """Oracle: the file of a short run; of a list, its first entry."""
    data = record(tmp_path, capsys, *words.split())
    assert f'`{{{", ".join(json.dumps(key) for key in data)}}}`' in page("files.md")
    assert {key for part in parts for key in (data[part][0] if isinstance(data[part], list) else data[part])} == set(keys(title))


def test_the_keys_of_a_run_are_listed(tmp_path, capsys):
    """Oracle: the file of a short run."""
    data = record(tmp_path, capsys, "run", "--impulse", "0.8", "--rho", "0.7", "--duration", "20")
    listed = re.search(r"JSON of `saltus run` is `\{(.*?)\}`", page("files.md"), re.DOTALL)[1]
    assert re.findall(r'"(\w+)"', listed) == list(data)
    assert set(keys("Run")) <= set(data)


def test_the_columns_of_a_section_are_listed(tmp_path, capsys):
    """Oracle: the file of a short section."""
    path = tmp_path / "section.npz"
    assert main(["section", "--energy", "0.06", "--orbits", "2", "--crossings", "2", "--npz", str(path)]) == 0
    capsys.readouterr()
    assert set(np.load(path).files) == {*keys("Section"), "about"}


def test_the_columns_of_a_sweep_are_listed(tmp_path, capsys):
    """Oracle: the file of a short sweep."""
    words = "sweep --scene impact_oscillator --in s --range=-0.1:0 --points 2 --up --record 2".split()
    data = record(tmp_path, capsys, *words)
    listed = re.search(r"`saltus sweep` writes .*? JSON is `\{(.*?)\}`", page("files.md"), re.DOTALL)[1]
    assert re.findall(r'"(\w+)"', listed) == list(data)
    part = page("files.md").partition("\n## Sweep\n")[2].partition("\n## ")[0]
    dotted = {name.partition(".")[0] for name in re.findall(r"`(\w+\.\w+)`", part)}
    assert {name.partition(".")[0] for name in data["points"][0]} == {*keys("Sweep"), *dotted}


def test_the_keys_and_columns_of_a_basin_are_listed(tmp_path, capsys):
    """Oracle: the files of a small basin."""
    words = "basin --scene damped_impact_oscillator --set w=2.2 --set A=1 --set c=0.02 --grid 6x6".split()
    data = record(tmp_path, capsys, *words, "--npz", str(tmp_path / "a.npz"))
    listed = re.search(r"`saltus basin` writes .*? JSON is `\{(.*?)\}`", page("files.md"), re.DOTALL)[1]
    assert re.findall(r'"(\w+)"', listed) == list(data)
    plain = {"schema", "system", "forces", "kind", "coordinates", "attractors", "saddles", "cells"}
    own = {"attractor", "periods", "impacts", *data, *data["attractors"][0], *data["saddles"][0]} - plain | {"kind"}
    assert set(keys("Basin")) == own
    assert set(np.load(tmp_path / "a.npz").files) == {"start_u.x", "start_v.x", "attractor", "periods", "impacts", "about"}
