"""Systems with smooth forces, for tests of their flights."""

import numpy as np

from bvp.springs import Spring
from bvp.system import ImpactSystem


def system_of(springs, n):
    """Unit masses on linear springs to the ground and to each other, and further springs."""
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return ImpactSystem(np.eye(n), np.zeros((n, n)), stiffness, [], springs=tuple(springs))


def chain(n, power=3, stiffness=1.0):
    """Unit masses between walls, neighbours on linear springs and on springs of some power."""
    rows = [np.eye(n)[0], *np.diff(np.eye(n), axis=0), np.eye(n)[-1]]
    return system_of([Spring(tuple(row), stiffness=stiffness, power=power, nonlinear_only=True) for row in rows], n)


def wall(n, potential="exp(3*w)/9 - w/3"):
    """A chain with one spring whose potential is an expression."""
    return system_of([Spring(tuple(np.eye(n)[0]), potential=potential)], n)


def states(system, count, size=0.7, seed=1):
    """Random states in modal coordinates."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield system.modes.from_state @ (size * rng.normal(size=2 * system.degrees_of_freedom))
