"""`saltus continue NAME --in PARAMETER --keep EQUATION`: starts, files, figures, messages, exit codes."""

import csv

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import loadmat

import saltus
from benchmarks.backbone import Backbone
from branches.naming.at_modes import orbit_at_mode
from tests.saltus.running import read_json, refused, run
from tests.units import CHANGES, Units

pytestmark = pytest.mark.usefixtures("folder")


def rows_of(path):
    """The rows of a CSV file."""
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def grazing_in_sigma():
    """Where the linear mode of the reference system grazes with energy 0.6: h = w^2/(2 b^2), in closed form."""

    def beyond(sigma):
        w, _, b = Backbone(0.1, sigma).modes[0]
        return w**2 / (2 * b**2) - mp.mpf("0.6")

    with mp.workdps(30):
        return float(mp.findroot(beyond, mp.mpf("0.168")))


def test_a_backbone_in_sigma(capsys):
    """Oracle: the closed form at each point, in each kind of file."""
    words = "S13+", "--in", "sigma", "--range", "0.06:0.2", "--keep", "energy=0.6"
    files = [word for kind in ("json", "csv", "npz", "mat") for word in (f"--{kind}", f"a.{kind}")]
    code, out, err = run(capsys, "continue", *words, *files, "--plot", "a.png", "--y", "start:u1'", "--uz", "0.15")
    assert code == 0, err
    assert out.splitlines()[0] == "start  S13O00+: from h = 0.6, alpha = 1.699237773"
    assert "origin-stop+, sequence (none); energy=0.6" in out and "event" in out and "stable after" in out
    branch = read_json("a.json")["branches"][0]
    assert branch["ends"] == ["origin", "stop+"] and branch["keep"] == ["energy=0.6"] and branch["released"] == ["sigma"]
    points = branch["points"]
    assert points[0]["sigma"] == pytest.approx(0.06) and points[-1]["sigma"] == pytest.approx(grazing_in_sigma(), rel=1e-9)
    at_events = {event["values"]["sigma"] for event in branch["events"]}
    for point in (point for point in points if point["sigma"] not in at_events):
        form = Backbone(0.1, point["sigma"])
        assert float(form.energy(point["alpha"])) == pytest.approx(0.6, rel=1e-12)
        assert point["h"] == pytest.approx(0.6, rel=1e-13) and point["label"] == "S13O00+"
        assert point["stable"] is form.stable(point["alpha"])
    marked = next(event for event in branch["events"] if event["type"] == "UZ")
    assert marked["values"]["sigma"] == pytest.approx(0.15) and set(marked["values"]) >= {"mu", "sigma", "energy", "quarter_period"}
    rows = rows_of("a.csv")
    assert [float(row["alpha"]) for row in rows] == [point["alpha"] for point in points]
    with np.load("a.npz") as arrays:
        assert arrays["alpha"].tolist() == [point["alpha"] for point in points]
    assert loadmat("a.mat")["sigma"].ravel().tolist() == [point["sigma"] for point in points]


def test_a_saved_family_is_shown_drawn_and_goes_on(capsys):
    """Oracle: the file; the closed form of the end; the family that begins at an event has it at the same sigma."""
    code, _, err = run(capsys, "continue", "S13+", "--in", "sigma", "--range", "0.09:0.13", "--keep", "energy=0.6", "--json", "a.json")
    assert code == 0, err
    shown = run(capsys, "show", "a.json")
    assert shown[0] == 0 and "energy=0.6" in shown[1] and "S" in shown[1]
    assert run(capsys, "plot", "a.json", "--y", "tau_half", "--plot", "a.pdf")[0] == 0
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--range", "0.06:0.2", "--json", "b.json")
    assert code == 0 and "GR1" in out
    first, last = (read_json(name)["branches"][0] for name in ("a.json", "b.json"))
    assert {event["type"] for event in first["events"]} == {"SB", "EP"}
    assert last["points"][-1]["sigma"] == pytest.approx(grazing_in_sigma(), rel=1e-9)
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--in", "mu", "--range", "0.09:0.11", "--keep", "energy = 0.6*mu/0.1")
    assert code == 0 and "mu = 0.09" in out
    code, _, err = run(capsys, "continue", "--from", "b.json:SB1", "--json", "c.json")
    assert code == 0, err
    first, last = (read_json(name)["branches"][0]["events"] for name in ("b.json", "c.json"))
    broken = next(event["values"]["sigma"] for event in first if event["type"] == "SB")
    assert next(event["values"]["sigma"] for event in last if event["type"] == "BP") == pytest.approx(broken, rel=1e-9)
    code, _, err = run(capsys, "continue", "--from", "b.json:GR1")
    assert code == 1 and "all impacts vanish at GR1: the linear mode L11+ remains" in err


