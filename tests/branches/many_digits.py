"""Periodic orbits in fifty digits by single shooting: an oracle that shares nothing with the program.

The modal state (q, q') after a whole period, from a place between two impacts, through exact flights and elastic impacts; its derivative is
the product of flights and saltation matrices. Newton's method with the smallest correction of start and period finds the orbit next to the
given one, wherever that lies on its family; its energy may move.
"""

import mpmath as mp
import numpy as np

DIGITS = 50


class ManyDigits:
    """The orbit next to one that is known in double precision.

    Parameters
    ----------
    orbit : branches.orbit.Orbit
        Of an undamped elastic system with two degrees of freedom, a diagonal mass matrix and one stop.
    digits : int
        Of the arithmetic. The equations of an orbit with |tau| - 2 = 10^-k are singular to k digits, and twice that are lost.

    Attributes
    ----------
    margin : mpf
        |tau| - 2, where tau is the trace of the period map less 2.
    residual : mpf
        By how far the orbit does not close.
    moved : mpf
        How far the start is from the one in double precision.

    Raises
    ------
    ZeroDivisionError
        At a branch point, where no single orbit is next.
    """

    def __init__(self, orbit, digits=DIGITS):
        self.digits = digits
        with mp.workdps(digits):
            self._set_up(orbit)
            given = list(self.state)
            self._solve()
            end, product = self.around()
            self.margin = abs(sum(product[i, i] for i in range(4)) - 2) - 2
            self.residual = max(abs(a - b) for a, b in zip(end, self.state, strict=True))
            self.moved = max(abs(a - b) for a, b in zip(given, self.state, strict=True))

    def _set_up(self, orbit):
        system = orbit.system
        masses = [mp.mpf(float(m)) for m in np.diag(system.mass)]
        assert not np.any(system.damping) and not np.any(system.mass - np.diag(np.diag(system.mass))) and len(masses) == 2
        (stop,) = system.stops
        k = [[mp.mpf(float(x)) for x in row] for row in system.stiffness]
        a, b, c = k[0][0] / masses[0], k[0][1] / mp.sqrt(masses[0] * masses[1]), k[1][1] / masses[1]
        middle, root = (a + c) / 2, mp.sqrt(((a - c) / 2) ** 2 + b * b)
        self.squares = [middle - root, middle + root]
        self.frequencies = [mp.sqrt(square) for square in self.squares]
        shapes = []
        for square in self.squares:
            size = mp.sqrt(b * b + (square - a) ** 2)
            shapes.append([b / size / mp.sqrt(masses[0]), (square - a) / size / mp.sqrt(masses[1])])
        self.gap = [sum(mp.mpf(float(x)) * y for x, y in zip(stop.gap, shape, strict=True)) for shape in shapes]
        # The start is in the middle of the longest flight.
        times = np.array([impact.time % orbit.period for impact in orbit.impacts])
        order = np.argsort(times)
        flights = np.diff(np.append(times[order], times[order[0]] + orbit.period))
        longest = int(np.argmax(flights))
        begin = float(times[order[longest]] + 0.5 * flights[longest]) % orbit.period
        order = np.roll(order, -longest - 1)
        self.times = [mp.mpf(float((times[i] - begin) % orbit.period)) for i in order]
        self.bounds = [mp.mpf(float(stop.upper if orbit.impacts[i].stop.endswith("+") else stop.lower)) for i in order]
        u, v = orbit.sample(np.array([begin]))
        self.state = [
            sum(shape[j] * masses[j] * mp.mpf(float(part[0][j])) for j in (0, 1)) for part in (u, v) for shape in shapes
        ]
        self.period = mp.mpf(float(orbit.period))
        self.turned = None, []

    def flow(self, z, t):
        """Free flight. Several states fly for the same time: its cosines and sines are kept."""
        if t != self.turned[0]:
            turns = [(w, *mp.cos_sin(w * t)) for w in self.frequencies]
            self.turned = t, [(c, s / w, w * s) for w, c, s in turns]
        (c, a, b), (d, e, f) = self.turned[1]
        return [c * z[0] + a * z[2], d * z[1] + e * z[3], c * z[2] - b * z[0], d * z[3] - f * z[1]]

    def rate(self, z):
        """The vector field."""
        return [z[2], z[3], -self.squares[0] * z[0], -self.squares[1] * z[1]]

    def impact(self, z):
        """The relative velocity turns round."""
        push = 2 * (self.gap[0] * z[2] + self.gap[1] * z[3]) / (self.gap[0] ** 2 + self.gap[1] ** 2)
        return [z[0], z[1], z[2] - push * self.gap[0], z[3] - push * self.gap[1]]

    def around(self):
        """State after a period, and its derivative (4, 4); the impact times are found anew, from those of before."""
        z, columns, now = self.state, [[mp.mpf(i == j) for i in range(4)] for j in range(4)], mp.mpf(0)
        for i, bound in enumerate(self.bounds):
            t = self.times[i] - now
            for _ in range(60):
                before = self.flow(z, t)
                speed = self.gap[0] * before[2] + self.gap[1] * before[3]
                change = (self.gap[0] * before[0] + self.gap[1] * before[1] - bound) / speed
                t -= change
                if abs(change) < mp.mpf(10) ** (8 - self.digits):
                    break
            else:
                raise ArithmeticError("the impact was not found")
            before = self.flow(z, t)
            z = self.impact(before)
            coming, going = self.impact(self.rate(before)), self.rate(z)
            for j, column in enumerate(columns):
                there = self.flow(column, t)
                late = (self.gap[0] * there[0] + self.gap[1] * there[1]) / speed
                columns[j] = [x + late * (b - a) for x, a, b in zip(self.impact(there), coming, going, strict=True)]
            now += t
            self.times[i] = now
        last = self.period - now
        return self.flow(z, last), mp.matrix([self.flow(column, last) for column in columns]).T

    def _solve(self):
        for _ in range(12):
            end, product = self.around()
            rate, arrival = self.rate(self.state), self.rate(end)
            slope = [square * q for square, q in zip(self.squares, self.state, strict=False)] + self.state[2:]
            # Energy is kept: that part of the return which changes it most follows from the others.
            kept = [i for i in range(4) if i != max(range(4), key=lambda j: abs(slope[j]))]
            jacobian = mp.matrix([[product[i, j] - (i == j) for j in range(4)] + [arrival[i]] for i in kept] + [[*rate, 0]])
            residual = mp.matrix([end[i] - self.state[i] for i in kept] + [0])
            step = jacobian.T * mp.lu_solve(jacobian * jacobian.T, residual)
            self.state = [a - b for a, b in zip(self.state, step[:4], strict=True)]
            self.period -= step[4]
            if mp.norm(step) < mp.mpf(10) ** (-self.digits // 2 - 5):
                return
        raise ArithmeticError("Newton's method did not settle")
