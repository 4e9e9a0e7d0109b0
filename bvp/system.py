"""Impacting systems: dynamics M u'' + C u' + K u = 0 between rigid stops, linear but for springs and dampers that are not.

The input is checked on construction. A `Stop` bounds one gap coordinate w = c . u on one or both sides; at a bound the velocity jumps along
M^-1 c with Newton's restitution. An `ImpactSystem` carries the three matrices, the stops, springs and dampers, and the coordinates' names.
"""

from __future__ import annotations

import math
import string
import sys
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.blocks import Matrices
from bvp.checks import EPSILON, SMALLEST, InvalidSystem, checked_number, read_only, reals, refuse_unknown, square
from bvp.dense import product
from bvp.modes import repeated_contacts, system_modes
from bvp.springs import Damper, Spring, element_from, is_nonlinear
from bvp.texts import brief, listed, shown

if TYPE_CHECKING:
    from bvp.smooth_forces import SmoothForces

__all__ = ["ImpactSystem", "InvalidSystem", "Stop", "vibro_impact_nes"]

SYSTEM_KEYS = ("mass", "damping", "stiffness", "stops", "coordinates", "springs", "dampers")
STOP_KEYS = ("c", "lower", "upper", "restitution", "name")
"""Keys of the description of a system without a model, and of a stop."""


@brief
@dataclass(frozen=True)
class Stop:
    """A rigid stop that bounds w = gap . u, lower <= w <= upper.

    Parameters
    ----------
    gap : sequence of n floats
        Row c of the gap coordinate w = c . u.
    lower, upper : float
        Bounds of w, in units of displacement; -inf or inf where there is none. At least one is finite.
    restitution : float
        Newton's coefficient in [0, 1]: the speed w' after an impact is -restitution times the speed before.
    name : str
        One lower-case letter; by default `ImpactSystem` gives "a", "b", ... in order.

    Raises
    ------
    InvalidSystem
        For a gap row that is zero or not finite, for lower >= upper, for no finite bound, for a restitution outside [0, 1].

    Examples
    --------
    >>> Stop((1.0, -1.0), -1.0, 1.0).restitution
    1.0
    """

    gap: tuple[float, ...]
    lower: float = -math.inf
    upper: float = math.inf
    restitution: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        label = f"stop {self.name}" if self.name else "a stop"
        if not isinstance(self.name, str) or (self.name and not (len(self.name) == 1 and "a" <= self.name <= "z")):
            raise InvalidSystem(f"the name of a stop is one lower-case letter a to z; received {shown(self.name)}")
        try:
            gap = tuple(reals(self.gap, flat=True).tolist())
        except (TypeError, ValueError):
            raise InvalidSystem(f"the gap row of {label} is a list of numbers; received {shown(self.gap)}") from None
        if not gap or not all(math.isfinite(x) for x in gap):
            raise InvalidSystem(f"the gap row of {label} is a list of finite numbers; received {list(gap)}")
        if not any(gap):
            raise InvalidSystem(f"the gap row of {label} is zero: no coordinate moves towards it")
        for entry in gap:
            checked_number(entry, f"an entry of the gap row of {label}")
        checked_number(max(map(abs, gap)), f"the gap row of {label}", SMALLEST)
        object.__setattr__(self, "gap", gap)
        for key, least in (("lower", SMALLEST), ("upper", SMALLEST), ("restitution", 0.0)):
            object.__setattr__(self, key, checked_number(getattr(self, key), f"{key} of {label}", least))
        if not self.lower < self.upper:
            raise InvalidSystem(f"lower must be below upper; {label} has lower {self.lower:g}, upper {self.upper:g}")
        if math.isinf(self.lower) and math.isinf(self.upper):
            raise InvalidSystem(f"{label} has no finite bound; give lower, upper or both")
        bound = min(max(self.restitution, 0.0), 1.0)
        if abs(self.restitution - bound) <= 4.0 * EPSILON:  # an expression is rounded at its bound
            object.__setattr__(self, "restitution", bound)
        if not 0.0 <= self.restitution <= 1.0:
            raise InvalidSystem(f"restitution lies in [0, 1]; {label} has {self.restitution:g}")

    def named(self, name: str) -> Stop:
        """The same with another name, a letter."""
        found = copy(self)
        object.__setattr__(found, "name", name)
        return found


