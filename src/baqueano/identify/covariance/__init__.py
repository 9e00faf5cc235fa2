"""Covariance of the estimated parameters."""
