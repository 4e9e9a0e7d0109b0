"""Impact sequences: the stops that are hit, in order of time, and those that stick after an impact.

A symbol is the letter of a contact, `+` or `a+`. With `=` behind it the stop stays closed after the impact, `a+=`. With `:` the stop opens,
`a+:`. It opens before the next symbol, unless the sequence says where.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bvp.closures import EndsError, contact_of
from bvp.dense import product, solve

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = [
    "CLOSES", "OPENS", "ContactEvent", "joined_sequence", "parse_contact_sequence", "pulled_open", "require_bounces", "require_half",
    "require_pressing",
]  # fmt: skip

CLOSES, OPENS = "=", ":"
"""Ends of the symbols of an impact after which the stop sticks, and of its release."""

_ROUNDING = 1e-13
"""Impulses, beside that of the impact, in units of their reduced masses, that count as zero."""


class ContactEvent(NamedTuple):
    """A node of an orbit: an impact at a contact, or its release; and the contacts that stick in the flight after it."""

    symbol: str
    contact: int
    is_release: bool
    closed: frozenset[int]

    @property
    def sticks(self) -> bool:
        """Whether the stop stays closed after the impact."""
        return self.contact in self.closed and not self.is_release


def _split(symbol: str) -> tuple[str, str]:
    return (symbol[:-1], symbol[-1]) if symbol.endswith((CLOSES, OPENS)) else (symbol, "")


def parse_contact_sequence(system: ImpactSystem, sequence: Sequence[str], half: bool = False) -> tuple[ContactEvent, ...]:
    """The events of a sequence, with the releases that it leaves out.

    Parameters
    ----------
    system : ImpactSystem
    sequence : sequence of str
        Symbols.
    half : bool
        The sequence is that of half a period, whose mirror image follows.

    Raises
    ------
    EndsError
        For an unknown contact, a stop that is hit while it sticks or opens while it does not, and a sequence that begins with a release.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> one = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), -1.0, 1.0, restitution=0.0)])
    >>> [event.symbol for event in parse_contact_sequence(one, ["+=", "-"])]
    ['+=', '+:', '-']
    """
    opposite = system.modes.contact_opposite
    parts = [_split(symbol) for symbol in sequence]
    found = [(letter, end, contact_of(system, letter)) for letter, end in parts]
    if found and found[0][1] == OPENS:
        raise EndsError(f"a sequence begins with an impact; received {sequence[0]}, which opens a stop")

    def image(contact: int) -> int:
        return int(opposite[contact]) if half else contact

    # A stop whose release comes first in the sequence sticks from the end of the period before.
    full: list[tuple[str, str, int]] = []
    for k, (letter, end, contact) in enumerate(found):
        full.append((letter, end, contact))
        if end != CLOSES:
            continue
        later = [*found[k + 1 :], *((other, kind, image(place)) for other, kind, place in found[: k + 1])]
        own = next((kind for _, kind, place in later if place == contact), CLOSES)
        if own != OPENS:
            full.append((letter, OPENS, contact))
    first = {
        contact
        for k, (_, end, contact) in enumerate(full)
        if end == OPENS and not any(kind == CLOSES and other == contact for _, kind, other in full[:k])
    }
    closed, events = set(first), list[ContactEvent]()
    for letter, end, contact in full:
        if end == OPENS and contact not in closed:
            raise EndsError(f"{letter}{OPENS} opens a stop that does not stick; expected {letter}{CLOSES} before it")
        if end != OPENS and closed & {contact, int(opposite[contact])}:
            raise EndsError(f"{letter}{end} hits a stop that sticks; expected {letter}{OPENS} before it")
        closed = closed - {contact} if end == OPENS else closed | ({contact} if end == CLOSES else set())
        events.append(ContactEvent(letter + end, contact, end == OPENS, frozenset(closed)))
    if closed != {image(contact) for contact in first}:
        raise EndsError("a stop sticks at the end of the sequence and not at its beginning")
    return tuple(events)


def pulled_open(system: ImpactSystem, closed: Collection[int], contact: int) -> int | None:
    """The contact that an impact at another one pulls open, of those that stick.

    With the rows c_S of the contacts that stick, times their sides, and c of the impact with the impulse p, they need the impulses
    -(c_S M^-1 c_S')^-1 c_S M^-1 c' p to stay closed. These cannot be negative. Their signs depend on masses alone.

    Returns
    -------
    int or None
        The one that is pulled most; None where none is.
    """
    contacts = [one for one in sorted(closed) if one != contact]
    if not contacts:
        return None
    modes = system.modes
    side, stop = modes.contacts.side, modes.contact_stop
    rows = np.array([side[one] * np.asarray(system.stops[stop[one]].gap) for one in [*contacts, contact]])
    matrix = product(rows, solve(system.mass, rows.T))
    scale = np.sqrt(np.diag(matrix))
    matrix = matrix / np.outer(scale, scale)
    pull = solve(matrix[:-1, :-1], matrix[:-1, -1])
    most = int(np.argmax(pull))
    return contacts[most] if pull[most] > _ROUNDING else None


def require_pressing(system: ImpactSystem, events: Sequence[ContactEvent]) -> None:
    """Refuse impacts that would pull a stop open which sticks on.

    Raises
    ------
    EndsError
    """
    for event in () if len(system.stops) < 2 else events:
        pulled = None if event.is_release else pulled_open(system, event.closed, event.contact)
        if pulled is not None:
            letter = system.modes.contact_letters[pulled]
            raise EndsError(f"the impact {event.symbol} pulls stop {letter} open, which sticks; expected {letter}{OPENS} before it")


def require_bounces(system: ImpactSystem, events: Sequence[ContactEvent], loaded: bool, varying: Collection[int]) -> None:
    """Refuse stops that stick after impacts without loss, and plastic impacts that do not stay so.

    Parameters
    ----------
    system : ImpactSystem
    events : sequence of ContactEvent
    loaded : bool
        There is a harmonic load.
    varying : collection of int
        The stops whose restitution depends on released parameters.

    Raises
    ------
    EndsError
    """
    for event in events:
        stop = int(system.modes.contact_stop[event.contact])
        restitution = system.stops[stop].restitution
        if event.sticks and restitution == 1.0:
            raise EndsError(f"{event.symbol}: a stop with restitution 1 does not stick; expected one below 1")
        if event.sticks and (restitution > 0.0 or stop in varying) and not loaded:
            raise EndsError(f"{event.symbol}: bounces that end in sticking need a harmonic load; expected one, or restitution 0")


def require_half(system: ImpactSystem, harmonics: Sequence[float], constant: bool, load_periods: int) -> None:
    """Refuse the half of a period where an orbit cannot have its symmetry. harmonics: of the loads; constant: there is a constant load.

    Raises
    ------
    EndsError
    """
    if not system.has_odd_symmetry:
        raise EndsError("a half period needs odd symmetry: two-sided stops with equal gaps, odd forces of springs and dampers")
    even = [k for k in harmonics if k % 2 == 0]
    if even or constant:
        raise EndsError(f"a half period needs odd loads; received {f'the harmonic {even[0]}' if even else 'a constant load'}")
    if load_periods % 2 == 0:
        raise EndsError(f"a half period needs an odd number of periods of the load; received {load_periods}")


def joined_sequence(symbols: Sequence[str]) -> str:
    """A sequence as a text, without the releases that follow their impacts at once.

    Examples
    --------
    >>> joined_sequence(["a+=", "a+:", "b-"])
    'a+=b-'
    """
    text = ""
    for k, symbol in enumerate(symbols):
        if not (symbol.endswith(OPENS) and k and symbols[k - 1] == symbol[:-1] + CLOSES):
            text += symbol
    return text
