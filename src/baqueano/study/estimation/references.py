"""Compute the references of an estimator: the model from the commands only, and plain integration of the readings.

Both begin at the initial pose of the run. ω is the reading of the gyro, and s the reading of the odometer.
The file calibrates both:

    ν̂     the model under the commands of the run only                                                    (1)
    r = (ω − bias) / scale,   v = s / scale; without an odometer v = ν̂_x                                   (2)
    ψ = ψ₀ + ∫ r,   p = p₀ + ∫ R(ψ) (v, ν_y),   ν_y = l r of a car, l from the rear axle; else ν̂_y         (3)

Integrals are trapezoids with the heading in the middle; a missing reading is interpolated between its neighbours.
"""

import numpy as np

from baqueano.identify.data.record import make_record
from baqueano.runs.run import Run
from baqueano.signals import seconds
from baqueano.study.recorded.simulated import simulate_outputs
from baqueano.vehicle_file import VehicleFile


def open_loop(vehicle_file: VehicleFile, run: Run, start: np.ndarray, backend: str = "auto") -> np.ndarray:
    """Return ν (N, 3) at the ticks by the model of `vehicle_file`; `start` is a pose (3,), or pose and velocity (6,).
    (1)"""
    vehicle, record = vehicle_file.vehicle, make_record(run, {})
    begin = vehicle.init(*(start[k : k + 3] for k in range(0, len(start), 3)))
    if np.any(start[3:] != 0.0):  # a moving vehicle has had a command before
        begin = begin._replace(drivetrain=vehicle.drivetrain.steady_state(record.u[0]))
    nu = simulate_outputs(vehicle, begin, record.dt_s, record.u, lambda motion: motion.nu, backend)
    return nu[np.searchsorted(record.t_s, run.t_s - 1e-9)]


def dead_reckoning(vehicle_file: VehicleFile, run: Run, nu: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return η (N, 3) at the ticks by integration; `nu` (N, 3) is the velocity by the model.  (2), (3)"""
    sensors = vehicle_file.sensors._asdict()
    imu, odometer = sensors["imu"], sensors.get("odometer")
    r = (_readings(run, "imu", 2) - imu.gyro_bias) / imu.gyro_scale
    v = nu[:, 0] if odometer is None else _readings(run, "odometer", 0) / odometer.scale
    arm_m = float(vehicle_file.data["model"].get("rear_axle_m", np.nan))
    lateral_speed = arm_m * r if np.isfinite(arm_m) else nu[:, 1]
    dt_s = np.diff(run.t_s)
    psi = start[2] + np.concatenate([[0.0], np.cumsum(_midpoints(r) * dt_s)])
    displacement = np.stack([_midpoints(v), _midpoints(lateral_speed)], axis=1) * dt_s[:, None]
    cos, sin = np.cos(_midpoints(psi)), np.sin(_midpoints(psi))
    steps = np.stack(
        [
            cos * displacement[:, 0] - sin * displacement[:, 1],
            sin * displacement[:, 0] + cos * displacement[:, 1],
        ],
        axis=1,
    )
    xy = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([xy, psi])


def _readings(run: Run, sensor: str, entry: int) -> np.ndarray:
    """Return entry `entry` (N,) of a sensor at the ticks, interpolated between its readings."""
    channel = run.sensors[sensor]
    is_finite = np.isfinite(channel.z[:, entry])
    return np.interp(run.t_s, seconds(channel.t_ns[is_finite], run.t_ns[0]), channel.z[is_finite, entry])


def _midpoints(x: np.ndarray) -> np.ndarray:
    return 0.5 * (x[1:] + x[:-1])
