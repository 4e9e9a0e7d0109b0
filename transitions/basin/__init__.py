"""Basins of attraction of forced motion: a grid of starts, and the attractor to which each of them leads."""
