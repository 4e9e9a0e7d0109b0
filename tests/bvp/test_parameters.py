"""Systems and loads as functions of parameters. Oracles: the same system made directly from numbers, complex steps of the formulas, and the
closed form of a load."""

import math

import numpy as np
import pytest
import sympy

from bvp.checks import InvalidSystem
from bvp.entries import base_frequency
from bvp.forcing import Constant, Harmonic, Record, forcing_of
from bvp.parameters import ParametricSystem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp import twins
from tests.lab.programs import run

STOP = {"c": [1.0, -1.0], "lower": "-d", "upper": "d*(1 + eps)", "restitution": "r"}
DESCRIPTION = {
    "parameters": {"m": 0.2, "k": "m*w0**2", "w0": 1.5, "c": 0.01, "d": 0.9, "eps": 0.1, "r": 0.7, "F": 0.3, "w": 1.1, "p": 0.4},
    "system": {
        "mass": [["m", 0.0], [0.0, 1.0]],
        "damping": [["c", "-c"], ["-c", "c + 0.02"]],
        "stiffness": [["k", "-k"], ["-k", "1 + k"]],
        "stops": [STOP, {"c": [0.0, 1.0], "upper": 5.0}],
        "coordinates": {"names": ["sink", "oscillator"], "absorber": "sink"},
    },
    "forces": [
        {"load": [0.0, 1.0], "amplitude": "F", "phase": "p", "harmonic": 1},
        {"load": ["m", 0.5], "amplitude": "F/2", "frequency": "3*w"},
        {"ground": [1.0, 1.0], "amplitude": 0.1, "phase": 0.2, "harmonic": 1},
        {"load": [1.0, 0.0], "constant": "-9.81*m"},
    ],
}


def by_hand(m, w0, c, d, eps, r, F, w, p):
    """The entries of DESCRIPTION by its formulas, also for complex numbers."""
    k = m * w0**2
    return np.array(
        [m, 0, 0, 1, c, -c, -c, c + 0.02, k, -k, -k, 1 + k]
        + [-d, -math.inf, d * (1 + eps), 5.0, r, 1.0]
        + [-9.81 * m, 0.0]
        + [-0.1 * math.cos(0.2) * m, F * np.cos(p) - 0.1 * math.cos(0.2), F / 2 * m, F / 4]
        + [0.1 * math.sin(0.2) * m, -F * np.sin(p) + 0.1 * math.sin(0.2), 0.0, 0.0]
        + [w]
    )  # fmt: skip


def test_entries_and_derivatives_are_those_of_the_formulas():
    """Oracle: the formulas in numpy; their complex steps, Im f(x + ih)/h."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    names = ("m", "w0", "c", "d", "eps", "r", "F", "w", "p")
    assert parametric.names == names and parametric.derived == {"k": "m*w0**2"}
    assert parametric.layout.harmonics == (1, 3) and parametric.layout.size == 29
    for changes in ({}, {"w": 0.37, "m": 2.0, "r": 0.0}):
        at = {**parametric.values, **changes}
        np.testing.assert_allclose(parametric.entries(changes), by_hand(**at), rtol=1e-15, atol=1e-16)  # a cosine of numpy can differ
        slopes = parametric.derivatives(changes, names)
        for j, name in enumerate(names):
            step = by_hand(**{**at, name: complex(at[name], 1e-150)}).imag / 1e-150
            np.testing.assert_allclose(slopes[:, j], step, rtol=1e-15, atol=1e-16)


def test_the_layout_places_what_the_system_and_the_loads_have():
    """Oracle: the matrices and stops of the system itself; the load at some times, by its own two-entry states."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    values = {"F": 0.8, "w": 1.7}
    system, forces, layout = parametric.system(values), parametric.forces(values), parametric.layout
    entries = parametric.entries(values)
    for name in ("mass", "damping", "stiffness"):
        np.testing.assert_allclose(entries[getattr(layout, name)].reshape(2, 2), getattr(system, name), rtol=3e-16)
    for name in ("lower", "upper", "restitution"):
        np.testing.assert_array_equal(entries[getattr(layout, name)], [getattr(stop, name) for stop in system.stops])
    (w,) = entries[layout.frequency]
    for time in (0.0, 0.9, 5.0):
        total = entries[layout.constant].copy()
        for k, cosine, sine in zip(layout.harmonics, entries[layout.cosine].reshape(2, 2), entries[layout.sine].reshape(2, 2), strict=True):
            total += cosine * math.cos(k * w * time) + sine * math.sin(k * w * time)
        np.testing.assert_allclose(total, twins.force_at(forcing_of(forces, 2), time), rtol=1e-14, atol=1e-15)


