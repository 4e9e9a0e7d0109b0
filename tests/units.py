"""Shipped scenes in other units of length, time and mass: the same system, whose numbers are others."""

import re
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.io

from saltus import load_scene, trace_response
from tests.saltus.running import read_json, reported

CATALOGUES = Path(__file__).parent.parent / "catalogues"

DIMENSIONS = {
    "length": (1, 0, 0), "frequency": (0, -1, 0), "speed": (1, -1, 0), "acceleration": (1, -2, 0), "mass": (0, 0, 1), "damping": (0, -1, 1),
    "stiffness": (0, -2, 1), "force": (1, -2, 1), "energy": (2, -2, 1), "time": (0, 1, 0), "number": (0, 0, 0), "cubic": (-2, -2, 1),
}  # fmt: skip
"""Powers of length, time and mass."""

PARAMETERS = {
    "absorber": {"mu": "mass", "sigma": "stiffness", "lam": "damping", "c": "damping", "F": "force"},
    "beam_on_cubic_spring": {"k3": "cubic"},
    "bouncing_ball": {"g": "acceleration"},
    "cubic_and_stops": {"mu": "mass", "k3": "cubic", "lam": "damping", "lam_nes": "damping"},
    "cubic_nes": {"mu": "mass", "k3": "cubic", "lam": "damping", "lam_nes": "damping"},
    "damped_impact_oscillator": {"k": "stiffness", "c": "damping", "A": "force", "d": "length"},
    "duffing_pair": {"k3": "cubic"},
    "forced_chain": {"c": "damping", "d": "length", "F": "force"},
    "forced_impact_damper": {"mu": "mass", "c": "damping", "F": "force"},
    "impact_oscillator": {"s": "length"},
    "impact_pair": {"A": "length", "d": "length"},
    "lee2009": {"mu": "mass", "sigma": "stiffness", "lam": "damping"},
    "oscillator_at_wall": {"c": "damping", "d": "length", "A": "force"},
    "rattling_gear_pair": {"delta": "damping", "Omega": "speed", "epsilon": "length"},
    "smooth_wall": {"mu": "mass", "sigma": "stiffness", "lam": "damping", "lam_nes": "damping"},
    "ueda_oscillator": {"k": "damping", "B": "force"},
}
"""What the parameters of the scenes are, w always being a frequency; a number where nothing is said."""

_EXPLICIT = {
    "mass": [["mu", 0.0], [0.0, 1.0]],
    "damping": [[0.0, 0.0], [0.0, "lam"]],
    "stiffness": [["sigma", "-sigma"], ["-sigma", "1 + sigma"]],
    "stops": [{"c": [1.0, -1.0], "lower": -1.0, "upper": 1.0, "restitution": "rho"}],
}  # the model vibro_impact_nes


class Units(NamedTuple):
    """How many of the new units one of the old ones is."""

    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0

    def of(self, what):
        """The same of another quantity."""
        length, time, mass = DIMENSIONS[what]
        return self.length**length * self.time**time * self.mass**mass


class ScaledScene(NamedTuple):
    """A scene in other units, and what its parameters are."""

    scene: object
    units: Units
    kinds: dict

    def new(self, name, value):
        """The value of a parameter in the new units."""
        return value * self.units.of(self.kinds.get(name, "number"))

    def old(self, name, value):
        """The value of a parameter in the old units."""
        return value / self.units.of(self.kinds.get(name, "number"))


