"""Choose Q of a sensor with channels that were not fitted, and which therefore do not have residuals.

    σ_i = the value of the file,   if the file has one for every channel;   else the first of these above 0  (1)
    σ_i = the residuals of a channel that was fitted,   else the scatter of its readings at rest,   else
    σ_i² = ½ mean (z_{k+1} − z_k)²,   if the vehicle was at rest for fewer than MIN_SAMPLES readings

With a noise of 0 a filter would follow only this sensor. For a channel that never changes, σ is 1 in its unit.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.rest import is_at_rest
from baqueano.runs.run import Run

MIN_SAMPLES = 30  # samples for a variance


def unfitted_covariance(
    name: str, block: Tree, fitted_variance: np.ndarray, runs: Sequence[Run], notes: list[Diagnostic]
) -> np.ndarray | None:
    """Return Q (m, m) of a sensor, or None if Q is not in the file and a run lacks the sensor.

    `fitted_variance` (m,) contains the variances of the residuals of its channels, 0 for channels that were not
    fitted.  (1)
    """
    file_variance = np.diagonal(block.cov)
    if np.all(file_variance > 0.0):
        notes.append(note("noise.of-the-file", Severity.WARNING, subject=name))
        return block.cov
    channels = [run.sensors.get(name) for run in runs]
    if any(channel is None or channel.z.shape[1] != block.size for channel in channels):
        return None
    variance = np.where(file_variance > 0.0, file_variance, fitted_variance)
    for i in np.flatnonzero(variance <= 0.0):
        variance[i] = next((v for v in _candidates(name, int(i), runs) if v > 0.0), 1.0)
        sigma = float(np.sqrt(variance[i]))
        notes.append(note("noise.of-its-rest", Severity.WARNING, subject=f"{name}[{i}]", sigma=sigma))
    return np.diag(variance)


def _candidates(name: str, i: int, runs: Sequence[Run]) -> Iterator[float]:
    """Yield the variance of channel i at rest, about the mean of each run, then the white part of all its readings."""
    deviations_at_rest, steps = [np.zeros(0)], [np.zeros(0)]
    for run in runs:
        channel = run.sensors[name]
        z, finite = channel.z[:, i], np.isfinite(channel.z[:, i])
        at_rest = z[finite & is_at_rest(run, channel.t_ns)]
        deviations_at_rest.append(at_rest - at_rest.mean() if len(at_rest) else at_rest)
        steps.append(np.diff(z[finite]))
    for x, factor in ((np.concatenate(deviations_at_rest), 1.0), (np.concatenate(steps), 0.5)):
        yield factor * float(np.mean(x**2)) if len(x) >= MIN_SAMPLES else 0.0
