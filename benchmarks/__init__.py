"""Benchmarks: speed and memory of saltus beside something named that is measured in the same run.

    python -m benchmarks.continuation --help
"""
