"""Figures of motions that are not periodic. matplotlib is loaded only when a figure is drawn."""