def test_the_system_is_the_one_made_directly():
    """Oracle: numbers in place of the expressions; coordinates and marks are kept."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    m, k, d = 0.2, 0.2 * 1.5**2, 0.9
    direct = ImpactSystem(
        [[m, 0.0], [0.0, 1.0]],
        [[0.01, -0.01], [-0.01, 0.03]],
        [[k, -k], [-k, 1.0 + k]],
        (Stop((1.0, -1.0), -d, d * 1.1, 0.7), Stop((0.0, 1.0), upper=5.0)),
        ("sink", "oscillator"),
        absorber=0,
    )
    assert parametric.system().describe() == direct.describe()
    assert ParametricSystem.from_description(parametric.describe()).system({"m": 3}).mass[0, 0] == 3.0


def test_coordinates_are_a_list_of_names_too():
    """Oracle: the same system whose names are in a table."""
    spring = {"on": "sink", "stiffness": 1.0, "power": "2*n + 1"}
    system = {key: value for key, value in DESCRIPTION["system"].items() if key != "coordinates"} | {"springs": [spring]}
    table = DESCRIPTION["parameters"] | {"n": 1.0}
    first, second = (
        ParametricSystem.from_description(DESCRIPTION | {"parameters": table, "system": {**system, "coordinates": names}})
        for names in (["sink", "oscillator"], {"names": ["sink", "oscillator"]})
    )
    assert first.system().describe() == second.system().describe()


def test_a_program_has_the_entries_that_depend_on_the_released_parameters():
    """Oracle: the formulas: F moves the loads of both harmonics; w0 moves the stiffness alone, by 2 m w0."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    at = np.array(list(parametric.values.values()))
    released = parametric.program(["F", "w0"])
    assert released.rows.tolist() == [8, 9, 10, 11, 21, 22, 23, 25] and released.columns.tolist() == [6, 1]
    out, known = run(released.program, at, released.scratch)
    assert known and len(out) == 24
    np.testing.assert_allclose(out[:8], parametric.entries()[released.rows], rtol=1e-15)  # without compiled code a sine can differ
    np.testing.assert_allclose(out[8:].reshape(8, 2)[:4], np.outer([1, -1, -1, 1], [0.0, 2 * 0.2 * 1.5]), rtol=1e-15)


