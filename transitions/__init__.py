"""Damped motion: where the energy goes, what its spectrum says over time, and which families of the undamped system it follows."""
