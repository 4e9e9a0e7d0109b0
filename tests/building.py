"""What one worker of a parallel run builds for all of them."""

import os
import pickle
import time
from contextlib import contextmanager


def built_once(tmp_path_factory, name, make):
    """The folder in which `make` built, and what it returned. The first worker of a parallel run builds, the others wait."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    folder.mkdir(exist_ok=True)
    kept = folder / "returned"
    with alone(kept):
        if not kept.exists():
            kept.write_bytes(pickle.dumps(make(folder)))
    return folder, pickle.loads(kept.read_bytes())


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
