"""Poincare sections. Oracles: closed forms of linear and of uncoupled motion, fifty digits, dense sampling, periodic orbits of a family."""

import math

import mpmath
import numpy as np
import pytest

import saltus
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.traced import traced
from transitions import kernels
from transitions.section import section as section_module
from transitions.section.plane import SectionPlane
from transitions.section.rotation import return_map
from transitions.section.section import SectionEnd, follow_crossings, section


def uncoupled(stiffness=0.0, coordinates=("a", "b"), order=(0, 1)):
    """A mass between two walls at -1 and 1 beside an oscillator of frequency 1 that it does not feel; the oscillator is the primary."""
    free, primary = order
    matrix = np.zeros((2, 2))
    matrix[free, free], matrix[primary, primary] = stiffness, 1.0
    gap = [0.0, 0.0]
    gap[free] = 1.0
    return ImpactSystem(np.eye(2), np.zeros((2, 2)), matrix, (Stop(tuple(gap), -1.0, 1.0),), coordinates, free, primary)


def coupled_masses(seed=3):
    """Two degrees of freedom whose mass and stiffness matrices are full, and whose two-sided stop is not symmetric."""
    rng = np.random.default_rng(seed)
    mass = np.array([[0.7, 0.25], [0.25, 1.3]])
    root = rng.normal(size=(2, 2))
    return ImpactSystem(mass, np.zeros((2, 2)), root @ root.T + 0.3 * np.eye(2), (Stop((1.0, -0.6), -0.8, 1.1),), primary=1)


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.37, 0.81), (2.0, 0.05)])
def test_below_the_first_impact_the_points_lie_on_the_curves_of_constant_modal_energy(mu, sigma):
    """Oracle: both modal energies of linear motion are constant; a crossing moves none of them by more than rounding."""
    system = vibro_impact_nes(mu, sigma)
    found = section(system, 0.499 * sigma, orbits=20, crossings=300)
    assert not found.impacts.any() and set(found.ends) == {SectionEnd.COMPLETE}
    u, v = found.plane.states(found.points.reshape(-1, 2))
    shapes = system.modes.shapes
    modal = 0.5 * ((v @ system.mass @ shapes) ** 2 + (u @ system.mass @ shapes * system.modes.frequencies) ** 2)
    modal = modal.reshape(20, 300, 2)
    assert np.abs(modal - modal[:, :1]).max() < 1e-12 * found.plane.energy  # where u2' is small, it has few digits of 2h
    assert found.drift < 1e-13


def test_below_the_first_impact_nothing_is_chaotic():
    """Oracle: linear motion parts linearly at most, so what is left of log(t)/t over the last nine tenths of t is below log(100)/t, and
    falls with it."""
    system = vibro_impact_nes()
    for crossings in (400, 4000):
        found = section(system, 0.049, orbits=10, crossings=crossings)
        assert np.all(np.abs(found.exponents) < math.log(100.0) / found.times[:, -1])


def test_uncoupled_motion_has_a_known_map():
    """Oracle: a triangle wave, once each period of the oscillator, through thousands of impacts; the other coordinate order too."""
    for order in ((0, 1), (1, 0)):
        plane = SectionPlane(uncoupled(order=order), 0.5)
        starts = plane.starts(12)
        found = follow_crossings(plane, starts, 500)
        times = 2.0 * math.pi * np.arange(500)
        assert np.abs(found.times - times).max() < 2e-12 * times[-1]
        folded = (starts[:, :1] + starts[:, 1:] * times + 1.0) % 4.0
        exact = np.where(folded < 2.0, folded - 1.0, 3.0 - folded)
        assert np.abs(found.points[..., 0] - exact).max() < 1e-10
        assert np.allclose(np.abs(found.points[..., 1]), np.abs(starts[:, 1:]), rtol=1e-13)
        way = np.abs(starts[:, 1]) * times[-1] + np.sign(starts[:, 1]) * starts[:, 0]
        assert np.array_equal(found.impacts, np.floor((way + 1.0) / 2.0))
        assert found.impacts.sum() > 500


