"""Galleries: lists of figures, each made by a command of saltus, that ship as data."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

from saltus.errors import BadInput, nearest

__all__ = ["Figure", "Gallery", "gallery_names", "load_gallery"]


@dataclass(frozen=True)
class Figure:
    """One figure of a gallery.

    Attributes
    ----------
    name : str
        Of its files, without ending.
    caption : str
        What is cited in it and what is our choice.
    words : tuple of str
        The command that makes it, without the files that it writes.
    files : tuple of str
        The options that name these, with {stem}, {format} and {caption}.
    """

    name: str
    caption: str
    words: tuple[str, ...]
    files: tuple[str, ...]

    def command(self, stem: str, picture: str) -> list[str]:
        """The words of the command that makes the figure.

        Parameters
        ----------
        stem : str
            The place of its files without ending.
        picture : {"png", "pdf", "svg"}

        Examples
        --------
        >>> Figure("one", "A motion.", ("run", "--impulse", "1"), ("--plot", "{stem}.{format}")).command("out/one", "pdf")
        ['run', '--impulse', '1', '--plot', 'out/one.pdf']
        """
        return [*self.words, *self._filled(stem, picture)]

    def written(self, stem: str, picture: str) -> list[str]:
        """The files that it writes.

        Examples
        --------
        >>> Figure("one", "A motion.", ("run",), ("--plot", "{stem}.{format}", "--samples", "9")).written("out/one", "pdf")
        ['out/one.pdf']
        """
        return [word for word, raw in zip(self._filled(stem, picture), self.files, strict=True) if raw.startswith("{stem}")]

    def _filled(self, stem: str, picture: str) -> list[str]:
        # Not str.format: a folder's name may hold braces.
        values = {"{stem}": stem, "{format}": picture, "{caption}": self.caption}
        out = []
        for word in self.files:
            head, dot, ending = word.partition(".")
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
