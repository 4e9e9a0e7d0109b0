"""Orbits for tests, found with the numpy flow alone: scanning a start set at fixed energy, and random starts polished by Newton."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks import backbone
from bvp.closures import Cycle
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.system import Stop, vibro_impact_nes
from tests.bvp import twins
from tests.bvp.flow_twin import Twin
from tests.lab.flights import LinearFlight


@dataclass
class Found:
    """A solved orbit."""

    problem: object
    solution: object
    energy: float

    @property
    def name(self):
        return "..".join(self.problem.ends) + ":" + "".join(self.problem.sequence)


def chain(rng, n, grounded=False):
    """A chain of n masses, ends free (one rigid-body mode) or tied to the ground, with one odd-symmetric stop between two of them."""
    masses, springs, j = rng.uniform(0.2, 2.0, n), rng.uniform(0.2, 2.0, n - 1), int(rng.integers(n - 1))
    return twins.chain(masses, springs, float(grounded), stops=(Stop(tuple(np.eye(n)[j] - np.eye(n)[j + 1]), -1.0, 1.0),))


def start_states(system, kind, energy, angles):
    """Start states (m, 2n) of a two-degree-of-freedom system in an end set at an energy; NaN where there is none."""
    twin = Twin(system)
    n = 2
    out = np.full((len(angles), 4), np.nan)
    for i, angle in enumerate(angles):
        direction = np.array([np.cos(angle), np.sin(angle)])
        if kind == "origin":
            out[i] = np.concatenate([np.zeros(n), twin.shapes @ (np.sqrt(2.0 * energy) * direction)])
        elif kind == "rest":
            u = twin.shapes @ (np.sqrt(2.0 * energy) / np.where(twin.frequencies > 0, twin.frequencies, 1.0) * direction)
            if np.min(twin.distances(np.concatenate([u, u])[None])) > 0:
                out[i] = np.concatenate([u, np.zeros(n)])
        else:
            c, side, bound, _, _ = next(x for x in twin.contacts if "stop" + x[4] == kind)
            gradient = twin.shapes.T @ c
            normal = gradient / np.linalg.norm(gradient)
            reach = np.sqrt(2.0 * energy) / min(w for w in twin.frequencies if w > 0)
            q = normal * bound / np.linalg.norm(gradient) + np.array([-normal[1], normal[0]]) * reach * np.cos(angle)
            left = 2.0 * energy - np.sum((twin.frequencies * q) ** 2)
            if left > 0:
                out[i] = np.concatenate([twin.shapes @ q, twin.shapes @ (-side * np.sqrt(left) * normal)])
    return out


def scan(system, start, energy, *, angles=160, impacts=6, far=("stop", "rest", "origin"), most=12):
    """Orbits from one end set at an energy, each sequence once: sign changes of the end condition between neighbouring angles, polished."""
    twin = Twin(system)
    to_modes = np.kron(np.eye(2), twin.to_modes)
    grid = np.linspace(0.01, np.pi - 0.01 if start != "rest" else 2 * np.pi, angles)
    leaving = next((j for j, x in enumerate(twin.contacts) if "stop" + x[4] == start), None)
    c = twin.contacts[0][0]
    basis = None
    gradient = twin.shapes.T @ c
    basis = np.array([-gradient[1], gradient[0]])
    other = np.array([0.0, 1.0])
    candidates = []
    previous = None
    for x in start_states(system, start, energy, grid):
        if np.isnan(x[0]):
            previous = None
            continue
        _, events = twin.run(x, 60.0, leaving, impacts + 1)
        seen = {}
        sequence, state, t0 = (), x, 0.0
        for time, contact, before, after in events:
            if "rest" in far or "origin" in far:
                times = np.linspace(0.0, time - t0, 80)
                states = twin.flow(state, times)
                for kind, row in (("origin", np.concatenate([c, np.zeros(2)])), ("rest", np.concatenate([np.zeros(2), c]))):
                    if kind not in far or (kind == "origin" and not system.has_odd_symmetry):
                        continue
                    values = states @ row
                    if not sequence and kind == start:
                        continue
                    for order, i in enumerate(np.flatnonzero(values[:-1] * values[1:] < 0)):
                        s = times[i] + (times[i + 1] - times[i]) * values[i] / (values[i] - values[i + 1])
                        z = twin.flow(state, s)
                        value = z[:2] @ other if kind == "origin" else z[2:] @ other
                        seen[kind, sequence, order] = (value, s)
            letter = twin.contacts[contact][4]
            if "stop" in far:
                seen["stop" + letter, sequence, 0] = (basis @ (twin.to_modes @ before[2:]), time - t0)
            sequence, state, t0 = (*sequence, letter), after, time
        flights = np.diff([0.0] + [e[0] for e in events])
        nodes = np.array([to_modes @ e[3] for e in events]).reshape(-1, 4)
        if previous is not None:
            for key, (value, s) in seen.items():
                if key in previous[0] and previous[0][key][0] * value < 0 and len(key[1]) <= impacts:
                    candidates.append((key, x, nodes[: len(key[1])], [*flights[: len(key[1])], s]))
        previous = (seen,)
    found, sequences = [], set()
    for (kind, sequence, _), x, nodes, flights in candidates:
        if (kind, sequence) in sequences or len(found) >= most:
            continue
        orbit = polish(system, (start, kind), sequence, to_modes @ x, nodes, flights, energy)
        if orbit is not None:
            sequences.add((kind, sequence))
            found.append(orbit)
    return found


def polish(system, ends, sequence, start, nodes, flights, energy):
    """Newton from a guess; None where it does not arrive at an admissible orbit."""
    problem = MultipointProblem(system, ends, sequence)
    y = problem.pack(start, nodes, flights)
    try:
        solution = problem.solve(y, energy=energy)
    except NotConverged:
        return None
    impacts = bool(sequence) or any(end.startswith("stop") for end in ends)
    ok = impacts and solution["clearance"] > 1e-6 and solution["flight"] > 1e-3 and solution["speed"] > 1e-3
    return Found(problem, solution, energy) if ok else None


SCANS = ((0.1, 0.1, 0.5, "origin"), (0.1, 0.1, 0.5, "stop+"), (1.3, 0.4, 2.0, "origin"), (1.3, 0.4, 2.0, "rest"), (1.9, 0.3, 0.4, "rest"))
"""(mu, sigma, h, start) of the orbits that the tests share; the last holds multipliers from 1 to 1e20."""


@cache
def collection():
    """Orbits of the two-degree-of-freedom system, solved."""
    found = []
    for mu, sigma, energy, start in SCANS:
        found += scan(vibro_impact_nes(mu, sigma), start, energy, angles=240 if mu > 1.5 else 110, impacts=6, most=40)
    assert len(found) >= 40
    return tuple(found)


@cache
def chains():
    """Orbits of chains of three to six masses, from random starts: Newton's nearest solution, at whatever energy it has."""
    rng = np.random.default_rng(11)
    found = []
    for n in (3, 4, 5, 6):
        for grounded in (False, True):
            system = chain(rng, n, grounded)
            twin = Twin(system)
            row = np.array(system.stops[0].gap)
            velocity = rng.normal(size=n) + 3.0 * np.linalg.solve(system.mass, row)
            x = np.concatenate([np.zeros(n), rng.uniform(0.3, 1.0) * velocity])
            _, events = twin.run(x, 60.0, None, 5)
            flights = np.diff([0.0] + [event[0] for event in events])
            nodes = np.array([system.modes.from_state @ event[3] for event in events])
            for k, (_, contact, _, _) in enumerate(events):
                sequence = tuple(twin.contacts[event[1]][4] for event in events[:k])
                ends = ("origin", "stop" + twin.contacts[contact][4])
                problem = MultipointProblem(system, ends, sequence)
                guess = problem.pack(system.modes.from_state @ x, nodes[:k], flights[: k + 1])
                try:
                    solution = problem.solve(guess)
                except NotConverged:
                    continue
                if solution["clearance"] > 1e-6 and solution["flight"] > 1e-3 and solution["speed"] > 1e-3:
                    found.append(Found(problem, solution, solution["energy"]))
    assert len(found) >= 20
    return tuple(found)


