"""Arithmetic of families of orbits.

functions    whether a point is an orbit, and the noise of tangents
brackets     compiled: where test functions are to be sampled
"""
