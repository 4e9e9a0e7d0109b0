"""Steps of flights by Gauss collocation, for smooth forces of which only values and first derivatives are known.

The polynomials of degree S whose derivatives are right at S Gauss points of a step (Hairer, Lubich and Wanner, Geometric Numerical
Integration, 2nd ed. 2006, II.1.2): their ends have the order 2 S, and the map is symplectic. The accelerations at the points are solved
for by Newton's method. The derivatives of the step obey its linearised equations. A step is confirmed, and the next length chosen, by the
defect at its ends and between the points: the difference of the polynomial's acceleration from that of the forces along it.

The step is a polynomial as a Taylor step is, so all that follows a path is the same.
"""

import math

from numpy import int64

from bvp.kernels.compiled import inlined, kernel, write_four
from bvp.kernels.jets import call_forces
from bvp.kernels.linear import factorise
from bvp.kernels.sources import ORDER, column_source, expand_sources, plus_source_now, source_terms, sources_at
from bvp.kernels.taylor import DEFECT, ROUNDING

EXTRAPOLATED = 10
"""Legendre coefficients of the step before that begin Newton's method: higher ones grow too fast outside."""

FIRST = 4.0
"""Length of the first step, in units of the time in which the motion turns by one radian."""

ITERATIONS = 24

RESOLVED = 1e-9
"""Largest last Legendre coefficient of the derivatives' accelerations, as a part. The error at the end of a step is its square."""

SMALLEST = 1e-13
"""Part of what is left of a flight below which a step is too short."""


def collocated(flight):
    """A flight of `bvp.kernels.taylor.make_smooth_flight` whose program calls a Python function, with steps by collocation."""
    return flight._replace(stages=flight.stages._replace(address=collocate.entry(flight, 0.0, 1.0, True).address))


@kernel
def solve_dense(matrix, pivots, right, count):
    """Replace the first `count` columns of `right` by solutions, with the factors of `factorise`."""
    size = matrix.shape[0]
    for k in range(size):
        pivot = pivots[k]
        if pivot != k:
            for c in range(count):
                x = right[k, c]
                right[k, c] = right[pivot, c]
                right[pivot, c] = x
    for r in range(size):
        for k in range(r):
            factor = matrix[r, k]
            for c in range(count):
                right[r, c] -= factor * right[k, c]
    for r in range(size - 1, -1, -1):
        for k in range(r + 1, size):
            factor = matrix[r, k]
            for c in range(count):
                right[r, c] -= factor * right[k, c]
        for c in range(count):
            right[r, c] /= matrix[r, r]


@inlined
def _place(flight, h):
    """The states at the points, from the accelerations there."""
    stages, begin = flight.stages, flight.states[0]
    n = stages.rates.shape[1]
    for i in range(stages.points.shape[0]):
        for r in range(n):
            once = 0.0
            twice = 0.0
            for j in range(stages.points.shape[0]):
                once += stages.integrals[i, j] * stages.rates[j, r]
                twice += stages.double[i, j] * stages.rates[j, r]
            stages.states[i, n + r] = begin[n + r] + h * once
            stages.states[i, r] = begin[r] + h * (stages.points[i] * begin[n + r] + h * twice)


@inlined
def _put_inputs(flight, z, i):
    """The inputs of the forces at a state, in column i."""
    values = flight.program.called.values
    for k in range(flight.rows.shape[0]):
        total = 0.0
        for r in range(z.shape[0]):
            total += flight.rows[k, r] * z[r]
        values[k, i] = total


@inlined
def _acceleration(flight, z, i, r):
    """That of coordinate r at a state, with the forces in column i and the sources that were computed last."""
    n = z.shape[0] // 2
    total = 0.0
    for c in range(2 * n):
        total += flight.matrix[n + r, c] * z[c]
    for f in range(flight.push.shape[1]):
        total += flight.push[r, f] * flight.program.called.values[flight.program.forces[f], i]
    return plus_source_now(flight.sources, total, r)


