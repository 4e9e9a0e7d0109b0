"""Benchmarks: speed, error and memory of saltus and of other programs, measured in the same run. They are not installed.

    python -m benchmarks --help
"""
