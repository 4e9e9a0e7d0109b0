"""Bad input from Python: one line that says what was received and what was expected; what objects hand out cannot be changed."""

import array
import copy
import dataclasses
import gc
import math
import pickle

import numpy as np
import pytest

import saltus
from branches.catalogue.database import CatalogueError
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.kernels.compiled import Kernel
from bvp.multipoint import MultipointProblem
from bvp.simulate import Simulator
from bvp.stability import stability

HUGE = 10**400
DIGITS = 10**5000
"""More digits than Python writes."""
LONG = "an integer of 16610 bits, beyond all floats"
BEYOND = "an integer of 1329 bits, beyond all floats"


def system(**changes):
    """The reference system."""
    return saltus.vibro_impact_nes(**changes)


def spring(k):
    """An oscillator from its energies, with the parameter k."""
    return saltus.ImpactSystem.from_lagrangian("x_dot**2/2", "k*x**2/2", ["x"], gaps=[("x", -1, 1)], parameters={"k": k})


@pytest.fixture(scope="module")
def branch():
    """A short piece of a family with two ends."""
    return saltus.trace("S13O00+", system(), energy=(0.3, 0.5))


def at_mode(energy):
    """The families at a linear mode in a range of energies."""
    return saltus.families_at(saltus.linear_modes(system())[0], 1, 1, energy=energy)


def on_spring(force, **known):
    """A system whose spring has a Python function."""
    return saltus.ImpactSystem([[1.0]], [[0.0]], [[1.0]], (), springs=(saltus.Spring((1.0,), force=force, **known),))


def basin(x=("x", -1.0, 1.0), y=("x'", -1.0, 1.0), **options):
    """Basins of an oscillator with a stop at 1."""
    return saltus.basin(saltus.load_scene("damped_impact_oscillator").parametric, x, y, **{"grid": (2, 2), **options})


def opaque(w):
    """w^3, of which no formula is known."""
    w = np.asarray(w)
    return w * w * w


