"""`saltus export` from end to end: pictures, data, a picture from data, bad input."""

import json

import numpy as np
import pytest

from branches.figures.atlas import atlas_figure
from branches.figures.data import read_atlas
from tests.branches import atlas_families as real
from tests.branches.catalogue.families import real as families
from tests.saltus.running import reported


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files of six families."""
    path = tmp_path_factory.mktemp("families")
    for k, branch in enumerate(real.families()[:6]):
        branch.save(path / f"{k}.json")
    return path


@pytest.mark.parametrize(("what", "options"), [("velocities", "--names 3")])
def test_a_picture_and_the_same_from_its_data(folder, what, options):
    """Oracle: see `require_a_picture_and_the_same_from_its_data`."""
    require_a_picture_and_the_same_from_its_data(folder, what, options)


def require_a_picture_and_the_same_from_its_data(folder, what, options):
    """Oracle: the bytes of both."""
    families = " ".join(str(folder / f"{k}.json") for k in range(6))
    scale = "--clearance 0.5 --natural-frequency 2"
    for words in (
        f"export {what} --plot {folder}/a.svg --branches {families} --energy 0.06:40 {scale} {options.replace('0.1:0.2', '0.1:0.2')}",
        f"export {what} --npz {folder}/a.npz --branches {families} --energy 0.06:40 {scale}",
        f"export {what} --plot {folder}/b.svg --data {folder}/a.npz {options}",
    ):
        code, out, err = reported(words)
        assert code == 0 and not err and out.startswith("wrote")
    assert (folder / "a.svg").read_bytes() == (folder / "b.svg").read_bytes()


def test_regimes_and_impulsive_motions(folder):
    """Oracle: the data; a note names what the given families do not show."""
    code, out, err = reported(
        f"export fep --csv {folder}/r.csv --branches {folder}/0.json {folder}/1.json --energy 0.06:0.6 --regimes --impulsive "
        "--max-quarter-period 2"
    )
    text = (folder / "r.csv").read_text()
    assert code == 0 and "no bound III/IV" in out and not err
    assert text.count("\nmanifold,") == 101 and text.count("\nimpulsive,") == 1 and '"below": "II"' in text.splitlines()[0]


@pytest.mark.parametrize("what", ["fep", "velocities"])
@pytest.mark.parametrize("filters", ["--label S*", "--energy 0.5 --stable --label S13+", ""])
def test_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters):
    """Oracle: see `require_pictures_take_the_filters_of_list`."""
    require_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters)


def require_pictures_take_the_filters_of_list(catalogue, tmp_path, what, filters):
    """Oracle: the ids that `saltus list` gives for the same words, from a catalogue and from files of the same families."""
    _, out, _ = reported(f"list --catalogue {catalogue} --json - {filters}")
    expected = {family["id"] for family in json.loads(out)["families"]}
    files = [tmp_path / f"{k}.json" for k in range(len(families()))]
    for branch, file in zip(families(), files, strict=True):
        branch.save(file)
    for source in (f"--catalogue {catalogue}", f"--branches {' '.join(map(str, files))}"):
        code, _, err = reported(f"export {what} {source} --json {tmp_path}/a.json {filters}")
        assert code == 0, err
        columns = json.loads((tmp_path / "a.json").read_text())["columns"]
        assert set(columns["family"]) == expected


def test_families_without_start_velocities(tmp_path):
    """Oracle: the ends; a family between a rest and a stop never passes the origin."""
    from branches.linear_modes import families_at, linear_modes

    begun = next(met for met in families_at(linear_modes(real.SYSTEM)[0], 1, 1, points=20) if "origin" not in met.ends)
    begun.branch.save(tmp_path / "rest.json")
    code, _, err = reported(f"export velocities --branches {tmp_path}/rest.json --plot {tmp_path}/a.png")
    assert code == 2 and "where no orbit of these families starts" in err and err.count("\n") == 1


def test_regimes_are_reported_by_all_families(catalogue, tmp_path):
    """Oracle: the symmetry breaking of S13O00+, which the filter leaves out."""
    code, out, _ = reported(f"export fep --catalogue {catalogue} --csv {tmp_path}/a.csv --label S11- --regimes")
    text = (tmp_path / "a.csv").read_text()
    assert code == 0 and '"what": "SB of S13+"' in text and "S13O00+" not in text and "no bound III/IV" in out


def test_named_families_alone(folder, tmp_path):
    """Oracle: lee2009, which names two of the six families; none of others."""
    families = " ".join(str(folder / f"{k}.json") for k in range(6))
    code, _, err = reported(f"export fep --branches {families} --named --json {tmp_path}/a.json")
    columns = json.loads((tmp_path / "a.json").read_text())["columns"]
    ids = {f"{folder}/{k}.json": json.loads((folder / f"{k}.json").read_text())["branch"]["id"] for k in range(6)}
    assert code == 0 and not err and {*columns["family"]} < {*ids.values()}
    assert {name for name, cited in zip(columns["name"], columns["cited"], strict=True) if cited} >= {"S13+", "S11-"}
    for id in {*columns["family"]}:
        assert any(cited for family, cited in zip(columns["family"], columns["cited"], strict=True) if family == id)
    others = [path for path, id in ids.items() if id not in columns["family"]]
    code, out, err = reported(f"export fep --branches {' '.join(others)} --named --csv {tmp_path}/b.csv")
    assert code == 2 and not out and "no family here has a name of the scene" in err and err.count("\n") == 1


def test_stars_of_impulsive_orbits_do_not_overlap(folder, tmp_path):
    """Oracles: the data, which have all of them; on the page the stars are apart, and each that is left out is near one that is drawn,
    whose period is no longer."""
    words = f"export fep --branches {folder}/0.json --energy 8:20 --impulsive --json {tmp_path}/a.json"
    assert reported(words)[0] == 0
    atlas = read_atlas(tmp_path / "a.json")
    figure = atlas_figure(atlas)
    (line,) = figure.findobj(lambda artist: artist.get_gid() == "frequency-impulsive")
    axes = figure.axes[0]

    def page(points):
        return axes.transData.transform(np.asarray(points)) * 72.0 / figure.dpi

    drawn, found = page(line.get_xydata()), page(np.stack([atlas.impulsive.h, atlas.impulsive.frequency_index], axis=1))
    apart = np.hypot(*(drawn[:, None] - drawn[None]).T) + 1e9 * np.eye(len(drawn))
    assert 10 < len(drawn) < 0.8 * len(found) and apart.min() >= 9.0
    far = np.hypot(*(found[:, None] - drawn[None]).transpose(2, 0, 1))
    assert far.min(axis=1).max() < 9.0
    alpha = atlas.impulsive.alpha
    own = far.argmin(axis=0)  # the orbit of each star
    assert all(alpha[own[near]].min() <= alpha[orbit] * (1.0 + 1e-12) for orbit, near in enumerate(far < 9.0))


def test_the_names_of_the_scene_come_first(folder, tmp_path):
    """Oracle: lee2009, which names both backbones without a point, and the labels of the families."""
    code, _, err = reported(f"export fep --branches {folder}/0.json {folder}/1.json --json {tmp_path}/a.json")
    assert code == 0, err
    columns = json.loads((tmp_path / "a.json").read_text())["columns"]
    names = {(name, label) for name, label, cited in zip(columns["name"], columns["label"], columns["cited"], strict=True) if cited}
    assert names == {("S13+", "S13O00+"), ("S11-", "S11O00-")}
