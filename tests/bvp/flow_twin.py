"""A second event-driven flow of impacting systems, in plain numpy and in physical coordinates: an oracle for tests.

It shares nothing with `bvp`: the modes come from numpy's eigenproblems (damped systems must not be critically damped), impacts
are found by sampling the gaps and their rates, by Brent's method and by bisection; tests keep away from grazing.
"""

import numpy as np
from scipy.optimize import brentq

from benchmarks.backbone import modes_of
from tests.bvp.twins import first_order


class Twin:
    """The flow of one system; states are x = (u, v), (2n,)."""

    def __init__(self, system, samples=60, restitution_sign=1.0):
        self.system = system
        self.n = system.degrees_of_freedom
        self.matrix = first_order(system)
        self.damped = bool(np.any(system.damping))
        if self.damped:
            self.rates, self.vectors = np.linalg.eig(self.matrix)
            self.inverse = np.linalg.inv(self.vectors)
        self.frequencies, self.shapes = modes_of(system)
        self.to_modes = self.shapes.T @ system.mass
        self.longest = 2.0 * np.pi / np.max(self.frequencies) / samples
        self.restitution_sign = restitution_sign
        self.contacts = []
        for stop in system.stops:
            c = np.array(stop.gap)
            for side, bound in ((-1.0, stop.lower), (1.0, stop.upper)):
                if np.isfinite(bound):
                    name = stop.name if len(system.stops) > 1 else ""
                    self.contacts.append((c, side, bound, stop.restitution, name + ("+" if side > 0 else "-")))

    def flow(self, x, t):
        """States at times t: (2n,) for a number, (m, 2n) for an array."""
        if np.ndim(t):
            return self._damped(x, np.asarray(t)) if self.damped else self._modal(x, np.asarray(t))
        return self.flow(x, np.array([t]))[0]

    def _damped(self, x, t):
        return np.real((np.exp(np.outer(t, self.rates)) * (self.inverse @ x)) @ self.vectors.T)

    def _modal(self, x, t):
        n, w = self.n, self.frequencies
        q, p = self.to_modes @ x[:n], self.to_modes @ x[n:]
        c = np.cos(np.outer(t, w))
        s = np.where(w > 0, np.sin(np.outer(t, w)) / np.where(w > 0, w, 1.0), t[:, None])
        return np.hstack([(c * q + s * p) @ self.shapes.T, (c * p - s * w * w * q) @ self.shapes.T])

    def impact(self, x, contact):
        """The state after an impact on a contact: Newton's restitution along M^-1 c."""
        c, _, _, restitution, _ = self.contacts[contact]
        direction = np.linalg.solve(self.system.mass, c)
        speed = c @ x[self.n :]
        out = x.copy()
        out[self.n :] -= (1.0 + self.restitution_sign * restitution) * speed / (c @ direction) * direction
        return out

    def distances(self, states):
        """side (bound - w) of every contact, (m, contacts)."""
        return np.array([side * (bound - states[:, : self.n] @ c) for c, side, bound, _, _ in self.contacts]).T

    def next_hit(self, x, leaving, horizon):
        """(time, contact) of the first impact within the horizon; contact None where there is none."""
        t = 0.0
        dt = min(self.longest, horizon)
        here = self.distances(x[None])[0]
        speeds = np.array([-side * (c @ x[self.n :]) for c, side, *_ in self.contacts])
        accelerations = np.array([-side * (c @ (self.matrix @ x)[self.n :]) for c, side, *_ in self.contacts])
        for j in range(len(self.contacts)):
            if j == leaving and accelerations[j] < 0:
                dt = min(dt, max(0.5 * speeds[j] / -accelerations[j], 1e-9))
            elif j != leaving and speeds[j] < 0:
                dt = min(dt, max(0.2 * here[j] / -speeds[j], 1e-9))
        while t < horizon:
            times = t + dt * np.arange(1, 33)
            if t == 0.0:
                times = np.concatenate([dt * np.array([0.01, 0.1, 0.4]), times])
            states = self.flow(x, times)
            distances = self.distances(states)
            outside = distances < 0.0
            if leaving is not None and t == 0.0:
                outside[0, leaving] = False
            rates = np.array([-side * (states[:, self.n :] @ c) for c, side, *_ in self.contacts]).T
            turns = (rates[:-1] < 0.0) & (rates[1:] > 0.0) & ~outside[:-1] & ~outside[1:]
            turns &= distances[:-1] < (rates[1:] - rates[:-1]) * np.diff(times)[:, None]
            for i, j in np.argwhere(turns):
                lowest = self._turn(x, j, times[i], times[i + 1])
                if self.distances(self.flow(x, lowest)[None])[0, j] < 0.0:
                    times = np.insert(times, i + 1, lowest)
                    outside = np.insert(outside, i + 1, np.arange(len(self.contacts)) == j, axis=0)
                    break
            if np.any(outside):
                first = int(np.argmax(np.any(outside, axis=1)))
                low = times[first - 1] if first else t
                roots = [(self._bisect(x, j, low, times[first]), j) for j in np.flatnonzero(outside[first])]
                time, contact = min(roots)
                return (time, contact) if time <= horizon else (horizon, None)
            t = times[-1]
            dt = min(2.0 * dt, self.longest)
        return horizon, None

    def _turn(self, x, contact, low, high):
        c, side, *_ = self.contacts[contact]
        for _ in range(60):
            middle = 0.5 * (low + high)
            if -side * (c @ self.flow(x, middle)[self.n :]) < 0.0:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)

    def _gap(self, x, c):
        """The gap coordinate as a function of time."""
        if self.damped or not np.all(self.frequencies > 0.0):
            return lambda t: c @ self.flow(x, t)[: self.n]
        row, w = c @ self.shapes, self.frequencies
        cosine, sine = row * (self.to_modes @ x[: self.n]), row * (self.to_modes @ x[self.n :]) / w
        return lambda t: cosine @ np.cos(w * t) + sine @ np.sin(w * t)

    def _bisect(self, x, contact, low, high):
        c, side, bound, _, _ = self.contacts[contact]
        gap = self._gap(x, c)

        def distance(t):
            return side * (bound - gap(t))

        if distance(low) > 0.0 > distance(high):
            # The last bits by bisection.
            root = brentq(distance, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
            for reach in (8.0, 64.0):
                near, far = root - reach * np.spacing(root), root + reach * np.spacing(root)
                if low < near and far < high and distance(near) > 0.0 > distance(far):
                    low, high = near, far
                    break
        for _ in range(200):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            if distance(middle) < 0.0:
                high = middle
            else:
                low = middle
        return 0.5 * (low + high)

    def run(self, x, duration, leaving=None, most=1000):
        """(end state, [(time, contact, state before, state after)]) over a duration, or up to `most` impacts."""
        t = 0.0
        events = []
        while t < duration and len(events) < most:
            step, contact = self.next_hit(x, leaving, duration - t)
            before = self.flow(x, step)
            t += step
            if contact is None:
                return before, events
            x = self.impact(before, contact)
            events.append((t, contact, before, x))
            leaving = contact
        return x, events
