"""`saltus gallery NAME --out DIR`: the figures of a publication, each with its data beside it."""

from __future__ import annotations

import argparse
import contextlib
import io
import shlex
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from saltus import catalogues
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, nearest, say, say_and_code
from saltus.outputs import WriteFailure, output_folder, write_data

__all__ = ["Figure", "Gallery", "add_arguments", "gallery_names", "load_gallery", "run"]

CAPTIONS = "captions.md"


@dataclass(frozen=True)
class Figure:
    """One figure of a gallery.

    Attributes
    ----------
    name : str
        Of its files, without ending.
    caption : str
        Which values are cited from the publication, and which ones are our choice.
    words : tuple of str
        The command that makes it, without the files that it writes.
    files : tuple of str
        The options that name these, with {stem}, {format} and {caption}.
    """

    name: str
    caption: str
    words: tuple[str, ...]
    files: tuple[str, ...]

    def command(self, stem: str, suffix: str) -> list[str]:
        """The words of the command that makes the figure.

        Parameters
        ----------
        stem : str
            The place of its files without ending.
        suffix : {"png", "pdf", "svg"}

        Examples
        --------
        >>> Figure("one", "A motion.", ("run", "--impulse", "1"), ("--plot", "{stem}.{format}")).command("out/one", "pdf")
        ['run', '--impulse', '1', '--plot', 'out/one.pdf']
        """
        return [*self.words, *self._filled(stem, suffix)]

    def written(self, stem: str, suffix: str) -> list[str]:
        """The files that it writes.

        Examples
        --------
        >>> Figure("one", "A motion.", ("run",), ("--plot", "{stem}.{format}", "--samples", "9")).written("out/one", "pdf")
        ['out/one.pdf']
        """
        return [text for text, raw in zip(self._filled(stem, suffix), self.files, strict=True) if raw.startswith("{stem}")]

    def _filled(self, stem: str, suffix: str) -> list[str]:
        # Not str.format: a folder's name may hold braces.
        values = {"{stem}": stem, "{format}": suffix, "{caption}": self.caption}
        out = []
        for text in self.files:
            head, dot, ending = text.partition(".")
            out.append(values.get(head, head) + dot + values.get(ending, ending))
        return out


@dataclass(frozen=True)
class Gallery:
    """A list of figures.

    Attributes
    ----------
    title, source : str
    scene : str
        The scene that its commands run, which is the default one.
    figures : tuple of Figure
    """

    title: str
    source: str
    scene: str
    figures: tuple[Figure, ...]

    def chosen(self, names: list[str] | None) -> tuple[Figure, ...]:
        """The figures with these names, in the gallery's order; all where none is given.

        Raises
        ------
        BadInput
            For a name that no figure has.
        """
        known = [figure.name for figure in self.figures]
        for name in names or ():
            if name not in known:
                raise BadInput(f"unknown figure {name!r}, expected one of {', '.join(known)}{nearest(name, known)}")
        return tuple(figure for figure in self.figures if not names or figure.name in names)


def gallery_names() -> list[str]:
    """The galleries that ship with saltus.

    Examples
    --------
    >>> gallery_names()
    ['paper']
    """
    return sorted(_shipped())


def load_gallery(name: str) -> Gallery:
    """Read a gallery that ships with saltus.

    Raises
    ------
    BadInput
        For an unknown name.

    Examples
    --------
    >>> [figure.name for figure in load_gallery("paper").figures][:2]
    ['fig10', 'fig11']
    """
    shipped = _shipped()
    if name not in shipped:
        raise BadInput(f"unknown gallery {name!r}, expected one of {', '.join(sorted(shipped))}{nearest(name, shipped)}")
    content = tomllib.loads(shipped[name])
    figures = []
    for entry in content["figures"]:
        words = tuple(shlex.split(entry["words"]))
        figures.append(Figure(entry["name"], entry["caption"], words, tuple(content["files"][words[0]])))
    return Gallery(content["title"], content["source"], content["scene"], tuple(figures))


def _shipped() -> Mapping[str, str]:
    """The text of each gallery, by bare name."""
    folder = resources.files("catalogues") / "galleries"
    entries = [entry for entry in folder.iterdir() if entry.name.endswith(".toml")]
    return {entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8") for entry in entries}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="the gallery: paper")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder of the figures; made if there is none")
    parser.add_argument("--figure", metavar="FIG", action="append", help="this figure only, by the name of its files; can be repeated")
    parser.add_argument("--format", metavar="KIND", choices=("png", "pdf", "svg"), default="png", help="png (default), pdf or svg")
    parser.add_argument(
        "--catalogue", metavar="FILE", help="take families from this catalogue: starts, stages, behind the spectra, on the sections"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from saltus.scene import load_scene

    gallery = load_gallery(arguments.name)
    figures = gallery.chosen(arguments.figure)
    with catalogues.given(arguments, load_scene(gallery.scene)):
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


def captions(gallery: Gallery, figures: list[Figure], suffix: str) -> str:
    """The text of the page that lists figures with their captions."""
    lines = [f"# {gallery.title}", "", f"After {gallery.source}.", ""]
    for figure in figures:
        files = " ".join(f"[{name}]({name})" for name in _names(figure, suffix))
        lines += [f"- {files}", f"  {figure.caption}", f"  `saltus {' '.join(figure.words)}`"]
    return "\n".join(lines) + "\n"


def _names(figure: Figure, suffix: str) -> list[str]:
    """The files of a figure: what its command writes, and what it prints."""
    return [*figure.written(figure.name, suffix), f"{figure.name}.txt"]


def _make(figure: Figure, folder: Path, suffix: str, more: list[str]) -> int:
    """Run the command of a figure; keep what it prints beside the figure. Return its exit code; errors go to standard error."""
    from saltus.__main__ import main

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = main([*figure.command(str(folder / figure.name), suffix), *more])
    if code == DONE:
        try:
            write_data(str(folder / f"{figure.name}.txt"), printed.getvalue())
        except WriteFailure as failure:
            return say_and_code(failure)
    return code
