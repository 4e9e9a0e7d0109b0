"""All figures of the paper by one command, and two of them beside their own commands."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from benchmarks import backbone
from branches.figures.atlas import atlas_figure
from branches.figures.curves import parse_inset
from branches.figures.data import read_atlas
from branches.figures.room import short_name
from saltus.commands.gallery import load_gallery
from saltus.scene import load_scene
from tests.branches.test_diagram import assert_texts_apart
from tests.saltus.running import run
from tests.saltus.test_gallery import PAPER

DETAILS = [PAPER["fig6"]["words"][k + 1] for k, word in enumerate(PAPER["fig6"]["words"]) if word == "--inset"]


@pytest.mark.parametrize("gallery", ["paper", "limit"])
def test_all_figures_are_made(capsys, tmp_path, gallery):
    """Oracle: the list of figures; each has a picture, data and a caption."""
    code, out, err = run(capsys, "gallery", gallery, "--out", tmp_path)
    figures = load_gallery(gallery)["figures"]
    built = ["families.sqlite"] if gallery == "paper" else []
    assert code == 0 and not err and [line.split()[0] for line in out.splitlines()] == [*built, *figures, "wrote"]
    page = (tmp_path / "captions.md").read_text(encoding="utf-8")
    if gallery == "paper":
        require_the_frequency_energy_plot(tmp_path / "fig6.json")
    for name, figure in figures.items():
        assert figure["caption"] in page and (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert all(file.stat().st_size > 0 for file in tmp_path.glob(f"{name}.*")) and len([*tmp_path.glob(f"{name}.*")]) == 3


def require_the_frequency_energy_plot(path):
    """Oracles: the paper's names, each of which is written in the plot or in a detail, and both linear modes; the fold of S11- by its
    closed form, which is marked; the texts do not overlap."""
    figure = atlas_figure(read_atlas(path), insets=[parse_inset(text) for text in DETAILS])
    assert_texts_apart(figure, "png")
    texts = {text.get_text() for axes in figure.axes for text in axes.texts}
    names = (*load_scene().names, "L11+", "L11-")
    assert len(names) == 24 and not [name for name in names if short_name(name) not in texts]
    system = load_scene().system
    fold = minimize_scalar(lambda alpha: backbone.energy(system, alpha), bounds=(1.1, 1.2), method="bounded", options={"xatol": 1e-9})
    for axes in figure.axes[:2]:
        (marks,) = (line for line in axes.lines if line.get_gid() == f"{axes.get_label()}-events-SN")
        places = np.asarray(marks.get_xydata())
        assert np.any(np.abs(places / (fold.fun, math.pi / (2.0 * fold.x)) - 1.0).max(axis=1) < 1e-6)


def test_stages_are_those_of_the_page(tmp_path, capsys):
    """Oracle: docs/reference/paper_damped.md, row 17: what a motion of the gallery follows, and when."""
    assert run(capsys, "gallery", "paper", "--out", tmp_path, "--figure", "fig13")[0] == 0
    stages = json.loads((tmp_path / "fig13.json").read_text())["stages"]
    found = [(pytest.approx(stage["start"], abs=0.06), stage["follows"] and stage["follows"]["label"]) for stage in stages]
    assert found[0] == (4.6, "S13O00+") and found[-1] == (215.1, "L11+")
    assert any(stage["follows"] and stage["follows"]["family"] == "rest-stop+::2c49f5ff" for stage in stages)


def test_a_catalogue_lies_behind(capsys, tmp_path, small_scene):
    """Oracles: stages named by other families than the one that the motion starts on; a family that the catalogue lacks is said, its figure
    is left out and the others are made."""
    path, _ = small_scene
    words = ("gallery", "paper", "--out", tmp_path / "figures", "--catalogue", path)
    code, out, err = run(capsys, *words, "--figure", "fig18", "--figure", "fig20")
    assert code == 1 and "S95E22-" in err and "fig18 was not made" in err
    assert [line.split()[0] for line in out.splitlines()] == ["fig20", "wrote"]
    assert not (tmp_path / "figures" / "fig18.txt").exists() and "fig18" not in (tmp_path / "figures" / "captions.md").read_text()
    stages = json.loads((tmp_path / "figures" / "fig20.json").read_text())["stages"]
    followed = {stage["follows"]["label"] for stage in stages if stage["follows"]}
    assert followed & {"S13O00+"}


def test_figures_with_their_data(capsys, tmp_path):
    """Oracle: the same command run by itself; a line a figure; the page of captions."""
    place = tmp_path / "new {stem}" / "figures"
    code, out, err = run(capsys, "gallery", "paper", "--out", place, "--figure", "fig17", "--figure", "fig16", "--format", "svg")
    assert code == 0 and not err
    assert [line.split()[0] for line in out.splitlines()] == ["families.sqlite", "fig16", "fig17", "wrote"]
    assert sorted(path.name for path in place.iterdir()) == sorted(
        ["captions.md", "families.sqlite", *(f"{name}.{kind}" for name in ("fig16", "fig17") for kind in ("svg", "json", "txt"))]
    )
    page = (place / "captions.md").read_text()
    for name in ("fig16", "fig17"):
        caption = PAPER[name]["caption"]
        assert caption in page and f"({name}.svg)" in page
        made = json.loads((place / f"{name}.json").read_text())
        code, out, _ = run(
            capsys, *PAPER[name]["words"], "--stages", "--json", "-", "--samples", "4000", "--catalogue", place / "families.sqlite"
        )
        assert code == 0 and made == json.loads(out)
        assert "last at" in (place / f"{name}.txt").read_text()
        picture = (place / f"{name}.svg").read_text()
        assert "<svg" in picture and caption[:40] in picture
