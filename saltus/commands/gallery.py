"""`saltus gallery NAME --out DIR`: the figures of a publication, each with its data beside it."""

from __future__ import annotations

import argparse
import contextlib
import io
import time
from pathlib import Path

from saltus import catalogue_arguments
from saltus.arguments import one_of
from saltus.errors import DONE, FAILED, INTERRUPTED, say, say_and_code
from saltus.files import WriteFailure, output_folder, write_data
from saltus.galleries import Figure, Gallery, load_gallery

__all__ = ["add_arguments", "run"]

CAPTIONS = "captions.md"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="the gallery: paper")
    parser.add_argument("--out", metavar="DIR", required=True, help="the folder that the figures are written into; made if there is none")
    parser.add_argument("--figure", metavar="FIG", action="append", help="this figure alone, by the name of its files; can be repeated")
    parser.add_argument("--format", metavar="KIND", type=one_of("png", "pdf", "svg"), default="png", help="png (default), pdf or svg")
    catalogue_arguments.add_file(parser, "take families from this catalogue: starts, stages, behind the spectra, on the sections")


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from saltus.scene import load_scene

    gallery = load_gallery(arguments.name)
    figures = gallery.chosen(arguments.figure)
    with catalogue_arguments.given(arguments, load_scene(gallery.scene)):
        pass  # A file that is no catalogue, or one of another system, is refused before the work.
    files = [CAPTIONS, *(name for figure in figures for name in _names(figure, arguments.format))]
    folder = output_folder("--out", arguments.out, files)
    more = [] if arguments.catalogue is None else ["--catalogue", arguments.catalogue]
    made: list[Figure] = []
    code = DONE
    for figure in figures:
        begun = time.monotonic()
        ended = _make(figure, folder, arguments.format, more)
        if ended == INTERRUPTED:
            code = INTERRUPTED
            break
        if ended == DONE:
            made.append(figure)
            print(f"{figure.name}  {time.monotonic() - begun:5.1f} s  {figure.caption}", flush=True)
        else:
            say(f"{figure.name} was not made")
            code = max(code, FAILED)
    if made:
        try:
            write_data(str(folder / CAPTIONS), captions(gallery, made, arguments.format))
        except WriteFailure as failure:
            return max(code, say_and_code(failure))
        print(f"wrote  {len(made)} figures with their data and {CAPTIONS} into {arguments.out}", flush=True)
    return code


def captions(gallery: Gallery, figures: list[Figure], picture: str) -> str:
    """The text of the page that lists figures with their captions."""
    lines = [f"# {gallery.title}", "", f"After {gallery.source}.", ""]
    for figure in figures:
        files = " ".join(f"[{name}]({name})" for name in _names(figure, picture))
        lines += [f"- {files}", f"  {figure.caption}", f"  `saltus {' '.join(figure.words)}`"]
    return "\n".join(lines) + "\n"


def _names(figure: Figure, picture: str) -> list[str]:
    """The files of a figure: what its command writes, and what it prints."""
    return [*figure.written(figure.name, picture), f"{figure.name}.txt"]


def _make(figure: Figure, folder: Path, picture: str, more: list[str]) -> int:
    """Run the command of a figure; keep what it prints beside the picture. Its exit code; what went wrong is told on standard error."""
    from saltus.__main__ import main

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = main([*figure.command(str(folder / figure.name), picture), *more])
    if code == DONE:
        try:
            write_data(str(folder / f"{figure.name}.txt"), printed.getvalue())
        except WriteFailure as failure:
            return say_and_code(failure)
    return code