def test_two_parameters_and_an_equation_that_names_both(capsys):
    """Oracle: the closed form where energy = quarter_period/3 and sigma = mu."""
    keep = "--keep", "energy = quarter_period/3", "--keep", "sigma = mu"
    words = "continue", "S13+", "--in", "mu,sigma", "--range", "0.05:0.3", *keep, "--points", "30", "--csv", "a.csv"
    code, out, err = run(capsys, *words)
    assert code == 0, err
    for point in rows_of("a.csv")[::5]:
        mu, alpha = float(point["mu"]), float(point["alpha"])
        assert float(point["sigma"]) == pytest.approx(mu, rel=1e-14)
        assert float(Backbone(mu, mu).energy(alpha)) == pytest.approx(alpha / 3.0, rel=1e-12)


def test_a_mode_and_a_file_of_an_orbit(capsys):
    words = "--in", "mu", "--range", "0.09:0.11", "--keep", "energy=1"
    code, out, err = run(capsys, "continue", "--from", "mode:1", *words)
    assert code == 0 and out.startswith("start  S13O00+: from h = 1"), err
    assert run(capsys, "orbit", "S13+", "--energy", "0.5", "--json", "orbit.json")[0] == 0
    code, out, err = run(capsys, "continue", "--from", "orbit.json", *words)
    assert code == 0 and out.startswith("start  S13O00+: from h = 1"), err