@inlined
def _by_state(flight, i, r, c):
    """The derivative of the acceleration of coordinate r by entry c of the state, at point i."""
    n = flight.stages.rates.shape[1]
    inputs = flight.rows.shape[0]
    total = flight.matrix[n + r, c]
    for d in range(flight.program.slopes.shape[0]):
        slope = flight.stages.forces[flight.program.slopes[d, 2] - inputs, i]
        total += flight.push[r, flight.program.slopes[d, 0]] * slope * flight.rows[flight.program.slopes[d, 1], c]
    return total


@kernel
def _evaluate(flight, at, h):
    """The residuals of the accelerations at the points, in stages.right. Returns whether they are finite."""
    stages = flight.stages
    count, n = stages.rates.shape
    _place(flight, h)
    for i in range(count):
        _put_inputs(flight, stages.states[i], i)
    call_forces(flight.program.called, count)
    inputs = flight.rows.shape[0]
    for k in range(stages.forces.shape[0]):
        for i in range(count):
            stages.forces[k, i] = flight.program.called.values[inputs + k, i]
    is_finite = True
    for i in range(count):
        sources_at(flight.sources, at + h * stages.points[i])
        for r in range(n):
            residual = _acceleration(flight, stages.states[i], i, r) - stages.rates[i, r]
            stages.right[i * n + r, 0] = residual
            is_finite = is_finite and abs(residual) < math.inf
    return is_finite


@kernel
def _linearise(flight, h):
    """The factors of the derivative of the residuals by the accelerations, without sign. Returns whether it is regular."""
    stages = flight.stages
    count, n = stages.rates.shape
    for j in range(count):
        for r in range(n):
            for c in range(n):
                by_place = h * h * _by_state(flight, j, r, c)
                by_speed = h * _by_state(flight, j, r, n + c)
                # The acceleration at point j depends on all others through the state there.
                for i in range(count):
                    stages.matrix[j * n + r, i * n + c] = -by_place * stages.double[j, i] - by_speed * stages.integrals[j, i]
            stages.matrix[j * n + r, j * n + r] += 1.0
    return factorise(stages.matrix, stages.pivots) > 0.0


@kernel
def _guess(flight, h):
    """Accelerations to begin with: those of the step before go on."""
    stages = flight.stages
    count, n = stages.rates.shape
    for i in range(count):
        x = 1.0 + 2.0 * stages.points[i] * h / stages.length[2]
        for r in range(n):
            stages.rates[i, r] = stages.before[0, r]
        before = 1.0
        here = x
        for k in range(1, min(EXTRAPOLATED, count)):
            for r in range(n):
                stages.rates[i, r] += stages.before[k, r] * here
            after = ((2 * k + 1) * x * here - k * before) / (k + 1)
            before = here
            here = after


@kernel
def _solve_step(flight, at, h):
    """The accelerations at the points of a step, by Newton's method; whether it converges."""
    stages = flight.stages
    count, n = stages.rates.shape
    last = math.inf
    known = False
    for _ in range(ITERATIONS):
        if not _evaluate(flight, at, h):
            return False
        if not known and not _linearise(flight, h):
            return False
        solve_dense(stages.matrix, stages.pivots, stages.right, int64(1))
        change = 0.0
        size = 0.0
        for i in range(count):
            for r in range(n):
                stages.rates[i, r] += stages.right[i * n + r, 0]
                change = max(change, abs(stages.right[i * n + r, 0]))
                size = max(size, abs(stages.rates[i, r]))
        if not size < math.inf:
            return False
        if change <= 2e-16 * size or (change <= 1e-12 * size and change >= 0.25 * last):
            _place(flight, h)
            return True
        # Once the accelerations are near, those of the factors are as good.
        known = change <= 1e-3 * size and change <= 0.1 * last
        last = change
    return False


