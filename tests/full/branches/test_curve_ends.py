"""Long cases of tests/branches/test_curve_ends.py."""

import pytest

import saltus
from tests.branches import test_curve_ends as origin
from tests.branches.test_curve_ends import (
    require_a_curve_ends_at_the_domain_of_either_parameter,
    require_no_bautin_point_lies_beside_a_resonance,
)

damper = origin.damper


@pytest.mark.parametrize("names", [("w", "e"), ("e", "w")])
def test_a_curve_ends_at_the_domain_of_either_parameter(damper, names):
    require_a_curve_ends_at_the_domain_of_either_parameter(damper, names)


@pytest.mark.parametrize("id", ["NS1", "NS2"])
def test_no_bautin_point_lies_beside_a_resonance(damper, id):
    require_no_bautin_point_lies_beside_a_resonance(damper, id)


def test_a_curve_ends_where_an_expression_leaves_its_domain():
    """The restitution 1 - q lies in [0, 1], so q does, too. Both ends say what the system cannot have."""
    parametric = saltus.ParametricSystem.from_description(
        {
            "parameters": {"A": 0.3, "w": 1.1, "q": 0.2},
            "system": {
                "mass": [[1.0]],
                "damping": [[0.1]],
                "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "upper": 1.0, "restitution": "1 - q"}],
            },
            "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
        }
    )
    (response,) = saltus.trace_response(parametric, "A", (0.05, 1.0))
    curve = saltus.follow_curve(saltus.curve_at(response, "SN1", ("A", "q")), ((0.05, 3.0), (-1.0, 2.0)))
    assert [end.reason for end in curve.ended] == ["DOMAIN", "DOMAIN"]
    assert all("restitution lies in [0, 1]" in end.text for end in curve.ended)
    assert sorted(curve.parameters[[0, -1], 1].tolist()) == pytest.approx([0.0, 1.0], abs=1e-8)
