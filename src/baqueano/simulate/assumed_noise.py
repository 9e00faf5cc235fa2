"""Simulate vehicles with the noise that a filter assumes, and return the errors of the filter on them.

Each drive draws its start, scales, course and biases. Its walks, disturbances and slips are integrated in TICK_PARTS
parts of a tick, with half of a walk before and half after each (Strang). Its readings come from the sensors' own step.
Nothing here is linearised, and no covariance is propagated, so effects that the filter neglects show in the result.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.augmented.motion import (
    SIDESLIP_ERROR_S,
    disturbance_acceleration,
    disturbance_variance,
    velocity_error,
)
from baqueano.estimators.augmented.state import (
    BEND_INDEX,
    BIAS_INDEX,
    SCALE_INDEX,
    SIDESLIP_INDEX,
    layout,
    start_std,
)
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.pauses import split_ticks
from baqueano.estimators.readings.sensor_numbers import slip_statistics
from baqueano.geometry import map_from_body, wrap
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS, Motion, Slot, Tick, sensor_slots
from baqueano.symbolic import scan, value_at_path, with_value
from baqueano.symbolic.scan import Scan
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import tick_effort

DRIVES, DRIVE_S, TICK_PARTS = 40, 20.0, 4
TICKS = {"c": 80_000, "python": 8_000}  # of all drives; 0 without compiled or generated code
MIN_TICKS = 100  # ticks of a drive
MIN_VARIANCE = 1e-30  # added to a variance


class SimulatedState(NamedTuple):
    """State of a vehicle with the noise that the filter assumes."""

    x: np.ndarray  # (n,) of augmented/state.py
    slip: Value  # relative to ν_x, by which the wheels turn faster
    motion: Motion  # at the end of the last tick
    drivetrain: DrivetrainState
    sensors: tuple[Tree, ...]


class DrawnTick(NamedTuple):
    """Commands and random numbers of one tick."""

    u: np.ndarray  # (commands,)
    walk: np.ndarray  # (TICK_PARTS, 2, 3) standard normal, like all fields below
    d: np.ndarray  # (3,) of the disturbance, and of the sideslip's error γ
    bias: np.ndarray  # (nb,)
    slip: Value
    reading: tuple[np.ndarray, ...]  # (m,) of each sensor


def simulated_errors(ekf: AugmentedEkf, run: Run, filter_kernel: Scan) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (DRIVES, N, 6) of the filter on vehicles that are driven as in `run`, and their covariances.

    The drives have the commands of the run, without its rests.

    `filter_kernel` runs the filter: its last outputs are η, ν and the covariance. Return empty arrays if the run is too
    short, for a kinematic model, and without compiled or generated code.
    """
    filter_layout, dt_s, rng = layout(ekf), 1.0 / ekf.rate_hz, np.random.default_rng(0)
    u = run.applied_commands[
        np.isfinite(run.applied_commands).all(axis=1) & np.any(run.applied_commands != 0.0, axis=1)
    ]
    u = np.ascontiguousarray(u[: min(round(DRIVE_S / dt_s), TICKS.get(filter_kernel.backend, 0) // DRIVES)])
    if len(u) < MIN_TICKS or not is_dynamic(ekf.vehicle):
        return np.zeros((0, 0, 6)), np.zeros((0, 0, 6, 6))
    state, n = _start(ekf, np.zeros(filter_layout.size)), len(u)
    sizes, bias_count = [sensor.size for sensor in ekf.sensors], len(filter_layout.biases)
    no_noise = np.zeros((TICK_PARTS, 2, 3)), np.zeros(3), np.zeros(bias_count), 0.0
    example = DrawnTick(u[0], *no_noise, tuple(map(np.zeros, sizes)))
    drive = scan(lambda x, draws: _tick(ekf, x, draws, dt_s), state, example, backend=filter_kernel.backend)
    t_ns: Any = np.round(np.arange(1, n + 1) * dt_s * NANOSECONDS).astype(np.int64)
    errors, covs = [], []
    for _ in range(DRIVES):
        begin = _start(ekf, start_std(ekf) * rng.standard_normal(filter_layout.size))
        shapes = (n, TICK_PARTS, 2, 3), (n, 3), (n, bias_count), (n,)
        walk, d, bias, slip = map(rng.standard_normal, shapes)
        draws = DrawnTick(u, walk, d, bias, slip, tuple(rng.standard_normal((n, m)) for m in sizes))
        _, (truth, slots) = drive.run(draws, carry=begin)
        rows, tick_rows = split_ticks(Tick(t_ns, u, slots), ekf.rate_hz)
        eta, nu, cov = (output_rows[tick_rows] for output_rows in filter_kernel.run(rows)[1][-3:])
        e = np.concatenate([eta, nu], axis=1) - truth
        e[:, 2] = wrap(e[:, 2])
        errors.append(e)
        covs.append(cov)
    return np.stack(errors), np.stack(covs)


def _start(ekf: AugmentedEkf, x: np.ndarray) -> SimulatedState:
    """Return the state of a vehicle that begins with x (n,)."""
    x[BEND_INDEX] = 0.0
    motion = Motion(x[:3], x[3:6], np.zeros(3), np.zeros(2))
    sensors = tuple(sensor.init() for sensor in ekf.sensors)
    return SimulatedState(x, 0.0, motion, ekf.vehicle.drivetrain.init(), sensors)


def _tick(
    ekf: AugmentedEkf, state: SimulatedState, draws: DrawnTick, dt_s: float
) -> tuple[SimulatedState, Any]:
    """Return the state after one tick, and (η, (1 + K) ν) (6,) with the readings of the sensors."""
    filter_layout, x = layout(ekf), state.x
    drivetrain, effort = tick_effort(ekf.vehicle, state.drivetrain, x[2], x[3:6], draws.u, dt_s)
    eta, nu, motions = x[:3], x[3:6], []
    for k in range(TICK_PARTS):
        eta, nu = _step_part(ekf, x, eta, nu, effort, k, draws.walk[k], dt_s)
        motions.append(_motion(ekf, x, eta, nu, _effort_at(effort, (k + 1) / TICK_PARTS)))
    current_motion = _motion(ekf, x, eta, nu, effort.last)
    variances = (disturbance_variance(ekf, x, effort), np.array([ekf.sideslip_error_std**2]))
    decay = np.exp(-dt_s / np.concatenate([ekf.disturbance_fade_s, np.array([SIDESLIP_ERROR_S])]))
    std = np.sqrt(np.concatenate(variances) * (1.0 - decay**2))
    *d, gamma = decay * x[[6, 7, SIDESLIP_INDEX]] + std * draws.d
    walks = [entry.value_at(ekf.sensors, entry.walk) * np.sqrt(dt_s) for entry in filter_layout.biases]
    bias, slope = x[BIAS_INDEX : BIAS_INDEX + len(walks)], x[BIAS_INDEX + len(walks) :]
    bias = bias + np.array(walks) * draws.bias if walks else bias
    entries = dict(zip(filter_layout.names, filter_layout.entries, strict=True))
    variance, fade_s, _ = slip_statistics(ekf.sensors, entries)
    slip_decay = np.exp(-dt_s / fade_s)
    slip = slip_decay * state.slip + np.sqrt(variance * (1.0 - slip_decay**2)) * draws.slip
    scales = (x[SCALE_INDEX:SIDESLIP_INDEX], np.array([gamma]), x[BEND_INDEX:BIAS_INDEX])
    next_x = np.concatenate([eta, nu, np.array(d), *scales, bias, slope])
    truth = current_motion._replace(tick=(state.motion, motions[TICK_PARTS // 2 - 1], motions[-1]))
    factors = np.min(filter_layout.moving_jacobian_factor, axis=0)
    shown_bias = factors[BIAS_INDEX : BIAS_INDEX + len(walks)] * bias
    sensors, slots = _read_sensors(ekf, state, shown_bias, slip, truth, draws, dt_s)
    state_read = np.concatenate([eta, nu + _velocity_error(ekf, x, nu)])
    return SimulatedState(next_x, slip, current_motion, drivetrain, sensors), (state_read, slots)


def _step_part(
    ekf: AugmentedEkf, x: np.ndarray, eta: np.ndarray, nu: np.ndarray, effort: Effort, k: int,
    walk: np.ndarray, dt_s: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return η (3,) and ν (3,) after one part of a tick."""
    h, kick = dt_s / TICK_PARTS, ekf.velocity_walk_std * np.sqrt(0.5 * dt_s / TICK_PARTS)
    begin, end = _effort_at(effort, k / TICK_PARTS), _effort_at(effort, (k + 1) / TICK_PARTS)
    kicked_nu = nu + kick * walk[0]
    rates = [(end - begin) / h] * 3
    _, nu, _ = ekf.vehicle.advance(eta, kicked_nu, Effort(begin, end, end, *rates), h)
    nu = nu + h * disturbance_acceleration(ekf.vehicle, x[6:SCALE_INDEX])
    mean_nu = 0.5 * (kicked_nu + nu)
    displacement = h * (mean_nu + _velocity_error(ekf, x, mean_nu))
    position = eta[:2] + (map_from_body(eta[2] + 0.5 * displacement[2]) @ displacement)[:2]
    return np.array([position[0], position[1], wrap(eta[2] + displacement[2])]), nu + kick * walk[1]


def _velocity_error(ekf: AugmentedEkf, x: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Return the errors (3,) of the velocity by scales, course and the bias of a gyro: no innovation shows them."""
    by_bias = np.array([0.0, 0.0, layout(ekf).yaw_rate_by_bias @ x])
    return velocity_error(ekf, x, nu) + by_bias


def _effort_at(effort: Effort, fraction: float) -> np.ndarray:
    return effort.start + fraction * (effort.end - effort.start)


def _motion(ekf: AugmentedEkf, x: np.ndarray, eta: np.ndarray, nu: np.ndarray, effort: np.ndarray) -> Motion:
    nu_dot = ekf.vehicle.nu_dot(nu, effort, eta[2]) + disturbance_acceleration(ekf.vehicle, x[6:SCALE_INDEX])
    return Motion(eta, nu, nu_dot, ekf.vehicle.gravity(eta[2]))


def _read_sensors(
    ekf: AugmentedEkf, state: SimulatedState, bias: np.ndarray, slip: Value, now: Motion, draws: DrawnTick,
    dt_s: float,
) -> tuple[tuple[Tree, ...], Tree]:  # fmt: skip
    """Return the states of the sensors and their readings, which contain the biases and the slip of the wheels."""
    names, slip_factors = ekf.sensors._fields, np.array([1.0 + slip, 1.0, 1.0])
    rolling = [motion._replace(nu=slip_factors * motion.nu) for motion in (now, *(now.tick or ()))]
    states, slots = [], []
    for k, (name, sensor) in enumerate(zip(names, ekf.sensors, strict=True)):
        sensor_biases = [
            (j, entry.path) for j, entry in enumerate(layout(ekf).biases) if entry.sensor == name
        ]
        Q = np.linalg.cholesky(sensor.cov + MIN_VARIANCE * np.eye(sensor.size))
        for j, path in sensor_biases:
            sensor = with_value(sensor, path, value_at_path(sensor, path) + bias[j])
        motions = now if sensor_biases else rolling[0]._replace(tick=tuple(rolling[1:]))
        next_state, slot = sensor.step(state.sensors[k], motions, dt_s, np.zeros(sensor.noise_size))
        z = np.where(slot.is_new > 0.0, slot.z + Q @ draws.reading[k], 0.0)
        states.append(next_state)
        slots.append(Slot(slot.is_new, z))
    return tuple(states), sensor_slots(names)(*slots)
