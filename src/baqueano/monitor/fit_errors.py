"""Propagate the errors of the fitted parameters to the readings that the model expects.

    P ≈ L Lᵀ,   θ_i = θ + STEP L_i                            P: covariance of the fit, L_i: column i of L  (1)
    ν_i⁺ = advance(θ_i, ν_i, u)                               from the commands only; at rest 0             (2)
    F = D Dᵀ,   D_i = (h(θ_i, ν_i) − h(θ, ν)) / STEP          covariance of the expected readings           (3)
    Δν = Σ_k A^k (ν⁺(θ_i) − ν⁺(θ)) / STEP,   A = ∂ν⁺/∂ν       effect on a steady motion                     (4)

An error of a parameter lasts, so a disturbance that decays does not contain it. In slow turns, for example, an error of
a dead zone can be as large as the turn itself. (1) is a derivative: a step of a whole standard error can make friction
negative. L has the MAX_MODELS directions with the largest effects (4): the right singular vectors of all effects, for
commands of half the limits. Without a covariance of the fit, F = 0.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.augmented_ekf import AugmentedBelief
from baqueano.estimators.pauses import FilterRow, row_effort
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import tick_effort

STEP = 1e-3  # fraction of a standard error
MAX_MODELS = 4  # each model lengthens the code of the monitor
COMMAND_SHARE, SETTLING_TICKS, SPEED_STEP = 0.5, 60, 1e-4  # (4): of the limit; until ν is steady; m/s, rad/s
PREFIX = "model."


class ModelMotion(NamedTuple):
    """The motion of a model with other parameters, computed only from the commands."""

    nu: np.ndarray  # (3,)
    drivetrain: DrivetrainState


def alternative_models(
    vehicle: Tree, names: tuple[str, ...], cov: np.ndarray, limit: np.ndarray, dt_s: float
) -> tuple[Tree, ...]:
    """Return the models of (1), whose parameters differ by a small fraction of the errors of the fit.

    Parameters
    ----------
    vehicle : Tree
        The model, with the values of the fit.
    names : tuple of str
        The p parameters, such as "model.mass_kg". Only those that begin with "model." are changed.
    cov : ndarray (p, p)
        Their covariance [products of the units].
    limit : ndarray (n,)
        The largest command of each axis [unit of the command]; 0 for an axis without a motor.
    dt_s : float
        Duration of a tick [s].

    Returns
    -------
    tuple of Tree
        At most MAX_MODELS models, one for each column of L that is not 0.

    Examples
    --------
    >>> model = bq.load("small").vehicle
    >>> models = alternative_models(model, ("model.mass_kg",), np.array([[0.01]]), np.ones(3), 0.01)
    >>> print(round(abs(models[0].mass_kg - model.mass_kg), 6))
    0.0001
    """
    indices = [k for k, name in enumerate(names) if name.startswith(PREFIX)]
    paths = [names[k].removeprefix(PREFIX) for k in indices]
    P = cov[np.ix_(indices, indices)]
    std = np.sqrt(np.maximum(np.diag(P), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    variances, axes = np.linalg.eigh(P / np.outer(scale, scale))
    L = std[:, None] * axes * np.sqrt(np.maximum(variances, 0.0))
    if L.shape[1] > MAX_MODELS and np.any(limit > 0.0):
        models = [_changed_model(vehicle, paths, column) for column in L.T]
        _, _, directions = np.linalg.svd(_effects(vehicle, models, limit, dt_s), full_matrices=False)
        L = L @ directions[:MAX_MODELS].T
    return tuple(_changed_model(vehicle, paths, column) for column in L.T if np.any(column != 0.0))


def _changed_model(vehicle: Tree, paths: list[str], change: np.ndarray) -> Tree:
    for path, entry in zip(paths, change, strict=True):
        vehicle = with_value(vehicle, path, value_at_path(vehicle, path) + STEP * entry)
    return vehicle


def _effects(vehicle: Tree, models: list[Tree], limit: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the effects (3 K, p) of p models on the steady motions of K commands, relative to the speeds.  (4)"""

    def next_nu(model: Tree, nu: np.ndarray, u: np.ndarray) -> np.ndarray:
        motors = model.drivetrain.steady_state(u)
        _, effort = tick_effort(model, motors, 0.0, nu, u, dt_s)
        return np.asarray(model.advance(np.zeros(3), nu, effort, dt_s)[1], float)

    motions, effects = [], []
    signs = [sign for sign in product((-1.0, 0.0, 1.0), repeat=int(np.sum(limit > 0.0))) if any(sign)]
    for sign in signs:
        u, nu = np.zeros(len(limit)), np.zeros(3)
        u[limit > 0.0] = COMMAND_SHARE * limit[limit > 0.0] * sign
        for _ in range(SETTLING_TICKS):
            nu = next_nu(vehicle, nu, u)
        end = next_nu(vehicle, nu, u)
        columns = [next_nu(vehicle, nu + step, u) - end for step in SPEED_STEP * np.eye(3)]
        A = np.stack(columns, axis=1) / SPEED_STEP
        response = sum((np.linalg.matrix_power(A, k) for k in range(SETTLING_TICKS)), np.zeros((3, 3)))
        motions.append(nu)
        effects.append(response @ np.stack([next_nu(model, nu, u) - end for model in models], axis=1))
    forward, _, turning = np.sqrt(np.mean(np.square(motions), axis=0)) + SPEED_STEP
    return np.concatenate(effects) / np.tile([forward, forward, turning], len(signs))[:, None]


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
