"""Scenes that ship with saltus, as TOML: systems of the literature with their bounds and the names that it uses."""
