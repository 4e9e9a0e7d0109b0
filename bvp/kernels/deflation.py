"""Multipliers of a conservative orbit without a product that large ones drown small ones in.

The perturbations that grow most span a subspace that the orbit carries along. Run round the cycle, any frame turns into it, and a frame run
backwards turns into the subspace of those that shrink most. Their multipliers are those of a product of small triangular factors, graded.
What is left, modulo the first subspace, neither grows nor shrinks much: there the formed product loses no digit. Each impact takes a few
operations a column, and no factor is ever reduced as a whole.

Subspace iteration: Golub and Van Loan, Matrix Computations, 4th ed. 2013, 7.3. For the two routes without deflation see
`bvp.kernels.monodromy` and `bvp.kernels.periodic_qr`.
"""

import math

from bvp.kernels.compiled import inlined, long_loops, square
from bvp.kernels.dense import eigenvalues
from bvp.kernels.flight import copy_1, inner, set_1, set_2
from bvp.kernels.monodromy import GRADE, linearised_impact, order_multipliers, sort_by_modulus, trivial_rows
from bvp.kernels.pencil import complement
from bvp.kernels.sweeps import block_multipliers

_PART = 0.8
"""Largest ratio of two neighbouring moduli that are parted."""

_TRUSTED = 1e-10
"""Eigenvalues of a formed matrix below this part of its norm say nothing yet."""

_GROWTH = 8.0
"""Growth of the leading columns after which they are orthonormalised again."""

_ROUNDING = 1e-16
"""Error of a frame below which no further round improves it."""

_SETTLED = 1e-14
"""Error of a frame that is rounding if it no longer decreases."""

_ROUNDS = 40
"""Most rounds for one frame."""

_NORM = 1e3
"""Norm of the product of what is left, and of the change at an impact, up to which they are taken. The change is large near a grazing, and
what it does not magnify is lost in its rounding."""


@inlined
def _orthonormalise(rows, weights, count, sweeps, x, rest):
    """The first `count` rows orthonormal with the weights, rows = R' rows', and the first `rest` columns of x perpendicular to them.
    The triangle R multiplies sweeps.product from the left."""
    upper, product, exponent, line = sweeps.older, sweeps.product, sweeps.exponent, sweeps.scratch[1, 3]
    size = weights.shape[0]
    for j in range(count):
        total = 0.0
        for r in range(size):
            total += weights[r] * rows[j, r] * rows[j, r]
        norm = math.sqrt(total)
        upper[j, j] = norm
        for r in range(size):
            rows[j, r] /= norm
        for c in range(j + 1, count):
            total = 0.0
            for r in range(size):
                total += weights[r] * rows[j, r] * rows[c, r]
            upper[j, c] = total
            for r in range(size):
                rows[c, r] -= total * rows[j, r]
        if rest > 0:
            set_1(line, 0.0)
            for r in range(size):
                a = weights[r] * rows[j, r]
                for c in range(rest):
                    line[c] += a * x[r, c]
            for r in range(size):
                a = rows[j, r]
                for c in range(rest):
                    x[r, c] -= a * line[c]
    for c in range(count):
        largest = 0.0
        for b in range(c, count):
            total = 0.0
            for a in range(c, b + 1):
                total += upper[c, a] * product[a, b] * 2.0 ** (exponent[a] - exponent[c])
            product[c, b] = total
            largest = max(largest, abs(total))
        if largest > 1e100 or 0.0 < largest < 1e-100:
            shift = math.floor(math.log2(largest))
            exponent[c] += shift
            for b in range(c, count):
                product[c, b] *= 2.0**-shift


@inlined
def _largest_change(linearised, contacts, contact, scale):
    """The largest change of a scaled perturbation by its late arrival at an impact."""
    nodes = contact.shape[0]
    largest = 0.0
    for s in range(nodes):
        c = contact[s + 1 if s + 1 < nodes else 0]
        if c >= 0:
            late = 0.0
            gap = 0.0
            for r in range(scale.shape[0]):
                late += (linearised.late[s, r] / scale[r]) ** 2
                gap += (contacts.gap[c, r] * scale[r]) ** 2
            largest = max(largest, late * gap)
    return math.sqrt(largest)


