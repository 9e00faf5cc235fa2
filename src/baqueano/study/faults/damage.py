"""Damage recordings: each function takes an intact run and a random generator, and returns the damaged run.

The size of a damage is drawn for each run, from almost invisible to obvious. Damages of two motors do not apply to a
car; detection.py excludes them.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from baqueano.messages.language import mark as N_
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY
from baqueano.vehicle_file import VehicleFile

Damage = Callable[[Run, VehicleFile, np.random.Generator], Run]


def with_readings(run: Run, z: np.ndarray, name: str = "imu") -> Run:
    """Return the run with the readings `z` of a sensor."""
    return replace(run, sensors={**run.sensors, name: run.sensors[name]._replace(z=z)})


def imu_readings(run: Run) -> np.ndarray:
    """Return a copy of the readings (M, 3) of the IMU."""
    return run.sensors["imu"].z.copy()


def with_clocks(run: Run, change: Callable[[np.ndarray], np.ndarray]) -> Run:
    """Return the run with all its timestamps `change`, and without its truth."""
    sensors = {n: Channel(change(c.t_ns), change(c.arrival_ns), c.z) for n, c in run.sensors.items()}
    return replace(run, t_ns=change(run.t_ns), sensors=sensors, truth=None)


def outliers(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Shift 10 % of all readings by 20 standard deviations, up or down."""
    for name, channel in run.sensors.items():
        std = np.sqrt(np.diagonal(getattr(vehicle_file.sensors, name).cov))
        outlier_mask = rng.random(channel.z.shape) < 0.1
        run = with_readings(
            run, channel.z + outlier_mask * rng.choice([-20.0, 20.0], channel.z.shape) * std, name
        )
    return run


