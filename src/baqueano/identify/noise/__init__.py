"""Noise of sensors and model: Q and R for the filter, and sensors at rest.

noise = measure_noise(fit, run)          # Q in motion and at rest, R
compare_noise(fit, {"truth": noise, …}, unseen_run).best
print(at_rest(run).table())              # Allan deviation, bias, temperature
"""

from baqueano.identify.noise.at_rest import AtRest, at_rest
from baqueano.identify.noise.covariances import STATES, Noise, measure_noise, valid
from baqueano.identify.noise.held_out import NoiseComparison, compare_noise

__all__ = [
    "STATES",
    "AtRest",
    "Noise",
    "NoiseComparison",
    "at_rest",
    "compare_noise",
    "measure_noise",
    "valid",
]
