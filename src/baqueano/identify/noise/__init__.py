"""How far sensors and model are off: Q and R for the filter, and what a sensor at rest is like.

noise = measure_noise(fit, run)          # Q in motion and at rest, R
print(at_rest(run).table())              # Allan deviation, bias, temperature
"""

from baqueano.identify.noise.covariances import STATES, Noise, measure_noise, valid

__all__ = ["STATES", "Noise", "measure_noise", "valid"]
