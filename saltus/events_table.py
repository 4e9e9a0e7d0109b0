"""The table of special points: one line for each, at the moment it is found."""

from __future__ import annotations

from typing import Any

__all__ = ["COLUMNS", "HEADER", "event_cells", "event_line", "stability_word"]

_ROW = "{number:>6}  {type:<4}  {label:<14}  {h:<18}  {alpha:<18}  {stable:<9}  {multiplier:<12}  {remark}"

COLUMNS = {
    "number": "point",
    "type": "type",
    "label": "label",
    "h": "energy h",
    "alpha": "quarter alpha",
    "stable": "stable",
    "multiplier": "|multiplier|",
    "remark": "remark",
}
"""What stands over each column."""

HEADER = _ROW.format(**COLUMNS).rstrip()


def stability_word(stable: bool | int | None) -> str:
    """Return ``yes``, ``no``, or ``undecided``.

    Parameters
    ----------
    stable : bool, int or None
        True or 1, False or 0; None or -1 where it cannot be decided.

    Examples
    --------
    >>> [stability_word(stable) for stable in (True, 0, -1, None)]
    ['yes', 'no', 'undecided', 'undecided']
    """
    if stable is None or stable == -1:
        return "undecided"
    return "yes" if stable else "no"


def event_line(event: Any) -> str:
    """Return the line of an event.

    Parameters
    ----------
    event : Event
        With ``number``, ``type``, ``label``, ``h``, ``alpha``, ``stable``, ``multiplier`` (the largest modulus, None where
        it is unbounded), ``stop``, ``p_q``, ``breaks``, ``note``.

    Returns
    -------
    str

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> event = SimpleNamespace(number=-12, type="SN", label="S11O00-", h=0.06911644996826901, alpha=1.13584395619551,
    ...     stable=None, multiplier=1.0, stop=None, p_q=None, breaks=None, note=None)
    >>> print(HEADER + "\\n" + event_line(event))
    point   type  label           energy h            quarter alpha       stable     |multiplier|  remark
     -12    SN    S11O00-         0.069116449968269   1.1358439561955     undecided  1
    """
    return _ROW.format(**dict(zip(COLUMNS, event_cells(event), strict=True))).rstrip()


def event_cells(event: Any) -> tuple[str, ...]:
    """Return the cells of an event's line, in the order of `COLUMNS`."""
    if event.note:
        remark = event.note
    elif event.p_q:
        remark = "p/q = {}/{}".format(*event.p_q)
    elif event.breaks:
        remark = f"breaks {event.breaks}"
    elif event.stop:
        remark = f"stop {event.stop}"
    else:
        remark = ""
    return (
        str(event.number), event.type, event.label, f"{event.h:.14g}", f"{event.alpha:.14g}", stability_word(event.stable),
        "unbounded" if event.multiplier is None else f"{event.multiplier:.8g}", remark,
    )  # fmt: skip
