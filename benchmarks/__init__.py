"""Benchmarks: speed, error and memory of saltus beside other programs, measured in the same run. Not installed.

    python -m benchmarks --help
"""
