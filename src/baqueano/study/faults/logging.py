"""Damage runs in the way of clocks, filters and loggers, before a recording is written; see also damage.py."""

from dataclasses import replace

import numpy as np

from baqueano.messages.language import mark as N_
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS
from baqueano.study.faults.damage import imu_readings, with_clocks, with_readings
from baqueano.vehicle_file import VehicleFile

EPOCH_MS = 1_760_000_000_000


def with_clock_drift(run: Run, rate: float) -> Run:
    """Return the run with an IMU clock that is fast by the fraction `rate`."""
    c = run.sensors["imu"]
    t_ns = c.t_ns + np.round(rate * (c.t_ns - run.t_ns[0])).astype(np.int64)
    return replace(run, sensors={**run.sensors, "imu": c._replace(t_ns=t_ns)})


def clock_drifts_little(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Let the IMU's clock run 200 ppm fast or slow."""
    return with_clock_drift(run, float(rng.choice([-1.0, 1.0])) * 200e-6)


def clock_drifts_much(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Let the IMU's clock run 2 % fast or slow."""
    return with_clock_drift(run, float(rng.choice([-1.0, 1.0])) * 0.02)


def rotate_mount(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Turn the accelerometer axes about z by 10 to 40° from a random time of the drive on."""
    z, angle = imu_readings(run), np.radians(rng.uniform(10.0, 40.0)) * rng.choice([-1.0, 1.0])
    turned_rows = slice(int(rng.uniform(0.3, 0.7) * len(z)), None)
    z[turned_rows, :2] = z[turned_rows, :2] @ _rotation(angle)
    return with_readings(run, z)


def resample(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Read all sensors at 50 to 90 % of the rate and interpolate linearly between the readings, as logging tools do."""
    sensors = {}
    for name, c in run.sensors.items():
        t = (c.t_ns - c.t_ns[0]) * 1e-9
        sparse_t = np.arange(0.0, t[-1], np.median(np.diff(t)) / rng.uniform(0.5, 0.9))
        z = [np.interp(t, sparse_t, np.interp(sparse_t, t, column)) for column in c.z.T]
        sensors[name] = c._replace(z=np.stack(z, axis=1))
    return replace(run, sensors=sensors)


def apply_low_pass(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Filter the IMU by a first-order low-pass of 5 to 44 Hz."""
    cut_hz = np.exp(rng.uniform(np.log(5.0), np.log(44.0)))
    return with_readings(run, _smooth(run, 2.0 * np.pi * cut_hz / vehicle_file.rate_hz))


def gyro_zeroes_itself(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Subtract from the gyro its moving mean, a first-order low-pass with a time constant of 1 to 5 s."""
    z = imu_readings(run)
    z[:, 2] -= _smooth(run, 1.0 / (rng.uniform(1.0, 5.0) * vehicle_file.rate_hz))[:, 2]
    return with_readings(run, z)


def lose_sign(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Replace the first command or an IMU channel by its magnitude in the second half of the run."""
    second_half = slice(len(run.t_ns) // 2, None)
    if rng.random() < 0.5:
        u = run.applied_commands.copy()
        u[second_half, 0] = np.abs(u[second_half, 0])
        return replace(run, applied_commands=u)
    z, channel = imu_readings(run), int(rng.integers(0, 3))
    z[second_half, channel] = np.abs(z[second_half, channel])
    return with_readings(run, z)


def log_epoch_in_ms(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Replace the timestamps by milliseconds since 1970, which a reader takes for nanoseconds, and remove the truth."""
    return with_clocks(run, lambda t_ns: EPOCH_MS + t_ns // 1_000_000)


def duplicated_half(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Replace the second half of the run by a copy of the first half, and remove the truth."""
    half_ticks = len(run.t_ns) // 2
    rows = np.concatenate([np.arange(half_ticks), np.arange(len(run.t_ns) - half_ticks)])
    sensors = {name: c._replace(z=c.z[rows]) for name, c in run.sensors.items()}
    return replace(run, applied_commands=run.applied_commands[rows], sensors=sensors, truth=None)


def two_imus(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Let every second reading come from another IMU, turned by 20 to 180° and with other biases."""
    z = imu_readings(run)
    angle = np.radians(rng.uniform(20.0, 180.0)) * rng.choice([-1.0, 1.0])
    z[1::2, :2] = z[1::2, :2] @ _rotation(angle)
    z[1::2] += rng.normal(0.0, 1.0, 3) * [0.3, 0.3, 0.02]
    return with_readings(run, z)


def ten_hertz(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Keep only the samples that a logger of 10 Hz would keep, and remove the truth."""
    stride = max(1, round(vehicle_file.rate_hz / 10.0))
    k = np.arange(stride - 1, len(run.t_ns), stride)
    sensors = {n: Channel(c.t_ns[k], c.arrival_ns[k], c.z[k]) for n, c in run.sensors.items()}
    return replace(
        run, t_ns=run.t_ns[k], applied_commands=run.applied_commands[k], sensors=sensors, truth=None
    )


def kilohertz_with_repeats(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Return the first 10 s of the run as a 1 kHz log that repeats the latest command and reading, without a truth."""
    repeat_count = max(1, round(1000.0 / vehicle_file.rate_hz))
    row, repeat_index = np.divmod(np.arange(round(10.0 * vehicle_file.rate_hz) * repeat_count), repeat_count)
    t_ns = run.t_ns[row] + repeat_index * (NANOSECONDS // 1000)
    sensors = {name: Channel(t_ns, t_ns, c.z[row]) for name, c in run.sensors.items()}
    u = run.applied_commands[row + (repeat_index > 0)]  # the next command is applied from a tick on
    return replace(run, t_ns=t_ns, applied_commands=u, sensors=sensors, truth=None)


def short_run(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Keep only 2 s of the drive."""
    start_s = rng.uniform(2.0, 20.0)
    return run.cut(start_s, start_s + 2.0)


def _rotation(angle: float) -> np.ndarray:
    """Return the matrix (2, 2) that transforms row vectors (x, y) to axes that are turned to the left by
    `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _smooth(run: Run, weight: float) -> np.ndarray:
    """Return the readings (M, 3) after a first-order low-pass with a time constant of 1 / `weight` samples."""
    z, keep = run.sensors["imu"].z, np.exp(-weight)
    smooth_values, level = np.empty_like(z), z[0]
    for k, reading in enumerate(z):
        level = reading + (level - reading) * keep
        smooth_values[k] = level
    return smooth_values


LOGGING = {
    N_("clock 200 ppm off"): clock_drifts_little,
    N_("clock 2 % off"): clock_drifts_much,
    N_("mount turns"): rotate_mount,
    N_("resampled"): resample,
    N_("low-passed"): apply_low_pass,
    N_("gyro zeroes itself"): gyro_zeroes_itself,
    N_("sign lost"): lose_sign,
    N_("epoch in ms"): log_epoch_in_ms,
    N_("half duplicated"): duplicated_half,
    N_("two IMUs"): two_imus,
    "10 Hz": ten_hertz,
    N_("1 kHz repeats"): kilohertz_with_repeats,
    "2 s": short_run,
}
