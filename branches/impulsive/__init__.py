"""Impulsive motion: only the oscillator moves at the start. Its periodic orbits, and its dominant frequency against energy."""
