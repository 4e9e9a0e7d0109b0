"""The multipoint problem and the half map of undamped systems in mpmath numbers: an oracle for tests.

Nothing is linearised: the half map comes from central differences of the event-driven flow between the ends, with so many digits
that the differences lose none that a test looks at.
"""

import mpmath
import numpy as np

DIGITS = 60
STEP = mpmath.mpf(10) ** -18


def flow(squares, z, t):
    """The modal state z after a free flight of t."""
    n = len(squares)
    q, p = [], []
    for k, square in enumerate(squares):
        w = mpmath.sqrt(square)
        c, s = (mpmath.cos(w * t), mpmath.sin(w * t) / w) if w else (mpmath.mpf(1), t)
        q.append(c * z[k] + s * z[n + k])
        p.append(c * z[n + k] - square * s * z[k])
    return q + p


def dot(row, z):
    return mpmath.fsum(mpmath.mpf(float(a)) * b for a, b in zip(row, z, strict=True))


class Exact:
    """A solved segment, refined to `DIGITS` digits; the unknown that moves fastest along the family is held."""

    def __init__(self, problem, solution, rounds=5):
        mpmath.mp.dps = DIGITS
        self.problem = problem
        self.segment = problem.segment
        self.squares = [mpmath.mpf(float(w)) for w in problem.modes.squares]
        self.y = [mpmath.mpf(float(v)) for v in solution.y]
        self.held = int(np.argmax(np.abs(solution.tangent[: problem.unknowns])))
        self.free = [j for j in range(problem.unknowns) if j != self.held]
        self.jacobian = problem.jacobian(solution.y)[:, self.free]
        self.refine(rounds)

    def refine(self, rounds=5):
        """Newton's corrections with the derivative of the start, which gain some fourteen digits each beside it."""
        for _ in range(rounds):
            residual = self.residual()
            size = max(abs(r) for r in residual)
            if size == 0:
                break
            scaled = np.array([float(r / size) for r in residual])
            update = np.linalg.solve(self.jacobian, scaled)
            for j, value in zip(self.free, update, strict=True):
                self.y[j] -= mpmath.mpf(float(value)) * size
        self.left = max(abs(r) for r in self.residual())

    def move(self, value, rounds=12):
        """Along the family to where the held unknown has a value near that of the start."""
        self.y[self.held] = value
        self.refine(rounds)

    def energy(self):
        """h of the start."""
        z, n = self.start(), len(self.squares)
        return mpmath.fsum(square * q * q + p * p for square, q, p in zip(self.squares, z[:n], z[n:], strict=True)) / 2

    def start(self):
        segment = self.segment
        s = self.problem.parameters
        return [dot(segment.start_map[r], self.y[:s]) + float(segment.start_offset[r]) for r in range(self.problem.size)]

    def flight_times(self):
        s, size = self.problem.parameters, self.problem.size
        return [self.y[s + i * (size + 1)] for i in range(self.problem.inner + 1)]

    def impact(self, i, z):
        segment = self.segment
        speed = dot(segment.gap_rate[i], z) * float(segment.jump[i])
        return [a - speed * float(b) for a, b in zip(z, segment.push[i], strict=True)]

    def residual(self):
        """F of a problem between two ends."""
        problem, segment, size = self.problem, self.segment, self.problem.size
        s = problem.parameters
        z = self.start()
        out = []
        for i, time in enumerate(self.flight_times()):
            if i > 0:
                at = s + 1 + (i - 1) * (size + 1)
                z = self.y[at : at + size]
            end = flow(self.squares, z, time)
            if i < problem.inner:
                at = s + 1 + i * (size + 1)
                target = self.y[at : at + size]
                out += [a - b for a, b in zip(self.impact(i, end), target, strict=True)]
                out.append(dot(segment.gap[i], target) - float(segment.bound[i]))
            else:
                out += [dot(row, end) - float(value) for row, value in zip(segment.end_map, segment.end_offset, strict=True)]
        return out

    def run(self, z, to_stop):
        """From a start state through all impacts of the word to the far end: at its stop, or at the orbit's own time there."""
        times = self.flight_times()
        total = mpmath.fsum(times)
        elapsed = mpmath.mpf(0)
        for i, guess in enumerate(times):
            if i == self.problem.inner and not to_stop:
                return flow(self.squares, z, total - elapsed)
            t = guess
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

    def half_map(self):
        """phi, (2 (n-1), 2 (n-1)) mpf entries, for two degrees of freedom."""
        origin, rest, stop = 0, 1, 2
        kinds = self.problem.kinds
        start = self.start()
        final = self.run(start, kinds[1] == stop)

        def across(kind, node, z):
            if kind == origin:
                x = z[2:]
            elif kind == rest:
                x = [square * q for square, q in zip(self.squares, z[:2], strict=True)]
            else:
                x = [mpmath.mpf(float(g)) for g in self.segment.gap[node, :2]]
            size = mpmath.sqrt(x[0] ** 2 + x[1] ** 2)
            return [-x[1] / size, x[0] / size]

        first = across(kinds[0], self.problem.inner + 1, start)
        last = across(kinds[1], self.problem.inner, final)
        zero = [mpmath.mpf(0)] * 2
        if kinds[0] == origin:
            columns = [zero + first, [-x for x in first] + zero]
        elif kinds[0] == rest:
            columns = [first + zero, zero + first]
        else:
            gap = [mpmath.mpf(float(g)) for g in self.segment.gap[self.problem.inner + 1, :2]]
            work = mpmath.fsum(w * q * d for w, q, d in zip(self.squares, start[:2], first, strict=True))
            normal = gap[0] * start[2] + gap[1] * start[3]
            columns = [first + [-work / normal * g for g in gap], zero + first]
        phi = [[None, None], [None, None]]
        for j, column in enumerate(columns):
            ends = [
                self.run([a + sign * STEP * b for a, b in zip(start, column, strict=True)], kinds[1] == stop) for sign in (1, -1)
            ]
            x = [(a - b) / (2 * STEP) for a, b in zip(*ends, strict=True)]
            displacement = last[0] * x[0] + last[1] * x[1]
            velocity = last[0] * x[2] + last[1] * x[3]
            phi[0][j], phi[1][j] = (velocity, -displacement) if kinds[1] == origin else (displacement, velocity)
        return phi
