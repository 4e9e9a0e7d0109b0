"""The next impact of 100,000 random starts. Takes a minute or two, and is run apart: `python -m pytest tests/full`."""

import numpy as np

from tests.hard.cases import hard
from tests.hard.sweeping import Verdicts, random_cases
from tests.hard.test_missed_events import SOURCE


@hard(
    "next impact of 100,000 random starts on 5,000 systems, drawn likewise",
    source=SOURCE,
    limit=1e-13,
    what="distance from the stop at a hit's time, of the sizes that make it up; none missed, none invented",
)
def test_none_is_missed_and_none_invented():
    """Oracle: `tests.hard.sweeping`, which skips no event."""
    verdicts = Verdicts()
    rng = np.random.default_rng(11)
    for _ in range(20):
        verdicts.judge(random_cases(rng, 250, 20))
    assert not verdicts.missed, [text for _, text in verdicts.missed]
    assert not verdicts.invented, [text for _, text in verdicts.invented]
    assert sum(verdicts.kinds.values()) == 100_000 and verdicts.near > 5000
    return verdicts.distance
