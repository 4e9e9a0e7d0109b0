"""Scans of starts at the origin at one energy."""

import numpy as np

from branches.search.orbit_search import OrbitSearch
from branches.search.starts import Sampler


def sampled(system, end, quarter_period, energy, angles, impacts):
    """Orbits from a scan of so many angles, or of an array of angles."""
    search, sampler = OrbitSearch(system), Sampler(system, end, quarter_period, list(impacts))
    found = (search.add(segment, lambda problem, y: problem.solve(y, energy=energy)) for segment in sampler.segments(energy, angles))
    return [orbit for orbit in found if orbit is not None]


def refined(system, end, quarter_period, energy, angle, most, width, count=801):
    """Angles up to `width` beside one, down to rounding where the sequence of up to `most` impacts changes."""
    sampler = Sampler(system, end, quarter_period, [most])
    grid = angle + np.linspace(-width, width, count)
    for _ in range(14):
        sequences = sampler.follow(energy, grid, [most])[1]
        change = np.any(sequences[1:] != sequences[:-1], axis=1) & (np.diff(grid) > 1e-14)
        if not change.any():
            break
        grid = np.unique(np.concatenate([grid, *(np.linspace(grid[i], grid[i + 1], 7)[1:-1] for i in np.flatnonzero(change))]))
    return grid
