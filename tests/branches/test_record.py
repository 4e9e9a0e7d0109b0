"""Files of branches and orbits: what is written is read back bit for bit, and what is no branch is refused in one line."""

import csv
import io
import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import saltus
from branches import reading, record
from branches.branch import BranchEvent
from branches.reading import RecordError
from bvp.system import vibro_impact_nes

FINITE = st.floats(allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(min_value=1e-300, max_value=1e300)


def made_of(points, events=()):
    """Return what a record reads of a branch, from columns."""
    return SimpleNamespace(
        system=vibro_impact_nes(),
        id="origin-stop+:+-:0badcafe",
        label="S13O00+",
        aliases=[{"label": "S13O00+", "from": 0.0, "to": 1.5}],
        ends=("origin", "stop+"),
        sequence="+-",
        energy=(0.05, math.inf),
        others=(),
        points=points,
        events=list(events),
        problem=SimpleNamespace(pieces=1),
        ended=(SimpleNamespace(reason="EVENT", text="it grazes"), SimpleNamespace(reason="POINTS", text="3 points")),
    )


def columns():
    """Return random columns of a branch, with each kind of value that is null in a file."""
    random = np.random.default_rng(0)
    multipliers = random.normal(size=(3, 2)) + 1j * random.normal(size=(3, 2))
    multipliers[0] = complex(math.inf, 0.0)
    scalars = {name: random.lognormal(size=3) for name in record.SCALARS}
    scalars["tau"][0] = math.nan
    scalars["tau_half"][:] = math.nan
    return scalars | {
        "half_waves": random.integers(1, 9, 3),
        "stable": np.array([-1, 0, 1], dtype=np.int8),
        "label": np.array(["S13O00+", "U(15)578-", "U21"]),
        "velocities": random.normal(size=(3, 2)),
        "start_u": random.normal(size=(3, 2)),
        "start_v": random.normal(size=(3, 2)),
        "flight_times": random.lognormal(size=(3, 3)),
        "impact_speeds": random.lognormal(size=(3, 2)),
        "multipliers": multipliers,
        "trivial": np.array([math.nan, 1e-14, 1e-13]),
        "pairing": random.lognormal(size=3),
        "reliable": np.array([False, True, True]),
    }


def event():
    """Return an event of a branch, with each kind of value that is null in a file."""
    place = 0.1, 1.7, 0.3, "located", (0.3, 0.3 + 1e-11), 1e-15
    return BranchEvent("RT1", "RT", 1, -2, *place, "S13O00+", None, [1, 3], None, "", None, math.inf)


@given(st.lists(st.tuples(POSITIVE, FINITE, FINITE), min_size=1, max_size=4))
def test_every_float_survives(values):
    """Oracle: the floats themselves, signed zero and subnormals included."""
    points = {name: column[:1].repeat(len(values), axis=0) for name, column in columns().items()}
    points["h"] = np.array([h for h, _, _ in values])
    points["start_v"] = np.array([[first, second] for _, first, second in values])
    back = reading.points_of(json.loads(record.to_json(made_of(points))))
    assert back["h"].tobytes() == points["h"].tobytes()
    assert back["start_v"].tobytes() == points["start_v"].tobytes()


def test_what_is_unbounded_is_null_with_a_note():
    """Oracle: the format: no NaN or Infinity in any file."""
    made = made_of(columns(), [event()])
    text = record.to_json(made)
    assert not re.search(r"NaN|Infinity", text)
    data = json.loads(text)
    assert data["schema"] == 2
    assert data["points"][0]["multipliers"] == [None, None] and "multipliers" in data["points"][0]["note"]
    assert data["points"][0]["tau"] is None and data["points"][0]["stable"] is None
    assert data["points"][1]["note"] is None and data["points"][1]["stable"] is False
    assert data["events"][0]["multiplier"] is None and data["events"][0]["p_q"] == [1, 3]
    assert not re.search(r"nan|inf", record.to_csv(made), re.IGNORECASE)


def test_the_range_and_the_other_pieces_are_kept(tmp_path):
    """Oracle: a fold inside a cut family: its two sides are two pieces; the range comes back, and one that is none is refused."""
    branch = saltus.trace("S11O00-@h=0.075,alpha=0.975", energy=(0.072, 0.08))
    branch.save(tmp_path / "b.json")
    head = json.loads((tmp_path / "b.json").read_text())["branch"]
    assert head["energy"] == [0.072, 0.08] and len(head["others"]) == 1
    assert sorted(head["others"][0][side]["h"] for side in ("from", "to")) == pytest.approx([0.072, 0.08], rel=1e-12)
    back = saltus.read_branch(tmp_path / "b.json")
    assert back.energy == branch.energy and back.others == branch.others
    text = (tmp_path / "b.json").read_text()
    (tmp_path / "b.json").write_text(text.replace('"energy": [0.072, 0.08]', '"energy": [0.072, "x"]'))
    assert "branch.energy[1] is 'x'" in refuse(tmp_path / "b.json")


def test_velocities_without_an_origin_start_are_null():
    """Oracle: the format; the CSV keeps a column for each."""
    points = columns()
    points["velocities"] = np.full((3, 2), math.nan)
    made = made_of(points)
    assert [point["velocities"] for point in record.to_record(made)["points"]] == [None] * 3
    rows = list(csv.DictReader(io.StringIO(record.to_csv(made))))
    assert rows[0]["velocities.1"] == rows[0]["velocities.2"] == ""
    np.testing.assert_array_equal(reading.points_of(record.to_record(made))["velocities"], points["velocities"])


def test_csv_holds_the_numbers_of_the_json():
    """Oracle: the JSON record, name by name."""
    made = made_of(columns(), [event()])
    data = record.to_record(made)
    rows = list(csv.DictReader(io.StringIO(record.to_csv(made))))
    assert len(rows) == len(data["points"])
    for row, point in zip(rows, data["points"], strict=True):
        assert float(row["h"]) == point["h"]
        assert float(row["start.v.2"]) == point["start"]["v"][1]
        assert float(row["flight_times.3"]) == point["flight_times"][2]
        assert row["quality.reliable"] == str(point["quality"]["reliable"]).lower()
        expected = point["multipliers"][1]
        assert row["multipliers.2.im"] == ("" if expected is None else repr(expected[1]))
    assert [row["event"] for row in rows] == ["", "RT1", ""]


def refuse(path):
    """Return the one line that refuses a file."""
    with pytest.raises(RecordError) as caught:
        reading.read_branch(path)
    message = str(caught.value)
    assert "\n" not in message and str(path) in message
    return message


@pytest.fixture
def good(tmp_path):
    """A file of a branch, as text."""
    return record.to_json(made_of(columns(), [event()]))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda data: data.update(schema=3), "schema is 3, expected 2"),
        (lambda data: data.pop("schema"), "lacks 'schema'"),
        (lambda data: data.pop("points"), "lacks 'points'"),
        (lambda data: data["points"][1].pop("alpha"), "points[1] lacks 'alpha'"),
        (lambda data: data["points"][1].update(h="high"), "points[1].h is 'high', expected a number"),
        (lambda data: data["points"][1].update(h=True), "points[1].h is True, expected a number"),
        (lambda data: data["points"][2]["flight_times"].pop(), "points[2].flight_times has 2 entries, expected 3"),
        (lambda data: data["points"][2]["start"]["u"].append(1.0), "points[2].start.u has 3 entries, expected 2"),
        (
            lambda data: [point.update(start={"u": [0.0] * 3, "v": [0.0] * 3}, velocities=None) for point in data["points"]],
            "3 entries, but the system has 2 coordinates",
        ),
        (lambda data: data["branch"].update(sequence="+"), "makes 2 flights"),
        (lambda data: data["branch"].update(pieces=0), "branch.pieces is 0, expected 1 or more"),
        (lambda data: data["points"].clear(), "no points"),
        (lambda data: data["events"][0].update(point=3), "events[0].point is 3, expected 0 to 2"),
        (lambda data: data["ended"].pop(), "ended is [{"),
        (lambda data: data["branch"].update(ends="origin"), "branch.ends is 'origin', expected a list of 2"),
    ],
)
def test_another_content_is_refused_at_its_place(tmp_path, good, change, expected):
    """Oracle: the change that was made."""
    data = json.loads(good)
    change(data)
    path = tmp_path / "branch.json"
    path.write_text(json.dumps(data))
    message = refuse(path)
    assert expected in message and message.startswith(f"{path} is not a readable branch file: ")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        *((lambda text, end=end: text[: int(end * len(text))], "truncated") for end in (0.0, 0.01, 0.5, 0.999)),
        (lambda text: b"\x89PNG\r\n\xff\xfe", "UTF-8"),
        (lambda text: "h,alpha\n1,2\n", "is not JSON"),
        (lambda text: "[1, 2]", "expected an object"),
        (lambda text: text.replace('"schema": 2', '"schema": NaN'), "it holds NaN, which no file of a branch holds"),
        (lambda text: "[" * 100_000, "branch.json"),
        (lambda text: re.sub(r'"h": [^,]+', '"h": 1e999', text, count=1), "points[0].h is inf"),
        *((lambda text, n=n: text.replace('"schema": 2', f'"schema": {"7" * n}'), "branch.json") for n in (400, 4000, 5000)),
    ],
)
def test_other_files_are_refused(tmp_path, good, changed, expected):
    """Oracle: what each file is: a part of a good one, or of another kind; the message is short."""
    path = tmp_path / "branch.json"
    content = changed(good)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert expected in refuse(path) and len(refuse(path)) < len(str(path)) + 250


