"""Identify a vehicle from runs: excitation signals, the fit with its error bars and verdict, and the noise.

u = excitation("random_steps", file.command.limit, 60.0, file.rate_hz, seed=0)
fit = identify(run, file)
noise = measure_noise(fit, run)
noise.updated_file(fit.vehicle_file).save("my.toml")
"""

from baqueano.identify.dataset import Dataset, dataset, parameters_of
from baqueano.identify.design.signals import KINDS, excitation, random_steps
from baqueano.identify.estimation.least_squares import solution_at
from baqueano.identify.fit import conclude, identify, solve
from baqueano.identify.forecast import Forecast, forecast
from baqueano.identify.noise.covariances import Noise, measure_noise
from baqueano.identify.options import FitOptions
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.fit_result import Fit

__all__ = [
    "KINDS",
    "Dataset",
    "Fit",
    "FitOptions",
    "Forecast",
    "Noise",
    "Residuals",
    "conclude",
    "dataset",
    "excitation",
    "forecast",
    "identify",
    "measure_noise",
    "parameters_of",
    "random_steps",
    "solution_at",
    "solve",
]
