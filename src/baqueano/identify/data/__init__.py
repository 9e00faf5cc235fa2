"""Conversion of runs to the rows that a fit reads."""
