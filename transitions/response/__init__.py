"""Responses to periodic loads: where a family starts, its measures, its files and its figure."""
