"""Rows of a catalogue: families (without their points), events, edges, other nodes, and the scene.

Neither numpy nor compiled kernels are needed to read them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

from branches.events import BranchEvent
from bvp.texts import brief, shown

__all__ = [
    "Axes", "ENERGY", "Edge", "EventOrbit", "FamilyRow", "Interval", "Node", "SceneRecord", "compact_json", "crosses", "dead_end_id",
    "difference", "event_from_row", "event_values",
]  # fmt: skip

_ON_BOUND = 1e-10
"""Largest relative distance of a family's last orbit from the energy bound that cut it: as for `Branch.orbits_at`."""


class Interval(NamedTuple):
    """An interval of a family with one label, or with one stability: stable (1), unstable (0) or undecided (-1).

    It has ranges of arclength, energy and quarter period, and begins where the last one ends.
    """

    value: Any
    arclength: tuple[float, float]
    h: tuple[float, float]
    alpha: tuple[float, float]


def crosses(h: tuple[float, float], energy: float) -> bool:
    """Whether a range of energies contains an energy, to the accuracy of a family's end on the bound that cut it.

    Examples
    --------
    >>> crosses((0.06911644996826903, 99.99999999999821), 100.0), crosses((0.07, 99.9999), 100.0)
    (True, False)
    """
    return h[0] * (1.0 - _ON_BOUND) <= energy <= h[1] * (1.0 + _ON_BOUND)


class FamilyRow(NamedTuple):
    """A family without its points. The fields are the columns of the table.

    Of a family in a parameter h is the parameter, alpha its period, and `impacts` those in a period of the loads, or of a free orbit in its
    own; `ends` is the closure of forced orbits.

    Attributes
    ----------
    number : int
        Its row.
    id, label, ends, sequence : str
        As of `branches.branch.Branch`; `ends` joined by a hyphen, or ``periodic``.
    impacts : float
        In half a period.
    h_low, h_high, alpha_low, alpha_high : float
        Ranges of energy and quarter period.
    points, events : int
        How many.
    start : int
        Index of the point that it was started from.
    stable_fraction : float
        Stable fraction of its arclength.
    names : str
        All labels along it, with spaces between.
    details : str
        JSON: `labels`, `stability`, `ended`, `layout`, and `normal_forms` of the events if these were computed. It is parsed when needed.
    """

    number: int
    id: str
    label: str
    ends: str
    sequence: str
    impacts: float
    h_low: float
    h_high: float
    alpha_low: float
    alpha_high: float
    points: int
    events: int
    start: int
    stable_fraction: float
    names: str
    details: str

    @property
    def h(self) -> tuple[float, float]:
        """Lowest and highest energy."""
        return self.h_low, self.h_high

    @property
    def alpha(self) -> tuple[float, float]:
        """Shortest and longest quarter period."""
        return self.alpha_low, self.alpha_high

    @property
    def label_names(self) -> tuple[str, ...]:
        """All labels along it, each once."""
        return tuple(self.names.split())

    @property
    def labels(self) -> tuple[Interval, ...]:
        """The intervals with one label each."""
        return self._intervals("labels")

    @property
    def stability(self) -> tuple[Interval, ...]:
        """The stable, unstable and undecided intervals."""
        return self._intervals("stability")

    def _intervals(self, name: str) -> tuple[Interval, ...]:
        return tuple(Interval(value, *map(tuple, rest)) for value, *rest in _parsed(self.details)[name])

    @property
    def ended(self) -> tuple[tuple[str, str], ...]:
        """Reason and text, at the first point and at the last."""
        return tuple((reason, text) for reason, text in _parsed(self.details)["ended"])

    @property
    def response(self) -> Any:
        """Of a family in a parameter: its problem, range and what else its events have; None of another one."""
        return _parsed(self.details).get("response")

    @property
    def normal_forms(self) -> list[tuple[float | None, str | None]]:
        """Coefficient and criticality of each event; empty if they were not computed."""
        if self.response is None:
            return [tuple(pair) for pair in _parsed(self.details).get("normal_forms", ())]
        return [tuple(more[4:6]) if len(more) > 5 else (None, None) for more in self.response["events"]]

    @property
    def layout(self) -> Any:
        """The columns in the array of its points (see `branches.catalogue.packing`)."""
        return _parsed(self.details)["layout"]

    def arclengths(self, name: str, fits: Callable[[Any], bool], energy: float | None = None) -> list[tuple[float, float]]:
        """Ranges of arclength of the intervals of ``labels`` or ``stability`` with a fitting value. `energy`: only those that reach it."""
        intervals = _parsed(self.details)[name]
        return [(s[0], s[1]) for value, s, h, _ in intervals if (energy is None or crosses(h, energy)) and fits(value)]


@lru_cache(maxsize=4096)
def _parsed(details: str) -> dict[str, Any]:
    return json.loads(details)


