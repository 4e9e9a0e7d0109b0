"""The largest absolute value of a functional of two oscillating modes over a flight, by the bounds that find impacts."""

from bvp.kernels.compiled import kernel
from bvp.kernels.two_modes import turned

__all__ = ["raised"]


@kernel
def climb(m1, w1, m2, w2, a1, b1, a2, b2, third, fourth, p1, q1, p2, q2, length, peak):
    """The larger of `peak` and of |f| over a stretch from the given state, f = a1 p1 + b1 q1 + a2 p2 + b2 q2, |f'''| <= third,
    |f''''| <= fourth."""
    t = 0.0
    size = length
    for _ in range(10000):
        size = min(size, length - t)
        f0 = a1 * p1 + b1 * q1 + a2 * p2 + b2 * q2
        g0 = a1 * (m1 * p1 + w1 * q1) + b1 * (m1 * q1 - w1 * p1) + a2 * (m2 * p2 + w2 * q2) + b2 * (m2 * q2 - w2 * p2)
        c1, s1 = turned(m1, w1, size)
        c2, s2 = turned(m2, w2, size)
        r1 = p1 * c1 + q1 * s1
        i1 = q1 * c1 - p1 * s1
        r2 = p2 * c2 + q2 * s2
        i2 = q2 * c2 - p2 * s2
        f1 = a1 * r1 + b1 * i1 + a2 * r2 + b2 * i2
        g1 = a1 * (m1 * r1 + w1 * i1) + b1 * (m1 * i1 - w1 * r1) + a2 * (m2 * r2 + w2 * i2) + b2 * (m2 * i2 - w2 * r2)
        hull = max(max(abs(f0), abs(f0 + size * g0 / 3.0)), max(abs(f1 - size * g1 / 3.0), abs(f1)))
        hull += fourth * size * size * size * size / 384.0
        done = hull <= peak * (1.0 + 1e-14)
        if not done:
            least = third * size * size / 8.0
            if g0 * g1 > 0.0 and min(abs(g0), abs(g1)) > least:
                done = True
            elif hull - max(abs(f0), abs(f1)) <= 1e-15 * hull or size <= 1e-9 * length:
                done = True
            if done:
                peak = max(peak, max(abs(f0), abs(f1)))
        if done:
            p1, q1, p2, q2 = r1, i1, r2, i2
            t += size
            if t >= length:
                break
            size *= 2.0
            continue
        if g0 * g1 < 0.0:
            # Newton for the turning point; the halved stretches only confirm it.
            s = size * g0 / (g0 - g1)
            for _ in range(8):
                c1, s1 = turned(m1, w1, s)
                c2, s2 = turned(m2, w2, s)
                r1 = p1 * c1 + q1 * s1
                i1 = q1 * c1 - p1 * s1
                r2 = p2 * c2 + q2 * s2
                i2 = q2 * c2 - p2 * s2
                x1 = m1 * r1 + w1 * i1
                y1 = m1 * i1 - w1 * r1
                x2 = m2 * r2 + w2 * i2
                y2 = m2 * i2 - w2 * r2
                g = a1 * x1 + b1 * y1 + a2 * x2 + b2 * y2
                bend = a1 * (m1 * x1 + w1 * y1) + b1 * (m1 * y1 - w1 * x1) + a2 * (m2 * x2 + w2 * y2) + b2 * (m2 * y2 - w2 * x2)
                change = g / bend if bend != 0.0 else 0.0
                s -= change
                if not 0.0 <= s <= size or abs(change) <= 1e-9 * size:
                    break
            peak = max(peak, abs(a1 * r1 + b1 * i1 + a2 * r2 + b2 * i2))
        size *= 0.5
    return peak


@kernel
def raised(m1, w1, m2, w2, a1, b1, a2, b2, third, fourth, p1, q1, p2, q2, n1, j1, n2, j2, length, h, peak):
    """The larger of `peak` and of |f| over a step of h, of which `length` counts, between two known states."""
    f0 = a1 * p1 + b1 * q1 + a2 * p2 + b2 * q2
    g0 = a1 * (m1 * p1 + w1 * q1) + b1 * (m1 * q1 - w1 * p1) + a2 * (m2 * p2 + w2 * q2) + b2 * (m2 * q2 - w2 * p2)
    f1 = a1 * n1 + b1 * j1 + a2 * n2 + b2 * j2
    g1 = a1 * (m1 * n1 + w1 * j1) + b1 * (m1 * j1 - w1 * n1) + a2 * (m2 * n2 + w2 * j2) + b2 * (m2 * j2 - w2 * n2)
    hull = max(max(abs(f0), abs(f0 + h * g0 * (1.0 / 3.0))), max(abs(f1 - h * g1 * (1.0 / 3.0)), abs(f1)))
    hull += fourth * h * h * h * h * (1.0 / 384.0)
    if hull <= peak:
        return peak
    if length == h and g0 * g1 > 0.0 and min(abs(g0), abs(g1)) > third * h * h * 0.125:
        return max(peak, max(abs(f0), abs(f1)))
    return climb(m1, w1, m2, w2, a1, b1, a2, b2, third, fourth, p1, q1, p2, q2, length, peak)
