"""Damped motion: its energy budget, its spectrum over time, and the families of the undamped system that it follows."""