CALLS = [
    # forces that are Python functions
    (lambda branch: on_spring(lambda w: math.nan), "the force of the spring on u1 is nan at rest, w = 0; expected a finite number"),
    (lambda branch: on_spring(lambda w: [1, 2]), "is one number for one elongation; received an array of shape (2,)"),
    (lambda branch: on_spring(lambda w: math.sin(w) / 0), "the force of the spring on u1 fails at rest, w = 0: ZeroDivisionError"),
    (lambda branch: on_spring(lambda w: math.sin(w)), "the derivative of the force of the spring on u1 is not known"),
    (lambda branch: on_spring(lambda w: math.sin(w), slope=math.sin), "the slope of the spring on u1 is -0.841471 at w = -1"),
    (lambda branch: on_spring(opaque, slope=3.0), "the slope of the spring on u1 is a function; received 3.0"),
    (lambda branch: on_spring(opaque, energy=opaque), "the force of the spring on u1 is -1 at w = -1, where differences of the energy"),
    (lambda branch: on_spring(lambda w: opaque(w) + 1.0), "the force of the spring on u1 is 1"),
    (lambda branch: on_spring(abs), "the force of the spring on u1 is not smooth, in Abs(..); expected smooth functions"),
    (lambda branch: saltus.Spring((1.0,), stiffness=1.0, slope=opaque), "slope and energy of the spring on u1 go with a force"),
    (lambda branch: saltus.Spring(force=opaque), "a spring whose force is a Python function acts between two coordinates or on one"),
    (
        lambda branch: MultipointProblem(on_spring(lambda w: opaque(w) * np.asarray(w)), ("origin", "rest"), ()),
        "a spring or damper on u1 whose force is not odd",
    ),
    (lambda branch: saltus.simulate(on_spring(opaque), [0], [1], 1.0), "of the spring on u1 is a Python function, which only orbits"),
    # numbers beyond floats
    (lambda branch: system(mu=HUGE), f"mu, the mass ratio, is a number; received {BEYOND}"),
    (lambda branch: saltus.load_scene(mu=HUGE), BEYOND),
    (lambda branch: saltus.Stop((HUGE,), 0.0, 1.0), "the gap row of a stop is a list of numbers; received (1000"),
    (lambda branch: saltus.Stop((1.0,), 0.0, 10**5000), "upper of a stop is a number; received an integer of 16610 bits"),
    (lambda branch: saltus.ImpactSystem([[10**5000]], [[0.0]], [[1.0]], [saltus.Stop((1.0,), 0.0)]), "mass is a square matrix of numbers"),
    (lambda branch: saltus.simulate(system(), [HUGE, 0], [0, 0], 1.0), "u is a list of 2 finite numbers; received [1000"),
    (lambda branch: saltus.simulate(system(), [0, 0], [0, 0], HUGE), f"duration is a finite time of 0 or more; received {BEYOND}"),
    (lambda branch: saltus.simulate(system(), [0, 0], [0, 0], 1.0, HUGE), f"max_impacts is an integer of 0 or more; received {BEYOND}"),
    (lambda branch: saltus.simulate(system(), [0, 0], [0, 0], 1.0).sample([HUGE]), "times is a list of finite numbers; received [1000"),
    (lambda branch: saltus.trace("S13O00+", energy=(0.1, HUGE)), "energy range (0.1, 1000"),
    (lambda branch: saltus.trace("S13O00+", energy=(0.1, 1.0), points=HUGE), f"points = {BEYOND}: expected an integer, at least 1"),
    (lambda branch: saltus.discover(system(), HUGE), f"the energy is {BEYOND}, expected a finite number above 0"),
    (lambda branch: saltus.discover(system(), 1.0, quarter_period=HUGE), f"the longest quarter period is {BEYOND}"),
    (lambda branch: saltus.discover(system(), 1.0, impacts=10**23), "expected an integer from 0 to 10000, or no bound"),
    (lambda branch: basin(("x", 0.0, 1.0), ("x", 0.0, 1.0)), "a basin needs two state coordinates to vary; received x twice"),
    (lambda branch: basin(("x", 0.0, HUGE)), f"the range of x is two finite numbers, LO < HI; received 0.0 and {BEYOND}"),
    (lambda branch: basin(("y", 0.0, 1.0)), "the state has no coordinate 'y'; expected some of x, x'"),
    (lambda branch: basin(grid=(4, DIGITS)), f"the number of starts along x' is an integer from 2 to 10000000; received {LONG}"),
    (lambda branch: basin(phase=7.0), "phase is a number from 0 to below 2 pi; received 7.0"),
    (lambda branch: basin(most=0), "most is an integer from 1 to 1000000000; received 0"),
    (lambda branch: basin(("x", 2.0, 3.0)), "every start of the grid over x and x' is beyond a stop; expected another range"),
    (lambda branch: saltus.section(system(), HUGE), f"the energy of a section is a finite number above 0; received {BEYOND}"),
    (lambda branch: saltus.Harmonic(HUGE, [1.0]), f"(a load of frequency 0 is Constant); received {BEYOND}"),
    (lambda branch: saltus.Constant([HUGE]), "load is a list of finite numbers; received [1000"),
    (lambda branch: branch.orbits_at(energy=HUGE), f"the energy h is a finite number above 0; received {BEYOND}"),
    (lambda branch: saltus.discover(system(), 1.0, impacts=DIGITS), f"is {LONG}, expected an integer from 0 to 10000"),
    (lambda branch: saltus.discover(system(), 1.0, budget=DIGITS), f"the most starts is {LONG}, expected an integer above 0"),
    (lambda branch: saltus.discover(system(), 1.0, ends=(DIGITS,)), f"unknown ends {LONG}, expected some of origin-origin"),
    (lambda branch: branch.orbit(DIGITS), f"point {LONG} does not exist: the branch has"),
    (lambda branch: branch.orbit(0).sample([DIGITS]), "numbers; received a list with an integer beyond all floats"),
    (lambda branch: branch.orbit(0).sample(HUGE), f"times is a list of finite numbers; received {BEYOND}"),
    (lambda branch: branch.neighbours(DIGITS), f"an event is one of branch.events or its id; received {LONG}"),
    (lambda branch: branch.save(DIGITS), f"a path is text; received {LONG}, expected the name of a file"),
    (lambda branch: saltus.load_scene(DIGITS), f"scene {LONG}: expected a TOML file or the name of a scene; shipped"),
    (lambda branch: saltus.read_branch(DIGITS), f"a path is text; received {LONG}, expected the name of a JSON file"),
    (lambda branch: saltus.Catalogue(DIGITS), f"a catalogue is the name of a file; received {LONG}"),
    (lambda branch: saltus.trace(DIGITS), f"a name is text such as S13O00+ or U8353-@h=1.9; received {LONG}"),
    (lambda branch: saltus.trace("S13O00+", direction=DIGITS), f"direction {LONG}: expected up, down or both"),
    (lambda branch: saltus.section(system(), 1.0, crossings=DIGITS), f"crossings is an integer from 1 to 1000000000; received {LONG}"),
    # bytes and text for numbers
    (lambda branch: system(mu=b"0.1"), "mu, the mass ratio, is a number; received b'0.1'"),
    (lambda branch: saltus.Stop((b"1",), 0.0), "the gap row of a stop is a list of numbers; received (b'1',)"),
    (lambda branch: saltus.ImpactSystem([[b"1"]], [["0"]], [[1.0]], [saltus.Stop((1.0,), 0.0)]), "received [[b'1']]"),
    (lambda branch: saltus.simulate(system(), [b"0", b"0"], [0, 0], 1.0), "u is a list of 2 finite numbers; received [b'0', b'0']"),
    (lambda branch: saltus.simulate(system(), [0, 0], [0, 0], b"1"), "duration is a finite time of 0 or more; received b'1'"),
    (lambda branch: saltus.trace("S13O00+", energy=(b"1", b"2")), "energy range (b'1', b'2'): expected two numbers (LO, HI)"),
    (lambda branch: saltus.discover(system(), b"1"), "the energy is b'1', expected a finite number above 0"),
    (lambda branch: saltus.section(system(), "1"), "the energy of a section is a finite number above 0; received '1'"),
    (lambda branch: saltus.Constant([b"1"]), "load is a list of finite numbers; received [b'1']"),
    # nested lists
    (lambda branch: saltus.Stop([[1, -1]], -1.0, 1.0), "the gap row of a stop is a list of numbers; received [[1, -1]]"),
    (lambda branch: saltus.trace("S13O00+", energy=[[1, 2], [3, 4]]), "energy range [[1, 2], [3, 4]]: expected two numbers (LO, HI)"),
    # buffers and booleans for numbers
    (lambda branch: saltus.Stop(bytearray(b"12"), -1.0, 1.0), "the gap row of a stop is a list of numbers; received bytearray(b'12')"),
    (lambda branch: saltus.Stop(array.array("b", b"12"), -1.0, 1.0), "is a list of numbers; received array('b', [49, 50])"),
    (lambda branch: saltus.ImpactSystem([bytearray(b"1")], [[0]], [[1]], [saltus.Stop((1,), 0)]), "received [bytearray(b'1')]"),
    (lambda branch: system(mu=np.array(True)), "mu, the mass ratio, is a number; received array(True)"),
    (lambda branch: system(mu=array.array("b", b"1")), "mu, the mass ratio, is a number; received array('b', [49])"),
    (lambda branch: spring(b"1"), "parameter k is a finite real number; received b'1'"),
    (lambda branch: spring(True), "parameter k is a finite real number; received True"),
    (lambda branch: Simulator(system()).run([0.5, True], [0, 0], 1.0), "u is a list of 2 finite numbers; received [0.5, True]"),
    (lambda branch: Simulator(system()).run_many([bytearray(b"1234")], 1.0), "an array (m, 4) of finite numbers; received [bytearray"),
    (lambda branch: Simulator(system()).run_many([[0, 0, 0]], 1.0), "states is an array (m, 4) of finite numbers; received [[0, 0, 0]]"),
    (lambda branch: Simulator(system()).run(memoryview(b"12"), [0, 0], 1.0), "u is a list of 2 finite numbers; received <memory at"),
    (lambda branch: Simulator(system()).run([0, 0], [0, 0], 1.0, marks=b"1"), "marks is a list of finite numbers; received b'1'"),
    (lambda branch: saltus.section(system(), 1.0, starts=b"12"), "starts is an array of numbers of shape (m, 2); received b'12'"),
    (lambda branch: saltus.section(system(), 1.0, orbits=1, longest=b"1"), "longest is a finite time above 0; received b'1'"),
    (lambda branch: saltus.discover(system(), 1.0, impacts=0), "at most 0 impacts in half a period: no orbit with impacts has so few"),
    # another kind of object
    (lambda branch: branch.neighbours(None), "an event is one of branch.events or its id; received None"),
    (lambda branch: branch.neighbours("SB1"), "SB1 is of type SB; neighbours need an event of type GR"),
    (lambda branch: branch.neighbours("SB1", cover=0), "cover is 0, expected 1 or more"),
    (lambda branch: branch.switch("EP1"), "EP1 is of type EP; switching starts from BP, SB, PD or RT"),
    (lambda branch: branch.neighbours("GR9"), "no event 'GR9' on this branch; it has EP1, SB1, EP2"),
    (lambda branch: Simulator("x"), "the system is 'x', expected an ImpactSystem"),
    (lambda branch: saltus.simulate(None, [0], [0], 1.0), "the system is None, expected an ImpactSystem"),
    (lambda branch: saltus.families_at(math.nan, 1, 1), "the mode is nan, expected one of saltus.linear_modes(system)"),
    (lambda branch: saltus.families_at(saltus.linear_modes(system())[0], math.nan, 1), "cover = nan: expected an integer, 1 to 11"),
    (lambda branch: at_mode((3, 1)), "energy range 3:1 is empty or reversed; expected 0 <= LO < HI"),
    (lambda branch: at_mode((math.nan, 1)), "energy range nan:1: expected 0 <= LO < HI"),
    (lambda branch: at_mode(3), "energy range 3: expected two numbers (LO, HI)"),
    (lambda branch: at_mode((1, 2, 3)), "energy range (1, 2, 3): expected two numbers (LO, HI)"),
    (lambda branch: saltus.changes(math.nan), "the stages are nan, expected a list of those that saltus.stages_of gives"),
    (lambda branch: saltus.changes(["A"]), "the stages are ['A'], expected a list of those that saltus.stages_of gives"),
    (lambda branch: saltus.discover(system(), 1.0, ends="foo"), "the ends are 'foo', expected a list with some of origin-origin"),
    (lambda branch: saltus.write_atlas(3, "a.csv"), "the data of a figure are 3, expected an Atlas"),
    (lambda branch: saltus.Catalogue("a.sqlite", "a", scene=3), "the scene is 3, expected a Scene"),
    (lambda branch: saltus.trace("S13O00+", scene=dataclasses.replace(saltus.load_scene(), loads=("forces",))), "the scene has [[forces]]"),
    (lambda branch: saltus.trace("S13O00+", energy=(False, True)), "energy range (False, True): expected two numbers (LO, HI)"),
    (lambda branch: saltus.trace(5), "a name is text such as S13O00+ or U8353-@h=1.9; received 5"),
    (lambda branch: saltus.trace("S13O00+", 5), "the system is 5, expected an ImpactSystem"),
    (lambda branch: saltus.trace("S13O00+", scene=5), "scene 5: expected a TOML file or the name of a scene; shipped: absorber, "),
    (lambda branch: saltus.trace("S13O00+", points="a"), "points = 'a': expected an integer, at least 1"),
    (lambda branch: saltus.trace("S13O00+", stop_when=3), "stop_when = 3: expected a function of an orbit"),
    (lambda branch: saltus.trace("S13O00+", stop_wen=len), "unexpected keyword argument 'stop_wen'"),
    (lambda branch: saltus.trace("S13O00+", reference_points=3), "reference_points = 3: expected a mapping"),
    (lambda branch: saltus.trace("S13O00+", bounds=3), "bounds = 3: expected a mapping"),
    (lambda branch: saltus.trace("S13O00+", stop_at="QQ"), "expected one of SN"),
    (lambda branch: saltus.trace("S13O00+", bounds={"impcts": 3}), "unknown bound 'impcts'; expected impacts"),
    (lambda branch: saltus.trace("S13O00+", energy=5), "expected two numbers"),
    (lambda branch: saltus.trace("S13O00+", bounds={"energy": 5}), "energy range 5: expected two numbers (LO, HI)"),
    (lambda branch: saltus.trace(branch.orbit(0), energy=5), "energy range 5: expected two numbers (LO, HI)"),
    (lambda branch: saltus.trace(branch.orbit(0), energy=("a", 2)), "energy range ('a', 2): expected two numbers (LO, HI)"),
    (lambda branch: saltus.trace(branch.orbit(0), energy=(1, 2, 3)), "energy range (1, 2, 3): expected two numbers (LO, HI)"),
    (lambda branch: saltus.trace(branch.orbit(0), energy=(3, 1)), "energy range 3:1 is empty or reversed; expected 0 <= LO < HI"),
    (lambda branch: saltus.trace(branch.orbit(0), energy=(3, 3.00000001)), "outside the energy range 3:3.00000001"),
    (lambda branch: saltus.trace(branch.orbit(0), system(mu=0.2)), "another system than the one given: there mu is 0.1"),
    (lambda branch: saltus.trace("mode:1"), "(linear modes are for --from; in Python see saltus.linear_modes)"),
    (lambda branch: saltus.atlas_of(branch.system, [branch], energy=(2, 1)), "energy range 2:1 is empty or reversed"),
    (lambda branch: branch.trace(9999), "point 9999 does not exist: the branch has"),
    (lambda branch: branch.trace(5, direction="left"), "expected up, down or both"),
    (lambda branch: branch.trace(5, points=0), "points = 0: expected an integer, at least 1"),
    (lambda branch: branch.trace(5, energy=(2.0, 1.0)), "empty or reversed"),
    (lambda branch: branch.trace(5, energy=(math.nan, 1.0)), "expected 0 <= LO < HI"),
    (lambda branch: branch.trace("a"), "a point is an integer; received 'a'"),
    (lambda branch: branch.orbit(2.5), "a point is an integer; received 2.5"),
    (lambda branch: branch.orbits_at(alpha=math.nan), "the quarter period alpha is a finite number above 0; received nan"),
    (lambda branch: branch.orbit_at(energy=-1.0), "the energy h is a finite number above 0; received -1"),
    (lambda branch: branch.orbit(1).sample([0.0, math.nan, math.inf]), "times is a list of finite numbers; received [0.0, nan, inf]"),
    (lambda branch: branch.orbit(1).sample([[0.0]]), "times is a list of finite numbers; received [[0.0]]"),
    # states and files
    (lambda branch: saltus.simulate(system(), [2.0, 0.0], [0, 0], 1.0), "the start lies beyond stop a: its gap is 2, expected -1 to 1"),
    (lambda branch: Simulator(system()).run([2.0, 0.0], [0, 0], 1.0), "the start lies beyond stop a: its gap is 2, expected -1 to 1"),
    (lambda branch: branch.save("x.mat"), "cannot save a branch as 'x.mat': expected a name that ends in .json or .csv"),
]


