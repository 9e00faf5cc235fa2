"""Process model of the augmented state: the mean one row later, and the covariance of its noise.

    x = (η, ν, d, κ, β, w, b):  pose, velocity, disturbance, scale errors, course, bend, biases               (1)
    dynamic model      ν̇ = f(ν, e) + D,      D = (d_x, l d_ψ, d_ψ) [m/s², rad/s²], η̇ = J(ψ) (1 + K) ν        (2)
    kinematic model    ν = V e + D,           D = (d_x, 0, d_ψ) [m/s, rad/s]
    K ν = (κ_v ν_x, κ_v ν_y + β ν_x, κ_ψ ν_ψ)
    ḋ = −(d − d̄)/T + noise  (Ornstein-Uhlenbeck, σ_d² about d̄),  d̄˙ = (d − d̄)/2 s,  κ̇ = β̇ = ẇ = 0,  ḃ = noise  (3)
    displacement += −w √¾ s / (1 + s/2) J(ψ) ν δ,   s the variance of the heading, w ~ N(0, 1)             (4)
    P_xx, P_yy += 2 T_s (σ_s ν_x)² δ,   var ν_x += (σ_s ν_x)² as reported:   slip, σ_s, T_s of a wheel    (5)
    var ν_x += (ν̇_x τ)²/3   as reported, τ the time between two readings of a wheel                       (6)
    var ν_y += σ² ∫ g^(2 s/δ) ds = σ² δ (1 + 4 g + g²)/6,  s from 0 to δ,  g = ∂ν_y⁺/∂ν_y                  (7)

e: effort; J: rotation; δ: row; σ: walk of ν_y; P: covariance. l is the distance of the origin ahead of the centre of
turning: a turn moves the origin sideways. d̄ follows d slowly: otherwise a model that is wrong in a whole bend would
pull the heading away from the gyro. docs/derivations/kalman.md derives (4) to (7).
"""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.state import BEND, BIASES, SCALES, layout
from baqueano.estimators.covariance import block_diagonal
from baqueano.estimators.kalman import Gaussian, predict
from baqueano.estimators.pauses import FilterRow, limit_covariance, unmoved_cov
from baqueano.estimators.readings.sensor_numbers import slips
from baqueano.geometry import map_from_body, wrap
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import DynamicVehicle

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedEkf


SLOW_S = 2.0  # time constant with which d̄ follows d: about one bend of the path


def ahead(
    estimator: "AugmentedEkf", x: Gaussian, slow: np.ndarray, effort: Effort, row: FilterRow
) -> Gaussian:
    """Return mean (n,) and covariance (n, n) of the state one row later; `slow` (2,) is d̄.  (2)-(4)"""
    n = len(x.mean)
    walks = [
        np.array([bias.of(estimator.sensors, bias.walk) ** 2 * row.dt_s]) for bias in layout(estimator).biases
    ]
    constant = np.diag(np.concatenate([np.zeros(BIASES - SCALES), *walks]))

    def R(mean: np.ndarray, G: np.ndarray) -> np.ndarray:
        unsure = unmoved_cov(row, mean, x.cov) + slip_covariance(estimator, mean, row.dt_s)
        return block_diagonal(
            [process_noise_cov(estimator, mean[2], row, G[4, 4]), constant]
        ) + block_diagonal([unsure, np.zeros((n - 3, n - 3))])

    motion = predict(x, lambda mean: move(estimator, mean, slow, effort, row.moved_s, x.cov[2, 2]), R)
    return Gaussian(motion.mean, limit_covariance(motion.cov))


def move(
    estimator: "AugmentedEkf",
    mean: np.ndarray,
    slow: np.ndarray,
    effort: Effort,
    dt_s: Value,
    spread: Value = 0.0,
) -> np.ndarray:
    """Return the mean (n,) after a row; `spread` [rad²] is the variance of the heading before it.  (2)-(4)"""
    vehicle, d, nu = estimator.vehicle, mean[6:SCALES], mean[3:6]
    D = disturbance_acceleration(vehicle, d)
    step, way = (dt_s, 0.5 * dt_s**2) if is_dynamic(vehicle) else (1.0, dt_s)
    eta, nu_next, _ = vehicle.advance(mean[:3], nu, effort, dt_s)
    nu_next = nu_next + step * D
    along = 0.5 * dt_s * velocity_error(mean[SCALES:BIASES], nu + nu_next)
    short = 0.5 * dt_s * mean[BEND] * np.sqrt(0.75) * spread / (1.0 + 0.5 * spread)
    along = along - short * np.array([1.0, 1.0, 0.0]) * (nu + nu_next)
    eta = eta + map_from_body(eta[2]) @ (way * D + along)
    fading = slow + (d - slow) * np.exp(-dt_s / estimator.disturbance_fade_s)
    return np.concatenate([eta[:2], np.array([wrap(eta[2])]), nu_next, fading, mean[SCALES:]])


