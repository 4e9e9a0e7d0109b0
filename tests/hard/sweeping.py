"""Random systems and starts, and a decision about the first impact of each that skips none: the oracle of the missed events.

The distance d(t) = side (bound - w(t)) of a contact is a sum of exponentials, d(t) = side bound - Re sum a_j exp(s_j t), by numpy's
eigenvectors of the first-order matrix; no s_j grows. On a piece of time of length h the cubic with the values and slopes of d at both
ends lies above the least of its four Bezier coefficients, and d differs from it by no more than W h^4/384, W = sum |a_j s_j^4| at its start
(Hermite's remainder). Where that leaves d above its rounding, no contact is possible in the piece; else it is halved. What is still open
at a width of `FINEST` - a grazing, a return right after leaving - is decided in integers of 500 bits (`tests.hard.integers`). So each start
is decided by a bound, and none by a sample.

Rounding in doubles is taken as `SLACK` eps cond(V) (1 + |s| t) times the sizes that make up d, some hundred times what it is.
"""

from dataclasses import dataclass

import numpy as np

from bvp.system import ImpactSystem, Stop
from tests.hard.integers import BITS, Integers, as_float, first_event
from tests.lab.limits import CONTACT_TOLERANCE
from tests.lab.paths import ImpactStatus, next_impact

HORIZON = 5.0
PIECES = 12
FINEST = 1e-4
SLACK = 100.0 * 2.220446049250313e-16
CONTACTS = 5


@dataclass
class Case:
    """A system, a start, and the contact that it leaves (None: none)."""

    system: ImpactSystem
    u: np.ndarray
    v: np.ndarray
    leaving: str | None
    kind: str


def random_system(rng, n, damping):
    """Full stiffness and damping, two or three stops, one of them one-sided."""
    root, half = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    lower = [-rng.uniform(0.5, 2.0), -np.inf, -rng.uniform(0.5, 2.0)][: 2 + int(rng.random() < 0.5)]
    stops = [Stop(tuple(rng.normal(size=n)), low, rng.uniform(0.5, 2.0)) for low in lower]
    stiffness = root @ root.T + 0.05 * np.eye(n)
    return ImpactSystem(np.diag(rng.uniform(0.2, 2.0, n)), damping * half @ half.T, 0.5 * (stiffness + stiffness.T), tuple(stops))