def test_the_derivative_of_the_map_of_uncoupled_motion_grows_linearly():
    """Oracle: the wave's argument is x + 2 pi j v, the oscillator's amplitude does not count; so the derivative is [[1, 2 pi j], [0, 1]] up
    to the sign of the branch."""
    plane = SectionPlane(uncoupled(), 0.5)
    starts = plane.starts(10)
    for direction, image in (([1.0, 0.0], [1.0, 0.0]), ([0.0, 1.0], [2.0 * math.pi * 30, 1.0])):
        found = follow_crossings(plane, starts, 31, directions=np.tile(direction, (10, 1)))
        changes = np.exp(found.growths[:, 30, None]) * found.tangents[:, 30]
        assert np.abs(np.abs(changes) - image).max() < 1e-9 * np.max(image)


@pytest.mark.parametrize("ulps", range(-8, 9))
def test_a_crossing_at_an_impact_counts_once(ulps):
    """Oracle: the oscillator's period; the speed lets each second impact fall on a crossing, within some ulps on either side."""
    plane = SectionPlane(uncoupled(), 0.5)
    speed = 1.0 / (2.0 * math.pi)
    speed += ulps * np.spacing(speed)
    found = follow_crossings(plane, np.array([[0.0, speed]]), 60)
    assert np.abs(found.times[0] - 2.0 * math.pi * np.arange(60)).max() < 1e-11
    assert found.impacts[0] >= 28


def fine_motion(system, state, points, digits=50):
    """Times and plane points of the first crossings of a VI NES, in mpmath: roots by sampling finely and by Illinois steps."""
    mpmath.mp.dps = digits
    description = system.describe()
    mu, sigma = (mpmath.mpf(description[name]) for name in ("mu", "sigma"))
    trace, product = 1 + sigma + sigma / mu, sigma / mu
    squares = [(trace + sign * mpmath.sqrt(trace**2 - 4 * product)) / 2 for sign in (-1, 1)]
    shapes = [(sigma, sigma - mu * square) for square in squares]  # u1 : u2, from the first equation
    norms = [mu * a * a + b * b for a, b in shapes]

    def between(function, low, high):
        return mpmath.findroot(function, (low, high), solver="anderson")

    def gap_left(motion):
        return lambda t: abs(motion(t)[0] - motion(t)[1]) - 1

    def primary(motion):
        return lambda t: motion(t)[1]

    def flight(state):
        u1, u2, v1, v2 = state
        parts = [((mu * a * u1 + b * u2) / n, (mu * a * v1 + b * v2) / n) for (a, b), n in zip(shapes, norms, strict=True)]

        def at(t):
            out = [mpmath.mpf(0)] * 4
            for (q, p), (a, b), square in zip(parts, shapes, squares, strict=True):
                w = mpmath.sqrt(square)
                c, s = mpmath.cos(w * t), mpmath.sin(w * t)
                x, y = q * c + p * s / w, p * c - q * w * s
                for k, value in enumerate((a * x, b * x, a * y, b * y)):
                    out[k] += value
            return out

        return at

    found, now = [], mpmath.mpf(0)
    state = [mpmath.mpf(float(x)) for x in state]
    step = mpmath.mpf(1) / 64
    while len(found) < points:
        motion = flight(state)
        t = step if not found and now == 0 else mpmath.mpf(0)
        while True:
            a, b = motion(t), motion(t + step)
            hit = abs(b[0] - b[1]) > 1
            stop = between(gap_left(motion), t, t + step) if hit else t + step
            if a[1] < 0 < motion(stop)[1]:
                root = between(primary(motion), t, stop)
                there = motion(root)
                found.append((now + root, there[0], there[2]))
                if len(found) == points:
                    return found
            if hit:
                u1, u2, v1, v2 = motion(stop)
                relative = v1 - v2
                state = [u1, u2, v1 - 2 * relative / (1 + mu), v2 + 2 * relative * mu / (1 + mu)]
                now += stop
                break
            t += step
    return found


