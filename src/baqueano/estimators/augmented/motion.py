"""Process model of the augmented state: the mean one row later, and the covariance of its noise.

    x = (η, ν, d, κ, β, γ, w, b, φ):  pose, velocity, disturbance, scales, course, sideslip, bend, biases, slope (1)
    ν̇ = f(ν, e) + D,  D = (d_x, l d_ψ, d_ψ),  or  ν = V e + D,  D = (d_x, 0, d_ψ);   η̇ = J(ψ) (1 + K) ν     (2)
    K ν = (κ_v ν_x, κ_v ν_y + β ν_x + γ (ν_y − l ν_ψ), κ_ψ ν_ψ),   ∂ψ̇/∂b = −(1 − p)/h_ψ of a gyro, p of state.py  (10)
    ḋ = −(d − d̄)/T + noise  (Ornstein-Uhlenbeck, σ_d² about d̄),  d̄˙ = (d − d̄)/2 s;   γ̇ = −γ/T_γ + noise  (3)
    displacement += −w λ s / (1 + s/2) J(ψ) ν δ,   s the variance of the heading, w ~ N(0, 1)              (4)
    P_xx, P_yy += 2 T_s (σ_s ν_x)² δ,   var ν_x += (σ_s ν_x)² as reported:   slip, σ_s, T_s of a wheel    (5)
    var ν_x += (ν̇_x τ)²/3,  (σ_y ν_ψ)²   as reported; τ between readings of a wheel; σ_y: no speed sensor  (6)
    var ν_y += σ² ∫ g^(2 s/δ) ds = σ² δ (1 + 4 g + g²)/6,  s from 0 to δ,  g = ∂ν_y⁺/∂ν_y                  (7)
    K ν_x = (κ_v e + c κ_ψ) ν_x,  e² = ((|ν_x| − v₀)² + (σ₀/σ₁)²)/ν_x²,  κ_v ~ N(0, σ₁²): no speed sensor   (8)
    half of D before f and half after:   ν⁺ = δ D/2 + F(ν + δ D/2),   ∫ν −= δ² (f(ν⁺, e) − f(ν⁺ − δ D/2, e))/6   (9)

e: effort; J: rotation; δ: row; σ: walk of ν_y; P: covariance; l: the origin ahead of the centre of turning. d̄ prevents
that an error in a whole bend turns the heading. κ, β, w, φ: constant; h_ψ: a slope. Derivations of (4)-(7), (9), (10).
"""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.noise_levels import NoiseLevels
from baqueano.estimators.augmented.state import (
    BEND_INDEX,
    BIAS_INDEX,
    MAX_SILENT_S,
    SCALE_INDEX,
    SIDESLIP_INDEX,
    SLOPE_STATES,
    layout,
)
from baqueano.estimators.covariance import CHI_SQUARE_95, block_diagonal
from baqueano.estimators.kalman import Gaussian, StatePrediction, predict
from baqueano.estimators.pauses import FilterRow, limit_covariance, limiting_factors, unpredicted_cov
from baqueano.estimators.readings.sensor_numbers import slip_statistics
from baqueano.geometry import map_from_body, wrap
from baqueano.symbolic import chain_rule
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import DynamicVehicle

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedBelief, AugmentedEkf


MEAN_DISTURBANCE_S = 2.0  # time constant with which d̄ follows d: about one bend of the path
SIDESLIP_ERROR_S = 20.0  # T_γ: the next bends have about the same error of the sideslip
MIN_VARIANCE = 1e-12  # (m/s²)², (rad/s²)²: of no disturbance
MIN_SPEED_M_S = 0.02  # below it, the error of the speed fades to 0
BEND_STD = 0.5 * 1.96**2 / np.sqrt(CHI_SQUARE_95 - 1.96**2)  # λ of (4)


