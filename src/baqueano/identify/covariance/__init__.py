"""Compute the covariance of θ.

information        the sandwich A⁻¹ B A⁻¹, for white and for autocorrelated residuals
clusters           the jackknife over blocks, where the sandwich is too small
scale_uncertainty  the errors of scales and zeros that the fit keeps fixed
"""
