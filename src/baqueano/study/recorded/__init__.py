"""Fit recordings of other authors, each in a module whose function `rows` returns its results and their bars."""