def predict_row(
    estimator: "AugmentedEkf", belief: "AugmentedBelief", effort: Effort, row: FilterRow, variance: np.ndarray,
    at_rest: Value = False,
) -> StatePrediction:  # fmt: skip
    """Return mean, covariance and G of the state one row later; `variance` is σ_d² (2,) in this row. `at_rest` is
    that of the row before.  (2)-(4), (10)"""
    x, n = Gaussian(belief.mean, belief.cov), len(belief.mean)
    # a calm drive lowers the level, but a lasting d̄ shows at least the variance d̄²
    mean_level = np.minimum(belief.mean_disturbance**2 / np.maximum(variance, MIN_VARIANCE), 1.0)
    noise_level = np.maximum(NoiseLevels.from_row(belief.memory.noise_levels).motion, mean_level)
    walks = [
        np.array([bias.value_at(estimator.sensors, bias.walk) ** 2 * row.dt_s])
        for bias in layout(estimator).biases
    ]

    def R(mean: np.ndarray, G: np.ndarray) -> np.ndarray:
        gamma = estimator.sideslip_error_std**2 * (1.0 - G[SIDESLIP_INDEX, SIDESLIP_INDEX] ** 2)
        zeros_before, zeros_after = np.zeros(SIDESLIP_INDEX - SCALE_INDEX), np.zeros(BIAS_INDEX - BEND_INDEX)
        walks_and_slope = [*walks, np.zeros(SLOPE_STATES * layout(estimator).has_slope)]
        slow_cov = np.diag(np.concatenate([zeros_before, np.array([gamma]), zeros_after, *walks_and_slope]))
        rest_cov = unpredicted_cov(row, mean, x.cov) + slip_covariance(estimator, mean, row.dt_s)
        return block_diagonal(
            [process_noise_cov(estimator, mean[2], row, G[4, 4], noise_level, variance), slow_cov]
        ) + block_diagonal([rest_cov, np.zeros((n - 3, n - 3))])

    turn_derivative = np.where(at_rest, 0.0, row.dt_s) * layout(estimator).yaw_rate_by_bias

    def g(mean: np.ndarray) -> np.ndarray:
        prediction = advance_mean(
            estimator, mean, belief.mean_disturbance, effort, row.predicted_s, x.cov[2, 2]
        )
        turn = turn_derivative @ (mean - x.mean)  # 0, but its derivative is not  (10)
        return np.concatenate([prediction[:2], np.array([prediction[2] + turn]), prediction[3:]])

    motion = predict(x, g, R)
    D = limiting_factors(motion.cov)
    return StatePrediction(motion.mean, limit_covariance(motion.cov), D[:, None] * motion.G)


def advance_mean(
    estimator: "AugmentedEkf",
    mean: np.ndarray,
    mean_disturbance: np.ndarray,
    effort: Effort,
    dt_s: Value,
    heading_variance: Value = 0.0,
) -> np.ndarray:
    """Return the mean (n,) after a row; `heading_variance` [rad²] is the variance of the heading before it.  (2)-(4)"""
    vehicle, d, nu = estimator.vehicle, mean[6:SCALE_INDEX], mean[3:6]
    D = disturbance_acceleration(vehicle, d)
    if is_dynamic(vehicle):  # (9)

        def advance(x: np.ndarray) -> np.ndarray:
            return np.concatenate(vehicle.advance(x[:3], x[3:], effort, dt_s))

        motion = chain_rule(advance)(np.concatenate([mean[:3], nu + 0.5 * dt_s * D]))  # d has the effect of ν
        eta, nu_next, nu_dot = motion[:3], motion[3:6] + 0.5 * dt_s * D, motion[6:]
        displacement = -(dt_s**2) / 6.0 * (vehicle.nu_dot(nu_next, effort.last, eta[2]) - nu_dot)
    else:
        eta, nu_next, _ = vehicle.advance(mean[:3], nu, effort, dt_s)
        nu_next, displacement = nu_next + D, dt_s * D
    scale_displacement = dt_s * velocity_error(estimator, mean, 0.5 * (nu + nu_next))
    bend_loss = 0.5 * dt_s * mean[BEND_INDEX] * BEND_STD * heading_variance / (1.0 + 0.5 * heading_variance)
    scale_displacement = scale_displacement - bend_loss * np.array([1.0, 1.0, 0.0]) * (nu + nu_next)
    eta = eta + map_from_body(eta[2]) @ (displacement + scale_displacement)
    next_disturbance = mean_disturbance + (d - mean_disturbance) * np.exp(
        -dt_s / estimator.disturbance_fade_s
    )
    # an exponential would take a fifth of the row
    gamma = mean[SIDESLIP_INDEX] / (1.0 + dt_s / SIDESLIP_ERROR_S)
    slow_states = (mean[SCALE_INDEX:SIDESLIP_INDEX], np.array([gamma]), mean[BEND_INDEX:])
    return np.concatenate([eta[:2], np.array([wrap(eta[2])]), nu_next, next_disturbance, *slow_states])