def backbone_segment(system, alpha, impacts=0):
    """(problem, exact unknowns) of the one-impact orbit: its quarter, or `impacts` half periods of it between two origins."""
    velocity = backbone.origin_velocity(system, alpha)
    modes = system.modes
    n = system.degrees_of_freedom
    start = modes.from_state @ np.concatenate([np.zeros(n), velocity])
    if impacts == 0:
        problem = MultipointProblem(system, ("origin", "stop+"), ())
        return problem, problem.pack(start, np.zeros((0, 2 * n)), [alpha])
    u, v = backbone.motion(system, alpha, np.array([-alpha]))
    after = modes.from_state @ np.concatenate([-u[0], -v[0]])
    nodes = np.array([after if i % 2 == 0 else -after for i in range(impacts)])
    sequence = tuple("+-"[i % 2] for i in range(impacts))
    problem = MultipointProblem(system, ("origin", "origin"), sequence)
    return problem, problem.pack(start, nodes, [alpha] + [2.0 * alpha] * (impacts - 1) + [alpha])


def cut(cycle, pieces):
    """The same orbit with each flight cut into `pieces` of equal duration by plain nodes (contact -1)."""
    count, size = cycle.after.shape
    before, after = np.empty((count * pieces, size)), np.empty((count * pieces, size))
    duration = np.repeat(cycle.duration / pieces, pieces)
    contact, flight = np.full(count * pieces, -1, dtype=np.int64), LinearFlight(cycle.system)
    for i in range(count):
        at = i * pieces
        contact[at], before[at], after[at] = cycle.contact[i], cycle.before[i], cycle.after[i]
        for j in range(1, pieces):
            after[at + j] = flight.end(cycle.after[i], j * duration[at])
            before[at + j] = after[at + j]
    return Cycle(cycle.system, before, after, duration, contact, cycle.lead)
