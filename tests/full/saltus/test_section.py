"""Long cases of tests/saltus/test_section.py."""

import numpy as np

from tests.saltus.running import reported
from tests.saltus.test_section import SMALL


def test_panels_of_a_range_have_eight_energies(tmp_path):
    """Oracle: a geometric sequence."""
    code, out, _ = reported(f"section --panels --energy 0.06:6 {SMALL}")
    found = [float(line.split()[0]) for line in out.splitlines()[1:9]]
    assert code == 0 and np.allclose(found, np.geomspace(0.06, 6.0, 8), rtol=1e-5)
    code, out, _ = reported(f"section --panels --energy 0.1,0.2,0.7 {SMALL} --colour lyapunov --plot {tmp_path}/p.pdf")
    assert code == 0 and [line.split()[0] for line in out.splitlines()[1:4]] == ["0.1", "0.2", "0.7"]
    assert (tmp_path / "p.pdf").read_bytes().startswith(b"%PDF")
