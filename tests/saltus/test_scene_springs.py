"""Springs, dampers and matrix files of scenes. Oracles: formulas of the forces, frequencies of a beam, what was written to the files."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import io, sparse
from scipy.integrate import solve_ivp

from saltus import load_scene
from saltus.errors import BadInput
from saltus.scene import SHIPPED
from saltus.scene.matrices import MOST, with_matrices
from saltus.scene.model import explain_search
from tests.lab.flights import SmoothFlight
from tests.saltus.running import refused, run

SCENE = """
[parameters]
k = 2.0
n = 3
[system]
mass = [[1.0, 0.0], [0.0, 0.5]]
stiffness = [[1.0, 0.0], [0.0, 0.0]]
[[springs]]
between = ["x", "y"]
polynomial = [0.5, 0.0, "k"]
[[springs]]
on = "y"
potential = "k*(cosh(w) - 1)"
[[springs]]
on = "x"
stiffness = 3.0
power = "n/2"
[[dampers]]
on = "x"
damping = 0.1
[coordinates]
names = ["x", "y"]
"""
SCENES = ("cubic_nes", "smooth_wall", "cubic_and_stops", "duffing_pair", "beam_on_cubic_spring")


def scene_of(tmp_path, text=SCENE, **parameters):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_scene(path, **parameters)


@pytest.mark.parametrize("k", [2.0, 0.3])
def test_springs_of_a_scene(tmp_path, k):
    """Oracle: the formulas; cosh(w) - 1 has the slope 1 at rest."""
    system = scene_of(tmp_path, k=k).system
    assert system.stiffness.tolist() == [[1.5, -0.5], [-0.5, 0.5 + k]] and system.damping.tolist() == [[0.1, 0.0], [0.0, 0.0]]
    x, y = u = np.array([0.7, -0.4])
    between = k * (x - y) ** 3
    exact = [between + 3.0 * x**1.5, -between + k * (np.sinh(y) - y)]
    np.testing.assert_allclose(system.smooth_forces.acting(u, 0 * u), exact, rtol=1e-13)
    assert system.why_not_conservative() == "damping acts on x (coefficient 0.1)"


def test_families_are_those_of_the_undamped_system(tmp_path):
    """Oracle: the same scene whose dampers are 0: its families are compared with damped motion."""
    text = SCENE.replace("damping = 0.1", 'damping = "c"').replace("k = 2.0", "k = 2.0\nc = 0.1")
    undamped, damped = scene_of(tmp_path, text, c=0.0), scene_of(tmp_path, text)
    assert undamped.system.is_conservative and not damped.system.is_conservative
    assert damped.underlying.system.describe() == undamped.system.describe() != damped.system.describe()


@pytest.mark.parametrize("name", SCENES)
def test_the_shipped_scenes_are_conservative_odd_and_cited(name):
    scene = load_scene(name)
    assert scene.system.is_conservative and scene.system.has_odd_symmetry and scene.system.smooth_forces is not None
    assert scene.title and scene.source and scene.energy[0] > 0.0
    assert len(scene.system.stops) == (name == "cubic_and_stops")


def test_the_cubic_sink():
    """Oracle: the equations: 0.05 u1'' + (u1 - u2)^3 = 0, u2'' + u2 - (u1 - u2)^3 = 0."""
    system = load_scene("cubic_nes").system
    u = np.array([0.8, -0.3])
    assert system.mass.tolist() == [[0.05, 0.0], [0.0, 1.0]] and system.stiffness.tolist() == [[0.0, 0.0], [0.0, 1.0]]
    np.testing.assert_allclose(system.smooth_forces.acting(u, 0 * u), [1.1**3, -(1.1**3)], rtol=1e-15)


@pytest.mark.parametrize("n", [0, 1, 10, 100])
def test_the_smooth_wall_is_one_at_the_wall(n):
    """Oracle: Eq. (9): f_n(1) = 1, its potential 1/(2 n + 2); for n = 0 the system is linear, with the coupling sigma + 1."""
    system = load_scene("smooth_wall", n=n).system
    if n == 0:
        assert system.smooth_forces is None and system.stiffness.tolist() == [[1.1, -1.1], [-1.1, 2.1]]
        return
    u = np.array([1.5, 0.5])
    assert system.smooth_forces.acting(u, 0 * u).tolist() == [1.0, -1.0] and system.smooth_forces.energy(u) == 1.0 / (2 * n + 2)
    assert np.array_equal(system.stiffness, load_scene().system.stiffness)


def test_the_beam():
    """Oracles: the script gives the files; the frequencies (k pi)^2 of a hinged beam, with errors of the fourth power of an element's
    length."""
    scene = load_scene("beam_on_cubic_spring")
    matrices = runpy.run_path(str(SHIPPED / "beam_on_cubic_spring.py"))["beam_matrices"]
    for found, made in zip((scene.system.mass, scene.system.stiffness), matrices(), strict=True):
        np.testing.assert_allclose(found, made, rtol=1e-12, atol=1e-12 * np.abs(made).max())
    exact, errors = (np.arange(1, 5) * np.pi) ** 2, []
    for elements in (11, 22, 44):
        mass, stiffness = matrices(elements)
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)[:4]
        errors.append(np.sqrt(squares) / exact - 1.0)
    assert (errors[0] > 0.0).all() and (errors[0] < [1e-5, 1e-4, 1e-3, 2e-3]).all()
    assert (abs(np.log2(errors[1][1:] / errors[2][1:]) - 4.0) < 0.1).all()
    np.testing.assert_allclose(scene.system.modes.frequencies[:4], exact * (1.0 + errors[0]), rtol=1e-10)
    assert scene.system.smooth_forces.inputs.tolist() == [[float(k == 4) for k in range(20)]]


TEXT = """
[system]
mass = [[1.0, 0.0], [0.0, 0.5]]
stiffness = [[1.0, 0.0], [0.0, 2.0]]
[[springs]]
potential = "3*(1 - cos(u1 - u2)) + exp(u1) - u1 + sqrt(1 + u2**2) + log(2 + u1**2) + tanh(u2)**4 + (u1*u2)**2"
[[springs]]
between = ["u1", "u2"]
stiffness = 2.0
power = 2.6
"""


@pytest.mark.parametrize(("name", "time"), [(name, 0.02 if "beam" in name else 0.9) for name in (*SCENES, "")])
def test_a_flight_is_that_of_another_integrator(tmp_path, name, time):
    """Oracle: DOP853 of scipy, with the formulas of the forces in place of their jets; constant energy."""
    system = load_scene(name).system if name else scene_of(tmp_path, TEXT).system
    n = system.degrees_of_freedom
    random = np.random.default_rng(3)
    state = np.concatenate([0.1 * random.normal(size=n), random.normal(size=n)])

    def rate(_, z):
        force = system.stiffness @ z[:n] + system.smooth_forces.acting(z[:n], z[n:])
        return np.concatenate([z[n:], -np.linalg.solve(system.mass, force)])

    other = solve_ivp(rate, (0.0, time), state, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    found = system.modes.to_state @ SmoothFlight.of(system).end(system.modes.from_state @ state, time).state
    assert np.abs(found - other).max() < 1e-11 * np.abs(other).max()
    assert abs(system.energy(found[:n], found[n:]) / system.energy(state[:n], state[n:]) - 1.0) < 1e-14


MASS, STIFFNESS = np.array([[1.0, 0.1], [0.1, 0.5]]), np.array([[2.0, -1.0], [-1.0, 1.0]])
DAMPING = np.array([[0.2, -0.1], [-0.1, 0.3]])
FILES = """
[system]
mass = "MASS"
stiffness = "STIFFNESS"
[[stops]]
c = [1.0, -1.0]
upper = 1.0
"""


MARKET = [
    ("large", "coordinate real general", "4000000000 4000000000 1\n1 1 1.0"),
    ("many", "coordinate real general", "2 2 1000000000000\n1 1 1.0"),
    ("wide", "array real general", "2 3\n1 2 3 4 5 6"),
    ("text_in", "array real general", "2 2\n1 one 3 4"),
    ("nan", "array real general", "2 2\n1 nan 3 4"),
    ("outside", "coordinate real general", "2 2 1\n3 1 1.0"),
    ("pattern", "coordinate pattern general", "2 2 1\n1 1"),
]
"""Matrix Market files that are no matrices of a system: name, rest of the first line, content."""


def write_matrices(folder):
    """The matrices in three formats, dense and sparse."""
    np.savez(folder / "both.npz", M=MASS, K=STIFFNESS, C=DAMPING)
    io.savemat(folder / "both.mat", {"mass": MASS, "stiffness": sparse.csc_matrix(STIFFNESS), "damping": DAMPING})
    io.mmwrite(folder / "mass.mtx", MASS, precision=17)
    io.mmwrite(folder / "stiffness.mtx", sparse.coo_matrix(STIFFNESS), precision=17)
    io.mmwrite(folder / "damping.mtx", DAMPING, precision=17)
    np.savez(folder / "other.npz", A=MASS)
    np.savez(folder / "list.npz", M=MASS[0], K=STIFFNESS)
    np.savez(folder / "complex.npz", M=1j * MASS)
    io.savemat(folder / "complex.mat", {"M": 1j * MASS})
    io.savemat(folder / "cell.mat", {"M": np.array([MASS, "text"], dtype=object)})
    io.savemat(folder / "huge.mat", {"M": sparse.csc_matrix((1_000_000, 1_000_000))}, do_compression=True)
    (folder / "hdf.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    for name, head, body in MARKET:
        (folder / f"{name}.mtx").write_text(f"%%MatrixMarket matrix {head}\n% a remark\n{body}\n")
    (folder / "text.npz").write_text("no archive")
    (folder / "text.mtx").write_text("no matrix")
    (folder / "text.mat").write_text("no matrix, but as long as a header is\n" * 10)
    (folder / "short.npz").write_bytes((folder / "both.npz").read_bytes()[:-40])


@pytest.mark.parametrize(
    ("mass", "stiffness", "damping"),
    [("both.npz", "both.mat", "both.npz"), ("both.mat", "both.npz", "both.mat"), ("mass.mtx", "stiffness.mtx", "damping.mtx")],
)
def test_matrices_from_files(tmp_path, mass, stiffness, damping):
    """Oracle: the matrices that were written; names are relative to the scene."""
    write_matrices(tmp_path)
    text = FILES.replace('"MASS"', f'"{mass}"\ndamping = "{damping}"').replace("STIFFNESS", stiffness)
    system = scene_of(tmp_path, text).system
    assert np.array_equal(system.mass, MASS) and np.array_equal(system.stiffness, STIFFNESS) and np.array_equal(system.damping, DAMPING)


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ("both.np", "[system]: mass = 'both.np', expected rows of numbers, or a file .mtx (Matrix Market), .npz or .mat"),
        ("boht.npz", "mass = 'boht.npz' does not exist; nearest: both.npz"),
        ("text.npz", "[system]: mass = 'text.npz': it is damaged, or no NPZ file"),
        ("text.mtx", "[system]: mass = 'text.mtx': it is damaged, or no Matrix Market file"),
        ("text.mat", "[system]: mass = 'text.mat': it is damaged, or no MAT file"),
        ("short.npz", "[system]: mass = 'short.npz': it is damaged, or no NPZ file"),
        ("large.mtx", "mass = 'large.mtx' is 4000000000 x 4000000000; expected at most 2000 rows: reduce the model"),
        ("many.mtx", "[system]: mass = 'many.mtx': it is damaged, or no Matrix Market file"),
        ("wide.mtx", "mass = 'wide.mtx' is 2 x 3; expected a square matrix"),
        ("text_in.mtx", "mass = 'text_in.mtx': it is damaged, or no Matrix Market file"),
        ("nan.mtx", "mass = 'nan.mtx' has nan in row 1, column 2; expected finite numbers"),
        ("outside.mtx", "mass = 'outside.mtx' has an entry outside of its 2 rows and columns"),
        ("pattern.mtx", "mass = 'pattern.mtx' is no matrix of real numbers; its numbers are 'pattern'"),
        ("complex.mat", "mass = 'complex.mat' is no matrix of real numbers; its numbers are complex"),
        ("complex.npz", "mass = 'complex.npz' is no matrix of real numbers; its numbers are complex"),
        ("cell.mat", "mass = 'cell.mat' is no matrix of real numbers"),
        ("huge.mat", "mass = 'huge.mat' is 1000000 x 1000000; expected at most 2000 rows: reduce the model"),
        ("hdf.mat", "mass = 'hdf.mat' is MAT 7.3 (HDF5); expected version 7 or lower: save it with -v7"),
        ("other.npz", "mass = 'other.npz' has no matrix mass or M; it has A"),
        ("list.npz", "mass = 'list.npz' is no matrix of real numbers; received a list of 2"),
    ],
)
def test_a_file_without_a_matrix_is_refused(tmp_path, mass, words):
    write_matrices(tmp_path)
    with pytest.raises(ValueError) as error:
        scene_of(tmp_path, FILES.replace("MASS", mass).replace("STIFFNESS", "both.npz"))
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("compressed", [False, True])
def test_matrices_of_each_kind(tmp_path, compressed):
    """Oracle: scipy's writers, of all symmetries, types of numbers and versions; symmetric matrices have their lower part in the file."""
    whole, integer = np.array([[4.0, 1.0, 0.0], [1.0, 5.0, -2.0], [0.0, -2.0, 6.0]]), np.array([[4, 1], [1, 300]], dtype=np.int16)
    for k, (matrix, symmetry) in enumerate(
        (m, s) for m in (whole, sparse.coo_matrix(whole), integer, sparse.coo_matrix(integer)) for s in ("general", "symmetric")
    ):
        io.mmwrite(tmp_path / f"{k}.mtx", matrix, symmetry=symmetry, precision=17)
    skew = np.array([[0.0, -2.0], [2.0, 0.0]])
    io.mmwrite(tmp_path / "skew.mtx", skew, symmetry="skew-symmetric", precision=17)
    io.mmwrite(tmp_path / "twice.mtx", sparse.coo_matrix(([1.0, 2.0], ([0, 0], [1, 1])), shape=(2, 2)))
    content = {"other": np.zeros((3, 5)), "M": integer, "K": sparse.csc_matrix(whole), "text": "damping"}
    io.savemat(tmp_path / "5.mat", content, do_compression=compressed)
    io.savemat(tmp_path / "4.mat", content, format="4")
    (np.savez_compressed if compressed else np.savez)(tmp_path / "all.npz", M=integer, K=whole)

    def read(key, name):
        return np.array(with_matrices({key: name}, tmp_path, "[system]")[key])

    for k in range(8):
        assert np.array_equal(read("mass", f"{k}.mtx"), (whole, integer)[k // 4])
    assert np.array_equal(read("damping", "skew.mtx"), skew) and read("mass", "twice.mtx").tolist() == [[0.0, 3.0], [0.0, 0.0]]
    for name in ("5.mat", "all.npz"):
        assert np.array_equal(read("mass", name), integer) and np.array_equal(read("stiffness", name), whole)
    with pytest.raises(BadInput, match="is MAT 4; expected version 5 to 7: save it with -v7"):
        read("mass", "4.mat")


@cache
def written():
    """Files of matrices as bytes, by kind."""
    with TemporaryDirectory() as place:
        folder = Path(place)
        write_matrices(folder)
        io.savemat(folder / "4.mat", {"M": MASS, "K": STIFFNESS, "C": DAMPING}, format="4")
        io.savemat(folder / "packed.mat", {"M": MASS, "K": sparse.csc_matrix(STIFFNESS), "C": DAMPING}, do_compression=True)
        names = "both.npz", "complex.npz", "both.mat", "packed.mat", "4.mat", "complex.mat", "mass.mtx", "stiffness.mtx", "nan.mtx"
        return [(name.partition(".")[2], (folder / name).read_bytes()) for name in names]


DAMAGE = st.one_of(
    st.binary(max_size=6),
    st.sampled_from([b"nan", b"1e999", b"-1", b"99999999999999999999", b"4294967296", b"complex", b"array", b"symmetric", b"\n"]),
    st.sampled_from([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x0f\x00\x00\x00", b"\x05\x00\x00\x00"]),
)


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 8),
    st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 8), DAMAGE), min_size=1, max_size=4),
    st.booleans(),
    st.sampled_from(["mass", "damping", "stiffness"]),
)
def test_damaged_files_of_matrices(which, damage, cut, key):
    """Oracle: the result is a square matrix of finite numbers, or an error of one line that names the table, without words of libraries."""
    kind, content = written()[which]
    for part, length, bytes_ in damage:
        at = int(part * len(content))
        content = content[:at] if cut and length == 0 else content[:at] + bytes_ + content[at + length :]
    with TemporaryDirectory() as place:
        (Path(place) / f"m.{kind}").write_bytes(content)
        try:
            rows = with_matrices({key: f"m.{kind}"}, Path(place), "[system]")[key]
        except BadInput as error:
            text = str(error)
            assert f"[system]: {key} = 'm.{kind}'" in text and text.isprintable()
            words = text.partition("'m.")[2].partition("it has")[0]
            assert not re.search("scipy|numpy|dtype|buffer|unpack|zlib|codec|index|Error", words)
            return
    matrix = np.array(rows)
    assert matrix.ndim == 2 and matrix.shape[0] == matrix.shape[1] <= MOST and np.isfinite(matrix).all()


