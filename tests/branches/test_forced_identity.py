"""Ids of families of forced orbits: they do not depend on how a family was reached, and differ between families."""

import math

import numpy as np
import pytest

from branches.forced.identity import canonical_letters, closure_name, invariants
from branches.forced.primitive import full_period, primitive_orbit, twice
from branches.forced.tracing import follow_response, switch_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from tests.branches.forced_systems import absorber_families, impact_speed, oscillator, settled
from tests.branches.test_forced_switching import two_sided


@pytest.fixture(scope="module")
def absorber():
    return absorber_families()


def require_id(branch, part, interval, direction):
    """The same id of the family, followed again from a point of it, in a range around its parameter or in a given one."""
    # At an event the equations can be singular.
    located = np.array([event.values["w"] for event in branch.events])
    plain = [k for k in range(len(branch)) if np.abs(located - branch.parameter[k]).min() > 1e-9]
    k = plain[int(part * len(plain))]
    at = float(branch.parameter[k])
    low, high = {"whole": (0.7, 2.2), "near": (at - 1e-3, at + 1e-3), "beyond": (at, 3.0)}[interval]
    assert follow_response(branch.problem, branch.unknowns[k], (low, high), direction=direction).id == branch.id


@pytest.mark.parametrize(("part", "interval", "direction"), [(0.35, "near", "both"), (0.9, "near", "along")])
def test_an_id_depends_neither_on_the_start_nor_on_the_range(absorber, part, interval, direction):
    """Oracle: the id of the family that is followed to both of its ends."""
    for branch in absorber:
        require_id(branch, part, interval, direction)


