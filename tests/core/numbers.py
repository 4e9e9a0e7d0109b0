"""Print numbers that the core computes, every bit of them, one a line: `python -m tests.core.numbers [words]`.

`.ci/instructions` compares what the core prints when it is compiled for other processors and by other compilers. A new part of the core
gets a function in PARTS. It yields a name and an array for each result, and takes few seconds in all. The arguments are exact or computed
by the core, because numpy's functions differ between processors. The words are required in the name of the core's compiler.
"""

import math
import sqlite3
import sys
import tempfile
from concurrent.futures import Future
from contextlib import closing
from importlib import resources
from pathlib import Path

import numpy as np
import saltus_core

from branches.building.build import build
from branches.building.plan import Bounds, BuildPlan
from branches.catalogue import Catalogue
from bvp.forced import ForcedProblem
from bvp.forced_orbits import core_problem
from bvp.forcing import Constant, Harmonic
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.simulate import Simulator, run_linear
from bvp.smooth_flights import core_flight
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from saltus import discover, load_scene, trace
from tests.core.smooth_systems import chain, wall

ONE = "sqrt sin cos tan exp expm1 log log1p sinh cosh tanh asinh asin acos atan".split()
TWO = "pow hypot atan2".split()


def grid():
    """Numbers of all magnitudes and both signs, and others spread evenly around zero: integers over powers of two."""
    magnitudes = np.ldexp(1.0 + np.arange(900) / 900.0, np.arange(900) % 120 - 80)
    return np.concatenate([magnitudes, -magnitudes, np.arange(-700, 700) / 64.0, np.arange(-700, 700) / 1024.0])


def elementary_functions():
    """Of doubles, with their first derivatives, and of double-doubles."""
    x = grid()
    y = x[::-1].copy()
    wide = [np.array([z, np.ldexp(z, -55)]) for z in (x, y)]
    for name in ONE:
        yield name, getattr(saltus_core, name)(x)
        yield f"jets.{name}", getattr(saltus_core.jets, name)(x)
        yield f"double_double.{name}", getattr(saltus_core.double_double, name)(wide[0])
    for name in TWO:
        yield name, getattr(saltus_core, name)(x, y)
        yield f"double_double.{name}", getattr(saltus_core.double_double, name)(*wide)


def families():
    """Points, multipliers and events of families with two and with three degrees of freedom."""
    chain = ImpactSystem(np.diag([1.0, 2.0, 0.5]), np.zeros((3, 3)), CHAIN, (Stop((1.0, -1.0, 0.0), -1.0, 1.0),))
    problem = MultipointProblem(chain, ("origin", "origin"), ("+", "-"))
    found = discover(vibro_impact_nes(), 1.0, quarter_period=4.0, impacts=6)
    for branch in (trace("S13O00+"), trace("S11O00-"), *(trace(orbit) for orbit in found.orbits[:4])):
        for name in ("h", "alpha", "tau", "residual", "arclength"):
            yield f"{branch.id} {name}", [math.nan if value is None else value for value in branch.points[name]]
        yield f"{branch.id} events", [value for event in branch.events for value in (event.h, event.alpha, event.arclength)]
    yield "chain", problem.residual(np.ldexp(1.0 + np.arange(problem.unknowns), -4))
    yield "curvature of a chain", problem.jacobian(np.ldexp(1.0 + np.arange(problem.unknowns), -4))


def loads():
    """The equations of an orbit under loads, their derivatives, and its multipliers."""
    description = {
        "parameters": {"A": 0.75, "w": 1.25, "r": 0.5, "b": 0.125},
        "system": {"mass": [[1.0]], "damping": [["b/2"]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": 0.25, "restitution": "r"}]},
        "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}, {"load": [1.0], "constant": "A/8"}],
    }
    problem = ForcedProblem(ParametricSystem.from_description(description), ("+", "+", "+"), ("w", "A"), keep=("A = 0.6*w",))
    core = core_problem(problem)
    y = np.ldexp(1.0 + np.arange(core.unknowns), -4)
    yield "residual", core.residual(y)
    yield "jacobian", core.jacobian(y)
    yield "second derivative", core.derivative(y, np.stack([y, y[::-1]]))
    yield "multipliers", core.multipliers(y)


def varied():
    """The same where springs are parameters: of a free orbit, and with smooth forces under loads."""
    parameters = {"k": 0.75, "a": 0.5, "p": 2.5, "w": 1.25, "A": 0.75}
    stop = {"c": [1.0, -1.0], "lower": -1.0, "upper": 1.0}
    system = {"mass": [[1.0, 0.0], [0.0, 0.5]], "stiffness": [["1 + k", "-k"], ["-k", 1.5]], "stops": [stop]}
    free = ParametricSystem.from_description({"parameters": {"k": 0.75}, "system": system})
    smooth = ParametricSystem.from_description(
        {
            "parameters": parameters, "system": system | {"springs": [{"on": "u1", "stiffness": "a", "power": "p"}]},
            "forces": [{"load": [1.0, 0.0], "amplitude": "A", "harmonic": 1}],
        }
    )
    for name, problem in {
        "free": ReleasedProblem(free, ("origin", "stop+"), ("+",), ("k",), ["energy = 0.75"]),
        "smooth": ForcedProblem(smooth, ("+", "-"), ("a", "p"), keep=("p = 5*a",)),
    }.items():
        core = core_problem(problem)
        y = np.ldexp(1.0 + np.arange(core.unknowns), -4)
        yield f"residual of a {name} orbit", core.residual(y)
        yield f"jacobian of a {name} orbit", core.jacobian(y)
        yield f"second derivative of a {name} orbit", core.derivative(y, np.stack([y, y[::-1]]))


def searches():
    """Every orbit at an energy: quarter periods and states."""
    for energy in (0.5, 3.0):
        found = discover(vibro_impact_nes(), energy, quarter_period=5.1, impacts=10)
        yield f"quarter periods at {energy}", [orbit.alpha for orbit in found.orbits]
        yield f"velocities at {energy}", np.concatenate([orbit.velocities for orbit in found.orbits if orbit.velocities is not None])


CHAIN = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.5]])


