"""Families of a catalogue, by filters and by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from typing import NamedTuple

from branches.catalogue.database import CatalogueError, not_taken
from branches.catalogue.rows import FamilyRow, Node, crosses
from branches.catalogue.store import CatalogueStore
from branches.naming.labels import Label, LabelSyntaxError, Name, most_alike, parse, parse_name
from branches.naming.matching import (
    AmbiguousName,
    NameNotFound,
    fits_otherwise,
    matches,
    nearest_crossing,
    nearest_labels,
    reaches,
    reference_point_of,
    remark_on_name,
    why_a_cover,
)
from bvp.texts import shown

__all__ = ["NameMatch", "chosen", "find", "is_part_of_id"]

_WILD = re.compile(r"[*?\[]")
_PART_OF_ID = re.compile(r"[0-9a-f]{4,}|(origin|rest|stop|periodic|period-|half-period-|free-).*")
_SHORTENED = re.compile(r"([a-z][^\s.…]*)(?:…|\.{1,3})([^\s.…]*:[0-9a-f]{8})")
"""An id that a narrow table shows without its middle."""
_SIDE = re.compile(r"(?<=stop)[a-z]?[+-]")


class NameMatch(NamedTuple):
    """The family or linear mode that has a name, and the orbit on it that a suffix, reference point or label selects. `note` reports if the
    orbit's own label is another one."""

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
    """The families that fit: see `Catalogue.families`."""
    for what, text in (("label", label), ("ends", ends)):
        if text is not None and not isinstance(text, str):
            raise not_taken(f"the {what} of families is text", text)
    if energy is not None or impacts is not None:
        # Imported here because it loads numpy, which browsing does not need.
        from bvp.checks import is_finite, reals

        if energy is not None and not is_finite(energy):
            raise not_taken("the energy of families is a finite number", energy)
        try:
            least, most = (0.0, 0.0) if impacts is None else reals(impacts, flat=True).tolist()
        except (TypeError, ValueError):
            raise not_taken("the impacts of families are two numbers, the least and the most", impacts) from None
    families = list(families)
    fits = None if label is None else _label_test(label)
    if ends is not None:
        known = {row.ends for row in families}
        known |= {_SIDE.sub("", name) for name in known}
        if ends not in known and families:
            raise CatalogueError(f"no family has the ends {shown(ends)}; expected one of {', '.join(sorted(known))}")
        families = [row for row in families if ends in (row.ends, _SIDE.sub("", row.ends))]
    if impacts is not None:
        families = [row for row in families if least <= row.impacts <= most]
    if energy is not None:
        families = [row for row in families if crosses(row.h, energy)]
    if fits is not None:
        families = _having(families, fits)
    if stable:
        families = [row for row in families if row.stable_fraction > 0.0 and _is_stable(row, fits, energy)]
    elif energy is not None and fits is not None:
        families = [row for row in families if row.arclengths("labels", fits, energy)]
    return families


def _is_stable(row: FamilyRow, fits: Callable[[str], bool] | None, energy: float | None) -> bool:
    """Whether a family is stable somewhere with a fitting label, at the energy if one is given."""
    parts = row.arclengths("labels", fits or (lambda label: True), energy)
    steady = row.arclengths("stability", lambda code: code == 1, energy)
    if row.points == 1:
        return bool(parts) and bool(steady)
    return any(a[0] < b[1] and b[0] < a[1] for a in parts for b in steady)


def _label_test(text: str) -> Callable[[str], bool]:
    """A function that decides whether a label fits a label, a pattern of labels, or shell wildcards."""
    try:
        pattern = parse(text)
    except LabelSyntaxError:
        if not _WILD.search(text):
            raise
        return cache(lambda label: fnmatchcase(label, text))
    return _fitting(lambda label: matches(pattern, label))


def _fitting(test: Callable[[Label], bool]) -> Callable[[str], bool]:
    """A test of labels as a function of their text; no label does not fit."""
    return cache(lambda text: bool(text) and test(parse(text)))


# -- names --------------------------------------------------------------------------------------------------------------------


