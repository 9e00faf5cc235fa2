"""Fit recordings of other authors, each in a module whose function `rows` returns the results and the required
limits.
"""
