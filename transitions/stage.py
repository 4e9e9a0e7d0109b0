"""A stage of a motion as data and in words, and the changes between stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

__all__ = [
    "Change", "Companion", "Follows", "Stage", "changes", "counted_label", "family_name", "stage_from_data", "stages_as_data",
]  # fmt: skip


def family_name(name: str, label: str, family: str) -> str:
    """What a family is called in messages: the name that the user gave, else its label, else its id.

    Examples
    --------
    >>> family_name("S95E22-", "S55E22+", "a:b:c"), family_name("", "S55E22+", "a:b:c"), family_name("", "", "a:b:c")
    ('S95E22-', 'S55E22+', 'a:b:c')
    """
    return name or label or family


def counted_label(called: str, label: str) -> str:
    """The label counted on a family's orbit, if it differs from what the family is called; else "".

    Examples
    --------
    >>> counted_label("S95E22-", "S75E22-"), counted_label("S75E22-", "S75E22-")
    ('S75E22-', '')
    """
    return label if label != called else ""


@dataclass(frozen=True)
class Follows:
    """The family that a stage follows.

    Parameters
    ----------
    family, label : str
        Id, and the label of its orbit in the middle of the stage ("" outside the grammar of labels).
    harmonic : int
        The harmonic k 2 pi/T that the ridge is at.
    deviation : float
        Mean distance of the ridge from the harmonic, in octaves.
    share : float
        Share of the orbit's amplitude that the harmonic has, mean over the stage.
    impacts : int
        In a period of the orbit; 0 for a linear mode.
    harmonics : tuple of int
        Rising: this one, and the others with a fifth both of the orbit's amplitude and of the motion's.
    others : tuple of str
        Ids of the other families that fit as well (`transitions.following.best_of`). Spectrum and impacts do not distinguish them. This
        family is named because it has the fewest impacts in a period.
    name : str
        A name in place of the label. The family of the start has one name in all stages.
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
        """Its name, as `family_name` decides."""
        return family_name(self.name, self.label, self.family)

    @property
    def counted(self) -> str:
        """Its label, as `counted_label` decides."""
        return counted_label(self.called, self.label)

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
    """Another ridge over half of a stage or more: ratios of its mean frequency and amplitude to those of the stage (0 where missing)."""

    ratio: float
    amplitude: float


@dataclass(frozen=True)
class Stage:
    """An interval in which one ridge of the spectrum is the largest.

    Parameters
    ----------
    start, end : float
        Times.
    periods : float
        Number of periods of the ridge.
    frequency : float
        Angular, geometric mean over the stage.
    frequencies, energies : (float, float)
        Lowest and highest in the stage; the energy is the total.
    share : float
        Share of the relative motion's amplitude that the ridge has, mean over the stage.
    dissipated_nes, dissipated_lo : float
        Energies dissipated in the stage.
    impacts : int
        Number of impacts in the stage.
    companions : tuple of Companion
        Strongest first.
    follows : Follows or None
        None if the ridge is at no harmonic with a fifth of an orbit's amplitude, or if no families were given.
    why : str
        Why it does not follow the family that the motion starts on; "" if it does, or if the motion starts on none.
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
        """The family that it follows, in words.

        Examples
        --------
        >>> Stage(0, 9, 3, 2.1, (2, 2.2), (1, 2), 0.9, 0, 0, 3, (), None).text
        'follows no family'
        """
        why = f": {self.why}" if self.why else ""
        if self.follows is None:
            return f"follows no family{why}"
        follows = self.follows
        counted = f" (counted {follows.counted} here)" if follows.counted else ""
        which = f"harmonic {follows.harmonic} of {follows.called}{counted}{follows.beside}"
        count = len(follows.others)
        return which + (f" ({count} other{'s fit' if count > 1 else ' fits'} as well)" if count else "") + why


@dataclass(frozen=True)
class Change:
    """The beginning (kind "capture") or end ("escape") of following a family, which is described as in `Follows`."""

    time: float
    kind: str
    family: str
    label: str
    harmonic: int
    name: str = ""

    @property
    def called(self) -> str:
        """The family's name, else its label, else its id."""
        return self.name or self.label or self.family


def changes(stages: Sequence[Stage]) -> list[Change]:
    """The captures and escapes between stages, in order of time.

    Between two successive stages that follow the same harmonic of the same family there is neither.
    """
    out: list[Change] = []
    for i, stage in enumerate(stages):
        if stage.follows is None:
            continue
        follows = stage.follows
        what = (follows.family, follows.label, follows.harmonic, follows.name)
        one = (follows.family, follows.harmonic)
        before = stages[i - 1].follows if i else None
        after = stages[i + 1].follows if i + 1 < len(stages) else None
        if before is None or (before.family, before.harmonic) != one:
            out.append(Change(stage.start, "capture", *what))
        if i + 1 < len(stages) and (after is None or (after.family, after.harmonic) != one):
            out.append(Change(stage.end, "escape", *what))
    return out


def stages_as_data(stages: Sequence[Stage]) -> list[dict[str, Any]]:
    """Stages as plain data for JSON; ``follows`` is null if a stage follows no family."""
    out = []
    for stage in stages:
        data = asdict(stage)
        data["frequencies"], data["energies"] = list(stage.frequencies), list(stage.energies)
        data["companions"] = list(data["companions"])
        out.append(data)
    return out


def stage_from_data(data: dict[str, Any]) -> Stage:
    """A stage from an item of `stages_as_data`.

    Raises
    ------
    KeyError, TypeError
        For anything else.
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
