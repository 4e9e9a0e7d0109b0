"""Long cases of tests/branches/catalogue/test_schema2.py."""

import random
import subprocess
import sys
import time
from pathlib import Path

from branches.catalogue import Catalogue
from tests.branches.catalogue import test_schema2 as origin
from tests.branches.catalogue.test_schema2 import content

path = origin.path


ROOT = Path(__file__).parents[4]


def test_a_conversion_that_is_killed(path):
    """Oracle: what was read before, after processes that were killed at random moments; the next writer converts the file."""
    before, dice = content(path), random.Random(9)
    script = f"import saltus; c = saltus.Catalogue; c; print(1, flush=True); c({str(path)!r}, 'a').close()"
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=ROOT)
        process.stdout.readline()
        time.sleep(dice.uniform(0.0, 1.2))
        process.kill()
        process.wait()
        assert content(path)[1:] == before[1:]
    Catalogue(path, "a").close()
    assert content(path)[1:] == before[1:]
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
