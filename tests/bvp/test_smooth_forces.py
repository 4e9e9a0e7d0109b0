"""Springs, dampers and their smooth forces. Oracles: the forces' formulas, complex steps of the potential, definitions, round trips."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import sympy

from bvp.checks import require_system
from bvp.closures import ORIGIN, EndsError, parse_end
from bvp.jet_programs import plain_powers
from bvp.parameters import ParametricSystem
from bvp.smooth_forces import smooth_forces
from bvp.springs import Damper, Spring, element_from
from bvp.system import ImpactSystem, InvalidSystem, Stop
from tests.lab.programs import run, taylor

NAMES = ["x", "y"]
BETWEEN, ON = (1.0, -1.0), (0.0, 1.0)
MASS, DAMPING, STIFFNESS = np.diag([0.5, 2.0]), np.array([[0.1, 0.0], [0.0, 0.2]]), np.array([[3.0, -1.0], [-1.0, 2.0]])
U = np.array([[0.3, -0.9], [1.3, 0.4], [-0.2, 0.7]])
V = np.array([[0.5, 0.1], [-0.4, 1.1], [0.8, -0.6]])


def system(springs=(), dampers=(), stops=()):
    return ImpactSystem(MASS, DAMPING, STIFFNESS, stops, tuple(NAMES), springs=tuple(springs), dampers=tuple(dampers))


def total(found, u, v):
    """The forces on the coordinates, without inertia."""
    linear = u @ found.stiffness + v @ found.damping.T
    return linear if found.smooth_forces is None else linear + found.smooth_forces.acting(u, v)


SPRINGS = [
    (Spring(BETWEEN, stiffness=2.0, power=3), lambda w: 2.0 * w**3, 0.0, True),
    (Spring(BETWEEN, stiffness=2.0, power=2), lambda w: 2.0 * w * np.abs(w), 0.0, True),
    (Spring(BETWEEN, stiffness=0.7, power=3.6), lambda w: 0.7 * np.sign(w) * np.abs(w) ** 3.6, 0.0, True),
    (Spring(BETWEEN, stiffness=0.7), lambda w: 0.7 * w, 0.7, True),
    (Spring(BETWEEN, polynomial=(0.5, 0.0, 4.0)), lambda w: 0.5 * w + 4.0 * w**3, 0.5, True),
    (Spring(BETWEEN, polynomial=(0.5, 0.2)), lambda w: 0.5 * w + 0.2 * w**2, 0.5, False),
    (Spring(BETWEEN, potential="k*(1 - cos(w))", parameters={"k": 3.0}), lambda w: 3.0 * np.sin(w), 3.0, True),
    (Spring(BETWEEN, potential="sqrt(1 + w**2) + w**42/42"), lambda w: w / np.sqrt(1.0 + w**2) + w**41, 1.0, True),
    (Spring(BETWEEN, potential="exp(w) - w"), lambda w: np.exp(w) - 1.0, 1.0, False),
    (Spring(BETWEEN, force="2*w + w**3 - w**2"), lambda w: 2.0 * w + w**3 - w**2, 2.0, False),
    (Spring(BETWEEN, potential="w**(2*n)/n", parameters={"n": 5.0}), lambda w: 2.0 * w**9, 0.0, True),
]


@pytest.mark.parametrize(("spring", "law", "slope", "odd"), SPRINGS)
def test_a_spring_adds_its_force(spring, law, slope, odd):
    """Oracle: the law's formula along the row; the linear part in K, and no stops."""
    found = system([spring])
    row = np.array(BETWEEN)
    exact = U @ STIFFNESS + V @ DAMPING.T + law(U @ row)[:, None] * row
    np.testing.assert_allclose(total(found, U, V), exact, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(found.stiffness, STIFFNESS + slope * np.outer(row, row), rtol=1e-15)
    assert found.has_odd_symmetry is odd and found.underlying.is_conservative
    assert found.modes.contacts.gap.shape == (0, 4) and len(found.modes.contact_stop) == 0


@pytest.mark.parametrize(("spring", "law", "slope", "odd"), SPRINGS)
def test_the_energy_is_that_of_the_spring(spring, law, slope, odd):
    """Oracle: the work of the law by Gauss quadrature; on the way to it, both the fast evaluation and the program of the potential."""
    found = system([spring])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    for u, v in zip(U, V, strict=True):
        w = float(np.dot(BETWEEN, u))
        work = 0.5 * w * float(weights @ law(0.5 * w * (nodes + 1.0)))
        exact = 0.5 * (v @ MASS @ v + u @ STIFFNESS @ u) + work
        assert abs(found.energy(u, v) - exact) <= 1e-6 * abs(work) if spring.power in (2, 3.6) else 1e-13 * exact
        if found.smooth_forces is not None:
            out, known = run(found.smooth_forces.energy_program(), found.smooth_forces.inputs[:, :2] @ u)
            assert known and out[0] == pytest.approx(found.smooth_forces.energy(u), rel=1e-14, abs=1e-16)


def test_energies_of_many_states_are_those_of_each():
    found = system([SPRINGS[0][0], SPRINGS[6][0]])
    each = [found.energy(u, v) for u, v in zip(U, V, strict=True)]
    np.testing.assert_allclose(found.energy(U, V), each, rtol=1e-14)  # sums in other orders


DAMPERS = [
    (Damper(BETWEEN, damping=2.0, power=3), lambda w, r: 2.0 * r**3, 0.0, True),
    (Damper(BETWEEN, damping=2.0, power=1.5), lambda w, r: 2.0 * np.sign(r) * np.abs(r) ** 1.5, 0.0, True),
    (Damper(BETWEEN, polynomial=(0.3, 0.1)), lambda w, r: 0.3 * r + 0.1 * r**2, 0.3, False),
    (Damper(BETWEEN, force="c*(w**2 - 1)*w_dot", parameters={"c": 0.5}), lambda w, r: 0.5 * (w**2 - 1.0) * r, -0.5, True),
    (Damper(BETWEEN, damping=0.4), lambda w, r: 0.4 * r, 0.4, True),
]


@pytest.mark.parametrize(("damper", "law", "slope", "odd"), DAMPERS)
def test_a_damper_adds_its_force(damper, law, slope, odd):
    """Oracle: the law's formula; the linear part in C."""
    found = system(dampers=[damper], stops=(Stop((1.0, 0.0), -1.0, 1.0),))
    row = np.array(BETWEEN)
    exact = U @ STIFFNESS + V @ DAMPING.T + law(U @ row, V @ row)[:, None] * row
    np.testing.assert_allclose(total(found, U, V), exact, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(found.damping, DAMPING + slope * np.outer(row, row), rtol=1e-15)
    assert found.has_odd_symmetry is odd and found.underlying.is_conservative and found.underlying.smooth_forces is None


def test_a_nonlinear_damper_is_named():
    found = ImpactSystem(MASS, 0 * MASS, STIFFNESS, (Stop((1.0, 0.0), -1.0, 1.0),), dampers=(Damper(BETWEEN, damping=1.0, power=3),))
    assert found.why_not_conservative() == "the damper between u1 and u2 loses energy"


def test_a_potential_of_several_coordinates():
    """Oracle: sympy's gradient of the whole potential, in which nothing was split."""
    text = "1 - cos(x - y) + k*x**4/4 + (x - y)**4 + x**2*y**2 + x*y"
    found = system([Spring(potential=text, parameters={"k": 2.0})])
    x, y = sympy.symbols("x y")
    potential = sympy.sympify(text).subs("k", 2)
    gradient = sympy.lambdify([x, y], [potential.diff(x), potential.diff(y)])
    for u in U:
        exact = STIFFNESS @ u + gradient(*u)
        np.testing.assert_allclose(total(found, u, 0 * u), exact, rtol=1e-13)
        energy = 0.5 * u @ STIFFNESS @ u + float(potential.subs({x: float(u[0]), y: float(u[1])}))
        assert abs(found.energy(u, 0 * u) - energy) < 1e-13 * abs(energy)
    assert found.stiffness.tolist() == (STIFFNESS + [[1.0, 0.0], [0.0, 1.0]]).tolist()
    # Terms of x - y, and of x, are forces along one row.
    assert found.smooth_forces.directions.tolist() == [[1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]


def test_a_potential_of_a_difference_is_a_spring_between_two_coordinates():
    """Oracle: the spring."""
    text, other = system([Spring(potential="k*(x - y)**4/4", parameters={"k": 2.0})]), system([SPRINGS[0][0]])
    for key in ("inputs", "directions"):
        assert np.array_equal(getattr(text.smooth_forces, key), getattr(other.smooth_forces, key))
    np.testing.assert_array_equal(text.smooth_forces.acting(U, V), other.smooth_forces.acting(U, V))


def test_linear_terms_balance_others_at_rest():
    """Oracle: sympy's gradient; exp(x + y) has the slope 1 along x and y."""
    found = system([Spring(potential="exp(x + y) - x - y + (2*x - y)**4")])
    x, y = U[1]
    slope, cubic = np.exp(x + y) - 1.0, 4.0 * (2.0 * x - y) ** 3
    np.testing.assert_allclose(total(found, U[1], 0 * U[1]), STIFFNESS @ U[1] + [slope + 2.0 * cubic, slope - cubic], rtol=1e-14)


def test_forces_on_coordinates_that_have_a_potential_together():
    """Oracle: x y^3 + x^2 y/2 + x y has these derivatives."""
    found = system([Spring((1.0, 0.0), force="y**3 + x*y + y"), Spring(ON, force="3*x*y**2 + x**2/2 + x")])
    assert found.stiffness.tolist() == (STIFFNESS + [[0.0, 1.0], [1.0, 0.0]]).tolist()
    x, y = U[0]
    exact = 0.5 * U[0] @ STIFFNESS @ U[0] + x * y**3 + x**2 * y / 2 + x * y
    assert found.energy(U[0], [0.0, 0.0]) == pytest.approx(exact, rel=1e-14) and found.why_not_conservative() is not None
    assert found.underlying.is_conservative


def test_forces_without_a_potential_name_the_coordinates():
    """Oracle: d(y^3)/dy = 3 y^2 is not 0. The forces act all the same."""
    found = system([Spring((1.0, 0.0), force="y**3 + 2*y")])
    expected = "the springs have no potential: the force on x changes with y unlike that on y with x"
    assert found.underlying.why_not_conservative() == expected
    exact = U @ STIFFNESS + V @ DAMPING.T + np.outer(U[:, 1] ** 3 + 2.0 * U[:, 1], [1.0, 0.0])
    np.testing.assert_allclose(total(found, U, V), exact, rtol=1e-14)
    # K is symmetric; what is left acts on both coordinates.
    assert np.array_equal(found.stiffness, found.stiffness.T)
    with pytest.raises(InvalidSystem, match="unlike that on y"):
        found.smooth_forces.energy(U)


def test_a_force_whose_potential_is_not_known_says_so():
    found = ImpactSystem(MASS, 0 * MASS, STIFFNESS, (), springs=(Spring(ON, force="sin(w)**3"),))
    expected = "the potential of the spring on u2 is not known; expected potential = .. in place of force = .."
    assert found.why_not_conservative() == expected


@pytest.mark.parametrize("elements", [[SPRINGS[k][0] for k in (0, 2, 4)], [SPRINGS[6][0], Spring(potential="x**2*y**2 + x**2")]])
def test_a_description_survives_json_and_gives_the_same_system(elements):
    """Oracle: the same matrices, to the bit, and forces; a change elsewhere does not add the linear parts again."""
    from dataclasses import replace

    found = system(elements, [DAMPERS[2][0], DAMPERS[3][0]])
    described = json.loads(json.dumps(found.describe()))
    other = ImpactSystem.from_description(described)
    for again in (other, replace(found, absorber=0), pickle.loads(pickle.dumps(found))):
        assert np.array_equal(again.stiffness, found.stiffness) and np.array_equal(again.damping, found.damping)
        np.testing.assert_array_equal(again.smooth_forces.acting(U, V), found.smooth_forces.acting(U, V))
    assert other.describe() == found.describe() == described


def test_a_system_without_springs_is_described_as_before():
    assert set(system(stops=(Stop((1.0, 0.0), -1.0, 1.0),)).describe()) == {"mass", "damping", "stiffness", "stops", "coordinates"}
    assert system(stops=(Stop((1.0, 0.0), -1.0, 1.0),)).smooth_forces is None


def test_push_and_program_are_those_of_the_forces():
    """Oracle: M^-1 applied to the forces; their values in the first coefficients of the jets."""
    found = system([SPRINGS[0][0], SPRINGS[2][0], Spring(ON, stiffness=1.5, power=5)], [DAMPERS[3][0]])
    smooth = found.smooth_forces
    program = smooth.program()
    for u, v in zip(U, V, strict=True):
        jets = taylor(program, (smooth.inputs @ [*u, *v])[:, None], 0)
        exact = -np.linalg.solve(MASS, smooth.acting(u, v))
        np.testing.assert_allclose(smooth.push(MASS) @ jets[program.forces, 0], exact, rtol=1e-14)


def test_springs_along_one_row_share_their_input():
    found = smooth_forces([SPRINGS[0][0], SPRINGS[4][0], SPRINGS[6][0]], [], NAMES)
    assert found.inputs.tolist() == [[1.0, -1.0, 0.0, 0.0]] and len(found.forces) == 1


def test_released_parameters_stay_symbols():
    """Oracle: the derivative of k |w|^p sign w by k and p."""
    k, p = sympy.symbols("k p", real=True)
    springs = [Spring(BETWEEN, stiffness=k, power=p), Spring(BETWEEN, potential="c*w**4/4", parameters={"c": 2 * k})]
    found = replace(smooth_forces(springs, [], NAMES), parameters=(k, p), numbers=(2.0, 3.5))
    program, _ = found.released_program()
    assert program.changes[:, :2].tolist() == [[0, 0], [0, 1]]
    w = found.symbols[0]
    assert sympy.expand(plain_powers(found.forces[0]) - k * sympy.sign(w) * sympy.Abs(w) ** p - 2 * k * w**3) == 0


REFUSED = [
    (lambda: Spring(BETWEEN, stiffness=1.0, power=0.5), "the power of the spring between u1 and u2 is from 1 to 10000; received 0.5"),
    (lambda: Spring(BETWEEN), "the spring between u1 and u2 has one of stiffness, polynomial, potential, force; received none"),
    (lambda: Spring(ON, stiffness=1.0, potential="w**2"), "potential, force; received stiffness and potential"),
    (lambda: Spring(stiffness=1.0), "a spring with stiffness acts between two coordinates or on one; received neither"),
    (lambda: Spring((0.0, 0.0), stiffness=1.0), "the row of a spring is zero: no coordinate moves along it"),
    (lambda: Spring(ON, stiffness=math.nan), "stiffness of the spring on u2 is a number; received NaN"),
    (lambda: Spring(ON, stiffness=math.inf), "stiffness of the spring on u2 is finite; received inf"),
    (lambda: Spring(ON, polynomial=(1.0,), power=3), "the power of the spring on u2 goes with stiffness; received polynomial"),
    (lambda: Spring(ON, polynomial=(1.0,) * 65), "has at most 64 coefficients, of w, w^2, ..; received 65"),
    (lambda: Spring(ON, potential=3.0), "the potential of the spring on u2 is a text; received 3.0"),
    (lambda: Damper(ON, damping=1.0, power=0.9), "the power of the damper on u2 is from 1 to 10000; received 0.9"),
    (lambda: Damper(ON), "the damper on u2 has one of damping, polynomial, force; received none"),
    (lambda: system([Spring((1.0,), stiffness=1.0)]), "the row of the spring on x has 1 entries; the system has 2 coordinates"),
    (lambda: system([Damper(ON, damping=1.0)]), "springs is a list of Spring; received"),
    (lambda: system(), "stops is a list of at least one Stop, springs of at least one Spring, or dampers of at least one Damper"),
    (
        lambda: system([Spring(BETWEEN, potential="abs(w)**3")]),
        "the potential of the spring between x and y is not smooth, in abs(..); expected smooth functions: a contact is a table [[stops]], "
        "k |w|^p sign w has power = p",
    ),
    (lambda: system([Spring(ON, force="w + sign(w)")]), "the force of the spring on y is not smooth, in sign(..)"),
    (lambda: system([Spring(ON, potential="Max(w, 0)**3")]), "is not smooth, in Max(..)"),
    (lambda: system([Spring(ON, potential="sqrt(w**2)*w**4")]), "is not smooth, in"),
    (lambda: system([Spring(ON, potential="w**2.5")]), "the potential of the spring on y is not smooth, in w**(5/2)"),
    (lambda: system([Spring(ON, potential="log(w)*w**4")]), "is not finite at rest, where all coordinates are 0"),
    (lambda: system([], [Damper(ON, force="1 + w_dot")]), "is 1 at rest, expected 0: a constant load is a table [[forces]]"),
    (
        lambda: system([Spring(ON, potential="stifness*w**4", parameters={"stiffness": 1.0})]),
        "the potential of the spring on y has the symbol stifness, which is neither w nor a parameter; nearest: stiffness",
    ),
    (
        lambda: system([Spring(potential="x**4 + yy**4")]),
        "the potential of the spring of all coordinates has the symbol yy, which is neither a coordinate nor a parameter; nearest: y",
    ),
    (lambda: system([Spring(ON, potential="erf(w)")]), "the functions known, of one argument, are sqrt, exp"),
    (lambda: system([Spring(ON, potential="w.real")]), "attributes such as .real are not allowed"),
    (lambda: system(SPRINGS[0][:1], [Damper(ON, force="w**3 + w_dot")]), "the force of the damper on y is not 0 without speed"),
    (lambda: element_from(Spring, {"on": "xx", "stiffness": 1.0}, NAMES), "a spring acts on 'xx', which is no coordinate; nearest: x"),
    (lambda: element_from(Spring, {"between": ["x"], "stiffness": 1.0}, NAMES), "between of a spring is two coordinates; received ['x']"),
    (lambda: element_from(Spring, {"on": "x", "c": [1.0, 0.0]}, NAMES), "on one, or along a row c; received on and c"),
    (lambda: element_from(Spring, {"on": "x", "stifness": 1.0}, NAMES), "unknown key 'stifness' in a spring; nearest known: stiffness"),
    (lambda: element_from(Damper, 3, NAMES), "a damper is a table of keys and values; received 3"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_what_cannot_be_is_refused_in_one_line(make, words):
    with pytest.raises(InvalidSystem) as error:
        make()
    assert words in str(error.value) and "\n" not in str(error.value) and "@" not in str(error.value)


DESCRIPTION = {
    "parameters": {"n": 10.0, "sigma": 0.1, "k": "2*sigma", "c": 0.3},
    "system": {
        "mass": [[0.1, 0.0], [0.0, 1.0]],
        "stiffness": [["sigma", "-sigma"], ["-sigma", "1 + sigma"]],
        "springs": [{"between": ["u1", "u2"], "stiffness": 1.0, "power": "2*n + 1"}, {"on": "u2", "potential": "k*w**2/2 + c*w**4"}],
        "dampers": [{"on": "u2", "polynomial": ["c", 0.0, "c/2"]}],
    },
}


def test_springs_with_parameters():
    """Oracles: the formulas of the matrices and their derivatives; the forces at the values."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    found, layout = parametric.system(), parametric.layout
    assert parametric.entries()[layout.stiffness].tolist() == found.stiffness.ravel().tolist() == [0.1, -0.1, -0.1, 1.1 + 0.2]
    assert parametric.entries()[layout.damping].tolist() == found.damping.ravel().tolist() == [0.0, 0.0, 0.0, 0.3]
    assert parametric.derivatives(None, ["sigma"])[layout.stiffness].ravel().tolist() == [1.0, -1.0, -1.0, 3.0]
    assert parametric.derivatives(None, ["c"])[layout.damping].ravel().tolist() == [0.0, 0.0, 0.0, 1.0]
    w, y, r = U[0] @ [1.0, -1.0], U[0][1], V[0][1]
    for n in (10.0, 2.0, 1.75):
        exact = np.sign(w) * abs(w) ** (2.0 * n + 1.0) * np.array([1.0, -1.0]) + [0.0, 1.2 * y**3 + 0.15 * r**3]
        np.testing.assert_allclose(parametric.system({"n": n}).smooth_forces.acting(U[0], V[0]), exact, rtol=1e-14)
    assert parametric.replaced({"n": 2.0}).system().describe() == parametric.system({"n": 2.0}).describe()
    assert "power of the spring between u1 and u2 is from 1 to 10000; received 0.2 (at n = -0.4)" in str(parametric.violation({"n": -0.4}))


def test_released_parameters_of_a_description():
    """Oracle: central differences of the forces at values on both sides."""
    parametric = ParametricSystem.from_description(DESCRIPTION)
    smooth = parametric.smooth_forces({"n": 1.6}, ["n", "c"])
    program, _ = smooth.released_program()
    jets = taylor(program, (smooth.inputs @ [*U[0], *V[0]])[:, None], 0)
    for column, (name, value) in enumerate((("n", 1.6), ("c", 0.3))):
        slope = np.zeros(len(program.forces))
        for row, other, register in program.changes:
            slope[row] += jets[register, 0] if other == column else 0.0
        near = [parametric.system({"n": 1.6, name: value + h}).smooth_forces.acting(U[0], V[0]) for h in (1e-5, -1e-5)]
        np.testing.assert_allclose(slope @ smooth.directions, (near[0] - near[1]) / 2e-5, rtol=1e-8, atol=1e-11)


def test_a_parameter_that_no_spring_has_is_refused():
    other = DESCRIPTION | {"parameters": DESCRIPTION["parameters"] | {"q": 1.0}}
    with pytest.raises(InvalidSystem, match="parameter q is used nowhere"):
        ParametricSystem.from_description(other)


def test_an_origin_end_needs_odd_springs():
    """Oracle: w^2 is even. A spring that is odd leaves the end."""
    expected = r"an origin end needs odd symmetry \(.*\); this system has a spring or damper on x and y whose force is not odd;"
    with pytest.raises(EndsError, match=expected):
        parse_end(system([SPRINGS[5][0]]), "origin")
    assert parse_end(system([SPRINGS[0][0]]), "origin") == (ORIGIN, -1)


def test_families_need_a_potential():
    """Oracle: d(y^3)/dy is not 0, and no other force has it."""
    found = ImpactSystem(MASS, 0 * MASS, STIFFNESS, (), tuple(NAMES), springs=(Spring((1.0, 0.0), force="y**3"),))
    expected = "^families need a conservative system: the springs have no potential: the force on x changes with y unlike that on y with x$"
    with pytest.raises(ValueError, match=expected):
        require_system(found, conservative="families", smooth=True)


def test_an_expression_that_is_linear_is_no_smooth_force():
    """Oracle: its second derivative."""
    found = system([Spring(BETWEEN, potential="k*w**2/2", parameters={"k": 0.5})])
    assert found.smooth_forces is None and found.why_not_linear() is None
    assert found.stiffness.tolist() == (STIFFNESS + 0.5 * np.outer(BETWEEN, BETWEEN)).tolist()
    assert system([SPRINGS[6][0]]).why_not_linear() == "the spring between x and y is not linear"


def test_computations_with_linear_flights_refuse_springs_that_are_not_linear():
    expected = "the spring between x and y is not linear, and this computation has linear flights only; expected linear springs"
    with pytest.raises(ValueError, match=expected):
        require_system(system([SPRINGS[0][0]]))
    require_system(system([SPRINGS[3][0]], stops=(Stop(ON, -1.0, 1.0),)))
