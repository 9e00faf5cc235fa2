"""Compare wheels in the file with their motion: the track by wheels and gyro, and the sliding in turns.

    ω_z = s (v_r − v_l)/b + noise,   s ≤ s_true ≤ s/ρ²,   b_true = b/s_true                                (1)
    β = m ω_z/d_y,   d_y = ∂f_y/∂ν_y at rest                                                               (2)

Noise of the wheels makes the slope s too small, at most by the squared correlation ρ². The finding needs a track
outside (1) by MAX_TRACK_ERROR, more than the scales of a gyro and of a wheel. Wheels that skid in turns look further
apart, and a fit with this track is right for them too. (2) is the angle between course and heading in a steady turn.
Driven wheels cannot show d_y, so a guess of it remains in the file, and turns the course of each estimate.
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
MAX_SLIDE_RAD = 0.04  # rms; tyres of small robots slide less
SIDEWAYS_PATH = "model.friction.linear[1]"
STIFFEST_PER_TICK = 2.0  # decay of a sideways velocity in a tick that the integrator follows well


def wheel_findings(end: "FinishedFit") -> list[Diagnostic]:
    """Return the findings on wheels of a fit with a gyro."""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    gyros = [problem.spans[name].start + GYRO_CHANNEL for name in problem.names if is_imu(sensors[name])]
    if not gyros:
        return []
    z = measurements(problem)
    return [*track_findings(end, z, z[:, gyros[0]]), *sliding_findings(end, z[:, gyros[0]])]


def track_findings(end: "FinishedFit", z: np.ndarray, gyro: np.ndarray) -> list[Diagnostic]:
    """Return a finding on each pair of wheels with another track than in the file, unless its track is fitted.  (1)"""
    sensors, findings = end.blocks.sensors._asdict(), []
    fitted_paths = {parameter.path for parameter in end.parameters.free}
    for name, span in end.task.problem.spans.items():
        path = f"sensors.{name}.track_m"
        if not has_field(sensors[name], "track_m") or path in fitted_paths:
            continue
        track_m = float(sensors[name].track_m)
        r = channel_regression(*clip(np.column_stack([gyro, np.diff(z[:, span]) / track_m])).T)
        if r.slope <= 0.0 or not r.is_clear(MIN_SCALE_GAIN):
            continue
        min_m, max_m = track_m * r.correlation**2 / r.slope, track_m / r.slope
        if track_m < min_m / (1.0 + MAX_TRACK_ERROR) or track_m > max_m * (1.0 + MAX_TRACK_ERROR):
            figures = {"track_m": max_m, "file_m": track_m}
            findings.append(note("file.track", Severity.WARNING, f"--free +{path}", name, **figures))
    return findings


def sliding_findings(end: "FinishedFit", gyro: np.ndarray) -> list[Diagnostic]:
    """Return a finding if the wheels slide by a guess of the sideways friction that the fit could not estimate.  (2)"""
    model, paths = end.blocks.model, [parameter.path for parameter in end.parameters.free]
    is_guess = SIDEWAYS_PATH in paths and not end.identifiability.mask[paths.index(SIDEWAYS_PATH)]
    if not is_guess or 1 in model.drivetrain.driven_axes or np.isnan(gyro).all():
        return []
    slope = float(model.friction.linear[1] + model.friction.coulomb[1] / model.friction.coulomb_speed[1])
    side_force = float(model.mass_kg * np.sqrt(np.nanmean(clip(gyro[:, None]) ** 2)))  # N per m/s forward
    angle = side_force / slope if slope > 0.0 else np.inf
    stiff = STIFFEST_PER_TICK * float(model.mass_kg) * end.vehicle_file.rate_hz
    if angle <= MAX_SLIDE_RAD or slope >= stiff:
        return []
    return [
        note("file.slides", subject=SIDEWAYS_PATH, value=slope, degrees=float(np.degrees(angle)), stiff=stiff)
    ]
