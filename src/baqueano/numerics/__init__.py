"""Provide numerical tools that do not depend on a vehicle or a run.

least_squares        damped Gauss-Newton with bounds, on normal equations
normal_equations     normal equations of segments, and the elimination of nuisance entries
quasi_newton         descent within bounds, with a gradient or by differences
gaussian_likelihood  its two terms, of values that can be traced
block_sums           scores and information by blocks, and the fit without each block
autocorrelation      white and autocorrelated residuals
score_test           tests of effects that a model lacks, without a new fit
statistics           quantiles, robust spreads, covariances of estimates
slow_part            a slow signal and its white noise
noise_level          σ of residuals with outliers, constant or growing with the speed
parallel             work on all cores
"""
