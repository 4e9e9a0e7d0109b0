"""Families of free orbits of conservative systems in released parameters."""