def next_mean_disturbance(
    previous: np.ndarray, d: np.ndarray, silent_s: np.ndarray, dt_s: Value
) -> np.ndarray:
    """Return d̄ (2,) one row later; `silent_s` (2,) is the time since a reading corrected d.  (3)"""
    d = np.where(silent_s > MAX_SILENT_S, 0.0, d)
    return previous + (d - previous) * (1.0 - np.exp(-dt_s / MEAN_DISTURBANCE_S))


def disturbance_acceleration(vehicle: DynamicVehicle, d: np.ndarray) -> np.ndarray:
    """Return D (3,), the acceleration (or velocity, in a kinematic model) that the disturbance d (2,) adds.  (2)"""
    return _push_matrix(vehicle) @ np.array([d[0], 0.0, d[1]])


def disturbance_variance(estimator: "AugmentedEkf", mean: np.ndarray, effort: Effort) -> np.ndarray:
    """Return σ_d² (2,) in a row. For the yaw rate, σ_d² + (τ_d ∂f_ψ/∂e ė)²: an error τ_d of the motors' time constant
    acts only while their effort e changes. `mean` (n,) is the state before the row."""
    vehicle, nu, psi = estimator.vehicle, mean[3:6], mean[2]
    if not has_motor_lag(vehicle):
        return estimator.disturbance_std**2
    change = estimator.motor_lag_std_s * effort.mean_rate
    f = [vehicle.nu_dot(nu, effort.last + side * change, psi)[2] for side in (0.5, -0.5)]
    return estimator.disturbance_std**2 + np.array([0.0, (f[0] - f[1]) ** 2])


def next_unmeasured_variance(
    estimator: "AugmentedEkf", previous: np.ndarray, variance: np.ndarray, dt_s: Value
) -> np.ndarray:
    """Return the variance (2,) of d one row later, without any measurement; `variance` is σ_d² of the row.  (3)"""
    return variance + (previous - variance) * np.exp(-2.0 * dt_s / estimator.disturbance_fade_s)


def has_motor_lag(vehicle: DynamicVehicle) -> bool:
    """Return True for a dynamic model whose motors have a lag; without a lag, ė is not known."""
    return is_dynamic(vehicle) and vehicle.drivetrain.has_lag


def slip_covariance(estimator: "AugmentedEkf", mean: np.ndarray, dt_s: Value) -> np.ndarray:
    """Return the covariance (3, 3) that the slip of the wheels adds to the pose in a row.  (5)"""
    variance, fade_s, _ = _slip_values(estimator)
    return np.diag(np.array([1.0, 1.0, 0.0])) * (2.0 * fade_s * dt_s * variance * mean[3] ** 2)


def reported_velocity_cov(estimator: "AugmentedEkf", nu: np.ndarray, gain: Value) -> np.ndarray:
    """Return the covariance (3, 3) that ν has beside that of the state; `gain` is ν̇_x of the model [m/s²].  (5), (6)"""
    variance, _, period_s = _slip_values(estimator)
    offset_m = 0.0 if layout(estimator).speed_is_measured else estimator.lateral_offset_std_m
    speed_variance = variance * nu[0] ** 2 + (period_s * gain) ** 2 / 3.0 + (offset_m * nu[2]) ** 2
    return np.diag(np.array([speed_variance, 0.0, 0.0]))


