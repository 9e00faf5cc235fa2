"""Identify a vehicle from runs: `fit = identify(run, file)`. A fit has five stages, each an immutable object:

    Dataset      runs without faults, and the sensors in use                         dataset.py, data/
    Parameters   θ: the free parameters, their start and bounds                      parameters/
    Residuals    z − h(θ) in every row of the runs                                   residuals/, noise level
    solve        the θ of least cost, with the noise estimated                       estimation/
    Fit          error bars, findings, verdict, vehicle file     identifiability.py, covariance/, diagnostics/, result/

fit.py composes them, and this folder is one fit. Before it, design/ makes the drive, and `excitation` a plain signal;
calibration/ measures the sensors. After it, noise/ measures the noise of the filter. Many fits: selection/ chooses the
terms of a model, validation/ judges a fit on other runs and forecasts the errors of a drive.
"""

from baqueano.identify.dataset import Dataset, dataset, parameters_of
from baqueano.identify.fit import conclude, identify, solve
from baqueano.identify.noise.covariances import Noise, measure_noise
from baqueano.identify.options import FitOptions
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.fit_result import Fit
from baqueano.numerics.least_squares import solution_at
from baqueano.simulate.excitation import KINDS, excitation, random_steps

__all__ = [
    "KINDS",
    "Dataset",
    "Fit",
    "FitOptions",
    "Noise",
    "Residuals",
    "conclude",
    "dataset",
    "excitation",
    "identify",
    "measure_noise",
    "parameters_of",
    "random_steps",
    "solution_at",
    "solve",
]