def test_a_path_that_leads_to_no_file_is_refused(tmp_path):
    """Oracle: what is there: nothing, a directory; a number is no path."""
    assert "no such file" in refuse(tmp_path / "branch.json") and "directory" in refuse(tmp_path)
    with pytest.raises(TypeError, match="received 5, expected the name of a JSON file"):
        reading.read_branch(5)


@pytest.fixture(scope="module")
def traced():
    """A branch as the program makes it."""
    return saltus.trace("S13O00+", energy=(0.05, 1.0))


@pytest.mark.parametrize(
    ("name", "words"), [("h", "its start has the energy {:.12g}"), ("alpha", "its flight_times make {:.12g}")], ids=["h", "alpha"]
)
def test_points_that_contradict_themselves_are_refused(traced, tmp_path, name, words):
    """Oracle: energy of the start, and quarter of the flights' sum, as they were saved before the change."""
    path = tmp_path / "branch.json"
    data = record.to_record(traced)
    right = data["points"][5][name]
    data["points"][5][name] = right * (1.0 + 1e-7)
    path.write_text(json.dumps(data))
    assert refuse(path).endswith(f"points[5].{name} is {right * (1.0 + 1e-7):.12g}, but {words.format(right)}")
    data["points"][5][name] = right * (1.0 + 1e-11)
    path.write_text(json.dumps(data))
    saltus.read_branch(path)


def test_the_record_of_an_orbit(traced):
    """Oracle: the orbit's own values; frequency 2 pi / T."""
    orbit = traced.orbit(5)
    data = json.loads(record.orbit_to_json(orbit))
    assert data["system"] == orbit.system.describe()
    mine, second = data["orbit"], orbit.impacts[1]
    assert mine["frequency"] == 2.0 * math.pi / orbit.period and mine["stable"] is orbit.stable and mine["tau_half"] == orbit.tau_half
    assert mine["velocities"] == orbit.velocities.tolist()
    assert [mine["start"][part] for part in "uv"] == [values[0].tolist() for values in orbit.sample(np.zeros(1))]
    assert mine["impacts"][1] == {"time": second.time, "stop": second.stop, "speed": second.speed}
    (row,) = csv.DictReader(io.StringIO(record.orbit_to_csv(orbit)))
    assert row["impacts.2.stop"] == second.stop and float(row["impacts.2.time"]) == second.time
    assert float(row["multipliers.1.im"]) == orbit.multipliers[0].imag
