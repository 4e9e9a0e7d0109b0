"""Long cases of tests/branches/building/test_build.py."""

import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import saltus
from branches.catalogue import Catalogue
from branches.catalogue.database import CatalogueError
from tests.branches.building import test_build as origin
from tests.branches.building.test_build import built, content
from tests.branches.building.test_frontier import Serial

tiny = origin.tiny


ROOT = Path(__file__).parents[4]


BUILDER = """
import sys
sys.path.insert(0, {root!r})
from tests.branches.building.test_build import Serial, built
built({path!r}, Serial())
"""


def kept(path):
    """How many families a file holds that is being written; 0 while there is none."""
    try:
        with Catalogue(path) as catalogue:
            return len(catalogue)
    except CatalogueError:
        return 0


def test_a_killed_build_goes_on(tiny, tmp_path):
    """Oracle: the catalogue of a build that was not killed."""
    path = tmp_path / "killed.sqlite"
    command = [sys.executable, "-c", BUILDER.format(root=str(ROOT), path=str(path))]
    for families in (2, 7):
        process = subprocess.Popen(command)
        while kept(path) < families:
            assert process.poll() is None, "it ended before it was killed"
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        with Catalogue(path) as catalogue:
            assert {row.id for row in catalogue.families()} <= {id for id, _ in content(tiny[0])[0]}
            assert len(catalogue) < len(content(tiny[0])[0])
    report = built(path, Serial())
    assert report["digits"].pop("seconds") > 0.0 and report == {**tiny[1], "digits": {"orbits": tiny[1]["digits"]["orbits"]}}
    assert [id for id, _ in content(path)[0]] == [id for id, _ in content(tiny[0])[0]]
    assert content(path)[2] == content(tiny[0])[2]


def test_the_number_of_workers_changes_nothing(tiny, tmp_path):
    """Oracle: the catalogue of one worker, bit for bit."""
    path = tmp_path / "several.sqlite"
    with ThreadPoolExecutor(1) as pool:
        built(path, pool, workers=5)
    one, other = content(tiny[0]), content(path)
    assert one[0] == other[0] and one[2:] == other[2:]
    for id, columns in one[1].items():
        for name, values in columns.items():
            assert np.array_equal(values, other[1][id][name], equal_nan=values.dtype.kind in "fc"), (id, name)


def test_families_that_were_saved_are_followed_anew(tiny, tmp_path):
    """Oracle: the catalogue of a build into a new file. The saved branch covers a part of its family."""
    path = tmp_path / "saved.sqlite"
    with Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        catalogue.add(saltus.trace("S13O00+", saltus.load_scene().system, energy=(0.3, 0.5)))
    built(path, Serial())
    with Catalogue(path) as catalogue, Catalogue(tiny[0]) as other:
        assert {row.id for row in catalogue.families()} == {row.id for row in other.families()}
        ranges = [next(row.h for row in each.families() if row.label == "S13O00+") for each in (catalogue, other)]
        np.testing.assert_allclose(*ranges, rtol=1e-9)
