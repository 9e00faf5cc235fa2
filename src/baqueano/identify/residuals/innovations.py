"""Run an extended Kalman filter over the velocity only, small enough to differentiate with respect to all parameters of
a fit.

    x̄ = f(x, e),   P̄ = G P Gᵀ + B diag(v) Bᵀ,               G = ∂f/∂x                                     (1)
    y_c = (z_c − h_c(x̄))/σ_c,   H = ∂h/∂x̄ / σ                                                              (2)
    Δ, P, e, s = correct(P̄, y, H, q),   weights w = 1/(1 + (e/G)⁸)                        (3) kalman.py

x = ν; with a sensor of the pose x = (η, ν). v is the variance that process noise adds to ν in one second, along the
axes of the vehicle's `process_noise_std`; B = ∂ν/∂noise. With v = 0, the state is never corrected, and e is the
residual of the simulation. The weights are a smooth gate: an outlier has almost no effect on state and covariance. A
delayed reading (delay of the sensor, or timestamp between ticks) is compared with its delayed prediction. A mean is
compared with the mean of h (data/averaging.py). Both are linearised at the present state.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field, is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.errors import UsageError
from baqueano.estimators.covariance import block_diagonal
from baqueano.estimators.kalman import Gaussian, boxplus, correct, predict
from baqueano.estimators.readings.sensor_numbers import measurement_jacobian
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.theta import ThetaShape
from baqueano.identify.residuals.motion import example, initial_state, make_row_blocks, read_sensor
from baqueano.sensors.sampling import difference, low_pass_gain
from baqueano.signals import ByName, Motion
from baqueano.symbolic import jacobian, scan, with_value
from baqueano.symbolic.scan import Scan
from baqueano.vehicles import Effort, VehicleState
from baqueano.vehicles.state import tick_effort, tick_end

GATE = 4.0  # G of (3): the gate of the other filters, made smooth
MIN_DERIVATIVE = 1e-9  # derivative below which a sensor does not depend on the pose


class FilterState(NamedTuple):
    """State of the filter."""

    vehicle: VehicleState
    cov: np.ndarray  # (n, n) of ν, or of (η, ν)
    signals: tuple[Tree, ...]  # per sensor, its past
    previous_h: tuple[np.ndarray, ...]  # per sensor, h of the previous row (m,); (0,) if it is not needed


class PredictedState(NamedTuple):
    """State of a vehicle after one row, before the correction."""

    model: Tree
    previous: VehicleState
    dt_s: Value
    eta: np.ndarray  # (3,)
    effort: Effort
    mean: np.ndarray  # x̄ (n,)

    def motion(self, x: np.ndarray) -> Motion:
        """Return the motion at the state x (n,), as the sensors measure it."""
        eta, nu = (self.eta, x) if len(x) == 3 else (x[:3], x[3:])
        drivetrain = self.previous.drivetrain
        return tick_end(self.model, self.previous, eta, nu, drivetrain, self.effort, self.dt_s)[1]


def noise_axes(model: Tree) -> tuple[int, ...]:
    """Return the entries of `process_noise_std` that change ν. Raise UsageError for a vehicle without such entries."""
    if not is_dynamic(model) or not has_field(model, "process_noise_std"):
        raise UsageError.of("cost.no-velocity", "--cost simulation", kind=type(model).__name__)
    kick = _noise_input_matrix(model, 1.0)
    return tuple(i for i in range(3) if np.any(kick[:, i] != 0.0))


def shows_pose(blocks: FittedBlocks) -> bool:
    """Return True if a sensor measures the pose."""
    slopes = [measurement_jacobian(sensor)[:, :3] for sensor in blocks.sensors]
    return any(bool(np.any(np.abs(slope) > MIN_DERIVATIVE)) for slope in slopes)


def filter_kernel(blocks: FittedBlocks, shape: ThetaShape, backend: str) -> Scan:
    """Return a scan over rows (dt, u, z, 1/σ, early) with outputs e (m,) and log s (m,), 0 without a measurement. θ =
    (θ of the simulation, v of each axis, ½ log q of each channel)."""
    n, sizes = blocks.model.commands, [s.size for s in blocks.sensors]
    m, axes = sum(sizes), noise_axes(blocks.model)
    size, columns = 6 if shows_pose(blocks) else 3, 1 + n + 2 * m + shape.extra_columns

    begin = initial_state(blocks, shape)

    def start(theta: np.ndarray) -> FilterState:
        vehicle, signals = begin(theta[: shape.size])
        previous_h = tuple(np.zeros(k if e else 0) for k, e in zip(sizes, shape.sample_fraction, strict=True))
        return FilterState(vehicle, np.zeros((size, size)), signals, previous_h)

    def step(theta: np.ndarray, state: FilterState, row: np.ndarray) -> tuple[FilterState, np.ndarray]:
        tick_blocks = make_row_blocks(blocks, shape, theta, row)
        noise = theta[shape.size :]
        u, z, weight = row[1 : 1 + n], row[1 + n : 1 + n + m], row[1 + n + m : 1 + n + 2 * m]
        model, previous = tick_blocks.model, state.vehicle
        drivetrain, effort = tick_effort(model, previous.drivetrain, previous.eta[2], previous.nu, u, row[0])
        predicted_mean, P = _prediction(
            tick_blocks.model, state, effort, row[0], {i: noise[k] for k, i in enumerate(axes)}
        )
        innovations, jacobians, lines = _innovation(
            tick_blocks.sensors, predicted_mean, state, z, row[1 + n + 2 * m :], row[0], shape
        )
        y, H = weight * np.concatenate(innovations), weight[:, None] * np.concatenate(jacobians)
        is_present = np.where(weight > 0.0, 1.0, 0.0)
        Q = np.exp(2.0 * noise[len(axes) :])
        correction = correct(P, y, H, Q, weight=lambda _c, e, _s: 1.0 / (1.0 + (e / GATE) ** 8))  # (3)
        signals, previous_h = _corrected_signals(
            lines, jacobians, correction.mean_change, shape.sample_fraction
        )
        eta, nu = _corrected_state(predicted_mean, correction.mean_change)
        vehicle = state.vehicle._replace(eta=eta, nu=nu, drivetrain=drivetrain)
        return FilterState(vehicle, correction.cov, signals, previous_h), np.concatenate(
            [correction.e, is_present * np.log(correction.s)]
        )

    theta = np.array([*example(blocks, shape), *np.ones(len(axes)), *np.zeros(m)])
    return scan(step, start, np.zeros(columns), theta, backend=backend)


def _prediction(
    model: Tree, state: FilterState, effort: Effort, dt_s: Value, v: dict[int, Any]
) -> tuple[PredictedState, np.ndarray]:
    """Return the state of the vehicle after one row, and P̄ (n, n).  (1)"""
    previous = state.vehicle

    def f(x: np.ndarray) -> np.ndarray:
        if len(x) == 3:
            return model.advance(previous.eta, x, effort, dt_s)[1]
        eta, nu, _ = model.advance(x[:3], x[3:], effort, dt_s)
        return np.concatenate([eta, nu])

    size = state.cov.shape[0]
    x = previous.nu if size == 3 else np.concatenate([previous.eta, previous.nu])
    B = _noise_input_matrix(model, dt_s)
    R = sum((v[i] * B[:, i][:, None] * B[:, i][None, :] for i in v), np.zeros((3, 3)))
    R = R if size == 3 else block_diagonal([np.zeros((3, 3)), R])
    mean, P, _ = predict(Gaussian(x, state.cov), f, R)
    eta = model.advance(previous.eta, previous.nu, effort, dt_s)[0]
    return PredictedState(model, previous, dt_s, eta, effort, mean), P


def _innovation(
    sensors: ByName[Tree],
    prediction: PredictedState,
    state: FilterState,
    z: np.ndarray,
    extra: np.ndarray,
    dt_s: Value,
    shape: ThetaShape,
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return for each sensor z − h (m,), ∂h/∂x̄ (m, n), and its signal with h after the low-pass, without delay."""
    innovations, jacobians, lines, offset = [], [], [], 0
    mean_weights, fractions = shape.mean_weights(sensors._fields, extra), shape.sample_fractions(extra)
    motion = prediction.motion(prediction.mean)
    for k, sensor in enumerate(sensors):
        signal, newest_h = read_sensor(sensor, state.signals[k], motion, dt_s, mean_weights[k])
        h = signal.low_passed if mean_weights[k] is None and len(signal.low_passed) else sensor.h(motion)
        if fractions[k] is not None:
            newest_h = newest_h + fractions[k] * difference(sensor, state.previous_h[k], newest_h)
        innovations.append(difference(sensor, z[offset : offset + sensor.size], newest_h))
        h_jacobian = jacobian(lambda x, s=sensor: s.h(prediction.motion(x)))(prediction.mean)
        jacobians.append(low_pass_gain(sensor, dt_s) * h_jacobian)
        lines.append((signal, h))
        offset += sensor.size
    return innovations, jacobians, lines


