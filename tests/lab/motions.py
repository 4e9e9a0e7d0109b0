"""Simulated motion: of the compiled core, and of the kernels that smooth forces need."""

import numpy as np

from bvp.simulate import Simulator, energies_of, run_linear

__all__ = ["KernelSimulator", "batch_of", "impulsive"]


class KernelSimulator(Simulator):
    """Runs the motions of a linear system by the kernels of smooth systems."""

    def _run_linear(self, *arguments):
        return self._run_smooth(*arguments)


def impulsive(energies):
    """Starts at rest, where the second of two masses of 1 has so much energy."""
    states = np.zeros((len(energies), 4))
    states[:, 3] = np.sqrt(2.0 * np.asarray(energies))
    return states


def batch_of(system, states, duration, *, to_rest=False, max_impacts=10**7, fractions=(0.3, 0.5, 0.9, 0.99), threads=1):
    """`run_linear` of one system, as columns by name; `energy` and `balance` at the end."""
    simulator, states = Simulator(system), np.atleast_2d(np.asarray(states, dtype=float))
    energies, parts = energies_of(system, states), len(simulator.parts)
    summary, final, modal = run_linear(
        simulator.table, states, energies, np.full(len(states), max_impacts), float(duration), np.array(fractions), with_peaks=True,
        to_rest=to_rest, threads=threads,
    )  # fmt: skip
    names = ("reason", "duration", "impacts", "touches", "last_impact", "clear_from", "sticking_time", "rested")
    found = dict(zip(names, summary.T, strict=False))
    found["dissipated"], found["work"] = summary[:, 9 : 9 + parts], summary[:, 9 + parts]
    found["times"] = summary[:, 10 + parts : 10 + parts + len(fractions) * (parts + 2) : parts + 2]
    found["peaks"] = summary[:, summary.shape[1] - states.shape[1] // 2 :]
    found["energy"] = np.where(found["rested"] > 0.0, 0.0, energies_of(system, final, modal))
    found["initial"] = energies
    found["balance"] = energies + found["work"] - found["dissipated"].sum(axis=1) - found["energy"]
    return found
