"""Plans of studies and their blocks on disk."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from transitions.study.plan import Axis, StudyPlan
from transitions.study.runs import block_columns
from transitions.study.study import DamagedBlock, ForeignBlock, Study, bins_of, block_path, read_block, write_block, write_plan

SYSTEM = {"model": "vibro_impact_nes", "mu": 0.1, "sigma": 0.1, "lam": 0.01, "rho": 0.7}


def plan_of(axes, **more):
    return StudyPlan(**{"system": SYSTEM, "nes": (0,), "lo": (1,), "axes": tuple(axes), "fixed": {}, "design": "grid", **more})


def study_of(folder, plan, **results):
    """A finished study on disk: the plan's own parameters, zero for each result that is not given."""
    columns = {name: np.zeros(plan.count) for name in block_columns(plan)}
    columns |= {f"given.{name}": values for name, values in plan.values(0, plan.count).items()}
    write_plan(folder, plan, "npz", "0")
    write_block(block_path(folder, 0, "npz"), columns | results, plan.digest, 0)
    return Study(folder)


def test_a_grid_has_every_combination_once_the_last_axis_fastest():
    """Oracle: itertools.product."""
    import itertools

    energy = Axis("energy", low=0.1, high=10.0, scale="log", points=3)
    axes = [energy, Axis("family", values=("A", "B")), Axis("rho", values=(0.5, 0.6, 0.9))]
    plan = plan_of(axes)
    found = plan.values(0, plan.count)
    expected = list(itertools.product((0.1, 1.0, 10.0), (0, 1), (0.5, 0.6, 0.9)))
    assert np.array(list(found.values())).T == pytest.approx(np.array(expected)) and plan.count == 18
    assert np.array_equal(plan.values(5, 9)["rho"], found["rho"][5:9])
    assert found["energy"].min() == 0.1 and found["energy"].max() == 10.0


@settings(max_examples=30)
@given(runs=st.integers(2, 200), seed=st.integers(0, 2**32 - 1))
def test_a_hypercube_has_one_run_in_each_part_of_each_axis(runs, seed):
    """Oracle: the definition of a Latin hypercube, on a linear and on a logarithmic scale."""
    axes = [Axis("rho", low=0.2, high=0.9), Axis("energy", low=0.01, high=100.0, scale="log")]
    values = plan_of(axes, design="hypercube", runs=runs, seed=seed).values(0, runs)
    parts = [(values["rho"] - 0.2) / 0.7, np.log(values["energy"] / 0.01) / np.log(1e4)]
    for part in parts:
        assert sorted(np.clip(np.floor(part * runs + 1e-9), 0, runs - 1)) == pytest.approx(range(runs), abs=1)
        assert np.unique(part).size == runs
    again = plan_of(axes, design="hypercube", runs=runs, seed=seed)
    assert all(np.array_equal(values[name], again.values(0, runs)[name]) for name in values)


def test_a_hypercube_shares_listed_values_equally():
    """Oracle: counts that differ by one at most."""
    plan = plan_of([Axis("family", values=("A", "B", "C")), Axis("mu", values=(0.1, 0.2))], design="hypercube", runs=100)
    values = plan.values(0, 100)
    assert np.ptp(np.bincount(values["family"].astype(int))) <= 1 and np.ptp(np.unique(values["mu"], return_counts=True)[1]) == 0


def test_a_plan_is_known_by_its_digest_and_read_back():
    """Oracle: equality; every field changes it, but for the title."""
    plan = plan_of([Axis("energy", low=0.1, high=1.0, points=3)], title="one")
    assert StudyPlan.from_plain(json.loads(json.dumps(plan.plain()))) == plan
    assert plan_of(plan.axes, title="two").digest == plan.digest
    for change in ({"until": 3.0}, {"block": 7}, {"units": "physical"}, {"fixed": {"clearance": 2.0}}, {"system": {**SYSTEM, "mu": 0.2}}):
        assert plan_of(plan.axes, **change).digest != plan.digest


