"""Compiled code that binds orbits to continuation."""
