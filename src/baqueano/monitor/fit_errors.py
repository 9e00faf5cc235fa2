"""Propagate the errors of the fitted parameters to the readings that the model expects.

    P = L Lᵀ,   θ_i = θ + STEP L_i                            P: covariance of the fit, L_i: column i of L  (1)
    ν_i⁺ = advance(θ_i, ν_i, u)                               from the commands only; at rest 0             (2)
    F = D Dᵀ,   D_i = (h(θ_i, ν_i) − h(θ, ν)) / STEP          covariance of the expected readings           (3)

An error of a parameter lasts, so a disturbance that decays does not contain it. In slow turns, for example, an error of
a dead zone can be as large as the turn itself. (1) is a derivative: a step of a whole standard error can make friction
negative. Without a covariance of the fit, F = 0.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.augmented_ekf import AugmentedBelief
from baqueano.estimators.pauses import FilterRow, row_effort
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort

STEP = 1e-3  # of a standard error
PREFIX = "model."


class ModelMotion(NamedTuple):
    """The motion of a model with other parameters, computed only from the commands."""

    nu: np.ndarray  # (3,)
    drivetrain: DrivetrainState


def alternative_models(vehicle: Tree, names: tuple[str, ...], cov: np.ndarray) -> tuple[Tree, ...]:
    """Return a model for each column of L; `names` are the parameters of `cov` (p, p).  (1)"""
    indices = [k for k, name in enumerate(names) if name.startswith(PREFIX)]
    paths = [names[k].removeprefix(PREFIX) for k in indices]
    P = cov[np.ix_(indices, indices)]
    std = np.sqrt(np.maximum(np.diag(P), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    variances, axes = np.linalg.eigh(P / np.outer(scale, scale))
    L = std[:, None] * axes * np.sqrt(np.maximum(variances, 0.0))
    models = []
    for column in L.T[np.any(L != 0.0, axis=0)]:
        model = vehicle
        for path, change in zip(paths, column, strict=True):
            model = with_value(model, path, value_at_path(model, path) + STEP * change)
        models.append(model)
    return tuple(models)


def advance_model(
    vehicle: Tree, previous: AugmentedBelief, motion: ModelMotion, row: FilterRow, at_rest: Value
) -> tuple[ModelMotion, Effort, Value]:
    """Return the motion of an alternative `vehicle` after a row, its effort, and ν̇ if the model is not dynamic.  (2)"""
    mean = np.concatenate([previous.mean[:3], motion.nu, previous.mean[6:]])
    belief = previous._replace(mean=mean, drivetrain=motion.drivetrain)
    drivetrain, effort = row_effort(vehicle, belief, row)
    _, nu, nu_dot = vehicle.advance(mean[:3], motion.nu, effort, row.predicted_s)
    return (
        ModelMotion(np.where(at_rest, 0.0, nu), drivetrain),
        effort,
        None if is_dynamic(vehicle) else nu_dot,
    )


def expected_cov(readings: list[np.ndarray], nominal: np.ndarray) -> Value:
    """Return F (m, m) from the reading (m,) that each model expects.  (3)"""
    differences = [(reading - nominal) / STEP for reading in readings]
    return sum((d[:, None] * d[None, :] for d in differences), np.zeros((len(nominal),) * 2))