@inlined
def _carry(linearised, contacts, at, contact, back, z):
    """z (N,) over a flight and the impact after it (-1: none), or back over both, for displacements and velocities without damping: gaps
    see the former, impacts push the latter."""
    half = z.shape[0] // 2
    entries, late = linearised.flight[at], linearised.late[at]
    c = max(contact, 0)
    jump = contacts.jump[c] if contact >= 0 else 0.0
    lateness = 0.0
    kick = 0.0
    if back:
        # The inverse of S has R late in place of late.
        turned = 0.0
        for r in range(half):
            lateness += contacts.gap[c, r] * z[r]
            kick += contacts.rate[c, half + r] * z[half + r]
            turned += contacts.rate[c, half + r] * late[half + r]
        if contact < 0:
            lateness = 0.0
        kick = jump * (kick + turned * lateness)
        # The inverse of a flight: its determinant is 1.
        for r in range(half):
            a = z[r] + late[r] * lateness
            b = z[half + r] + late[half + r] * lateness - contacts.push[c, half + r] * kick
            z[r] = entries[3, r] * a - entries[1, r] * b
            z[half + r] = entries[0, r] * b - entries[2, r] * a
        return
    for r in range(half):
        a = z[r]
        b = z[half + r]
        q = entries[0, r] * a + entries[1, r] * b
        p = entries[2, r] * a + entries[3, r] * b
        lateness += contacts.gap[c, r] * q
        kick += contacts.rate[c, half + r] * p
        z[r] = q
        z[half + r] = p
    if contact >= 0:
        kick *= jump
        for r in range(half):
            z[r] += late[r] * lateness
            z[half + r] += late[half + r] * lateness - contacts.push[c, half + r] * kick


@inlined
def _carry_columns(linearised, contacts, at, contact, x, columns, lines):
    """The same, forwards, for the first columns of x (N, N) at once. lines (2, N): scratch."""
    half = x.shape[0] // 2
    for r in range(half):
        e11 = linearised.flight[at, 0, r]
        e12 = linearised.flight[at, 1, r]
        e21 = linearised.flight[at, 2, r]
        e22 = linearised.flight[at, 3, r]
        for c in range(columns):
            a = x[r, c]
            b = x[half + r, c]
            x[r, c] = e11 * a + e12 * b
            x[half + r, c] = e21 * a + e22 * b
    if contact >= 0:
        linearised_impact(contacts, contact, linearised.late[at], x, columns, lines)


@inlined
def _round(linearised, contacts, contact, back, columns, count, work, sweeps):
    """Carry the first rows of sweeps.frame (m, m) once round the cycle, or back: `columns` of them, of which the first `count` are kept
    orthonormal and the others, forwards only, perpendicular to these. The column c of work.square becomes the image of row c in the same
    coordinates, and sweeps.product and exponent the triangular factor of the first ones."""
    x, y, lines, scale = work.map, work.square, work.lines, work.scale
    frame, basis, weights, rows, image = sweeps.frame, sweeps.scratch[0], sweeps.scratch[1, 0], sweeps.scratch[3], sweeps.scratch[2, 2:]
    m, size = frame.shape[0], x.shape[0]
    nodes = contact.shape[0]
    rest = columns - count
    for r in range(count):
        sweeps.exponent[r] = 0.0
        for c in range(count):
            sweeps.product[r, c] = 1.0 if r == c else 0.0
    line = lines[0]
    for c in range(columns):
        set_1(line, 0.0)
        for b in range(m):
            for r in range(size):
                line[r] += frame[c, b] * basis[b, r]
        for r in range(size):
            if c < count:
                rows[c, r] = scale[r] * line[r]
            else:
                x[r, c - count] = scale[r] * line[r]
    for r in range(size):
        weights[r] = 1.0 / (scale[r] * scale[r])
    for step in range(nodes):
        at = nodes - 1 - step if back else step
        hit = contact[at + 1 if at + 1 < nodes else 0]
        grown = 0.0
        for c in range(count):
            z = rows[c]
            _carry(linearised, contacts, at, hit, back, z)
            total = 0.0
            for r in range(size):
                total += weights[r] * z[r] * z[r]
            grown = max(grown, total)
        if rest > 0:
            _carry_columns(linearised, contacts, at, hit, x, rest, lines)
        if grown > _GROWTH * _GROWTH:
            _orthonormalise(rows, weights, count, sweeps, x, rest)
    set_2(y, 0.0)
    for b in range(m):
        for c in range(count):
            total = 0.0
            for r in range(size):
                total += basis[b, r] / scale[r] * rows[c, r]
            image[c, b] = total
        for r in range(size):
            a = basis[b, r] / scale[r]
            for c in range(rest):
                y[b, c] += a * x[r, c]
    set_1(weights, 1.0)
    _orthonormalise(image, weights[:m], count, sweeps, y, rest)
    for b in range(m):
        for c in range(rest - 1, -1, -1):
            y[b, count + c] = y[b, c]
        for c in range(count):
            y[b, c] = image[c, b]


