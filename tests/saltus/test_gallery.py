"""`saltus gallery`. Oracles: the paper's list of figures, the words of refusals."""

import configparser
import re
from importlib import resources
from pathlib import Path

from branches.catalogue import Catalogue
from saltus.commands.gallery import load_gallery
from tests.docs.pages import page, table
from tests.saltus.running import run

ROOT = Path(__file__).parents[2]
PAPER = load_gallery("paper")["figures"]


def test_the_figures_of_the_paper_are_there():
    """Oracle: the paper's numbers of figures, but for a photograph, two sketches, and those of which the text has no caption; each caption
    says what is cited and what is our choice; each has a picture and data."""
    numbers = [re.sub(r"[a-d]$", "", name.removeprefix("fig")) for name in PAPER]
    assert [*dict.fromkeys(numbers)] == [str(k) for k in (2, *range(5, 21))] + ["modes14", "27", "28", "29", "30"]
    for name, figure in PAPER.items():
        caption = figure["caption"]
        begins = {"modes14": "Empirical modes", "fig9a": "Fig. 9, left:", "fig9b": "Fig. 9, right:"}
        number = re.sub(r"([0-9])([a-d])$", r"\1(\2)", name.removeprefix("fig"))
        assert caption.startswith(begins.get(name, f"Fig. {number}: ")) and "Cited: " in caption and "Our choice: " in caption
        assert sum(text.startswith("{stem}") for text in figure["files"]) == 2
    damped = {name: " ".join(figure["words"]) for name, figure in PAPER.items() if figure["words"][0] == "run"}
    assert all("--rho 0.7 --lam 0.01" in words for name, words in damped.items() if name not in ("fig2", "fig11", "fig12"))
    assert all("--rho 0.7 --lam 0 " in damped[name] for name in ("fig2", "fig11")) and "--rho 1 --lam 0.01" in damped["fig12"]


def test_the_page_names_the_command_of_each_figure():
    """Oracle: the gallery; a table of the page has every figure with the words of its command."""
    rows = {cells[1].strip("`"): cells[2] for cells in table(page("paper.md"), "Figures") if cells[1].startswith("`")}
    assert rows == {name: f"`saltus {' '.join(figure['words'])}`" for name, figure in PAPER.items()}


def test_a_catalogue_is_built_once_and_named(capsys, tmp_path, small_scene):
    """Oracles: the file is there with the families that the scene names, a second run adds none; a given one is taken in its place; an
    orbit needs none."""
    code, out, err = run(capsys, "gallery", "paper", "--out", tmp_path / "a", "--figure", "fig27")
    assert code == 0 and not err and [line.split()[0] for line in out.splitlines()] == ["families.sqlite", "fig27", "wrote"]
    with Catalogue(tmp_path / "a" / "families.sqlite") as catalogue:
        ids = {row.id for row in catalogue.families()}
        assert {catalogue.find(name).id for name in ("S13+", "S95E22-", "U5421-", "U4122-", "U8353-")} <= ids
        assert max(row.alpha[1] for row in catalogue.families() if row.impacts <= 2.0) > 4.0
    again = run(capsys, "gallery", "paper", "--out", tmp_path / "a", "--figure", "fig27")[1]
    assert again.splitlines()[0].split("by")[0].split()[-2:] == [str(len(ids)), "families"]
    code, out, err = run(capsys, "gallery", "paper", "--out", tmp_path / "b", "--figure", "fig27", "--catalogue", small_scene[0])
    assert code == 0 and not err and sorted(place.name for place in (tmp_path / "b").iterdir()) == [
        "captions.md", "fig27.csv", "fig27.png", "fig27.txt"
    ]  # fmt: skip
    run(capsys, "gallery", "paper", "--out", tmp_path / "c", "--figure", "fig7a")
    assert not (tmp_path / "c" / "families.sqlite").exists() and (tmp_path / "c" / "fig7a.png").exists()


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
    assert code == 130 and [line.split()[0] for line in out.splitlines()] == ["families.sqlite", "fig14", "wrote"]
    page = (tmp_path / "captions.md").read_text()
    assert "fig14.json" in page and "fig16" not in page and "fig17" not in page