@kernel
def _worst_defect(flight, at, h):
    """The largest defect at the other points of a step, and the largest speed in it. What rounding changes is left out, as it is no error
    of the step: that of the state, in the forces, and that of the accelerations, in the polynomial through them."""
    stages, begin = flight.stages, flight.states[0]
    count, n = stages.rates.shape
    size = 2 * n
    called, slopes = flight.program.called, flight.program.slopes
    # The states there are kept in the rows of the polynomial, which is written later.
    for d in range(stages.others.shape[0]):
        other = flight.states[1 + d]
        for r in range(n):
            once = 0.0
            twice = 0.0
            for j in range(count):
                once += stages.areas[d, j] * stages.rates[j, r]
                twice += stages.areas[d, j] * stages.states[j, n + r]
            other[n + r] = begin[n + r] + h * once
            other[r] = begin[r] + h * twice
        _put_inputs(flight, other, d)
    call_forces(called, stages.others.shape[0])
    worst = 0.0
    speed = 0.0
    for i in range(count):
        for r in range(n):
            speed = max(speed, abs(stages.states[i, n + r]))
    for d in range(stages.others.shape[0]):
        other = flight.states[1 + d]
        sources_at(flight.sources, at + h * stages.others[d])
        for r in range(n):
            defect = -_acceleration(flight, other, d, r)
            rounding = 0.0
            for j in range(count):
                defect += stages.values[d, j] * stages.rates[j, r]
                rounding += abs(stages.values[d, j] * stages.rates[j, r])
            for c in range(size):
                rounding += abs(flight.matrix[n + r, c] * other[c])
            defect = abs(defect) - ROUNDING * rounding
            for k in range(slopes.shape[0]):
                rounding = 0.0
                for c in range(size):
                    rounding += abs(flight.rows[slopes[k, 1], c] * other[c])
                defect -= 2.0 * ROUNDING * rounding * abs(called.values[slopes[k, 2], d] * flight.push[r, slopes[k, 0]])
            if not defect <= worst:
                worst = defect
    return worst, speed


