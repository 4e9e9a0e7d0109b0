"""`saltus gallery`. Oracles: the paper's list of figures, the words of refusals."""

import configparser
from importlib import resources
from pathlib import Path

from saltus.commands.gallery import load_gallery
from tests.saltus.running import run

ROOT = Path(__file__).parents[2]
PAPER = load_gallery("paper")["figures"]


def test_the_figures_of_section_3_are_there():
    """Oracle: the paper's numbers of figures; each caption says what is cited and what is our choice; each has a picture and data."""
    assert list(PAPER) == [f"fig{k}" for k in (10, 11, 12, 13, 14, 16, 17, 18, 19, 20)]
    for name, figure in PAPER.items():
        caption = figure["caption"]
        assert caption.startswith(f"Fig. {name[3:]}: ") and "Cited: " in caption and "Our choice: " in caption
        assert sum(text.startswith("{stem}") for text in figure["files"]) == 2
    damped = {name: " ".join(figure["words"]) for name, figure in PAPER.items() if figure["words"][0] == "run"}
    assert all("--rho 0.7 --lam 0.01" in words for name, words in damped.items() if name not in ("fig11", "fig12"))
    assert "--rho 0.7 --lam 0 " in damped["fig11"] and "--rho 1 --lam 0.01" in damped["fig12"]


def test_galleries_are_installed():
    """Oracle: setup.cfg's patterns."""
    configuration = configparser.ConfigParser()
    configuration.read(ROOT / "setup.cfg", encoding="utf-8")
    assert "galleries/*.toml" in configuration["options.package_data"]["catalogues"]
    shipped = (entry.name for entry in (resources.files("catalogues") / "galleries").iterdir())
    assert sorted(shipped) == ["absorber.toml", "limit.toml", "paper.toml"]


def test_what_is_interrupted_lists_what_was_made(capsys, tmp_path, monkeypatch):
    """Oracle: exit code 130; the page of captions has the figures that there are."""
    import saltus.commands.run as command

    plain = command.run

    def second_is_interrupted(arguments):
        if arguments.on == "S11O00-":
            raise KeyboardInterrupt
        arguments.duration = 20.0
        return plain(arguments)

    monkeypatch.setattr(command, "run", second_is_interrupted)
    words = ("--figure", "fig14", "--figure", "fig16", "--figure", "fig17")
    code, out, _ = run(capsys, "gallery", "paper", "--out", tmp_path, *words)
    assert code == 130 and [line.split()[0] for line in out.splitlines()] == ["fig14", "wrote"]
    page = (tmp_path / "captions.md").read_text()
    assert "fig14.json" in page and "fig16" not in page and "fig17" not in page
