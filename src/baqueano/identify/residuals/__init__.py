"""Residuals as functions of θ, and their noise."""
