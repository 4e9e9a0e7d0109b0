"""Families of orbits under periodic loads."""
