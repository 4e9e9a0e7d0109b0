"""All figures of the paper's damped motions by one command, and two of them beside their own commands."""

from __future__ import annotations

import json

import pytest

from saltus.commands.gallery import load_gallery
from tests.saltus.running import run
from tests.saltus.test_gallery import PAPER


@pytest.mark.parametrize("gallery", ["paper", "limit"])
def test_all_figures_are_made(capsys, tmp_path, gallery):
    """Oracle: the list of figures; each has a picture, data and a caption."""
    code, out, err = run(capsys, "gallery", gallery, "--out", tmp_path)
    figures = load_gallery(gallery)["figures"]
    assert code == 0 and not err and [line.split()[0] for line in out.splitlines()] == [*figures, "wrote"]
    page = (tmp_path / "captions.md").read_text(encoding="utf-8")
    for name, figure in figures.items():
        assert figure["caption"] in page and (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert all(file.stat().st_size > 0 for file in tmp_path.glob(f"{name}.*")) and len([*tmp_path.glob(f"{name}.*")]) == 3


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
    assert [line.split()[0] for line in out.splitlines()] == ["fig16", "fig17", "wrote"]
    assert sorted(path.name for path in place.iterdir()) == sorted(
        ["captions.md", *(f"{name}.{kind}" for name in ("fig16", "fig17") for kind in ("svg", "json", "txt"))]
    )
    page = (place / "captions.md").read_text()
    for name in ("fig16", "fig17"):
        caption = PAPER[name]["caption"]
        assert caption in page and f"({name}.svg)" in page
        made = json.loads((place / f"{name}.json").read_text())
        code, out, _ = run(capsys, *PAPER[name]["words"], "--stages", "--json", "-", "--samples", "4000")
        assert code == 0 and made == json.loads(out)
        assert "last at" in (place / f"{name}.txt").read_text()
        picture = (place / f"{name}.svg").read_text()
        assert "<svg" in picture and caption[:40] in picture
