"""The benchmark of studies: what it reports is what the runs are. No time is asserted."""

import numpy as np

from benchmarks.studying import integrate, plan, study, table, tail_time
from transitions.study.runs import run_block


def test_it_reports_the_runs_of_its_study():
    """Oracle: the same runs in this process; scipy's integrator finds the same impacts, and an error of the size of its tolerance."""
    found = study(60, 1)
    wanted = plan(60)
    columns = run_block(wanted, wanted.values(0, 60))
    assert found.runs == 60 and found.impacts == columns["impacts"].sum() and np.array_equal(found.energies, columns["h"])
    assert found.memory == sum(values.nbytes for values in columns.values()) / 60 < 200 and found.error < 1e-12
    few = np.argsort(columns["impacts"])[:2]
    other = integrate(found.energies[few], found.last[few])
    assert other.impacts == columns["impacts"][few].sum() and 1e-15 < other.worst < 1e-6
    whole, tail = tail_time(found.energies)
    assert str(found.impacts) in table([found], other, (whole, tail)).text()
