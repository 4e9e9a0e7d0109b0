"""Scans of the angles of a start that find what hides between them."""

import numpy as np


def refined(scanner, h, angle, most, width, count=801):
    """Angles up to `width` beside one, down to rounding where the word of up to `most` impacts changes."""
    grid = angle + np.linspace(-width, width, count)
    for _ in range(14):
        word = scanner.follow(scanner.starts(h, grid), [most])[0]
        change = np.any(word[1:] != word[:-1], axis=1) & (np.diff(grid) > 1e-14)
        if not change.any():
            break
        grid = np.unique(np.concatenate([grid, *(np.linspace(grid[i], grid[i + 1], 7)[1:-1] for i in np.flatnonzero(change))]))
    return grid
