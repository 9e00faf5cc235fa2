"""Identifiability of parameters, and advice on those that the data do not show."""