WRONG = [
    ("power = 3", "power = 0.5", "the power of the spring on x is from 1 to 10000; received 0.5"),
    ("potential = 'w**4'", "potential = 'abs(w)**3'", "not smooth, in abs(..); expected smooth functions: a contact is a table [[stops]]"),
    ("potential = 'w**4'", "potential = 'w**4 + sign(w)'", "in sign(..); expected smooth functions: a contact is a table [[stops]]"),
    ("potential = 'w**4'", "potential = 'x**4 + z'", "has the symbol x, which is neither w nor a parameter"),
    ("potential = 'w**4'", "potential = 'k4*w**4'", "the spring on y has the symbol k4, which is neither w nor a parameter; nearest: "),
    ('on = "x"', 'on = "z"', "a spring acts on 'z', which is no coordinate; nearest: "),
    ('on = "x"', 'at = "x"', "unknown key 'at' in a spring"),
    ('on = "x"', "slop = 1.0", "unknown key 'slop' in a spring; nearest known: on"),
    (
        "potential = 'w**4'",
        "potential = 'sqrt(-1)*w**4'",
        "the spring on y has a number that is not real, or not finite; received 'sqrt(-1)*w**4'",
    ),
    ("potential = 'w**4'", "potential = 'log(-1)*w**4'", "the spring on y has a number that is not real, or not finite"),
    ("potential = 'w**4'", "potential = 'w**4/0'", "the spring on y has a number that is not real, or not finite"),
    ("stiffness = 1.0", "", "the spring on x has one of stiffness, polynomial, potential, force; received none"),
]
TWO = """
[system]
mass = [[1.0, 0.0], [0.0, 0.5]]
stiffness = [[1.0, 0.0], [0.0, 0.0]]
[[springs]]
on = "x"
stiffness = 1.0
power = 3
[[springs]]
on = "y"
potential = 'w**4'
[coordinates]
names = ["x", "y"]
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""


@pytest.mark.parametrize(("right", "wrong", "words"), WRONG)
def test_a_wrong_spring_is_one_line(tmp_path, capsys, right, wrong, words):
    assert right in TWO
    (tmp_path / "scene.toml").write_text(TWO.replace(right, wrong))
    refused(run(capsys, "continue", "S11-", "--scene", tmp_path / "scene.toml"), "scene.toml", words)


def test_an_unknown_key_is_named_beside_parameters(tmp_path, capsys):
    """Its value is not read as an expression of parameters first."""
    scene = TWO.replace('on = "x"\nstiffness = 1.0', 'at = "x"\nstiffness = "k"')
    (tmp_path / "scene.toml").write_text("[parameters]\nk = 1.0\n" + scene)
    refused(
        run(capsys, "continue", "S11-", "--scene", tmp_path / "scene.toml"), "scene.toml", "unknown key 'at' in a spring; nearest known: "
    )


def test_springs_go_with_matrices(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text('[system]\nmodel = "vibro_impact_nes"\n[[springs]]\non = "u1"\nstiffness = 1.0\n')
    words = "[springs] goes with matrices; model vibro_impact_nes brings its own"
    refused(run(capsys, "run", "--scene", tmp_path / "scene.toml", "--duration", 1), words)


@pytest.mark.parametrize(
    "words",
    [
        ("impulsive", "--energy", "1:2"),
    ],
)
def test_commands_with_linear_flights_refuse_springs_that_are_not(capsys, words):
    """They never leave the springs out."""
    command, *others = words
    expected = f"saltus {command} computes linear flights, and the spring between u1 and u2 is not linear; expected a scene with linear"
    refused(run(capsys, command, *others, "--scene", "smooth_wall"), expected)


def test_linear_springs_are_no_reason_to_refuse(tmp_path, capsys):
    """Oracle: the same stiffness as a matrix."""
    linear = "[system]\nmass = [[1.0]]\nstiffness = [[{}]]\n[[stops]]\nc = [1.0]\nupper = 0.5\n"
    spring = '[[springs]]\non = "u1"\nstiffness = 3.0\n'
    found = []
    for text in (linear.format("1.0") + spring, linear.format("4.0")):
        (tmp_path / "scene.toml").write_text(text)
        code, out, _ = run(capsys, "run", "--scene", tmp_path / "scene.toml", "--duration", 3, "--state", "0,2")
        assert code == 0
        found.append(out)
    assert found[0] == found[1]


def test_the_model_of_a_scene_with_springs(tmp_path):
    """Oracle: what the scene has: no stops, odd springs; then a force w^2."""
    lines = explain_search(load_scene("smooth_wall").system)
    assert lines[0].startswith("the spring between u1 and u2 is not linear -> free flight is a Taylor series")
    assert lines[1] == "no stops -> no impacts" and lines[2].startswith("odd springs -> mirror images")
    text = '[system]\nmass = [[1.0]]\nstiffness = [[1.0]]\n[[springs]]\non = "u1"\npolynomial = [0.0, 1.0, 1.0]\n'
    assert explain_search(scene_of(tmp_path, text).system)[2].startswith("springs that are not odd -> no ends at the origin")


def test_the_domain_of_a_power(tmp_path):
    parametric = scene_of(tmp_path, SCENE.replace('"n/2"', '"n"')).parametric
    assert parametric.domain("n") == (1.0, 10_000.0) and parametric.domain("k") == (-np.inf, np.inf)


def test_a_scene_without_springs_loads_nothing_of_them():
    """Oracle: the modules that a new process has."""
    heavy = {"bvp.smooth_forces", "bvp.jet_programs", "sympy"}
    code = f"import sys, saltus; saltus.load_scene().system.modes; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
