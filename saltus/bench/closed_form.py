"""Closed forms of the two backbones in forty digits, and their stability: they share nothing with the rest of the program.

One impact a half period, mode by mode: G = sum b_k^2 tan(w_k alpha)/w_k, h = sum b_k^2 sec^2(w_k alpha) / (2 G^2). The half-period
map composed with u -> -u is one exact flight over 2 alpha and one saltation; its trace less 2, for the two trivial multipliers
1, is tau_half.
"""

import mpmath as mp

DIGITS = 40


class Backbone:
    """The orbits with one impact a half period of the linear oscillator with a vibro-impact energy sink; alpha is T/4."""

    def __init__(self, mu=0.1, sigma=0.1, ground=None):
        with mp.workdps(DIGITS):
            mu, sigma = mp.mpf(mu), mp.mpf(sigma)
            first, mixed, last = sigma / mu, -sigma / mp.sqrt(mu), 1 + sigma if ground is None else mp.mpf(ground)
            middle, root = (first + last) / 2, mp.sqrt(((first - last) / 2) ** 2 + mixed**2)
            self.modes = []
            for square in (middle - root, middle + root):
                shape = mp.matrix([mixed, square - first])
                shape /= mp.norm(shape)
                absorber, primary = shape[0] / mp.sqrt(mu), shape[1]
                self.modes.append((mp.sqrt(square), (absorber, primary), absorber - primary))

    @classmethod
    def of(cls, system):
        """The same of a system whose stiffness 1 + sigma is the number in double precision that it has."""
        return cls(float(system.mass[0, 0]), float(system.stiffness[0, 0]), float(system.stiffness[1, 1]))

    def half_period_sum(self, alpha):
        """G(alpha)."""
        return sum(b * b * mp.tan(w * alpha) / w for w, _, b in self.modes)

    def energy(self, alpha):
        """h(alpha)."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            return sum((b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes) / (2 * self.half_period_sum(alpha) ** 2)

    def velocities(self, alpha):
        """Velocities (u1', u2') at zero displacement, a quarter period before an impact on the upper side."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            g = self.half_period_sum(alpha)
            return [sum(shape[i] * b / (g * mp.cos(w * alpha)) for w, shape, b in self.modes) for i in (0, 1)]

    def impact_speed(self, alpha):
        """Speed of the relative motion at the impact, sum b_k^2 / G."""
        with mp.workdps(DIGITS):
            return sum(b * b for _, _, b in self.modes) / self.half_period_sum(mp.mpf(alpha))

    def tau_half(self, alpha):
        """Trace of the reduced half-period map composed with u -> -u."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            g = self.half_period_sum(alpha)
            total = sum(b * b for _, _, b in self.modes)
            q = [b * mp.tan(w * alpha) / (w * g) for w, _, b in self.modes]
            p = [b / g for _, _, b in self.modes]
            speed = sum(mode[2] * velocity for mode, velocity in zip(self.modes, p, strict=True))
            after = [velocity - 2 * mode[2] * speed / total for mode, velocity in zip(self.modes, p, strict=True)]
            force = [-(mode[0] ** 2) * x for mode, x in zip(self.modes, q, strict=True)]
            jump, flight = mp.eye(4), mp.zeros(4)
            for i in (0, 1):
                for j in (0, 1):
                    jump[2 + i, 2 + j] -= 2 * self.modes[i][2] * self.modes[j][2] / total
                w = self.modes[i][0]
                c, s = mp.cos(2 * w * alpha), mp.sin(2 * w * alpha)
                flight[i, i], flight[i, i + 2], flight[i + 2, i], flight[i + 2, i + 2] = c, s / w, -w * s, c
            row = mp.matrix([[self.modes[0][2], self.modes[1][2], 0, 0]])
            coming, going = mp.matrix(p + force), mp.matrix(after + force)
            saltation = jump + (going - jump * coming) * row / speed
            turned = -saltation * flight
            return sum(turned[i, i] for i in range(4)) - 2

    def stable(self, alpha, apart=0.0):
        """True or false where |tau_half| < 2 is so at alpha and at relative distances `apart` on both sides; else None."""
        answers = set()
        for side in (-1, 0, 1) if apart else (0,):
            tau_half = self.tau_half(mp.mpf(alpha) * (1 + side * mp.mpf(apart)))
            answers.add(abs(tau_half) < 2)
            answers.add(abs(tau_half) < 2 if abs(tau_half) > apart else None)
        return answers.pop() if len(answers) == 1 else None

    def where_tau_half_is(self, value, low, high):
        """alpha and h between low and high where tau_half has a value."""
        alpha, h = self.root(lambda x: self.tau_half(x) - value, low, high)
        return float(alpha), float(h)

    def fold(self, low, high):
        """alpha and h between low and high where h has an extremum, in all digits: with G' = sum b^2 sec^2, h = G'/(2 G^2) and h' = 0 is
        G G'' = 2 G'^2."""

        def slope(alpha):
            first = sum((b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes)
            second = sum(2 * w * mp.tan(w * alpha) * (b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes)
            return self.half_period_sum(alpha) * second - 2 * first**2

        return self.root(slope, low, high)

    def symmetry_breaking(self, low, high):
        """alpha and h between low and high where tau_half is -2, in all digits."""
        return self.root(lambda x: self.tau_half(x) + 2, low, high)

    def root(self, function, low, high):
        """alpha and h between low and high where a function of alpha is zero, in all digits."""
        with mp.workdps(DIGITS + 10):
            alpha = mp.findroot(function, (mp.mpf(low), mp.mpf(high)), solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 10))
            return alpha, self.energy(alpha)
