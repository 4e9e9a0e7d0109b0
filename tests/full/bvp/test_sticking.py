"""Long cases of tests/bvp/test_sticking.py."""

import numpy as np

from bvp.motion import MotionStatus
from bvp.simulate import Simulator
from bvp.system import vibro_impact_nes


def test_a_search_that_makes_no_way_ends_the_motion():
    """A contact mode whose states are scaled so that bounds of its gap are 1e14 times too large: steps too small to arrive."""
    simulator = Simulator(vibro_impact_nes(0.1, 0.0, 0.0, 0.7))
    mode = simulator.table.modes[0]
    scale = np.ones(len(mode["matrix"]))
    scale[np.abs(mode["gap"]).argmax() % len(scale)] = 1e14
    rows = {name: mode[name] * scale for name in ("leave", "gap", "rate", "acceleration", "first", "second")}
    columns = {"enter": mode["enter"] / scale[:, None], "push": mode["push"] / scale, "matrix": mode["matrix"] * scale / scale[:, None]}
    whole = np.array([[0, -len(scale)]], dtype=np.int64)
    blocks = {"pairs": whole, "mean": np.zeros(1), "delta": np.zeros(1)}
    mode.update(**rows, **columns, **blocks)
    simulator.table.__dict__.pop("stacked", None)
    motion = simulator.run([0.0, 0.0], [0.1, 1.0], 5.0)
    assert motion.status is MotionStatus.EXHAUSTED and motion.duration < 5.0