def scaled_scene(name, units, folder):
    """A shipped scene in other units, written into a folder as a TOML file. Records of the ground are left out."""
    table = tomllib.loads((CATALOGUES / f"{name}.toml").read_text(encoding="utf-8"))
    kinds = {"w": "frequency"} | PARAMETERS.get(name, {})
    for key in ("ground", "sections", "names", "complete"):
        table.pop(key, None)
    system = table["system"]
    if system.pop("model", None) is not None:
        table["parameters"] = {key: system.pop(key) for key in ("mu", "sigma", "lam", "rho")}
        table["system"] = system = {key: _EXPLICIT[key] for key in ("mass", "damping", "stiffness")}
        table["stops"], table["coordinates"] = deepcopy(_EXPLICIT["stops"]), {"names": ["u1", "u2"], "LO": "u2", "NES": "u1"}
    parameters = table.get("parameters", {})

    def scale(parameter):
        return units.of(kinds.get(parameter, "number"))

    def entry(value, factor):
        """A number, or an expression of parameters in the new units, times a factor."""
        if not isinstance(value, str):
            return value * factor
        inner = re.sub(r"[A-Za-z_]\w*", lambda m: f"({m[0]}/{scale(m[0])!r})" if m[0] in parameters else m[0], value)
        # A parameter alone stays one: it has a domain of its own.
        return value if value in kinds and units.of(kinds[value]) == factor else inner if factor == 1.0 else f"({inner})*{factor!r}"

    for key, what in (("mass", "mass"), ("damping", "damping"), ("stiffness", "stiffness")):
        rows = system.get(key, [])
        rows = np.asarray(scipy.io.mmread(CATALOGUES / rows)).tolist() if isinstance(rows, str) else rows
        if rows:
            system[key] = [[entry(value, units.of(what)) for value in row] for row in rows]
    for stop in table.get("stops", []):
        stop.update({key: entry(stop[key], units.length) for key in ("lower", "upper") if key in stop})
    for spring in table.get("springs", []):
        power = eval(str(spring["power"]), {}, dict(parameters)) - 1
        spring["stiffness"] = entry(spring["stiffness"], units.of("stiffness") / units.length**power)
    for force in table.get("forces", []):
        force.update({key: entry(force[key], units.of("force")) for key in ("amplitude", "constant") if key in force})
    for key in parameters:
        parameters[key] *= scale(key)
    bounds = table.get("bounds", {})
    if bounds:
        bounds["energy"] = [value * units.of("energy") for value in bounds["energy"]]
        bounds["quarter_period"] *= units.time
    path = Path(folder) / f"{name}.toml"
    path.write_text(_toml(table), encoding="utf-8")
    return ScaledScene(load_scene(path), units, kinds)


def _toml(table):
    """A dictionary as TOML."""
    lines, parts = [], []
    for key, value in table.items():
        if isinstance(value, dict):
            parts += [f"[{key}]", *(f"{name} = {_value(one)}" for name, one in value.items())]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for one in value:
                parts += [f"[[{key}]]", *(f"{name} = {_value(part)}" for name, part in one.items())]
        else:
            lines.append(f"{key} = {_value(value)}")
    return "\n".join([*lines, *parts]) + "\n"


def _value(value):
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return '"' + value.replace('"', "'") + '"'
    return repr(float(value)) if isinstance(value, float) else repr(value)


RESPONSES = {
    "absorber": ("F", 0.01, 0.3, "rest", {}),
    "bouncing_ball": ("Gamma", 1.1, 1.4, "simulate", {"Gamma": 1.2}),
    "damped_impact_oscillator": ("A", 0.1, 0.5, "simulate", {"A": 0.2}),
    "forced_chain": ("F", 0.4, 0.7, "simulate", {}),
    "forced_impact_damper": ("w", 0.95, 1.1, "simulate", {}),
    "impact_oscillator": ("s", -1.9, 0.1, "simulate", {"s": -0.5}),
    "impact_pair": ("A", 0.55, 0.8, "simulate", {"A": 0.6}),
    "oscillator_at_wall": ("A", 0.3, 1.0, "simulate", {}),
    "rattling_gear_pair": ("epsilon", 0.5, 0.8, "simulate", {}),
    "ueda_oscillator": ("B", 0.1, 0.5, "rest", {"B": 0.2}),
}
"""A response of each shipped scene with a harmonic load: parameter, range, start and other values."""

