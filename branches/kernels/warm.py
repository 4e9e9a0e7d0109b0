"""Compile the kernels that look at an orbit and those that follow a family, and keep them on disk: `python -m branches.kernels.warm`.

Run beside a program that compiles the kernels of the search at the same time, this uses a second core at the very first run.
"""

from __future__ import annotations

__all__ = ["kept", "warm"]


def kept(*, discovery: bool = False, impulsive: bool = False) -> bool:
    """Whether the kernels were compiled before, here or elsewhere on this machine, and are on disk; those of `discovery`, and of
    `impulsive` motions, too, if asked."""
    from branches.kernels.march import march
    from bvp.kernels.warm import kept as looking_kept
    from bvp.kernels.warm import stored

    kernels = [march]
    if impulsive:
        from bvp.kernels.motion import move
        from bvp.kernels.trail import trail

        kernels += [trail, move]
    return looking_kept(discovery=discovery) and all(map(stored, kernels))


def warm() -> None:
    """Compile them, by asking for them once: the march for no step at all, which needs no other kernel."""
    import numpy as np

    from branches.family import Family
    from bvp.kernels.warm import warm as warm_looking
    from bvp.multipoint import MultipointProblem
    from bvp.system import vibro_impact_nes
    from continuation.control import control_of
    from continuation.problem import Step
    from continuation.settings import Settings

    warm_looking()
    problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    problem.addresses = np.zeros(3, dtype=np.int64)
    family = Family(problem)
    tests = [0.0] * len(family.tests)
    y, tangent, position = (np.zeros(size) for size in (problem.unknowns, 2 * problem.unknowns, problem.size + 2))
    step = Step(True, y, tangent, position, 1.0, 0.0, 0, 0.0, 1.0, 1.0, tests)
    family._march(step, tests, tests, tests, 1.0, 1.0, 0.01, position, position, 0, control_of(Settings()))


if __name__ == "__main__":
    warm()
