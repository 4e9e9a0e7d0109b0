"""Figures of families and of orbits. Only these modules load matplotlib."""
