"""docs/reference/paper_damped.md: each number of the columns that are ours is computed here, and compared to the digits that are printed.

Oracle: saltus, for the page; what the paper says stands beside it and is not tested."""

import math
from dataclasses import dataclass
from functools import cache, cached_property

import pytest

import saltus
from branches.building.build import build
from branches.building.plan import Bounds, BuildPlan
from branches.catalogue import Catalogue
from bvp.motion import Motion
from bvp.simulate import simulate
from saltus.commands.gallery import load_gallery
from saltus.processes import open_executor
from tests.branches.paper_names import NAMES, SYSTEM, family
from tests.branches.traced import traced
from tests.docs.pages import compare, page, table
from transitions.families import Families, families_of
from transitions.record import sampled
from transitions.sharing import Sharing, sharing_of
from transitions.stage import Stage
from transitions.stages import stages_of

PAGE = page("paper_damped.md")
GAP = (1.0, -1.0)
DURATION = 400.0
FAMILIES: list[Families] = []


@cache
def named_families():
    """The families that the paper names."""
    return families_of([family(name) for name in NAMES], GAP)


@pytest.fixture(scope="module", autouse=True)
def all_families(tmp_path_factory):
    """What stages are named by: all families with up to two impacts in half a period and a quarter period up to 4, and those that the paper
    names."""
    path = tmp_path_factory.mktemp("few") / "few.sqlite"
    with open_executor(2) as (executor, workers), Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        build(catalogue, BuildPlan.within(Bounds((0.05, 100.0), 4.0, 2)), executor, workers)
    with Catalogue(path) as catalogue:
        few = families_of(catalogue, GAP)
        ids = {item.id for item in few.members}
        FAMILIES.append(Families((*few.members, *(item for item in named_families().members if item.id not in ids)), few.gap))
        yield
        FAMILIES.clear()


