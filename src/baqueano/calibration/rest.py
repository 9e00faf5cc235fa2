"""Measure the bias of a gyro while the vehicle is at rest, and test if a run begins at rest.

    b = b₀ + mean of (z − h), over the readings after REST_S without a command                            (1)
    w² = ½ mean (z_{k+1} − z_k)²                                                                          (2)

The bias of a gyro is (1) over each rest that lasts MIN_REST_S more: errors of the model do not act at rest. It changes
from run to run, so the scatter s of the biases of n runs adds s²/n to the variance of their mean, and the file states
at least s for another run. From the drive of a car, the bias cannot be separated from a small steering offset. So
without a rest the file of a car keeps its value. A run begins at rest if its first speed readings are 0 within
ZERO_SPEED_FACTOR w. w is the standard deviation of their white noise, by von Neumann's estimate over the whole run.
Without a speed sensor, the run must begin without a command. Before the first command the standard deviation of the
readings must be below REST_NOISE_FACTOR w: a coasting vehicle slows down, so its readings vary more.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Verdict, note
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS, ByName, Motion
from baqueano.vehicle_file import Provenance, VehicleFile
from baqueano.vehicle_file.file import today

REST_S = 1.0  # without any command, before the vehicle is treated as at rest
TOLERANCE = 1e-9  # tolerance for readings without noise
MIN_REST_S = 1.0  # shortest duration of the measurements after REST_S for a bias
ZERO_SPEED_FACTOR = 4.0  # times w: the largest speed reading that is treated as 0
FIRST_READINGS = 5  # readings of a speed; 0 s to 0.05 s at 100 Hz
REST_NOISE_FACTOR = 2.0  # times w, or the noise in the file: a gyro with more scatter is being turned by hand


def with_rest_gyro_bias(
    vehicle_file: VehicleFile, runs: Sequence[Run]
) -> tuple[VehicleFile, Diagnostic | None]:
    """Return the file with the bias of the first gyro that was at rest in the runs, and a message. If the vehicle was
    not at rest in any run, return the unchanged file and None."""
    for name, sensor in vehicle_file.sensors._asdict().items():
        if not has_field(sensor, "gyro_bias"):
            continue
        residuals = {run.name: _rest_residuals(run, name, sensor) for run in runs}
        runs_at_rest = [name for name, x in residuals.items() if len(x)]
        x = np.concatenate([np.zeros(0), *residuals.values()])
        if not len(x):
            continue
        n, scatter = len(runs_at_rest), 0.0
        if n > 1:
            scatter = float(np.std([residuals[run].mean() for run in runs_at_rest], ddof=1))
        bias, own_std = float(sensor.gyro_bias + x.mean()), x.std(ddof=1) / np.sqrt(len(x))
        std = float(np.hypot(own_std, scatter / np.sqrt(n)))
        message = note(
            "bias.at-rest", subject=name, bias_rad_s=bias, std_rad_s=std, runs=", ".join(runs_at_rest)
        )
        if scatter > sensor.gyro_bias_std:
            vehicle_file = vehicle_file.with_values({f"sensors.{name}.gyro_bias_std": scatter})
        return _set_gyro_bias(vehicle_file, name, bias, std, runs_at_rest), message
    return vehicle_file, None


def begins_at_rest(run: "Run", sensors: ByName[Tree]) -> bool:
    """Return True if a run begins at rest, according to its commands and the readings of `sensors`.  (2)"""
    driven_ticks = np.flatnonzero(np.any(run.applied_commands != 0.0, axis=1))  # NaN counts as driven
    first_ns = run.t_ns[max(driven_ticks[0] - 1, 0)] if len(driven_ticks) else run.t_ns[-1]
    is_quiet = not len(driven_ticks) or driven_ticks[0] > 0
    for name, sensor in sensors._asdict().items():
        channel = run.sensors.get(name)
        if channel is None or len(channel.z) <= FIRST_READINGS:
            continue
        is_finite = np.isfinite(channel.z)
        step = np.diff(np.where(is_finite, channel.z, 0.0), axis=0) * (is_finite[1:] & is_finite[:-1])
        white_std = np.sqrt(0.5 * np.mean(step**2, axis=0))
        if not has_field(sensor, "gyro_bias") and speed_channels(sensor).any():
            first_speeds = np.abs(channel.z[:FIRST_READINGS, speed_channels(sensor)])
            # NaN is not treated as moving
            return not np.any(
                first_speeds > ZERO_SPEED_FACTOR * white_std[speed_channels(sensor)] + TOLERANCE
            )
        first_readings = np.where(is_finite, channel.z, 0.0)[channel.t_ns <= first_ns]
        is_quiet = (
            is_quiet
            and len(first_readings) >= FIRST_READINGS
            and bool(np.all(np.std(first_readings, axis=0) <= REST_NOISE_FACTOR * white_std + TOLERANCE))
        )
    return is_quiet


def speed_channels(sensor: Tree) -> np.ndarray:
    """Return a mask (m,) of the channels that depend on ν and not on ν̇."""
    zeros, zero_force = np.zeros(3), np.zeros(2)
    z_at_rest, z_moving = (
        sensor.h(Motion(zeros, nu, zeros, zero_force)) for nu in (zeros, np.array([1.0, 0.0, 1.0]))
    )
    z_accelerating = sensor.h(Motion(zeros, zeros, np.ones(3), zero_force))
    return np.asarray((z_moving != z_at_rest) & (z_accelerating == z_at_rest))


def is_at_rest(run: "Run", t_ns: np.ndarray) -> np.ndarray:
    """Return a mask (K,), True at the times `t_ns` (K,) that come after REST_S without a command."""
    driven_ticks = np.any(run.applied_commands != 0.0, axis=1)  # NaN counts as driven
    last_driven_ns = np.maximum.accumulate(np.where(driven_ticks, run.t_ns, run.t_ns[0]))
    tick = np.clip(np.searchsorted(run.t_ns, t_ns), 0, len(run.t_ns) - 1)
    return ~driven_ticks[tick] & (t_ns - last_driven_ns[tick] > REST_S * NANOSECONDS)


def _rest_residuals(run: "Run", name: str, sensor: Tree) -> np.ndarray:
    """Return gyro readings minus model (K,) [rad/s] while the vehicle was at rest. A rest is left out if it is
    too short, or if the vehicle coasted or was turned by hand."""
    channel = run.sensors.get(name)
    if channel is None or channel.z.shape[1] != sensor.size or not len(run.t_ns):
        return np.zeros(0)
    is_finite = np.isfinite(channel.z[:, -1])
    t_ns, z = channel.t_ns[is_finite], channel.z[is_finite, -1]
    at_rest = is_at_rest(run, t_ns)
    rest_motion = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
    residuals = z - sensor.h(rest_motion)[-1]
    parts = np.split(np.arange(len(z)), np.flatnonzero(np.diff(at_rest)) + 1)
    rests = [k for k in parts if at_rest[k].all() and _is_still(t_ns[k], residuals[k], sensor)]
    return np.concatenate([np.zeros(0), *(residuals[k] for k in rests)])


def _is_still(t_ns: np.ndarray, residuals: np.ndarray, sensor: Tree) -> bool:
    """Return True if one rest (K,) lasts MIN_REST_S and varies as noise; pooled, a short coast would pass."""
    if len(t_ns) < 2 or (t_ns[-1] - t_ns[0]) * len(t_ns) / (len(t_ns) - 1) < 0.999 * MIN_REST_S * NANOSECONDS:
        return False
    noise_std = np.sqrt(max(sensor.cov[-1, -1], 0.5 * np.mean(np.diff(residuals) ** 2)))  # (2)
    return not np.std(residuals) > REST_NOISE_FACTOR * noise_std > 0.0


def _set_gyro_bias(
    vehicle_file: VehicleFile, name: str, bias: float, std: float, run_names: list[str]
) -> VehicleFile:
    path = f"sensors.{name}.gyro_bias"
    return vehicle_file.with_values(
        {path: bias}, {path: Provenance(", ".join(run_names), today(), std, Verdict.USABLE)}
    )