def process_noise_cov(
    estimator: "AugmentedEkf", psi: Value, row: FilterRow, nu_y_factor: Value, noise_level: np.ndarray,
    variance: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the covariance (8, 8) that a row adds to (η, ν, d): the walks of ν and d, and their displacement.

    The displacement has the variance σ² δ³/3: σ² δ³/4 is correlated with the change of ν, σ² δ³/12 is not. The change
    of ν by d is computed in the same manner. `nu_y_factor` is the part of ν_y that remains after a row.  (7)
    `noise_level` (2,) multiplies the variances of the speed, and of the yaw rate with the sideways velocity.
    `variance` is σ_d² (2,).
    """
    W, E = _push_matrix(estimator.vehicle), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    J, D, predicted_s = map_from_body(psi) @ W, W @ E, row.predicted_s
    d = noise_level * variance * (1.0 - np.exp(-2.0 * row.dt_s / estimator.disturbance_fade_s))
    walk = estimator.velocity_walk_std**2 * row.dt_s * noise_level[[0, 1, 1]]
    nu_gain, eta_gain = D, 0.5 * predicted_s * J @ E
    if is_dynamic(estimator.vehicle):
        sideways_factor = np.maximum(nu_y_factor, 0.0)
        fading_weights = np.array([1.0, (1.0 + sideways_factor * (4.0 + sideways_factor)) / 6.0, 1.0])
        walk = walk * fading_weights + predicted_s**2 / 12.0 * (E @ d)
        nu_gain, eta_gain = 0.5 * predicted_s * D, predicted_s**2 / 6.0 * J @ E
    displacement, zeros = predicted_s * J, np.zeros((3, 3))
    rows = [
        (0.5 * displacement, eta_gain, displacement),
        (W, nu_gain, zeros),
        (zeros[:2], np.eye(2), zeros[:2]),
    ]
    B = np.concatenate([np.concatenate(row, axis=1) for row in rows])
    return (B * np.concatenate([walk, d, walk / 12.0])) @ B.T


def velocity_error(estimator: "AugmentedEkf", x: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Return K ν (3,), the error of the velocity due to scale errors and course in the state x (n,).  (2), (8)

    A sloping floor pushes in the direction φ of the map: K ν_x += (φ_x cos ψ + φ_y sin ψ) ν_x²/(ν_x² + MIN_SPEED_M_S²).
    """
    kappa, push = x[SCALE_INDEX:BIAS_INDEX], 0.0
    if layout(estimator).has_slope:
        speed_share = nu[0] ** 2 / (nu[0] ** 2 + MIN_SPEED_M_S**2)  # friction holds a vehicle at rest
        push = speed_share * (x[-2] * np.cos(x[2]) + x[-1] * np.sin(x[2]))
    c = 0.0 if layout(estimator).speed_is_measured else estimator.speed_per_gyro_scale
    scale = kappa[0] * _speed_error_shape(estimator, nu[0]) + c * kappa[1]
    sideslip = nu[1] - optional.turning_arm_m(estimator.vehicle) * nu[2]
    sideways = scale * nu[1] + kappa[2] * nu[0] + kappa[3] * sideslip
    return np.array([scale * nu[0] + push, sideways, kappa[1] * nu[2]])


def _speed_error_shape(estimator: "AugmentedEkf", speed: Value) -> Value:
    """Return e, the error of the speed at `speed` [m/s] relative to its scale error κ_v.  (8)"""
    if layout(estimator).speed_is_measured:
        return 1.0
    std, least_error_speed = estimator.speed_error_std, estimator.least_error_speed_m_s
    magnitude, slope = np.sqrt(speed**2 + MIN_SPEED_M_S**2), np.where(std[1] > 0.0, std[1], 1.0)
    relative = np.sqrt((std[0] / slope) ** 2 + (magnitude - least_error_speed) ** 2) / magnitude
    return np.where(std[1] > 0.0, relative, 1.0)


def _push_matrix(vehicle: DynamicVehicle) -> np.ndarray:
    """Return the matrix (3, 3) from a disturbance (forward, sideways, in rotation) to the change of ν."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, optional.turning_arm_m(vehicle)], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=256)
def _slip_values(estimator: "AugmentedEkf") -> tuple[Value, Value, Value]:
    """Return the relative variance of the slip, its decay time [s], and the time between wheel readings [s]."""
    states = layout(estimator)
    return slip_statistics(estimator.sensors, dict(zip(states.names, states.entries, strict=True)))