@pytest.mark.parametrize(("mu", "sigma", "energy", "start"), [(0.1, 0.1, 0.06, 1)])
def test_crossings_have_the_times_of_fifty_digits(mu, sigma, energy, start):
    """Oracle: see `require_crossings_have_the_times_of_fifty_digits`."""
    require_crossings_have_the_times_of_fifty_digits(mu, sigma, energy, start)


def require_crossings_have_the_times_of_fifty_digits(mu, sigma, energy, start):
    """Oracle: fifty digits of the modal solution from the same start, impacts and crossings by sampling; errors grow as motions part."""
    system = vibro_impact_nes(mu, sigma)
    plane = SectionPlane(system, energy)
    starts = plane.starts(8)[start : start + 1]
    u, v = plane.states(starts)
    found = follow_crossings(plane, starts, 7)
    exact = fine_motion(system, np.concatenate([u[0], v[0]]), 6)
    assert found.impacts[0] > 2
    for k, (time, x, y) in enumerate(exact, 1):
        allowed = 1e-14 * (1.0 + float(time)) * max(1.0, math.exp(float(found.growths[0, : k + 1].max())))
        assert abs(float(found.times[0, k] - time)) < allowed
        assert abs(float(found.points[0, k, 0] - x)) < allowed and abs(float(found.points[0, k, 1] - y)) < allowed


@pytest.mark.parametrize("system", [vibro_impact_nes(), vibro_impact_nes(0.3, 0.0), coupled_masses(), vibro_impact_nes(rho=0.8)])
def test_dense_sampling_finds_no_crossing_that_was_missed(system):
    """Oracle: signs of the primary's displacement on a fine grid over the same runs: each change upwards has its crossing, and there are
    as many up to pairs closer than the grid."""
    plane = SectionPlane(system, 0.7)
    starts = plane.starts(3)
    found = follow_crossings(plane, starts, 25)
    u, v = plane.states(starts)
    for m in range(3):
        count = int(found.counts[m])
        # Where neighbours have parted by more than e^15, two runs of one start are two motions.
        count = int(np.argmax(np.append(np.maximum.accumulate(found.growths[m, :count]) > 15.0, True)))
        assert count > 5
        end = found.times[m, count - 1] + 1e-9
        run = saltus.simulate(system, u[m], v[m], end)
        times = np.linspace(0.0, end, 200_000)
        shown = run.sample(times)[0][:, plane.primary]
        up = 1 + np.flatnonzero((shown[1:-1] < 0.0) & (shown[2:] >= 0.0))
        crossings = found.times[m, 1:count]
        nearest = np.array([np.abs(crossings - t).min() for t in times[up]])
        assert nearest.max() <= times[1] + 1e-9
        assert len(up) <= len(crossings) <= len(up) + 1


@pytest.mark.parametrize("system", [vibro_impact_nes(), vibro_impact_nes(0.37, 0.81), vibro_impact_nes(0.1, 0.0), coupled_masses()])
@pytest.mark.parametrize("factor", [1.2, 4.0, 20.0])
def test_energy_is_kept_to_rounding(system, factor):
    """Oracle: energy, through hundreds of impacts and more; the energies are multiples of the least at which a stop is reached."""
    (stop,) = system.stops
    give = np.array(stop.gap) @ np.linalg.pinv(system.stiffness) @ stop.gap
    least = 0.5 * min(-stop.lower, stop.upper) ** 2 / give if np.linalg.det(system.stiffness) > 0.0 else 0.01
    found = section(system, factor * least, orbits=30, crossings=200)
    assert set(found.ends) == {SectionEnd.COMPLETE}
    assert found.impacts.max() > 20
    assert found.drift < 1e-12


