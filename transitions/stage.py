"""A stage of a motion: what is told of it, in words and as plain data, and what changes from one stage to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["Change", "Companion", "Follows", "Stage", "changes", "stage_from_data", "stages_as_data"]


@dataclass(frozen=True)
class Follows:
    """What a stage follows.

    Parameters
    ----------
    family, label : str
        Id, and the label of its orbit in the middle of the stage ("" outside the grammar of labels).
    harmonic : int
        k of the harmonic k 2 pi/T that the ridge is at.
    deviation : float
        Mean distance of the ridge from it, in octaves.
    share : float
        Part of the orbit's amplitude that the harmonic carries, mean over the stage.
    impacts : int
        In a period of the orbit; 0 of a linear mode.
    harmonics : tuple of int
        Rising: this one, and those others that carry a fifth both of the orbit's amplitude and of the motion's.
    others : tuple of str
        Ids of the other families that fit as well (`transitions.following.best_of` says what that means): by spectrum and impacts they are
        not told apart, and this one is named because it has the fewest impacts in a period.
    name : str
        What the family is called in place of its label: that of the start has one name in all stages.
    """

    family: str
    label: str
    harmonic: int
    deviation: float
    share: float
    impacts: int
    harmonics: tuple[int, ...]
    others: tuple[str, ...]
    name: str = ""

    @property
    def called(self) -> str:
        """Its name, else its label, else its id.

        Examples
        --------
        >>> Follows("a", "S55E22+", 5, 0.0, 0.5, 2, (5,), (), "S95E22-").called
        'S95E22-'
        """
        return self.name or self.label or self.family

    @property
    def counted(self) -> str:
        """The label, where the family is called otherwise."""
        return self.label if self.name != self.label and self.name else ""

    @property
    def beside(self) -> str:
        """The other harmonics in words.

        Examples
        --------
        >>> Follows("a", "S13O00+", 1, 0.0, 0.5, 2, (1, 3, 5), ()).beside
        ', with 3, 5'
        """
        rest = ", ".join(str(k) for k in self.harmonics if k != self.harmonic)
        return f", with {rest}" if rest else ""


@dataclass(frozen=True)
class Companion:
    """Another ridge that goes on for half of a stage or more: its frequency and amplitude (0 where it is not) in those of the stage's."""

    ratio: float
    amplitude: float


@dataclass(frozen=True)
class Stage:
    """An interval in which one ridge holds.

    Parameters
    ----------
    start, end : float
        Times.
    periods : float
        Of the ridge.
    frequency : float
        Angular, geometric mean over the stage.
    frequencies, energies : (float, float)
        Lowest and highest in it; the energy is the total.
    share : float
        Part of the amplitude of the relative motion that the ridge carries, mean over the stage.
    dissipated_nes, dissipated_lo : float
        In it.
    impacts : int
        In it.
    companions : tuple of Companion
        Strongest first.
    follows : Follows or None
        None: it is at no harmonic of any family that carries a fifth of the orbit's amplitude, or no families were given.
    why : str
        Why it does not follow the family that the motion starts on; "" where it does, or the motion starts on none.
    """

    start: float
    end: float
    periods: float
    frequency: float
    frequencies: tuple[float, float]
    energies: tuple[float, float]
    share: float
    dissipated_nes: float
    dissipated_lo: float
    impacts: int
    companions: tuple[Companion, ...]
    follows: Follows | None
    why: str = ""

    @property
    def text(self) -> str:
        """What it follows, in words.

        Examples
        --------
        >>> Stage(0, 9, 3, 2.1, (2, 2.2), (1, 2), 0.9, 0, 0, 3, (), None).text
        'follows no family'
        """
        why = f": {self.why}" if self.why else ""
        if self.follows is None:
            return f"follows no family{why}"
        counted = f" (counted {self.follows.counted} here)" if self.follows.counted else ""
        which = f"harmonic {self.follows.harmonic} of {self.follows.called}{counted}{self.follows.beside}"
        count = len(self.follows.others)
        return which + (f" ({count} other{'s fit' if count > 1 else ' fits'} as well)" if count else "") + why


@dataclass(frozen=True)
class Change:
    """A family that is taken up or left: time, "capture" or "escape", id, label and harmonic, and its name as of `Follows`."""

    time: float
    kind: str
    family: str
    label: str
    harmonic: int
    name: str = ""


def changes(stages: Sequence[Stage]) -> list[Change]:
    """The captures and escapes between stages, in order of time.

    Stages that follow one family with one harmonic, one right after the other, are not told apart by an escape.
    """
    out: list[Change] = []
    for i, stage in enumerate(stages):
        if stage.follows is None:
            continue
        name = stage.follows
        what = (name.family, name.label, name.harmonic, name.name)
        one = (name.family, name.harmonic)
        before = stages[i - 1].follows if i else None
        after = stages[i + 1].follows if i + 1 < len(stages) else None
        if before is None or (before.family, before.harmonic) != one:
            out.append(Change(stage.start, "capture", *what))
        if i + 1 < len(stages) and (after is None or (after.family, after.harmonic) != one):
            out.append(Change(stage.end, "escape", *what))
    return out


def stages_as_data(stages: Sequence[Stage]) -> list[dict[str, Any]]:
    """Stages as plain data for JSON; what follows no family has ``follows`` null."""
    out = []
    for stage in stages:
        data = asdict(stage)
        data["frequencies"], data["energies"] = list(stage.frequencies), list(stage.energies)
        data["companions"] = list(data["companions"])
        out.append(data)
    return out


def stage_from_data(data: dict[str, Any]) -> Stage:
    """A stage from what `stages_as_data` makes of it.

    Raises
    ------
    KeyError, TypeError
        For what is none.
    """
    follows = data["follows"]
    return Stage(
        **{name: data[name] for name in ("start", "end", "periods", "frequency", "share", "dissipated_nes", "dissipated_lo", "impacts")},
        frequencies=(data["frequencies"][0], data["frequencies"][1]),
        energies=(data["energies"][0], data["energies"][1]),
        companions=tuple(Companion(**item) for item in data["companions"]),
        follows=None if follows is None else Follows(**{**follows, **{name: tuple(follows[name]) for name in ("harmonics", "others")}}),
        why=data.get("why", ""),
    )
