"""Compiled arithmetic of `transitions`, on plain arrays."""
