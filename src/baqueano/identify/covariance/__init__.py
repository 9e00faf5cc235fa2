"""Compute the covariance of θ.

information       the sandwich A⁻¹ B A⁻¹, for white and autocorrelated residuals, and the errors of scales and zeros
clusters          the jackknife over blocks, where the sandwich is too small
fixed_parameters  the errors by uncertain parameters that a fit keeps fixed
"""
