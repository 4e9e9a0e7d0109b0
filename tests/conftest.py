"""Settings of the whole test suite: no timed property tests, no window for pictures."""

import os

import hypothesis

os.environ.setdefault("MPLBACKEND", "Agg")

# The first call of a compiled kernel takes seconds and later ones microseconds, so no example is timed.
hypothesis.settings.register_profile("saltus", deadline=None, print_blob=True)
hypothesis.settings.load_profile("saltus")
