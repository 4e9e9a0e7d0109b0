"""Scenes that ship with saltus, as TOML: systems with their bounds, the names that the literature uses, and records of their loads; and
galleries, the figures of a publication."""
