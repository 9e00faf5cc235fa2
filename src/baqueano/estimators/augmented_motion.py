"""Process model of the augmented state: the mean one row on, and the covariance of its noise.

    x = (η, ν, d, κ, β, w, b):  pose, velocity, disturbance, error of the scales of ν, course, bend, biases (1)
    dynamic model      ν̇ = f(ν, e) + D,      D = (d_x, 0, d_ψ) [m/s², rad/s²],   η̇ = J(ψ) (1 + K) ν        (2)
    kinematic model    ν = V e + D,           D = (d_x, 0, d_ψ) [m/s, rad/s]
    K ν = (κ_v ν_x, κ_v ν_y + β ν_x, κ_ψ ν_ψ)
    ḋ = −d/T + noise   (Ornstein-Uhlenbeck, variance σ_d²),    κ̇ = β̇ = ẇ = 0,    ḃ = noise                (3)
    way += −w √¾ s / (1 + s/2) J(ψ) ν,   s the variance of the heading, w ~ N(0, 1)                        (4)
    P_xx, P_yy += 2 T_s (σ_s ν_x)² δ,   var ν_x += (σ_s ν_x)² as it is reported:   slip, σ_s, T_s of a wheel  (5)

Who is wrong by δ in heading gets ahead by cos δ alone: linear in δ this is nothing, and at 0.4 rad the region of the
position bends like a banana. (4) has the second moment of 1 − cos δ, √¾ s of a small s, and keeps it along the path.

Wheels slip for some T_s, ahead and aside alike. Over a way that takes longer (5) is the variance of that. The mean
follows the wheels, for on real cars the model is further off than they are.

Noise grows along a row: half of what ν gained went into the way, and of what d gained into ν.
"""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented_state import BEND, BIASES, SCALES, layout
from baqueano.estimators.covariance import block_diagonal
from baqueano.estimators.kalman import Gaussian, predict
from baqueano.estimators.pauses import Row, bounded, unmoved_cov
from baqueano.estimators.sensor_numbers import slips
from baqueano.geometry import map_from_body, wrap
from baqueano.vehicles.effort import Effort

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedEkf


def ahead(estimator: "AugmentedEkf", x: Gaussian, effort: Effort, row: Row) -> Gaussian:
    """Return the state (n,), (n, n) one row later.  (2)-(4)"""
    n = len(x.mean)
    moved = predict(x, lambda mean: move(estimator, mean, effort, row.moved_s, x.cov[2, 2]), np.zeros((n, n)))
    walks = [
        np.array([one.of(estimator.sensors, one.walk) ** 2 * row.dt_s]) for one in layout(estimator).biases
    ]
    B, unsure = kick(estimator, moved.mean[2], row), unmoved_cov(row, moved.mean, x.cov)
    unsure = unsure + slipped(estimator, moved.mean, row.dt_s)[0]
    R = block_diagonal([B @ B.T, np.diag(np.concatenate([np.zeros(BIASES - SCALES), *walks]))])
    return Gaussian(moved.mean, bounded(moved.cov + R + block_diagonal([unsure, np.zeros((n - 3, n - 3))])))


def move(
    estimator: "AugmentedEkf", mean: np.ndarray, effort: Effort, dt_s: Value, spread: Value = 0.0
) -> np.ndarray:
    """Return the mean (n,) after a row; `spread` [rad²] is the variance of the heading before it.  (2)-(4)"""
    vehicle, d, nu = estimator.vehicle, mean[6:SCALES], mean[3:6]
    D = np.array([d[0], 0.0, d[1]])
    step, way = (dt_s, 0.5 * dt_s**2) if is_dynamic(vehicle) else (1.0, dt_s)
    eta, nu_next, _ = vehicle.advance(mean[:3], nu, effort, dt_s)
    nu_next = nu_next + step * D
    along = 0.5 * dt_s * scaled(mean[SCALES:BIASES], nu + nu_next)
    short = 0.5 * dt_s * mean[BEND] * np.sqrt(0.75) * spread / (1.0 + 0.5 * spread)
    along = along - short * np.array([1.0, 1.0, 0.0]) * (nu + nu_next)
    eta = eta + map_from_body(eta[2]) @ (way * D + along)
    fading = d * np.exp(-dt_s / estimator.disturbance_fade_s)
    return np.concatenate([eta[:2], np.array([wrap(eta[2])]), nu_next, fading, mean[SCALES:]])


def slipped(estimator: "AugmentedEkf", mean: np.ndarray, dt_s: Value) -> tuple[np.ndarray, np.ndarray]:
    """Return what the slip of wheels adds in a row to the covariance of the pose (3, 3), and of ν (3, 3).  (5)"""
    variance, fade_s = _slips(estimator)
    of_nu = variance * mean[3] ** 2
    return np.diag(np.array([1.0, 1.0, 0.0])) * (2.0 * fade_s * dt_s * of_nu), np.diag(
        np.array([of_nu, 0.0, 0.0])
    )


def kick(estimator: "AugmentedEkf", psi: Value, row: Row) -> np.ndarray:
    """Return B (8, 8): what unit normals of the walk of ν (3), of d (2), and of the way of that walk (3) do to
    (η, ν, d) in a row. Of the variance σ² δ³/3 of the way, σ² δ³/4 goes with what ν gains, σ² δ³/12 does not."""
    J, D = map_from_body(psi), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    walk = np.diag(estimator.velocity_walk_std * np.sqrt(row.dt_s))
    d = np.diag(
        estimator.disturbance_std * np.sqrt(1.0 - np.exp(-2.0 * row.dt_s / estimator.disturbance_fade_s))
    )
    dynamic = is_dynamic(estimator.vehicle)
    of_nu = 0.5 * row.moved_s * D @ d if dynamic else D @ d
    of_eta = J @ of_nu * (row.moved_s / 3.0 if dynamic else 0.5 * row.moved_s)
    way, none = row.moved_s * J @ walk, np.zeros((3, 3))
    rows = [(0.5 * way, of_eta, way / np.sqrt(12.0)), (walk, of_nu, none), (none[:2], d, none[:2])]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def scaled(kappa: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Return K ν (3,)."""
    return np.array([kappa[0] * nu[0], kappa[0] * nu[1] + kappa[2] * nu[0], kappa[1] * nu[2]])


@lru_cache(maxsize=256)
def _slips(estimator: "AugmentedEkf") -> tuple[Value, Value]:
    """The variance of slip and the time over which it fades, of what the estimator uses."""
    its = layout(estimator)
    return slips(estimator.sensors, dict(zip(its.names, its.at, strict=True)))