@kernel
def _carry_columns(flight, at, h):
    """The accelerations of the columns at the points, in stages.right, from the linearised equations; their places and rates in
    stages.moved. Returns the largest last Legendre coefficient, as a part."""
    stages, sources = flight.stages, flight.sources
    count, n = stages.rates.shape
    columns = stages.right.shape[1]
    inputs = flight.rows.shape[0]
    right, moved, terms = stages.right, stages.moved, stages.terms
    for r in range(2 * n):
        flight.slope[r] = flight.states[0, r]
    for i in range(count):
        for k in range(stages.forces.shape[0]):
            flight.jets[inputs + k, 0] = stages.forces[k, i]
        for r in range(2 * n):
            flight.states[0, r] = stages.states[i, r]
        expand_sources(sources, at + h * stages.points[i])
        source_terms(sources, flight, at + h * stages.points[i])
        for r in range(n):
            for block in range(flight.columns.shape[0]):
                write_four(terms[i, r, 4 * block : 4 * block + 4], column_source(sources, block, 0, r))
            for c in range(columns):
                begin = flight.columns[c // 4, 0]
                moved[i, n + r, c] = begin[n + r, c % 4]
                moved[i, r, c] = begin[r, c % 4] + h * stages.points[i] * begin[n + r, c % 4]
    for r in range(2 * n):
        flight.states[0, r] = flight.slope[r]
    for i in range(count):
        for r in range(n):
            for c in range(columns):
                right[i * n + r, c] = terms[i, r, c]
            for s in range(2 * n):
                factor = _by_state(flight, i, r, s)
                for c in range(columns):
                    right[i * n + r, c] += factor * moved[i, s, c]
    if not _linearise(flight, h):
        return math.inf
    solve_dense(stages.matrix, stages.pivots, right, columns)
    for i in range(count):
        for j in range(count):
            once = h * stages.integrals[i, j]
            twice = h * h * stages.double[i, j]
            for r in range(n):
                for c in range(columns):
                    moved[i, n + r, c] += once * right[j * n + r, c]
                    moved[i, r, c] += twice * right[j * n + r, c]
    worst = 0.0
    for c in range(columns):
        largest = 0.0
        last = 0.0
        for r in range(n):
            tail = 0.0
            for i in range(count):
                largest = max(largest, abs(moved[i, n + r, c]), abs(h * right[i * n + r, c]))
                tail += stages.legendre[count - 1, i] * right[i * n + r, c]
            last = max(last, abs(h * tail))
        if not last <= worst * largest:
            worst = last / largest
    return worst


@inlined
def _shift(stages, sums, h, k):
    """The coefficient of order k + 1 of an integral, from the Legendre coefficients of its integrand."""
    total = 0.0
    for j in range(k, stages.points.shape[0]):
        total += stages.powers[j, k] * sums[j]
    return total / ((k + 1) * h**k)


@kernel
def _write_polynomials(flight, h, with_columns):
    """The polynomials of the step in powers of the time from its begin."""
    stages, states, columns = flight.stages, flight.states, flight.columns
    count, n = stages.rates.shape
    sums = flight.projected[0]
    for k in range(1, ORDER + 1):
        for r in range(2 * n):
            states[k, r] = 0.0
            if with_columns:
                for block in range(columns.shape[0]):
                    for e in range(4):
                        columns[block, k, r, e] = 0.0
    for r in range(2 * n):
        for j in range(count):
            sums[j] = 0.0
            for i in range(count):
                sums[j] += stages.legendre[j, i] * (stages.states[i, n + r] if r < n else stages.rates[i, r - n])
            if r >= n:
                stages.before[j, r - n] = sums[j]
        for k in range(count):
            states[k + 1, r] = _shift(stages, sums, h, k)
        if with_columns:
            for c in range(stages.right.shape[1]):
                for j in range(count):
                    sums[j] = 0.0
                    for i in range(count):
                        sums[j] += stages.legendre[j, i] * (stages.moved[i, n + r, c] if r < n else stages.right[i * n + r - n, c])
                for k in range(count):
                    columns[c // 4, k + 1, r, c % 4] = _shift(stages, sums, h, k)


@kernel
def _first_length(flight, left):
    """A length of the first step, from the forces' derivatives at its begin."""
    stages = flight.stages
    n = stages.rates.shape[1]
    inputs = flight.rows.shape[0]
    _put_inputs(flight, flight.states[0], int64(0))
    call_forces(flight.program.called, int64(1))
    for k in range(stages.forces.shape[0]):
        stages.forces[k, 0] = flight.program.called.values[inputs + k, 0]
    largest = 0.0
    for r in range(n):
        total = 0.0
        for c in range(n):
            total += abs(_by_state(flight, int64(0), r, c))
        largest = max(largest, total)
    return min(left, FIRST / math.sqrt(largest)) if largest > 0.0 else left


@kernel
def collocate(flight, at, left, with_columns):
    """Compute a step from flight.states[0] and flight.columns[0], at a time of the flight of which so much is left; < 0: back in time.

    Its polynomials take the place of the Taylor coefficients, and its length is stages.length[0]; 0 if there is none."""
    stages = flight.stages
    count, n = stages.rates.shape
    direction = 1.0 if left >= 0.0 else -1.0
    room = abs(left)
    length = stages.length
    if at == 0.0:
        length[1] = _first_length(flight, room)
        length[2] = 0.0
    length[0] = 0.0
    wanted = length[1]
    while wanted > SMALLEST * room:
        # What is left over would be a short step.
        step = room if wanted >= room else min(wanted, 0.5 * room) if 2.0 * wanted > room else wanted
        h = direction * step
        if length[2] > 0.0 and step <= 2.0 * length[2]:
            _guess(flight, step)
        else:
            _put_inputs(flight, flight.states[0], int64(0))
            call_forces(flight.program.called, int64(1))
            sources_at(flight.sources, at)
            for r in range(n):
                here = _acceleration(flight, flight.states[0], int64(0), r)
                for i in range(count):
                    stages.rates[i, r] = here
        if not _solve_step(flight, at, h):
            wanted = 0.3 * step
            continue
        defect, speed = _worst_defect(flight, at, h)
        limit = ORDER * DEFECT * speed
        share = defect * step
        factor = 4.0
        if not share <= limit * 4.0**-count:
            factor = max(0.2, min(4.0, 0.9 * (limit / share) ** (1.0 / count))) if share < math.inf else 0.2
        if not share <= limit:
            wanted = min(0.8, factor) * step
            continue
        if with_columns and not _carry_columns(flight, at, h) <= RESOLVED:
            wanted = 0.7 * step
            continue
        _write_polynomials(flight, h, with_columns)
        length[0] = step
        length[1] = factor * step
        length[2] = step
        return