def is_part_of_id(text: str) -> bool:
    """Whether a text can be the beginning of an id or of its hash, or an id that a table shortened.

    Examples
    --------
    >>> [is_part_of_id(text) for text in ("87dd6282", "rest-st", "origin-o…:d777f141", "S13+")]
    [True, True, True, False]
    """
    return (_PART_OF_ID.fullmatch(text) or _SHORTENED.fullmatch(text)) is not None


def find(catalogue: CatalogueStore, text: str, reference_points: Mapping[str, Mapping[str, float]]) -> NameMatch:
    """The family or linear mode that has a name: see `Catalogue.find`."""
    if not isinstance(text, str):
        raise not_taken("a name is text such as S13O00+, U83@h=1.9 or an id", text)
    head, at, suffix = text.partition("@")
    mode = _modes(catalogue).get(head)
    if mode is not None and not at:
        return _match(mode)
    row = _family_of_id(catalogue, head)
    if catalogue.scene.parameters:
        return _response(catalogue, text, head, row)
    if row is not None:
        name = parse_name(row.id + at + suffix)
        orbits = _select(catalogue, name, [row], None)
        if not orbits:
            raise NameNotFound(f"family {row.id} has no orbit at {_where(name)}: it has {_extent(row)}")
        return orbits[0]
    name = parse_name(text)
    assert name.label is not None
    if name.label.kind == "L":
        return _linear_mode(catalogue, name.label)
    families, pattern = catalogue.all_families(), name.label
    fits = _fitting(lambda label: matches(pattern, label))
    having = _having(families, fits)
    reference = reference_point_of(text, pattern, reference_points) if name.h is None and name.alpha is None else None
    found = []
    if reference is not None and "h" in reference and "alpha" in reference:
        there = Name(pattern, None, reference["h"], reference["alpha"])
        found = _select(catalogue, there, having, fits) or _counted_otherwise(catalogue, there, families)
    found = found or _select(catalogue, name, having, fits)
    if not found:
        raise NameNotFound(_nothing(catalogue, name, families, having))
    if len(found) > 1 and reference is not None and len(reference) == 1:
        found = _select(catalogue, Name(pattern, None, reference.get("h"), reference.get("alpha")), having, None) or found
    if len(found) > 1:
        more = f" and {len(found) - 12} more" if len(found) > 12 else ""
        raise AmbiguousName(f"{text} matches {len(found)} families; choose one of {' '.join(_suffixed(head, found)[:12])}{more}")
    return found[0]


def _response(catalogue: CatalogueStore, text: str, head: str, row: FamilyRow | None) -> NameMatch:
    """The family of forced orbits that has an id, or the beginning of one: it has no label."""
    held = f"the families of {catalogue.path} are {catalogue.scene.held}"
    if row is None:
        near = ", ".join(most_alike(head, [row.id for row in catalogue.all_families()])) or "none, it holds no family"
        raise NameNotFound(f"no family {shown(text)}: {held}, which have ids and no labels; nearest: {near}")
    if text != head:
        raise NameNotFound(f"{shown(text)}: {held}; expected an id without @")
    return NameMatch(row.id, "family")


def _family_of_id(catalogue: CatalogueStore, head: str) -> FamilyRow | None:
    """The family with an id, or with the only id that begins with a text or is shortened to it. None if the text is no part of an id."""
    families = catalogue.all_families()
    found = [row for row in families if row.id == head]
    if found or not is_part_of_id(head):
        return found[0] if found else None
    shortened = _SHORTENED.fullmatch(head)
    if shortened:
        how = f"is shortened to {head!r}"
        found = [row for row in families if row.id.startswith(shortened[1]) and row.id.endswith(shortened[2])]
    else:
        how = f"begins with {head!r}"
        found = [row for row in families if row.id.startswith(head) or row.id.rpartition(":")[2].startswith(head)]
    if not found:
        near = ", ".join(most_alike(head, [row.id for row in families])) or "none, the catalogue is empty"
        raise NameNotFound(f"{catalogue.path} has no family whose id {how}; nearest: {near}")
    if len(found) > 1:
        listed = " ".join(row.id for row in found[:8]) + (f" and {len(found) - 8} more" if len(found) > 8 else "")
        raise AmbiguousName(f"{len(found)} families have an id that {how}: {listed}")
    return found[0]


