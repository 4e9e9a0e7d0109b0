"""Other ways to the same orbits: scipy's integrators, scipy's collocation, the reference paper's method, AUTO-07p."""
