"""Settings of the whole test suite: no timed property tests, no window for pictures; and the small scene that many tests read."""

import functools
import gc
import os
import pickle
import shutil
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import hypothesis
import pytest

from saltus import processes

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

    # The first worker of a parallel run builds it, the others wait. Each has its own copy.
    folder = tmp_path_factory.mktemp("scene")
    shared = tmp_path_factory.getbasetemp().parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    built, kept = shared / "built.sqlite", shared / "built.report"
    with alone(shared / "built.report"):
        if not kept.exists():
            with open_executor(2) as (executor, workers), Catalogue(built, "a", scene=saltus.load_scene()) as catalogue:
                report = build(catalogue, BuildPlan.within(Bounds((0.05, 100.0), 3.0, 6)), executor, workers)
            kept.write_bytes(pickle.dumps(report))
    return Path(shutil.copy(built, folder / "small.sqlite")), pickle.loads(kept.read_bytes())


@contextmanager
def alone(path):
    """One process after the other. A lock ends with the process that holds it."""
    from branches.catalogue.database import CatalogueInUse, WriterLock

    lock = None
    while lock is None:
        try:
            lock = WriterLock(path)
        except CatalogueInUse:
            time.sleep(0.05)
    try:
        yield
    finally:
        lock.release()
