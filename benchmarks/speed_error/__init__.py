"""Speed against error: every method solves every task at all its settings, each in a new process."""
