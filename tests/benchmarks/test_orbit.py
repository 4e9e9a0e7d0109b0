"""`python -m benchmarks orbit`: an orbit by the paper's method beside the exact one, and what the method cannot do."""

import json

import pytest

from benchmarks import orbit as task
from benchmarks.__main__ import main
from benchmarks.orbit import compare, nonsmooth_time_orbit
from benchmarks.peers.nonsmooth_time import TOLERANCE, NotMatched, Stagnates, solve_nonsmooth_time
from branches.orbit import Orbit
from saltus.errors import BadInput
from tests.bvp.orbits import backbone_segment, collection


def orbit_at(alpha):
    """S13O00+ at a quarter period."""
    problem, y = backbone_segment(collection()[0].problem.system, alpha)
    return Orbit(problem, problem.solve(y, quarter_period=alpha))


def test_an_orbit_by_the_method_of_the_paper(capsys, tmp_path):
    """Oracle: published: S13O00+ has alpha = 1.7 at h = 0.58875. The error against the closed form h = 0.588748128566443 is smaller than
    the tolerance and larger than rounding."""
    data = tmp_path / "orbit.json"
    assert main(["orbit", "S13O00+", "--alpha", "1.7", "--tolerance", "1e-5", "--json", str(data)]) == 0
    out, err = capsys.readouterr()
    record = json.loads(data.read_text())
    energy = record["quantities"][0]
    error = energy["found"] - 0.588748128566443
    assert energy["name"] == "h" and 1e-12 < abs(error) < 1e-5 and abs(energy["exact"] - 0.588748128566443) < 1e-12
    assert "  shooting in nonsmooth time, from velocities to 3 digits" in err.splitlines()
    assert f"{error:.1e}" in out and "Integrator RK45" in " ".join(out.split())
    assert record["label"] == "S13O00+" and record["tolerance"] == 1e-5 and record["mismatch"] < 1e-5
    assert [quantity["name"] for quantity in record["quantities"][3::2]] == ["time of impact +", "time of impact -"]


def test_the_quantities_are_those_of_the_orbit():
    """Oracle: the exact orbit U8353- with 16 impacts in a period; the method agrees within its tolerance."""
    found = next(x for x in collection() if x.problem.ends[0] == "origin" and x.problem.inner >= 4 and abs(x.solution["trace"]) < 50.0)
    orbit = Orbit(found.problem, found.solution)
    near, digits = nonsmooth_time_orbit(orbit, 1e-6)
    table, record = compare(orbit, near, digits)
    assert len(table.rows) == len(record["quantities"]) == 3 + 2 * len(orbit.impacts) and 3 <= digits <= 8
    assert [row[0] for row in table.rows[3::2]] == [f"time of impact {impact.stop}" for impact in orbit.impacts]
    assert all(abs(quantity["found"] - quantity["exact"]) < 1e-4 for quantity in record["quantities"])
    assert any(quantity["found"] != quantity["exact"] for quantity in record["quantities"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--alpha", "1.7", "--tolerance", "-1"), "'-1'"),
        (("--alpha", "1.7", "--tolerance", "0"), "'0'"),
        (("--alpha", "1.7", "--tolerance", "9e-14"), "received 9e-14, expected 1e-13 or more"),
        ((), "needs --energy H or --alpha A"),
    ],
)
def test_bad_options_are_refused(words, message, capsys):
    """Oracle: exit code 2, one line that names what was received, nothing on standard output."""
    assert main(["orbit", "S13O00+", *words]) == 2
    out, err = capsys.readouterr()
    assert not out and message in err and len(err.splitlines()) == 1


def test_other_ends_are_refused():
    """Oracle: an orbit between a rest and a stop, which does not have u = 0 at the ends of its half period."""
    found = next(x for x in collection() if x.problem.ends[0] == "rest")
    with pytest.raises(BadInput, match="its ends are rest .*u = 0 at the start"):
        nonsmooth_time_orbit(Orbit(found.problem, found.solution), 1e-6)


def test_a_tolerance_that_is_not_reached_is_reported_at_once(monkeypatch):
    """Oracle: a solver that stagnates below the usual tolerance: one attempt at each tolerance, and its own message."""
    asked = []

    def stagnating(*given, tolerance):
        asked.append(tolerance)
        if tolerance < TOLERANCE:
            raise Stagnates("shooting stagnates at a mismatch of 3e-13")
        return solve_nonsmooth_time(*given, tolerance=tolerance)

    monkeypatch.setattr(task.paper, "solve_nonsmooth_time", stagnating)
    with pytest.raises(NotMatched, match=r"S13O00\+: shooting stagnates at a mismatch of 3e-13"):
        nonsmooth_time_orbit(orbit_at(1.7), 1e-13)
    assert asked == [TOLERANCE, 1e-13]


def test_another_orbit_than_the_wanted_one_is_refused(monkeypatch):
    """Oracle: shooting that answers with the orbit of another quarter period, or with one more impact."""
    wanted, other = orbit_at(1.7), orbit_at(1.75)
    first, second = (nonsmooth_time_orbit(orbit, 1e-6)[0] for orbit in (wanted, other))
    monkeypatch.setattr(task.paper, "solve_nonsmooth_time", lambda *given, **options: second)
    with pytest.raises(NotMatched, match=r"S13O00\+, from its velocities to 8 digits: this is another orbit: its impacts"):
        nonsmooth_time_orbit(wanted, 1e-6)
    object.__setattr__(first, "half", first.half * 2)
    monkeypatch.setattr(task.paper, "solve_nonsmooth_time", lambda *given, **options: first)
    with pytest.raises(NotMatched, match="with 2 impacts in half a period instead of 1"):
        nonsmooth_time_orbit(wanted, 1e-6)
