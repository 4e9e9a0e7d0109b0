"""`saltus gallery NAME --out DIR`: the figures of a publication, each with its data beside it."""

from __future__ import annotations

import argparse
import contextlib
import io
import shlex
import time
import tomllib
from typing import Any

from saltus import catalogues
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, say
from saltus.outputs import output_folder, write_data

CAPTIONS = "captions.md"
CATALOGUE = "families.sqlite"


def load_gallery(name: str) -> dict[str, Any]:
    """Read a gallery that ships with saltus: ``title``, ``source``, ``scene``, and ``figures`` by their names.

    A figure has a ``caption``, the ``words`` of its command, and the options of its ``files``, with {stem}, {format}, {caption} and
    {catalogue}. Words can name a file of an earlier figure, in {folder}. ``catalogue`` has the words of the command that builds a
    catalogue for the figures, if they need one.

    Examples
    --------
    >>> list(load_gallery("paper")["figures"])[:2]
    ['fig2', 'fig5']
    """
    from saltus.scene import SHIPPED

    shipped = {entry.stem: entry for entry in (SHIPPED / "galleries").glob("*.toml")}
    if name not in shipped:
        raise BadInput(f"unknown gallery {name!r}, expected one of {', '.join(sorted(shipped))}{nearest(name, shipped)}")
    gallery = tomllib.loads(shipped[name].read_text(encoding="utf-8"))
    figures = {}
    for entry in gallery["figures"]:
        words = shlex.split(entry["words"])
        command = " ".join(words[: 2 if words[0] == "export" else 1])  # `export` is one for each of what it writes
        figures[entry["name"]] = {"caption": entry["caption"], "words": words, "files": gallery["files"][command]}
    return {**gallery, "figures": figures}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="the gallery: paper, absorber or limit")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder of the figures; made if there is none")
    parser.add_argument("--figure", metavar="FIG", action="append", help="this figure only, by the name of its files; can be repeated")
    parser.add_argument("--format", metavar="KIND", choices=("png", "pdf", "svg"), default="png", help="png (default), pdf or svg")
    parser.add_argument(
        "--catalogue", metavar="FILE",
        help="take families from this catalogue: starts, stages, behind the spectra, on the sections (default: the gallery's own, if it "
        "needs one, which is built once in the folder)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from saltus.scene import load_scene

    gallery = load_gallery(arguments.name)
    figures = gallery["figures"]
    for name in arguments.figure or ():
        if name not in figures:
            raise BadInput(f"unknown figure {name!r}, expected one of {', '.join(figures)}{nearest(name, figures)}")
    figures = {name: figure for name, figure in figures.items() if not arguments.figure or name in arguments.figure}
    with catalogues.given(arguments, load_scene(gallery["scene"])):
        pass  # A file that is no catalogue, or one of another system, is refused before the work.
    files = {name: _files(name, figure, arguments.format) for name, figure in figures.items()}
    folder = output_folder("--out", arguments.out, [CAPTIONS, *sum(files.values(), [])])
    place, needed = arguments.catalogue, any("{catalogue}" in figure["files"] for figure in figures.values())
    if place is None and needed:
        place = str(folder / CATALOGUE)
        begun = time.monotonic()
        ended, lines = _printed([*shlex.split(gallery["catalogue"]), "--catalogue", place])
        if ended != DONE:
            return ended
        found = next((line.split(",")[0].partition(" ")[2].strip() for line in lines.splitlines() if line.startswith("done")), "")
        print(f"{CATALOGUE}  {time.monotonic() - begun:5.1f} s  {found} by saltus {gallery['catalogue']}", flush=True)
    page = [f"# {gallery['title']}", "", f"After {gallery['source']}.", ""]
    made = 0
    code = DONE
    for name, figure in figures.items():
        begun = time.monotonic()
        caption = figure["caption"]
        options = [text.format(stem=folder / name, format=arguments.format, caption=caption, catalogue=place) for text in figure["files"]]
        more = [] if needed or arguments.catalogue is None else ["--catalogue", arguments.catalogue]
        words = [word.replace("{folder}", str(folder)) for word in figure["words"]]
        ended, printed = _printed([*words, *options, *more])
        if ended == INTERRUPTED:
            code = INTERRUPTED
            break
        if ended != DONE:
            say(f"{name} was not made")
            code = FAILED
            continue
        write_data(str(folder / f"{name}.txt"), printed)
        made += 1
        listed = " ".join(f"[{file}]({file})" for file in files[name])
        page += [f"- {listed}", f"  {caption}", f"  `saltus {' '.join(figure['words'])}`"]
        print(f"{name}  {time.monotonic() - begun:5.1f} s  {caption}", flush=True)
    if made:
        write_data(str(folder / CAPTIONS), "\n".join(page) + "\n")
        print(f"wrote  {made} figures with their data and {CAPTIONS} into {arguments.out}")
    return code


def _printed(words: list[str]) -> tuple[int, str]:
    """The exit code of a command, and what it prints."""
    from saltus.__main__ import main

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        return main(words), printed.getvalue()


def _files(name: str, figure: dict[str, Any], suffix: str) -> list[str]:
    """The names of a figure's files: what its command writes, and what it prints."""
    written = [text.format(stem=name, format=suffix) for text in figure["files"] if text.startswith("{stem}")]
    return [*written, f"{name}.txt"]