@brief
@dataclass(frozen=True, eq=False)
class ImpactSystem(Matrices):
    """M u'' + C u' + K u = 0 with n degrees of freedom between stops.

    Parameters
    ----------
    mass : (n, n) array_like
        M, symmetric positive definite.
    damping : (n, n) array_like
        C, any finite matrix (zero where nothing damps).
    stiffness : (n, n) array_like
        K, symmetric; it may be semidefinite (rigid-body modes) or indefinite.
    stops : sequence of Stop
        At least one if there are no springs.
    coordinates : sequence of n str
        Names of the displacements; default u1, u2, ...
    absorber, primary : int, str or None
        The coordinate of the nonlinear energy sink and that of the linear oscillator, where the system has them: an index or a name.
    model, parameters : str, mapping or None
        The named model that made the system and its parameters, for `describe`.
    springs, dampers : sequence of bvp.springs.Spring, of bvp.springs.Damper
        Their linear parts are added to K and C, and those kept here have it no more (`nonlinear_only`).
    known_forces : SmoothForces, optional
        The forces of these springs and dampers, where they are known: they are not made again.

    Attributes
    ----------
    degrees_of_freedom : int
        n, the number of displacements.
    is_conservative : bool
        True where nothing loses or gains energy: no damping, restitution 1 at every stop, springs with a potential.
    has_odd_symmetry : bool
        True where u -> -u is a symmetry: every stop has lower == -upper, and the forces of springs and dampers are odd.

    Raises
    ------
    InvalidSystem
        For matrices of unequal shape, not finite, asymmetric M or K, indefinite M; for a gap row of another length; for a number
        beyond the sizes of `bvp.checks`.

    Examples
    --------
    >>> system = ImpactSystem([[1.0]], [[0.0]], [[4.0]], [Stop((1.0,), upper=0.5)])
    >>> system.degrees_of_freedom, system.is_conservative
    (1, True)
    >>> float(system.modes.frequencies[0])
    2.0
    """

    stops: tuple[Stop, ...]
    coordinates: tuple[str, ...] = ()
    absorber: int | None = None
    primary: int | None = None
    model: str | None = None
    parameters: Mapping[str, float] | None = field(default=None, repr=False)
    springs: tuple[Spring, ...] = ()
    dampers: tuple[Damper, ...] = ()
    known_forces: InitVar[SmoothForces | None] = None
    degrees_of_freedom: int = field(init=False, repr=False)
    is_conservative: bool = field(init=False, repr=False)
    has_odd_symmetry: bool = field(init=False, repr=False)

    def __post_init__(self, known_forces: SmoothForces | None) -> None:
        if known_forces is not None:
            vars(self)["smooth_forces"] = known_forces
        mass = square(self.mass, "mass")
        n = mass.shape[0]
        # Stiffness first: damping that is not given has its shape.
        stiffness = square(self.stiffness, "stiffness", n)
        damping = square(self.damping, "damping", n, symmetric=False)
        diagonal = mass.diagonal()
        if diagonal.min() <= 0.0:
            k = int(np.argmin(diagonal))
            raise InvalidSystem(f"mass must be positive definite; its diagonal entry {k + 1} is {diagonal[k]:g}")
        # Scaled to a unit diagonal, so that mass ratios of any size pass.
        scale = 1.0 / np.sqrt(diagonal)
        smallest = float(np.linalg.eigvalsh(scale[:, None] * mass * scale)[0]) if np.count_nonzero(mass) > n else 1.0
        if smallest <= n * 4.0 * EPSILON:
            kind = "indefinite" if smallest < -n * 4.0 * EPSILON else "singular"
            raise InvalidSystem(
                f"mass must be positive definite; scaled to a unit diagonal it is {kind} (lowest eigenvalue {smallest:.3g})"
            )
        for name, value in (("mass", mass), ("damping", damping), ("stiffness", stiffness)):
            object.__setattr__(self, name, read_only(value))
        stops = (self.stops,) if isinstance(self.stops, Stop) else self.stops
        listed_stops = isinstance(stops, Sequence) and all(isinstance(stop, Stop) for stop in stops)
        if not listed_stops or not (stops or self.springs or self.dampers):
            raise InvalidSystem("stops is a list of at least one Stop, springs of at least one Spring, or dampers of at least one Damper")
        if len(stops) > 26:
            raise InvalidSystem(f"at most 26 stops can be named a to z; received {len(stops)}")
        taken = [stop.name for stop in stops if stop.name]
        if len(set(taken)) != len(taken):
            raise InvalidSystem(f"stops have different names; received {', '.join(taken)}")
        free = iter([letter for letter in string.ascii_lowercase if letter not in taken])
        named = tuple(stop if stop.name else stop.named(next(free)) for stop in stops)
        for stop in named:
            if len(stop.gap) != n:
                raise InvalidSystem(f"the gap row of stop {stop.name} has {len(stop.gap)} entries; the system has {n} coordinates")
        object.__setattr__(self, "stops", named)
        for a, b, bound in self.repeated_stops() if len(named) > 1 else ():
            if a.restitution != b.restitution:
                raise InvalidSystem(
                    f"stops {a.name} and {b.name} end the same gap at the same place, {bound:g} of stop {a.name}, "
                    f"with restitutions {a.restitution:g} and {b.restitution:g}; give them one, or leave one of them out"
                )
        names = tuple(f"u{k + 1}" for k in range(n)) if self.coordinates == () else self.coordinates
        if isinstance(names, str) or not isinstance(names, Sequence) or len(names) != n:
            raise InvalidSystem(f"coordinates is a list of {n} names; received {shown(names)}")
        if len(set(map(str, names))) != n or not all(isinstance(name, str) and name for name in names):
            raise InvalidSystem(f"coordinates have different names that are not empty; received {shown(names)}")
        object.__setattr__(self, "coordinates", tuple(names))
        for key in ("absorber", "primary"):
            index = getattr(self, key)
            if isinstance(index, str) and index in names:
                index = names.index(index)
                object.__setattr__(self, key, index)
            if index is not None and (isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < n):
                raise InvalidSystem(f"{key} is one of the coordinates {', '.join(names)} or its index; received {shown(index)}")
        if self.absorber is not None and self.absorber == self.primary:
            raise InvalidSystem(f"absorber and primary are two coordinates; both are {names[self.absorber]}")
        object.__setattr__(self, "degrees_of_freedom", n)
        if self.springs or self.dampers:
            self._take_linear_parts()
        object.__setattr__(self, "is_conservative", self.why_not_conservative() is None)
        object.__setattr__(self, "has_odd_symmetry", self.why_not_odd() is None)

    def _take_linear_parts(self) -> None:
        """Add the linear parts of springs and dampers to K and C, once."""
        from bvp.smooth_forces import linear_part

        n = self.degrees_of_freedom
        for key, cls, name in (("springs", Spring, "stiffness"), ("dampers", Damper, "damping")):
            elements = getattr(self, key)
            if not isinstance(elements, Sequence) or not all(isinstance(element, cls) for element in elements):
                raise InvalidSystem(f"{key} is a list of {cls.__name__}; received {shown(elements)}")
            for element in elements:
                if element.row and len(element.row) != n:
                    place, entries = element.place(self.coordinates), len(element.row)
                    raise InvalidSystem(f"the row of {place} has {entries} entries; the system has {n} coordinates")
            if not all(element.nonlinear_only for element in elements):
                total = getattr(self, name) + linear_part(elements, self.coordinates)
                object.__setattr__(self, name, read_only(square(total, name, n, symmetric=name == "stiffness")))
            kept = tuple(element if element.nonlinear_only else replace(element, nonlinear_only=True) for element in elements)
            object.__setattr__(self, key, kept)

    @cached_property
    def smooth_forces(self) -> SmoothForces | None:
        """The forces of springs and dampers that are not linear; None if all are, and nothing is loaded for them."""
        if not any(element.text or is_nonlinear(element) for element in (*self.springs, *self.dampers)):
            return None
        from bvp.smooth_forces import smooth_forces

        return smooth_forces(self.springs, self.dampers, self.coordinates)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "smooth_forces"}  # compiled expressions have no copy

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        stops = [f"{stop.name}: {stop.lower:g} to {stop.upper:g}, restitution {stop.restitution:g}" for stop in self.stops]
        parameters = ", ".join(f"{key} = {value:g}" for key, value in (self.parameters or {}).items())
        model = [("model", f"{self.model}: {parameters}")] if "model" in self.describe() else []
        title = f"ImpactSystem with {self.degrees_of_freedom} degrees of freedom"
        elements = [element.place(self.coordinates) for element in (*self.springs, *self.dampers)]
        rows = [*model, ("coordinates", listed(self.coordinates)), ("stops", listed(stops, 3))]
        return title, [*rows, ("springs", listed(elements, 3))] if elements else rows

    def energy(self, u: Any, v: Any) -> Any:
        """Kinetic and elastic energy (v M v + u K u)/2 of displacements and velocities (..., n), and the potential of nonlinear springs.

        A spring that has no potential adds nothing.

        Examples
        --------
        >>> vibro_impact_nes(mu=0.1, sigma=0.1).energy([0.0, 0.0], [0.0, 2.0])
        2.0
        """
        u, v = reals(u), reals(v)
        with np.errstate(invalid="ignore", over="ignore"):
            moved, pulled = (product(rows.reshape(-1, rows.shape[-1]), matrix) for rows, matrix in ((v, self.mass), (u, self.stiffness)))
            total = 0.5 * (np.sum(moved.reshape(v.shape) * v, axis=-1) + np.sum(pulled.reshape(u.shape) * u, axis=-1))
        if self.smooth_forces is not None and self.has_potential:
            total = total + self.smooth_forces.energy(u)
        return float(total) if np.ndim(total) == 0 else total

    def repeated_stops(self) -> list[tuple[Stop, Stop, float]]:
        """Pairs of stops that end one gap at one place, and the place in the gap coordinate of the first."""
        contacts = [(stop, bound) for stop in self.stops for bound in (stop.lower, stop.upper) if math.isfinite(bound)]
        pairs = repeated_contacts(self.stops).items()
        return [(contacts[earlier][0], contacts[contact][0], contacts[earlier][1]) for contact, earlier in pairs]

    @property
    def has_potential(self) -> bool:
        """Whether all springs have a potential, which the computation of motion needs."""
        return self.smooth_forces is None or self.smooth_forces.potential is not None

    def why_not_conservative(self) -> str | None:
        """One sentence that names what loses energy, or None."""
        for stop in self.stops:
            if stop.restitution != 1.0:
                return f"restitution {stop.restitution:g} of stop {stop.name} loses energy"
        if np.any(self.damping):
            i, j = np.unravel_index(int(np.argmax(np.abs(self.damping))), self.damping.shape)
            return (
                f"damping acts on {self.coordinates[i]}"
                + ("" if i == j else f" through {self.coordinates[j]}")
                + f" (coefficient {self.damping[i, j]:g})"
            )
        if self.smooth_forces is not None:
            return self.smooth_forces.why_dissipative or self.smooth_forces.why_no_potential
        return None

    def why_not_odd(self) -> str | None:
        """What has no odd symmetry, or None."""
        uneven = [f"stop {stop.name} from {stop.lower:g} to {stop.upper:g}" for stop in self.stops if stop.lower != -stop.upper]
        if uneven:
            return " and ".join(uneven)
        return None if self.smooth_forces is None else self.smooth_forces.why_not_odd

    def why_not_inside(self) -> str | None:
        """Which stop the rest position u = 0 is not inside of, or None."""
        for stop in self.stops:
            if not stop.lower < 0.0 < stop.upper:
                place = "at" if 0.0 in (stop.lower, stop.upper) else "beyond"
                return f"the rest position lies {place} stop {stop.name}, whose gap coordinate goes from {stop.lower:g} to {stop.upper:g}"
        return None

    def why_not_linear(self) -> str | None:
        """Which spring or damper is not linear, or None."""
        for element in (*self.springs, *self.dampers):
            if self.smooth_forces is not None if element.text else is_nonlinear(element):
                return f"{element.place(self.coordinates)} is not linear"
        return None

    @property
    def underlying(self) -> ImpactSystem:
        """The underlying conservative system: the same masses, springs and stops, without damping, restitution 1 at every stop.

        Examples
        --------
        >>> vibro_impact_nes(mu=0.2, lam=0.01, rho=0.7).underlying.describe()
        {'model': 'vibro_impact_nes', 'mu': 0.2, 'sigma': 0.1, 'lam': 0.0, 'rho': 1.0}
        """
        if self.is_conservative:
            return self
        stops = tuple(replace(stop, restitution=1.0) for stop in self.stops)
        parameters = self.parameters and {**self.parameters, "lam": 0.0, "rho": 1.0}
        # Without stops and springs a linear system is left, as one with a spring that has no stiffness.
        springs = self.springs or (() if stops else (Spring(np.eye(self.degrees_of_freedom)[0].tolist(), stiffness=0.0),))
        return replace(self, damping=np.zeros_like(self.damping), stops=stops, parameters=parameters, springs=springs, dampers=())

    modes = cached_property(system_modes)
    """The blocks of free flight, as arrays for the kernels (computed once)."""

    def describe(self) -> dict[str, Any]:
        """The system as plain lists, numbers and strings, for JSON and TOML; `from_description` is the inverse."""
        if self.model in MODELS and self.parameters is not None:
            # `dataclasses.replace` may have changed the system, and then it is no longer that of its model.
            other = MODELS[self.model].make(**self.parameters)
            same = all(np.array_equal(getattr(self, key), getattr(other, key)) for key in ("mass", "damping", "stiffness"))
            others = ("stops", "coordinates", "absorber", "primary", "springs", "dampers")
            if same and all(getattr(self, key) == getattr(other, key) for key in others):
                return {"model": self.model, **{key: float(value) for key, value in self.parameters.items()}}
        stops = []
        for stop in self.stops:
            entry: dict[str, Any] = {"name": stop.name, "c": list(stop.gap)}
            entry.update({key: getattr(stop, key) for key in ("lower", "upper") if math.isfinite(getattr(stop, key))})
            stops.append({**entry, "restitution": stop.restitution})
        names: dict[str, Any] = {"names": list(self.coordinates)}
        # Dampers that take nothing make no other system: families are those of the undamped one.
        acting = {"springs": self.springs, "dampers": () if self.is_conservative else self.dampers}
        for key in ("absorber", "primary"):
            index = getattr(self, key)
            if index is not None:
                names[key] = self.coordinates[index]
        return {
            "mass": self.mass.tolist(),
            "damping": self.damping.tolist(),
            "stiffness": self.stiffness.tolist(),
            "stops": stops,
            "coordinates": names,
            **{key: [element.describe() for element in elements] for key, elements in acting.items() if elements},
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any], known_forces: SmoothForces | None = None) -> ImpactSystem:
        """The system that `describe` described.

        Parameters
        ----------
        description : mapping
            Either `model` and its parameters, or `mass`, `stiffness`, `stops` and optionally `damping` and `coordinates`. With `springs`
            there can be no `stops`.
        known_forces : SmoothForces, optional
            As for `ImpactSystem`.

        Raises
        ------
        InvalidSystem
            For an unknown or missing key (the nearest known one is named) or for values that cannot be.

        Examples
        --------
        >>> ImpactSystem.from_description({"model": "vibro_impact_nes", "mu": 0.2}).mass[0, 0]
        np.float64(0.2)
        """
        if not isinstance(description, Mapping):
            raise InvalidSystem(f"a system is a table of keys and values; received {type(description).__name__}")
        given = dict(description)
        if "model" in given:
            name = given.pop("model")
            if not isinstance(name, str) or name not in MODELS:
                raise InvalidSystem(f"unknown model {name!r}; known: {', '.join(MODELS)}")
            refuse_unknown(given, tuple(MODELS[name].domains), f"model {name}")
            return MODELS[name].make(**given)
        refuse_unknown(given, SYSTEM_KEYS, "the system")
        if "springs" in given:
            given.setdefault("stops", ())
        for key in ("mass", "stiffness", "stops"):
            if key not in given:
                raise InvalidSystem(f"the system lacks {key!r}; give mass, stiffness and stops, or a model")
        names = given.get("coordinates", {})
        names = dict(names) if isinstance(names, Mapping) else {"names": names}
        refuse_unknown(names, ("names", "absorber", "primary"), "coordinates")
        if isinstance(given["stops"], (str, Mapping)) or not isinstance(given["stops"], Sequence):
            raise InvalidSystem(f"stops is a list of tables; received {shown(given['stops'])}")
        stops = []
        for entry in given["stops"]:
            if not isinstance(entry, Mapping):
                raise InvalidSystem(f"a stop is a table with c, lower, upper, restitution; received {shown(entry)}")
            refuse_unknown(entry, STOP_KEYS, "a stop")
            if "c" not in entry:
                raise InvalidSystem("a stop lacks its gap row 'c'")
            stops.append(Stop(entry["c"], **{key: value for key, value in entry.items() if key != "c"}))
        damping = given.get("damping", np.zeros(np.shape(given["stiffness"])))
        places: dict[str, Any] = {key: names.get(key) for key in ("absorber", "primary")}
        elements: dict[str, Any] = {}
        for key, kind in (("springs", Spring), ("dampers", Damper)):
            entries = given.get(key, ())
            if isinstance(entries, (str, Mapping)) or not isinstance(entries, Sequence):
                raise InvalidSystem(f"{key} is a list of tables; received {shown(entries)}")
            known = names.get("names", ()) or [f"u{k}" for k, _ in enumerate(given["mass"], 1)] if entries else ()
            elements[key] = tuple(element_from(kind, entry, known) for entry in entries)
        elements["known_forces"] = known_forces
        return cls(given["mass"], damping, given["stiffness"], tuple(stops), names.get("names", ()), **places, **elements)

    @classmethod
    def from_lagrangian(cls, *arguments: Any, **options: Any) -> ImpactSystem:
        """The system of kinetic and potential energy given as sympy expressions: see `bvp.lagrangian.parts_from_lagrangian`."""
        from bvp.lagrangian import parts_from_lagrangian

        parts = parts_from_lagrangian(*arguments, **options)
        return cls(**{**parts, "stops": tuple(Stop(*stop) for stop in parts["stops"])})