def test_the_map_keeps_areas():
    """Oracle: the determinant of the derivative of a conservative map in x and momentum is 1, at full mass matrices too."""
    for system in (vibro_impact_nes(), coupled_masses()):
        plane = SectionPlane(system, 0.4)
        _, derivative, _ = return_map(plane, plane.starts(30))
        size = np.abs(derivative).max(axis=(1, 2)) ** 2
        assert np.abs(np.linalg.det(derivative) - 1.0).max() < 1e-11 * size.max()


def test_the_derivative_is_that_of_differences():
    """Oracle: central differences of the map, where no impact grazes between."""
    plane = SectionPlane(coupled_masses(), 0.4)
    starts = plane.starts(40)
    step = 1e-6
    for direction in np.eye(2):
        here = follow_crossings(plane, starts, 2, directions=np.tile(direction, (40, 1)))
        sides = [follow_crossings(plane, starts + sign * step * direction, 2) for sign in (1.0, -1.0)]
        kept = (sides[0].impacts == sides[1].impacts) & (sides[0].impacts == here.impacts)
        change = np.exp(here.growths[:, 1, None]) * here.tangents[:, 1]
        difference = (sides[0].points[:, 1] - sides[1].points[:, 1]) / (2.0 * step)
        size = np.abs(change).max(axis=1)
        assert kept.sum() > 25
        close = np.abs(difference - change).max(axis=1) < 1e-4 * size
        assert close[kept].mean() > 0.9


def test_a_periodic_orbit_closes_and_parts_at_its_multiplier():
    """Oracle: the family's orbit: as many points as its half-waves tell, the first again after a period, and the logarithm of its largest
    multiplier over its period as Lyapunov exponent."""
    system = vibro_impact_nes()
    orbit = max(traced("S11O00-", high=2.0).orbits_at(energy=0.08), key=lambda orbit: abs(orbit.multipliers).max())
    assert orbit.stable is False
    plane = SectionPlane(system, orbit.h)
    u, v = orbit.sample(np.zeros(1))
    if v[0, 1] < 0.0:
        u, v = -u, -v
    found = follow_crossings(plane, plane.coordinates(u, v), 6)
    assert np.abs(found.times[0, 1] - orbit.period) < 1e-11
    assert np.abs(found.points[0] - found.points[0, 0]).max() < 1e-13 * abs(orbit.multipliers).max() ** 6
    # Later the orbit has left for good: its multiplier is 160. Before, the perturbation still turns.
    rate = (found.growths[0, 3] - found.growths[0, 2]) / (found.times[0, 3] - found.times[0, 2])
    assert rate == pytest.approx(math.log(abs(orbit.multipliers).max()) / orbit.period, rel=1e-6)


@pytest.mark.parametrize(("energy", "close"), [(0.2, 1e-3), (0.3, 5e-3)])
def test_the_exponent_leaves_out_how_the_perturbation_turns_at_the_start(energy, close):
    """Oracle: the multiplier of the family's orbit, whose square is the part of the perturbation that is left of the other direction at a
    crossing: with the first of eleven steps the mean would be off by four times as much and more."""
    (orbit,) = traced("S13O00+", low=0.05, high=5.0).orbits_at(energy=energy)
    plane = SectionPlane(vibro_impact_nes(), energy)
    u, v = orbit.sample(np.zeros(1))
    found = follow_crossings(plane, plane.coordinates(u, v), 12)
    rate = math.log(abs(orbit.multipliers).max()) / orbit.period
    assert found.exponents[0] == pytest.approx(rate, rel=close)
    assert found.growths[0, -1] / found.times[0, -1] != pytest.approx(rate, rel=4.0 * close)


