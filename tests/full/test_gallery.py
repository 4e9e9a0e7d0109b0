"""All figures of the paper's damped motions by one command. tests/saltus/test_gallery.py makes some of them."""

from __future__ import annotations

from saltus.commands.gallery import load_gallery
from tests.saltus.running import run


def test_all_figures_of_the_paper_are_made(capsys, tmp_path):
    """Oracle: the paper's list of figures; each has a picture, data and a caption."""
    code, out, err = run(capsys, "gallery", "paper", "--out", tmp_path)
    figures = load_gallery("paper")["figures"]
    assert code == 0 and not err and [line.split()[0] for line in out.splitlines()] == [*figures, "wrote"]
    page = (tmp_path / "captions.md").read_text(encoding="utf-8")
    for name, figure in figures.items():
        assert figure["caption"] in page and (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert all(file.stat().st_size > 0 for file in tmp_path.glob(f"{name}.*")) and len([*tmp_path.glob(f"{name}.*")]) == 3
