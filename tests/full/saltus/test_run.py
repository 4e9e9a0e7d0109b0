"""Long cases of tests/saltus/test_run.py."""

import pytest

from tests.saltus.running import run
from tests.saltus.test_run import require_the_stages_begin_with_the_family_of_the_start


def test_modes_of_more_coordinates_are_in_the_picture(capsys, tmp_path):
    """Oracle: the names of the modes of the shipped building that reach a stop and are within the panel's frequencies and energies."""
    words = ("--scene", "three_storey_building", "--duration", "2", "--plot", tmp_path / "building.svg")
    assert run(capsys, "run", *words)[0] == 0
    assert 'id="families-L1"' in (tmp_path / "building.svg").read_text()


@pytest.mark.parametrize(
    ("words", "reasons"),
    [
        (("S13O00+", "--energy", "10"), ["of the orbit's amplitude", None, None, "has no orbit at these energies", "no impact"]),
        (("S11O00-", "--energy", "0.8"), ["too fast for the spectrum", "no impact"]),
        (("S95E22-", "--impulsive"), [None, "has no orbit at these energies", "no impact"]),
        (("S31O11-", "--impulsive"), [None, "octaves from harmonic 1 of S31O11-", "no impact"]),
        (("U4122-", "--impulsive"), ["of the orbit's amplitude", "no impact"]),
    ],
    ids=lambda words: words[0],
)
def test_the_stages_begin_with_the_family_of_the_start(capsys, words, reasons):
    """Oracle: see `require_the_stages_begin_with_the_family_of_the_start`."""
    require_the_stages_begin_with_the_family_of_the_start(capsys, words, reasons)
