"""Long cases of tests/saltus/test_dask.py."""

import pytest

from saltus.processes import open_executor
from tests.saltus import test_dask as origin
from tests.saltus.test_dask import distributed

cluster = origin.cluster


def test_a_cluster_that_is_lost_is_one_line(cluster):
    """Oracle: the error of Dask's connections, which the program turns into exit code 1."""
    with pytest.raises(RuntimeError, match=r"the Dask cluster at tcp://.* was lost; what was finished is kept"):
        with open_executor(dask=cluster.scheduler_address):
            raise distributed.comm.CommClosedError