def test_an_id_does_not_depend_on_the_steps(absorber, monkeypatch):
    """Oracle: the id with steps of the usual length."""
    import dataclasses

    from branches import family
    from branches.forced import identity, tracing

    finer = dataclasses.replace(family.SETTINGS, maximum_step=0.011, initial_step=0.003, target_turn=0.02)
    for module in (identity, tracing):
        monkeypatch.setattr(module, "SETTINGS", finer)
    for branch in absorber:
        again = follow_response(branch.problem, branch.unknowns[len(branch) // 3], (0.7, 2.2))
        assert len(again) > 1.5 * len(branch) and again.id == branch.id


def test_families_have_ids_of_their_own(absorber):
    """Oracle: they have other closures, sequences or ends."""
    ids = [branch.id for branch in absorber]
    assert len(set(ids)) == len(ids)
    assert [id.rpartition(":")[0] for id in ids] == ["half-period-1:+", "half-period-1:++", "period-1:++--", "period-2:++--++--"]


def test_both_mirror_images_have_one_id(absorber):
    """Oracle: a broken symmetry gives two families that are images of each other."""
    _, four, broken, _ = absorber
    event = next(event for event in four.events if event.type == "SB")
    images = [follow_response(*start, (0.7, 2.2), direction="along") for start in switch_response(four, event)]
    first, second = (image.unknowns[len(image) // 2] for image in images)
    assert images[0].id == images[1].id == broken.id
    size = 2 * four.problem.degrees_of_freedom
    assert np.abs(images[0].problem.nodes(first)[:, :size] - images[1].problem.nodes(second)[:, :size]).max() > 1e-3


def test_a_repeated_orbit_is_the_orbit(absorber):
    """Oracle: the numbers of an orbit, of its double, and of the full period of a half."""
    first, _, broken, _ = absorber
    y = first.unknowns[100]
    full, whole = full_period(first.problem, y)
    double, two = twice(full, whole)
    for problem, orbit in ((first.problem, y), (full, whole), (double, two)):
        found, back = primitive_orbit(problem, orbit)
        assert (closure_name(found), canonical_letters(found)) == ("half-period-1", "+")
        assert invariants(found, back) == pytest.approx(invariants(first.problem, y), rel=1e-10)
    problem, orbit = twice(broken.problem, broken.unknowns[20])
    found, back = primitive_orbit(problem, orbit)
    assert closure_name(found) == "period-1" and back == pytest.approx(broken.unknowns[20], rel=1e-9, abs=1e-9)
    problem, orbit = broken.problem, broken.unknowns[20]
    assert primitive_orbit(problem, orbit)[0] is problem, "it is not symmetric"


def test_letters_are_those_of_the_first_image():
    """Oracle: the images by hand."""
    system = two_sided()

    def letters(sequence, **options):
        return canonical_letters(ForcedProblem(system, sequence, ["w"], **options))

    assert letters("-", half=True) == letters("+", half=True) == "+"
    assert letters("-+", half=True) == letters("--", half=True) == "++", "+ + - -, begun at its second impact"
    assert letters("-++") == letters("+-+") == letters("--+") == "++-"
    assert letters("") == ""


def test_impact_oscillator_ids_from_the_closed_form():
    """Oracle: design section 9: the two roots of the formula at one value of s lie on the same family where it has a fold between
    them, and the fold identifies it."""
    parametric = oscillator()
    problem, y = settled(parametric, ["s"], values={"s": -0.03, "w": 2.8}, start=(np.array([-0.66]), np.zeros(1)))
    branch = follow_response(problem, y, (-0.2, 0.02))
    upper = follow_response(problem, y, (-1.79, -0.02))
    speeds = [impact_speed(2.8, 0.8, 1, float(branch.parameter[5]), sign) for sign in (1, -1)]
    assert min(abs(branch.speeds[5, 0] - speed) for speed in speeds) < 1e-10
    assert branch.id == upper.id and branch.id.startswith("period-1:+:")
    (mark,) = branch.full_family.marks[:1]
    assert mark.kind == "GR s" and mark.h == pytest.approx(-0.368968205647608, abs=1e-9)
    assert mark.alpha == pytest.approx(2.0 * math.pi / 2.8, rel=1e-14)


def smooth_oscillator(potential, **values):
    """An oscillator in a potential under a load."""
    return ParametricSystem.from_description(
        {
            "parameters": values,
            "system": {"mass": [[1.0]], "damping": [["c"]], "stiffness": [[0.0]], "springs": [{"c": [1.0], "potential": potential}]},
            "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}],
        }
    )


def test_a_place_where_steps_fail_identifies_no_family():
    """Oracle: one family of a pendulum, from two of its orbits. Steps fail where its multipliers are large, at two places."""
    pendulum = smooth_oscillator("1-cos(w)", w=1.0, c=0.1, F=0.3)
    problem = ForcedProblem(pendulum, (), ["w"], half=True)
    y = problem.solve(problem.pack(np.zeros((1, 2)), [0.0], [2.0])).y
    families = [follow_response(problem, y, interval).full_family for interval in ((1.95, 2.05), (0.7, 3.0))]
    lowest = [float(family.parameter.min()) for family in families]
    assert 0.2 < min(lowest) and lowest[0] != lowest[1], "steps fail inside the window"
    assert families[0].ids == families[1].ids and families[0].marks[0].kind == "EP w"


def test_responses_in_two_wells_have_ids_of_their_own():
    """Oracle: the closed form of the wells' places, between which no orbit of so small a load passes."""
    wells = smooth_oscillator("-0.5*w**2+0.1*w**3+0.25*w**4", w=2.0, c=0.3, F=0.005)
    problem = ForcedProblem(wells, (), ["w"])
    ids = []
    for place in ((-0.3 + math.sqrt(4.09)) / 2.0, (-0.3 - math.sqrt(4.09)) / 2.0):
        y = problem.solve(problem.pack([[place, 0.0]], [0.0], [2.0])).y
        assert problem.states(y)[0, 0] == pytest.approx(place, abs=0.01)
        assert invariants(problem, y)[2] == pytest.approx(abs(place), abs=0.01)
        ids.append(follow_response(problem, y, (1.95, 2.05)).id)
    assert ids[0] != ids[1]