def modes():
    """Of damped chains, whose modes are coupled, uncoupled and overdamped."""
    for damping in (0.0, 0.125, 2.0, 40.0):
        dampers = damping * np.diag([1.0, 0.0, 0.25])
        found = ImpactSystem(np.diag([1.0, 2.0, 0.5]), dampers, CHAIN, [Stop((0.0, 0.0, 1.0), -1.0, 1.0)]).modes
        yield f"blocks at {damping}", found.matrix
        yield f"states at {damping}", np.concatenate([found.to_state, found.from_state.T])
        yield f"impulses at {damping}", found.contacts.push


def smooth_flights():
    """Ends of flights with smooth forces, and their derivatives."""
    for name, system in {"chain": chain(3), "wall": wall(2), "root": wall(2, "sqrt(1 + w**2)*tanh(w)**3")}.items():
        flight = core_flight(system)
        for time in (0.375, 3.0):
            end, derivative = flight.end_with_map(np.arange(1, flight.size + 1) / 8.0, time)
            yield f"{name} at {time}", np.concatenate([[end], derivative])


def motions():
    """Events of motions with one, two, three and more pairs, with loads, chatter and sticking; and of many, with marks and peaks."""
    half = Stop((1.0,), -0.5, 0.75, 0.5)
    four = ImpactSystem(np.eye(4), np.diag([0.0, 0.125, 0.0, 3.0]), 2.0 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1), [
        Stop((1.0, -1.0, 0.0, 0.0), -0.25, 0.25, 0.75), Stop((0.0, 0.0, 0.0, 1.0), -0.5, 0.5, 0.0),
    ])  # fmt: skip
    chain = ImpactSystem(np.diag([1.0, 2.0, 0.5]), 0.03125 * CHAIN, CHAIN, [Stop((1.0, -1.0, 0.0), -1.0, 1.0, 0.875)])
    cases = {
        "oscillator": (ImpactSystem([[1.0]], [[0.0625]], [[1.0]], [half]), [Harmonic(0.75, [1.0])]),
        "free oscillator": (ImpactSystem([[1.0]], [[0.0625]], [[1.0]], [half]), []),
        "ball": (ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)]), [Constant([-1.0])]),
        "sink": (vibro_impact_nes(lam=0.015625, rho=0.75), []),
        "chain": (chain, []),
        "two stops": (four, [Constant([0.0, 0.125, 0.0, 0.5])]),
    }
    for name, (system, forces) in cases.items():
        simulator, n = Simulator(system, forces), system.degrees_of_freedom
        start = np.concatenate([np.full(n, 0.125), np.ldexp(3.0 + np.arange(n), -1)])
        motion = simulator.run(start[:n], start[n:], 20.0)
        for part in ("times", "speeds", "losses", "states", "sums"):
            yield f"{part} of {name}", getattr(motion, part)
        starts = np.outer([0.25, 0.5, 1.0, 2.0], start)
        starts[:, :n] = 0.125
        runs = run_linear(
            simulator.table, starts, 0.5 * (starts[:, n] * starts[:, n]), np.full(4, 500), 100.0, np.array([0.25, 0.5, 0.75]),
            with_peaks=True, to_rest=True,
        )  # fmt: skip
        yield f"many of {name}", np.hstack(runs)


class AtOnce(Future):
    """A call that is done at once, in this process."""

    @classmethod
    def submit(cls, function, *arguments):
        made = cls()
        made.set_result(function(*arguments))
        return made


def catalogues():
    """All numbers of small catalogues, and ids: of the reference scene, and of one with three masses."""
    for name in ("lee2009", "three_mass_chain"):
        scene = load_scene(resources.files("catalogues") / f"{name}.toml")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "small.sqlite"
            with Catalogue(path, "a", scene=scene) as catalogue:
                build(catalogue, BuildPlan.within(Bounds((0.05, 100.0), 1.9, 2)), AtOnce, 1)
            with closing(sqlite3.connect(path)) as tables:
                for table in ("families", "points", "arrays", "events", "nodes", "edges"):
                    rows = tables.execute(f"SELECT * FROM {table}")
                    columns = [column[0] for column in rows.description]
                    for row in rows.fetchall():
                        for column, value in zip(columns, row, strict=True):
                            if column == "npz":  # its crc is there
                                continue
                            is_number = isinstance(value, float)
                            yield f"{name} {table} {column}" + ("" if is_number else f" {value!r}"), value if is_number else []


PARTS = [elementary_functions, families, loads, varied, searches, modes, smooth_flights, motions, catalogues]


def lines():
    for part in PARTS:
        for name, values in part():
            found = [value.hex() for value in np.asarray(values, dtype=float).ravel().tolist()]
            yield from (f"{name} {k} {value}" for k, value in enumerate(found)) if found else [name]


if __name__ == "__main__":
    for word in " ".join(sys.argv[1:]).split():
        if word not in saltus_core.compiler:
            sys.exit(f"expected {word} in the compiler of {saltus_core.__file__}: {saltus_core.compiler}")
    sys.stdout.writelines(f"{line}\n" for line in lines())
