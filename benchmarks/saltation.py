"""Floquet multipliers by the textbook method, the product of saltation matrices: the second method of the tests and benchmarks."""

from __future__ import annotations

import numpy as np

from bvp.closures import Cycle, deflated_motions
from bvp.multipliers import scaled_nodes, sort_multipliers
from bvp.system import ImpactSystem
from tests.lab.flights import LinearFlight

__all__ = ["monodromy", "reduced_monodromy", "saltation", "saltation_matrix", "saltation_multipliers"]


def saltation(jump: np.ndarray, coming: np.ndarray, going: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """The saltation matrix (N, N) of a surface, S = R + (f+ - R f-) g / (g . f-): what crossing it does to a perturbation.

    `jump` is R, the derivative of what the state becomes on the surface; the identity if only the flow changes. `coming` and `going` are
    f- and f+, the flow before and behind it, and `gradient` is g; g . f- is not 0.

    Examples
    --------
    >>> saltation(np.eye(2), np.array([2.0, 0.0]), np.array([2.0, 1.0]), np.array([1.0, 0.0]))
    array([[1. , 0. ],
           [0.5, 1. ]])
    """
    return jump + np.outer(going - jump @ coming, gradient) / float(gradient @ coming)


def saltation_matrix(system: ImpactSystem, contact: int, before: np.ndarray) -> np.ndarray:
    """The saltation matrix (2n, 2n) of an impact, in modal coordinates, for the modal state (2n,) before it.

    S = R + (f+ - R f-) g / (g . f-), with R = I - (1 + r) d g' the map of the states, f+- = B z+- the flow on either side and
    g the gradient of the gap (Mueller, Chaos, Solitons & Fractals 5 (1995) 1671). `contact` is a row of the contact arrays of `Modes`.

    Raises
    ------
    ValueError
        For an impact at zero speed.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> S = saltation_matrix(vibro_impact_nes(rho=0.7), 1, np.array([1.0, 0.2, 0.3, 0.4]))
    >>> bool(abs(np.linalg.det(S) - 0.7**2) < 1e-14)
    True
    """
    modes = system.modes
    before = np.asarray(before, dtype=float)
    gap, rate = modes.contacts.gap[contact], modes.contacts.rate[contact]
    restitution = 1.0 + modes.contacts.restitution[contact]
    impact = np.eye(before.size) - restitution * np.outer(modes.contacts.push[contact], rate)
    flow_before = modes.matrix @ before
    flow_after = modes.matrix @ (impact @ before)
    if float(gap @ flow_before) == 0.0:
        raise ValueError(f"the impact on {modes.contact_letters[contact]!r} has zero speed: it has no saltation matrix")
    return saltation(impact, flow_before, flow_after, gap)


def monodromy(cycle: Cycle) -> np.ndarray:
    """Product of saltation matrices and exponentials once round a cycle, (2n, 2n), in modal coordinates.

    It carries a perturbation from just after the first node of the cycle to just after its return there. For another section,
    to_state M from_state is the same map of (u, v).

    Raises
    ------
    ValueError
        For an impact at zero speed.
    """
    flight = LinearFlight(cycle.system)
    nodes, size = cycle.after.shape
    product = np.eye(size)
    for i in range(nodes):
        j = (i + 1) % nodes
        product = flight.map(cycle.duration[i]) @ product
        if cycle.contact[j] >= 0:
            product = saltation_matrix(cycle.system, int(cycle.contact[j]), cycle.before[j]) @ product
    return product


def reduced_monodromy(cycle: Cycle) -> np.ndarray:
    """The monodromy without its trivial directions, in orthonormal coordinates of the states divided by their size.

    (2 m, 2 m) for a conservative system with m pairs: perpendicular to the flow, tangent to the energy level, and without the motions that
    no spring and no stop resists; else (2n - 1, 2n - 1), perpendicular to the flow.

    Raises
    ------
    ValueError
        For an impact at zero speed.
    """
    nodes = scaled_nodes(cycle)
    after, scale, weights = nodes.after, nodes.scale, nodes.weights
    scaled = monodromy(cycle) * scale / scale[:, None]
    directions = [(cycle.system.modes.matrix @ after[0]) / scale]
    if cycle.system.is_conservative:
        directions.append(weights * after[0] * scale)
        free = deflated_motions(cycle.system, cycle.hit)
        directions += [np.concatenate(part) for row in free for part in ((row, 0.0 * row), (0.0 * row, row))]
    columns = np.column_stack([*(x / np.linalg.norm(x) for x in directions), np.eye(len(scale))])
    rest = np.linalg.qr(columns)[0][:, len(directions) :]
    return rest.T @ scaled @ rest


def saltation_multipliers(cycle: Cycle) -> np.ndarray:
    """Nontrivial multipliers from the monodromy, in the same order: the cross-check of `saddle_point_multipliers`.

    They are right to rounding times |M|, so a small multiplier beside a large one is lost.

    Raises
    ------
    ValueError
        For an impact at zero speed.
    """
    return sort_multipliers(np.linalg.eigvals(reduced_monodromy(cycle)))
