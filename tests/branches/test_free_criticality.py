"""Normal forms of free orbits. Oracles: orbits solved in many digits, closed forms, and the families that begin at events."""

from __future__ import annotations

import json
from functools import cache

import mpmath as mp
import numpy as np
import pytest

import saltus
from branches import normal_forms
from branches.curves.free_start import released_of
from branches.forced.tracing import follow_response
from branches.linear_modes import families_at, linear_modes
from branches.reading import branch_of_record, read_branch
from branches.released.criticality import free_criticality, free_criticality_of
from branches.released.switching import switch_released
from branches.switching import emanating_families, switch
from bvp.kernels.hook import interpreted
from bvp.stability import stability
from tests.branches.curve_oracles import DIGITS, ReferenceBackbone, exact
from tests.branches.traced import traced

LINE = ReferenceBackbone()


class ModalOrbit:
    """Orbits of the reference system from u = 0 to u = 0 with some impacts, in modal coordinates and many digits."""

    def __init__(self, sides, line=LINE):
        (w1, b1), (w2, b2) = line.modes
        self.w, self.b, self.sides = (w1, w2), (mp.sqrt(b1), mp.sqrt(b2)), sides

    def conditions(self, v1, v2, *times):
        """The gaps at the impacts less those of the stops, and the displacements at the end."""
        q, v, found = [mp.mpf(0)] * 2, [v1, v2], []
        for time, side in zip(times, (*self.sides, None), strict=True):
            turned = [mp.cos_sin(w * time) for w in self.w]
            q, v = (
                [c * x + s * y / w for x, y, w, (c, s) in zip(q, v, self.w, turned, strict=True)],
                [c * y - s * x * w for x, y, w, (c, s) in zip(q, v, self.w, turned, strict=True)],
            )
            if side is None:
                return [*found, *q]
            found.append(sum(b * x for b, x in zip(self.b, q, strict=True)) - side)
            speed = 2 * sum(b * y for b, y in zip(self.b, v, strict=True)) / sum(b * b for b in self.b)
            v = [y - speed * b for y, b in zip(v, self.b, strict=True)]
        raise AssertionError

    def solved(self, guess, apart):
        """The velocities and times, (2 + k + 1), of the orbit whose first and last flights differ by some time."""
        return mp.findroot(lambda *x: [*self.conditions(*x), x[2] - x[-1] - apart], guess, tol=mp.mpf(10) ** (-2 * DIGITS + 10))


def velocities_of(alpha, line=LINE):
    """Modal velocities at the origin of the orbit with one impact in half a period, which hits the stop at alpha ."""
    speed = 1 / line.half_period_sum(alpha)
    return [mp.sqrt(b) * speed / mp.cos(w * alpha) for w, b in line.modes]


@cache
def many_digit_breaking(alpha, sides, line=LINE):
    """h'' / (2 x'^2) of the orbits that begin where a symmetry of the backbone breaks. sides: of the impacts between two origins."""
    with mp.workdps(DIGITS + 10):
        orbit = ModalOrbit(sides, line)
        times = [alpha, *([2 * alpha] * (len(sides) - 1)), alpha]
        step = mp.mpf(10) ** -10
        middle = [*velocities_of(alpha, line), *times]
        ahead, behind = (orbit.solved(middle, sign * step) for sign in (1, -1))
        energies = [(x[0] ** 2 + x[1] ** 2) / 2 for x in (ahead, behind)]
        half = [(one - other) / 2 for one, other in zip(ahead[:2], behind[:2], strict=True)]
        energy = (middle[0] ** 2 + middle[1] ** 2) / 2
        squared = (half[0] ** 2 + half[1] ** 2) / (2 * energy)
        return float((sum(energies) / 2 - energy) / squared)


def located(branch, code, number=0):
    """An event of a branch, and the orbit there."""
    event = [event for event in branch.events if event.type == code][number]
    return event, branch.orbit(event.point)


def test_breaking_of_the_symmetry_of_a_backbone():
    """Oracle: the broken orbits solved in fifty digits, from a closed form of the symmetric one."""
    event, orbit = located(traced("S13O00+", low=0.2, high=3.0), "SB")
    with mp.workdps(DIGITS):
        alpha = mp.findroot(LINE.breaking_condition, exact(event.alpha))
    wanted = many_digit_breaking(alpha, (1,))
    found = free_criticality(orbit, "SB")
    assert found.kind == "subcritical" and found.error < 1e-12
    assert found.coefficient == pytest.approx(wanted, rel=1e-8)


