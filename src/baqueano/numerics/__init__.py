"""Numerical tools without a vehicle: work on all cores, quantiles and robust statistics."""