def log_gyro_in_degrees(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Convert the logged gyro to degrees per second."""
    return with_readings(run, imu_readings(run) * [1.0, 1.0, 180.0 / np.pi])


def log_accel_in_g(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Convert the logged accelerometers to multiples of 9.80665 m/s²."""
    return with_readings(run, imu_readings(run) / [STANDARD_GRAVITY, STANDARD_GRAVITY, 1.0])


def log_time_in_ms(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Make all clocks run 1000 times as fast, and remove the truth."""
    return with_clocks(run, lambda t_ns: run.t_ns[0] + 1000 * (t_ns - run.t_ns[0]))


def log_command_in_volts(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Convert the logged command to the voltage of a battery of 6 to 12 V."""
    return replace(run, applied_commands=_command_scale(run, vehicle_file) * rng.uniform(6.0, 12.0))


def log_command_in_pwm(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Convert the logged command to whole counts of 255."""
    return replace(run, applied_commands=np.rint(_command_scale(run, vehicle_file) * 255.0))


def _command_scale(run: Run, vehicle_file: VehicleFile) -> np.ndarray:
    limit = np.asarray(vehicle_file.command.limit)
    return run.applied_commands / np.where(limit > 0.0, limit, 1.0)


def clip_imu(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Clip each channel of the IMU at 50 to 80 % of its largest reading."""
    z = imu_readings(run)
    end = rng.uniform(0.5, 0.8) * np.max(np.abs(z), axis=0)
    return with_readings(run, np.clip(z, -end, end))


def late_sensor(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Delay all sensors by 20 to 100 ms without a change of their timestamps."""
    delay_ticks = round(rng.uniform(0.02, 0.1) * vehicle_file.rate_hz)
    sensors = {
        n: c._replace(z=np.concatenate([c.z[:1].repeat(delay_ticks, 0), c.z[:-delay_ticks]]))
        for n, c in run.sensors.items()
    }
    return replace(run, sensors=sensors)


def repeated_time(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Replace the timestamp of 3 to 20 % of the IMU samples by the timestamp of the previous sample."""
    c = run.sensors["imu"]
    repeated_rows = np.flatnonzero(rng.random(len(c.t_ns)) < rng.uniform(0.03, 0.2))
    t_ns = c.t_ns.copy()
    t_ns[repeated_rows[repeated_rows > 0]] = t_ns[repeated_rows[repeated_rows > 0] - 1]
    return replace(run, sensors={**run.sensors, "imu": c._replace(t_ns=t_ns)})


def time_jumps_a_day(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Let all clocks jump forward by a day during the drive, and remove the truth."""
    return _time_jump(run, 86_400 * NANOSECONDS, rng)


def time_jumps_seconds(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Let all clocks jump forward by 2 to 60 s during the drive, and remove the truth."""
    return _time_jump(run, round(rng.uniform(2.0, 60.0) * NANOSECONDS), rng)


def _time_jump(run: Run, offset_ns: int, rng: np.random.Generator) -> Run:
    jump_ns = run.t_ns[int(rng.uniform(0.3, 0.7) * len(run.t_ns))]
    return with_clocks(run, lambda t_ns: t_ns + np.where(t_ns >= jump_ns, offset_ns, 0))


def sensor_clock_goes_back(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Set the IMU's clock back by an hour during the drive."""
    c = run.sensors["imu"]
    is_later = np.arange(len(c.t_ns)) > rng.uniform(0.3, 0.7) * len(c.t_ns)
    t_ns = c.t_ns - is_later * 3600 * NANOSECONDS
    return replace(run, sensors={**run.sensors, "imu": c._replace(t_ns=t_ns)})


def bursts(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Timestamp the IMU's samples in bursts of 4 to 10 samples, 20 µs apart."""
    c, burst_size = run.sensors["imu"], int(rng.integers(4, 11))
    burst_end = np.minimum((np.arange(len(c.t_ns)) // burst_size + 1) * burst_size - 1, len(c.t_ns) - 1)
    t_ns = c.t_ns[burst_end] - (burst_end - np.arange(len(burst_end))) * 20_000
    return replace(run, sensors={**run.sensors, "imu": Channel(t_ns, c.arrival_ns[burst_end], c.z)})


def hold_samples(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Repeat each IMU sample for 3 to 8 readings, as if the IMU measured more slowly than it is read."""
    z, hold_count = imu_readings(run), int(rng.integers(3, 9))
    return with_readings(run, z[np.arange(len(z)) // hold_count * hold_count])


def stuck(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Repeat one sample of the IMU for 5 to 20 % of the run."""
    z = imu_readings(run)
    length = int(rng.uniform(0.05, 0.2) * len(z))
    first_row = int(rng.integers(0, len(z) - length))
    z[first_row : first_row + length] = z[first_row]
    return with_readings(run, z)


def zeros(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Set 5 to 30 % of the IMU samples to zero."""
    z = imu_readings(run)
    z[rng.random(len(z)) < rng.uniform(0.05, 0.3)] = 0.0
    return with_readings(run, z)


def not_numbers(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Set 1 to 20 % of the IMU's readings to NaN."""
    z = imu_readings(run)
    z[rng.random(z.shape) < rng.uniform(0.01, 0.2)] = np.nan
    return with_readings(run, z)


def axes_swapped(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Swap a_x and a_y in the log."""
    return with_readings(run, imu_readings(run)[:, [1, 0, 2]])


def axis_inverted(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Invert the sign of one of a_x, a_y, ω_z."""
    sign = np.ones(3)
    sign[rng.integers(0, 3)] = -1.0
    return with_readings(run, imu_readings(run) * sign)


def gyro_inverted(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Invert the sign of ω_z."""
    return with_readings(run, imu_readings(run) * [1.0, 1.0, -1.0])


def gravity_on_an_axis(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Replace a_x or a_y by gravity and noise, as if the IMU were mounted upright."""
    z, axis = imu_readings(run), int(rng.integers(0, 2))
    std = float(np.sqrt(vehicle_file.sensors.imu.cov[axis, axis]))
    z[:, axis] = rng.choice([-1.0, 1.0]) * STANDARD_GRAVITY + std * rng.standard_normal(len(z))
    return with_readings(run, z)


def dead_channel(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Set one of a_x, a_y, ω_z to 0 in the whole run."""
    z = imu_readings(run)
    z[:, rng.integers(0, 3)] = 0.0
    return with_readings(run, z)


def motors_swapped(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Invert the sign of the turning command, as if left and right motor were swapped."""
    return replace(run, applied_commands=run.applied_commands * [1.0, 1.0, -1.0])


def motor_inverted(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Swap the commands forward and turning, as if one motor were reversed."""
    forward, _, turning = vehicle_file.command.limit
    limit_ratios = [forward / turning, 1.0, turning / forward]
    return replace(run, applied_commands=run.applied_commands[:, [2, 1, 0]] * limit_ratios)


def too_short(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Cut the run to a duration of 0.4 to 1.5 s."""
    start_s = rng.uniform(0.0, 5.0)
    return run.cut(start_s, start_s + rng.uniform(0.4, 1.5))


def partly_missing_command(run: Run, vehicle_file: VehicleFile, rng: np.random.Generator) -> Run:
    """Set the last entry of the logged command to zero in the last 30 to 70 % of the run."""
    u = run.applied_commands.copy()
    u[int(rng.uniform(0.3, 0.7) * len(u)) :, -1] = 0.0
    return replace(run, applied_commands=u)


DAMAGES: dict[str, Damage] = {
    N_("gyro in °/s"): log_gyro_in_degrees,
    N_("accelerometer in g"): log_accel_in_g,
    N_("time in ms"): log_time_in_ms,
    N_("command in volts"): log_command_in_volts,
    N_("command in PWM"): log_command_in_pwm,
    N_("clipped"): clip_imu,
    N_("late sensors"): late_sensor,
    N_("repeated time"): repeated_time,
    N_("time jumps a day"): time_jumps_a_day,
    N_("time jumps seconds"): time_jumps_seconds,
    N_("clock goes back"): sensor_clock_goes_back,
    N_("bursts"): bursts,
    N_("repeated samples"): hold_samples,
    N_("stuck"): stuck,
    N_("frames as zero"): zeros,
    N_("not numbers"): not_numbers,
    N_("axes swapped"): axes_swapped,
    N_("axis inverted"): axis_inverted,
    N_("gyro inverted"): gyro_inverted,
    N_("gravity on an axis"): gravity_on_an_axis,
    N_("dead channel"): dead_channel,
    N_("motors swapped"): motors_swapped,
    N_("motor inverted"): motor_inverted,
    N_("too short"): too_short,
    N_("command lost"): partly_missing_command,
}
