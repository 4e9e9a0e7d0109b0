"""Search for all orbits of a system at one energy."""
