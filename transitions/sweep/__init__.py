"""Forced motion from period to period of its loads: what it settles to, and bifurcation diagrams by simulation."""
