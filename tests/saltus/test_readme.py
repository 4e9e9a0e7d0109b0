"""The README and the pages of docs/: every command and snippet runs as it stands there, and every link leads somewhere."""

import re
import shlex
from pathlib import Path

import pytest

from saltus.__main__ import main
from saltus.scene import load_scene

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page):
    """Return the fenced blocks of a page: language and text."""
    return FENCE.findall(page.read_text(encoding="utf-8"))


def commands(page):
    """Return the shell commands of a page."""
    return [line for language, text in blocks(page) if language == "sh" for line in text.splitlines()]


def programs():
    """Return the blocks of commands that run as they stand: page and lines, which build on each other."""
    found = [(page.name, text.splitlines()) for page in PAGES for language, text in blocks(page) if language == "sh"]
    return [(page, lines) for page, lines in found if all(line.startswith("saltus ") for line in lines)]


def write_files(page, folder):
    """Write the TOML blocks of a page whose first line names a file, as a comment."""
    for language, text in blocks(page):
        named = re.match(r"# (\S+\.toml)\n", text)
        if language == "toml" and named:
            (folder / named[1]).write_text(text, encoding="utf-8")


SETUP = [line for line in commands(ROOT / "README.md") if not line.startswith("saltus ")]


@pytest.mark.parametrize(("page", "lines"), programs(), ids=[f"{page}: {lines[0]}" for page, lines in programs()])
def test_the_commands_of_a_block_run(page, lines, tmp_path, monkeypatch, capsys):
    """Oracle: exit code 0, and the files that the commands name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    write_files(next(path for path in PAGES if path.name == page), tmp_path)
    for line in lines:
        words = shlex.split(line)[1:]
        assert main(words) == 0
        out, err = capsys.readouterr()
        assert out and ("-" in words or not err)
        for option, value in zip(words, words[1:], strict=False):
            if option in ("--json", "--csv", "--npz", "--mat", "--plot", "--orbit", "--catalogue", "--out") and value != "-":
                assert (tmp_path / value).stat().st_size > 0


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
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    pattern = re.search(r"grep -E '(.*)' README.md", script).group(1)
    found = [line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if re.search(pattern, line)]
    assert found == [SETUP[1]]
    assert "pip install" not in script
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_the_python_and_toml_of_a_page_run(page, tmp_path, monkeypatch):
    """Oracle: no error; the blocks of a page build on each other, as a reader would type them."""
    monkeypatch.chdir(tmp_path)
    names = {}
    write_files(page, tmp_path)
    for language, text in blocks(page):
        if language == "toml" and not text.startswith("# "):
            (tmp_path / "two-masses.toml").write_text(text, encoding="utf-8")
            assert load_scene(tmp_path / "two-masses.toml").title
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)
    if "drift" in names:
        assert names["drift"] < 1e-13
    if "born" in names:
        assert names["born"]


def test_the_scene_of_the_how_to_is_followed(tmp_path, capsys):
    """Oracle: exit code 0 for the command that the page gives in its text."""
    page = ROOT / "docs" / "how-to" / "families.md"
    line = re.search(r"`(saltus continue \S+ --scene two-masses.toml)`", page.read_text(encoding="utf-8")).group(1)
    scene = tmp_path / "two-masses.toml"
    scene.write_text(next(text for language, text in blocks(page) if language == "toml"), encoding="utf-8")
    assert main(shlex.split(line.replace("two-masses.toml", str(scene)))[1:]) == 0
    assert "start" in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_links_lead_somewhere(page):
    """Oracle: the files of the repository."""
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_every_block_is_one_that_the_tests_run():
    """Oracle: the languages that the tests above run; the commands are those of `programs` and `SETUP`, which name each file."""
    ran = [line for _, lines in programs() for line in lines] + SETUP
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert text.count("```") == 2 * len(blocks(page))
        assert {language for language, _ in blocks(page)} <= {"sh", "python", "toml"}
        assert set(commands(page)) <= set(ran)
        named = re.findall(r"^```toml\n# (.*)$", text, re.MULTILINE)
        assert all(any(name in shlex.split(line) for line in commands(page)) for name in named)


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_the_commands_in_the_text_of_a_page_exist(page, capsys):
    """Oracle: the help of each command that stands in a line of text, which has its options."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for line in re.findall(r"`saltus ([a-z][^`]*)`", text):
        with pytest.raises(SystemExit) as ended:
            main([shlex.split(line)[0], "--help"])
        said = capsys.readouterr().out
        assert ended.value.code == 0
        assert set(re.findall(r"--[a-z-]+", line)) <= set(re.findall(r"--[a-z-]+", said)), line
