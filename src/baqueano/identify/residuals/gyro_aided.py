"""Compute the residuals of a vehicle with an IMU and without an encoder: its gyro gives the yaw rate.

    ν_x from the commands, under the measured ν_ψ = (ω_z − b)/s and its derivative                        (1)
    r_x, r_y = z − h(ν, ν̇)   of the two accelerometers, at the velocity of (1)                            (2)
    r_ψ = z − h(ν_ψ)   of the gyro, at the ν_ψ that the commands produce at the ν_x of (1)                (3)
    ω̂ = h(ν_ψ) + slow part of (ω_z − h(ν_ψ))      numerics/slow_part.py                                  (4)

With (1), an error of the steering does not affect the speed through ν_ψ. A noisy ω_z as a regressor would bias its
coefficients towards 0, so only the first search uses it. Then ω̂ is used, the mean of the true rate given gyro and
model ("regression calibration"). If the model's rate is correct, its error is white and this rate is used. Channels are
weighted by (4) of numerics/noise_level.py. Source: Carroll, Ruppert, Stefanski and Crainiceanu 2006.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.free import DELAY_PATH, has_offset
from baqueano.identify.parameters.theta import ThetaShape
from baqueano.identify.residuals.motion import cached_kernel, example, initial_state, make_row_blocks
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.noise_level import slow_noise_profile
from baqueano.numerics.slow_part import slow_part
from baqueano.sensors.sampling import Signal, low_pass_s, step_signal
from baqueano.signals import Motion
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan
from baqueano.vehicles.freedoms import tyre_paths
from baqueano.vehicles.state import tick_effort

LEVER_ARM = "lever_arm_m[0]"
GYRO_CHANNEL = 2  # channel of an IMU
SETTLING_LAGS = 3.0  # time constants after which a motor has settled
# entries of a row beyond those of the simulation: ω_z and its derivative, at the end of the row
EXTRA_COLUMNS = 2


class GyroAidedState(NamedTuple):
    """State of the two simulations, with and without the gyro."""

    gyro_aided: Tree  # with the yaw rate of the gyro
    free: Any  # with the yaw rate of the model
    signals: tuple[Signal, Signal]  # of the IMU on each of them
    previous_h: np.ndarray  # h of the previous row (3,); (0,) if it is not needed


class GyroAidedResiduals(Residuals):
    """Residuals (2), (3) of several runs as a function of one θ, for an IMU only."""

    has_speed_noise = depends_on_fit = has_fixed_scales = True

    def __init__(
        self, blocks: FittedBlocks, shape: ThetaShape, records: Sequence[FitRecord], backend: str = "auto"
    ) -> None:
        is_delay_free = DELAY_PATH in shape.shared_paths
        records = [record.without_start(_unknown_s(record, blocks, is_delay_free)) for record in records]
        super().__init__(blocks, shape, records, backend)
        imu = self.names[0]
        self.rows = [
            _gyro_rows(rows, record, imu, blocks) for rows, record in zip(self.rows, records, strict=True)
        ]
        self._gyro = [rows[:, -EXTRA_COLUMNS] for rows in self.rows]

    def _kernel(self, shape: ThetaShape, backend: str) -> Scan:
        """Return the scan from rows and θ to the residuals."""
        return cached_kernel(self.blocks, shape, backend, _trace)

    def speeds(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment |ν_x| (N,) of the gyro-aided simulation."""
        return [np.abs(outputs[:, 0]) for outputs in self._outputs(theta)]

    def at_estimate(self, theta: np.ndarray) -> Self:
        """Return the residuals with the expected yaw rate in their simulation, given gyro and model at θ.  (4)"""
        yaw_rates = []
        for omega, outputs, record in zip(self._gyro, self._outputs(theta), self.records, strict=True):
            slow_rate = slow_part(omega - outputs[:, 1])
            slow_change = np.column_stack([slow_rate, np.gradient(slow_rate, np.cumsum(record.dt_s))])
            yaw_rates.append(outputs[:, 1:] + slow_change)
        return self.with_columns([-2, -1], yaw_rates)

    def _outputs(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment (N, 3): ν_x with the gyro, the predicted gyro reading, and its derivative."""
        kernel = cached_kernel(self.blocks, self.shape, self.scan.backend, _trace, True)
        return [
            np.asarray(kernel.run(rows, theta[index])[1])
            for rows, index in zip(self.rows, self._index, strict=True)
        ]

    def sigma_and_profile(
        self, misfits: Sequence[np.ndarray], theta: np.ndarray, floor: np.ndarray
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return σ (m,) and, for each segment, its profile (N, m) over the speed. Both are computed from the residuals
        `misfits` at θ, and weight the channels."""
        dt_s = [record.dt_s for record in self.records]
        return slow_noise_profile(misfits, self.masks, self.speeds(theta), dt_s, floor)


def _unknown_s(record: FitRecord, blocks: FittedBlocks, is_delay_free: bool) -> float:
    """Return the time [s] in which commands before the record can still move the vehicle. A free delay is treated as
    the longest delay, so that every search has the same rows."""
    drivetrain, tick_s = blocks.model.drivetrain, float(np.median(record.dt_s))
    delay_s = drivetrain.delay_slots * tick_s if is_delay_free else float(drivetrain.delay_s)
    return delay_s + SETTLING_LAGS * float(drivetrain.longest_lag_s) + float(blocks.sensors[0].delay_s)


def _gyro_rows(rows: np.ndarray, record: FitRecord, imu: str, blocks: FittedBlocks) -> np.ndarray:
    """Return the rows (N, q) with ω_z and its derivative at the end. Raise UsageError with fewer than 2 readings."""
    z, mask, sample_fraction = record.sensors[imu][:3]
    is_measured = mask[:, 2] > 0.0
    if np.sum(is_measured) < 2:
        raise UsageError.of("imu-only.silent-gyro", run=record.name)
    block = blocks.sensors[0]
    delay_s = float(block.delay_s) + float(low_pass_s(block))
    t_s = (
        record.t_s - delay_s
        if sample_fraction is None
        else record.t_s - delay_s - sample_fraction * record.dt_s
    )
    omega = np.interp(record.t_s, t_s[is_measured], z[is_measured, 2])
    slope = np.gradient(omega, np.cumsum(record.dt_s))
    gyro_rows = np.ascontiguousarray(np.concatenate([rows, omega[:, None], slope[:, None]], axis=1))
    gyro_rows.flags.writeable = False
    return gyro_rows


def _trace(blocks: FittedBlocks, shape: ThetaShape, backend: str, rates: bool = False) -> Scan:
    """Return the scan from rows and θ to the residuals (3,). If `rates`, its outputs (3,) are ν_x of the gyro-aided
    simulation, the gyro reading that the commands predict, and its derivative."""
    n = blocks.model.commands
    at_start, sample_fraction = initial_state(blocks, shape), shape.sample_fraction[0]

    def start(theta: np.ndarray) -> GyroAidedState:
        vehicle, (signal,) = at_start(theta)
        return GyroAidedState(vehicle, vehicle, (signal, signal), np.zeros(3 if sample_fraction else 0))

    def step(theta: np.ndarray, state: GyroAidedState, row: np.ndarray) -> tuple[GyroAidedState, np.ndarray]:
        tick_blocks = make_row_blocks(blocks, shape, theta, row[:-EXTRA_COLUMNS])
        imu = tick_blocks.sensors[0]
        nu = np.array([state.gyro_aided.nu[0], state.free.nu[1], state.free.nu[2]])
        aided_nu = tick_blocks.model.init(nu=nu).nu
        free, motion = tick_blocks.model.step(
            state.free._replace(nu=aided_nu), row[1 : 1 + n], row[0], np.zeros(3)
        )
        aided_state, readings = _aided_step(tick_blocks, state.gyro_aided, row)
        if rates:
            reading = imu.h(motion)[2]
            slope = imu.h(motion._replace(nu=motion.nu + motion.nu_dot))[2] - reading
            next_state = state._replace(gyro_aided=aided_state, free=free)
            return next_state, np.array([readings.nu[0], reading, slope])
        aided_signal, accel = step_signal(imu, state.signals[0], readings, row[0])
        free_signal, gyro = step_signal(imu, state.signals[1], motion, row[0])
        h = np.concatenate([accel[:2], gyro[2:]])
        sample_h = h + row[7 + n] * (state.previous_h - h) if sample_fraction else h
        previous_h = h if sample_fraction else state.previous_h
        next_state = GyroAidedState(aided_state, free, (aided_signal, free_signal), previous_h)
        return next_state, row[4 + n : 7 + n] * (row[1 + n : 4 + n] - sample_h)

    width = 7 + n + sum(shape.sample_fraction) + shape.has_voltage + EXTRA_COLUMNS
    return scan(step, start, np.zeros(width), example(blocks, shape), backend=backend)


def _aided_step(tick_blocks: FittedBlocks, state: Tree, row: np.ndarray) -> tuple[Tree, Motion]:
    """Return the state of the gyro-aided simulation after a row, and its motion.  (1)"""
    model, imu, dt_s = tick_blocks.model, tick_blocks.sensors[0], row[0]
    rest_motion = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
    at_rest = imu.h(rest_motion)[2]
    gain = imu.h(rest_motion._replace(nu=np.array([0.0, 0.0, 1.0])))[2] - at_rest
    r, r_dot, u = (row[-2] - at_rest) / gain, row[-1] / gain, row[1 : 1 + model.commands]
    _, effort = tick_effort(model, state.drivetrain, state.eta[2], state.nu, u, dt_s)
    previous_r = state.nu[2]
    state, motion = model.step(state, u, dt_s, np.zeros(3))
    efforts, rates = (effort.start, effort.mean, effort.end), (previous_r, 0.5 * (previous_r + r), r)
    tick = tuple(
        with_yaw_rate(model, *motion_k, r_dot) for motion_k in zip(motion.tick, efforts, rates, strict=True)
    )
    readings = with_yaw_rate(model, motion, effort.last, r, r_dot)
    return state._replace(nu=readings.nu, nu_dot=readings.nu_dot), readings._replace(tick=tick)


def with_yaw_rate(model: Tree, motion: Motion, effort: np.ndarray, r: Any, r_dot: Any) -> Motion:
    """Return the motion of a vehicle with a known yaw rate and yaw acceleration, under an effort (n,)."""
    nu = model.init(nu=np.array([motion.nu[0], motion.nu[1], r])).nu
    nu_dot = model.nu_dot(nu, effort, motion.eta[2])
    nu_dot = np.array([nu_dot[0], nu_dot[1] + model.turning_arm_m * (r_dot - nu_dot[2]), r_dot])
    return motion._replace(nu=nu, nu_dot=nu_dot)


def gyro_aided_paths(blocks: FittedBlocks, free: Sequence[str] | None, vehicle: str) -> list[str]:
    """Return the requested paths `free`, and the position of the IMU along the vehicle. If `free` contains the default
    parameters, also return the delay of a car's commands, and the slip of its tyres, which would act like drag.
    Raise UsageError if the velocity is not a state."""
    model = blocks.model
    if optional.attribute(model, "turning_arm_m") is None:
        raise UsageError.of("imu-only.no-dynamics", vehicle=vehicle, kind=type(model).__name__)
    lever, names = f"sensors.{blocks.sensors._fields[0]}.{LEVER_ARM}", ["+"] if free is None else list(free)
    if not all(path.startswith("+") for path in names):
        return [*names, lever]
    defaults = [f"+{DELAY_PATH}"] if has_offset(model) else []
    return [*defaults, *(f"+{path}" for path in tyre_paths(model)), *names, f"+{lever}"]