@pytest.mark.parametrize(("call", "expected"), CALLS, ids=[words[:60] for _, words in CALLS])
def test_a_bad_call_is_one_line(branch, tmp_path, monkeypatch, call, expected):
    """Oracle: the argument."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, TypeError, IndexError)) as caught:
        call(branch)
    assert expected in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 400
    assert not list(tmp_path.iterdir())


CATALOGUE_CALLS = [
    (lambda catalogue: catalogue.find(None), "a name is text such as S13O00+, U83@h=1.9 or an id; received None"),
    (lambda catalogue: catalogue.branch(None), "a family is named by its id, such as origin-stop+::44db5a75; received None"),
    (lambda catalogue: catalogue.events(3), "a family is named by its id, such as origin-stop+::44db5a75; received 3"),
    (lambda catalogue: catalogue.families(energy=math.nan), "the energy of families is a finite number; received nan"),
    (lambda catalogue: catalogue.families(label=3), "the label of families is text; received 3"),
    (lambda catalogue: catalogue.families(ends=["origin"]), "the ends of families is text; received ['origin']"),
    (lambda catalogue: catalogue.families(impacts=3), "the impacts of families are two numbers, the least and the most; received 3"),
    (
        lambda catalogue: catalogue.families(impacts=[[1], [2]]),
        "the impacts of families are two numbers, the least and the most; received [[1], [2]]",
    ),
    (lambda catalogue: catalogue.connect(3), "an edge is a saltus.Edge; received 3"),
    (lambda catalogue: catalogue.add_node("L11+"), "a node is a saltus.Node; received 'L11+'"),
    (lambda catalogue: catalogue.identify(3), "an orbit is a saltus.Orbit, such as those of Branch.orbits_at; received 3"),
    (lambda catalogue: saltus.Catalogue(None), "a catalogue is the name of a file; received None"),
    (lambda catalogue: saltus.Catalogue(b"a.sqlite", "a"), "a catalogue is the name of a file; received b'a.sqlite'"),
]


@pytest.mark.parametrize(("call", "expected"), CATALOGUE_CALLS, ids=[words[:60] for _, words in CATALOGUE_CALLS])
def test_a_bad_call_of_a_catalogue_is_one_line(tmp_path, branch, call, expected):
    """Oracle: the argument; the kind of the errors of catalogues."""
    with saltus.Catalogue(tmp_path / "a.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        catalogue.add(branch)
        with pytest.raises(CatalogueError) as caught:
            call(catalogue)
        assert expected == str(caught.value)
        assert None not in catalogue and [] not in catalogue


USES = [len, lambda catalogue: catalogue.families(), lambda catalogue: catalogue.find("S13O00+"), lambda catalogue: catalogue.__enter__()]


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("mode", ["r", "a"])
@pytest.mark.parametrize("read", [False, True])
def test_a_closed_catalogue_says_so(tmp_path, branch, mode, use, read):
    """Oracle: the state that it is in, also where its families were read before it was closed."""
    path = tmp_path / "a.sqlite"
    with saltus.Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        catalogue.add(branch)
    with saltus.Catalogue(path, mode) as catalogue:
        if read:
            assert catalogue.families() and catalogue.find("S13O00+")
    with pytest.raises(CatalogueError, match=r"the catalogue .*a\.sqlite is closed; expected one that is open"):
        use(catalogue)


@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, lambda item: pickle.loads(pickle.dumps(item))])
def test_scenes_and_branches_can_be_copied(branch, twin):
    """Oracle: what the copy computes."""
    scene = saltus.load_scene()
    copied = twin(scene)
    assert copied == scene and copied.reference_points == scene.reference_points and copied.system.describe() == scene.system.describe()
    assert saltus.trace("S13O00+", scene=copied, energy=(0.3, 0.5)).points["h"].tolist() == branch.points["h"].tolist()
    assert twin(branch).points["h"].tolist() == branch.points["h"].tolist() and twin(branch).id == branch.id


def shaken(force=0.5):
    """A scene with a load."""
    return dataclasses.replace(saltus.load_scene(), forces=(saltus.Harmonic(2.0, [0.0, force]),))


def test_scenes_with_the_same_content_are_equal():
    """Oracle: the same file read twice; one number that differs, in each part."""
    scene = saltus.load_scene()
    assert saltus.load_scene() == scene and shaken() == shaken() and scene != "lee2009"
    bare, narrow = dataclasses.replace(scene, reference_points={}), dataclasses.replace(scene, energy=(0.1, 1.0))
    others = [saltus.load_scene(mu=0.2), shaken(), bare, narrow]
    assert not any(other == scene for other in others) and shaken(0.6) != shaken()


def lent(array):
    """Whether numpy refuses to write to an array, and to make it or what it is a view of writable."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        with pytest.raises(ValueError, match="cannot set WRITEABLE flag"):
            array.setflags(write=True)
        array = array.base
    return True