def slow_part(previous: np.ndarray, d: np.ndarray, dt_s: Value) -> np.ndarray:
    """Return d̄ (2,) one row later.  (3)"""
    return previous + (d - previous) * (1.0 - np.exp(-dt_s / SLOW_S))


def disturbance_acceleration(vehicle: DynamicVehicle, d: np.ndarray) -> np.ndarray:
    """Return D (3,), the acceleration (or velocity, in a kinematic model) that the disturbance d (2,) adds.  (2)"""
    return _to_axes(vehicle) @ np.array([d[0], 0.0, d[1]])


def slip_covariance(estimator: "AugmentedEkf", mean: np.ndarray, dt_s: Value) -> np.ndarray:
    """Return the covariance (3, 3) that the slip of the wheels adds to the pose in a row.  (5)"""
    variance, fade_s, _ = _slips(estimator)
    return np.diag(np.array([1.0, 1.0, 0.0])) * (2.0 * fade_s * dt_s * variance * mean[3] ** 2)


def wheel_velocity_cov(estimator: "AugmentedEkf", speed: Value, gain: Value) -> np.ndarray:
    """Return the covariance (3, 3) of ν relative to the wheels; `gain` is ν̇_x of the model [m/s²].  (5), (6)"""
    variance, _, period_s = _slips(estimator)
    return np.diag(np.array([variance * speed**2 + (period_s * gain) ** 2 / 3.0, 0.0, 0.0]))


def process_noise_cov(estimator: "AugmentedEkf", psi: Value, row: FilterRow, kept: Value) -> np.ndarray:
    """Return the covariance (8, 8) that a row adds to (η, ν, d): the walks of ν and d, and their displacement.

    The displacement has the variance σ² δ³/3: σ² δ³/4 is correlated with the change of ν, σ² δ³/12 is not. The change
    of ν by d is computed in the same manner. `kept` is the part of ν_y that remains after a row.  (7)
    """
    W, E = _to_axes(estimator.vehicle), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    J, D, moved_s = map_from_body(psi) @ W, W @ E, row.moved_s
    d = estimator.disturbance_std**2 * (1.0 - np.exp(-2.0 * row.dt_s / estimator.disturbance_fade_s))
    walk, of_nu, of_eta = estimator.velocity_walk_std**2 * row.dt_s, D, 0.5 * moved_s * J @ E
    if is_dynamic(estimator.vehicle):
        aside = np.maximum(kept, 0.0)
        lasts = np.array([1.0, (1.0 + aside * (4.0 + aside)) / 6.0, 1.0])
        walk = walk * lasts + moved_s**2 / 12.0 * (E @ d)
        of_nu, of_eta = 0.5 * moved_s * D, moved_s**2 / 6.0 * J @ E
    way, none = moved_s * J, np.zeros((3, 3))
    rows = [(0.5 * way, of_eta, way), (W, of_nu, none), (none[:2], np.eye(2), none[:2])]
    B = np.concatenate([np.concatenate(row, axis=1) for row in rows])
    return (B * np.concatenate([walk, d, walk / 12.0])) @ B.T


def velocity_error(kappa: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Return K ν (3,), the error of the velocity by the scale errors and the bend `kappa` = (κ_v, κ_ψ, β, …).  (2)"""
    return np.array([kappa[0] * nu[0], kappa[0] * nu[1] + kappa[2] * nu[0], kappa[1] * nu[2]])


def _to_axes(vehicle: DynamicVehicle) -> np.ndarray:
    """Return the matrix (3, 3) from a push (forward, sideways, in rotation) to the change of ν."""
    arm = optional.of(vehicle, "turning_arm_m")
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0 if arm is None else arm], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=256)
def _slips(estimator: "AugmentedEkf") -> tuple[Value, Value, Value]:
    """Return the relative variance of the slip, its fading time [s], and the time between wheel readings [s]."""
    its = layout(estimator)
    return slips(estimator.sensors, dict(zip(its.names, its.entries, strict=True)))
