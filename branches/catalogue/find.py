"""Families of a catalogue by filters and by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from branches.catalogue.errors import CatalogueError, not_taken
from branches.catalogue.rows import FamilyRow, crosses
from branches.crossings import nearest_crossing, reaches
from branches.labels import Label, LabelSyntaxError, Name, matches, nearest, nearest_labels, parse, parse_name
from branches.name_errors import AmbiguousName, NameNotFound, several_turns
from branches.name_pins import fits_otherwise, note, pin_of
from bvp.shown import shown

if TYPE_CHECKING:
    from branches.catalogue.store import Catalogue

__all__ = ["Match", "chosen", "find", "is_part_of_id"]

_WILD = re.compile(r"[*?\[]")
_PART_OF_ID = re.compile(r"[0-9a-f]{4,}|(origin|rest|stop|periodic).*")
_SHORTENED = re.compile(r"([a-z][^\s.…]*)(?:…|\.{1,3})([^\s.…]*:[0-9a-f]{8})")
"""An id as a table shows it that has no room for all of it: its middle is left out."""
_SIDE = re.compile(r"(?<=stop)[a-z]?[+-]")


class Match(NamedTuple):
    """What a name stands for: the id of a family or linear mode, and the orbit that a suffix, pin or label selects on it. `note` says so
    where the orbit's own label is another one."""

    id: str
    kind: str
    h: float | None = None
    alpha: float | None = None
    note: str = ""


# -- filters ------------------------------------------------------------------------------------------------------------------


def chosen(
    families: Iterable[FamilyRow],
    *,
    label: str | None = None,
    energy: float | None = None,
    stable: bool = False,
    ends: str | None = None,
    impacts: tuple[float, float] | None = None,
) -> list[FamilyRow]:
    """Those of the families that fit: see `Catalogue.families`.

    Raises
    ------
    LabelSyntaxError
        For a label that cannot be read and has no wildcard.
    CatalogueError
        For ends that no family has; those that exist are named. For what is no label or no number.
    """
    for what, text in (("label", label), ("ends", ends)):
        if text is not None and not isinstance(text, str):
            raise not_taken(f"the {what} of families is text", text)
    if energy is not None or impacts is not None:
        # Loaded here, for it loads numpy, which browsing does without.
        from bvp.checks import is_finite, real_list

        if energy is not None and not is_finite(energy):
            raise not_taken("the energy of families is a finite number", energy)
        try:
            least, most = (0.0, 0.0) if impacts is None else real_list(impacts)
        except (TypeError, ValueError):
            raise not_taken("the impacts of families are two numbers, the least and the most", impacts) from None
    families = list(families)
    fits = None if label is None else _label_test(label)
    if ends is not None:
        known = {row.ends for row in families}
        known |= {_SIDE.sub("", name) for name in known}
        if ends not in known and families:
            raise CatalogueError(f"no family has the ends {shown(ends)}; expected one of {', '.join(sorted(known))}")

    def keep(row: FamilyRow) -> bool:
        if ends is not None and ends not in (row.ends, _SIDE.sub("", row.ends)):
            return False
        if impacts is not None and not least <= row.impacts <= most:
            return False
        if energy is not None and not crosses(row.h, energy):
            return False
        if fits is not None and not any(map(fits, row.label_names)):
            return False
        if not stable and (energy is None or fits is None):
            return True
        if stable and row.stable_fraction == 0.0:
            return False
        parts = row.arclengths("labels", fits or (lambda label: True), energy)
        if not stable:
            return bool(parts)
        steady = row.arclengths("stability", lambda code: code == 1, energy)
        return any(a[0] < b[1] and b[0] < a[1] for a in parts for b in steady) or (row.points == 1 and bool(parts) and bool(steady))

    return [row for row in families if keep(row)]


def _label_test(text: str) -> Callable[[str], bool]:
    """Whether a label fits a label, a pattern of labels, or shell wildcards."""
    try:
        pattern = parse(text)
    except LabelSyntaxError:
        if not _WILD.search(text):
            raise
        return cache(lambda label: fnmatchcase(label, text))
    return cache(lambda label: bool(label) and matches(pattern, parse(label)))


# -- names --------------------------------------------------------------------------------------------------------------------


def is_part_of_id(text: str) -> bool:
    """Whether a text can be the beginning of an id or of its hash, or an id that a table has shortened.

    Examples
    --------
    >>> [is_part_of_id(text) for text in ("87dd6282", "rest-st", "origin-o…:d777f141", "S13+")]
    [True, True, True, False]
    """
    return (_PART_OF_ID.fullmatch(text) or _SHORTENED.fullmatch(text)) is not None