def test_kernels_are_not_compiled_again_for_arrays_that_cannot_be_changed(branch):
    """Oracle: how many versions of each kernel there are."""

    def versions():
        return {id(item): len(item.entries) for item in gc.get_objects() if isinstance(item, Kernel)}

    y, tangent = (np.array(values) for values in (branch.orbit(2).solution.y, branch.orbit(2).solution.tangent))
    problem = branch.problem
    for writable in (True, False):
        if not writable:
            before = versions()
            y, tangent = branch.orbit(2).solution.y, branch.orbit(2).solution.tangent
            assert not y.flags.writeable
        problem.step(y, tangent, 1e-3), problem.residual(y), problem.jacobian(y), problem.end_states(y), cycle_of(problem, y)
        stability(problem, problem.step(y, tangent, 0.0)), follow_family(problem, y, points=3), problem.scales(y)
    assert versions() == before


def test_what_objects_hand_out_cannot_be_changed(branch, tmp_path):
    """Oracle: numpy's own flag, which stays; a copy can be changed."""
    orbit = branch.orbit(2)
    twins = branch, pickle.loads(pickle.dumps(branch)), copy.deepcopy(branch)
    arrays = {f"{k}.{name}": values for k, item in enumerate(twins) for name, values in item.points.items()}
    arrays |= {f"orbit.{name}": getattr(orbit, name) for name in ("multipliers", "velocities", "impact_speeds")}
    arrays |= {f"described.{name}": values for name, values in orbit.columns.items()}
    arrays |= {f"solution.{name}": getattr(orbit.solution, name) for name in ("y", "tangent", "position", "ends", "result")}
    arrays |= {"full_family.h": branch.full_family.h, "full_family.alpha": branch.full_family.alpha}
    motion = saltus.simulate(system(lam=0.01, rho=0.7), [0.0, 0.0], [0.0, 1.0], 20.0)
    arrays |= {f"motion.{name}": values for name, values in vars(motion).items() if isinstance(values, np.ndarray)}
    arrays |= {"motion.after": motion.after, "motion.peaks": motion.peaks, "frequencies": system().modes.frequencies}
    with saltus.Catalogue(tmp_path / "a.sqlite", "a", scene=saltus.load_scene()) as catalogue:
        arrays |= {f"catalogue.{name}": values for name, values in catalogue.points(catalogue.add(branch)).items()}
    for name, values in arrays.items():
        assert lent(values), name
    assert motion.impacts > 0
    scene = saltus.load_scene()
    for mapping in (branch.points, scene.reference_points, scene.complete, next(iter(scene.reference_points.values()))):
        for change in (
            lambda mapping: mapping.__setitem__("h", 1.0), lambda mapping: mapping.update(h=1.0), lambda mapping: mapping.pop("h"),
            lambda mapping: mapping.clear(), lambda mapping: mapping.setdefault("x", 1.0), lambda mapping: mapping.__ior__({"h": 1.0}),
        ):  # fmt: skip
            with pytest.raises(TypeError, match="these data cannot be changed"):
                change(mapping)
    points = {**branch.points, "h": np.full(len(branch), math.pi)}
    assert points["h"][0] == math.pi != branch.points["h"][0]
