"""Third derivatives of the multipoint problem by states, phases and times, equations (38) to (43): parameters stay.

With its loads a flight ends at exp(A t) xi, where A is constant. Along three directions t goes to t + t_a + t_b + t_c, and xi to
xi + xi_a + xi_b + xi_c + xi_ab + ... By Leibniz's rule the third derivative is

    exp(A t) [xi_abc + A (t_a xi_bc + t_b xi_ac + t_c xi_ab) + A^2 (t_a t_b xi_c + t_a t_c xi_b + t_b t_c xi_a) + A^3 t_a t_b t_c xi].

Of xi the states of the loads alone have more than first derivatives. Impacts and all other equations are linear, but for contact forces,
which depend on the phases of the loads, and for the equations to keep, whose derivatives are left out.
"""

from bvp.kernels.bent_orbit import bend_orbit
from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import inner
from bvp.kernels.multipoint import PERIODIC, STOP


@inlined
def _expand(b, i, y, directions, at, work):
    """work (4, s): what exp(A t) and its first three derivatives by t are applied to, for flight i, whose node begins at `at`."""
    size, width = 2 * b.stops.shape[1], b.gap.shape[1]
    phase = b.orbit.phase[i]
    a, d, c = directions[0], directions[1], directions[2]
    s_a, s_d, s_c = a[at + size], d[at + size], c[at + size]
    t_a, t_d, t_c = a[at + width], d[at + width], c[at + width]
    for r in range(work.shape[1]):
        if r < size:
            work[0, r] = 0.0
            work[1, r] = 0.0
            work[2, r] = t_a * t_d * c[at + r] + t_a * t_c * d[at + r] + t_d * t_c * a[at + r]
            work[3, r] = t_a * t_d * t_c * y[at + r]
        else:
            work[0, r] = phase[3, r] * s_a * s_d * s_c
            work[1, r] = phase[2, r] * (t_a * s_d * s_c + t_d * s_a * s_c + t_c * s_a * s_d)
            work[2, r] = phase[1, r] * (t_a * t_d * s_c + t_a * t_c * s_d + t_d * t_c * s_a)
            work[3, r] = phase[0, r] * t_a * t_d * t_c


@inlined
def _end_rows(b, out, work):
    """The conditions of a start, which are linear, and of an end, in place of the state at the end in out. work (4, s): scratch."""
    n, k = b.stops.shape[1], b.shape[0]
    for e in range(n):
        stop = e == 0 and b.shape[4] == STOP
        work[0, e] = 0.0
        for r in range(n if stop else 2 * n):
            work[0, e] += (b.gap[k, r] if stop else b.end_map[n + e, r]) * out[r]
    for e in range(n):
        out[e] = 0.0
        out[n + e] = work[0, e]


@kernel
def third_of_states(b, y, directions, work, out):
    """out (u - 1,) = F'''(y)[a, b, c] for three directions (3, u), real or complex, whose parameters are not looked at. work (4, s), as
    out: scratch."""
    width, k = b.gap.shape[1], b.shape[0]
    n = b.stops.shape[1]
    size = work.shape[1]
    bend_orbit(b, y)
    orbit = b.orbit
    for r in range(out.shape[0]):
        out[r] = 0.0
    for i in range(k + 1):
        at = i * (width + 1)
        _expand(b, i, y, directions, at, work)
        for r in range(2 * n):
            for c in range(size):
                out[at + r] += orbit.flow[i, 0, r, c] * work[0, c]
                for order in range(3):
                    out[at + r] += orbit.turn[i, order, r, c] * work[1 + order, c]
        if b.contact[i, 0] >= 0:
            for e in range(n):
                # The velocity across the stop, of the state before the impact.
                work[0, e] = out[at + n + e]
            for r in range(n):
                for e in range(n):
                    out[at + n + r] -= orbit.push[i, 0, r] * b.gap[i, e] * work[0, e]
        if i == k and b.shape[3] != PERIODIC:
            _end_rows(b, out[at:], work)
        if i < k and b.release[i] >= 0:
            after = at + width + 1 + 2 * n
            bend = inner(orbit.force[i, 0, 2 * n : size], orbit.phase[i + 1, 3, 2 * n : size])
            out[at + width] = directions[0, after] * directions[1, after] * directions[2, after] * bend