@inlined
def _turn(x, count, sweeps):
    """The image's leading columns in the frame: sweeps.turn. Returns how far they are from the frame's span; they replace it."""
    frame, turn, line = sweeps.frame, sweeps.turn, sweeps.scratch[1, 1]
    m = frame.shape[0]
    away = 0.0
    set_2(turn, 0.0)
    for c in range(count):
        for b in range(m):
            line[b] = x[b, c]
        for a in range(count):
            turn[a, c] = inner(frame[a], line[:m])
        for b in range(m):
            rest = line[b]
            for a in range(count):
                rest -= turn[a, c] * frame[a, b]
            away = max(away, abs(rest))
    for c in range(count):
        for b in range(m):
            frame[c, b] = x[b, c]
    return away


@inlined
def _complete(frame, count, scratch, factor):
    """The rows of the frame from `count` on: perpendicular to the first ones."""
    for c in range(count):
        copy_1(frame[c], scratch[c])
    complement(scratch, count, frame[count:], factor)


@long_loops
def _settle(linearised, contacts, contact, back, count_and_columns, ratio, work, sweeps, values):
    """Rounds until the first `count` rows of the frame span what the cycle carries along, with their multipliers in `values` (2, m).
    ratio: of the largest other modulus to the least of theirs. columns: that the last round carries. Returns how many rounds; 0 if they do
    not settle."""
    known = False
    older = math.inf
    count, columns = count_and_columns
    for rounds in range(1, _ROUNDS + 1):
        wide = known and columns > count
        if wide:
            _complete(sweeps.frame, count, sweeps.turn, sweeps.scratch[1, 2])
        _round(linearised, contacts, contact, back, columns if wide else count, count, work, sweeps)
        away = _turn(work.square, count, sweeps)
        if not away < math.inf:
            return 0
        # A frame has the multipliers of the span that the round began with, and ends with a better one.
        if known and block_multipliers(sweeps, count, values):
            return rounds
        known = away * ratio < _ROUNDING or (away < _SETTLED and away > 0.5 * older)
        older = away
    return 0


@inlined
def _leading(values, norm, size):
    """(how many eigenvalues, sorted by modulus, to part from the others; the ratio of moduli there); -1: they do not part."""
    found = 0
    ratio = _PART
    for j in range(size):
        larger = math.hypot(values[0, j], values[1, j])
        if larger <= math.sqrt(GRADE) or larger < _TRUSTED * norm:
            break
        found = -1 if found == 0 else found
        smaller = math.hypot(values[0, j + 1], values[1, j + 1]) if j + 1 < size else 0.0
        if smaller <= ratio * larger:
            found = j + 1
            ratio = smaller / larger
    return found, ratio


@inlined
def _iterate(matrix, lead, ratio, rows, line):
    """Rows of `rows` (>= lead, size): an orthonormal basis of the subspace of the leading eigenvalues of a matrix (size, size)."""
    size = matrix.shape[0]
    for j in range(lead):
        for b in range(size):
            rows[j, b] = math.cos(1.0 + 7.0 * j + 3.0 * b * (j + 1))
    steps = 3 + int(37.0 / -math.log(ratio)) if ratio > 0.0 else 3
    for _ in range(steps):
        for j in range(lead):
            for b in range(size):
                line[b] = inner(matrix[b], rows[j, :size])
            for _ in range(2):
                for a in range(j):
                    total = inner(rows[a, :size], line[:size])
                    for b in range(size):
                        line[b] -= total * rows[a, b]
            norm = 0.0
            for b in range(size):
                norm = max(norm, abs(line[b]))
            total = 0.0
            for b in range(size):
                total += (line[b] / norm) ** 2
            norm *= math.sqrt(total)
            for b in range(size):
                rows[j, b] = line[b] / norm


@inlined
def _least(values, count):
    """The smallest of the first moduli."""
    least = math.inf
    for j in range(count):
        least = min(least, math.hypot(values[0, j], values[1, j]))
    return least


@inlined
def _dual(basis, frame, count, line):
    """Rows of the frame that the map multiplies from the right become columns that its inverse multiplies from the left, by the symplectic
    form: (q, p) becomes (p, -q)."""
    m = frame.shape[0]
    half = basis.shape[1] // 2
    for c in range(count):
        set_1(line, 0.0)
        for b in range(m):
            for r in range(half):
                line[r] += frame[c, b] * basis[b, half + r]
                line[half + r] -= frame[c, b] * basis[b, r]
        for b in range(m):
            frame[c, b] = inner(basis[b], line)