def _having(families: Sequence[FamilyRow], fits: Callable[[str], bool]) -> list[FamilyRow]:
    """The families with a label that fits."""
    return [row for row in families if any(map(fits, row.label_names))]


def _counted_otherwise(catalogue: CatalogueStore, name: Name, families: Sequence[FamilyRow]) -> list[NameMatch]:
    """The family at a reference point whose label has the right impacts, but other half-waves or another sign than the literature
    prints."""
    label = name.label
    assert label is not None
    fits = _fitting(lambda known: fits_otherwise(label, known))
    return [match._replace(note=remark_on_name(label, None)) for match in _select(catalogue, name, _having(families, fits), fits)]


def _suffixed(head: str, found: Sequence[NameMatch]) -> list[str]:
    """A name for each of several families, with enough digits to distinguish them; their ids if no digits do."""
    for digits in (6, 9, 12):
        names = [f"{head}@h={match.h:.{digits}g},alpha={match.alpha:.{digits}g}" for match in found]
        if len(set(names)) == len(names):
            return names
    return [match.id for match in found]


def _select(catalogue: CatalogueStore, name: Name, families: Sequence[FamilyRow], fits: Callable[[str], bool] | None) -> list[NameMatch]:
    """The families with an orbit at the energy and quarter period of a name and with a label that fits. If the name has both, the nearest
    one; if it has neither, all families with such a label."""
    out: list[tuple[float, NameMatch]] = []
    for row in families:
        if name.h is None and name.alpha is None and fits is None:
            out.append((0.0, NameMatch(row.id, "family")))
            continue
        if name.h is not None and not reaches(row.h, name.h):
            continue
        if name.h is None and name.alpha is not None and not reaches(row.alpha, name.alpha):
            continue
        points = catalogue.track(row)
        if name.h is None and name.alpha is None:
            own = [(h, alpha) for h, alpha, label in points if fits is None or fits(label)]
            middle = own[len(own) // 2] if own else (points[0][0], points[0][1])
            out.append((0.0, NameMatch(row.id, "family", *middle)))
            continue
        best = nearest_crossing(points, name.h, name.alpha, fits)
        if best is not None:
            out.append((best[0], NameMatch(row.id, "family", *best[1])))
    least = min((distance for distance, _ in out), default=0.0)
    return [match for distance, match in out if distance <= least + 1e-9]


def _modes(catalogue: CatalogueStore) -> dict[str, Node]:
    """The linear modes of a catalogue by their names: L11+, or L1, L2, .. where modes have no labels."""
    return {node.id: node for node in catalogue.nodes if node.kind == "linear mode"}


def _match(mode: Node) -> NameMatch:
    return NameMatch(mode.id, mode.kind, mode.h[1] if mode.h else None, mode.alpha)


def _linear_mode(catalogue: CatalogueStore, label: Label) -> NameMatch:
    known = _modes(catalogue)
    node = known.get(str(label))
    if node is None:
        covered = why_a_cover(label, lambda root: str(root) in known)
        raise NameNotFound(covered or f"{catalogue.path} has no linear mode {label}; it has {', '.join(known) or 'none'}")
    return _match(node)


def _nothing(catalogue: CatalogueStore, name: Name, families: Sequence[FamilyRow], having: Sequence[FamilyRow]) -> str:
    """The message for a name without a family: what was asked for, and what exists."""
    label = name.label
    assert label is not None
    if having:
        listed = "; ".join(f"{row.id} with {_extent(row)}" for row in having[:4])
        return f"no orbit {label} at {_where(name)} in {catalogue.path}; families that have the label: {listed}"
    existing = {part.value for row in families for part in row.labels if part.value}
    covered = why_a_cover(label, lambda root: any(matches(root, parse(known)) for known in existing))
    near = ", ".join(nearest_labels(label, existing)) or "none, it holds no family with a label"
    return covered or f"{catalogue.path} has no family {label}; nearest that exist: {near}"


def _where(name: Name) -> str:
    return ", ".join(f"{key} = {value:.10g}" for key, value in (("h", name.h), ("alpha", name.alpha)) if value is not None)


def _extent(row: FamilyRow) -> str:
    return f"h = {row.h[0]:.6g} to {row.h[1]:.6g}, alpha = {row.alpha[0]:.6g} to {row.alpha[1]:.6g}"
