"""Basins of attraction of forced motion.

Oracles: closed forms of linear motion; long simulations of each start by the plain simulator, and by `settle`; symmetry; the definition of
a saddle; and that neither processes nor blocks change the result.
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from bvp.forcing import Constant, Harmonic
from bvp.parameters import ParametricSystem
from bvp.simulate import Simulator
from bvp.system import ImpactSystem, Stop
from saltus import load_scene
from transitions.basin import rounds
from transitions.basin.basin import find_basin
from transitions.basin.figure import basin_figure
from transitions.basin.following import CAUGHT, StartFollower
from transitions.basin.grid import BasinAxis, StartGrid, default_range
from transitions.basin.identity import same_states, strobe_states
from transitions.basin.neighbourhood import neighbourhoods
from transitions.basin.plan import BasinPlan, path_of
from transitions.basin.record import IMPOSSIBLE, UNDECIDED, AttractorKind, basin_record, basin_table
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle


def oscillator(damping=0.1, reach=50.0, restitution=0.7, lower=None):
    return ImpactSystem(
        [[1.0]], [[damping]], [[1.0]], [Stop((1.0,), -reach if lower is None else lower, reach, restitution)], coordinates=("x",)
    )


def plan_of(system, forces, count=6, x=(-1.0, 1.0), y=(-1.0, 1.0), phase=0.0, **options):
    grid = StartGrid(system.coordinates, BasinAxis("x", *x, count), BasinAxis("x'", *y, count), phase=phase)
    return BasinPlan(path_of(ParametricSystem.of(system, forces)), grid, **options)


@pytest.fixture(scope="module")
def bistable():
    """An oscillator that either does not reach its stop, or hits it in each second period."""
    scene = load_scene("damped_impact_oscillator", w=2.2, A=1.0, c=0.02)
    grid = StartGrid(("x",), BasinAxis("x", -2.0, 2.0, 24), BasinAxis("x'", -4.0, 4.0, 16))
    plan = BasinPlan(path_of(scene.parametric), grid)
    basin, interrupted = find_basin(plan)
    assert not interrupted
    return scene, plan, basin


def test_a_linear_oscillator_has_one_basin_with_every_start():
    """Oracle: its steady response A/(1 - w^2 + i c w), and its multipliers, of modulus exp(-c T/2)."""
    w, c = 0.6, 0.1
    basin, _ = find_basin(plan_of(oscillator(c), [Harmonic(w, [1.0])], phase=0.5))
    (found,) = basin.attractors
    assert found.kind is AttractorKind.PERIODIC and found.family == "half-period-1:" and np.all(basin.attractor == 0)
    response = 1.0 / (1.0 - w**2 + 1j * c * w)
    for states, phase in ((found.states, 0.0), (basin.positions[0], 0.5)):
        turned = response * np.exp(1j * phase)
        assert np.abs(states[0] - [turned.real, (1j * w * turned).real]).max() < 1e-9
    assert abs(found.largest_multiplier - math.exp(-0.5 * c * 2.0 * math.pi / w)) < 1e-10
    assert basin.saddles == () and not basin.undecided


def test_a_load_without_amplitude_has_rest_as_its_attractor():
    """Oracle: a damped oscillator loses all its energy, whatever impacts it has first."""
    basin, _ = find_basin(plan_of(oscillator(reach=1.0), [Harmonic(1.3, [0.0])], x=(-1.0, 1.0), y=(-3.0, 3.0)))
    assert basin.counts.tolist() == [36]
    (rest,) = basin.attractors
    assert rest.kind is AttractorKind.PERIODIC and rest.problem is not None and not rest.note
    assert not rest.states.any()
    assert abs(rest.multipliers[0]) == pytest.approx(math.exp(-0.05 * 2.0 * math.pi / 1.3), rel=1e-12)


def test_the_basins_are_those_of_long_simulations(bistable):
    """Oracle: the simulator alone, over 800 periods of each start."""
    scene, plan, basin = bistable
    assert [(found.period, found.sequence) for found in basin.attractors] == [(2, "+"), (1, "")]
    beyond = plan.grid.states[:, 0] > 1.0
    assert np.array_equal(basin.attractor == IMPOSSIBLE, beyond) and beyond.sum() == 96
    assert np.all(basin.counts > 50) and not basin.undecided
    simulator = Simulator(scene.system, list(scene.forces))
    for state, number in zip(plan.grid.states[~beyond], basin.attractor[~beyond], strict=True):
        final = simulator.run(state[:1], state[1:], 800 * 2.0 * math.pi / 2.2).final
        distances = [np.abs(found.states - final).max(axis=1).min() for found in basin.attractors]
        assert np.argmin(distances) == number and min(distances) < 1e-5


def test_the_image_of_a_start_is_in_the_same_basin(bistable):
    """Oracle: a basin is invariant. The images are settled by themselves."""
    scene, plan, basin = bistable
    chosen = np.flatnonzero(basin.attractor >= 0)[::17]
    images = StartFollower(scene.system, scene.forces).follow(plan.grid.states[chosen], 1).states
    for image, number in zip(images, basin.attractor[chosen], strict=True):
        found = settle(scene.system, scene.forces, image[:1], image[1:])
        assert same_states(found.states, basin.attractors[number].states)


def test_the_saddle_is_on_the_boundary(bistable):
    """Oracle: the stroboscopic map takes it to itself, and motions that begin on both sides of it go to different attractors."""
    scene, _, basin = bistable
    (saddle,) = basin.saddles
    assert (saddle.period, saddle.family) == (2, "period-2:+") and abs(saddle.multipliers[0]) > 2.0 > 1.0 > abs(saddle.multipliers[1])
    follower = StartFollower(scene.system, scene.forces)
    assert np.abs(follower.follow(saddle.states[:1], 2).states - saddle.states[0]).max() < 1e-9
    ends = set()
    for sign in (-1.0, 1.0):
        start = saddle.states[0] + sign * np.array([0.0, 1e-3])
        found = settle(scene.system, scene.forces, start[:1], start[1:])
        ends |= {k for k, one in enumerate(basin.attractors) if same_states(one.states, found.states)}
    assert ends == {0, 1}


def test_a_neighbourhood_catches_what_comes_closer_and_nothing_else(bistable):
    """Oracle: a state on its border, followed by the simulator: it comes closer in each period. A state of the other basin stays free."""
    scene, _, basin = bistable
    follower = StartFollower(scene.system, scene.forces)
    resting, hitting = basin.attractors[1], basin.attractors[0]
    known = neighbourhoods(follower, resting.states, (0,), False)
    metric, size = known.metric[0], known.sizes[0]
    simulator = Simulator(scene.system, list(scene.forces))
    for angle in np.linspace(0.0, 2.0 * math.pi, 7):
        state = resting.states[0] + size * np.linalg.solve(metric, [math.cos(angle), math.sin(angle)])
        distance = size
        for _ in range(3):
            state = simulator.run(state[:1], state[1:], follower.period).final
            before, distance = distance, float(np.linalg.norm(metric @ (state - resting.states[0])))
            assert distance <= known.factors[0] * before
    found = follower.follow(np.concatenate([resting.states, hitting.states]), 300, known)
    assert found.outcome[0] == CAUGHT and np.all(found.outcome[1:] != CAUGHT) and found.periods[0] <= 2


def test_processes_and_blocks_change_nothing(bistable, monkeypatch):
    """Oracle: the same basin in one piece."""
    _, plan, basin = bistable
    monkeypatch.setattr(rounds, "BLOCK", 37)
    counts = []
    with ThreadPoolExecutor(1) as pool:
        other, _ = find_basin(plan, pool, counts.append, saddles=False)
    for name in ("attractor", "periods", "impacts"):
        assert np.array_equal(getattr(other, name), getattr(basin, name)), name
    assert counts == sorted(counts) and counts[-1] == basin.possible


def test_a_ball_on_a_weakly_shaken_table_comes_to_rest():
    """Oracle: below Gamma = 1 the table never leaves a ball that lies on it."""
    ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)], coordinates=("x",))
    forces = [Constant([-1.0]), Harmonic(1.0, [0.5])]
    basin, _ = find_basin(plan_of(ball, forces, x=(-0.5, 1.0)))
    (found,) = basin.attractors
    assert found.kind is AttractorKind.STICKING and found.sticking == ("-",) and found.family == "sticking:-"
    assert np.array_equal(basin.attractor, np.where(basin.grid.states[:, 0] < 0.0, IMPOSSIBLE, 0))
    assert np.abs(found.states).max() < 1e-12


def test_a_torus_and_a_periodic_motion_share_the_starts():
    """Oracle: `settle` of each start alone says torus or periodic."""
    system, forces = oscillator(-0.1, reach=1.0), [Harmonic(1.3, [0.1])]
    plan = plan_of(system, forces, count=5, x=(-1.0, 1.0), y=(-1.5, 1.5))
    basin, _ = find_basin(plan, saddles=False)
    assert sorted(found.kind.name for found in basin.attractors) == ["PERIODIC", "TORUS"]
    for k in range(0, len(basin), 3):
        state = plan.grid.states[k]
        assert settle(system, forces, state[:1], state[1:], most=4096).kind.name == basin.attractors[basin.attractor[k]].kind.name


def test_chaos_is_one_attractor():
    """Oracle: `settle` finds that a tangent vector grows."""
    scene = load_scene("impact_oscillator", s=0.0)
    grid = StartGrid(("x",), BasinAxis("x", -1.0, 0.0, 3), BasinAxis("x'", -1.0, 1.0, 3))
    basin, _ = find_basin(BasinPlan(path_of(scene.parametric), grid), saddles=False)
    (found,) = basin.attractors
    assert found.kind is AttractorKind.CHAOS and found.exponent > 0.05 and np.all(basin.attractor == 0)


def test_loads_of_two_frequencies_need_no_parameter():
    """Oracle: the sum of the steady responses to both loads."""
    basin, _ = find_basin(plan_of(oscillator(), [Harmonic(0.5, [1.0]), Harmonic(1.5, [0.5])], count=3))
    (found,) = basin.attractors
    total = sum(a / (1.0 - w**2 + 0.1j * w) for w, a in ((0.5, 1.0), (1.5, 0.5)))
    assert found.family == "half-period-1:" and basin.frequency == 0.5 and abs(found.states[0, 0] - total.real) < 1e-9


def test_motion_that_grows_without_bound_is_named():
    """Oracle: negative damping, and a stop that takes nothing."""
    basin, _ = find_basin(plan_of(oscillator(-0.1, reach=1e12, restitution=1.0), [Harmonic(0.6, [1.0])]))
    assert [found.kind for found in basin.attractors] == [AttractorKind.UNBOUNDED] and np.all(basin.attractor == 0)


def test_what_nothing_attracts_is_undecided():
    """Oracle: without losses each start has a motion of its own. None is an attractor."""
    basin, _ = find_basin(plan_of(oscillator(0.0), [Harmonic(0.6, [1.0])], count=4))
    assert basin.attractors == () and np.all(basin.attractor == UNDECIDED)
    ((reason, count),) = basin.undecided.items()
    assert reason.startswith("no attractor was found") and count == 16


def test_an_interrupt_keeps_what_is_done(bistable, monkeypatch):
    _, plan, basin = bistable
    monkeypatch.setattr(rounds, "BLOCK", 50)

    def interrupt(count):
        raise KeyboardInterrupt

    part, interrupted = find_basin(plan, None, interrupt)
    done = part.attractor >= 0
    assert interrupted and 0 < done.sum() < basin.possible and part.saddles == ()
    assert part.undecided == {"interrupted": int(np.sum(part.attractor == UNDECIDED))}
    states = [part.attractors[k].states for k in part.attractor[done]]
    assert all(same_states(one, basin.attractors[k].states) for one, k in zip(states, basin.attractor[done], strict=True))


def test_default_ranges_hold_the_motion_between_its_stops():
    """Oracle: the bounds of the stops, less what is fixed; without them twice the steady response, rounded up."""
    scene = load_scene("absorber", w=0.82)
    given = scene.system, scene.forces
    assert default_range(*given, "u1", {}, 1) == (-1.0, 1.0) and default_range(*given, "u1", {"u2": 0.5}, 1) == (-0.5, 1.5)
    low, high = default_range(oscillator(), [Harmonic(0.6, [1.0])], "x", {}, 1)
    assert (low, high) == (-5.0, 5.0)  # twice 1/|1 - 0.36 + 0.06 i| = 1.56


@pytest.mark.parametrize(
    ("x", "y", "given", "words"),
    [
        ("x", "x", {}, "two state coordinates"),
        ("x", "z", {}, "no coordinate 'z'"),
        ("x", "x'", {"fixed": {"x": 1.0}}, "x varies"),
        ("x", "x'", {"phase": 7.0}, "phase"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(x, y, given, words):
    with pytest.raises(ValueError, match=words):
        StartGrid(("x",), BasinAxis(x, -1.0, 1.0, 3), BasinAxis(y, -1.0, 1.0, 3), **given)


def test_the_picture_has_each_basin_with_its_marks(bistable):
    """Oracle: the numbers of the basin."""
    _, _, basin = bistable
    figure = basin_figure(basin, title="two basins")
    (axes,) = figure.axes
    (image,) = axes.images
    assert np.array_equal(image.get_array(), basin.grid.image(basin.attractor)) and image.get_extent() == [-2.0, 2.0, -4.0, 4.0]
    marks = {line.get_gid(): line.get_xydata() for line in axes.lines if line.get_gid()}
    assert {key: len(points) for key, points in marks.items()} == {"A1": 2, "A2": 1, "S1": 2}
    assert np.allclose(marks["S1"], basin.saddles[0].states)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[0].startswith("A1 period-2:+, ") and "beyond a stop" in texts and "saddle at this phase" in texts
    plt.close("all")


def test_a_mark_on_the_border_is_whole(bistable):
    """Oracle: the colour of the pixel two points outside the axes. A mark that is farther outside is not drawn, and counted."""
    _, _, basin = bistable
    border, beyond = np.array([[-2.0 - 1e-15, 1.0], [-2.1, 1.0]]), np.array([[2.1, 0.0]])
    figure = basin_figure(dataclasses.replace(basin, positions=(border, beyond)))
    (axes,) = figure.axes
    marks = {line.get_gid(): line for line in axes.lines if line.get_gid()}
    assert np.array_equal(marks["A1"].get_xydata(), border[:1]) and not len(marks["A2"].get_xydata())
    assert "attractor at this phase (1 of 2 out of the picture)" in [text.get_text() for text in figure.legends[0].get_texts()]
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())
    x, y = axes.transData.transform(border[0]) - [2.0 * figure.dpi / 72.0, 0.0]
    assert np.allclose(pixels[len(pixels) - 1 - round(y), round(x), :3] / 255.0, to_rgb(marks["A1"].get_markerfacecolor()), atol=0.01)
    plt.close("all")


def test_the_record_and_the_table_have_the_same_starts(bistable):
    _, _, basin = bistable
    record, table = basin_record(basin), basin_table(basin)
    assert [one["starts"] for one in record["attractors"]] == basin.counts.tolist()
    assert record["impossible"] == np.sum(table["attractor"] == -1) and record["starts"] + record["impossible"] == len(table["attractor"])
    assert list(table) == ["start_u.x", "start_v.x", "attractor", "periods", "impacts"]


@pytest.mark.parametrize("late", [0.0, 3e-32, -3e-32])
def test_a_node_at_the_phase_to_rounding_is_at_it(late):
    """Oracle: the state of the node. Just before it, a whole period later is the same state."""
    scene = load_scene("ueda_oscillator", B=1.0)
    orbit = settled_orbit(path_of(scene.parametric), settle(scene.system, scene.forces))
    y = np.array(orbit.y)
    orbit.problem.instants(y)[0] = late
    assert np.abs(strobe_states(orbit.problem, y)[0] - orbit.problem.nodes(y)[0, :2]).max() < 1e-12
