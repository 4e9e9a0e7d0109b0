"""The path from a command to a figure on docs/reference/program.md, and the files that CONTRIBUTING.md names.

Oracle: the functions that Python enters while the command runs (`sys.setprofile`), the kernels that it can import, and the core's source.
"""

import ast
import re
import sys
from pathlib import Path

import pytest

from saltus.__main__ import main
from tests.docs.pages import page, table

ROOT = Path(__file__).parents[2]
STEPS = [cells[1] for cells in table(page("program.md"), "The functions in order")]


def entered(words):
    """The functions of ours that a command enters, as (file, name); a method counts for its class, too."""
    codes = set()

    def note(frame, event, _):
        if event == "call":
            codes.add(frame.f_code)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        assert main(words) == 0
    finally:
        sys.setprofile(before)
    ours = [code for code in codes if code.co_filename.startswith(str(ROOT))]
    return {(Path(code.co_filename).relative_to(ROOT).as_posix(), name) for code in ours for name in code.co_qualname.split(".")}


def kernels(file):
    """The functions of a file that are compiled: Python does not enter them."""
    text = (ROOT / file).read_text(encoding="utf-8")
    if file.startswith("bvp/core/"):
        return set(re.findall(r"(?:class|struct) (\w+)", text)) | set(re.findall(r"^ *[\w:<>*& ,]+ (\w+)\(", text, re.MULTILINE))
    tree = ast.parse(text)
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.decorator_list}


def test_the_functions_of_the_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    found = entered(["continue", "S13O00+", "--energy", "0.1:20", "--plot", str(tmp_path / "figure.png")])
    assert len(STEPS) > 20
    for cell in STEPS:
        *functions, file = re.findall(r"`([^`]+)`", cell)
        for function in functions:
            assert (file, function) in found or function in kernels(file), cell


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "docs/reference/program.md", "tests/README.md", "README.md"])
def test_the_paths_on_a_page_exist(name):
    """Oracle: the files of the repository. Paths in tests/README.md start at tests/."""
    text = (ROOT / name).read_text(encoding="utf-8")
    paths = [path for path in re.findall(r"`([\w./-]+(?:\.py|\.toml|\.md|/))`", text) if "NAME" not in path]
    assert name == "README.md" or len(paths) > 5
    for path in paths:
        assert (ROOT / path).exists() or (ROOT / "tests" / path).exists(), path