@brief
@dataclass(frozen=True)
class Node:
    """A node of the graph that is no family.

    Attributes
    ----------
    id : str
        ``L11+``; for a dead end see `dead_end_id`.
    kind : str
        ``linear mode`` or ``dead end``.
    label : str
    h : (float, float) or None
        Range of energies of a linear mode.
    alpha : float or None
        Its quarter period.
    note : str
        Why an edge ends here.
    """

    id: str
    kind: str
    label: str = ""
    h: tuple[float, float] | None = None
    alpha: float | None = None
    note: str = ""

    def values(self) -> tuple[Any, ...]:
        """The values of its row in the catalogue."""
        low, high = self.h or (None, None)
        return self.id, self.kind, self.label, _number(low), _number(high), _number(self.alpha), self.note

    @classmethod
    def of(cls, values: tuple[Any, ...]) -> Node:
        """The object of a row, as `values` gives it."""
        id, kind, label, low, high, alpha, note = values
        return cls(id, kind, label, None if low is None else (low, high), alpha, note)


@dataclass(frozen=True)
class EventOrbit:
    """The orbit of an event as an orbit of one of the two families that meet there.

    Attributes
    ----------
    ends : (str, str)
    sequence : str
    start : tuple of 2 n float
        Displacements, then velocities, at the start of the solved segment.
    flight_times : tuple of float
        One more than the inner impacts.
    """

    ends: tuple[str, str]
    sequence: str
    start: tuple[float, ...]
    flight_times: tuple[float, ...]

    @classmethod
    def of(cls, text: str | None) -> EventOrbit | None:
        """The orbit from its JSON text."""
        if text is None:
            return None
        ends, sequence, start, flight_times = json.loads(text)
        return cls(tuple(ends), sequence, tuple(start), tuple(flight_times))


@brief
@dataclass(frozen=True)
class Edge:
    """An event that joins two nodes.

    Attributes
    ----------
    source : str
        Id of the family, or of the linear mode, that has the event.
    source_event : str
        The event's id there; "" for the grazing of a linear mode.
    type : str
        Its code: GR, SN, BP, SB, PD, RT.
    kind : str
        How they meet: ``fold``, ``passage``, ``switch``, ``dead end``, ``linear mode``.
    target : str or None
        Id of the node on the other side; None makes a dead end, with `note` as its reason.
    h, alpha : float
    target_event : str
        The event's id on the target; "" where it has none.
    stop : str or None
        The contact that is touched or left.
    note : str or None
    source_orbit, target_orbit : EventOrbit or None
        The event's orbit as the two families have it, which shows that the edge closes.
    """

    source: str
    source_event: str
    type: str
    kind: str
    target: str | None
    h: float
    alpha: float
    target_event: str = ""
    stop: str | None = None
    note: str | None = None
    source_orbit: EventOrbit | None = None
    target_orbit: EventOrbit | None = None

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        events = [("from", f"{self.source} {self.source_event}".rstrip()), ("to", f"{self.target} {self.target_event}".rstrip())]
        return f"Edge {self.type}, {self.kind}, at h = {self.h:.10g}, alpha = {self.alpha:.10g}", events

    def values(self) -> tuple[Any, ...]:
        """The values of its row in the catalogue."""
        orbits = (None if orbit is None else compact_json([*vars(orbit).values()]) for orbit in (self.source_orbit, self.target_orbit))
        return (
            self.source, self.source_event, self.type, self.kind, self.target, self.target_event, float(self.h), float(self.alpha),
            self.stop, self.note, *orbits,
        )  # fmt: skip

    @classmethod
    def of(cls, values: tuple[Any, ...]) -> Edge:
        """The object of a row, as `values` gives it."""
        source, source_event, type, kind, target, target_event, h, alpha, stop, note, here, there = values
        return cls(source, source_event, type, kind, target, h, alpha, target_event, stop, note, EventOrbit.of(here), EventOrbit.of(there))


def dead_end_id(source: str, event: str) -> str:
    """Id of the node at which an edge without a target ends."""
    return f"dead end:{source}:{event}"


def event_values(event: BranchEvent) -> tuple[Any, ...]:
    """The row of an event: its fields, with the two numbers of `bracket` and of `p_q` apart."""
    located = (event.h, event.alpha, event.arclength, event.status, *event.bracket, event.residual)
    stable = None if event.stable is None else int(event.stable)
    return (
        event.id, event.type, int(event.point), int(event.number), *map(_number, located), event.label, event.stop,
        *(event.p_q or (None, None)), event.breaks, event.note, stable, _number(event.multiplier),
    )  # fmt: skip


def event_from_row(values: tuple[Any, ...]) -> BranchEvent:
    """The inverse of `event_values`."""
    (
        id, type, point, number, h, alpha, arclength, status, low, high, residual, label, stop, p, q, breaks, note, stable, multiplier,
    ) = values  # fmt: skip
    bracket = (math.nan if low is None else low, math.nan if high is None else high)
    return BranchEvent(
        id, type, point, number, h, alpha, arclength, status, bracket, math.nan if residual is None else residual, label, stop,
        None if p is None else [p, q], breaks, note, None if stable is None else bool(stable), multiplier,
    )  # fmt: skip