FAMILIES = [
    ("lee2009", "S11-", 0.07, 0.5), ("lee2009", "S13O00+", 0.2, 2.0), ("lee2009", "U2111-", 0.5, 2.0), ("impact_damper", "S11-", 0.1, 0.5),
    ("impact_damper", "S13+", 0.1, 1.0), ("cubic_nes", "S11+", 1e-3, 1e-2), ("cubic_and_stops", "S11-", 0.1, 1.0),
    ("duffing_pair", "S11-", 0.1, 1.0), ("duffing_pair", "mode:2", 0.1, 1.0), ("smooth_wall", "S11-", 0.05, 0.5),
    ("three_mass_chain", "mode:2", 0.3, 3.0), ("beam_on_cubic_spring", "mode:1", 1e-3, 1e-2), ("gear_pair", "mode:3", 0.05, 5.0),
]  # fmt: skip
"""Families of all shipped scenes without loads: the scene, the start, and the lowest and the highest energy."""

CHANGES = [Units(**{what: size}) for what in ("length", "time", "mass") for size in (1e-6, 1e6)]


def response_in_units(name, units, folder):
    """A response of a shipped scene, computed in other units; and the scene."""
    scaled = scaled_scene(name, units, folder)
    parameter, low, high, start, values = RESPONSES[name]
    new = {key: scaled.new(key, value) for key, value in values.items()}
    interval = scaled.new(parameter, low), scaled.new(parameter, high)
    branch, *_ = trace_response(scaled.scene.parametric, parameter, interval, start=start, values=new)
    return branch, scaled


def require_same_family(name, start, energies, units, folder):
    """A family in other units has the events that it has in those of the scene, and about as many points."""
    found = []
    for one in (Units(), units):
        scaled_scene(name, one, folder)
        unit, file = one.of("energy"), Path(folder) / "family.json"
        energy = ":".join(repr(h * unit) for h in energies)
        start_words = f"--from {start}" if ":" in start else start
        code, _, err = reported(f"continue {start_words} --scene {Path(folder) / name}.toml --energy {energy} --json {file}")
        assert code == 0, err
        branch = read_json(file)
        found.append((len(branch["points"]), sorted((e["h"] / unit, e["type"], e["alpha"] / one.time) for e in branch["events"])))
    assert abs(found[1][0] - found[0][0]) <= 0.1 * found[0][0] and len(found[0][1]) == len(found[1][1])
    for (h, code, alpha), (other_h, other, other_alpha) in zip(found[0][1], found[1][1], strict=True):
        assert code == other and (other_h, other_alpha) == pytest.approx((h, alpha), rel=1e-8)


def require_same_response(name, units, folder):
    """A response in other units has the events, the ends, the multipliers and the number of points that it has in those of the scene."""
    (plain, here), (other, there) = (response_in_units(name, one, folder) for one in (Units(), units))
    first, *_ = RESPONSES[name]
    expected = sorted((event.type, event.values[first]) for event in plain.events)
    found = sorted((event.type, there.old(first, event.values[first])) for event in other.events)
    assert expected and [code for code, _ in found] == [code for code, _ in expected]
    assert [value for _, value in found] == pytest.approx([value for _, value in expected], rel=1e-9)
    assert sorted(end.reason for end in other.ended) == sorted(end.reason for end in plain.ended)
    assert abs(len(other) - len(plain)) <= 3
    assert sorted((other.parameter[0], other.parameter[-1])) == pytest.approx(
        [there.new(first, value) for value in sorted((plain.parameter[0], plain.parameter[-1]))], rel=1e-9
    )
    assert other.largest_multiplier[other.start] == pytest.approx(plain.largest_multiplier[plain.start], rel=1e-8)
    if plain.speeds.size:
        assert other.speeds.max() / units.of("speed") == pytest.approx(plain.speeds.max(), rel=1e-2)
