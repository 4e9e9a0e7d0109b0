"""Long cases of tests/saltus/test_run_smooth.py."""

import json

from tests.saltus import test_run_smooth as origin
from tests.saltus.running import run

catalogue = origin.catalogue


def test_a_motion_follows_the_family_that_it_starts_on(tmp_path, capsys, catalogue):
    """Oracles: without losses the orbit itself; with small ones the family, on which a slow motion stays."""
    words = ("--scene", "cubic_nes", "--on", "S11+", "--energy", 0.08, "--catalogue", catalogue, "--duration", 60)
    for more in (), ("--lam", 0.002, "--set", "lam_nes=0.002", "--plot", tmp_path / "run.png"):
        code, out, _ = run(capsys, "run", *words, *more, "--json", tmp_path / "run.json", "--stages")
        record = json.loads((tmp_path / "run.json").read_text())
        assert code == 0 and "leaves" not in out
        assert [(stage["follows"]["label"], stage["follows"]["harmonic"]) for stage in record["stages"]] == [("S11+", 1)]
        assert record["stages"][0]["start"] < 10.0 and record["stages"][0]["end"] > 50.0
        assert record["initial"]["on"]["name"] == "S11+"
    assert (tmp_path / "run.png").stat().st_size > 10_000
    code, out, _ = run(capsys, "run", "--scene", "cubic_nes", "--impulse", 0.4, "--duration", 60, "--stages")
    assert code == 0 and "compared with no family: springs that are not linear leave no linear modes" in out
