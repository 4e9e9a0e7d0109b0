"""Speed against error: every method does every task at all its settings, each in a fresh process."""
