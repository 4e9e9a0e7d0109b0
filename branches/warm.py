"""Compilation of the kernels for orbits and families, which are then kept on disk: `python -m branches.warm`.

Run beside a program that compiles the kernels of the search at the same time, this uses a second core at the very first run.
"""

from __future__ import annotations

__all__ = ["kept", "warm"]


def kept(*, discovery: bool = False, impulsive: bool = False) -> bool:
    """Whether the kernels were compiled before, here or elsewhere on this machine, and are on disk; those of `discovery`, and of
    `impulsive` motions, too, if asked."""
    from branches.kernels import advance_block
    from bvp.kernels.compiled import stored
    from bvp.kernels.intervals import scan_interval
    from bvp.kernels.shooting import scan_starts
    from bvp.kernels.stability import orbit_stability

    kernels = [advance_block, orbit_stability, scan_interval if discovery else scan_starts]
    if impulsive:
        from bvp.kernels.motion import move

        kernels += [scan_interval, move]
    return all(map(stored, kernels))


def warm() -> None:
    """Compile them, by asking for them once: the block of steps for no step at all, which needs no other kernel."""
    import numpy as np

    from branches.family import Family
    from bvp.kernels.multipoint import RESULT
    from bvp.kernels.stability import orbit_stability
    from bvp.kernels.step import two_dof_orbit_observe
    from bvp.multipoint import MultipointProblem
    from bvp.system import vibro_impact_nes
    from continuation.control import Settings, control_of
    from continuation.problem import Goal, Recent, Step

    problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    y, ends, result = np.array([0.8, 0.6, 1.7]), np.ones((1, 4)), np.zeros(len(RESULT))
    orbit_stability(problem._packed, y, ends, problem._period, result)
    two_dof_orbit_observe(problem._packed, problem.observed, y, ends, problem._work, result)
    problem._kernel = lambda k: (None, 0)  # type: ignore[method-assign]
    family = Family(problem)
    tests = [0.0] * len(family.tests)
    y, tangent, position = (np.zeros(size) for size in (problem.unknowns, 2 * problem.unknowns, problem.size + 2))
    step = Step(True, y, tangent, position, 1.0, 0.0, 0, 0.0, 1.0, 1.0, tests)
    family._advance(Recent(step, tests, tests, tests, 1.0, 1.0), 0.01, Goal(step, position), 0, control_of(Settings()))


if __name__ == "__main__":
    warm()
