"""Many damped motions of one system: plans, runs, and blocks of results on disk."""
