"""The first-order form z' = B z of damped free flight, with B in real blocks of size one and two.

A block is larger only if smaller ones would be inaccurate.

Modes that damping does not couple keep their real pair (q_k, p_k), whatever their damping ratio. A group of coupled modes
goes through the real Schur form, whose blocks are cut apart with Sylvester equations as long as the transformation stays well
conditioned (Bavely & Stewart, SIAM J. Numer. Anal. 16 (1979) 359); blocks that cannot be cut apart are merged. Two near-equal
real eigenvalues (critical damping) so share one 2 x 2 block, and two nearly equal complex pairs (an exceptional point) one 4
x 4 block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import product as pairs_of

import numpy as np
import saltus_core as core

from bvp.checks import EPSILON
from bvp.dense import eigenvalues, jacobi, product, quadratic, solve

__all__ = [
    "Blocks", "Matrices", "blocks_of", "coupled_groups", "cut", "decay_rates", "exact", "exact_product", "traceless",
]  # fmt: skip

LIGHT = 0.1
"""Decay, of the frequency, of a mode that counts as lightly damped."""

SEPARATION_LIMIT = 30.0
"""Largest entry of a Sylvester solution that still counts as a well-conditioned cut; rounding errors grow by about this
factor."""

REFINEMENTS = 3
"""Most steps of refinement with exact residuals. Each adds nearly sixteen digits, or doubles them."""

exact = np.vectorize(Fraction, otypes=[object])
"""The exact numbers, as fractions, of an array of doubles."""


@dataclass(frozen=True, eq=False)
class Matrices:
    """M, C and K of M u'' + C u' + K u = 0."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray


@dataclass(frozen=True, eq=False)
class Blocks:
    """The first-order form: layout, shapes Phi, blocks (layout of `bvp.kernels.flight`) and the maps between z and (u, v)."""

    layout: str
    shapes: np.ndarray
    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    to_state: np.ndarray
    from_state: np.ndarray


def blocks_of(system: Matrices, squares: np.ndarray, shapes: np.ndarray) -> Blocks:
    """The blocks of a system.

    Where no two modes are coupled (no or proportional damping) u = Phi q, v = Phi p and z = (q, p) with pairs (k, n + k): q'' = -w^2 q and
    B[n+k, n+k] = -2 zeta_k w_k. Else the coupled modes come first, in blocks of neighbouring indices, then q_k and p_k of each mode that is
    left alone.

    `squares` are w^2 of the undamped modes, of any sign, and `shapes` is Phi with Phi^T M Phi = I.

    Raises
    ------
    RuntimeError
        Where the Schur form does not converge.
    """
    n = len(squares)
    damping = np.zeros((n, n))
    if np.any(system.damping):
        shapes = _turn_repeated(system, squares, shapes, _noise(system, squares, shapes))
        damping = product(shapes.T, system.damping, shapes)
        # Repeat: a rotated shape can touch a damper that it did not touch before: a free translation must not seem to be damped.
        damping = np.where(np.abs(damping) <= _noise(system, squares, shapes), 0.0, damping)
    to_state, from_state = np.kron(np.eye(2), shapes), np.kron(np.eye(2), product(shapes.T, system.mass))
    own = damping.diagonal()
    if np.count_nonzero(damping) == np.count_nonzero(own):
        matrix, half = np.eye(2 * n, k=n), 0.5 * own
        pairs = np.arange(2 * n).reshape(2, n).T.copy()
        q, p = pairs.T
        matrix[p, q], matrix[p, p] = -squares, -own
        return Blocks("uncoupled", shapes, pairs, -half, half * half - squares, matrix, to_state, from_state)
    found = []
    for group in coupled_groups(damping):
        index = np.array([*group, *(n + k for k in group)])
        right, left, k = to_state[:, index], from_state[index], group[0]
        blocks = [np.array([[0.0, 1.0], [-squares[k], -damping[k, k]]])]
        if len(group) > 1:
            blocks, forward, backward = _coupled_blocks(squares[list(group)], damping[np.ix_(group, group)])
            blocks, right, left = _apart(system, blocks, product(right, forward), product(backward, left), bool(squares[list(group)].all()))
        found.append((blocks, right, left))
    parts, columns, rows = zip(*found, strict=True)
    pieces = [piece for part in parts for piece in part]
    ends = np.cumsum([len(piece) for piece in pieces]).tolist()
    places = [(end - len(piece), end - 1 if len(piece) == 2 else -len(piece)) for end, piece in zip(ends, pieces, strict=True)]
    matrix, pairs = _diagonal(pieces), np.array(places, dtype=np.int64)
    mean, delta = traceless(matrix, pairs)
    return Blocks("coupled", shapes, pairs, mean, delta, matrix, np.hstack(columns), np.vstack(rows))