def test_a_motion_that_loses_energy_leaves_its_surface():
    """Oracle: energies of a run of the same system: they fall, and are those at the crossings."""
    system = vibro_impact_nes(rho=0.7)
    found = section(system, 0.3, orbits=5, crossings=40)
    u, v = found.plane.states(found.points[:, 0])
    for m in range(5):
        count = int(found.counts[m])
        assert np.all(np.diff(found.energies[m, :count]) <= 1e-15)
        run = saltus.simulate(system, u[m], v[m], found.times[m, count - 1])
        energies = system.energy(*run.sample(found.times[m, :count]))
        assert np.all(np.abs(energies - found.energies[m, :count]) < 1e-14 * np.exp(np.maximum.accumulate(found.growths[m, :count])))
    assert found.energies[:, -1].max() < 0.29


@pytest.mark.parametrize(("sigma", "rho"), [(0.0, 0.0), (0.1, 0.0), (0.1, 0.3)])
def test_orbits_that_stick_to_a_stop_go_on(sigma, rho):
    """Oracle: dense samples of the run of the same start: u2 passes zero upwards as often, and at these times the run has these points and
    energies; only orbits that never stick have an exponent."""
    system = vibro_impact_nes(sigma=sigma, rho=rho)
    found = section(system, 5.0, orbits=12, crossings=12)
    assert set(found.ends) == {SectionEnd.COMPLETE} and (found.sticking_times > 0.0).any()
    u, v = found.plane.states(found.points[:, 0])
    for m in range(12):
        motion = saltus.simulate(system, u[m], v[m], found.times[m, -1] + 1e-9)
        assert found.sticking_times[m] == pytest.approx(motion.sticking_time, abs=2e-9)
        us, vs = motion.sample(found.times[m])
        np.testing.assert_allclose(us[:, 1], 0.0, atol=1e-10)
        np.testing.assert_allclose(found.plane.coordinates(us, vs), found.points[m], atol=1e-10)
        np.testing.assert_allclose(system.energy(us, vs), found.energies[m], atol=1e-10)
        dense = motion.sample(np.linspace(1e-6, motion.duration, 40_000))[0][:, 1]
        assert np.count_nonzero((dense[:-1] < 0.0) & (dense[1:] >= 0.0)) == 11
    np.testing.assert_array_equal(np.isnan(found.exponents), found.sticking_times > 0.0)


@pytest.mark.parametrize(("rho", "energy"), [(0.3, 5.0), (0.6, 5.0), (1.0, 20.0)])
@pytest.mark.parametrize(("periods", "events"), [(0.02, 256), (8.0, 12)])
def test_the_length_of_the_blocks_does_not_change_a_section(monkeypatch, rho, energy, periods, events):
    """Oracle: the same motions in long blocks. Short blocks cut flights and sums of bounces; a small log is full at once."""
    system = vibro_impact_nes(rho=rho)
    whole = section(system, energy, orbits=8, crossings=6)
    monkeypatch.setattr(section_module, "_PERIODS", periods)
    monkeypatch.setattr(kernels, "EVENTS_AT_ONCE", events)
    cut = section(system, energy, orbits=8, crossings=6)
    assert whole.ends == cut.ends == (SectionEnd.COMPLETE,) * 8 and np.array_equal(whole.impacts, cut.impacts)
    far = np.exp(np.nan_to_num(whole.growths, nan=0.0)).max()
    np.testing.assert_allclose(cut.times, whole.times, atol=1e-12 * far)
    np.testing.assert_allclose(cut.points, whole.points, atol=1e-12 * far)
    np.testing.assert_allclose(cut.sticking_times, whole.sticking_times, atol=1e-12 * far)
    np.testing.assert_allclose(cut.growths, whole.growths, atol=1e-11 * far)


