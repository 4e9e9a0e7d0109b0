"""The multipoint problem and the half map of undamped systems in mpmath numbers: an oracle for tests.

Nothing is linearised: the half map comes from central differences of the event-driven flow between the ends, with so many digits
that the differences lose none that a test looks at.
"""

import mpmath
import numpy as np

from bvp.closures import cycle_of
from bvp.multipliers import sort_multipliers
from tests.lab.problems import Equations

DIGITS = 60
STEP = mpmath.mpf(10) ** -18

exact = np.frompyfunc(lambda x: mpmath.mpf(float(x)), 1, 1)


def flow(squares, z, t):
    """The modal state z after a free flight of t."""
    q, p = np.split(np.asarray(z), 2)
    w = [mpmath.sqrt(square) for square in squares]
    turns = [mpmath.cos_sin(x * t) if x else (mpmath.mpf(1), mpmath.mpf(t)) for x in w]
    c = np.array([cosine for cosine, _ in turns])
    s = np.array([sine / x if x else sine for x, (_, sine) in zip(w, turns, strict=True)])
    return np.concatenate([c * q + s * p, c * p - squares * s * q])


def dot(row, z):
    return exact(row) @ z


class Exact:
    """A solved segment, refined to `DIGITS` digits; the unknown that moves fastest along the family is held."""

    def __init__(self, problem, solution, rounds=5):
        mpmath.mp.dps = DIGITS
        self.problem = problem
        self.segment = Equations(problem)
        self.squares = exact(problem.modes.squares)
        self.y = exact(solution.y)
        self.held = int(np.argmax(np.abs(solution.tangent[: problem.unknowns])))
        self.free = [j for j in range(problem.unknowns) if j != self.held]
        self.jacobian = problem.jacobian(solution.y)[:, self.free]
        self.refine(rounds)

    def refine(self, rounds=5):
        """Newton's corrections with the derivative of the start, which gain some fourteen digits each beside it."""
        for _ in range(rounds):
            residual = self.residual()
            size = np.abs(residual).max()
            if size == 0:
                break
            self.y[self.free] -= exact(np.linalg.solve(self.jacobian, (residual / size).astype(float))) * size
        self.left = np.abs(self.residual()).max()

    def move(self, value, rounds=12):
        """Along the family to where the held unknown has a value near that of the start."""
        self.y[self.held] = value
        self.refine(rounds)

    def energy(self):
        """h of the start."""
        q, p = np.split(self.start(), 2)
        return (self.squares @ q**2 + p @ p) / 2

    def start(self):
        return dot(self.segment.start_map, self.y[: self.problem.parameters]) + self.segment.start_offset

    def flight_times(self):
        return self.problem.flight_times(self.y)

    def impact(self, i, z):
        return z - dot(self.segment.gap_rate[i], z) * float(self.segment.jump[i]) * exact(self.segment.push[i])

    def residual(self):
        """F of a problem between two ends."""
        problem, segment, nodes = self.problem, self.segment, self.problem.nodes(self.y)
        out, z = [], self.start()
        for i, time in enumerate(self.flight_times()):
            end = flow(self.squares, z, time)
            if i < problem.inner:
                z = nodes[i]
                out += [self.impact(i, end) - z, [dot(segment.gap[i], z) - float(segment.bound[i])]]
        return np.concatenate([*out, dot(segment.end_map, end) - segment.end_offset])

    def run(self, z, to_stop):
        """From a start state through all impacts of the sequence to the far end: at its stop, or at the orbit's own time there."""
        times = self.flight_times()
        elapsed = mpmath.mpf(0)
        for i, t in enumerate(times):
            if i == self.problem.inner and not to_stop:
                return flow(self.squares, z, mpmath.fsum(times) - elapsed)
            for _ in range(8):
                x = flow(self.squares, z, t)
                change = (dot(self.segment.gap[i], x) - float(self.segment.bound[i])) / dot(self.segment.gap_rate[i], x)
                t -= change
                if abs(change) < mpmath.mpf(10) ** (-DIGITS + 8):
                    break
            z = flow(self.squares, z, t)
            elapsed += t
            if i < self.problem.inner:
                z = self.impact(i, z)
        return z

    def multipliers(self):
        """The nontrivial multipliers (2 m,) of the full period, rounded: impact by impact, by saltation matrices."""
        problem, modes, squares = self.problem, self.problem.modes, self.squares
        cycle = cycle_of(problem, np.array(self.y, float))
        gap, rate, push = (exact(rows) for rows in (modes.contacts.gap, modes.contacts.rate, modes.contacts.push))
        n, z = problem.half, self.start()
        period, elapsed = 4 * mpmath.fsum(self.flight_times()) / problem.quarters, mpmath.mpf(0)
        product = exact(np.eye(2 * n))

        def field(z):
            return np.concatenate([z[n:], -squares * z[:n]])

        for duration, c in zip([cycle.lead, *cycle.duration[:-1]], cycle.contact, strict=True):
            t = mpmath.mpf(float(duration))
            for _ in range(8):
                x = flow(squares, z, t)
                t -= (gap[c] @ x - float(modes.contacts.bound[c])) / (rate[c] @ x)
            x = flow(squares, z, t)
            product = np.array([flow(squares, column, t) for column in product.T]).T
            coming, z = field(x), x - 2 * push[c] * (rate[c] @ x)
            late = field(z) - coming + 2 * push[c] * (rate[c] @ coming)
            product = product - 2 * np.outer(push[c], rate[c] @ product) + np.outer(late / (gap[c] @ coming), gap[c] @ product)
            elapsed += t
        product = np.array([flow(squares, column, period - elapsed) for column in product.T])
        values = list(mpmath.eig(mpmath.matrix(product.tolist()), left=False, right=False))
        for _ in range(2 * (n - problem.pairs)):
            values.remove(min(values, key=lambda value: abs(value - 1)))
        return sort_multipliers(np.array([complex(value) for value in values]))

    def half_map(self):
        """phi, (2 (n-1), 2 (n-1)) mpf entries, for two degrees of freedom."""
        ends, inner = self.problem.ends, self.problem.inner
        at_stop = [end.startswith("stop") for end in ends]
        start = self.start()
        final = self.run(start, at_stop[1])

        def across(end, node, z):
            x = z[2:] if end == "origin" else self.squares * z[:2] if end == "rest" else exact(self.segment.gap[node, :2])
            return np.array([-x[1], x[0]]) / mpmath.sqrt(x @ x)

        first, last = across(ends[0], inner + 1, start), across(ends[1], inner, final)
        zero = exact(np.zeros(2))
        kept, turned = np.concatenate([first, zero]), np.concatenate([zero, first])
        if ends[0] == "origin":
            kept, turned = turned, -kept
        if at_stop[0]:
            gap = exact(self.segment.gap[inner + 1, :2])
            kept[2:] = -((self.squares * start[:2]) @ first) / (gap @ start[2:]) * gap
        phi = []
        for column in (kept, turned):
            after, before = (self.run(start + sign * STEP * column, at_stop[1]) for sign in (1, -1))
            q, p = np.split((after - before) / (2 * STEP), 2)
            phi.append((last @ p, -(last @ q)) if ends[1] == "origin" else (last @ q, last @ p))
        return np.array(phi).T