def _diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """The matrix of blocks."""
    out = np.zeros((sum(map(len, blocks)), sum(block.shape[1] for block in blocks)))
    row = column = 0
    for block in blocks:
        out[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return out


def _refine_decay(system: Matrices, blocks: list[np.ndarray], right: np.ndarray) -> None:
    """Write the decay of lightly damped modes, of which a Schur form leaves few digits, into the diagonals of their pairs. right (2n, m):
    their columns."""
    rounding = 16.0 * len(right) * EPSILON * max(float(np.abs(block).max()) for block in blocks)
    ends = np.cumsum([len(block) for block in blocks])
    for block, end in zip(blocks, ends, strict=True):
        if len(block) != 2 or block[0, 0] != block[1, 1] or not block[0, 1] * block[1, 0] < 0.0:
            continue
        frequency = np.sqrt(-block[0, 1] * block[1, 0])
        if abs(block[0, 0]) > LIGHT * frequency:
            continue
        shape = right[:, end - 2] * block[0, 1] + right[:, end - 1] * (1j * frequency)
        (mean,) = decay_rates(system, shape[:, None])
        if abs(mean - block[0, 0]) <= rounding:
            block[0, 0] = block[1, 1] = mean


def _apart(
    system: Matrices, blocks: list[np.ndarray], right: np.ndarray, left: np.ndarray, is_held: bool
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Blocks of one group, with their columns (2n, m) of (u, v) and the rows (m, 2n) that give them, where real rates are far above others.

    A Schur form leaves the slow ones the rounding of the fast ones. Rates far apart are separated by Newton's method: the columns are
    exact numbers, and so are the forces of the dampers, which nearly cancel in slow motion."""
    rates = [eigenvalues(block) for block in blocks]
    order = sorted(range(len(blocks)), key=lambda k: -np.abs(rates[k]).max())
    sizes = [float(np.abs(rates[k]).max()) for k in order]
    cuts = [i for i in range(1, len(order)) if sizes[i - 1] > SEPARATION_LIMIT * sizes[i]]
    if not (is_held and cuts) or all(np.iscomplex(rates[k]).any() for k in order[: cuts[-1]]):
        _refine_decay(system, blocks, right)
        return blocks, right, left
    place = np.split(np.arange(len(left)), np.cumsum([len(block) for block in blocks])[:-1])
    parts = [np.concatenate([place[k] for k in part]) for part in np.split(order, cuts)]
    own, columns, damping = _diagonal(blocks), exact(right), exact(system.damping)
    for _ in range(REFINEMENTS):
        u, v = np.split(columns.astype(float), 2)
        force = exact_product(system.stiffness, u) + (damping @ columns[len(u) :]).astype(float)
        residual = product(left, np.vstack([v - product(u, own), -solve(system.mass, force) - product(v, own)]))
        turn = np.zeros_like(own)
        for a, b in pairs_of(parts, parts):
            here = residual[np.ix_(a, b)]
            if a is b:
                own[np.ix_(a, a)] += here
            else:
                operator = np.kron(own[np.ix_(a, a)], np.eye(len(b))) - np.kron(np.eye(len(a)), own[np.ix_(b, b)].T)
                turn[np.ix_(a, b)] = solve(operator, -here.ravel()).reshape(here.shape)
        columns = columns + exact(product(np.vstack([u, v]), turn))
        left = solve(np.eye(len(own)) + turn, left)
        if np.abs(turn).max() <= np.sqrt(EPSILON):
            break
    right, index = columns.astype(float), np.concatenate(parts)
    found = [cut(own[np.ix_(part, part)]) for part in parts]
    pieces, forward, backward = zip(*found, strict=True)
    return sum(pieces, []), product(right[:, index], _diagonal(forward)), product(_diagonal(backward), left[index])


def _noise(system: Matrices, squares: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Rounding of each entry of the damping between shapes, (n, n). A free translation is known to rounding of its largest entries: it is
    not to be damped by a damper that it does not touch."""
    size = np.abs(shapes)
    root = np.sqrt(np.diag(system.mass))[:, None]
    off = np.where(squares == 0.0, np.minimum((root * size).max(axis=0) / root, size.max(axis=0)), 0.0)
    damper = np.abs(system.damping)
    between = product(off.T, damper, size) + product(size.T, damper, off)
    return 8.0 * len(shapes) * EPSILON * (product(size.T, damper, size) + between)


def coupled_groups(damping: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of modes that the damping connects, the larger ones first (connected components of its nonzero pattern).

    Examples
    --------
    >>> coupled_groups(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2e-9], [0.0, 2e-9, 0.0]]))
    [(1, 2), (0,)]
    """
    linked = ((damping != 0.0) | (damping.T != 0.0)).tolist()
    left, groups = set(range(len(linked))), []
    while left:
        group = waiting = {left.pop()}
        while waiting:
            waiting = {j for i in waiting for j in left if linked[i][j]}
            left -= waiting
            group = group | waiting
        groups.append(tuple(sorted(group)))
    return sorted(groups, key=lambda group: (len(group) == 1, group))


def _turn_repeated(system: Matrices, squares: np.ndarray, shapes: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Within repeated frequencies the shapes are free: take those that the (symmetric) damping does not couple."""
    if not np.array_equal(system.damping, system.damping.T):
        return shapes
    blur = 8.0 * len(squares) * EPSILON * quadratic(np.abs(system.stiffness), np.abs(shapes))
    shapes = shapes.copy()
    start = 0
    for end in range(1, len(squares) + 1):
        if end < len(squares) and squares[end] - squares[end - 1] <= blur[end] + blur[end - 1]:
            continue
        if end - start > 1:
            part = shapes[:, start:end]
            damping = product(part.T, system.damping, part)
            damping = np.where(np.abs(damping) <= noise[start:end, start:end], 0.0, damping)
            shapes[:, start:end] = product(part, jacobi(damping)[1])
        start = end
    return shapes


