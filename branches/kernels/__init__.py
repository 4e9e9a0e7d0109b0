"""Compiled code for families of orbits.

functions    the test functions
blocks       the step with its test functions, and the advance by many steps in one call
brackets     the steps inside a step, and the bracket of a zero of a test function
"""
