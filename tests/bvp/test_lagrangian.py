"""Systems from their energies.

Oracles: the reference system written with its matrices (Lee et al., Physica D 238 (2009) 1868, Eq. 1); random quadratic forms,
whose matrices are known exactly; Lagrange's equations derived by sympy's own LagrangesMethod.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import saltus
from bvp.lagrangian import LagrangianError
from bvp.resting import has_constant_force
from bvp.system import ImpactSystem, InvalidSystem, vibro_impact_nes

KINETIC = "mu*u1_dot**2/2 + u2_dot**2/2"
POTENTIAL = "u2**2/2 + sigma*(u1 - u2)**2/2"
GAPS = [("u1 - u2", -1, 1, "rho")]


def reference(kinetic=KINETIC, potential=POTENTIAL, coordinates=("u1", "u2"), gaps=GAPS, **options):
    options.setdefault("parameters", {"mu": 0.1, "sigma": 0.1, "rho": 0.7, "lam": 0.01})
    return ImpactSystem.from_lagrangian(kinetic, potential, coordinates, gaps=gaps, **options)


def assert_equal(system, other):
    for key in ("mass", "damping", "stiffness"):
        np.testing.assert_array_equal(getattr(system, key), getattr(other, key))
    assert system.stops == other.stops and system.coordinates == other.coordinates


@given(st.floats(1e-3, 1e3), st.floats(0, 1e3), st.floats(0, 10), st.floats(0, 1))
@settings(max_examples=20, deadline=None)
def test_reference_system_from_text(mu, sigma, lam, rho):
    values = {"mu": mu, "sigma": sigma, "lam": lam, "rho": rho}
    system = reference(dissipation="lam*u2_dot**2/2", parameters=values, absorber="u1", primary="u2")
    other = vibro_impact_nes(**values)
    assert_equal(system, other)
    assert (system.absorber, system.primary) == (other.absorber, other.primary)


def test_reference_system_from_functions_of_time():
    from sympy.physics.mechanics import dynamicsymbols

    u1, u2 = dynamicsymbols("u1 u2")
    time = dynamicsymbols._t
    mu, sigma, rho = sympy.symbols("mu sigma rho", positive=True)
    kinetic = (mu * u1.diff(time) ** 2 + u2.diff(time) ** 2) / 2
    potential = (u2**2 + sigma * (u1 - u2) ** 2) / 2
    values = {mu: 0.1, sigma: 0.1, rho: 0.7}
    other = vibro_impact_nes(mu=0.1, sigma=0.1, rho=0.7)
    assert_equal(ImpactSystem.from_lagrangian(kinetic, potential, [u1, u2], gaps=[(u1 - u2, -1, 1, rho)], parameters=values), other)
    assert_equal(ImpactSystem.from_lagrangian(KINETIC, potential, [u1, u2], gaps=GAPS, parameters=values, time=time), other)
    assert_equal(ImpactSystem.from_lagrangian(kinetic, POTENTIAL, [u1, u2], gaps=GAPS, parameters=values), other)


def test_reference_system_from_symbols_with_given_velocities():
    u1, u2, v1, v2 = sympy.symbols("u1 u2 v1 v2", real=True)
    system = reference((v1**2 / 10 + v2**2) / 2, POTENTIAL, [u1, u2], velocities=[v1, "v2"])
    assert_equal(system, vibro_impact_nes(mu=0.1, sigma=0.1, rho=0.7))


RATIONAL = st.fractions(min_value=-9, max_value=9, max_denominator=16)


@st.composite
def systems(draw):
    n = draw(st.integers(1, 4))
    square = st.lists(st.lists(RATIONAL, min_size=n, max_size=n), min_size=n, max_size=n)
    forms = []
    for k in range(3):
        a = draw(square)
        form = [[a[i][j] + a[j][i] for j in range(n)] for i in range(n)]
        if k == 0:  # diagonally dominant: positive definite
            form = [[form[i][j] + (2 + sum(map(abs, form[i])) + abs(form[i][i])) * (i == j) for j in range(n)] for i in range(n)]
        forms.append(form)
    row = draw(st.lists(RATIONAL, min_size=n, max_size=n).filter(any))
    return n, forms, row, draw(RATIONAL), draw(st.fractions(0, 5, max_denominator=8).filter(bool))


def quadratic_text(matrix, names):
    return " + ".join(f"({matrix[i][j]})*{a}*{b}/2" for i, a in enumerate(names) for j, b in enumerate(names))


@given(systems())
@settings(max_examples=12, deadline=None)
def test_random_quadratic_forms_are_recovered_exactly(drawn):
    n, (mass, damping, stiffness), row, constant, half = drawn
    names = [f"x{k}" for k in range(n)]
    dots = [f"x{k}_dot" for k in range(n)]
    system = ImpactSystem.from_lagrangian(
        quadratic_text(mass, dots) + " + 3",
        f"({quadratic_text(stiffness, names)}) - 7/2",
        names,
        gaps=[(" + ".join(f"({c})*{x}" for c, x in zip(row, names, strict=True)) + f" + ({constant})", f"{-half}", str(half))],
        dissipation=quadratic_text(damping, dots),
    )
    for matrix, exact in ((system.mass, mass), (system.damping, damping), (system.stiffness, stiffness)):
        assert matrix.tolist() == [[float(x) for x in line] for line in exact]
    stop = system.stops[0]
    assert stop.gap == tuple(map(float, row)) and stop.restitution == 1.0
    assert (stop.lower, stop.upper) == (float(-half - constant), float(half - constant))


@given(systems())
@settings(max_examples=4, deadline=None)
def test_against_lagranges_equations_of_sympy(drawn):
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    n, (mass, _, stiffness), row, _, _ = drawn
    u = list(dynamicsymbols(f"u1:{n + 1}"))
    v = [item.diff() for item in u]
    # other coordinates of the same system
    shear = sympy.Matrix(n, n, lambda i, j: 1 if i == j else Fraction(i + 1, j + 2) if i < j else 0)
    old_u, old_v = shear * sympy.Matrix(u), shear * sympy.Matrix(v)
    kinetic = (old_v.T * sympy.Matrix(mass) * old_v)[0] / 2
    potential = (old_u.T * sympy.Matrix(stiffness) * old_u)[0] / 2
    method = LagrangesMethod(kinetic - potential, u)
    equations = method.form_lagranges_equations()
    system = ImpactSystem.from_lagrangian(kinetic, potential, u, gaps=[(u[0], None, 1)])
    expected_mass = equations.jacobian([item.diff() for item in v])
    expected_stiffness = equations.jacobian(u)
    np.testing.assert_array_equal(system.mass, np.array(expected_mass.tolist(), dtype=float))
    np.testing.assert_array_equal(system.stiffness, np.array(expected_stiffness.tolist(), dtype=float))


def test_one_sided_gaps_and_bounds_with_parameters():
    system = reference(
        gaps=[("u1 - u2 + d", None, "2*d"), (sympy.Symbol("u2"), -math.inf, 3), ("u2", "-e/2", sympy.oo, 0.5)],
        parameters={"mu": 0.1, "sigma": 0.1, "d": 0.25, "e": 4},
    )
    assert [(stop.lower, stop.upper, stop.restitution) for stop in system.stops] == [
        (-math.inf, 0.25, 1.0),
        (-math.inf, 3.0, 1.0),
        (-2.0, math.inf, 0.5),
    ]


def test_a_nonlinear_term_with_coefficient_zero_is_no_term():
    values = {"mu": 0.1, "sigma": 0.1, "rho": 1, "k3": 0, "a": 0.0, "n": 2}
    system = reference(potential="u2**n/2 + sigma*(u1 - u2)**2/2 + k3*u1**4/4 + a*cos(u1)", parameters=values)
    assert_equal(system, vibro_impact_nes(mu=0.1, sigma=0.1))


def test_irrational_coefficients():
    system = reference(
        potential="sqrt(2)*u2**2/2 + sigma*(u1-u2)**2/2 + exp(-a)*u1**2/2", parameters={"mu": 1, "sigma": 0, "rho": 1, "a": 1}
    )
    # The nearest floats. The exponential of the C library can be off by one unit in the last place.
    assert system.stiffness.tolist() == [[0.36787944117144233, 0.0], [0.0, math.sqrt(2)]]


def test_a_coordinate_may_have_a_functions_name():
    system = ImpactSystem.from_lagrangian("log_dot**2/2", "log**2*sqrt(4)", ["log"], gaps=[("log", -1, 1)])
    assert system.stiffness.tolist() == [[4.0]]


U1, U2, MU = sympy.symbols("u1 u2 mu")
QUARTIC = POTENTIAL + " + k3*(u1 - u2)**4/4 + 0.3*u1**2*u2**2 + mu*(1 - cos(u1))"


@pytest.mark.parametrize("gaps", [(), GAPS])
def test_a_potential_that_is_not_quadratic(gaps):
    """Oracle: sympy's gradient of the whole potential. The quadratic part, with that of the cosine, is in K."""
    values = {"mu": 0.1, "sigma": 0.25, "rho": 1.0, "k3": 0.7}
    system = reference(potential=QUARTIC, gaps=gaps, parameters=values)
    assert system.stiffness.tolist() == [[0.25 + 0.1, -0.25], [-0.25, 1.25]] and len(system.stops) == len(gaps)
    potential = sympy.sympify(QUARTIC).subs(values)
    gradient = sympy.lambdify([U1, U2], [potential.diff(U1), potential.diff(U2)])
    for u in np.array([[0.3, -0.8], [1.2, 0.5]]):
        found = u @ system.stiffness + system.smooth_forces.acting(u, 0 * u)
        np.testing.assert_allclose(found, gradient(*u), rtol=1e-14)
        assert system.energy(u, 0 * u) == pytest.approx(float(potential.subs(dict(zip((U1, U2), u.tolist(), strict=True)))), rel=1e-14)
    again = ImpactSystem.from_description(system.describe())
    assert again.describe() == system.describe() and again.has_odd_symmetry and again.is_conservative


