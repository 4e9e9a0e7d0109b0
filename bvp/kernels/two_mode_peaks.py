"""The largest absolute value of a functional of two oscillating modes over a flight, by the bounds that find impacts."""

from bvp.kernels.compiled import kernel, part
from bvp.kernels.two_modes import turned

__all__ = ["raised"]


@part
def derivatives(m1, w1, m2, w2, a1, b1, a2, b2, p1, q1, p2, q2):
    """f, f' and f'' of f = a1 p1 + b1 q1 + a2 p2 + b2 q2."""
    x1 = m1 * p1 + w1 * q1
    y1 = m1 * q1 - w1 * p1
    x2 = m2 * p2 + w2 * q2
    y2 = m2 * q2 - w2 * p2
    f = a1 * p1 + b1 * q1 + a2 * p2 + b2 * q2
    slope = a1 * x1 + b1 * y1 + a2 * x2 + b2 * y2
    bend = a1 * (m1 * x1 + w1 * y1) + b1 * (m1 * y1 - w1 * x1) + a2 * (m2 * x2 + w2 * y2) + b2 * (m2 * y2 - w2 * x2)
    return f, slope, bend


@kernel
def climb(m1, w1, m2, w2, a1, b1, a2, b2, third, fourth, p1, q1, p2, q2, length, peak):
    """The larger of `peak` and of |f| over a stretch from the given state, f = a1 p1 + b1 q1 + a2 p2 + b2 q2, |f'''| <= third,
    |f''''| <= fourth: by parts on which f' keeps its sign, or f'' does and f' has one zero, or f stays below."""
    t = 0.0
    size = length
    f0, g0, h0 = derivatives(m1, w1, m2, w2, a1, b1, a2, b2, p1, q1, p2, q2)
    for _ in range(10000):
        size = min(size, length - t)
        c1, s1 = turned(m1, w1, size)
        c2, s2 = turned(m2, w2, size)
        r1 = p1 * c1 + q1 * s1
        i1 = q1 * c1 - p1 * s1
        r2 = p2 * c2 + q2 * s2
        i2 = q2 * c2 - p2 * s2
        f1, g1, h1 = derivatives(m1, w1, m2, w2, a1, b1, a2, b2, r1, i1, r2, i2)
        ends = max(abs(f0), abs(f1))
        hull = max(ends, max(abs(f0 + size * g0 / 3.0), abs(f1 - size * g1 / 3.0))) + fourth * size * size * size * size / 384.0
        square = size * size / 8.0
        convex = h0 * h1 > 0.0 and min(abs(h0), abs(h1)) > fourth * square
        if hull > peak:
            if convex and g0 * g1 < 0.0:
                # Newton for the one turning point, kept between the ends.
                s = size * g0 / (g0 - g1)
                low = 0.0
                high = size
                for _ in range(50):
                    c1, s1 = turned(m1, w1, s)
                    c2, s2 = turned(m2, w2, s)
                    f, g, h = derivatives(
                        m1, w1, m2, w2, a1, b1, a2, b2, p1 * c1 + q1 * s1, q1 * c1 - p1 * s1, p2 * c2 + q2 * s2, q2 * c2 - p2 * s2
                    )
                    ends = max(ends, abs(f))
                    if g * g0 > 0.0:
                        low = s
                    else:
                        high = s
                    better = s - g / h if h != 0.0 else 0.5 * (low + high)
                    if not low <= better <= high:
                        better = 0.5 * (low + high)
                    if abs(h) * (better - s) * (better - s) <= 1e-15 * abs(f):
                        break
                    s = better
            elif not (
                (convex or min(abs(g0), abs(g1)) > third * square) and g0 * g1 >= 0.0
                or hull - ends <= 1e-15 * hull or size <= 1e-9 * length
            ):  # fmt: skip
                size *= 0.5
                continue
            peak = max(peak, ends)
        p1, q1, p2, q2 = r1, i1, r2, i2
        f0, g0, h0 = f1, g1, h1
        t += size
        if t >= length:
            break
        size *= 2.0
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