@dataclass(frozen=True, eq=False)
class Damped:
    """A damped motion with what the page says of it; shares are in % of the initial energy."""

    motion: Motion
    sharing: Sharing

    def mark(self, fraction):
        """Time, and shares of NES and LO, when a fraction is gone."""
        mark = next(mark for mark in self.motion.marks if mark.fraction == fraction)
        return mark.time, *self._shares(mark.dissipated)

    def shares(self, time=None):
        """Shares of NES and LO up to a time."""
        if time is None:
            return self._shares(self.motion.dissipated)
        return self._shares(dict(zip(self.motion.parts, self.motion.spent([time])[0, :-1].tolist(), strict=True)))

    def _shares(self, dissipated):
        nes, lo = self.sharing.totals(dissipated)
        return 100.0 * nes / self.motion.initial_energy, 100.0 * lo / self.motion.initial_energy

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Its stages, named by all families that there are here."""
        return self.reported(FAMILIES[0])

    def reported(self, families) -> tuple[Stage, ...]:
        """Its stages, named by these families."""
        record = sampled(self.motion, self.sharing)
        return tuple(stages_of(record, GAP, families))


@cache
def damped(v1, v2, lam=0.01, rho=0.7, duration=DURATION):
    """The motion from no displacement and these velocities."""
    system = saltus.vibro_impact_nes(lam=lam, rho=rho)
    shared = sharing_of(system, nes=(0,), lo=(1,))
    motion = simulate(system, [0.0, 0.0], [v1, v2], duration, dampers=shared.dampers)
    assert motion.balance_error < 1e-12
    return Damped(motion, shared)


def on(name, h):
    """The motion from the orbit of a backbone at an energy."""
    (orbit,) = traced(name).orbits_at(energy=h)
    return damped(*(float(v) for v in orbit.velocities))


def struck(h, **options):
    """The motion from an impulsive start."""
    return damped(0.0, math.sqrt(2.0 * h), **options)


def impulsive(name):
    """Energy of the impulsive orbit of a family."""
    h, *others = (e.h for e in family(name).events if e.type == "IO")
    assert others == pytest.approx([h] * len(others), rel=1e-9)
    return h


def follows(stage):
    """Harmonics, that of the ridge first, and label or family of what a stage follows, None where it follows no family."""
    if stage.follows is None:
        return None
    own = stage.follows.harmonic
    return (own, *(k for k in stage.follows.harmonics if k != own), stage.follows.label or stage.follows.family)


ONE = "rest-stop+::87c63b1c"
"""One impact a period, at one of the two stops."""

HALF = "rest-stop+::2c49f5ff"
"""The same with a period twice as long."""


ROWS = {}


def row(number):
    """Register what computes a row."""
    return lambda compute: ROWS.setdefault(number, compute)


@row(1)
def in_phase_shares():
    time, nes, lo = on("S13O00+", 10.0).mark(0.85)
    return [85, time, lo, nes, 40 - lo, nes - 45]


@row(2)
def in_phase_stage_a():
    motion = on("S13O00+", 10.0)
    first, second, third, after = motion.stages[:4]
    reported = [follows(stage) for stage in (first, second, third, after)]
    assert reported == [(1, "S11E11+"), (1, 3, "S11E11+"), (1, 3, "S13O00+"), (1, "S13O00+")] and first.start == 0.0
    nes, lo = motion.shares(third.end)
    return [1, 1, 1, first.end, 3, second.end, third.end, nes + lo, lo, nes, nes + lo - 85]


@row(3)
def in_phase_stage_b():
    pure = on("S13O00+", 10.0).stages[3]
    breaking = next(e.h for e in traced("S13O00+").events if e.type == "SB")
    return [pure.start, pure.end, *pure.energies[::-1], breaking]


@row(4)
def in_phase_stage_c():
    fifth, sixth = on("S13O00+", 10.0).stages[4:6]
    assert follows(fifth) == (1, ONE) and follows(sixth) == (2, HALF)
    return [fifth.start, fifth.end, 1, sixth.end, 2]


@row(5)
def in_phase_stage_d():
    motion = on("S13O00+", 10.0)
    last = motion.stages[6]
    assert len(motion.stages) == 7 and follows(last) == (1, "L11+")
    return [motion.motion.last_impact, last.start]


@row(6)
def out_of_phase_impacts():
    (orbit,) = traced("S11O00-").orbits_at(energy=0.8)
    motion = on("S11O00-", 0.8)
    assert motion.motion.clear_from is not None
    last = motion.motion.last_impact
    nes, lo = motion.shares(last)
    return [motion.motion.impacts, last, nes + lo, nes, 0.1 * orbit.velocities[0] ** 2 / (2.0 * orbit.h), nes + lo - 90, 90]


@row(7)
def out_of_phase_stages():
    first, second = on("S11O00-", 0.8).stages
    assert follows(first) is None and follows(second) == (1, "L11-")
    return [first.end]


@row(8)
def lowest_regime():
    motion = struck(0.07)
    assert motion.motion.clear_from is not None
    out = [0.07, motion.motion.impacts, motion.motion.last_impact, motion.shares()[0], DURATION, motion.shares()[1]]
    return out + [0.06, struck(0.06).shares()[0], 0.08, struck(0.08).shares()[0]]


@row(9)
def lowest_regime_stages():
    first, second = struck(0.07).stages
    assert follows(first) == (1, "L11-") and follows(second) == (1, "L11+")
    return [first.start, first.end]


@row(10)
def second_regime_shares():
    h = impulsive("S95E22-")
    time, nes, lo = struck(h).mark(0.5)
    return [h, 50, time, nes, lo, 33 - nes]


@row(11)
def second_regime_stages():
    motion = struck(impulsive("S95E22-"))
    first, second, third, last = motion.stages
    assert [follows(stage) for stage in (first, second, third, last)] == [(1, ONE), (2, HALF), None, (1, "L11+")]
    alone = motion.reported(families_of([family("S95E22-")], GAP))[0]
    assert follows(alone) == (5, "S55E22+") and "S55E22+" in {alias["label"] for alias in family("S95E22-").aliases}
    named = motion.reported(named_families())
    assert [follows(stage) for stage in named[:3]] == [(4, 7, "U4421+"), (4, "U4421+"), (2, 3, "U2201+")]
    for one, other in (("U4421+", "U5421-"), ("U2201+", "U3201-")):
        assert family(one).id == family(other).id
    out = [first.start, first.end, 1, second.end, 2, third.end, motion.motion.last_impact]
    return [*out, 4, named[1].end, 2, named[2].end, 5, alone.end]


@row(12)
def third_regime_shares():
    h = impulsive("S31O11-")
    motion = struck(h)
    first = motion.stages[0]
    assert follows(first) == (1, "S13O00+")
    nes, _ = motion.shares(first.end)
    return [h, first.end, nes, 85, motion.mark(0.85)[1], nes - 50]


@row(13)
def third_regime_stages():
    motion = struck(impulsive("S31O11-"))
    first, second, last = motion.stages
    assert follows(second) == (2, HALF) and follows(last) == (1, "L11+")
    alone = motion.reported(families_of([family("S31O11-")], GAP))[0]
    assert follows(alone) == (1, 3, "S31O11+")
    return [first.start, first.end, 2, second.end, motion.motion.last_impact, 1, 3, alone.end]


@row(14)
def highest_regime():
    h = impulsive("U4122-")
    assert h > impulsive("S31O11-")
    motion = struck(h)
    first, second, third, fourth, last = motion.stages
    reported = [follows(stage) for stage in (first, second, third, fourth, last)]
    assert reported == [(1, 3, "S13O00+"), (1, "S13O00+"), (1, ONE), (2, HALF), (1, "L11+")]
    out = [h, first.end, second.end, motion.shares(second.end)[0], third.end, motion.shares(third.end)[0], fourth.end]
    out += [DURATION, motion.shares()[0]]
    for other in (10.0, 20.0, 100.0):
        out += [other, struck(other).shares()[0]]
    return out


@row(15)
def impacts_alone():
    motion = struck(impulsive("U8344-"), lam=0.0)
    first, second, third = motion.stages
    nes, lo = motion.shares()
    assert [follows(stage) for stage in (first, second, third)] == [(1, "S13O00+"), (1, ONE), (2, HALF)] and lo == 0.0
    later = struck(impulsive("U8344-"), lam=0.0, duration=2000.0).motion
    left = 100.0 * later.energy / later.initial_energy
    return [impulsive("U8344-"), first.start, first.end, second.end, 1, 2, DURATION, nes, later.last_impact, later.duration, left]


@row(16)
def damping_alone():
    motion = struck(impulsive("U8344-"), rho=1.0)
    first, second, third = motion.stages[:3]
    nes, lo = motion.shares()
    assert [follows(stage) for stage in (first, second, third)] == [(8, "U8344-"), (8, 3, "U8344-"), None] and nes == 0.0
    later = struck(impulsive("U8344-"), rho=1.0, duration=1000.0)
    last = later.stages[-1]
    assert follows(last) == (1, "L11+")
    return [DURATION, lo, 8, 3, second.end, later.motion.impacts, later.motion.last_impact, last.start]


@row(17)
def impacts_and_damping():
    motion = struck(impulsive("U8344-"))
    first, second, third, last = motion.stages
    assert [follows(stage) for stage in (first, second, third, last)] == [(1, "S13O00+"), (2, 3, HALF), None, (1, "L11+")]
    nes, lo = motion.shares()
    return [first.start, first.end, second.end, 2, 3, nes, lo, DURATION, motion.motion.last_impact, last.start]


@pytest.mark.parametrize("cells", table(PAGE, "Statements"), ids=lambda cells: f"{cells[0]}: {cells[2][:40]}")
def test_statements(cells):
    """Oracle: the functions above."""
    compare(f"{cells[3]} {cells[4]}", ROWS[int(cells[0])]())


def test_the_table_is_whole():
    """Oracle: the functions above, and the gallery: each of its damped figures has a row, and is the motion of the row."""
    rows = table(PAGE, "Statements")
    assert [int(cells[0]) for cells in rows] == sorted(ROWS)
    figures = {name: figure["words"] for name, figure in load_gallery("paper")["figures"].items() if figure["words"][0] == "run"}
    # Fig. 2 has no numbers. Close-ups and empirical modes are of the motion of Fig. 14.
    whole = " ".join(figures["fig14"])
    assert all(" ".join(figures.pop(name)).startswith(whole) for name in [name for name in figures if name[:5] in ("fig15", "modes")])
    del figures["fig2"]
    assert {cells[1] for cells in rows} == {name[3:] for name in figures}
    for words in figures.values():
        assert "--duration 400" in " ".join(words)
    assert SYSTEM.describe() == saltus.vibro_impact_nes().describe()