def test_a_pendulum_from_functions_of_time():
    """Oracle: the frequency sqrt(g/l) and the torque of gravity."""
    from sympy.physics.mechanics import dynamicsymbols

    angle, time = dynamicsymbols("q"), dynamicsymbols._t
    length, gravity = sympy.symbols("l g", positive=True)
    kinetic, potential = length**2 * angle.diff(time) ** 2 / 2, gravity * length * (1 - sympy.cos(angle))
    system = ImpactSystem.from_lagrangian(kinetic, potential, [angle], parameters={length: 2, gravity: 9.81})
    assert system.modes.frequencies.tolist() == pytest.approx([math.sqrt(9.81 / 2)], rel=1e-15)
    u = np.array([2.0])
    assert system.stiffness @ u + system.smooth_forces.acting(u, 0 * u) == pytest.approx(19.62 * math.sin(2.0), rel=1e-14)


def test_a_symbol_that_no_text_can_have_is_refused():
    q = sympy.Symbol("q_{1}")
    with pytest.raises(LagrangianError, match="cannot be named in a potential that is not quadratic"):
        ImpactSystem.from_lagrangian(sympy.Symbol("v") ** 2, q**4, [q], velocities=[sympy.Symbol("v")])


REFUSED = [
    # nonlinear terms, by name
    ({"dissipation": "u1_dot**4"}, "the dissipation has the term u1_dot**4, which is not quadratic in the velocities"),
    ({"potential": "sigma/u1"}, "has the term sigma/u1, which is not smooth in 1/u1; expected a smooth potential and gaps"),
    ({"potential": POTENTIAL + " + mu*abs(u1)**3"}, "the term mu*Abs(u1)**3, which is not smooth in Abs(u1); expected a smooth"),
    ({"potential": sympy.Max(0, U1) ** 2}, "which is not smooth in Max(0, u1)"),
    ({"potential": "log(u1**2 + u2**2)*u2"}, "has the term u2*log(u1**2 + u2**2), whose force is not finite where all coordinates are 0"),
    ({"potential": POTENTIAL + " + u1*u1_dot"}, "the potential energy has the velocity u1_dot in the term u1*u1_dot"),
    ({"kinetic": KINETIC + " + u1**2*u1_dot**2"}, "the kinetic energy has the coordinate u1 in the term u1**2*u1_dot**2"),
    ({"kinetic": KINETIC + " + u1_dot"}, "the kinetic energy has the term u1_dot, which is not quadratic in the velocities"),
    ({"gaps": [("u1 - u2**2", -1, 1)]}, "gap 1 has the term -u2**2, which is not linear in the coordinates"),
    ({"gaps": [("mu", -1, 1)]}, "contains no coordinate"),
    # symbols without meaning
    ({"potential": "k*u2**2"}, "the potential energy has the symbol k, which is neither a coordinate nor a velocity"),
    ({"potential": "sigm*u2**2"}, "the nearest known is sigma"),
    ({"potential": "t*u2**2"}, "depends on the time t"),
    ({"potential": sympy.Function("f")(sympy.Symbol("t")) ** 2}, "has f(t), which is neither a coordinate nor a velocity"),
    ({"gaps": [("u1", -1, "gap")]}, "the upper bound of gap 1 has the symbol gap"),
    ({"gaps": [("u1", "u2", 1)]}, "the lower bound of gap 1 has the coordinate u2"),
    # numbers
    ({"parameters": {"mu": math.nan, "sigma": 1, "rho": 1}}, "parameter mu is a finite real number"),
    ({"parameters": {"mu": 1, "sigma": 1j, "rho": 1}}, "parameter sigma is a finite real number"),
    ({"potential": "u1**2/(mu - 1/10)", "parameters": {"mu": sympy.Rational(1, 10)}}, "is a finite real number"),
    ({"potential": "sqrt(-1)*u1**2"}, "not a finite real expression"),
    ({"potential": "u1**2/0"}, "not a finite real expression"),
    ({"gaps": [("u1", math.nan, 1)]}, "the lower bound of gap 1 is not a finite real expression"),
    # shapes
    ({"coordinates": "u1"}, "coordinates is a list"),
    ({"coordinates": []}, "coordinates is a list of at least one name or symbol; received none"),
    ({"coordinates": [1, 2]}, "coordinate 1 is neither a name nor a symbol"),
    ({"coordinates": ["u1", "u1"]}, "the name u1 is given twice"),
    ({"velocities": ["v1"]}, "velocities is a list of 2"),
    ({"gaps": "u1"}, "gaps is a list"),
    ({"gaps": ["u1 - u2"]}, "gap 1 is (expression, lower, upper)"),
    ({"kinetic": True}, "the kinetic energy is not an expression; received True"),
    ({"kinetic": None}, "the kinetic energy is neither an expression, text nor a number"),
    ({"parameters": {"mu": 10**400, "sigma": 1, "rho": 1}}, "parameter mu is a finite real number; received an integer of 1329 bits"),
    ({"potential": "(10**20)**20*u1**2"}, "of the potential energy is a finite real number; received 1000"),
    ({"potential": "u1*sin(" * 90 + "1" + ")" * 90}, "an expression of the system is nested too deeply to be read"),
    # text that is no arithmetic
    ({"potential": "u1**"}, 'the potential energy "u1**" cannot be read: not an expression'),
    ({"potential": "u1^2"}, "a power is written **"),
    ({"potential": "u1.__class__"}, "attributes such as .__class__ are not allowed"),
    ({"potential": "__import__('os').getcwd()"}, "cannot be read"),
    ({"potential": "__builtins__*u1**2"}, "the name __builtins__ is not allowed"),
    ({"potential": "eval('1')*u1**2"}, "the functions known"),
    ({"potential": "u1[0]"}, "only + - * / **"),
    ({"potential": "(lambda: 1)()"}, "cannot be read"),
    ({"potential": "'u1'"}, "is not a finite real number"),
    ({"potential": "1e999*u1**2"}, "is not a finite real number"),
    ({"potential": "u1**2 + 9**9**9"}, "a power is at most"),
    ({"potential": "(" * 500 + "u1" + ")" * 500}, "cannot be read"),
    ({"potential": "u1+" * 20_000 + "u1"}, "cannot be read: too long, or no text"),
    ({"potential": "sin*sin(1)*u1**2"}, "sin is a function, expected sin"),
    ({"potential": "\0"}, "cannot be read: not an expression at character 1"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_refusals(change, message):
    with pytest.raises(LagrangianError) as caught:
        reference(**change)
    assert message in str(caught.value) and "\n" not in str(caught.value)


TOO_LARGE = [
    "((((2**20)**20)**20)**20)*u1**2",
    "((1.5**20)**20)*(((3/2)**20)**20)**20*u1**2",
    "((u1+u2+1)**20)**20",
    "(u1+u2+1)**20*(u1-u2+1)**20",
    "((u1+u2+1)**20.0)**20.0",
    "exp(exp(20))*u1**2",
    "sin(exp(exp(20)))*u1**2",
    "sin(exp(exp(mu)))*u1**2",
    "(u1+u2)**lam",
    "u1**2*1.00001**lam",
    U1**2 * sympy.sin(sympy.exp(sympy.exp(20))),
    U1**2 * (U1 + U2 + MU) ** 400,
    U1**2 * sympy.Pow(7, 2000),
    U1**2 * sympy.Pow(sympy.Rational(1001, 1000), 1000),
]


@pytest.mark.parametrize("potential", TOO_LARGE)
def test_an_expression_on_which_sympy_could_spend_hours_is_refused(potential):
    """Oracle: by hand: bits of the powers, binomial coefficients, e^(e^20) = 10^(2.1e8)."""
    said = r"^the potential energy is too large, expected at most 20000 terms when multiplied out, and numbers .* of at most 4096 bits$"
    with pytest.raises(LagrangianError, match=said):
        reference(potential=potential, parameters={"mu": 20, "sigma": 1, "rho": 1, "lam": 10**6})


def test_a_large_energy_is_read():
    """Oracle: the stiffness of springs between all pairs of 12 masses."""
    names = [f"q{k}" for k in range(12)]
    springs = " + ".join(f"({a} - {b})**2/2" for k, a in enumerate(names) for b in names[:k])
    kinetic = " + ".join(f"{name}_dot**2/2" for name in names)
    system = reference(kinetic, springs, names, gaps=[("q0 - q1", -1, 1)], parameters={})
    np.testing.assert_array_equal(system.stiffness, 12.0 * np.eye(12) - 1.0)


@pytest.mark.parametrize("change", [{"kinetic": "u1_dot**2 - u2_dot**2"}, {"gaps": [("u1", 1, -1)]}, {"gaps": []}, {"primary": "u4"}])
def test_what_makes_no_system_is_refused_by_the_system(change):
    with pytest.raises(InvalidSystem):
        reference(**change)


def test_functions_of_two_times_are_refused():
    t, s = sympy.symbols("t s")
    u1, u2 = sympy.Function("u1"), sympy.Function("u2")
    with pytest.raises(LagrangianError, match="depend on s and t, expected one time"):
        reference(coordinates=[u1(t), u2(s)])
    with pytest.raises(LagrangianError, match="nor a function of time"):
        reference(coordinates=[u1(t, s), u2(t)])
    with pytest.raises(LagrangianError, match="neither a coordinate nor a velocity"):
        reference(kinetic=u1(t).diff(t, 2) ** 2, coordinates=[u1(t), u2(t)])


def test_linear_terms_can_balance_at_rest():
    """Oracle: exp(q) - q has no force at q = 0; with exp(q) alone there is one, a constant load. Terms that cancel leave none."""
    system = ImpactSystem.from_lagrangian("q_dot**2/2", "exp(q) - q", ["q"])
    assert system.stiffness.tolist() == [[1.0]] and not has_constant_force(system)
    loaded = ImpactSystem.from_lagrangian("q_dot**2/2", "exp(q) + q**2", ["q"])
    assert loaded.stiffness.tolist() == [[3.0]] and has_constant_force(loaded)
    plain = ImpactSystem.from_lagrangian("q_dot**2/2", "(q - 1)**2/2 + q", ["q"], gaps=[("q", -1, 1)])
    assert plain.stiffness.tolist() == [[1.0]] and plain.springs == ()


def test_a_linear_term_is_a_constant_load():
    """Oracle: the energy m g y at rest; y'' = -g from the motion, y = y0 - g t^2/2."""
    ball = ImpactSystem.from_lagrangian("m*y_dot**2/2", "m*g*y", ["y"], gaps=[("y", 0, None)], parameters={"m": 2.0, "g": 9.81})
    assert ball.energy([3.0], [0.0]) == pytest.approx(3.0 * 2.0 * 9.81, rel=1e-15) and ball.is_conservative
    motion = saltus.simulate(ball, [3.0], [0.0], 0.7)
    assert motion.final[0] == pytest.approx(3.0 - 9.81 * 0.7**2 / 2, rel=1e-14)