def vibro_impact_nes(mu: float = 0.1, sigma: float = 0.1, lam: float = 0.0, rho: float = 1.0) -> ImpactSystem:
    """Linear oscillator u2 that carries a vibro-impact nonlinear energy sink u1 in a cavity of half-width 1.

    mu u1'' + sigma (u1 - u2) = 0,  u2'' + lam u2' + u2 + sigma (u2 - u1) = 0,  |u1 - u2| <= 1
    (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Eqs. 2 and 11). The gap is w = u1 - u2, "+" is w = 1.

    Parameters
    ----------
    mu : float
        Mass ratio, > 0.
    sigma : float
        Stiffness of the coupling over that of the oscillator, >= 0.
    lam : float
        Damping of the oscillator, >= 0.
    rho : float
        Restitution, in [0, 1].

    Raises
    ------
    InvalidSystem
        For a parameter outside its range or not finite.

    Examples
    --------
    >>> vibro_impact_nes(mu=0.1, sigma=0.1).modes.frequencies.round(6)
    array([0.854309, 1.170537])
    """
    values = {}
    for key, given, meaning, expected, largest in (
        ("mu", mu, "the mass ratio", "must be above 0 and finite", sys.float_info.max),
        ("sigma", sigma, "the coupling stiffness", "must be 0 or above and finite", sys.float_info.max),
        ("lam", lam, "the damping", "must be 0 or above and finite", sys.float_info.max),
        ("rho", rho, "the restitution", "lies in [0, 1]", 1.0),
    ):
        value = checked_number(given, f"{key}, {meaning},", SMALLEST if key == "mu" else 0.0)
        if not 0.0 <= value <= largest or (key == "mu" and value == 0.0):
            raise InvalidSystem(f"{key}, {meaning}, {expected}; received {value:g}")
        values[key] = value
    mu, sigma, lam, rho = values.values()
    parts = _nes_parts(**values)
    return ImpactSystem(
        mass=np.array(parts["mass"], dtype=float),
        damping=np.array(parts["damping"], dtype=float),
        stiffness=np.array(parts["stiffness"], dtype=float),
        stops=(_nes_stop(rho),),
        absorber=0,
        primary=1,
        model="vibro_impact_nes",
        parameters=values,
    )


@lru_cache(maxsize=8)
def _nes_stop(rho: float) -> Stop:
    """The cavity. It is checked once along a family."""
    return Stop(*_nes_parts(0, 0, 0, rho)["stops"][0]).named("a")


def _nes_parts(mu: Any, sigma: Any, lam: Any, rho: Any) -> dict[str, Any]:
    """Matrices, and the row, bounds and restitution of the stop, of numbers or of expressions."""
    return {
        "mass": [[mu, 0], [0, 1]],
        "damping": [[0, 0], [0, lam]],
        "stiffness": [[sigma, -sigma], [-sigma, 1 + sigma]],
        "stops": [((1, -1), -1, 1, rho)],
    }


class Model(NamedTuple):
    """A named model."""

    make: Callable[..., ImpactSystem]
    parts: Callable[..., dict[str, Any]]  # matrices and stops, also of expressions
    domains: Mapping[str, tuple[float, float]]  # the names of its parameters, and between which values each lies


MODELS = {
    "vibro_impact_nes": Model(
        vibro_impact_nes, _nes_parts, {"mu": (0.0, math.inf), "sigma": (0.0, math.inf), "lam": (0.0, math.inf), "rho": (0.0, 1.0)}
    )
}
"""The named models."""
