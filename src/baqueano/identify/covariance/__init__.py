"""Covariance of what was estimated."""
