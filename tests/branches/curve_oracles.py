"""Closed forms and many digits for curves of bifurcations in two parameters. Nothing here uses the solvers of saltus.

- `ImpactOscillator`: fold, period doubling and grazing of the orbits with one impact in p periods of the load, and where they meet.
- `doubling_coefficient`: the cubic normal-form coefficient of a period doubling of such an orbit.
- `ReferenceBackbone`: fold, symmetry breaking and touch of the orbits with one impact a half period of the reference system.
- `AbsorberOrbit`: multipliers and touches of a claimed response of the scene `absorber`.
- `cusp_fold`, `BogdanovTakens`, `ResonantMap`: algebraic problems whose curves and codimension-two points are known.

Numbers are mpmath numbers of `DIGITS` digits. A float argument stands for the decimal number that it prints as. Arithmetic with the results
has the digits of the caller: `mp.workdps(DIGITS)` keeps them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np
import scipy.linalg

DIGITS = 40

Number = Any
"""int, float, decimal text or mpf."""


def exact(x: Number) -> mp.mpf:
    """The decimal number that a float prints as; other numbers as they are."""
    return mp.mpf(repr(float(x))) if isinstance(x, float | np.floating) else mp.mpf(x)


def many_digits(function: Callable) -> Callable:
    """Run a function in `DIGITS` digits."""

    def run(*args: Any, **options: Any) -> Any:
        with mp.workdps(DIGITS):
            return function(*args, **options)

    run.__doc__, run.__name__ = function.__doc__, function.__name__
    return run


def unit(angle: mp.mpf) -> mp.mpc:
    """exp(i angle). (`findroot` refuses `mp.expj` of real numbers.)"""
    return mp.mpc(*mp.cos_sin(angle))


# One degree of freedom, one impact in p periods of the load


class OneImpact(NamedTuple):
    """An orbit with one impact: x'' + c x' + k x = A cos(w t), x <= d.

    speed: before the impact, into the stop, so v- > 0. phase: w t at the impact, in [0, 2 pi).
    """

    w: mp.mpf
    amplitude: mp.mpf
    distance: mp.mpf
    speed: mp.mpf
    phase: mp.mpf


class Touch(NamedTuple):
    """A local maximum of x inside a flight: the time after the impact, and d - x there (negative: the orbit penetrates the stop)."""

    time: mp.mpf
    clearance: mp.mpf


class Forms(NamedTuple):
    """Coefficients at one frequency: see `ImpactOscillator`."""

    alpha: mp.mpf
    beta: mp.mpf
    push: mp.mpf
    rest: mp.mpf


@dataclass(frozen=True)
class ImpactOscillator:
    """x'' + c x' + k x = A cos(w t), x <= d, velocity v -> -e v at the stop: orbits with one impact in T = 2 pi p/w.

    A constant load f0 moves d to d - f0/k: the scene `oscillator_at_wall` (x'' + c x' + x = -d + A cos(w t), x <= 0) has the distance d.

    With the flight matrix M = exp(T [[0, 1], [-k, -c]]) and (g, h) = (M - 1)^-1 (0, 1), the motion without load must take the jump (1+e) v
    back in one flight, so it is (1+e) v (g, h) after the impact. With Y = A/sqrt((k - w^2)^2 + c^2 w^2) the conditions are

        Y cos(theta) = d - alpha v,   Y sin(theta) = beta v,   alpha = (1+e) g,   beta = (e + (1+e) h)/w
        Y^2 = (d - alpha v)^2 + (beta v)^2                                                                (a quadratic in v)

    Fold, dY/dv = 0: v = alpha d/(alpha^2 + beta^2). Grazing, v = 0: Y = d. The monodromy is M times the saltation matrix
    [[-e, 0], [(a+ + e a-)/v, -e]] with a+ + e a- = -(1+e) (w^2 d + ((k - w^2) alpha + c w beta) v), so

        det = e^2 exp(-c T),   tr = -e tr(M) - m12 (1+e) (w^2 d/v + (k - w^2) alpha + c w beta).

    Period doubling, 1 + tr + det = 0: rest v = push d with push = (1+e) w^2 m12 and
    rest = 1 + det - e tr(M) - (1+e) m12 ((k - w^2) alpha + c w beta).

    The three meet at v = 0 where m12 = exp(-c T/2) sin(W T)/W vanishes, W = sqrt(k - c^2/4): at w = 2 p W/m, m = 1, 2, ... . Then alpha,
    which is -(1+e) m12/det(M - 1), and push vanish together. Since det(M - 1) > 0 and rest > 0 there, the fold has v > 0 where m12 < 0 and
    the doubling has v > 0 where m12 > 0: they leave the point to opposite sides, both quadratically tangent to the grazing.
    """

    damping: Number
    restitution: Number
    stiffness: Number = 1
    distance: Number = 1
    periods: int = 1

    def _data(self) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
        return exact(self.damping), exact(self.restitution), exact(self.stiffness)

    @property
    def free_frequency(self) -> mp.mpf:
        """W = sqrt(k - c^2/4)."""
        with mp.workdps(DIGITS):
            c, _, k = self._data()
            return mp.sqrt(k - c * c / 4)

    def period(self, w: Number) -> mp.mpf:
        """T."""
        with mp.workdps(DIGITS):
            return 2 * mp.pi * self.periods / exact(w)

    def flight(self, time: mp.mpf) -> mp.matrix:
        """exp(t [[0, 1], [-k, -c]])."""
        c, _, k = self._data()
        w = mp.sqrt(k - c * c / 4)
        cosine, sine, decay = mp.cos(w * time), mp.sin(w * time) / w, mp.exp(-c * time / 2)
        return decay * mp.matrix([[cosine + c / 2 * sine, sine], [-k * sine, cosine - c / 2 * sine]])

    def impedance(self, w: Number) -> mp.mpf:
        """sqrt((k - w^2)^2 + c^2 w^2) = A/Y."""
        c, _, k = self._data()
        w = exact(w)
        return mp.sqrt((k - w * w) ** 2 + (c * w) ** 2)

    def _forms(self, w: mp.mpf) -> Forms:
        c, e, k = self._data()
        m = self.flight(self.period(w))
        g, h = mp.lu_solve(m - mp.eye(2), mp.matrix([0, 1]))
        alpha, beta = (1 + e) * g, (e + (1 + e) * h) / w
        trace, determinant = m[0, 0] + m[1, 1], e * e * mp.det(m)
        rest = 1 + determinant - e * trace - (1 + e) * m[0, 1] * ((k - w * w) * alpha + c * w * beta)
        return Forms(alpha, beta, (1 + e) * w * w * m[0, 1], rest)

    def _along(self, w: mp.mpf, distance: mp.mpf, speed: mp.mpf, amplitude: mp.mpf | None) -> OneImpact:
        """The orbit with this ratio of distance and speed, with the given amplitude, or with the distance of the oscillator."""
        alpha, beta, _, _ = self._forms(w)
        (c, _, k), z = self._data(), self.impedance(w)
        if amplitude is None:
            if distance * exact(self.distance) <= 0 or speed < 0:
                raise ValueError("no orbit with an impact speed > 0 on this curve at this frequency")
            scale = exact(self.distance) / distance
        else:
            scale = amplitude / (z * mp.hypot(distance - alpha * speed, beta * speed))
        distance, speed = scale * distance, scale * speed
        along, across = distance - alpha * speed, beta * speed  # Y cos(theta), Y sin(theta)
        cosine, sine = (k - w * w) * along - c * w * across, (k - w * w) * across + c * w * along
        return OneImpact(w, mp.hypot(cosine, sine), distance, speed, mp.atan2(sine, cosine) % (2 * mp.pi))

    @many_digits
    def grazing(self, w: Number, amplitude: Number | None = None) -> OneImpact:
        """The motion without impacts that touches the stop: at the distance of the oscillator, or with a given amplitude."""
        return self._along(exact(w), mp.mpf(1), mp.mpf(0), None if amplitude is None else exact(amplitude))

    @many_digits
    def fold(self, w: Number, amplitude: Number | None = None) -> OneImpact:
        """The fold: its amplitude at the distance of the oscillator, or its distance (of any sign) at a given amplitude.

        Raises ValueError where the first has no impact speed v > 0."""
        w = exact(w)
        alpha, beta, _, _ = self._forms(w)
        side = mp.sign(alpha)
        return self._along(w, side * (alpha**2 + beta**2), side * alpha, None if amplitude is None else exact(amplitude))

    @many_digits
    def doubling(self, w: Number, amplitude: Number | None = None) -> OneImpact:
        """The period doubling, as `fold`."""
        w = exact(w)
        _, _, push, rest = self._forms(w)
        side = mp.sign(push)
        return self._along(w, side * rest, side * push, None if amplitude is None else exact(amplitude))

    @many_digits
    def orbit(self, w: Number, speed: Number) -> OneImpact:
        """The one orbit with this impact speed, at the distance of the oscillator: smooth through the fold."""
        w, speed, d = exact(w), exact(speed), exact(self.distance)
        alpha, beta, _, _ = self._forms(w)
        return self._along(w, d, speed, self.impedance(w) * mp.hypot(d - alpha * speed, beta * speed))

    @many_digits
    def orbits(self, w: Number, amplitude: Number) -> list[OneImpact]:
        """All orbits with one impact at a frequency and an amplitude, those that penetrate the stop too, by their speed."""
        w, amplitude, d = exact(w), exact(amplitude), exact(self.distance)
        alpha, beta, _, _ = self._forms(w)
        square, size = alpha**2 + beta**2, amplitude / self.impedance(w)
        root = (alpha * d) ** 2 - square * (d * d - size * size)
        if root < 0:
            return []
        speeds = [(alpha * d + sign * mp.sqrt(root)) / square for sign in (-1, 1)]
        return [self._along(w, d, v, amplitude) for v in speeds if v > 0]

    @many_digits
    def trace_and_determinant(self, orbit: OneImpact) -> tuple[mp.mpf, mp.mpf]:
        """Trace and determinant of the monodromy."""
        _, e, _ = self._data()
        determinant = e * e * mp.det(self.flight(self.period(orbit.w)))
        _, _, push, rest = self._forms(orbit.w)
        return rest - 1 - determinant - push * orbit.distance / orbit.speed, determinant

    @many_digits
    def state(self, orbit: OneImpact, time: Number) -> tuple[mp.mpf, mp.mpf]:
        """Position and velocity at a time after the impact, 0 <= t <= T."""
        (c, e, k), w, time = self._data(), orbit.w, exact(time)
        response = orbit.amplitude / (k - w * w + 1j * c * w)

        def steady(at: mp.mpf) -> mp.matrix:
            turned = response * unit(w * at + orbit.phase)
            return mp.matrix([turned.real, (1j * w * turned).real])

        after = mp.matrix([orbit.distance, -e * orbit.speed])
        found = steady(time) + self.flight(time) * (after - steady(mp.mpf(0)))
        return found[0], found[1]

    @many_digits
    def touches(self, orbit: OneImpact, samples: int = 400) -> list[Touch]:
        """The local maxima inside the flight. The velocity is sampled in double precision, and its roots are found in all digits."""
        period = self.period(orbit.w)
        times = np.linspace(0.0, float(period), samples * self.periods + 1)
        v = self._velocities(orbit, times)
        found = []
        for i in np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0)):
            ends = mp.mpf(times[i]), mp.mpf(times[i + 1])
            time = mp.findroot(lambda t: self.state(orbit, t)[1], ends, solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 10))
            found.append(Touch(time, orbit.distance - self.state(orbit, time)[0]))
        return found

    def _velocities(self, orbit: OneImpact, times: np.ndarray) -> np.ndarray:
        c, e, k = (float(x) for x in self._data())
        w, phase = float(orbit.w), float(orbit.phase)
        turned = float(orbit.amplitude) / (k - w * w + 1j * c * w) * np.exp(1j * (w * times + phase))
        x, v = turned.real, (1j * w * turned).real
        free = float(self.free_frequency)
        a, b = float(orbit.distance) - x[0], -e * float(orbit.speed) - v[0]
        sine, cosine = np.sin(free * times) / free, np.cos(free * times)
        return v + np.exp(-c * times / 2) * (b * cosine - (k * a + c / 2 * b) * sine)

    def clearance(self, orbit: OneImpact) -> mp.mpf:
        """The least d - x at a local maximum inside the flight; infinite without one. Negative: the orbit is inadmissible."""
        return min((touch.clearance for touch in self.touches(orbit)), default=mp.inf)

    def impact_map(self, z: mp.matrix, orbit: OneImpact) -> mp.matrix:
        """The map from (w t, x') just after an impact to those just after the next, near an orbit whose w, amplitude and distance it takes.

        In the digits of the caller. 2 pi p is taken from the phase. Raises ArithmeticError if no impact is near the end of the period."""
        (c, e, k), w, d = self._data(), +orbit.w, +orbit.distance
        response = orbit.amplitude / (k - w * w + 1j * c * w)
        turned = response * unit(z[0])
        x0, v0 = d - turned.real, z[1] - (1j * w * turned).real
        time = 2 * mp.pi * self.periods / w
        for _ in range(100):
            now, m = response * unit(w * time + z[0]), self.flight(time)
            x, v = now.real + m[0, 0] * x0 + m[0, 1] * v0, (1j * w * now).real + m[1, 0] * x0 + m[1, 1] * v0
            time -= (x - d) / v
            if abs(x - d) < mp.mpf(10) ** (8 - mp.mp.dps):
                return mp.matrix([z[0] + w * time - 2 * mp.pi * self.periods, -e * v])
        raise ArithmeticError("no impact near the end of the period")

    @many_digits
    def meeting(self, halves: int) -> mp.mpf:
        """w = 2 p W/m at which fold, doubling and grazing meet: m = `halves` half periods of the free oscillator last T."""
        return 2 * self.periods * self.free_frequency / halves

    @many_digits
    def tangency(self, halves: int) -> tuple[mp.mpf, mp.mpf]:
        """The coefficients of (w - w*)^2 in A - A_grazing at a meeting w*: of the fold (w beyond w* where m12 < 0) and of the doubling.

        With alpha = a (w - w*), push = b (w - w*) to first order, Y - d is -d a^2/(2 beta^2) on the fold, and
        d (-a b/rest + (beta b/rest)^2/2) on the doubling."""
        w, d, (c, e, _) = self.meeting(halves), exact(self.distance), self._data()
        _, beta, _, rest = self._forms(w)
        period = self.period(w)
        slope = -mp.exp(-c * period / 2) * (-1) ** halves * period / w  # of m12
        a = -(1 + e) * slope / mp.det(self.flight(period) - mp.eye(2))
        b = (1 + e) * w * w * slope
        z = self.impedance(w)
        return -z * d * a * a / (2 * beta**2), z * d * (-a * b / rest + (beta * b / rest) ** 2 / 2)

    @many_digits
    def touching(self, curve: Callable[[mp.mpf], OneImpact], value: Number, time: Number) -> tuple[OneImpact, mp.mpf]:
        """The orbit whose flight touches the stop on a curve of orbits, and the time of the touch after the impact.

        curve: such as `fold` or `doubling`, of the frequency, or a family of orbits of any other value. value, time: a guess."""

        def conditions(value: mp.mpf, time: mp.mpf) -> list[mp.mpf]:
            orbit = curve(value)
            x, v = self.state(orbit, time)
            return [x - orbit.distance, v]

        value, time = mp.findroot(conditions, (exact(value), exact(time)), tol=mp.mpf(10) ** (-2 * DIGITS + 16))
        return curve(value), time


def fold_stop(w: Number, r: Number, n: int = 1) -> mp.mpf:
    """The stop s of the fold of x'' + x = cos(w t), x <= s: |s| = |gamma| sqrt(1 + C^2/R^2), gamma = 1/(1 - w^2), T = 2 pi n/w,
    C = (1+r) sin T/(1 - cos T), R = (1-r)/w. The impact speed is positive for the sign of -C."""
    with mp.workdps(DIGITS):
        w, r = exact(w), exact(r)
        period = 2 * mp.pi * n / w
        c, rest = (1 + r) * mp.sin(period) / (1 - mp.cos(period)), (1 - r) / w
        return -mp.sign(c) * mp.sqrt(1 + (c / rest) ** 2) / abs(1 - w * w)


def doubling_stop(w: Number, r: Number, n: int = 1) -> mp.mpf:
    """The stop s of the period doubling of x'' + x = cos(w t), x <= s, in closed form.

    With S = sin T, C and R as in `fold_stop`, m = (1+r) w^2 S and K = 1 + r^2 - 2 r cos T + (1+r) S C (1 - w^2)/2 the impact has v K = s m,
    and s = sign(S) |gamma| K/sqrt(K^2 + C K m + (C^2 + R^2) m^2/4): no impact at S = 0, and s = 0 where K = 0."""
    with mp.workdps(DIGITS):
        w, r = exact(w), exact(r)
        period = 2 * mp.pi * n / w
        sine, cosine = mp.sin(period), mp.cos(period)
        c, rest, push = (1 + r) * sine / (1 - cosine), (1 - r) / w, (1 + r) * w * w * sine
        k = 1 + r * r - 2 * r * cosine + (1 + r) * sine * c * (1 - w * w) / 2
        return mp.sign(sine) * k / mp.sqrt(k * k + c * k * push + (c * c + rest * rest) * push**2 / 4) / abs(1 - w * w)


class Doubling(NamedTuple):
    """The period doubling of a map: c of the normal form xi -> -xi + c xi^3, its unit eigenvector, and the derivative of the map."""

    coefficient: mp.mpf
    eigenvector: mp.matrix
    derivative: mp.matrix


def map_derivative(oscillator: ImpactOscillator, orbit: OneImpact, digits: int = 120) -> mp.matrix:
    """The derivative of `ImpactOscillator.impact_map` at its fixed point, by differences of fourth order in so many digits."""
    with mp.workdps(digits):
        z = mp.matrix([orbit.phase, -exact(oscillator.restitution) * orbit.speed])
        step = mp.mpf(10) ** (-digits // 5)
        out = mp.matrix(2, 2)
        for j in (0, 1):
            unit_step = mp.matrix([step * (j == 0), step * (j == 1)])
            once, twice = (
                oscillator.impact_map(z + k * unit_step, orbit) - oscillator.impact_map(z - k * unit_step, orbit) for k in (1, 2)
            )
            out[:, j] = (8 * once - twice) / (12 * step)
        return out


def doubling_coefficient(oscillator: ImpactOscillator, orbit: OneImpact, digits: int = 120) -> Doubling:
    """The cubic coefficient of a period doubling, from differences of the map (phase of impact, velocity after it).

    The map takes (w t, x') just after an impact to those just after the next. Its impact time is a root in `digits` digits, and its
    differences lose less than those of the orbit. With A q = -q, |q| = 1, A^T p = -p, <p, q> = 1 (Kuznetsov, Elements of Applied
    Bifurcation Theory, section 5.4)

        c = <p, C(q, q, q) + 3 B(q, (1 - A)^-1 B(q, q))>/6.

    c > 0: supercritical, a stable orbit of twice the period beside the unstable one.
    """
    with mp.workdps(digits):
        z = mp.matrix([orbit.phase, -exact(oscillator.restitution) * orbit.speed])
        step = mp.mpf(10) ** (-digits // 5)

        def image(along: mp.matrix) -> mp.matrix:
            return oscillator.impact_map(z + step * along, orbit)

        def second(a: mp.matrix, b: mp.matrix) -> mp.matrix:
            """B(a, b)."""
            return (image(a + b) - image(a - b) - image(b - a) + image(-a - b)) / (4 * step**2)

        a = map_derivative(oscillator, orbit, digits)
        q = mp.matrix([a[0, 1], -1 - a[0, 0]])
        p = mp.matrix([a[1, 0], -1 - a[0, 0]])
        q /= mp.norm(q)
        p /= p[0] * q[0] + p[1] * q[1]
        third = (image(2 * q) - 2 * image(q) + 2 * image(-q) - image(-2 * q)) / (2 * step**3)
        total = third + 3 * second(q, mp.lu_solve(mp.eye(2) - a, second(q, q)))
        return Doubling((p[0] * total[0] + p[1] * total[1]) / 6, q, a)


# The reference system, one impact per half period


class BackbonePoint(NamedTuple):
    """An orbit with one impact per half period: alpha is T/4, h the energy."""

    alpha: mp.mpf
    h: mp.mpf


@dataclass(frozen=True)
class ReferenceBackbone:
    """mu u1'' + sigma (u1 - u2) = 0, u2'' + u2 + sigma (u2 - u1) = 0, elastic stops at |u1 - u2| = 1: one impact per half period.

    Frequencies w1 < w2, mass-normalised shapes, b_k = gap of shape k, B = b1^2 + b2^2 = 1 + 1/mu. With c_k = cos(w_k alpha) etc.

        G = sum b_k^2 tan(w_k alpha)/w_k,   h = sum b_k^2 / c_k^2 / (2 G^2)
        gap(t) = sum b_k^2 sin(w_k t)/(w_k c_k)/G, |t| <= alpha, impact at t = alpha.

    The saltation matrix of the impact is [[J, 0], [-kappa b b^T, J]] with J = 1 - 2 b b^T/B and kappa = 2 sum b_k^2 w_k tan(w_k alpha)/B^2.
    The half map is -saltation flight(2 alpha), its trace is 2 + tau_half. With beta_k = b_k^2/B the trace factorises:

        tau_half = -2 + 4 (beta_2 s1 + beta_1 s2 w1 c2/(w2 c1)) (beta_2 s1 + beta_1 s2 w2 c1/(w1 c2)).

    So the symmetry breaks (tau_half = -2) where one factor vanishes:

        origin kept:  b1^2 w1 sin(2 w2 alpha) + b2^2 w2 sin(2 w1 alpha) = 0
        stop kept:    b1^2 w2 tan(w2 alpha) + b2^2 w1 tan(w1 alpha) = 0

    ("origin kept": the broken orbits still run through u = 0; "stop kept": they still turn round at the stops.) The fold, dh/dalpha = 0,
    is G G'' = 2 G'^2. S11O00- has 0 < alpha < pi/(2 w2), S13O00+ pi/(2 w2) < alpha < pi/(2 w1).
    """

    mu: Number = 0.1
    sigma: Number = 0.1

    @cached_property
    def modes(self) -> list[tuple[mp.mpf, mp.mpf]]:
        """(w_k, b_k^2), w1 < w2. At sigma = 0 w1 = 0: the absorber flies freely."""
        with mp.workdps(DIGITS + 10):
            mu, sigma = exact(self.mu), exact(self.sigma)
            first, last = sigma / mu, 1 + sigma  # stiffness in units of the masses; mixed term -sigma/sqrt(mu)
            root = mp.sqrt(((first - last) / 2) ** 2 + sigma * sigma / mu)
            upper = (first + last) / 2 + root
            lower = sigma / (mu * upper)  # the product of the squares is sigma/mu
            found = []
            for square, other in ((lower, upper), (upper, lower)):
                # The receptance of the gap is (1 - (1 + mu) s)/(mu (s - s1) (s - s2)) with s = w^2; b_k^2 is minus its residue at s_k.
                found.append((mp.sqrt(square), -(1 - (1 + mu) * square) / (mu * (square - other))))
            return found

    def _tan_over(self, w: mp.mpf, time: mp.mpf) -> mp.mpf:
        return mp.tan(w * time) / w if w else time

    def half_period_sum(self, alpha: mp.mpf) -> mp.mpf:
        """G."""
        return sum(b * self._tan_over(w, alpha) for w, b in self.modes)

    @many_digits
    def energy(self, alpha: Number) -> mp.mpf:
        """h."""
        alpha = exact(alpha)
        return sum(b / mp.cos(w * alpha) ** 2 for w, b in self.modes) / (2 * self.half_period_sum(alpha) ** 2)

    @many_digits
    def tau_half(self, alpha: Number) -> mp.mpf:
        """Trace of the half map less 2: the factorised form."""
        alpha = exact(alpha)
        (w1, b1), (w2, b2) = self.modes
        one, two = b1 / (b1 + b2), b2 / (b1 + b2)
        (c1, s1), (c2, s2) = mp.cos_sin(w1 * alpha), mp.cos_sin(w2 * alpha)
        over = s1 / w1 if w1 else alpha
        return -2 + 4 * (two * w2 * c1 * over + one * s2 * c2) * (two * w1 * s1 * c2 + one * w2 * s2 * c1) / (w2 * c1 * c2)

    def fold_condition(self, alpha: mp.mpf) -> mp.mpf:
        """(2 G'^2 - G G'') cos(w2 alpha)^3: positive at alpha = 0, negative at the pole alpha = pi/(2 w2)."""
        first = sum(b / mp.cos(w * alpha) ** 2 for w, b in self.modes)
        second = sum(2 * b * w * mp.tan(w * alpha) / mp.cos(w * alpha) ** 2 for w, b in self.modes)
        return (2 * first**2 - self.half_period_sum(alpha) * second) * mp.cos(self.modes[1][0] * alpha) ** 3

    def breaking_condition(self, alpha: mp.mpf, kept: str = "origin") -> mp.mpf:
        """The factor whose zero breaks the symmetry, divided by w1 for "origin"."""
        (w1, b1), (w2, b2) = self.modes
        if kept == "origin":
            return b1 * mp.sin(2 * w2 * alpha) + b2 * w2 * (mp.sin(2 * w1 * alpha) / w1 if w1 else 2 * alpha)
        return b1 * w2 * mp.tan(w2 * alpha) + b2 * w1 * mp.tan(w1 * alpha)

    def _point(self, condition: Callable[[mp.mpf], mp.mpf], ends: tuple[mp.mpf, mp.mpf]) -> BackbonePoint:
        alpha = mp.findroot(condition, ends, solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 10), maxsteps=200)
        return BackbonePoint(alpha, self.energy(alpha))

    @many_digits
    def fold(self) -> BackbonePoint:
        """The least energy of S11O00-. It exists for all mu, sigma > 0.

        h is infinite at alpha = 0. At the pole, h = w2^2/(2 b2^2), dh/dalpha > 0 like the finite part b1^2 tan(pi w1/(2 w2))/w1 of G.
        """
        pole = mp.pi / (2 * self.modes[1][0])
        return self._point(self.fold_condition, (pole / 1000, pole * (1 - mp.mpf(10) ** -15)))

    @many_digits
    def symmetry_breaking(self, kept: str = "origin", order: int = 0) -> BackbonePoint:
        """A zero of a factor of tau_half + 2 on S13O00+, pi/(2 w2) < alpha < pi/(2 w1), admissible or not: the first, the second, ...

        Raises ValueError without one. For "origin" the factor is b2^2 w2 sin(pi w1/w2)/w1 > 0 at the lower end, and b1^2 sin(pi w2/w1) at
        the upper end: there is a zero while w2 < 2 w1. At w2 = 2 w1 one is at the upper end, where the impact vanishes.
        """
        (w1, _), (w2, _) = self.modes
        low, high = mp.pi / (2 * w2), mp.pi / (2 * w1) if w1 else mp.inf
        inside = mp.mpf(10) ** -20
        begin, high = low * (1 + inside), min(20 * low, high * (1 - inside))
        while begin < high:
            end = min(begin + low / 40, high)
            if self.breaking_condition(begin, kept) * self.breaking_condition(end, kept) < 0:
                if order == 0:
                    return self._point(lambda alpha: self.breaking_condition(alpha, kept), (begin, end))
                order -= 1
            begin = end
        raise ValueError("the symmetry does not break on this backbone")

    @many_digits
    def gap(self, alpha: Number, time: Number) -> tuple[mp.mpf, mp.mpf]:
        """u1 - u2 and its rate, at a time from the middle of a flight; the impact is at time = alpha, where the gap is 1."""
        alpha, time = exact(alpha), exact(time)
        g = self.half_period_sum(alpha)
        terms = [(w, b / (g * mp.cos(w * alpha))) for w, b in self.modes]
        return sum(a * (mp.sin(w * time) / w if w else time) for w, a in terms), sum(a * mp.cos(w * time) for w, a in terms)

    @many_digits
    def clearance(self, alpha: Number, samples: int = 2000) -> mp.mpf:
        """The least 1 - |u1 - u2| at a turning point inside the flight; infinite without one. Negative: inadmissible, as where G < 0."""
        alpha = exact(alpha)
        g = self.half_period_sum(alpha)
        if g <= 0:
            return -mp.inf
        times = np.linspace(0.0, float(alpha), samples + 1)
        first, second = (float(b / (g * mp.cos(w * alpha))) * np.cos(float(w) * times) for w, b in self.modes)
        rates = first + second
        found = [mp.inf]
        for i in np.flatnonzero(rates[:-1] * rates[1:] < 0):
            ends = mp.mpf(times[i]), mp.mpf(times[i + 1])
            time = mp.findroot(lambda t: self.gap(alpha, t)[1], ends, solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 10))
            found.append(1 - abs(self.gap(alpha, time)[0]))
        return min(found)

    @many_digits
    def touch(self, alpha: Number, time: Number) -> tuple[BackbonePoint, mp.mpf]:
        """The orbit near a guess whose flight touches a stop, and the time of the touch from the middle of the flight."""
        side = mp.sign(self.gap(alpha, time)[0])

        def conditions(alpha: mp.mpf, time: mp.mpf) -> list[mp.mpf]:
            gap, rate = self.gap(alpha, time)
            return [gap - side, rate]

        alpha, time = mp.findroot(conditions, (exact(alpha), exact(time)), tol=mp.mpf(10) ** (-2 * DIGITS + 16))
        return BackbonePoint(alpha, self.energy(alpha)), time


def internal_resonances(mu: Number | None = None, sigma: Number | None = None) -> list[mp.mpf]:
    """The two sigma at a given mu, or the two mu at a given sigma, with w2 = 2 w1: (sigma/mu + 1 + sigma)^2 = 25 sigma/(4 mu), ascending.

    There the symmetry breaking of S13O00+ ("origin") meets the linear mode w1: alpha = pi/(2 w1), h = w1^2/(2 b1^2), impact speed 0."""
    with mp.workdps(DIGITS):
        if sigma is None:  # a quadratic in sigma
            mu = exact(mu)
            return sorted(mp.polyroots([(1 + 1 / mu) ** 2, 2 * (1 + 1 / mu) - 25 / (4 * mu), 1]))
        sigma = exact(sigma)  # a quadratic in 1/mu
        return sorted(1 / x for x in mp.polyroots([sigma**2, 2 * sigma * (1 + sigma) - 25 * sigma / 4, (1 + sigma) ** 2]))


def double_breaking(alpha: Number, mu: Number, sigma: Number, released: str = "mu") -> tuple[mp.mpf, BackbonePoint]:
    """Near a guess: where both factors of tau_half + 2 vanish, and the half map is -1. The released parameter there, and the orbit.

    The curves of both kinds of symmetry breaking cross there."""

    def conditions(line: ReferenceBackbone, at: mp.mpf) -> list[mp.mpf]:
        return [line.breaking_condition(at, kept) for kept in ("origin", "stop")]

    return _of_two_conditions(alpha, mu, sigma, released, conditions)


def breaking_turn(alpha: Number, mu: Number, sigma: Number, released: str = "mu") -> tuple[mp.mpf, BackbonePoint]:
    """Near a guess: where two symmetry breakings ("origin") of a backbone coalesce. The released parameter there, and the orbit.

    The curve of symmetry breakings turns there."""

    def conditions(line: ReferenceBackbone, at: mp.mpf) -> list[mp.mpf]:
        (w1, b1), (w2, b2) = line.modes
        return [line.breaking_condition(at), b1 * mp.cos(2 * w2 * at) + b2 * mp.cos(2 * w1 * at)]

    return _of_two_conditions(alpha, mu, sigma, released, conditions)


@many_digits
def _of_two_conditions(alpha: Number, mu: Number, sigma: Number, released: str, conditions: Callable) -> tuple[mp.mpf, BackbonePoint]:
    given = {"mu": exact(mu), "sigma": exact(sigma)}
    alpha, value = mp.findroot(
        lambda alpha, value: conditions(ReferenceBackbone(**given | {released: value}), alpha),
        (exact(alpha), given[released]), tol=mp.mpf(10) ** (-2 * DIGITS + 16),
    )  # fmt: skip
    return value, BackbonePoint(alpha, ReferenceBackbone(**given | {released: value}).energy(alpha))


# The absorber of the scene `absorber`


class ClosestTurn(NamedTuple):
    """Where a flight turns closest to a stop.

    time: after the first impact (after the start, without impacts). clearance: 1 - |u1 - u2|, negative if the flight penetrates.
    rate: of the gap there, zero but for rounding. side: of the stop.
    """

    time: float
    clearance: float
    rate: float
    side: int


@dataclass(frozen=True)
class AbsorberOrbit:
    """A claimed periodic response of the absorber, checked by matrix exponentials.

    The state is (u1, u2, v1, v2). Of the load F cos(w t) two more states are made, so that a flight is one exponential of a (6, 6) matrix.

    Parameters
    ----------
    parameters : dict
        mu, sigma, lam, c, rho, F, w.
    states : (k, 4) float
        After each impact, or (1, 4) anywhere of a motion without impacts.
    times : (k,) float
        Of the impacts, with the maximum of the load at 0; ascending, within one period (or half period) of the orbit.
    sides : sequence of int
        +1 or -1: of the stop u1 - u2 = +-1. Empty without impacts.
    half : bool
        x(t + T/2) = -x(t): the impacts are those of half a period.
    load_periods : int
        Periods of the load in one of the orbit.
    """

    parameters: dict[str, float]
    states: np.ndarray
    times: np.ndarray
    sides: tuple[int, ...]
    half: bool = False
    load_periods: int = 1

    @classmethod
    def of(cls, problem: Any, y: np.ndarray) -> AbsorberOrbit:
        """The orbit that the unknowns y of a `bvp.forced.ForcedProblem` claim."""
        nodes = np.asarray(problem.nodes(y))[: max(1, len(problem.sequence))]
        sides = tuple(1 if letter == "+" else -1 for letter in problem.sequence)
        return cls(problem.parameters(y), nodes[:, :4], nodes[:, 4] * problem.period(y), sides, problem.half, problem.load_periods)

    @property
    def span(self) -> float:
        """The time over which the map is taken: T or T/2."""
        return 2.0 * np.pi * self.load_periods / self.parameters["w"] / (2.0 if self.half else 1.0)

    @property
    def duration(self) -> np.ndarray:
        """Flight times (k,): of each flight after an impact."""
        return np.diff(np.append(self.times, self.times[0] + self.span))

    @cached_property
    def rates(self) -> np.ndarray:
        """(6, 6): d/dt of (u1, u2, v1, v2, F cos(w t), F sin(w t))."""
        p = self.parameters
        out = np.zeros((6, 6))
        out[0, 2] = out[1, 3] = 1.0
        out[2, :4] = np.array([-p["sigma"], p["sigma"], -p["c"], p["c"]]) / p["mu"]
        out[3, :4] = p["sigma"], -1.0 - p["sigma"], p["c"], -p["lam"] - p["c"]
        out[3, 4], out[4, 5], out[5, 4] = 1.0, -p["w"], p["w"]
        return out

    def _begin(self, k: int) -> np.ndarray:
        angle = self.parameters["w"] * self.times[k]
        return np.concatenate([self.states[k], self.parameters["F"] * np.array([np.cos(angle), np.sin(angle)])])

    def _reset(self) -> np.ndarray:
        """(4, 4): momentum is kept, the relative velocity is multiplied by -rho."""
        mu, rho = self.parameters["mu"], self.parameters["rho"]
        reset, share = np.eye(4), (1.0 + rho) / (1.0 + mu)
        reset[2:, 2:] -= share * np.array([[1.0, -1.0], [-mu, mu]])
        return reset

    def _arrivals(self) -> list[tuple[np.ndarray, int, np.ndarray]]:
        """For each impact: (6,) the state in which the flight from the impact before it arrives, its side, and (4, 4) the flight."""
        found = []
        for k, time in enumerate(self.duration):
            flight = scipy.linalg.expm(self.rates * time)
            last = k == len(self.sides) - 1
            side = self.sides[(k + 1) % len(self.sides)] * (-1 if last and self.half else 1)
            found.append((flight @ self._begin(k), side, flight[:4, :4]))
        return found

    def residual(self) -> float:
        """The largest error of the claim: a flight that misses its stop or the next state, relative to the largest state."""
        sign = -1.0 if self.half else 1.0
        if not self.sides:
            end = (scipy.linalg.expm(self.rates * self.span) @ self._begin(0))[:4]
            return float(np.max(np.abs(sign * end - self.states[0])) / np.max(np.abs(self.states)))
        worst = 0.0
        for k, (arrival, side, _) in enumerate(self._arrivals()):
            last = k == len(self.sides) - 1
            next_state = sign * self.states[0] if last else self.states[k + 1]
            worst = max(worst, abs(arrival[0] - arrival[1] - side), float(np.max(np.abs(self._reset() @ arrival[:4] - next_state))))
        return worst / float(np.max(np.abs(self.states)))

    def impact_speeds(self) -> np.ndarray:
        """(k,) before each impact, into the stop, beginning with the second."""
        return np.array([side * (arrival[2] - arrival[3]) for arrival, side, _ in self._arrivals()]) if self.sides else np.array([])

    def monodromy(self) -> np.ndarray:
        """(4, 4): the derivative of the map from just after the first impact over T, or of minus the map over T/2 for a symmetric orbit."""
        product, sign = np.eye(4), -1.0 if self.half else 1.0
        if not self.sides:
            return sign * scipy.linalg.expm(self.rates * self.span)[:4, :4]
        reset, gap = self._reset(), np.array([1.0, -1.0, 0.0, 0.0])
        for arrival, _, flight in self._arrivals():
            after = np.concatenate([reset @ arrival[:4], arrival[4:]])
            coming, going = (self.rates @ arrival)[:4], (self.rates @ after)[:4]
            saltation = reset + np.outer(going - reset @ coming, gap) / (gap @ coming)
            product = saltation @ flight @ product
        return sign * product

    def multipliers(self) -> np.ndarray:
        """(4,), by falling modulus; of half the period for a symmetric orbit."""
        found = np.linalg.eigvals(self.monodromy())
        return found[np.argsort(-np.abs(found))]

    def distance(self, code: str) -> float:
        """How far the multipliers are from the condition of an event; 0 at the event.

        SN: from 1. PD, and SB over half a period: from -1. NS: of the modulus of a complex pair from 1; infinite without one.
        """
        found = self.multipliers()
        if code == "SN":
            return float(np.min(np.abs(found - 1.0)))
        if code in ("PD", "SB"):
            if self.half != (code == "SB"):
                raise ValueError(f"{code} is a condition of {'half a' if code == 'SB' else 'a whole'} period")
            return float(np.min(np.abs(found + 1.0)))
        if code == "NS":
            pairs = found[found.imag > 1e-12]
            return float(np.min(np.abs(np.abs(pairs) - 1.0), initial=np.inf))
        raise ValueError(f"code {code}: expected SN, PD, SB or NS")

    def at(self, time: float) -> tuple[float, float]:
        """The gap u1 - u2 and its rate, at a time after the first impact (the start, without impacts) within the span."""
        k = int(np.searchsorted(self.times - self.times[0], time, side="right")) - 1
        state = scipy.linalg.expm(self.rates * (time + self.times[0] - self.times[k])) @ self._begin(k)
        return float(state[0] - state[1]), float(state[2] - state[3])

    def closest_turn(self, samples: int = 1000) -> ClosestTurn:
        """The turning point inside a flight that is closest to a stop (or deepest in it): `samples` a flight, then Newton's method.

        The clearance is infinite if no flight turns."""
        best = ClosestTurn(float("nan"), float("inf"), float("nan"), 0)
        for k, time in enumerate(self.duration):
            step = scipy.linalg.expm(self.rates * time / samples)
            begin, states = self._begin(k), np.empty((samples + 1, 6))
            states[0] = begin
            for i in range(samples):
                states[i + 1] = step @ states[i]
            rate = states[:, 2] - states[:, 3]
            for i in map(int, np.flatnonzero((rate[:-1] * rate[1:] <= 0.0) & (rate[:-1] != 0.0))):
                at, state = i * time / samples, states[i]
                for _ in range(8):
                    change = self.rates @ state
                    at -= (state[2] - state[3]) / (change[2] - change[3])
                    state = scipy.linalg.expm(self.rates * at) @ begin
                gap, side = state[0] - state[1], 1 if state[0] > state[1] else -1
                turn = ClosestTurn(float(self.times[k] - self.times[0] + at), float(1.0 - abs(gap)), float(state[2] - state[3]), side)
                best = min(best, turn, key=lambda one: one.clearance)
        return best


# Algebraic problems


def cusp_fold(b: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The folds (x, a) of x^3 - b x - a = 0 at b > 0: x = +-sqrt(b/3), a = -2 x^3, so 27 a^2 = 4 b^3. The cusp is at a = b = x = 0."""
    x = float(np.sqrt(b / 3.0))
    return (x, -2.0 * x**3), (-x, 2.0 * x**3)


@dataclass(frozen=True)
class BogdanovTakens:
    """x' = y, y' = a + b x + x^2 + s x y: equilibria y = 0, a + b x + x^2 = 0, with trace s x and determinant -(b + 2 x).

    Fold: x = -b/2, a = b^2/4. Hopf: x = 0, a = 0 for b < 0, frequency sqrt(-b) (for b > 0 a neutral saddle). They meet at the
    Bogdanov-Takens point a = b = 0, where the Jacobian is a nilpotent block. Kuznetsov, Elements of Applied Bifurcation Theory, 8.4.
    """

    s: float = 1.0

    def field(self, x: np.ndarray, a: float, b: float) -> np.ndarray:
        """(2,)."""
        return np.array([x[1], a + b * x[0] + x[0] ** 2 + self.s * x[0] * x[1]])

    def jacobian(self, x: np.ndarray, a: float, b: float) -> np.ndarray:
        """(2, 2)."""
        return np.array([[0.0, 1.0], [b + 2.0 * x[0] + self.s * x[1], self.s * x[0]]])

    def fold(self, b: float) -> tuple[float, float]:
        """(x, a)."""
        return -b / 2.0, b * b / 4.0

    def hopf(self, b: float) -> tuple[float, float]:
        """(x, a), b < 0."""
        return 0.0, 0.0


@dataclass(frozen=True)
class ResonantMap:
    """(x, y) -> (x, y) + the field of `BogdanovTakens` at (x, y), with fixed points y = 0, a = -b x - x^2: exact curves and points.

    Trace 2 + s x, determinant 1 + s x - b - 2 x. At a fixed point x and with s not in (0, 1, 2):

        fold (multiplier 1):      x = -b/2
        PD (-1):                  x = (b - 4)/(2 (s - 1))
        NS (determinant 1):       x = b/(s - 2), while -4 < s x < 0, with multipliers exp(+-i theta), cos(theta) = 1 + s x/2

    On the NS curve 1:1 is at x = 0, 1:4 at -2/s, 1:3 at -3/s, 1:2 at -4/s; on the fold curve the fold-flip is at x = -2/s.
    """

    s: float = -1.0

    def image(self, x: np.ndarray, a: float, b: float) -> np.ndarray:
        """(2,)."""
        return x + BogdanovTakens(self.s).field(x, a, b)

    def jacobian(self, x: np.ndarray, a: float, b: float) -> np.ndarray:
        """(2, 2)."""
        return np.eye(2) + BogdanovTakens(self.s).jacobian(x, a, b)

    def point(self, code: str, b: float) -> tuple[float, float]:
        """(x, a) of the curve SN, PD or NS."""
        x = {"SN": -b / 2.0, "PD": (b - 4.0) / (2.0 * (self.s - 1.0)), "NS": b / (self.s - 2.0)}[code]
        return x, -b * x - x * x

    def codimension_two(self, kind: str) -> tuple[float, float, float]:
        """(x, a, b) of the points "1:1", "1:2", "1:3", "1:4" of the NS curve, or of the fold-flip "SN+PD"."""
        if kind == "SN+PD":
            x = -2.0 / self.s
            b = -2.0 * x
        else:
            x = {"1:1": 0.0, "1:4": -2.0, "1:3": -3.0, "1:2": -4.0}[kind] / self.s
            b = (self.s - 2.0) * x
        return x, -b * x - x * x, b
