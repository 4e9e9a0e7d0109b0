"""`saltus impulsive` from end to end: the fields of its files, what it prints."""

import csv
import io
import json
from functools import cache

import numpy as np
import pytest

from tests.branches.catalogue.families import real
from tests.saltus.running import reported as reported_once

NAMES = ["label", "family", "h", "alpha", "u2_velocity", "impacts"]


reported = cache(reported_once)


def test_json_has_the_fields():
    """Oracle: the fields of the format; h and the velocity agree (mass 1); the impulsive orbit of U4122 lies on its traced family, whose
    event is at h = 2.98736731."""
    code, out, err = reported("impulsive --energy 2.5:3.5 --max-quarter-period 2 --density 5 --json -")
    record = json.loads(out)
    assert code == 0 and record["schema"] == 2 and record["complete"] is True
    (orbit,) = record["orbits"]
    assert list(orbit)[: len(NAMES)] == NAMES
    assert orbit["label"] == "U4122-" and orbit["family"] is None and orbit["impacts"] == 4
    assert abs(orbit["h"] - 2.98736731483) < 1e-10 and abs(0.5 * orbit["u2_velocity"] ** 2 / orbit["h"] - 1.0) < 1e-14
    curve = record["manifold"]
    assert len(curve["h"]) == len(curve["frequency"]) == len(curve["samples_per_period"]) > 1
    assert curve["window"] == "Hann" and curve["periods"] == 200
    assert "U4122-" in err and "complete" in err and "Hann" in err


def test_families_of_a_catalogue(catalogue):
    """Oracle: the events IO of the catalogue's traced branches, one to one; what is found besides lies on no family of it."""
    events = [(branch.id, event.h) for branch in real() for event in branch.events if event.type == "IO" and 0.5 < event.h < 2.0]
    assert real()[3].id in dict(events)
    words = f"impulsive --energy 0.5:2 --max-quarter-period 2 --density 2 --catalogue {catalogue}"
    code, out, err = reported(f"{words} --json -")
    assert code == 0
    orbits = [(orbit["family"], orbit["h"]) for orbit in json.loads(out)["orbits"]]
    found = [orbit for orbit in orbits if orbit[0] is not None]
    assert found == [(id, pytest.approx(h, rel=1e-9)) for id, h in events] and len(found) < len(orbits)
    assert all(id in err for id in dict(events))


def test_files(tmp_path):
    """Oracle: CSV agrees with JSON; the picture is one."""
    paths = {kind: tmp_path / f"a.{kind}" for kind in ("json", "csv", "svg")}
    words = f"impulsive --energy 1:2 --max-quarter-period 4 --density 5 --json {paths['json']} --csv {paths['csv']} --plot {paths['svg']}"
    code, out, err = reported(words)
    assert code == 0 and not err and out.count("wrote") == 3
    record = json.loads(paths["json"].read_text())
    rows = list(csv.DictReader(io.StringIO(paths["csv"].read_text())))
    assert [float(row["h"]) for row in rows] == [orbit["h"] for orbit in record["orbits"]]
    assert [row["label"] for row in rows] == [orbit["label"] for orbit in record["orbits"]] and rows
    assert paths["svg"].read_text().startswith("<?xml")


def test_bounds_and_parameters():
    """Oracle: the impacts bound leaves the orbits with so many out; another system has other orbits; --model says why."""
    few = json.loads(reported("impulsive --energy 1:2 --max-quarter-period 4 --max-impacts 3 --density 2 --json -")[1])
    assert [orbit["impacts"] for orbit in few["orbits"]] == [3] and few["bounds"] == {"quarter_period": 4.0, "impacts": 3}
    code, out, _ = reported("impulsive --energy 1:2 --max-quarter-period 2 --mu 0.3 --sigma 0.4 --model")
    assert code == 0 and "origin" in out and "complete" in out


def test_nothing_there():
    """Oracle: no impacts below sigma/2: an empty list, complete, exit 0."""
    code, out, _ = reported("impulsive --energy 0.01:0.05 --density 5 --json -")
    record = json.loads(out)
    assert code == 0 and record["orbits"] == [] and record["complete"]
    assert np.ptp(record["manifold"]["frequency"]) < 1e-12
