"""Compute the covariance of θ.

information  the sandwich A⁻¹ B A⁻¹, for white and autocorrelated residuals, and the errors of fixed parameters
clusters     the jackknife over blocks, where the sandwich is too small
"""
