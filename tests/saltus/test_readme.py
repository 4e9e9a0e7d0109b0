"""The README and the pages of docs/: every command and snippet runs as it is printed, and every link leads somewhere."""

import importlib
import re
import shlex
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from saltus.__main__ import main
from saltus.scene import load_scene

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILES = ("--json", "--csv", "--npz", "--mat", "--graphml", "--dot", "--plot", "--catalogue", "--out")


def text_of(page):
    """Return the text of a page."""
    return page.read_text(encoding="utf-8")


def blocks(page):
    """Return the fenced blocks of a page: language and text."""
    return FENCE.findall(text_of(page))


def commands(page):
    """Return the shell commands of a page."""
    return [line for language, text in blocks(page) if language == "sh" for line in text.splitlines()]


def bare(page):
    """Return the text of a page without its blocks."""
    return FENCE.sub("", text_of(page))


def anchors(page):
    """Return the anchors of the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", bare(page), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


SETUP = [line for line in commands(ROOT / "README.md") if not line.startswith("saltus ")]


def run_command(line, folder, capsys):
    """Run a command: exit code 0, and the files that it names."""
    words = shlex.split(line)[1:]
    capsys.readouterr()
    assert main(words) == 0, line
    out, err = capsys.readouterr()
    assert out and ("-" in words or not err), line
    for option, value in zip(words, words[1:], strict=False):
        if option in FILES and value != "-":
            assert (folder / value).stat().st_size > 0, line


_HOW_TO = ("curves", "damped", "families", "figures", "forced", "sections", "smooth", "studies")
LONG = [ROOT / "docs" / f"{name}.md" for name in (*(f"how-to/{page}" for page in _HOW_TO), "limit", "tutorial")]
"""Pages whose commands take long. They run in tests/full; here their command lines are read."""


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page) and page not in LONG], ids=lambda page: str(page.relative_to(ROOT))
)
def test_a_page_runs(page, tmp_path, monkeypatch, capsys):
    """Oracle: see `require_page`."""
    require_page(page, tmp_path, monkeypatch, capsys)


@pytest.mark.parametrize("page", LONG, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_commands_of_a_long_page_have_valid_options(page, monkeypatch):
    """Oracle: exit codes. Each command line is read, and nothing is computed."""
    lines = [line for line in commands(page) if line not in SETUP]
    assert lines
    for line in lines:
        words = shlex.split(line)[1:]
        command = importlib.import_module("saltus.commands." + words[0].replace("continue", "continue_"))
        monkeypatch.setattr(command, "run", lambda arguments: 0)
        assert main(words) == 0, line


def require_page(page, tmp_path, monkeypatch, capsys):
    """Oracle: exit codes, files, and no error. The blocks of a page build on each other, as a reader types them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    names = {}
    for language, text in blocks(page):
        if language == "toml":
            named = re.match(r"# (\S+\.toml)\n", text)
            file = tmp_path / (named[1] if named else "scene.toml")
            file.write_text(text, encoding="utf-8")
            assert "[vary" in text or load_scene(file).title
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)
        else:
            for line in set(text.splitlines()) - set(SETUP):
                assert line.startswith("saltus ")
            for line in text.splitlines():
                if line not in SETUP:
                    run_command(line, tmp_path, capsys)
    plt.close("all")
    if "drift" in names:
        assert names["drift"] < 1e-13
    if "emanating" in names:
        assert names["emanating"]


def test_the_two_commands_do_all_the_set_up_in_one_line(tmp_path, monkeypatch):
    """Oracle: the words of each line: an environment, an installation, then the program; the program's part runs here."""
    assert len(SETUP) == 2
    for line in SETUP:
        environment, install, work = line.split(" && ")
        assert environment == "python3 -m venv .venv"
        assert install.startswith(".venv/bin/python -m pip install ")
        assert work.startswith(".venv/bin/")
    assert SETUP[0].endswith("saltus continue S13O00+ --plot S13O00+.png")
    assert SETUP[1].endswith("-m pytest -n 2 --dist loadfile")
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(SETUP[0].rpartition("saltus ")[2])) == 0
    assert (tmp_path / "S13O00+.png").read_bytes().startswith(b"\x89PNG")


def test_continuous_integration_runs_the_test_command_of_the_readme():
    """Oracle: the script's own pattern finds the command, and only it; the script has no copy of it."""
    script = text_of(ROOT / ".ci" / "run")
    pattern = re.search(r"grep -E '(.*)' README.md", script).group(1)
    found = [line for line in text_of(ROOT / "README.md").splitlines() if re.search(pattern, line)]
    assert found == [SETUP[1]]
    assert "pip install" not in script
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111


@pytest.mark.parametrize("page", [*PAGES, ROOT / "tests" / "README.md"], ids=[*NAMES, "tests/README.md"])
def test_links_lead_somewhere(page):
    """Oracle: the files of the repository, and the headings of their pages."""
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", bare(page)):
        if target.startswith("https://"):
            continue
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), f"{target}#{anchor}"


def test_the_index_has_every_page():
    """Oracle: the files of docs/."""
    index = ROOT / "docs" / "index.md"
    linked = {(index.parent / target).resolve() for target in re.findall(r"\]\(([^)#]+)", text_of(index))}
    assert set((ROOT / "docs").rglob("*.md")) - {index} <= linked


def test_every_block_is_one_that_the_tests_run():
    """Oracle: the languages that `require_page` knows. A TOML file with a name is used by a command of its page."""
    for page in PAGES:
        assert text_of(page).count("```") == 2 * len(blocks(page))
        assert {language for language, _ in blocks(page)} <= {"sh", "python", "toml"}
        named = re.findall(r"^```toml\n# (.*)$", text_of(page), re.MULTILINE)
        assert all(any(name in shlex.split(line) for line in commands(page)) for name in named)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_commands_in_the_text_of_a_page_exist(page, capsys):
    """Oracle: the help of each command that is named in a line of text, which has its options."""
    if page.name == "changes.md":
        return
    for line in re.findall(r"`saltus ([a-z][^`]*)`", bare(page)):
        words = shlex.split(line)
        with pytest.raises(SystemExit) as ended:
            main([*words[: 2 if words[0] == "export" and len(words) > 1 else 1], "--help"])
        assert ended.value.code == 0
        assert set(re.findall(r"--[a-z-]+", line)) <= set(re.findall(r"--[a-z-]+", capsys.readouterr().out)), line


def test_the_readme_is_short():
    """Oracle: the limit of 120 lines."""
    assert len(text_of(ROOT / "README.md").splitlines()) <= 120