@pytest.mark.parametrize("forces", [(), (Constant([1.0, 2.0]), Harmonic(1.3, [0.0, 0.3], [0.1, 0.0]))])
def test_parameters_of_a_model_and_the_frequency_of_loads_are_parameters_of_themselves(forces):
    """Oracle: the model and the loads made directly."""
    parametric = ParametricSystem.of(vibro_impact_nes(0.2, lam=0.02, rho=0.7), forces)
    assert dict(parametric.values) == {"mu": 0.2, "sigma": 0.1, "lam": 0.02, "rho": 0.7} | ({"w": 1.3} if forces else {})
    assert parametric.system({"rho": 0.5}).describe() == vibro_impact_nes(0.2, lam=0.02, rho=0.5).describe()
    assert [parametric.domain(name) for name in ("mu", "sigma", "rho")] == [(0, math.inf), (0, math.inf), (0, 1)]
    entries, layout = parametric.entries({"sigma": 0.4}), parametric.layout
    np.testing.assert_array_equal(entries[layout.stiffness], [0.4, -0.4, -0.4, 1.4])
    slopes = parametric.derivatives(None, ["mu", "sigma", "rho"])
    np.testing.assert_array_equal(slopes[layout.mass], [[1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(slopes[layout.stiffness, 1], [1, -1, -1, 1])
    np.testing.assert_array_equal(slopes[layout.restitution], [[0, 0, 1]])
    if forces:
        assert parametric.forces({"w": 2.0})[1].frequency == 2.0 and parametric.domain("w") == (0.0, math.inf)
        assert layout.harmonics == (1,) and entries[layout.frequency] == [1.3]
        np.testing.assert_array_equal(entries[layout.constant], [1.0, 2.0])
    else:
        assert layout.harmonics == () and entries[layout.frequency] == [0.0]


def test_domains_of_parameters_that_are_masses_restitutions_and_frequencies():
    """Oracle: what a system accepts; the message of what it does not."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    assert [parametric.domain(name) for name in ("m", "r", "w", "F")] == [(0, math.inf), (0, 1), (0, math.inf), (-math.inf, math.inf)]
    assert parametric.violation({"r": 1.0}) is None
    assert parametric.violation({"r": 1.2}) == "restitution lies in [0, 1]; a stop has 1.2 (at r = 1.2)"
    assert "mass must be positive definite; its diagonal entry 1 is -1 (at m = -1)" in parametric.violation({"m": -1})
    assert "frequency is a finite number above 0" in parametric.violation({"w": 0.0})
    assert "lower must be below upper" in parametric.violation({"eps": -2.5})


def test_what_is_semidefinite_only_together_is_found():
    """Oracle: det [[1, a], [a, 1]] = 1 - a^2."""
    system = {"mass": [[1.0, "a"], ["a", 1.0]], "stiffness": [[1.0, 0.0], [0.0, 1.0]], "stops": [{"c": [1.0, 0.0], "upper": 1.0}]}
    parametric = ParametricSystem.from_description({"parameters": {"a": 0.5}, "system": system})
    assert parametric.violation({"a": 0.99}) is None and "indefinite" in parametric.violation({"a": 1.01})


def test_loads_without_a_common_period_are_loads_all_the_same():
    """Oracle: the frequencies 1 and the golden ratio; a record. Only what needs a period refuses them."""
    forces = (Harmonic(1.0, [1.0, 0.0]), Harmonic((1 + 5**0.5) / 2, [0.0, 1.0]))
    parametric = ParametricSystem.of(vibro_impact_nes(), forces)
    assert [force.frequency for force in parametric.forces()] == [1.0, (1 + 5**0.5) / 2]
    with pytest.raises(ValueError, match="the load frequencies 1.0 and 1.618.* are incommensurate"):
        parametric.entries()
    parametric = ParametricSystem.of(vibro_impact_nes(), (Record([1.0, 0.0], [0.0, 1.0], [0.0, 2.0]),))
    assert parametric.forces()[0].values.tolist() == [0.0, 2.0]
    with pytest.raises(ValueError, match="a load is a record, which has no period"):
        parametric.layout  # noqa: B018


def test_base_frequencies():
    """Oracle: the greatest common divisor of fractions."""
    assert base_frequency([0.9, 1.5, 0.3]) == (pytest.approx(0.3, rel=1e-15), (3, 5, 1))
    assert base_frequency([2.0, 2.0]) == (2.0, (1, 1))
    assert base_frequency([1 / 3, 1 / 7]) == (pytest.approx(1 / 21, rel=1e-15), (7, 3))
    k, m = sympy.symbols("k m", real=True)
    assert base_frequency([sympy.sqrt(k / m), 3 * sympy.sqrt(k) / sympy.sqrt(m)])[1] == (1, 3)
    assert base_frequency([(k + m) ** 2, k**2 / 2 + k * m + m**2 / 2])[1] == (2, 1)
    with pytest.raises(ValueError, match="the load frequencies 1 and 1.001 are incommensurate: they would be the multiples 1000 and 1001"):
        base_frequency([1.0, 1.001])


def changed(part, key, value):
    """DESCRIPTION with one change."""
    return {**DESCRIPTION, part: {**DESCRIPTION[part], key: value}}


def stiff(first="k", across="-k"):
    """DESCRIPTION with other entries of the stiffness."""
    return changed("system", "stiffness", [[first, across], ["-k", "1 + k"]])


OF_MODEL = {"parameters": {}, "system": {"model": "vibro_impact_nes"}}
WRONG = [
    (changed("parameters", "unused", 1.0), "parameter unused is used nowhere"),
    (changed("parameters", "w0", "m*k"), "parameters depend on each other in a cycle: k -> w0 -> k"),
    (changed("parameters", "w0", "w1"), "parameter w0 has the name w1, which is no parameter; nearest: w"),
    (changed("parameters", "w0", math.inf), "parameter w0 is a finite number or an expression of others; received inf"),
    (changed("parameters", "w0", True), "parameter w0 is a finite number or an expression of others; received True"),
    (changed("parameters", "2k", 1.0), "parameter '2k' cannot be named in expressions"),
    (changed("parameters", "lambda", 1.0), "parameter 'lambda' cannot be named in expressions"),
    (changed("parameters", "__import__", 1.0), "parameter '__import__' cannot be named in expressions"),
    (changed("parameters", "sin", 1.0), "parameter sin would hide the function sin"),
    (changed("parameters", "quarter_period", 3.0), "parameter quarter_period would hide the quarter period of an orbit"),
    (changed("parameters", "pi", 3.0), "parameter pi would hide the number pi"),
    (stiff(across="-kk"), "entry 2 of row 1 of stiffness has the name kk, which is no parameter; nearest: k"),
    (stiff(across="-m"), "stiffness must be symmetric"),
    (stiff("k +"), 'entry 1 of row 1 of stiffness "k +" cannot be read: not an expression'),
    (stiff("k.real"), "attributes such as .real are not allowed"),
    (stiff("log(m - 0.2)"), "entry 1 of row 1 of stiffness is log(m - 0.2), which has no finite value (at m"),
    (stiff("sqrt(-1)*k"), "entry 1 of row 1 of stiffness is not a finite real expression; received 'sqrt(-1)*k'"),
    (stiff("k/(m - m)"), "entry 1 of row 1 of stiffness is not a finite real expression"),
    (stiff("k**(9**9)"), "a power is at most 20"),
    (changed("system", "stops", [{**STOP, "restitution": "r + 1"}]), "restitution lies in [0, 1]; a stop has 1.7 (at m = 0.2, w0 = 1.5"),
    ({**DESCRIPTION, "forces": [{"load": [1.0, "phi"], "constant": 1.0}]}, "entry 2 of load of force 1 has the name phi"),
    ({**OF_MODEL, "forces": [{"load": [1, 0], "harmonic": 2}]}, "harmonic = 2 is a multiple of the"),
    ({**OF_MODEL, "parameters": {"mu": 1.0}}, "mu is a parameter of the model vibro_impact_nes itself"),
]  # fmt: skip


@pytest.mark.parametrize(("description", "words"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_a_wrong_description_is_refused_in_one_line(description, words):
    """Oracle: the change that was made to a description that can be read."""
    with pytest.raises(ValueError) as caught:
        ParametricSystem.from_description(description)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_wrong_values_and_names_are_refused():
    """Oracle: the names of DESCRIPTION."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    for call, words in (
        (lambda: parametric.system({"omega": 1.0}), "unknown parameter 'omega'; known: m, w0"),
        (lambda: parametric.system({"epss": 1.0}), "unknown parameter 'epss'; nearest: eps"),
        (lambda: parametric.system({"k": 1.0}), "parameter k is the expression m*w0**2; expected one of m, w0"),
        (lambda: parametric.entries({"w": math.nan}), "parameter w is a finite number; received nan"),
        (lambda: parametric.derivatives(None, ["mm"]), "unknown parameter 'mm'; nearest: m"),
        (lambda: parametric.domain("rr"), "unknown parameter 'rr'; nearest: r"),
    ):
        with pytest.raises(InvalidSystem) as caught:
            call()
        assert words in str(caught.value)


def test_a_matrix_that_is_symmetric_at_one_value_only_is_refused_where_it_is_differentiated():
    """Oracle: a = b at the defaults, and not elsewhere."""
    system = {"mass": [[1.0, 0.0], [0.0, 1.0]], "stiffness": [[1.0, "a"], ["b", 1.0]], "stops": [{"c": [1.0, 0.0], "upper": 1.0}]}
    parametric = ParametricSystem.from_description({"parameters": {"a": 0.5, "b": 0.5}, "system": system})
    with pytest.raises(InvalidSystem, match=r"stiffness must be symmetric; entry \(1, 2\) is a and \(2, 1\) is b"):
        parametric.layout  # noqa: B018


@pytest.mark.parametrize(
    ("here", "there"),
    [
        ("m*0.1234567890123457", "m*0.1234567890123456"),
        ("0.1 + 0.01*sin(m*0.1234567890123457)", "0.1 + 0.01*sin(m*0.1234567890123456)"),
        ("0.1*m/3", "m/30.000000000000004"),
    ],
)
def test_expressions_that_differ_by_rounding_are_symmetric(here, there):
    """Oracle: the same system with one of both expressions twice; its derivative, too."""
    system = {"stiffness": [[1.0, 0.1], [0.1, 1.0]], "stops": [{"c": [1.0, 0.0], "upper": 1.0}]}
    made = [
        ParametricSystem.from_description({"parameters": {"m": 1.0}, "system": {**system, "mass": [["m", here], [other, 1.0]]}})
        for other in (here, there)
    ]
    assert np.allclose(made[0].system().mass, made[1].system().mass, rtol=1e-15, atol=0.0)
    assert np.allclose(made[0].derivatives(None, ["m"])[0], made[1].derivatives(None, ["m"])[0], rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("there", ["0.1*m*1.0000000001", "0.1*m**1.0000001"])
def test_expressions_that_differ_by_more_are_not(there):
    """Oracle: the difference is above 64 roundings where m is not 1."""
    system = {"mass": [["m", "0.1*m"], [there, 1.0]], "stiffness": [[1.0, 0.0], [0.0, 1.0]], "stops": [{"c": [1.0, 0.0], "upper": 1.0}]}
    with pytest.raises(InvalidSystem, match="mass must be symmetric"):
        ParametricSystem.from_description({"parameters": {"m": 1.0}, "system": system}).layout  # noqa: B018
