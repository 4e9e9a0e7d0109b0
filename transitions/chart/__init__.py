"""Charts of forced motion: curves of bifurcations and grazings in the plane of two parameters, and the attractors between them."""
