"""Runs → vehicle file: signals that show what a vehicle is, the fit with its error bars and verdict, noise.

u = excitation("random_steps", file.command.limit, 60.0, file.rate_hz, seed=0)
fit = identify(run, file)
noise = measure_noise(fit, run)
noise.updated(fit.vehicle_file).save("my.toml")
"""

from baqueano.identify.answer.result import ChannelFit, Fit
from baqueano.identify.fit import identify
from baqueano.identify.forecast import Forecast, forecast
from baqueano.identify.noise import Noise, measure_noise
from baqueano.identify.signals import KINDS, excitation, multisine, prbs, ramps, random_steps

__all__ = [
    "KINDS",
    "ChannelFit",
    "Fit",
    "Forecast",
    "Noise",
    "excitation",
    "forecast",
    "identify",
    "measure_noise",
    "multisine",
    "prbs",
    "ramps",
    "random_steps",
]