def _coupled_blocks(squares: np.ndarray, damping: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Blocks of (q, p)' = (p, -w^2 q - C p) for one group, with the maps from and to its block coordinates."""
    g = len(squares)
    rate = np.sqrt(np.abs(squares))
    # All motions decay at least this fast. Displacements in units of speed over a smaller rate would lose digits.
    slowest, rounding = float(jacobi(0.5 * (damping + damping.T))[0].min()), 4.0 * g * EPSILON * float(np.abs(damping).max())
    rate = np.maximum(rate, slowest if slowest > rounding else 0.0)
    rate = np.where(rate > 0.0, rate, np.maximum(np.abs(damping).max(axis=1), np.finfo(float).tiny))
    first = np.zeros((2 * g, 2 * g))
    first[:g, g:] = np.diag(rate)
    first[g:, :g] = -np.diag(squares / rate)
    first[g:, g:] = -damping
    blocks, forward, backward = cut(first)
    scale = np.concatenate([1.0 / rate, np.ones(g)])
    return blocks, scale[:, None] * forward, backward / scale


def cut(matrix: np.ndarray, limit: float = SEPARATION_LIMIT) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Real block-diagonal form (blocks, forward, backward): matrix = forward diag(blocks) backward, backward the inverse of forward.

    Blocks whose Sylvester solution would have an entry above `limit` are merged with the nearest one.

    Raises
    ------
    RuntimeError
        Where the Schur form does not converge.
    """
    size = matrix.shape[0]
    try:
        t, q = core.schur(np.ascontiguousarray(matrix))
    except RuntimeError as error:
        raise RuntimeError(f"the Schur form of a damped system of {size} states did not converge: {error}") from None
    noise = 4.0 * size * EPSILON * float(np.abs(matrix).max())
    forward = q.copy()
    backward = q.T.copy()
    blocks = []
    start = 0
    while start < size:
        end = start + _schur_size(t, start)
        while end < size:
            solution, magnified = _cutting(t, start, end)
            is_rate = end == start + 1
            if magnified <= (min(limit, 1.0) if is_rate else limit):
                break
            nearest = _nearest(t, start, end)
            width = _schur_size(t, nearest)
            if nearest > end:
                try:
                    t, basis = core.move_block(t, np.eye(size), nearest, end)
                except ValueError as error:
                    raise RuntimeError(f"eigenvalues of a damped system of {size} states could not be reordered: {error}") from None
                forward, backward = product(forward, basis), product(basis.T, backward)
            # Two real rates in one block cost no more than apart, and then cutting them apart magnifies nothing. A larger block would.
            if is_rate and magnified <= limit and (width > 1 or _cutting(t, start, end + 1)[1] > limit):
                solution, _ = _cutting(t, start, end)
                break
            end += width
        if end < size:
            forward[:, end:] += product(forward[:, start:end], solution)
            backward[start:end] -= product(solution, backward[end:])
            t[start:end, end:] = 0.0
        block = t[start:end, start:end].copy()
        if len(block) == 1 and abs(block[0, 0]) <= noise:
            block[0, 0] = 0.0
        blocks.append(block)
        start = end
    return blocks, forward, backward


def _cutting(t: np.ndarray, start: int, end: int) -> tuple[np.ndarray, float]:
    """The Sylvester solution that cuts the block start..end off those after it, and its largest entry; infinite where there is none."""
    if end == len(t):
        return np.zeros((end - start, 0)), 0.0
    parts = t[start:end, start:end], t[end:, end:], -t[start:end, end:]
    solution = core.sylvester(*map(np.ascontiguousarray, parts))
    magnified = math.inf if solution is None else float(np.abs(solution).max())
    return (parts[2], math.inf) if not magnified < math.inf else (solution, magnified)


def _schur_size(t: np.ndarray, start: int) -> int:
    """1 or 2: the size of the diagonal block of a real Schur form that begins at `start`."""
    return 2 if start + 1 < len(t) and t[start + 1, start] != 0.0 else 1


def _nearest(t: np.ndarray, start: int, end: int) -> int:
    """Where the block after `end` begins whose eigenvalue is nearest to one of the cluster start..end."""
    cluster = eigenvalues(t[start:end, start:end])

    def apart(k: int) -> float:
        width = _schur_size(t, k)
        return float(np.abs(eigenvalues(t[k : k + width, k : k + width])[:, None] - cluster).min())

    return min((k for k in range(end, len(t)) if t[k, k - 1] == 0.0), key=apart)


def traceless(matrix: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and delta of each block: B = mean + D, D^2 = delta for a pair; for larger blocks delta is 0 and unused."""
    mean, delta = np.zeros(len(pairs)), np.zeros(len(pairs))
    for k, (i, j) in enumerate(pairs):
        if j < 0:
            mean[k] = np.trace(matrix[i : i - j, i : i - j]) / -j
        else:
            mean[k] = 0.5 * (matrix[i, i] + matrix[j, j])
            half = 0.5 * (matrix[i, i] - matrix[j, j])
            delta[k] = half * half + matrix[i, j] * matrix[j, i]
    return mean, delta


def decay_rates(system: Matrices, shapes: np.ndarray) -> np.ndarray:
    """Real parts of the rates (k,) of oscillating modes with the complex shapes (u, v) (2n, k), from the power and the energy of each.
    Where damping is light, those of an eigenvalue solver have few digits."""
    u, v = np.split(shapes, 2)
    power, kinetic = (quadratic(matrix, v.real) + quadratic(matrix, v.imag) for matrix in (system.damping, system.mass))
    potential = quadratic(system.stiffness, u.real) + quadratic(system.stiffness, u.imag)
    return 0.0 - power / (kinetic + potential)


def exact_product(*factors: np.ndarray) -> np.ndarray:
    """The product of matrices (and rows) with 0 for every entry that is rounding of the terms it is summed from.

    What cancels exactly, as a gap between two bodies does in the translation of both, so takes nothing from a translation of any size.

    Examples
    --------
    >>> exact_product(np.array([1.0, -1.0]), np.array([[0.1 + 0.2, 1.0], [0.3, 0.0]]))
    array([0., 1.])
    """
    found, sizes = product(*factors), product(*map(np.abs, factors))
    terms = sum(factor.shape[-2:][0] for factor in factors[1:])  # of a vector, a matrix, or each matrix of a stack
    return np.where(np.abs(found) <= 8.0 * terms * EPSILON * sizes, 0.0, found)
