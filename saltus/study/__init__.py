"""Studies: many damped motions over a grid or a Latin hypercube of parameters."""