def test_doubling_of_a_backbone():
    """Oracle: the doubled orbits solved in fifty digits, where tau_half of the closed form vanishes."""
    event, orbit = located(traced("S11O00-", low=0.06, high=0.3), "PD")
    with mp.workdps(DIGITS):
        alpha = mp.findroot(LINE.tau_half, exact(event.alpha))
    wanted = many_digit_breaking(alpha, (1, -1))
    found = free_criticality(orbit, "PD")
    assert found.kind == "supercritical"
    assert found.coefficient == pytest.approx(wanted, rel=1e-8)


def test_fold_of_a_backbone():
    """Oracle: the second derivative of the closed form of the energy."""
    event, orbit = located(traced("S11O00-", low=0.06, high=0.3), "SN")
    with mp.workdps(DIGITS):
        alpha = mp.findroot(LINE.fold_condition, exact(event.alpha))
        energy = LINE.energy(alpha)
        speeds = [mp.diff(lambda at, k=k: velocities_of(at)[k], alpha) for k in (0, 1)]
        length = sum(v * v for v in speeds) / (2 * energy) + 1 / alpha**2
        wanted = float(mp.diff(lambda at: sum(v * v for v in velocities_of(at)) / 2, alpha, 2) / 2 / length)
    found = free_criticality(orbit, "SN")
    assert found.kind is None and found.coefficient == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize(("label", "code"), [("S13O00+", "SB"), ("S11O00-", "PD")])
def test_family_in_a_parameter(label, code):
    """Oracle: the orbits that begin are a surface over the energy and the parameter, so that the ratio of the coefficients
    is the slope of the curve of events, which a closed form has."""
    event, orbit = located(traced(label, low=0.06, high=3.0), code)
    problem, y = released_of(orbit, ("mu",))
    in_parameter, in_energy = free_criticality_of(problem, y, code), free_criticality(orbit, code)

    def energy(mu):
        line = ReferenceBackbone(mu=mu)
        condition = line.breaking_condition if code == "SB" else line.tau_half
        return line.energy(mp.findroot(condition, exact(event.alpha)))

    with mp.workdps(DIGITS):
        step = mp.mpf(10) ** -12
        slope = float((energy(mp.mpf("0.1") + step) - energy(mp.mpf("0.1") - step)) / (2 * step))
    assert in_parameter.coefficient == pytest.approx(-in_energy.coefficient / slope, rel=1e-7)
    assert in_parameter.kind == in_energy.kind


def chain_family():
    """A family of three masses that starts at a linear mode."""
    chain = saltus.load_scene("three_mass_chain").system
    found = families_at(linear_modes(chain)[0], 1, 1, energy=(0.05, 0.5))
    return next(one.branch for one in found if any(event.type == "PD" for event in one.branch.events))


FAMILIES = {
    "S13O00+": lambda: traced("S13O00+", low=0.2, high=3.0),
    "S11O00-": lambda: traced("S11O00-", low=0.06, high=0.3),
    "S31O11+": lambda: traced("S31O11+", low=0.05, high=20.0),
    "U2111-": lambda: traced("U2111-", low=0.05, high=50.0),
    "U21-": lambda: traced("U21-", low=0.05, high=50.0),
    "U8353-": lambda: traced("U8353-", low=0.5, high=5.0),
    "three masses": chain_family,
}
EXPECTED = {
    "S13O00+": {"SB1": "subcritical"},
    "S11O00-": {"PD1": "supercritical"},
    "S31O11+": {"PD1": "subcritical", "SB1": "supercritical"},
    "U2111-": {"PD1": "supercritical", "PD2": "supercritical"},
    "U21-": {"SB1": "subcritical", "SB2": "subcritical"},
    "U8353-": {},
    "three masses": {"PD1": "supercritical"},
}


@pytest.mark.parametrize("name", FAMILIES)
def test_families_that_begin(name):
    """Oracle: the first orbits of the families that begin: whether their energy is above that of the event, and whether they are stable."""
    check(FAMILIES[name](), EXPECTED[name])


def check(branch, expected):
    """Compare all SB and PD of a family with the families that begin there."""
    found = {}
    for event in branch.events:
        if event.type not in ("SB", "PD"):
            continue
        known = free_criticality(branch.orbit(event.point), event.type)
        found[event.id] = known.kind
        families = emanating_families(branch, event)
        stable = [stability(one.problem, one.step.extra).stable for one in families]
        assert (known.kind == "supercritical") is any(stable), event.id
        assert (families[0].step.parameter > event.h) is (known.coefficient > 0.0), event.id
        for other in families[1:] if branch.problem.quarters == 1 and event.type == "PD" else ():
            assert ((other.step.parameter - event.h) * known.coefficient > 0.0) is (known.kind == "supercritical")
    assert found == expected