def compact_json(value: Any) -> str:
    """JSON without spaces; NaN is refused."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def _number(value: Any) -> Any:
    """A number of numpy as a float, and NaN as None, for SQLite; text and None stay."""
    if value is None or isinstance(value, str):
        return value
    return None if math.isnan(value) else float(value)


@dataclass(frozen=True)
class SceneRecord:
    """The scene of a catalogue.

    Attributes
    ----------
    system : dict
        As `bvp.system.ImpactSystem.describe` gives it.
    bounds : dict
        ``energy``, ``quarter_period``, ``impacts``; empty for a scene without bounds.
    reference_points : dict of str to dict
        Cited ``h`` and ``alpha`` by name; they choose among the families that match a bare name.
    title, source, text : str
        The scene's title and source, and its TOML if it was read from a file.
    parameters : dict
        Of a catalogue of families in a parameter: ``names`` of the parameters that vary, and the equations that they ``keep``. `system` is
        then as `bvp.parameters.ParametricSystem.describe` gives it.
    """

    system: dict[str, Any]
    bounds: dict[str, Any] = field(default_factory=dict)
    reference_points: dict[str, dict[str, float]] = field(default_factory=dict)
    title: str = ""
    source: str = ""
    text: str = ""
    parameters: dict[str, list[str]] = field(default_factory=dict)

    @property
    def is_free(self) -> bool:
        """Whether its families are those of free orbits in parameters: they keep as many equations as parameters vary."""
        return bool(self.parameters) and len(self.parameters["keep"]) == len(self.parameters["names"])

    @property
    def held(self) -> str:
        """What families it has, in words."""
        if not self.parameters:
            return "families in the energy"
        return f"{'families of free orbits' if self.is_free else 'responses'} in {', '.join(self.parameters['names'])}"

    @property
    def axes(self) -> Axes:
        """What the two numbers of its families are."""
        if not self.parameters:
            return ENERGY
        name = self.parameters["names"][0]
        return Axes((name, "period"), (name, "T"), ("parameter", "period"))

    @classmethod
    def of(cls, scene: Any) -> SceneRecord:
        """The record of a scene, or of a system alone.

        Parameters
        ----------
        scene : saltus.Scene, bvp.system.ImpactSystem or SceneRecord
        """
        if isinstance(scene, cls):
            return scene
        if hasattr(scene, "describe"):
            return cls(scene.describe())
        if not hasattr(scene, "reference_points"):
            raise TypeError(f"the scene is {shown(scene)}, expected a Scene such as saltus.load_scene(), or an ImpactSystem")
        kept = {} if scene.energy is None else scene.bounds
        bounds = {key: list(value) if isinstance(value, tuple) else value for key, value in kept.items()}
        points = {name: dict(point) for name, point in scene.reference_points.items()}
        return cls(scene.system.describe(), bounds, points, scene.title, scene.source, getattr(scene, "text", ""))


@dataclass(frozen=True)
class Axes:
    """What the two numbers of a family, an event and an edge are: ``h`` and ``alpha``, or a parameter and the period.

    Attributes
    ----------
    names : (str, str)
        In tables.
    symbols : (str, str)
        In equations.
    keys : (str, str)
        In files.
    """

    names: tuple[str, str]
    symbols: tuple[str, str]
    keys: tuple[str, str]


ENERGY = Axes(("energy h", "quarter alpha"), ("h", "alpha"), ("h", "alpha"))
"""The axes of conservative families."""


def difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str | None:
    """The differences of two descriptions of systems, as text; None if there are none.

    Examples
    --------
    >>> difference({"model": "vibro_impact_nes", "mu": 0.1}, {"model": "vibro_impact_nes", "mu": 0.2})
    'mu is 0.1, not 0.2'
    >>> difference({"mass": [[1.0]]}, {"mass": [[1.0]]})
    """
    mine, theirs = dict(_leaves(one)), dict(_leaves(other))
    changed = [key for key in dict.fromkeys([*mine, *theirs]) if mine.get(key) != theirs.get(key)]
    differences = [f"{key} is {_value(mine.get(key))}, not {_value(theirs.get(key))}" for key in changed]
    if len(differences) > 3:
        differences = [*differences[:3], f"and {len(differences) - 3} more"]
    return ", ".join(differences) or None


def _leaves(value: Any, name: str = "") -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [leaf for key, entry in value.items() for leaf in _leaves(entry, f"{name}.{key}" if name else key)]
    if isinstance(value, list | tuple) and any(isinstance(entry, list | tuple | Mapping) for entry in value):
        return [leaf for i, entry in enumerate(value) for leaf in _leaves(entry, f"{name}[{i}]")]
    return [(name, list(value) if isinstance(value, tuple) else value)]


def _value(value: Any) -> str:
    return "absent" if value is None else f"{value:.15g}" if isinstance(value, float) else str(value)
