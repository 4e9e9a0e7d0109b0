"""Pictures of motions that are no periodic orbits; matplotlib is loaded only when one is drawn."""
