"""Conversion of a finished search to a Fit."""
