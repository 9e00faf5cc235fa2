"""Validate a fit on data that it did not use, and for drives to come.

held_out          errors of a simulation of held-out runs, against the noise
cost_advice       the cost that these errors recommend
noise_comparison  noise matrices of a filter, on held-out runs
forecast          errors of a drive in open loop that follow from the errors of the fit
parameter_drift   parameters run by run, and the ones that changed
"""

from baqueano.validation.forecast import Forecast, forecast
from baqueano.validation.held_out import Validation, validate

__all__ = ["Forecast", "Validation", "forecast", "validate"]