@pytest.mark.parametrize("rho", [0.3, 1.0])
def test_the_colour_bar_reports_orbits_without_an_exponent(rho):
    """Oracle: the exponents: orbits that stick have none, elastic ones never stick."""
    from transitions.section.figure import section_figure
    from transitions.section.view import SectionView

    found = section(vibro_impact_nes(rho=rho), 5.0, orbits=12, crossings=12)
    label = section_figure([SectionView(found)], colour="lyapunov").axes[-1].get_ylabel()
    none = bool(np.isnan(found.exponents).any())
    assert "Lyapunov" in label and ("grey: none" in label) == none == (rho < 1.0)


def test_an_orbit_that_does_not_come_back_is_left():
    """Oracle: nothing holds the primary coordinate, so that it moves on."""
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 0.0]), (Stop((1.0, 0.0), -1.0, 1.0),), primary=1)
    found = section(system, 0.3, orbits=4, crossings=5)
    assert found.counts.tolist() == [1] * 4 and set(found.ends) == {SectionEnd.TIME_OVER}


def test_the_plane_and_its_boundary():
    """Oracle: energy on the boundary with u_p' = 0; states and coordinates are each other's inverse; starts lie inside."""
    for system in (vibro_impact_nes(), coupled_masses(), vibro_impact_nes(sigma=0.0)):
        plane = SectionPlane(system, 0.06)
        line = plane.boundary()
        assert np.array_equal(line[0], line[-1])
        own, stiffness = system.mass[0, 0], system.stiffness[0, 0]
        assert np.all(own * line[:, 1] ** 2 + stiffness * line[:, 0] ** 2 <= 0.12 * (1.0 + 1e-12))
        assert np.abs(line[:, 0]).max() <= max(np.abs(plane.walls)) + 1e-15
        starts = plane.starts(500)
        assert plane.holds(starts).all() and len(np.unique(starts, axis=0)) == 500
        u, v = plane.states(starts)
        assert np.allclose(system.energy(u, v), 0.06, rtol=1e-14)
        assert np.all(u[:, 1] == 0.0) and np.all(v[:, 1] > 0.0)
        assert np.allclose(plane.coordinates(u, v), starts, rtol=0, atol=1e-15)


def plane_of(stop, stiffness=(1.0, 1.0), energy=0.1, primary=1):
    """The section of two uncoupled masses."""
    return SectionPlane(ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag(stiffness), [stop], primary=primary), energy)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SectionPlane(ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), -1.0)]), 1.0), "this system has 1"),
        (lambda: plane_of(Stop((1, 0), -1, 1), primary=None), "LO = u1 or u2"),
        (lambda: SectionPlane(vibro_impact_nes(), 0.0), "above 0; received 0.0"),
        (lambda: SectionPlane(vibro_impact_nes(), math.nan), "received nan"),
        (lambda: section(vibro_impact_nes(), 1.0, orbits=0), "orbits is an integer from 1 to 1000000000; received 0"),
        (lambda: section(vibro_impact_nes(), 1.0, starts=[[0.0, 99.0]]), r"inside the bounding curve .* received \[0.0, 99.0\]"),
        (lambda: plane_of(Stop((1, 0), 0.5, 1)), "no motion with energy 0.1 reaches the section u2 = 0; expected an energy above 0.125"),
        (lambda: plane_of(Stop((0, 1), 0.5, 1)), "no motion reaches the section u2 = 0: the stops leave no room there"),
        (lambda: plane_of(Stop((1, 0), -1), (0.0, 1.0)), "has no bounds"),
    ],
)
def test_what_has_no_section_is_refused_in_one_line(make, words):
    """Oracle: the input."""
    with pytest.raises(ValueError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_motion_without_impacts_is_followed_for_any_number_of_crossings():
    """Each block of a motion has its own clock. Oracle: below the first grazing every crossing comes, and the energy stays."""
    found = section(vibro_impact_nes(), 0.046, orbits=1, crossings=20_000)
    assert found.ends == (SectionEnd.COMPLETE,) and found.counts.tolist() == [20_000] and not found.impacts.any()
    assert found.drift < 1e-10
