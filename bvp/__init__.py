"""Impacting systems: exact free flight, next impact by bound, restitution, event-driven runs, orbits, the multipoint problem.

The public names are those of `saltus`.
"""
