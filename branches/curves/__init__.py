"""Curves of bifurcations and grazings in the plane of two parameters."""