@inlined
def _invert(values, count, out):
    """The first columns of `out` become 1/values: real and imaginary parts."""
    for j in range(count):
        x = values[0, j]
        y = values[1, j]
        if y == 0.0:
            out[0, j] = 1.0 / x
            out[1, j] = 0.0
        else:
            total = x * x + y * y
            out[0, j] = x / total
            out[1, j] = -y / total


@long_loops
def deflated_multipliers(flight, contacts, orbit, linearised, work, spectrum, sweeps, matrix):
    """Multipliers of an orbit of a conservative system, after `bvp.kernels.monodromy.formed_multipliers` with the same arguments, into
    spectrum.values.

    linearised: filled by that. sweeps: `bvp.kernels.sweeps.make_sweep_work`. matrix (m, m): scratch. Returns (rounds; largest defect of
    a pair); rounds are 0 where the multipliers do not part well."""
    values, other, found = spectrum.values, spectrum.sums, sweeps.scratch[2]
    frame, basis, factor, line = sweeps.frame, sweeps.scratch[0], sweeps.scratch[1, 2], sweeps.scratch[1, 1]
    m = frame.shape[0]
    if not _largest_change(linearised, contacts, orbit.contact, work.scale) < _NORM:
        return 0, math.inf
    trivial_rows(flight, orbit, True, work)
    complement(work.vectors, work.vectors.shape[0], basis, factor)
    for r in range(m):
        copy_1(spectrum.matrix[r], matrix[r])
        for c in range(m):
            frame[r, c] = 1.0 if r == c else 0.0
    count = 0
    rounds = 0
    first = 0
    ratio = 0.0
    while True:
        size = m - count
        left = square(sweeps.block, size)
        norm = 0.0
        for r in range(size):
            for c in range(size):
                left[r, c] = matrix[r, c]
                norm += matrix[r, c] ** 2
        norm = math.sqrt(norm)
        if count == 0:
            for j in range(m):
                found[0, j] = values[0, j]
                found[1, j] = values[1, j]
        else:
            if not norm < math.inf or not eigenvalues(left, found[0], found[1]):
                return 0, math.inf
            sort_by_modulus(found[:2, :size], other)
        lead, parted = _leading(found, norm, size)
        if lead == 0:
            break
        if lead < 0 or 2 * (count + lead) > m:
            return 0, math.inf
        for r in range(size):
            for c in range(size):
                left[r, c] = matrix[r, c]
        ratio = parted
        rows = spectrum.work
        _iterate(left, lead, ratio, rows, line)
        # From coordinates in the rest of the frame to its own.
        for j in range(lead):
            set_1(matrix[j], 0.0)
            for a in range(size):
                for b in range(m):
                    matrix[j, b] += rows[j, a] * frame[count + a, b]
        for j in range(lead):
            copy_1(matrix[j], frame[count + j])
        count += lead
        first = count if first == 0 else first
        more = _settle(linearised, contacts, orbit.contact, False, (count, m if 2 * count < m else count), ratio, work, sweeps, values)
        if more == 0:
            return 0, math.inf
        rounds += more
        if 2 * count == m:
            break
        for a in range(count, m):
            row = matrix[a - count]
            set_1(row, 0.0)
            for b in range(m):
                for c in range(m - count):
                    row[c] += frame[a, b] * work.square[b, count + c]
    middle = m - 2 * count
    if count == 0 or (middle > 0 and not norm < _NORM):
        return 0, math.inf
    for j in range(middle):
        values[0, count + j] = found[0, j]
        values[1, count + j] = found[1, j]
    if middle > 0:
        ratio = math.hypot(found[0, 0], found[1, 0]) / _least(values, count)
        if not GRADE * math.hypot(found[0, middle - 1], found[1, middle - 1]) ** 2 > 1.0:
            return 0, math.inf
    if count == first:
        # The formed product's own left subspace.
        left = square(sweeps.block, m)
        for r in range(m):
            for c in range(m):
                left[r, c] = spectrum.matrix[c, r]
        _iterate(left, count, ratio, frame, line)
    _dual(basis, frame, count, line)
    more = _settle(linearised, contacts, orbit.contact, True, (count, count), ratio, work, sweeps, other)
    if more == 0:
        return 0, math.inf
    _invert(other, count, values[:, count + middle :])
    return rounds + more, order_multipliers(values, other, True)
