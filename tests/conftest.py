"""Settings of the whole test suite: no timed property tests, no window for pictures; and the small scene that many tests read."""

import functools
import gc
import os
import shutil
import signal
import sys
from pathlib import Path

import hypothesis
import pytest

from saltus import processes
from tests.building import built_once

processes.one_thread()

# Nearly all that the workers of the tests need is loaded once, in the process that they are copies of.
processes.LOADED += ("sympy", "matplotlib.figure", "matplotlib.backends.backend_agg", "saltus.scene", "transitions.study.runs")
os.environ.setdefault("MPLBACKEND", "Agg")

# Processes that the tests start keep compiled modules. To compile them anew takes half of the time of a short command.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A job in the background of a shell ignores Ctrl-C, and so do its children. The tests of interrupts need Python's handler.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The first call of a compiled kernel takes seconds and later ones microseconds, so no example is timed.
hypothesis.settings.register_profile("saltus", deadline=None, print_blob=True)
hypothesis.settings.load_profile("saltus")


# What the collection of the tests makes stays. To look through it for garbage, again and again, takes a third of the time.
gc.disable()


def pytest_collection_finish(session):
    if "matplotlib" in sys.modules:
        share_parsed_texts()
    gc.freeze()
    gc.enable()


def share_parsed_texts():
    """Texts with mathematics are parsed once for all figures. By default each renderer parses anew, which is a quarter of the time of a
    figure."""
    from matplotlib import mathtext
    from matplotlib.backends import backend_agg

    parser = mathtext.MathTextParser
    parser._parse_cached = functools.lru_cache(5000)(parser._parse_cached.__wrapped__)
    backend_agg.MathTextParser = functools.cache(parser)


def pytest_sessionstart(session):
    """The kernels are compiled once, before the first test, in all processes that the machine has."""
    import saltus
    from saltus.compiling import prepare

    # A public name gives data their methods. Many tests reach a branch by other ways.
    assert saltus.Branch
    if not hasattr(session.config, "workerinput"):
        prepare()


@pytest.fixture(scope="session")
def small_scene(tmp_path_factory):
    """The reference scene up to quarter period 3 and 6 impacts in half a period, built once: its path and the report of the build."""
    import saltus
    from branches.building.build import build
    from branches.building.plan import Bounds, BuildPlan
    from branches.catalogue import Catalogue
    from saltus.processes import open_executor

    def make(folder):
        with open_executor(2) as (executor, workers), Catalogue(folder / "small.sqlite", "a", scene=saltus.load_scene()) as catalogue:
            return build(catalogue, BuildPlan.within(Bounds((0.05, 100.0), 3.0, 6)), executor, workers)

    folder, report = built_once(tmp_path_factory, "scene", make)
    return Path(shutil.copy(folder / "small.sqlite", tmp_path_factory.mktemp("own"))), report  # each worker has its own copy