def find(catalogue: Catalogue, text: str, pins: Mapping[str, Mapping[str, float]]) -> Match:
    """What a name stands for in a catalogue: see `Catalogue.find`."""
    if not isinstance(text, str):
        raise not_taken("a name is text such as S13O00+, U83@h=1.9 or an id", text)
    families = catalogue.families()
    head, at, _ = text.partition("@")
    by_id = [row for row in families if row.id == head]
    if not by_id and is_part_of_id(head):
        shortened = _SHORTENED.fullmatch(head)
        if shortened:
            by_id = [row for row in families if row.id.startswith(shortened[1]) and row.id.endswith(shortened[2])]
        else:
            by_id = [row for row in families if row.id.startswith(head) or row.id.rpartition(":")[2].startswith(head)]
        how = f"is shortened to {head!r}" if shortened else f"begins with {head!r}"
        if not by_id:
            near = ", ".join(nearest(head, [row.id for row in families])) or "none, the catalogue is empty"
            raise NameNotFound(f"{catalogue.path} has no family whose id {how}; nearest: {near}")
        if len(by_id) > 1:
            listed = " ".join(row.id for row in by_id[:8]) + (f" and {len(by_id) - 8} more" if len(by_id) > 8 else "")
            raise AmbiguousName(f"{len(by_id)} families have an id that {how}: {listed}")
    if by_id:
        name = parse_name(by_id[0].id + at + text.partition("@")[2])
        orbits = _select(catalogue, name, by_id, None)
        if not orbits:
            raise NameNotFound(f"family {by_id[0].id} has no orbit at {_where(name)}: it has {_extent(by_id[0])}")
        return orbits[0]
    name = parse_name(text)
    assert name.label is not None
    if name.label.kind == "L":
        return _linear_mode(catalogue, name.label)
    pattern = name.label
    fits = cache(lambda label: bool(label) and matches(pattern, parse(label)))
    having = [row for row in families if any(map(fits, row.label_names))]
    pin = pin_of(text, pattern, pins) if name.h is None and name.alpha is None else None
    found = []
    if pin is not None and "h" in pin and "alpha" in pin:
        at_pin = Name(pattern, None, pin["h"], pin["alpha"])
        found = _select(catalogue, at_pin, having, fits) or _counted_otherwise(catalogue, at_pin, families)
    found = found or _select(catalogue, name, having, fits)
    if not found:
        raise NameNotFound(_nothing(catalogue, name, families, having))
    if len(found) > 1 and pin is not None and len(pin) == 1:
        found = _select(catalogue, Name(pattern, None, pin.get("h"), pin.get("alpha")), having, None) or found
    if len(found) > 1:
        more = f" and {len(found) - 12} more" if len(found) > 12 else ""
        raise AmbiguousName(f"{text} is {len(found)} families; expected one of {' '.join(_suffixed(head, found)[:12])}{more}")
    return found[0]


def _counted_otherwise(catalogue: Catalogue, name: Name, families: Sequence[FamilyRow]) -> list[Match]:
    """The family that a pin means by a label that has the impacts of its orbits, where the half-waves that are counted, or the sign, are
    others than the literature prints."""
    label = name.label
    assert label is not None
    fits = cache(lambda known: bool(known) and fits_otherwise(label, parse(known)))
    having = [row for row in families if any(map(fits, row.label_names))]
    return [match._replace(note=note(label, None)) for match in _select(catalogue, name, having, fits)]


def _suffixed(head: str, found: Sequence[Match]) -> list[str]:
    """A name for each of several families: with as many digits as tell them apart, by id where none do."""
    for digits in (6, 9, 12):
        names = [f"{head}@h={match.h:.{digits}g},alpha={match.alpha:.{digits}g}" for match in found]
        if len(set(names)) == len(names):
            return names
    return [match.id for match in found]


def _select(catalogue: Catalogue, name: Name, families: Sequence[FamilyRow], fits: Callable[[str], bool] | None) -> list[Match]:
    """The families with an orbit at the energy and quarter period of a name and with a label that fits; all that have such a label
    where the name has neither. With both given, the one that comes nearest."""
    out: list[tuple[float, Match]] = []
    for row in families:
        if name.h is None and name.alpha is None and fits is None:
            out.append((0.0, Match(row.id, "family")))
            continue
        if name.h is not None and not reaches(row.h, name.h):
            continue
        if name.h is None and name.alpha is not None and not reaches(row.alpha, name.alpha):
            continue
        points = catalogue.track(row)
        if name.h is None and name.alpha is None:
            own = [(h, alpha) for h, alpha, label in points if fits is None or fits(label)]
            middle = own[len(own) // 2] if own else (points[0][0], points[0][1])
            out.append((0.0, Match(row.id, "family", *middle)))
            continue
        best = nearest_crossing(points, name.h, name.alpha, fits)
        if best is not None:
            out.append((best[0], Match(row.id, "family", *best[1])))
    least = min((miss for miss, _ in out), default=0.0)
    return [match for miss, match in out if miss <= least + 1e-9]


def _linear_mode(catalogue: Catalogue, label: Label) -> Match:
    known = {node.id: node for node in catalogue.nodes if node.kind == "linear mode"}
    node = known.get(str(label))
    if node is None:
        turned = several_turns(label, lambda root: str(root) in known)
        raise NameNotFound(turned or f"{catalogue.path} has no linear mode {label}; it has {', '.join(known) or 'none'}")
    return Match(node.id, node.kind, node.h[1] if node.h else None, node.alpha)


def _nothing(catalogue: Catalogue, name: Name, families: Sequence[FamilyRow], having: Sequence[FamilyRow]) -> str:
    """What was asked for, and what exists."""
    label = name.label
    assert label is not None
    if having:
        listed = "; ".join(f"{row.id} with {_extent(row)}" for row in having[:4])
        return f"no orbit {label} at {_where(name)} in {catalogue.path}; families that have the label: {listed}"
    existing = {part.label for row in families for part in row.labels if part.label}
    turned = several_turns(label, lambda root: any(matches(root, parse(known)) for known in existing))
    near = ", ".join(nearest_labels(label, existing)) or "none, it holds no family with a label"
    return turned or f"{catalogue.path} has no family {label}; nearest that exist: {near}"


def _where(name: Name) -> str:
    return ", ".join(f"{key} = {value:.10g}" for key, value in (("h", name.h), ("alpha", name.alpha)) if value is not None)


def _extent(row: FamilyRow) -> str:
    return f"h = {row.h[0]:.6g} to {row.h[1]:.6g}, alpha = {row.alpha[0]:.6g} to {row.alpha[1]:.6g}"
