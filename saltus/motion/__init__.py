"""Damped motions of a scene: one motion and its report, and the file and the runs of a study of many."""
