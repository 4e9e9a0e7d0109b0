"""A system and its loads as functions of named parameters, with exact derivatives.

A description is plain data: numbers, and texts that are expressions of the parameters. At values of the parameters it gives an
`ImpactSystem` and loads. Sympy differentiates the expressions once. It is loaded only if an expression is more than a name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.checks import Frozen, InvalidSystem, is_finite, refuse_unknown
from bvp.description import (
    BASE,
    FORCE,
    force_from,
    in_reciprocal,
    leaves,
    mapped,
    ordered_by_dependence,
    own_parameters,
    reciprocals,
    replaced_values,
    require_name,
    require_used,
)  # fmt: skip
from bvp.entries import EntryLayout, entries_of, exact
from bvp.expressions import parsed
from bvp.forcing import Constant, Force, Harmonic
from bvp.springs import LARGEST_POWER
from bvp.system import MODELS, STOP_KEYS, SYSTEM_KEYS, ImpactSystem
from bvp.texts import at_values, brief, nearest_known, shown

if TYPE_CHECKING:
    from bvp.kernels.expressions import Program
    from bvp.smooth_forces import SmoothForces

__all__ = ["ParametricSystem", "Released"]


class Released(NamedTuple):
    """What a kernel needs to compute the entries that depend on P released parameters.

    ``run(program, parameters, scratch, out)`` of `bvp.kernels.expressions` receives the values of all parameters (N,), in the order of
    `ParametricSystem.names`. It writes D entries, then their derivatives by the P parameters, entry by entry: out is (D + D P,)."""

    program: Program
    rows: np.ndarray  # (D,) int64, ascending: the entries, by `EntryLayout`
    columns: np.ndarray  # (P,) int64: the released parameters among the names
    scratch: int  # length of the scratch


@brief
@dataclass(frozen=True, eq=False)
class ParametricSystem:
    """A system and its loads as functions of N named parameters.

    Made by `from_description` or `of`.

    Parameters
    ----------
    description : mapping
        ``parameters``: a number, or an expression of other parameters, by name; with ``"1/n"`` a number, of which n is the reciprocal.
        ``system``: as `ImpactSystem.from_description` takes it.
        ``forces``: a list of loads (`from_description`). Numbers of the system and of the loads can be texts: expressions.

    Attributes
    ----------
    names : tuple of N str
        The independent parameters: those with a number, then those of the model, then `BASE` of loads with one frequency.
    values : mapping of str to float
        Their default values.
    derived : mapping of str to str
        The other parameters: expressions of these.
    layout : EntryLayout
        Of the entries. A ValueError if the loads have no common period.
    """

    description: Mapping[str, Any] = field(repr=False)
    names: tuple[str, ...] = field(init=False)
    values: Mapping[str, float] = field(init=False)
    derived: Mapping[str, str] = field(init=False)
    _system: dict[str, Any] = field(init=False, repr=False)
    _forces: list[dict[str, Any]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        given = dict(self.description)
        refuse_unknown(given, ("parameters", "system", "forces"), "the description")
        table = dict(given.get("parameters", {}))
        values: dict[str, float] = {}
        inverse = reciprocals(table)
        for name, value in table.items():
            require_name(name.removeprefix("1/"))
            if name.startswith("1/") and isinstance(value, str):
                raise InvalidSystem(f"parameter {name} is a number, as {name[2:]} follows from it; received {shown(value)}")
            if not isinstance(value, str):
                if not is_finite(value) or isinstance(value, bool):
                    raise InvalidSystem(f"parameter {name} is a finite number or an expression of others; received {shown(value)}")
                values[name] = float(value)
        system, forces = dict(given["system"]), [dict(force) for force in given.get("forces", ())]
        for force in forces:
            refuse_unknown(force, FORCE, "a load")
            if "harmonic" in force:
                if BASE not in table:
                    raise InvalidSystem(f"harmonic = {force['harmonic']} is a multiple of the parameter {BASE}, which is missing")
                force["frequency"] = BASE if force["harmonic"] == 1 else f"{force['harmonic']}*{BASE}"
        if "model" not in system:
            refuse_unknown(system, SYSTEM_KEYS, "the system")
            for stop in system.get("stops", ()):
                refuse_unknown(stop, STOP_KEYS, "a stop")
        own = own_parameters(system, forces, table)
        object.__setattr__(self, "description", given)
        object.__setattr__(self, "names", (*values, *own))
        object.__setattr__(self, "values", Frozen(values | own))
        object.__setattr__(self, "derived", Frozen({name: value for name, value in table.items() if isinstance(value, str)} | inverse))
        object.__setattr__(self, "_system", system)
        object.__setattr__(self, "_forces", forces)
        self._require_used(table)
        self.system()  # it can be made

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> ParametricSystem:
        """The system of a description; `describe` is the inverse.

        Parameters
        ----------
        description : mapping
            Each load has ``load`` (n), a force on each coordinate, or ``ground`` (n), the direction in which the ground moves, and one of:
            ``amplitude``, ``phase`` and ``frequency`` or ``harmonic`` = k, for amplitude cos(frequency t + phase), the frequency being
            k w; ``constant``; ``times``, ``values`` and ``scale``. Or it has ``cosine`` and ``sine`` (n) with ``frequency``.

        Raises
        ------
        InvalidSystem, ValueError
            For an unknown, unused or impossible name, a cycle, an expression that cannot be read, values that a system cannot have.

        Examples
        --------
        >>> stop = {"c": [1.0], "upper": "d", "restitution": 0.8}
        >>> oscillator = ParametricSystem.from_description({
        ...     "parameters": {"A": 0.5, "w": 1.2, "d": 1.0, "k": "w**2"},
        ...     "system": {"mass": [[1.0]], "damping": [["A/10"]], "stiffness": [["k"]], "stops": [stop]},
        ...     "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}]})
        >>> oscillator.system({"w": 3.0}).stiffness, oscillator.forces()[0].frequency
        (array([[9.]]), 1.2)
        >>> oscillator.derivatives(None, ["w"])[oscillator.layout.stiffness]
        array([[2.4]])
        """
        return cls(description)

    @classmethod
    def of(cls, system: ImpactSystem, forces: Sequence[Force] = ()) -> ParametricSystem:
        """A system and its loads. The parameters are those of its model, and `BASE` if the loads have one frequency."""
        loads = []
        for force in forces:
            if isinstance(force, Harmonic):
                loads.append({"cosine": force.cosine.tolist(), "sine": force.sine.tolist(), "frequency": force.frequency})
            elif isinstance(force, Constant):
                loads.append({"load": force.load.tolist(), "constant": 1.0})
            else:
                loads.append({"load": force.load.tolist(), "times": force.times.tolist(), "values": force.values.tolist()})
        return cls({"system": system.describe(), "forces": loads})

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [(name, f"{value:g}") for name, value in self.values.items()]
        return f"ParametricSystem with {len(self.names)} parameters", rows + list(self.derived.items())

    @property
    def has_table(self) -> bool:
        """Whether the description has parameters of its own, besides those of its model and the frequency of its loads."""
        return bool(self.description.get("parameters"))

    def describe(self) -> dict[str, Any]:
        """The description, as plain data for JSON."""
        return dict(self.description)

    def all_values(self, values: Mapping[str, float] | None = None) -> dict[str, float]:
        """The values of all parameters, also of the derived ones, at values of the independent ones; errors as for `system`."""
        numbers = self._numbers(self.at(values))
        return {name: numbers[name] for name in (*self.names, *self.derived)}

    def replaced(self, values: Mapping[str, float]) -> ParametricSystem:
        """The same with other default values.

        Raises
        ------
        InvalidSystem
            For an unknown name, and for values outside their domain.
        """
        self.system(values)
        return ParametricSystem(replaced_values(self.description, self._system, self.at(values)))

    def in_reciprocal(self, name: str) -> ParametricSystem:
        """The same with the parameter 1/name in place of an independent one.

        Raises
        ------
        InvalidSystem
            For an unknown parameter, for the frequency of loads that is no parameter of the description, and for one that is zero.

        Examples
        --------
        >>> spring = {"on": "u1", "stiffness": 1.0, "power": "2*n + 1"}
        >>> system = {"mass": [[1.0]], "stiffness": [[0.0]], "springs": [spring]}
        >>> ParametricSystem({"parameters": {"n": 4.0}, "system": system}).in_reciprocal("n").all_values()
        {'1/n': 0.25, 'n': 4.0}
        """
        self._require_known(name)
        return ParametricSystem(in_reciprocal(self.description, name, self.values[name]))

    def domain(self, name: str) -> tuple[float, float]:
        """The interval (low, high) in which a parameter can lie; an end may be excluded. `violation` says what holds at given values.

        Known are the parameters of the model, and a parameter that is itself a mass, restitution, frequency or power."""
        self._require_known(name)
        model = self._system.get("model")
        low, high = -math.inf, math.inf
        if model is not None and self._system.get(name) == name:
            low, high = MODELS[model].domains[name]
        positive = [row[k] for k, row in enumerate(self._system.get("mass", ()))]
        for force in self._forces:
            positive += [force.get("frequency"), BASE if "harmonic" in force else None]
        if name in positive:
            low = 0.0
        if name in [stop.get("restitution") for stop in self._system.get("stops", ())]:
            low, high = max(low, 0.0), min(high, 1.0)
        if name in [element.get("power") for key in ("springs", "dampers") for element in self._system.get(key, ())]:
            low, high = max(low, 1.0), min(high, LARGEST_POWER)
        return low, high

    def at(self, values: Mapping[str, float] | None = None) -> dict[str, float]:
        """The values of all parameters: the defaults, and those that replace them.

        Raises
        ------
        ValueError
            For an unknown name, with the nearest known one; for a value that is no finite number.
        """
        found = dict(self.values)
        for name, value in (values or {}).items():
            self._require_known(name)
            if not is_finite(value):
                raise InvalidSystem(f"parameter {name} is a finite number; received {shown(value)}")
            found[name] = float(value)
        return found

    def system(self, values: Mapping[str, float] | None = None, known_forces: SmoothForces | None = None) -> ImpactSystem:
        """The system at values of the parameters. known_forces: its smooth forces at these values, which are not made again.

        Raises
        ------
        InvalidSystem
            For values that are outside their domain: the message names them.
        """
        return self._defaults[0] if not values else self._made(values, known_forces)[0]

    def forces(self, values: Mapping[str, float] | None = None) -> tuple[Force, ...]:
        """The loads at values of the parameters; errors as for `system`."""
        return self._defaults[1] if not values else self._made(values)[1]

    def system_along(self, values: Mapping[str, float], released: Sequence[str]) -> ImpactSystem:
        """The system at values of the parameters, also with smooth forces that vanish there, but not at other values of released ones."""
        system = self.system(values)
        if system.smooth_forces is not None or not (system.springs or system.dampers):
            return system
        forces = self.smooth_forces_along(values, released)
        return system if forces is None else self.system(self.at(values), forces)

    def smooth_forces(self, values: Mapping[str, float] | None = None, released: Sequence[str] = ()) -> SmoothForces:
        """The forces of springs and dampers that are not linear, in which released parameters are symbols."""
        found = self.smooth_forces_along(values, released)
        assert found is not None
        return found

    def smooth_forces_along(self, values: Mapping[str, float] | None, released: Sequence[str]) -> SmoothForces | None:
        """The same; None if all are linear at all values of the released parameters."""
        from bvp.description import elements_from
        from bvp.smooth_forces import smooth_forces

        description, symbols = self.description_in(released, values)
        coordinates, at = self.system().coordinates, self.at(values)
        found = smooth_forces(**elements_from(description, coordinates), coordinates=coordinates)
        return found and replace(found, parameters=tuple(symbols), numbers=tuple(at[name] for name in released))

    def description_in(self, released: Sequence[str], values: Mapping[str, float] | None = None) -> tuple[dict[str, Any], list[Any]]:
        """The description of the system at values of the parameters, in which released ones are symbols; and these symbols."""
        for name in released:
            self._require_known(name)
        fixed = {self._symbols[name]: exact(value) for name, value in self.at(values).items() if name not in released}
        found = mapped(self._system, lambda text: self._expressions[text].xreplace(fixed))
        return found, [self._symbols[name] for name in released]

    def violation(self, values: Mapping[str, float] | None = None) -> str | None:
        """Why the parameters cannot have these values, None if they can."""
        try:
            self.system(values)
        except ValueError as error:
            return str(error)
        return None

    def entries(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """The entries (E,), as `layout` places them.

        Raises
        ------
        ValueError
            If the loads have no common period, or an entry is not finite.
        """
        entries = self._fixed.copy()
        released = self.program(())
        entries[released.rows] = self._run(released, values)
        return entries

    def derivatives(self, values: Mapping[str, float] | None, names: Sequence[str]) -> np.ndarray:
        """The derivatives (E, P) of the entries by P parameters; errors as for `entries`."""
        released = self.program(names)
        derivatives = np.zeros((self.layout.size, len(names)))
        count = len(released.rows)
        derivatives[released.rows] = self._run(released, values)[count:].reshape(count, len(names))
        return derivatives

    def program(self, names: Sequence[str], order: int = 1) -> Released:
        """The program of the entries that depend on some parameters, and of their derivatives up to an order. Without names: of all that
        depend on any."""
        from bvp.programs import derivatives_of, program_of, scratch_size

        key, at = tuple(names), (tuple(names), order)
        if at not in self._programs:
            for name in key:
                self._require_known(name)
            symbols = [self._symbols[name] for name in key]
            rows = [row for row, expression in self._variable.items() if not key or expression.free_symbols & set(symbols)]
            program = program_of(derivatives_of([self._variable[row] for row in rows], symbols, order), list(self._symbols.values()))
            columns = np.array([self.names.index(name) for name in key], dtype=np.int64)
            self._programs[at] = Released(program, np.array(rows, dtype=np.int64), columns, scratch_size(program, len(self.names)))
        return self._programs[at]

    def equations(self, texts: Sequence[str], names: Sequence[str], others: Sequence[str] = (), order: int = 1) -> Program:
        """The program of equations such as "F = 0.3*w**2": left less right side of each, then its derivatives by some parameters, equation
        by equation, up to an order. others: more names that can be in an equation; their values follow those of the parameters, and their
        derivatives those by the parameters.

        Raises
        ------
        InvalidSystem
            For a text that is no equation, or has a name that is no parameter.
        """
        from bvp.programs import derivatives_of, program_of

        for name in names:
            self._require_known(name)
        if not texts:
            return program_of([], [])
        import sympy

        more = {name: sympy.Symbol(name, real=True) for name in others}
        known = dict(self._symbols) | more | {name: self._expressions[name] for name in self.derived if name in self._expressions}
        found = []
        for text in texts:
            sides = text.split("=")
            if len(sides) != 2 or not all(side.strip() for side in sides):
                raise InvalidSystem(f"an equation is LEFT = RIGHT, such as F = 0.3*w**2; received {shown(text)}")
            left, right = (self._read(side.strip(), f"the equation {text!r}", known) for side in sides)
            found.append(left - right)
        variables = [*(self._symbols[name] for name in names), *more.values()]
        return program_of(derivatives_of(found, variables, order), [*self._symbols.values(), *more.values()])

    def unseen_entries(self, names: Sequence[str], located: Sequence[str]) -> list[int]:
        """The restitutions, and the base frequency, that released parameters can move out of their domain within the `domain` of those
        whose ends are located: through an expression, or through another one of them."""
        places = [*range(self.layout.restitution.start, self.layout.restitution.stop), self.layout.frequency.start]
        symbols = [self._symbols[name] for name in names]
        seen = {self._symbols[name] for name in located}
        moved = {row: self._variable[row] for row in places if row in self._variable}
        return [row for row, entry in moved.items() if entry not in seen and entry.free_symbols & set(symbols)]

    @property
    def layout(self) -> EntryLayout:
        return self._entries[0]

    @property
    def entry_expressions(self) -> list[Any]:
        """The entries (E), as `layout` places them, each a number or an expression of the parameters."""
        return self._entries[1]

    def _run(self, released: Released, values: Mapping[str, float] | None) -> np.ndarray:
        from bvp.programs import evaluate_program

        at = self.at(values)
        out = evaluate_program(released.program, [at[name] for name in self.names])
        if not np.isfinite(out).all():
            raise InvalidSystem(f"an entry of the system or its derivative is not finite{at_values(at)}")
        return out

    def _require_known(self, name: str) -> None:
        if name in self.derived:
            raise InvalidSystem(f"parameter {name} is the expression {self.derived[name]}; expected one of {', '.join(self.names)}")
        if name not in self.values:
            raise InvalidSystem(f"unknown parameter {shown(name)}{nearest_known(name, self.names)}")

    def _require_used(self, table: Mapping[str, Any]) -> None:
        """Refuse a parameter on which nothing depends."""
        if not all(text in self.values for text in self._texts):
            _ = self._expressions  # what cannot be read is refused first
        require_used(table, self._texts, self.derived)

    @cached_property
    def _texts(self) -> dict[str, str]:
        """Each expression with the place where it was found first."""
        places = [*leaves(self._system, "the system"), *leaves(self._forces, "forces")]
        return dict(reversed(places))

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        if not self.names:
            return {}
        import sympy

        return {name: sympy.Symbol(name, real=True) for name in self.names}

    @cached_property
    def _expressions(self) -> dict[str, Any]:
        """The expression of independent parameters that each text and derived parameter is."""
        if not self.names and not self.derived and not self._texts:
            return {}
        import sympy

        known = dict(self._symbols) | {"pi": sympy.pi}
        given = reciprocals(self.values)
        known |= {name: 1 / self._symbols[inverse] for name, inverse in given.items()}
        for name in ordered_by_dependence({name: text for name, text in self.derived.items() if name not in given}):
            known[name] = self._read(self.derived[name], f"parameter {name}", known)
        return known | {text: self._read(text, where, known) for text, where in self._texts.items() if text not in known}

    def _read(self, text: str, what: str, known: Mapping[str, Any]) -> Any:
        import sympy

        expression = parsed(text, what, {sympy.Symbol(name): exact(value) for name, value in self.values.items()}, exact=True)
        for name in sorted(symbol.name for symbol in expression.free_symbols):
            if name not in known:
                raise InvalidSystem(f"{what} has the name {name}, which is no parameter{nearest_known(name, [*known])}")
        expression = expression.xreplace({symbol: known[symbol.name] for symbol in expression.free_symbols})
        if expression.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo, sympy.I):
            raise InvalidSystem(f"{what} is not a finite real expression; received {shown(text)}")
        return expression

    @cached_property
    def _numbers_program(self) -> tuple[list[str], Program]:
        from bvp.programs import program_of

        texts = [text for text in dict.fromkeys([*self.derived, *self._texts]) if text not in self.values]
        return texts, program_of([self._expressions[text] for text in texts], list(self._symbols.values()))

    def _numbers(self, at: dict[str, float]) -> dict[str, float]:
        """The value of each text."""
        if not self.derived and all(text in at for text in self._texts):
            return at
        from bvp.programs import evaluate_program, program_of

        texts, program = self._numbers_program
        out = evaluate_program(program, list(at.values()))
        if not np.isfinite(out).all():
            symbols = list(self._symbols.values())
            each = [evaluate_program(program_of([self._expressions[text]], symbols), list(at.values()))[0] for text in texts]
            k = int(np.argmin(np.isfinite(each)))
            place = self._texts.get(texts[k], f"parameter {texts[k]}")
            raise InvalidSystem(f"{place} is {self.derived.get(texts[k], texts[k])}, which has no finite value")
        return at | dict(zip(texts, out.tolist(), strict=True))

    @cached_property
    def _defaults(self) -> tuple[ImpactSystem, tuple[Force, ...]]:
        return self._made({})

    def _made(self, values: Mapping[str, float], known_forces: SmoothForces | None = None) -> tuple[ImpactSystem, tuple[Force, ...]]:
        """The system and the loads."""
        at = self.at(values)
        try:
            read = self._numbers(at).__getitem__
            content = mapped(self._system, read)
            if known_forces is not None:
                content |= self._apart(content, at)
            system = ImpactSystem.from_description(content, known_forces)
            return system, tuple(force_from(mapped(force, read), system) for force in self._forces)
        except ValueError as error:
            given = values or at if self.description.get("parameters") else {}
            raise InvalidSystem(f"{error}{at_values(given)}") from None

    def _apart(self, content: Mapping[str, Any], at: Mapping[str, float]) -> dict[str, Any]:
        """The matrices at values of the parameters, with the linear parts of springs and dampers; these without them."""
        entries, layout = self.entries(at), self.layout
        found = {key: entries[getattr(layout, key)].reshape(len(content["mass"]), -1) for key in ("mass", "damping", "stiffness")}
        elements = {key: [{**element, "nonlinear_only": True} for element in content.get(key, ())] for key in ("springs", "dampers")}
        return found | elements

    @cached_property
    def _entries(self) -> tuple[EntryLayout, list[Any]]:
        from bvp.description import load_entries, parts_from

        read = self._expressions.__getitem__
        content = mapped(self._system, read)
        if "model" in content:
            model = MODELS[content.pop("model")]
            default = model.make().parameters or {}
            parts = model.parts(**{name: exact(content.get(name, default[name])) for name in model.domains})
        else:
            parts = parts_from(content, self.system().coordinates)
        loads = load_entries(self._forces, [mapped(force, read) for force in self._forces], parts["mass"])
        return entries_of(parts, loads)

    @cached_property
    def _variable(self) -> dict[int, Any]:
        """The entries that depend on parameters, by their index."""
        return {k: entry for k, entry in enumerate(self._entries[1]) if getattr(entry, "free_symbols", None)}

    @cached_property
    def _fixed(self) -> np.ndarray:
        """The entries that are numbers; NaN for others."""
        return np.array([math.nan if index in self._variable else float(entry) for index, entry in enumerate(self._entries[1])])

    @cached_property
    def _programs(self) -> dict[tuple[tuple[str, ...], int], Released]:
        return {}