CASES = [
    ("--in mu --range 0.02:1", ["--in mu needs 1 equation --keep", "energy=0.8", "received 0"]),
    ("--in mu,sigma --range 0.02:1 --keep energy=1", ["needs 2 equations --keep", "received 1"]),
    ("--in mu,mu --range 0.02:1 --keep energy=1 --keep sigma=1", ["given twice"]),
    ("--in mu --keep energy=0.5", ["--range LO:HI is required"]),
    ("--in nu --range 0.02:1 --keep energy=0.5", ["--in nu: no such parameter; nearest: mu"]),
    ("--in mu --range 0.2:1 --keep energy=0.5", ["--range 0.2:1 has not the start's value mu = 0.1", "--set mu=VALUE"]),
    ("--in lam --range 0:1 --keep energy=0.5", ["lam damps the system", "conservative"]),
    ("--in rho --range 0.5:1 --keep energy=0.5", ["rho changes a restitution", "conservative"]),
    ("--in mu --range 0.02:1 --keep energy=-1", ["--keep energy=-1: expected a value above 0"]),
    ("--in mu --range 0.02:1 --keep energy=1e9", ["no orbit of S13+ has h = 1000000000"]),
    ("--in mu --range 0.02:1 --keep foo=1", ["name foo, which is no parameter", "energy, quarter_period"]),
    ("--in mu --range 0.02:1 --keep sigma=0.1", ["no equation names energy or quarter_period"]),
    ("--in mu --range 0.02:1 --keep energy", ["an equation is LEFT = RIGHT"]),
    ("--in mu --range 0.02:1 --keep energy=quarter_period*99", ["no orbit of S13+ fulfils it", "the family has h ="]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --y alfa", ["--y: unknown column 'alfa'; nearest: alpha"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --energy 1:2", ["--energy belongs to families in the energy"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --phase 1", ["--phase is where a simulation starts"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --stop-at EP", ["--stop-at EP: a family of free orbits in a parameter has no such event"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --set lam=0.1", ["families of free orbits need a conservative system: damping acts on u2"]),
    ("--in w --range 0.02:1 --keep energy=0.5 --scene absorber", ["S13+ is a free orbit, and the scene has [[forces]]"]),
]


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_bad_input(capsys, words, expected):
    refused(run(capsys, "continue", "S13+", *words.split()), *expected)


def test_a_scene_without_parameters(capsys, tmp_path):
    matrices = "mass = [[1.0]]\nstiffness = [[1.0]]\n"
    (tmp_path / "scene.toml").write_text(f'[system]\n{matrices}[[springs]]\non = "u1"\nstiffness = 1.0\npower = 3\n')
    words = ("--scene", tmp_path / "scene.toml", "--from", "mode:1", "--in", "k", "--range", "0:1", "--keep", "energy=1")
    refused(run(capsys, "continue", *words), "--in k: no such parameter; the scene has no [parameters]")


def test_bad_input_with_a_file(capsys):
    assert run(capsys, "continue", "S13+", "--in", "sigma", "--range", "0.09:0.1", "--keep", "energy=0.5", "--json", "a.json")[0] == 0
    refused(run(capsys, "continue", "--from", "a.json:EP1"), "no other family begins at EP1", "BP, SB, PD, RT, GR")
    refused(run(capsys, "continue", "--from", "a.json:XX"), "has no event XX")
    refused(run(capsys, "continue", "--from", "a.json:EP1", "--in", "mu", "--keep", "energy=1"), "keeps energy=0.5", "expected no --in")
    refused(run(capsys, "continue", "S13+", "--from", "a.json"), "received S13+ and --from a.json")
    refused(run(capsys, "continue", "--from", "a.json", "--keep", "energy=1"), "needs --in NAME")
    refused(run(capsys, "continue", "--from", "a.json", "--set", "mu=0.2"), "has a system of its own")
    refused(run(capsys, "continue", "--from", "a.json", "--in", "sigma", "--keep", "energy=1"), "--range LO:HI is required")


def scene_under_gravity(path, mass, stiffness, stops, loads, parameters, springs="", bounds=(0.01, 50.0, 8.0)):
    """Write a scene under constant loads."""
    names = [f"y{k + 1}" for k in range(len(mass))]
    tables = "".join(f"[[stops]]\nc = {c}\nlower = {lower!r}\n" for c, lower in stops)
    tables += "".join(f'[[forces]]\non = "{name}"\nconstant = "{load}"\n' for name, load in zip(names, loads, strict=True))
    values = "".join(f"{name} = {value!r}\n" for name, value in parameters.items())
    limits = f"[bounds]\nenergy = {[*bounds[:2]]}\nquarter_period = {bounds[2]!r}\nimpacts = 4\n"
    system = f"[system]\nmass = {mass}\nstiffness = {stiffness}\n"
    path.write_text(f"[parameters]\n{values}{system}{springs}{tables}[coordinates]\nnames = {names}\n{limits}".replace("'", '"'))
    return path


def ball(path):
    return scene_under_gravity(path / "ball.toml", [["m"]], [[0.0]], [([1.0], 0.0)], ["-m*g"], {"m": 1.0, "g": 1.0})


def test_a_ball_on_a_floor(capsys, tmp_path):
    """Oracle: T = 2 sqrt(2 H/m)/g; from rest on the floor, from a state, from a file; and in g and m at an energy."""
    scene = ball(tmp_path)
    for number, start in enumerate((["mode:1"], ["simulate", "--start", "2,0"], ["simulate", "--start", "0,2"], ["1.json"])):
        path = f"{number}.json"
        code, out, err = run(capsys, "continue", "--scene", scene, "--from", *start, "--json", path, "--plot", "a.png")
        assert code == 0 and "rest" in out and "wrote  a.png" in out, err
        points = read_json(path)["points"]
        h, alpha = (np.array([point[key] for point in points]) for key in ("h", "alpha"))
        assert h.min() == pytest.approx(0.01) and h.max() == pytest.approx(50.0)
        np.testing.assert_allclose(4.0 * alpha, 2.0 * np.sqrt(2.0 * h), rtol=1e-12)
        assert all(point["stable"] for point in points)
    for name in "gm":
        words = ("--from", "mode:1", "--in", name, "--range", "0.25:4", "--keep", "energy=2")
        assert run(capsys, "continue", "--scene", scene, *words, "--csv", "a.csv")[0] == 0
        rows = rows_of("a.csv")
        value, alpha = (np.array([float(row[key]) for row in rows]) for key in (name, "alpha"))
        assert value.min() == pytest.approx(0.25) and value.max() == pytest.approx(4.0)
        np.testing.assert_allclose(4.0 * alpha, 4.0 / value ** {"g": 1.0, "m": 0.5}[name], rtol=1e-12)


@pytest.mark.parametrize("lower", [-1.5, -0.4])
def test_a_mass_on_a_spring_under_gravity_over_a_stop(capsys, tmp_path, lower):
    """Oracle: x'' = -(k/m)(x - x_e) falls from its highest place onto the stop at x = b in T/2 = arccos((b - x_e)/A)/w. x counts from the
    position at rest, y = -m g/k or on the stop above it; A^2 = 2 h/k + x_e^2, and x_e is the equilibrium of the spring alone."""
    m, g, k = 2.0, 1.5, 3.0
    system = scene_under_gravity(tmp_path / "s.toml", [["m"]], [["k"]], [([1.0], lower)], ["-m*g"], {"m": m, "g": g, "k": k})
    rest = max(lower, -m * g / k)

    def require(h, alpha, m, g, k):
        centre = -m * g / k - rest
        size = np.sqrt(2.0 * h / k + centre**2)
        if rest == lower:  # at the scene's values the stop holds the mass at x = 0, where the energy is zero
            assert rest > -m * g / k
        np.testing.assert_allclose(2.0 * alpha, np.arccos((lower - rest - centre) / size) * np.sqrt(m / k), rtol=1e-10)

    code, out, err = run(capsys, "continue", "--scene", system, "--from", "mode:1", "--json", "a.json")
    assert code == 0 and (f"rest   y1 = {rest:g}: displacements count from there" in out), err
    points = read_json("a.json")["points"]
    assert len(points) > 100 and max(point["h"] for point in points) == pytest.approx(50.0)
    for point in points[2:]:
        require(point["h"], point["alpha"], m, g, k)
    if rest != lower:  # the mode grazes the stop
        (grazing,) = (event for event in read_json("a.json")["events"] if event["type"] == "GR")
        assert grazing["h"] == pytest.approx(k * (lower - rest) ** 2 / 2, rel=1e-10)
    for name, interval in (("g", "1:2"), ("m", "1.5:2.5"), ("k", "2:4")):
        words = ("--from", "mode:1", "--in", name, "--range", interval, "--keep", "energy=2", "--csv", "a.csv")
        assert run(capsys, "continue", "--scene", system, *words)[0] == 0
        rows = rows_of("a.csv")
        assert len(rows) > 10
        for row in rows[::5]:
            require(2.0, float(row["alpha"]), **({"m": m, "g": g, "k": k} | {name: float(row[name])}))


def test_a_spring_that_is_not_linear_under_gravity(capsys, tmp_path):
    """Oracle: T of y'' = -y - y^3/2 - g by quadrature between its turning points; near rest 2 pi/w of the slope there."""
    springs = '[[springs]]\non = "y1"\nstiffness = 0.5\npower = 3\n'
    system = scene_under_gravity(tmp_path / "s.toml", [[1.0]], [[1.0]], [], ["-g"], {"g": 1.0}, springs)
    assert run(capsys, "continue", "--scene", system, "--from", "mode:1", "--energy", "1e-8:5", "--json", "a.json")[0] == 0
    points = read_json("a.json")["points"]
    rest = float(np.roots([0.5, 0.0, 1.0, 1.0])[np.isreal(np.roots([0.5, 0.0, 1.0, 1.0]))][0].real)
    assert min(points, key=lambda point: point["h"])["alpha"] == pytest.approx(0.5 * np.pi / np.sqrt(1.0 + 1.5 * rest**2), rel=1e-7)

    def quarter(h, g):
        at = mp.mpf(rest)
        energy = at**2 / 2 + at**4 / 8 + at + h  # of the load at rest, g = 1; x = y - rest has zero energy at x = 0
        roots = mp.polyroots([1, 0, 4, 8 * g, -8 * (energy + (g - 1) * at)])
        low, high = sorted(mp.re(root) for root in roots if abs(mp.im(root)) < 1e-15)

        def slope(t):  # y = middle + half-width sin t; 8 (V - E) = (y - low) (y - high) (y^2 + (low + high) y + ..)
            y = (low + high) / 2 + (high - low) / 2 * mp.sin(t)
            return 2 / mp.sqrt(y**2 + (low + high) * y + 4 - low * high + (low + high) ** 2)

        return float(mp.quad(slope, [-mp.pi / 2, 0, mp.pi / 2]) / 2)

    with mp.workdps(25):
        for point in points[:: len(points) // 4]:
            if point["h"] > 1e-3:
                assert point["alpha"] == pytest.approx(quarter(mp.mpf(point["h"]), mp.mpf(1)), rel=1e-10)
        words = ("--from", "mode:1", "--in", "g", "--range", "0:2", "--keep", "energy=0.5", "--csv", "a.csv")
        assert run(capsys, "continue", "--scene", system, *words)[0] == 0
        for row in rows_of("a.csv")[::40]:
            assert float(row["alpha"]) == pytest.approx(quarter(mp.mpf("0.5"), mp.mpf(float(row["g"]))), rel=1e-10)


def test_a_hopper(capsys, tmp_path):
    """Oracle: scipy integrates two masses, a spring and gravity from the orbit's start; after a period, with impacts at the floor, it is
    there again. The energy is that of the masses and of the spring, and m g y, less its value at rest."""
    g, k = 1.0, 20.0
    loads = {"g": g, "k": k}
    system = scene_under_gravity(
        tmp_path / "s.toml", [[1.0, 0.0], [0.0, 1.5]], [["k", "-k"], ["-k", "k"]], [([1.0, 0.0], 0.0)], ["-g", "-1.5*g"], loads
    )
    words = ("continue", "--scene", system, "--from", "simulate", "--start", "0,0.3,1,0")
    assert run(capsys, *words, "--json", "a.json")[0] == 0
    points = read_json("a.json")["points"]
    rest = np.array([0.0, -1.5 * g / k])

    def energy(u, v):
        return v @ np.diag([1.0, 1.5]) @ v / 2 + k * (u[0] - u[1]) ** 2 / 2 + g * (u[0] + 1.5 * u[1])

    for point in points[:: len(points) // 3]:
        u, v = (np.array(point["start"][key]) for key in "uv")
        assert point["h"] == pytest.approx(energy(u + rest, v) - energy(rest, np.zeros(2)), rel=1e-10)
        y = moved(np.concatenate([u + rest, v]), 4.0 * point["alpha"], g, k)
        # An orbit that starts on the floor is back there before its impact.
        y[2] = abs(y[2]) if abs(y[0]) < 1e-8 else y[2]
        np.testing.assert_allclose(y, [*(u + rest), *v], atol=1e-7 * np.sqrt(point["h"]))


def moved(y, duration, g, k):
    """The state of the hopper after a time, without an impact at its end."""

    def rates(t, y):
        pull = k * (y[1] - y[0])
        return [y[2], y[3], pull - g, -pull / 1.5 - g]

    def floor(t, y):
        return y[0]

    floor.terminal, floor.direction = True, -1.0
    begin = 0.0
    while duration - begin > 1e-9:
        found = solve_ivp(rates, (begin, duration), y, method="DOP853", rtol=1e-12, atol=1e-13, events=floor)
        begin, y = found.t[-1], found.y[:, -1]
        if found.status == 1 and duration - begin > 1e-9:
            y = y * [1.0, 1.0, -1.0, 1.0]
    return y


def test_a_rod_rocks_between_its_ends(capsys, tmp_path):
    """Oracle: a uniform rod of mass m hits the floor with one end, then with the other: M^-1 c of an end is (4, -2)/m, and
    T = 4 sqrt(H/(5 m))/g. Its impacts interact; they never come at one instant."""
    m, g = 1.5, 2.0
    mass = [["m/3", "m/6"], ["m/6", "m/3"]]
    stops = [([1.0, 0.0], 0.0), ([0.0, 1.0], 0.0)]
    system = scene_under_gravity(tmp_path / "s.toml", mass, [[0.0, 0.0]] * 2, stops, ["-m*g/2"] * 2, {"m": m, "g": g})
    start = f"0,{6.0 / g!r},4,-2"  # the first end at the floor, the other one where it falls from
    assert run(capsys, "continue", "--scene", system, "--from", "simulate", "--start", start, "--json", "a.json")[0] == 0
    branch = read_json("a.json")
    assert branch["branch"]["ends"] == ["stopa-", "stopb-"] and len(branch["points"]) > 100
    for point in branch["points"]:
        assert 4.0 * point["alpha"] == pytest.approx(4.0 * np.sqrt(point["h"] / (5.0 * m)) / g, rel=1e-11)
    words = ("--from", "mode:1", "--scene", system)
    refused(run(capsys, "continue", *words), "at rest the system lies on stop a and stop b", "--from simulate --start")


def test_constant_loads_in_python(tmp_path):
    """Oracle: the closed form of the ball, T = 2 sqrt(2 H/m)/g; the linear mode of a hanging mass about its position at rest."""
    scene = saltus.load_scene(ball(tmp_path))
    orbit = orbit_at_mode("mode:1", scene.about_rest.system, (0.5, 2.0))
    branch = saltus.trace_in_parameter(orbit, "g", (0.5, 2.0), keep="energy = 0.5", system=scene.parametric)
    np.testing.assert_allclose(4.0 * branch.columns["alpha"], 2.0 / branch.parameter, rtol=1e-12)
    hanging = saltus.ImpactSystem.from_lagrangian("y_dot**2/2", "2*y**2 + y", ["y"], gaps=[("y", -1, None)])
    (mode,) = saltus.linear_modes(hanging)
    assert mode.frequency == pytest.approx(2.0) and mode.energies[1] == pytest.approx(2.0 * 0.75**2)


def test_losses_under_a_constant_load_are_refused_without_a_circle(capsys, tmp_path):
    scene = ball(tmp_path)
    scene.write_text(scene.read_text().replace("lower = 0.0", "lower = 0.0\nrestitution = 0.5"))
    words = ("--scene", scene, "--in", "g", "--range", "0.5:2")
    why = "restitution 0.5 of stop a loses energy"
    refused(run(capsys, "continue", *words, "--from", "mode:1", "--keep", "energy=1"), why, "--from simulate with --in")
    refused(run(capsys, "continue", "--scene", scene, "--from", "mode:1"), why, "--from simulate with --in")
    refused(run(capsys, "continue", *words, "--from", "rest"), "the scene's loads are constant", "or --from simulate")


def test_what_hangs_nowhere_is_refused(capsys, tmp_path):
    system = scene_under_gravity(tmp_path / "s.toml", [[1.0]], [[0.0]], [([-1.0], 0.0)], ["-g"], {"g": 1.0})
    refused(run(capsys, "continue", "--scene", system, "--from", "mode:1"), "the system rests nowhere", "y1 against the constant load")
    words = ("--scene", ball(tmp_path), "--from", "simulate")
    refused(run(capsys, "continue", *words), "--from simulate needs periodic loads or losses", "expected --start", "a state of zero speed")
    refused(run(capsys, "continue", *words, "--start", "1,1"), "at rest, with all velocities 0, or on a stop")


def test_a_ball_between_a_floor_and_a_ceiling_reaches_the_ceiling(capsys, tmp_path):
    """Oracle: it reaches y = 2 with no speed where 2 m g = h; between both T = 2 (v - sqrt(v^2 - 4 g))/g with v^2 = 2 h. It starts at
    either place, and from the family below that does not touch the ceiling."""
    stops = [([1.0], 0.0), ([-1.0], -2.0)]
    system = scene_under_gravity(tmp_path / "s.toml", [[1.0]], [[0.0]], stops, ["-g"], {"g": 1.0})
    start = ("--scene", system, "--in", "g", "--range", "0.1:3", "--keep", "energy=4.5", "--from")
    below = (*start, "mode:1", "--set", "g=2.5", "--json", "g.json")
    for words in ((*start, "simulate", "--start", "0,3"), (*start, "simulate", "--start", "2,-2.23606797749979"), below):
        assert run(capsys, "continue", *words, "--csv", "a.csv")[0] == 0
        if words is below:
            assert run(capsys, "continue", "--from", "g.json:GR1", "--csv", "a.csv")[0] == 0
        rows = rows_of("a.csv")
        g, alpha = (np.array([float(row[key]) for row in rows]) for key in ("g", "alpha"))
        assert g.max() == pytest.approx(2.25, rel=1e-10) and next(row["event"] for row in rows if float(row["g"]) == g.max()) == "GR1"
        np.testing.assert_allclose(alpha[:-1], 0.5 * (3.0 - np.sqrt(9.0 - 4.0 * g[:-1])) / g[:-1], rtol=1e-6)


@pytest.mark.parametrize("start", ["1,-2", f"-1.5,{2.75**0.5!r}"])
def test_a_mass_between_two_stops_reaches_the_other_one(capsys, tmp_path, start):
    """Oracle: x = A sin t between -1.5 and b, A^2 = 2 h = 5: T = 2 (asin(b/A) + asin(1.5/A)), and the impact at b vanishes at b = A."""
    system = scene_under_gravity(tmp_path / "s.toml", [[1.0]], [[1.0]], [([1.0], -1.5), ([-1.0], "-b")], ["0*b"], {"b": 1.0})
    words = ("--from", "simulate", "--start", start, "--in", "b", "--range", "0.1:6", "--keep", "energy=2.5", "--csv", "a.csv")
    assert run(capsys, "continue", "--scene", system, *words)[0] == 0
    b, alpha = (np.array([float(row[key]) for row in rows_of("a.csv")]) for key in ("b", "alpha"))
    assert (b.min(), b.max()) == pytest.approx((0.1, np.sqrt(5.0)), rel=1e-10)
    np.testing.assert_allclose(2.0 * alpha, np.arcsin(np.minimum(b / np.sqrt(5.0), 1.0)) + np.arcsin(1.5 / np.sqrt(5.0)), rtol=1e-6)


@pytest.mark.parametrize("units", CHANGES)
def test_motion_without_a_frequency_in_other_units(capsys, tmp_path, units):
    """Oracle: a ball reaches the ceiling y = 2 where 2 m g = h; of a rod T = 4 sqrt(H/(5 m))/g. The points are as many in all units."""
    counts = []
    for one in (Units(), units):
        length, speed, h, g, m = (one.of(what) for what in ("length", "speed", "energy", "acceleration", "mass"))
        bounds = 0.01 * h, 50.0 * h, 8.0 * one.time
        gaps, mass = [([1.0], 0.0), ([-1.0], -2.0 * length)], [["m/3", "m/6"], ["m/6", "m/3"]]
        ball = scene_under_gravity(tmp_path / "s.toml", [["m"]], [[0.0]], gaps, ["-m*g"], {"m": m, "g": g}, bounds=bounds)
        ends, loads, free = [([1.0, 0.0], 0.0), ([0.0, 1.0], 0.0)], ["-m*g/2"] * 2, [[0.0, 0.0]] * 2
        rod = scene_under_gravity(tmp_path / "r.toml", mass, free, ends, loads, {"m": m, "g": g}, bounds=bounds)
        begun = ["simulate", "--in", "g", "--range", f"{0.5 * g!r}:{3 * g!r}", "--keep", f"energy={4.5 * h!r}", "--start"]
        fall, rock = f"0,{3 * speed!r}", f"0,{6 * length!r},{4 * speed!r},{-2 * speed!r}"
        for scene, words, reached in ((ball, ["mode:1"], 2.0), (ball, [*begun, fall], 2.25), (rod, [*begun, rock], 3.0)):
            assert run(capsys, "continue", "--scene", scene, "--csv", "a.csv", "--from", *words)[0] == 0
            rows = rows_of("a.csv")
            assert max(float(row["h"]) / h if len(words) == 1 else float(row["g"]) / g for row in rows) == pytest.approx(reached, rel=1e-10)
            for row in rows if scene == rod else ():
                assert float(row["alpha"]) == pytest.approx(np.sqrt(float(row["h"]) / (5.0 * m)) / float(row["g"]), rel=1e-10)
            counts.append(len(rows))
    assert np.abs(np.subtract(counts[:3], counts[3:])).max() <= 2


def test_the_grazing_of_one_degree_of_freedom(capsys, tmp_path):
    """Oracle: the impact at x = b vanishes where the potential there is h: (g - 1) b + b^2/2 = 0.5 at b = -1/2 from rest at y = -1, so
    g = 1/4; k b^2/2 + a b^4/4 = h. Beyond it the family has no impact, T = 2 pi/sqrt(k/m). A coefficient can be 0 at the start."""
    system = scene_under_gravity(tmp_path / "s.toml", [["m"]], [["k"]], [([1.0], -1.5)], ["-m*g"], {"m": 1.0, "g": 1.0, "k": 1.0})
    words = ("--from", "mode:1", "--in", "g", "--range", "0.1:1.4", "--keep", "energy=0.5", "--json", "g.json")
    assert run(capsys, "continue", "--scene", system, *words)[0] == 0
    (grazing,) = (event for event in read_json("g.json")["branches"][0]["events"] if event["type"] == "GR")
    assert grazing["values"]["g"] == pytest.approx(0.25, rel=1e-10)
    assert run(capsys, "continue", "--from", "g.json:GR1", "--range", "0.1:1.4", "--csv", "a.csv")[0] == 0
    rows = rows_of("a.csv")
    assert min(float(row["g"]) for row in rows) == pytest.approx(0.1)
    np.testing.assert_allclose([float(row["alpha"]) for row in rows], np.pi / 2, rtol=1e-9)
    assert run(capsys, "continue", "--from", "g.json", "--range", "0.2:1.6", "--csv", "a.csv")[0] == 0
    assert max(float(row["g"]) for row in rows_of("a.csv")) == pytest.approx(1.6)
    assert run(capsys, "curve", "g.json:GR1", "--in", "g,energy", "--range", "0.2:1.2,0.01:1", "--csv", "a.csv")[0] == 0
    for row in rows_of("a.csv"):
        assert float(row["energy"]) == pytest.approx(0.125 - 0.5 * (float(row["g"]) - 1.0), rel=1e-9)
    springs = '[[springs]]\non = "y1"\nstiffness = "a"\npower = 3\n'
    plain = scene_under_gravity(tmp_path / "p.toml", [[1.0]], [["k"]], [([1.0], -0.5)], ["0*k"], {"k": 1.0, "a": 0.0}, springs)
    for name, expected in (("k", 8 * 0.2), ("a", (0.2 - 0.125) * 64)):
        words = ("--in", name, "--range", f"{-0.1 if name == 'a' else 0.5}:6", "--keep", "energy=0.2", "--json", "a.json")
        assert run(capsys, "continue", "--scene", plain, "--from", "mode:1", *words)[0] == 0
        (grazing,) = (event for event in read_json("a.json")["branches"][0]["events"] if event["type"] == "GR")
        assert grazing["values"][name] == pytest.approx(expected, rel=1e-10)


def test_two_masses_under_a_constant_load(capsys, tmp_path):
    """Oracle: equality of paths: the system with its stop moved by c K^-1 f, as a scene without loads."""
    mass, stiffness, load = np.diag([1.0, 0.5]), np.array([[2.0, -1.0], [-1.0, 1.0]]), np.array([-0.3, -0.15])
    stop = ([1.0, -1.0], -1.0)
    loaded = scene_under_gravity(tmp_path / "a.toml", mass.tolist(), stiffness.tolist(), [stop], ["-g", "-g/2"], {"g": 0.3})
    moved = [(stop[0], stop[1] - float(np.array(stop[0]) @ np.linalg.solve(stiffness, load)))]
    plain = scene_under_gravity(tmp_path / "b.toml", mass.tolist(), stiffness.tolist(), moved, ["0*g", "0*g"], {"g": 0.3})
    words = ("--energy", "1", "--max-impacts", "3", "--max-quarter-period", "5", "--json", "a.json")
    found = []
    for scene in (loaded, plain):
        code, out, err = run(capsys, "discover", "--scene", scene, *words)
        assert code == 0 and ("rest   y1 = -0.45, y2 = -0.6" in out) == (scene == loaded), err
        found.append([(orbit["alpha"], orbit["sequence"]) for orbit in read_json("a.json")["orbits"]])
    assert len(found[0]) > 1 and [sequence for _, sequence in found[0]] == [sequence for _, sequence in found[1]]
    np.testing.assert_allclose(*([alpha for alpha, _ in orbits] for orbits in found), rtol=1e-11)
    assert run(capsys, "build", "--scene", loaded, "--catalogue", "c.sqlite", "--energy", "1:2", *words[2:6])[0] == 0
    code, out, err = run(capsys, "list", "--scene", loaded, "--catalogue", "c.sqlite")
    assert code == 0 and "stop" in out, err