class Exponentials:
    """The free motion of a system by numpy alone: rates s (N,), vectors V, and the contacts' rows."""

    def __init__(self, system):
        n = system.degrees_of_freedom
        inverse = 1.0 / np.diag(system.mass)[:, None]
        self.matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * system.stiffness, -inverse * system.damping]])
        self.rates, self.vectors = np.linalg.eig(self.matrix)
        self.inverse = np.linalg.inv(self.vectors)
        self.condition = np.linalg.cond(self.vectors)
        self.rows, self.bounds, self.letters = [], [], []
        for stop in system.stops:
            for side, bound, sign in ((-1.0, stop.lower, "-"), (1.0, stop.upper, "+")):
                if np.isfinite(bound):
                    self.rows.append(side * np.array(stop.gap))
                    self.bounds.append(side * bound)
                    self.letters.append((stop.name if len(system.stops) > 1 else "") + sign)
        self.rows, self.bounds = np.array(self.rows), np.array(self.bounds)

    def flow(self, z, t):
        return np.real(self.vectors @ (np.exp(self.rates * t) * (self.inverse @ z)))

    def distances(self, z):
        return self.bounds - self.rows @ z[: len(z) // 2]


def random_cases(rng, systems, states):
    """`systems` systems with `states` starts each: thrown from the middle, made to graze, thrown off a stop."""
    cases = []
    for k in range(systems):
        n = 2 + k % 4
        system = random_system(rng, n, (0.0, 0.02, 0.5, 3.0)[(k // 4) % 4])
        motion = Exponentials(system)
        while len(cases) < (k + 1) * states:
            kind = rng.choice(["thrown", "grazing", "leaving"], p=[0.8, 0.15, 0.05])
            case = getattr(_Make, kind)(rng, system, motion)
            if case is not None:
                cases.append(case)
    return cases


class _Make:
    @staticmethod
    def thrown(rng, system, motion):
        n = system.degrees_of_freedom
        return Case(system, np.zeros(n), rng.uniform(0.1, 5.0) * rng.normal(size=n), None, "thrown")

    @staticmethod
    def grazing(rng, system, motion):
        """A turning point beyond or before a stop by 1e-1 ... 1e-14, or on it, made at one instant and flown back."""
        n = system.degrees_of_freedom
        c = int(rng.integers(len(motion.bounds)))
        row, depth = motion.rows[c], float(rng.choice([-1.0, 0.0, 1.0], p=[0.45, 0.1, 0.45])) * 10.0 ** -rng.uniform(1.0, 14.0)
        u, v = 0.3 * rng.normal(size=n), rng.normal(size=n)
        u += row * (motion.bounds[c] + depth - row @ u) / (row @ row)
        v -= row * (row @ v) / (row @ row)
        z = np.concatenate([u, v])
        if row @ (motion.matrix @ z)[n:] > -0.05:
            return None
        early = motion.flow(z, -rng.uniform(0.02, 0.6))
        if np.min(motion.distances(early)) < 1e-3 or np.max(np.abs(early)) > 30.0:
            return None
        return Case(system, early[:n], early[n:], None, "grazing")

    @staticmethod
    def leaving(rng, system, motion):
        """On a stop, moving off at a speed of 1 ... 1e-8."""
        n = system.degrees_of_freedom
        c = int(rng.integers(len(motion.bounds)))
        row = motion.rows[c]
        u, v = 0.3 * rng.normal(size=n), rng.normal(size=n)
        u += row * (motion.bounds[c] - row @ u) / (row @ row)
        v -= row * (row @ v + 10.0 ** -rng.uniform(0.0, 8.0)) / (row @ row)
        z = np.concatenate([u, v])
        others = np.delete(motion.distances(z), c)
        if np.min(others) < 1e-3 or abs(row @ (motion.matrix @ z)[n:]) < 0.05 or row @ v > -1e-9:
            return None
        return Case(system, u, v, motion.letters[c], "leaving")


class Verdicts:
    """What the program says of some cases, and what is so.

    Attributes
    ----------
    missed, invented : list of (Case, text)
    near : int
        Starts that integers decided.
    distance : float
        Largest |d| at a hit's time in integers, over the sizes that make it up; of the near ones and of one in a hundred others.
    kinds : dict of str to int
        Counts of what the program answered.
    """

    def __init__(self):
        self.missed, self.invented = [], []
        self.near, self.distance, self.kinds, self.integers = 0, 0.0, {}, {}

    def judge(self, cases):
        """Ask the program for the first impact of each case, and decide."""
        motions = {}
        for case in cases:
            if id(case.system) not in motions:
                motions[id(case.system)] = Exponentials(case.system)
        for n in sorted({len(case.u) for case in cases}):
            self._group([case for case in cases if len(case.u) == n], motions)

    def _group(self, cases, motions):
        answers = [next_impact(case.system, case.u, case.v, HORIZON, case.leaving) for case in cases]
        n = len(cases[0].u)
        count = len(cases)
        rates = np.array([motions[id(case.system)].rates for case in cases])
        amplitudes = np.zeros((count, CONTACTS, 2 * n), complex)
        bounds = np.full((count, CONTACTS), 1e9)
        ends = np.empty((count, CONTACTS))
        starts = np.zeros((count, CONTACTS))
        level = np.empty((count, CONTACTS))
        near = []
        for i, (case, answer) in enumerate(zip(cases, answers, strict=True)):
            self.kinds[answer.status.name] = self.kinds.get(answer.status.name, 0) + 1
            motion = motions[id(case.system)]
            m = len(motion.bounds)
            weights = motion.inverse @ np.concatenate([case.u, case.v])
            amplitudes[i, :m] = (motion.rows @ motion.vectors[:n]) * weights
            bounds[i, :m] = motion.bounds
            ends[i] = answer.time
            sizes = np.abs(bounds[i]) + np.sum(np.abs(amplitudes[i]), axis=1)
            level[i] = SLACK * motion.condition * sizes * (1.0 + np.max(np.abs(motion.rates)) * answer.time)
            if case.leaving is not None:
                c = motion.letters.index(case.leaving)
                bend = np.sum(np.abs(amplitudes[i, c] * motion.rates**2))
                speed = -np.real(np.sum(amplitudes[i, c] * motion.rates))
                starts[i, c] = min(FINEST, answer.time)
                if speed < 2.0 * bend * FINEST or answer.time < 2.0 * FINEST:
                    near.append((i, c, 0.0, min(FINEST, answer.time)))
            if answer.status is ImpactStatus.NONE:
                continue
            if answer.status not in (ImpactStatus.HIT, ImpactStatus.TOUCH):
                self.invented.append((case, answer.status.name))
                continue
            c = motion.letters.index(answer.contact)
            waves = amplitudes[i, c] * np.exp(motion.rates * answer.time)
            slope, bend = -np.real(np.sum(waves * motion.rates)), np.sum(np.abs(waves * motion.rates**2))
            reach = 20.0 * level[i, c] / max(-slope, 1e-300)
            sure = answer.status is ImpactStatus.HIT and 4.0 * reach * bend < -slope and reach < 0.25 * (answer.time - starts[i, c])
            if sure:
                distances = [bounds[i, c] - np.real(np.sum(waves * np.exp(motion.rates * s))) for s in (-reach, 0.0, reach)]
                sure = distances[0] > level[i, c] and distances[2] < -level[i, c] and abs(distances[1]) < level[i, c]
            if not sure:
                reach = FINEST
                near.append((i, c, max(answer.time - FINEST, starts[i, c]), answer.time + FINEST))
            ends[i, c] = max(answer.time - reach, starts[i, c])
            if sure and i % 100 == 0:
                self._accuracy(case, answer, motion, c)
        near += self._open(rates, amplitudes, bounds, level, starts, ends)
        by_case = {}
        for i, c, low, high in near:
            by_case.setdefault(i, []).append((c, low, high))
        self.near += len(by_case)
        for i, pieces in by_case.items():
            self._decide(cases[i], answers[i], motions[id(cases[i].system)], pieces)

    def _open(self, rates, amplitudes, bounds, level, starts, ends):
        """Pieces of time, (case, contact, begin, end), in which a contact is not excluded in doubles."""
        i, c, k = (x.ravel() for x in np.meshgrid(*(np.arange(m) for m in (*bounds.shape, PIECES)), indexing="ij"))
        whole = bounds[i, c] < 1e8
        i, c, k = i[whole], c[whole], k[whole]
        width = (ends[i, c] - starts[i, c]) / PIECES
        low, high = starts[i, c] + k * width, starts[i, c] + (k + 1) * width
        out = []
        while len(i):
            a, s = amplitudes[i, c], rates[i]
            first, last = np.exp(s * low[:, None]), np.exp(s * high[:, None])
            h = high - low
            d0, d1 = (bounds[i, c] - np.real(np.sum(a * e, axis=1)) for e in (first, last))
            r0, r1 = (-np.real(np.sum(a * s * e, axis=1)) for e in (first, last))
            remainder = np.sum(np.abs(a * s**4 * first), axis=1) * h**4 / 384.0 + level[i, c]
            corners = np.stack([d0, d0 + h * r0 / 3.0, d1 - h * r1 / 3.0, d1])
            free = np.min(corners, axis=0) > remainder
            small = ~free & ((h < FINEST) | (np.max(corners, axis=0) < -remainder))
            out += list(zip(i[small].tolist(), c[small].tolist(), low[small].tolist(), high[small].tolist(), strict=True))
            split = ~free & ~small
            middle = 0.5 * (low + high)[split]
            i, c = np.tile(i[split], 2), np.tile(c[split], 2)
            low, high = np.concatenate([low[split], middle]), np.concatenate([middle, high[split]])
        return out

    def _exact(self, system):
        if id(system) not in self.integers:
            self.integers = {id(system): Integers(system)}
        return self.integers[id(system)]

    def _accuracy(self, case, answer, motion, c):
        """|d| at a hit's time in integers."""
        exact = self._exact(case.system)
        state = exact.flow(exact.state(case.u, case.v), answer.time)
        size = abs(motion.bounds[c]) + float(np.abs(motion.rows[c]) @ np.abs([as_float(x) for x in state[: exact.n]]))
        row = np.array([exact.number(x) for x in motion.rows[c]], dtype=object)
        distance = as_float(exact.number(motion.bounds[c]) - (int(row.dot(state[: exact.n])) >> BITS))
        self.distance = max(self.distance, abs(distance) / size)

    def _decide(self, case, answer, motion, pieces):
        """In integers: the first event of the open pieces against the answer."""
        exact = self._exact(case.system)
        start = exact.state(case.u, case.v)
        modes, letters = case.system.modes, motion.letters
        found, asked = [], False
        for c, low, high in _short(_merged(pieces)):
            begins = case.leaving == letters[c] and low == 0.0
            mine = answer.contact == letters[c] and low <= answer.time <= high
            asked = asked or mine
            at = 0.0 if begins else 0.5 * (low + high)
            state = exact.flow(start, at) if at else start
            polynomial = exact.polynomial(state, motion.rows[c], motion.bounds[c])
            if begins:  # d(0) = 0 is given, so d/s is examined
                kind, place = first_event(polynomial[1:], 0, exact.number(high), 0.0)
            else:
                sizes = np.abs(modes.contacts.gap[modes.contact_letters.index(letters[c])])
                size = abs(motion.bounds[c]) + sizes @ np.abs(modes.from_state @ [as_float(x) for x in state])
                kind, place = first_event(polynomial, exact.number(low - at), exact.number(high - at), CONTACT_TOLERANCE * size)
            if kind != "none":
                found.append((at + as_float(place), kind, c, mine))
        for time, kind, c, mine in sorted(found):
            if mine:
                self._compare(case, answer, motion, kind, c)
                return
            if kind != "either" and time < answer.time - 1e-12:
                said = f"{answer.status.name} {answer.contact} at {answer.time}"
                self.missed.append((case, f"{kind} of {letters[c]} at {time}, answered {said}"))
                return
        if asked:
            self.invented.append((case, f"nothing there, answered {answer.status.name} of {answer.contact} at {answer.time}"))

    def _compare(self, case, answer, motion, kind, c):
        """An event where the answer has one."""
        if answer.status.name not in {"hit": ("HIT",), "touch": ("TOUCH",), "either": ("HIT", "TOUCH")}[kind]:
            self.missed.append((case, f"{kind} of {motion.letters[c]}, answered {answer.status.name} at {answer.time}"))
        elif answer.status is ImpactStatus.HIT and case.leaving != motion.letters[c]:
            self._accuracy(case, answer, motion, c)


def _merged(pieces):
    """Pieces of one contact that touch each other, as one."""
    out = []
    for c, low, high in sorted(pieces):
        if out and out[-1][0] == c and low <= out[-1][2] + 1e-12:
            out[-1] = (c, out[-1][1], max(high, out[-1][2]))
        else:
            out.append((c, low, high))
    return out


def _short(pieces):
    """Pieces of a few `FINEST` each, for their Taylor polynomials."""
    for c, low, high in pieces:
        count = int(np.ceil((high - low) / (4.0 * FINEST)))
        edges = np.linspace(low, high, count + 1)
        yield from ((c, float(a), float(b)) for a, b in zip(edges[:-1], edges[1:], strict=True))
