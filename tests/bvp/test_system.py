"""ImpactSystem and Stop: what is refused and in which words; energy, symmetry and description. Oracles: definitions, round
trips."""

import json
import math

import numpy as np
import pytest

from bvp.system import ImpactSystem, InvalidSystem, Stop, vibro_impact_nes

EYE = np.eye(2)
ZERO = np.zeros((2, 2))
STOP = Stop((1.0, -1.0), -1.0, 1.0)


MATRICES = [
    ({"mass": [[1.0, 0.1], [0.2, 1.0]]}, r"mass must be symmetric; entry \(1, 2\) is 0.1 and \(2, 1\) is 0.2"),
    ({"mass": [[1.0, 0.1], [0.1 + 1e-12, 1.0]]}, r"symmetric; entry \(1, 2\) is 0.1 and \(2, 1\) is 0.100000000001"),
    ({"mass": [[1.0, 2.0], [2.0, 1.0]]}, "mass must be positive definite; scaled to a unit diagonal it is indefinite"),
    ({"mass": [[1.0, 1.0], [1.0, 1.0]]}, "mass must be positive definite; scaled to a unit diagonal it is singular"),
    ({"mass": [[1.0, 0.0], [0.0, -1.0]]}, "mass must be positive definite; its diagonal entry 2 is -1"),
    ({"mass": [[math.nan, 0.0], [0.0, 1.0]]}, r"mass holds finite numbers; entry \(1, 1\) is nan"),
    ({"damping": np.zeros((3, 3))}, "damping is 2 by 2 like mass; received 3 by 3"),
    ({"mass": [1.0, 2.0]}, "mass is a square matrix"),
    ({"stops": (Stop((1.0,), 0.0, 1.0),)}, "gap row of stop a has 1 entries; the system has 2 coordinates"),
    ({"stops": ()}, "at least one Stop"),
    ({"stops": (Stop((1.0, 0.0), 0.0, 1.0),) * 27}, "at most 26 stops can be named a to z; received 27"),
    ({"stops": (Stop((1.0, 0.0), 0.0, 1.0, name="b"), Stop((0.0, 1.0), 0.0, 1.0, name="b"))}, "different names"),
    ({"coordinates": ("x", "x")}, r"coordinates have different names that are not empty; received \('x', 'x'\)"),
    ({"coordinates": 5}, "coordinates is a list of 2 names; received 5"),
    ({"mass": [[1e-320, 0.0], [0.0, 1.0]]}, r"entry \(1, 1\) of mass is too small to compute with"),
    ({"stiffness": [[1e300, 0.0], [0.0, 1.0]]}, r"entry \(1, 1\) of stiffness is too large .* received 1e\+300"),
    ({"absorber": 2}, "absorber is one of the coordinates u1, u2 or its index; received 2"),
    ({"absorber": 1, "primary": 1}, "two coordinates; both are u2"),
]
STOPS = [
    ({"gap": (0.0, 0.0), "upper": 1.0}, "gap row of a stop is zero"),
    ({"gap": (), "upper": 1.0}, "list of finite numbers"),
    ({"gap": (1.0,), "lower": 2.0, "upper": 1.0, "name": "c"}, "lower must be below upper; stop c has lower 2, upper 1"),
    ({"gap": (1.0,)}, "no finite bound"),
    ({"gap": (1.0,), "upper": math.nan}, "upper of a stop is a number; received NaN"),
    ({"gap": (1.0,), "upper": 1.0, "restitution": 1.1}, r"restitution lies in \[0, 1\]; a stop has 1.1"),
    ({"gap": (1e-320, 1e-300), "upper": 1.0}, "the gap row of a stop is too small to compute with"),
    ({"gap": (1.0,), "upper": 1e300, "name": "c"}, "upper of stop c is too large to compute with"),
    ({"gap": (1.0,), "upper": 1.0, "name": "A"}, "one lower-case letter"),
]
PARAMETERS = [
    ({"mu": math.inf}, "mu, the mass ratio"),
    ({"mu": math.nan}, r"mu, .* is a number; received NaN"),
    *(({"mu": mu}, r"mu, .* is too (small|large).* expected a size from 1e-25 to 1e\+25") for mu in (1e-320, 1e-26, 1e300)),
    *(({"sigma": size}, r"sigma, .* is too large .* expected a size from 0 to 1e\+25") for size in (1e26, 1e300)),
    ({"rho": "one"}, r"rho, .* is a number; received 'one'"),
]
DESCRIPTIONS = [
    ({"model": "vibro_impact_ness"}, "unknown model 'vibro_impact_ness'; known: vibro_impact_nes"),
    ({"model": "vibro_impact_nes", "sigm": 0.1}, "unknown key 'sigm' in model vibro_impact_nes; nearest known: sigma"),
    ({"mass": [[1.0]], "stiffness": [[1.0]]}, "lacks 'stops'"),
    ({"mass": [[1.0]], "stiffness": np.eye(2).tolist(), "stops": []}, "stiffness is 1 by 1 like mass; received 2 by 2"),
    (
        {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [], "coordinates": ["x"], "springs": [{"c": [1.0, 0.0], "stiffness": 1.0}]},
        "the row of the spring on x has 2 entries; the system has 1 coordinates",
    ),
    ({"mas": [[1.0]]}, "unknown key 'mas' in the system; nearest known: mass"),
    ({"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"upper": 1.0}]}, "a stop lacks its gap row 'c'"),
    ({"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "uper": 1.0}]}, "nearest known: upper"),
    ({"mass": [[1.0]], "stiffness": [[1.0]], "stops": [3]}, "a stop is a table"),
    ({"mass": [[1.0]], "stiffness": [[1.0]], "stops": 3}, "stops is a list of tables"),
    (
        {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": 1.0}], "coordinates": {"absorber": "x"}},
        "absorber is one of the coordinates u1 or its index; received 'x'",
    ),
    ([1, 2], "a table of keys and values"),
]


def system_with(**change):
    return ImpactSystem(**({"mass": EYE, "damping": ZERO, "stiffness": EYE, "stops": (STOP,)} | change))


@pytest.mark.parametrize(
    ("make", "given", "words"),
    [(make, *row) for make, table in ((system_with, MATRICES), (Stop, STOPS), (vibro_impact_nes, PARAMETERS)) for row in table],
)
def test_what_cannot_be_is_refused_by_name(make, given, words):
    with pytest.raises(InvalidSystem, match=words) as error:
        make(**given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("given", "words"), DESCRIPTIONS)
def test_a_description_that_cannot_be_is_refused(given, words):
    with pytest.raises(InvalidSystem, match=words):
        ImpactSystem.from_description(given)


def test_the_reference_system_has_the_energy_of_the_paper():
    """H = (mu u1'^2 + u2'^2 + u2^2 + sigma (u1 - u2)^2)/2, for one state and for an array of states."""
    system = vibro_impact_nes(mu=0.3, sigma=0.7)
    u = np.random.default_rng(1).normal(size=(5, 3, 2))
    v = np.random.default_rng(2).normal(size=(5, 3, 2))
    h = (0.3 * v[..., 0] ** 2 + v[..., 1] ** 2 + u[..., 1] ** 2 + 0.7 * (u[..., 0] - u[..., 1]) ** 2) / 2
    np.testing.assert_allclose(system.energy(u, v), h, rtol=1e-14)
    assert isinstance(system.energy(u[0, 0], v[0, 0]), float)


def test_a_system_says_what_loses_energy():
    assert vibro_impact_nes().is_conservative and vibro_impact_nes().why_not_conservative() is None
    assert vibro_impact_nes(rho=0.7).why_not_conservative() == "restitution 0.7 of stop a loses energy"
    assert vibro_impact_nes(lam=0.01).why_not_conservative() == "damping acts on u2 (coefficient 0.01)"
    assert not vibro_impact_nes(lam=0.01).is_conservative


def test_odd_symmetry_needs_equal_gaps_on_both_sides():
    def with_stop(*bounds):
        return ImpactSystem(EYE, ZERO, EYE, (Stop((1.0, 0.0), *bounds),))

    assert with_stop(-1.0, 1.0).has_odd_symmetry
    assert not with_stop(-1.0, 1.1).has_odd_symmetry
    assert not with_stop(-1.0).has_odd_symmetry


def test_names_default_in_order_around_those_given():
    stops = (Stop((1.0, 0.0), upper=1.0), Stop((0.0, 1.0), upper=1.0, name="a"), Stop((1.0, 1.0), upper=1.0))
    assert [stop.name for stop in ImpactSystem(EYE, ZERO, EYE, stops).stops] == ["b", "a", "c"]


def test_arrays_are_copies_and_read_only():
    mass = np.eye(2)
    system = ImpactSystem(mass, ZERO, EYE, (STOP,))
    mass[0, 0] = 7.0
    assert system.mass[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        system.stiffness[0, 0] = 2.0
    for matrix in (system.mass, system.damping, system.stiffness):
        with pytest.raises(ValueError, match="cannot set WRITEABLE flag"):
            matrix.setflags(write=True)


@pytest.mark.parametrize(
    "system",
    [
        vibro_impact_nes(0.37, 0.81, 0.01, 0.7),
        ImpactSystem(
            [[2.0, 0.1], [0.1, 1.0]],
            [[0.1, 0.0], [0.0, 0.0]],
            [[1.0, -1.0], [-1.0, 1.0]],
            (Stop((1.0, 0.0), upper=0.5, restitution=0.9), Stop((1.0, -1.0), -1.0, 2.0, name="g")),
            ("x", "y"),
            absorber=0,
        ),
    ],
)
def test_a_description_survives_json_and_gives_the_same_system(system):
    text = json.dumps(system.describe(), allow_nan=False)
    again = ImpactSystem.from_description(json.loads(text))
    for key in ("mass", "damping", "stiffness"):
        np.testing.assert_array_equal(getattr(again, key), getattr(system, key))
    for key in ("stops", "coordinates", "absorber", "primary", "model"):
        assert getattr(again, key) == getattr(system, key)
    assert json.dumps(again.describe()) == text


@pytest.mark.parametrize("mu", [1e-25, 1.0, 1e25])
@pytest.mark.parametrize("sigma", [0.0, 5e-324, 1e-320, 1e-300, 1e-25, 1.0, 1e25])
def test_no_number_of_the_modes_overflows_in_the_range(mu, sigma):
    """Oracle: floating-point errors raise; what the kernels watch (to the third derivative) and its squares are finite."""
    from bvp.multipoint import observed_of

    with np.errstate(all="raise", under="ignore"):
        system = vibro_impact_nes(mu=mu, sigma=sigma)
        assert np.isfinite(np.square(observed_of(system).rows)).all()


def test_a_changed_matrix_is_not_described_as_the_model_it_came_from():
    """`describe` must never give a description that makes another system."""
    from dataclasses import replace

    system = replace(vibro_impact_nes(), stiffness=np.array([[0.2, -0.2], [-0.2, 1.2]]))
    assert ImpactSystem.from_description(system.describe()).stiffness[0, 0] == 0.2


@pytest.mark.parametrize(("here", "there"), [(0.1234567890123457, 0.1234567890123456), (0.1 + 0.2, 0.3), (1e-17, 0.0), (-3e-16, 3e-16)])
def test_matrices_that_are_symmetric_to_rounding_are_taken_as_symmetric(here, there):
    """Oracle: the mean of both entries. A sum over elements leaves the rounding of the diagonal in entries that cancel."""
    for factor in (1e-9, 1.0, 1e9):
        given = factor * np.array([[1.0, here], [there, 1.0]])
        system = ImpactSystem(given, ZERO, given, (STOP,))
        for matrix in (system.mass, system.stiffness):
            assert matrix[0, 1] == matrix[1, 0] == 0.5 * (given[0, 1] + given[1, 0])