def _noise_input_matrix(model: Tree, dt_s: Value) -> np.ndarray:
    """Return B = ∂ν/∂noise (3, 3) over a row, per unit of `process_noise_std`."""
    unit = with_value(model, "process_noise_std", np.ones(3))
    u = np.zeros(model.commands)
    return jacobian(lambda noise: unit.step(unit.init(), u, dt_s, noise)[0].nu)(np.zeros(3))


def _corrected_state(prediction: PredictedState, move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return η (3,) and ν (3,) after the correction."""
    if len(move) == 3:
        return prediction.eta, prediction.mean + move
    x = boxplus(prediction.mean, move)
    return x[:3], x[3:]


def _corrected_signals(
    lines: list[Any], jacobians: list[Any], move: np.ndarray, sample_fraction: tuple[bool, ...]
) -> Any:
    """Return the signals and h of this row after the correction."""
    signals, previous_h = [], []
    for (signal, h), h_jacobian, is_needed in zip(lines, jacobians, sample_fraction, strict=True):
        correction, past = h_jacobian @ move, signal.past_values
        if past.shape[0]:
            past = np.concatenate([(past[0] + correction)[None, :], past[1:]])
        low_passed = signal.low_passed + correction if len(signal.low_passed) else signal.low_passed
        signals.append(signal._replace(past_values=past, low_passed=low_passed))
        previous_h.append(h + correction if is_needed else np.zeros(0))
    return tuple(signals), tuple(previous_h)
