"""`saltus orbit --method nstt`: the form of the exact answer, said to be approximate, and what the method cannot do."""

import csv
import json

import pytest

from branches.orbit import Orbit
from bvp.nonsmooth_time import TOLERANCE, NotMatched, StandsStill, solve_nonsmooth_time
from saltus.errors import BadInput
from saltus.nonsmooth_time import approximate
from tests.bvp.orbits import backbone_segment, collection
from tests.saltus.running import run


def test_an_orbit_by_the_method_of_the_paper(capsys, tmp_path):
    """Oracle: published: S13O00+ has alpha = 1.7 at h = 0.58875; the closed form h = 0.588748128566443 is missed by less than the
    tolerance, and by more than rounding."""
    data, table, picture = tmp_path / "orbit.json", tmp_path / "orbit.csv", tmp_path / "orbit.svg"
    files = ("--json", data, "--csv", table, "--plot", picture)
    code, out, err = run(capsys, "orbit", "S13O00+", "--alpha", "1.7", "--method", "nstt", "--tolerance", "1e-5", *files)
    orbit = json.loads(data.read_text())["orbit"]
    assert code == 0 and not err
    assert "quality  APPROXIMATE  nstt (RK45)  tolerance 1.0e-05" in out and "no multipliers" in out and "stable   undecided" in out
    error = orbit["h"] - 0.588748128566443
    assert 1e-12 < abs(error) < 1e-5 and f"off by {error:.1e}" in out
    assert orbit["stable"] is None and orbit["multipliers"] == [] and orbit["residual"] < 1e-5
    quality = orbit["quality"]
    assert quality["approximate"] is True and quality["method"] == "nstt" and quality["tolerance"] == 1e-5 and not quality["reliable"]
    assert [impact["stop"] for impact in orbit["impacts"]] == ["+", "-"] and abs(orbit["impacts"][0]["time"] - 1.7) < 1e-4
    (row,) = csv.DictReader(table.open())
    assert row["quality.approximate"] == "true" and float(row["h"]) == orbit["h"]
    assert "approximate (nstt" in picture.read_text() and "multipliers not reliable" not in picture.read_text()


def test_the_form_is_that_of_the_exact_method(capsys):
    """Oracle: the same command without it: the same names, and the same orbit within the tolerance."""
    records = []
    for words in ((), ("--method", "nstt"), ("--method", "exact")):
        code, out, _ = run(capsys, "orbit", "U8353-", "--alpha", "4.9065", "--json", "-", *words)
        assert code == 0
        records.append(json.loads(out)["orbit"])
    exact, near, same = records
    assert exact == same
    assert set(exact) == set(near) and set(exact["quality"]) < set(near["quality"])
    assert near["label"] == exact["label"] and near["ends"] == exact["ends"] and near["word"] == exact["word"]
    assert abs(near["h"] - exact["h"]) < 1e-5 and near["h"] != exact["h"]
    for a, b in zip(near["impacts"], exact["impacts"], strict=True):
        assert a["stop"] == b["stop"] and abs(a["time"] - b["time"]) < 1e-4 and abs(a["speed"] - b["speed"]) < 1e-4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--tolerance", "1e-5"), "--method nstt with it"),
        (("--method", "nsst"), "nearest: nstt"),
        (("--method", "nstt", "--tolerance", "-1"), "'-1'"),
        (("--method", "nstt", "--tolerance", "0"), "'0'"),
        (("--method", "nstt", "--tolerance", "9e-14"), "received 9e-14, expected 1e-13 or more"),
    ],
)
def test_options_that_do_not_fit_are_refused(words, message, capsys):
    """Oracle: exit code 2, one line that names what was received, nothing on standard output."""
    code, out, err = run(capsys, "orbit", "S13O00+", "--alpha", "1.7", *words)
    assert code == 2 and not out and message in err and len(err.splitlines()) == 1


def test_other_ends_are_refused():
    """Oracle: an orbit between a rest and a stop, which passes u = 0 nowhere at the ends of its half period."""
    found = next(x for x in collection() if x.problem.ends[0] == "rest")
    with pytest.raises(BadInput, match="its ends are rest .*--method exact"):
        approximate(Orbit(found.problem, found.solution), 1e-6)


def test_a_tolerance_that_is_not_reached_is_told_at_once(monkeypatch):
    """Oracle: a solution that stands still below the usual tolerance: one attempt at each, and its own words in the message."""
    from saltus import nonsmooth_time

    asked = []

    def still(*given, tolerance):
        asked.append(tolerance)
        if tolerance < TOLERANCE:
            raise StandsStill("shooting stands still at a mismatch of 3e-13")
        return solve_nonsmooth_time(*given, tolerance=tolerance)

    monkeypatch.setattr(nonsmooth_time, "solve_nonsmooth_time", still)
    problem, y = backbone_segment(collection()[0].problem.system, 1.7)
    with pytest.raises(NotMatched, match=r"does not match S13O00\+: shooting stands still at a mismatch of 3e-13"):
        approximate(Orbit(problem, problem.solve(y, quarter_period=1.7)), 1e-13)
    assert asked == [TOLERANCE, 1e-13]


def test_another_orbit_than_the_one_asked_for_is_refused(monkeypatch):
    """Oracle: shooting that answers with the orbit of another quarter period, or with one more impact."""
    from saltus import nonsmooth_time

    system = collection()[0].problem.system
    orbits = []
    for alpha in (1.7, 1.75):
        problem, y = backbone_segment(system, alpha)
        orbits.append(Orbit(problem, problem.solve(y, quarter_period=alpha)))
    first, second = (approximate(orbit, 1e-6).found for orbit in orbits)
    monkeypatch.setattr(nonsmooth_time, "solve_nonsmooth_time", lambda *given, **options: second)
    with pytest.raises(NotMatched, match=r"S13O00\+, from its velocities to 8 digits: it ends on another orbit, whose impacts"):
        approximate(orbits[0], 1e-6)
    object.__setattr__(first, "half", first.half * 2)
    monkeypatch.setattr(nonsmooth_time, "solve_nonsmooth_time", lambda *given, **options: first)
    with pytest.raises(NotMatched, match="with 4 impacts in a period and not the 2"):
        approximate(orbits[0], 1e-6)
