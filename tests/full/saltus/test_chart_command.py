"""Long cases of tests/saltus/test_chart_command.py."""

import numpy as np
import pytest

from tests.saltus import test_chart_command as origin
from tests.saltus.running import read_json
from tests.saltus.test_chart_command import chart

folder = origin.folder
inside = origin.inside


def test_a_third_parameter_follows_an_equation(inside):
    """Oracle: with c = 0.1 w the grazing is at A = |1 - w^2 + 0.1 i w^2|. The response has c = 0.1, near the equation."""
    code, _, err = chart('--in w,A,c --keep "c = 0.1*w" --from response.json --range 0.9:1.1,0.06:0.25 --levels 0 --grid 0x0 --json k.json')
    assert (code, err) == (0, "")
    grazing = next(curve for curve in read_json("k.json")["curves"] if curve["code"] == "GR")
    for point in grazing["points"]:
        w, amplitude = point["parameters"]
        assert amplitude == pytest.approx(np.hypot(1.0 - w * w, 0.1 * w * w), rel=1e-9)
