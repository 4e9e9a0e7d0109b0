"""Compiled arithmetic of the impacting problem: plain arrays in, plain arrays out, no policy."""
