"""Damped and chaotic motion beside the families of periodic orbits: where it goes, and where its energy goes."""