def test_what_has_no_normal_form():
    branch = traced("S13O00+", low=0.2, high=3.0)
    closed = switch(traced("U21-", low=0.05, high=50.0), "SB1", energy=(0.05, 50.0))[0]
    assert closed.problem.periodic
    assert free_criticality(closed.orbit(1), "SB") is free_criticality(closed.orbit(1), "PD") is None
    event, orbit = located(branch, "SB")
    with pytest.raises(ValueError, match="a normal form of SN, SB, PD is known; received RT"):
        free_criticality(orbit, "RT")
    assert free_criticality(orbit, "PD") is None
    assert free_criticality(orbit, "SN") is None
    assert free_criticality(branch.orbit(event.point + 3), "SB") is None


def test_events_of_a_branch_have_their_normal_form(tmp_path):
    """Oracle: `free_criticality` at each event; a file keeps it, and one without it can be read."""
    reported = []
    branch = saltus.trace("S31O11+", energy=(0.05, 20.0), normal_forms=True, on_event=reported.append)
    assert branch.id == traced("S31O11+", low=0.05, high=20.0).id
    for event in branch.events:
        known = free_criticality(branch.orbit(event.point), event.type) if event.type in ("SN", "SB", "PD") else None
        assert (event.criticality, event.coefficient is None) == (known and known.kind, known is None)
        if known is not None:
            assert event.coefficient == pytest.approx(known.coefficient, rel=1e-6)
    shown = {event.type: event.normal_form for event in reported}
    assert shown["SB"] == "supercritical 1039" and shown["PD"] == "subcritical -1184" and shown["SN"] == "0.176" and not shown["GR"]
    branch.save(tmp_path / "a.json")
    assert [event.normal_form for event in read_branch(tmp_path / "a.json").events] == [event.normal_form for event in branch.events]
    record = json.loads((tmp_path / "a.json").read_text())
    for event in record["events"]:
        del event["coefficient"], event["criticality"]
    assert not any(event.normal_form for event in branch_of_record(record).events)
    stepped = saltus.trace("S31O11+", energy=(0.1, 10.0), normal_forms=True, points=2000)
    assert [event.criticality for event in stepped.events if event.type in ("PD", "SB")] == ["subcritical", "supercritical"]


@pytest.mark.parametrize("options", [{}, {"points": 80}])
def test_few_normal_forms_are_computed_without_compiling(options, monkeypatch):
    """Oracle: by hand. With a limit of points, events are reported while the family is followed."""
    asked, events = [], []

    def recorded(wanted):
        asked.append(wanted)
        return interpreted(False)

    monkeypatch.setattr(normal_forms, "interpreted", recorded)
    saltus.trace("S13O00+", energy=(0.14, 1.0), normal_forms=True, on_event=events.append, **options)
    assert [event.criticality for event in events if event.type == "SB"] == ["subcritical"] and asked == [True]
    monkeypatch.setattr(normal_forms, "_FEW", 0)
    saltus.trace("S13O00+", energy=(0.14, 1.0), normal_forms=True, on_event=events.append, **options)
    assert asked == [True, False]


def test_family_in_a_parameter_reports_its_normal_forms():
    """Oracle: the coefficient at the event."""
    problem, y = released_of(traced("S13O00+", low=0.2, high=3.0).orbit_at(energy=0.5), ("mu",))
    branch = follow_response(problem, y, (0.09, 0.12))
    event = next(event for event in branch.events if event.type == "SB")
    known = free_criticality_of(problem, branch.unknowns[event.point], "SB")
    assert known.kind == event.criticality == "subcritical" and event.coefficient == pytest.approx(known.coefficient)


@pytest.mark.parametrize("alpha", [1.7, 1.73])
def test_a_symmetry_that_breaks_at_a_constant_parameter_is_degenerate(alpha):
    """At fixed duration the flight from impact to impact is linear, and where it is singular orbits of any size begin: their family is
    vertical in sigma. Oracle: an orbit at a finite distance from the event solves the equations at the same sigma."""
    family = traced("S13O00+", low=0.2, high=3.0)
    near = family.orbit(int(np.argmin(np.abs(family.points["alpha"] - alpha))))
    plain, y = released_of(near, ("sigma",))
    problem = plain.sibling(plain.sequence, keep=[f"quarter_period = {alpha}"])
    branch = follow_response(problem, y, (0.0, 0.3))
    event = next(event for event in branch.events if event.type == "SB" and "the far end stays" in event.note)
    assert event.criticality == event.normal_form == "degenerate"
    wide, begin = switch_released(branch, event)[0]
    beside = follow_response(wide, begin, (0.0, 0.3), points=12)
    assert np.ptp(beside.unknowns[:, 1]) > 1e-2 and np.ptp(beside.parameter) < 1e-10
