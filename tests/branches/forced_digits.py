"""Periodic orbits under a harmonic load in many digits by single shooting: an oracle that shares nothing with the program.

The state at one phase of the load is mapped by exact flights to the phase a period, or half of one, later. The derivative is the product
of flights and saltation matrices, as in textbooks; it needs impacts of some speed. Newton's method solves the orbit together with the
condition of an event, with derivatives that are differenced in so many digits that none is lost.
"""

import mpmath as mp
import numpy as np

DIGITS = 40
STEP = mp.mpf(10) ** -18


class ForcedDigits:
    """The stroboscopic map of a system with two degrees of freedom and one load cos(w t), beside an orbit of a `ForcedProblem` in w.

    Parameters
    ----------
    problem : ForcedProblem
    y : (u,) float
        The orbit in double precision: its impact times are guesses. The map begins in the middle of its longest flight.
    """

    def __init__(self, problem, y):
        mp.mp.dps = DIGITS
        values, system = problem.parameters(y), problem.system
        at = {name: mp.mpf(repr(value)) for name, value in values.items()}
        mu, sigma, lam, c = (at[name] for name in ("mu", "sigma", "lam", "c"))
        self.masses = np.array([mu, mp.mpf(1)])
        self.damping = np.array([[c, -c], [-c, lam + c]])
        self.stiffness = np.array([[sigma, -sigma], [-sigma, 1 + sigma]])
        assert np.allclose(system.stiffness, self.stiffness.astype(float)) and np.allclose(system.damping, self.damping.astype(float))
        self.rho, self.load = at["rho"], at["F"]
        self._around_of = []
        self.half, self.periods = problem.half, problem.load_periods
        nodes, times = problem.nodes(y), problem.flight_times(y)
        period = problem.period(y)
        longest = int(np.argmax(times))
        letters = list(problem.sequence)
        sides = [1 if letter == "+" else -1 for letter in letters]
        middle = 0.5 * float(times[longest])
        state, _ = problem.fly(nodes[longest], middle)
        self.phase = mp.mpf(2 * np.pi * self.periods * float(nodes[longest][4] + middle / period))
        order = list(range(longest + 1, len(letters))) + list(range(longest + 1))
        passed = 0.5 * float(times[longest])
        self.sides, self.guesses = [], []
        for place, k in enumerate(order):
            self.sides.append(sides[k] if place < len(letters) - longest - 1 or not self.half else -sides[k])
            self.guesses.append(passed)
            passed += float(times[k])
        self.start = np.array([mp.mpf(float(x)) for x in (*state[:4], values["w"])])
        eye, zero = np.eye(2), np.zeros((2, 2))
        a = np.block([[zero, eye], [-self.stiffness / self.masses[:, None], -self.damping / self.masses[:, None]]])
        self.rates = mp.matrix([[mp.mpf(x) for x in row] for row in a])
        found, vectors = mp.eig(self.rates)
        self.exponents = np.array(found)
        self.vectors = np.array(vectors.tolist()).reshape(4, 4)
        self.inverse = np.array(mp.inverse(vectors).tolist()).reshape(4, 4)
        self.gap = np.array([mp.mpf(1), mp.mpf(-1)])
        self.push = self.gap / self.masses / sum(self.gap**2 / self.masses)

    def response(self, w, time):
        """The steady state (u, v) without impacts at a time."""
        if getattr(self, "_at", None) != w:
            k = mp.matrix(2, 2)
            for i in range(2):
                for j in range(2):
                    k[i, j] = self.stiffness[i, j] + 1j * w * self.damping[i, j] - (w * w * self.masses[i] if i == j else 0)
            self._at, self._amplitude = w, np.array(list(mp.lu_solve(k, mp.matrix([0, self.load]))))
        turned = self._amplitude * mp.expj(w * time)
        return np.array([*(x.real for x in turned), *((1j * w * x).real for x in turned)])

    def rate(self, w, time, z):
        """d(u, v)/dt."""
        force = np.array([mp.mpf(0), self.load * mp.cos(w * time)])
        return np.concatenate([z[2:], (force - self.damping @ z[2:] - self.stiffness @ z[:2]) / self.masses])

    def fly(self, w, time, z, duration):
        """The state after a flight, and the matrix of the flight."""
        matrix = (self.vectors * np.array([mp.exp(x * duration) for x in self.exponents])) @ self.inverse
        matrix = np.array([[x.real for x in row] for row in matrix])
        return self.response(w, time + duration) + matrix @ (z - self.response(w, time)), matrix

    def around(self, x):
        """The image of x = (u, v, w) after the period, or minus that after half of it; its derivative; the speeds of approach."""
        w, z = x[4], x[:4]
        self._around_of = list(x[:5])
        begun = self.phase / w
        duration = 2 * mp.pi * self.periods / w / (2 if self.half else 1)
        product, time, speeds = np.array(mp.eye(4).tolist()).reshape(4, 4), begun, []
        self.instants = []
        scale = 1
        for side, guess in zip(self.sides, self.guesses, strict=True):
            t = begun + scale * mp.mpf(guess) - time
            for _ in range(60):
                at, matrix = self.fly(w, time, z, t)
                update = (self.gap @ at[:2] - side) / (self.gap @ at[2:])
                t -= update
                if abs(update) < mp.mpf(10) ** (3 - DIGITS):
                    break
            at, matrix = self.fly(w, time, z, t)
            time += t
            approach = self.gap @ at[2:]
            speeds.append(side * approach)
            self.instants.append(time - begun)
            reset = np.array(mp.eye(4).tolist()).reshape(4, 4)
            reset[2:, 2:] = reset[2:, 2:] - (1 + self.rho) * np.outer(self.push, self.gap)
            z = reset @ at
            change = self.rate(w, time, z) - reset @ self.rate(w, time, at)
            reset[:, :2] = reset[:, :2] + np.outer(change, self.gap) / approach
            product = reset @ matrix @ product
        z, matrix = self.fly(w, time, z, begun + duration - time)
        sign = -1 if self.half else 1
        return sign * z, sign * (matrix @ product), speeds

    def orbit(self, w):
        """The orbit at a value of w."""
        x = self.start.copy()
        x[4] = mp.mpf(w)
        for _ in range(30):
            image, product, _ = self.around(x)
            update = np.array(list(mp.lu_solve(mp.matrix((product - np.eye(4)).tolist()), mp.matrix(list(image - x[:4])))))
            x[:4] -= update
            if max(abs(u) for u in update) < mp.mpf(10) ** (8 - DIGITS):
                break
        return x

    def multipliers(self, x):
        """Those of the map."""
        return mp.eig(mp.matrix(self.around(x)[1].tolist()), left=False, right=False)

    def event(self, code):
        """w of the event beside the start, with the orbit x = (u, v, w).

        SN: a multiplier 1. SB (of half a period) and PD: a multiplier -1. NS: a pair of product 1. GR: a flight touches a stop.
        """
        x = list(self.start)
        if code == "GR":
            x += [self._turning()]
        for _ in range(30):
            value = self._conditions(code, x)
            jacobian = mp.matrix(len(x), len(x))
            for j in range(len(x)):
                moved = list(x)
                moved[j] += STEP
                other = self._conditions(code, moved)
                for i in range(len(x)):
                    jacobian[i, j] = (other[i] - value[i]) / STEP
            update = mp.lu_solve(jacobian, mp.matrix(value))
            x = [a - b for a, b in zip(x, update, strict=True)]
            if max(abs(u) for u in update) < mp.mpf(10) ** (-DIGITS // 2 - 5):
                break
        return np.array(x[:5])

    def _conditions(self, code, x):
        z = np.array(x[:5])
        image, product, _ = self.around(z)
        closes = list(image - z[:4])
        if code == "GR":
            at = self._at_time(z, x[5])
            return [*closes, self.gap @ at[:2] - self.side, self.gap @ at[2:]]
        if code == "NS":
            found = mp.eig(mp.matrix(product.tolist()), left=False, right=False)
            out = mp.mpc(1)
            for i in range(4):
                for j in range(i):
                    out *= 1 - found[i] * found[j]
            return [*closes, out.real]
        sign = 1 if code == "SN" else -1
        return [*closes, mp.det(mp.matrix((product - sign * np.eye(4)).tolist()))]

    def _at_time(self, z, instant):
        """The state (u, v) at a time after the start, with the impacts up to it."""
        if self._around_of != list(z):
            self.around(z)
        begun, time, state = self.phase / z[4], self.phase / z[4], z[:4]
        for at in self.instants:
            if at > instant:
                break
            state, _ = self.fly(z[4], time, state, begun + at - time)
            state[2:] = state[2:] - (1 + self.rho) * self.push * (self.gap @ state[2:])
            time = begun + at
        return self.fly(z[4], time, state, begun + instant - time)[0]

    def _turning(self):
        """The instant in open flight where the gap turns closest to a stop, by samples, and the side."""
        x = self.start
        self.around(x)
        whole = 2 * mp.pi * self.periods / x[4] / (2 if self.half else 1)
        ends = [mp.mpf(0), *self.instants, whole]
        found = []
        for begun, end in zip(ends[:-1], ends[1:], strict=True):
            instants = [begun + (end - begun) * k / 60 for k in range(1, 60)]
            gaps = [self.gap @ self._at_time(x, t)[:2] for t in instants]
            for before, at, after, instant in zip(gaps, gaps[1:], gaps[2:], instants[1:], strict=False):
                if (at - before) * (after - at) <= 0:
                    peak = at - (after - before) ** 2 / (8 * (after - 2 * at + before))  # of a parabola
                    found.append((abs(abs(peak) - 1), instant, 1 if at > 0 else -1))
        _, instant, self.side = min(found)
        return instant
