"""Poincare sections: the plane, the motions on it, fixed points, rotation numbers, and their tables."""
