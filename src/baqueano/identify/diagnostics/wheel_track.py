"""Compare the track of two wheels in the file with the track by wheels and gyro.

    ω_z = s (v_r − v_l)/b + noise,   s ≤ s_true ≤ s/ρ²,   b_true = b/s_true                                (1)

Noise of the wheels makes the slope s too small, at most by the squared correlation ρ². The finding needs a track
outside (1) by MAX_TRACK_ERROR, more than the scales of a gyro and of a wheel. Wheels that skid in turns look further
apart, and a fit with this track is right for them too.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.diagnostics.file_consistency import measurements
from baqueano.identify.residuals.gyro_aided import GYRO_CHANNEL
from baqueano.runs.diagnostics.signal_map import MIN_SCALE_GAIN, channel_regression, clip
from baqueano.sensors.sampling import is_imu

if TYPE_CHECKING:
    from baqueano.identify.identifiability import FinishedFit

MAX_TRACK_ERROR = 0.15


def track_findings(end: "FinishedFit") -> list[Diagnostic]:
    """Return a finding on each pair of wheels with another track than in the file, unless its track is fitted."""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    z, findings = measurements(problem), []
    gyros = [problem.spans[name].start + GYRO_CHANNEL for name in problem.names if is_imu(sensors[name])]
    fitted_paths = {parameter.path for parameter in end.parameters.free}
    for name, span in problem.spans.items() if gyros else ():
        path = f"sensors.{name}.track_m"
        if not has_field(sensors[name], "track_m") or path in fitted_paths:
            continue
        track_m = float(sensors[name].track_m)
        rate, gyro = clip(np.column_stack([np.diff(z[:, span]) / track_m, z[:, gyros[0]]])).T
        r = channel_regression(gyro, rate)
        if r.slope <= 0.0 or not r.is_clear(MIN_SCALE_GAIN):
            continue
        least_m, most_m = track_m * r.correlation**2 / r.slope, track_m / r.slope
        if track_m < least_m / (1.0 + MAX_TRACK_ERROR) or track_m > most_m * (1.0 + MAX_TRACK_ERROR):
            figures = {"track_m": most_m, "was_m": track_m}
            findings.append(note("file.track", Severity.WARNING, f"--free +{path}", name, **figures))
    return findings
