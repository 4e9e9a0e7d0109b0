"""Poincare sections: the plane, the motions on it, fixed points and rotation numbers, and what is shown of them."""
