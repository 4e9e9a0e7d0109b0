"""An orthogonal sweep round the cycle of a product pencil.

Periodic QR without shifts (Fairgrieve & Jepson, SIAM J. Numer. Anal. 28 (1991) 1446; Lust, Int. J. Bifurcation Chaos 11 (2001) 2389): every
factor is kept triangular, so that small multipliers survive beside large ones.
"""

import math

from bvp.kernels.arrays import set_2
from bvp.kernels.compiled import inlined, part


@part
def _rotation(a, b):
    """c, s with c a + s b = r, -s a + c b = 0."""
    if b == 0.0:
        return 1.0, 0.0
    r = math.hypot(a, b)
    return a / r, b / r


@inlined
def sweep(left, right, height, width, square, turns, scratch, frame, product, exponent):
    """One orthogonal sweep round the cycle, which runs through the given factors `turns` times. scratch (4, N, N).

    frame (d_0, w): orthonormal columns at node 0, replaced by those that node P is reached with. height[i], width[i] = (m_i, d_{i+1});
    not looked at where they are all w and `square` says so.
    product (w, w): upper triangular product of the factors U_i^-1 T_i, scaled by 2^-exponent[j] in row j. Returns the number of
    singular factors met (grazing impacts)."""
    w = frame.shape[1]
    nodes = left.shape[0]
    singular = 0
    scaled = False
    top = scratch[0]
    e = scratch[1]
    y = scratch[2]
    current = scratch[3]
    set_2(product, 0.0)
    for c in range(w):
        product[c, c] = 1.0
        exponent[c] = 0.0
    here = w if square else frame.shape[0]
    for r in range(here):
        for c in range(w):
            current[r, c] = frame[r, c]
    for count in range(turns * nodes):
        i = count % nodes
        m = w if square else height[i]
        d = w if square else width[i]
        for a in range(m):
            for c in range(w):
                total = 0.0
                for r in range(here):
                    total += right[i, a, r] * current[r, c]
                top[a, c] = total
            for b in range(d):
                e[a, b] = left[i, a, b]
        for c in range(w):
            for r in range(m - 1, c, -1):
                if top[r, c] == 0.0:
                    continue
                cs, sn = _rotation(top[r - 1, c], top[r, c])
                for b in range(c, w):
                    p = top[r - 1, b]
                    q = top[r, b]
                    top[r - 1, b] = cs * p + sn * q
                    top[r, b] = cs * q - sn * p
                for b in range(d):
                    p = e[r - 1, b]
                    q = e[r, b]
                    e[r - 1, b] = cs * p + sn * q
                    e[r, b] = cs * q - sn * p
        for a in range(d):
            for b in range(d):
                y[a, b] = 1.0 if a == b else 0.0
        for r in range(d - 1, -1, -1):
            for c in range(r):
                if e[r, c] == 0.0:
                    continue
                cs, sn = _rotation(e[r, r], e[r, c])
                for a in range(m):
                    p = e[a, r]
                    q = e[a, c]
                    e[a, r] = cs * p + sn * q
                    e[a, c] = cs * q - sn * p
                for a in range(d):
                    p = y[a, r]
                    q = y[a, c]
                    y[a, r] = cs * p + sn * q
                    y[a, c] = cs * q - sn * p
        for a in range(d):
            for c in range(w):
                current[a, c] = y[a, c]
        here = d
        for c in range(w):
            for b in range(c, w):
                total = 0.0
                for a in range(c, b + 1):
                    total += top[c, a] * product[a, b] * (2.0 ** (exponent[a] - exponent[c]) if scaled else 1.0)
                product[c, b] = total
        for c in range(w - 1, -1, -1):
            if e[c, c] == 0.0:
                singular += 1
                continue
            for b in range(c, w):
                total = product[c, b]
                for a in range(c + 1, b + 1):
                    total -= e[c, a] * product[a, b] * (2.0 ** (exponent[a] - exponent[c]) if scaled else 1.0)
                product[c, b] = total / e[c, c]
            largest = 0.0
            for b in range(c, w):
                largest = max(largest, abs(product[c, b]))
            if largest > 1e100 or (0.0 < largest < 1e-100):
                shift = math.floor(math.log2(largest))
                exponent[c] += shift
                scaled = True
                for b in range(c, w):
                    product[c, b] *= 2.0**-shift
    for r in range(here):
        for c in range(w):
            frame[r, c] = current[r, c]
    return singular