COLUMNS = {"given.energy": np.linspace(0.1, 1.0, 50), "impacts": np.arange(50, dtype=np.int32), "ended": np.zeros(50, dtype=np.int8),
           "time_90": np.where(np.arange(50) % 3, np.nan, 1.5)}  # fmt: skip


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_a_block_is_read_back_and_every_damage_found(tmp_path, kind):
    """Oracle: the columns, bit for bit; a file with any one byte changed gives the same numbers or is refused; so does one cut short."""
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    path = block_path(tmp_path, 3, kind)
    write_block(path, COLUMNS, "abc", 3)
    for name, values in read_block(path, "abc", 3, 50).items():
        assert np.array_equal(values, COLUMNS[name], equal_nan=True) and values.dtype == COLUMNS[name].dtype
    whole = path.read_bytes()
    refused = 0
    for at in range(0, len(whole), 7):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x40]) + whole[at + 1 :])
        try:
            found = read_block(path, "abc", 3, 50)
        except (DamagedBlock, ForeignBlock):
            refused += 1
        else:
            assert all(np.array_equal(found[name], values, equal_nan=True) for name, values in COLUMNS.items())
    assert refused > 0.6 * len(whole) / 7
    for length in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DamagedBlock, match="block-000003"):
            read_block(path, "abc", 3, 50)


def test_a_block_of_something_else_is_refused(tmp_path):
    """Oracle: another study, another number, another length."""
    path = block_path(tmp_path, 0, "npz")
    write_block(path, COLUMNS, "abc", 0)
    with pytest.raises(ForeignBlock, match="another study"):
        read_block(path, "abd", 0, 50)
    with pytest.raises(DamagedBlock, match="block 0"):
        read_block(path, "abc", 1, 50)
    with pytest.raises(DamagedBlock, match="not 49 runs"):
        read_block(path, "abc", 0, 49)


@pytest.mark.parametrize("best", [0, 5])
def test_runs_at_the_place_of_the_best_one_are_about_it_and_itself_is_not(tmp_path, best):
    """Oracle: by hand: half of the runs of a listed parameter have the best one's value, and come first."""
    plan = plan_of([Axis("rho", values=(0.5, 0.7))], design="hypercube", runs=8, seed=1)
    rho = plan.values(0, 8)["rho"]
    found = study_of(tmp_path, plan, nes_share=np.eye(8)[best]).best("nes_share")
    same = [run for run in np.flatnonzero(rho == rho[best]).tolist() if run != best]
    assert found.run == best and len(same) == 3 and found.neighbours.tolist() == same


def test_of_runs_that_are_best_to_rounding_the_first_counts(tmp_path):
    """Oracle: by hand."""
    plan = plan_of([Axis("rho", low=0.5, high=0.9, points=4)])
    for k, shares in enumerate(([0.3, 1.0, 1.0 + 3e-16, 1.0 - 2e-16], [np.nan, 1.0 - 2e-16, 1.0, 1.0 + 3e-16])):
        (tmp_path / str(k)).mkdir()
        assert study_of(tmp_path / str(k), plan, nes_share=np.array(shares)).best().run == 1


def test_cells_of_a_map_have_full_size_at_its_borders(tmp_path):
    """Oracle: by hand: half-way between the values of a grid, on the axis's scale, and as far beyond the first and the last."""
    axes = [Axis("energy", low=0.1, high=10.0, scale="log", points=3), Axis("rho", low=0.0, high=1.0, points=3), Axis("mu", values=(0.2,))]
    study = study_of(tmp_path, plan_of(axes))
    energy, rho, mu = (bins_of(study, axis, 5) for axis in axes)
    assert energy.edges == pytest.approx([np.sqrt(1e-3), np.sqrt(0.1), np.sqrt(10.0), np.sqrt(1e3)], rel=1e-14)
    assert rho.edges.tolist() == [-0.25, 0.25, 0.75, 1.25]
    assert mu.edges == pytest.approx([0.19, 0.21], rel=1e-15)
    assert energy.which.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2] and rho.which.tolist() == [0, 1, 2] * 3


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_bins_of_a_hypercube_end_where_the_parameter_does(tmp_path, scale):
    """Oracle: the range itself."""
    axis = Axis("energy", low=0.3, high=7.0, scale=scale)
    study = study_of(tmp_path, plan_of([axis], design="hypercube", runs=50, seed=1))
    bins, given = bins_of(study, axis, 5), study.given["energy"]
    assert (bins.edges[0], bins.edges[-1]) == (0.3, 7.0)
    assert np.all((bins.edges[bins.which] <= given) & (given <= bins.edges[bins.which + 1]))
    assert np.bincount(bins.which).tolist() == [10] * 5
