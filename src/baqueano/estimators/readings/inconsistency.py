"""Widen the covariance during a lasting disagreement; the correction of the state does not change.

Speed ν_x and yaw rate ν_ψ each have an inconsistency a [m/s or rad/s]. While a channel of ν_x or ν_ψ is rejected, a =
|y / h'| with its innovation y and derivative h'. While the filter follows a channel against its model, a = |ν − ν of
the model|; this is detected by |d| > gate_sigma σ_d. If the inconsistency lasts at least MIN_INCONSISTENT_S:

    var ν ← var ν + a²  in the estimate only,   P_ηη ← P_ηη + J g (2 a² t δ) gᵀ Jᵀ                         (1)

P_ηη is the covariance of the pose, J rotates body to map. g is the axis of the velocity, δ the duration of the row, t
the duration of the inconsistency. The position error is a t if the velocity has the error a all the time. So the region
contains the truth if either the sensor or the model is correct. The correction uses the unchanged covariance: a wider
covariance would open the gate.
"""

from functools import reduce
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.pauses import MAX_POSE_VARIANCE
from baqueano.geometry import map_from_body

MIN_INCONSISTENT_S = 0.5
SPEED_AND_YAW_RATE = (3, 5)  # of a state (η, ν, …)
# when readings agree again, the duration of an inconsistency falls to MAX_HELD_S, then by FADING_RATE seconds per
# second
MAX_HELD_S, FADING_RATE = 1.0, 2.0


class InconsistencyUpdate(NamedTuple):
    """The inconsistency after a row, and its contributions to the covariances of pose and velocity."""

    inconsistency: (
        np.ndarray
    )  # (2, 2) of speed and yaw rate: absolute value of the last rejected innovations, and duration [s]
    pose_cov: np.ndarray  # (3, 3)
    nu_cov: np.ndarray  # (3, 3)


def update_inconsistency(
    inconsistency: np.ndarray,
    channel_jacobian: np.ndarray,
    innovations: Value,
    model_error: np.ndarray,
    psi: Value,
    dt_s: Value,
) -> InconsistencyUpdate:
    """Return the inconsistency of speed and yaw rate after a row of `dt_s`, and its additions to the covariances.

    `channel_jacobian` (m, 2) is the derivative of each channel with respect to speed and yaw rate; 0 if the channel
    must not correct them. `innovations` contains y (m,), NaN for a channel without a measurement, and the weights (m,).
    `model_error` (2,) is the absolute value of the correction against the model.
    """
    rejected_sizes, has_reading = [], []
    for h in channel_jacobian.T:
        channels = np.flatnonzero(h)
        rejected_sizes.append(
            _largest(
                [
                    np.where(innovations.weight[c] < 0.5, np.abs(innovations.y[c]) / abs(h[c]), 0.0)
                    for c in channels
                ]
            )
        )
        has_reading.append(_largest([np.where(np.isfinite(innovations.y[c]), 1.0, 0.0) for c in channels]))
    next_inconsistency = inconsistency_after(
        inconsistency, np.array(rejected_sizes), model_error, np.array(has_reading) > 0.0, dt_s
    )
    return InconsistencyUpdate(
        next_inconsistency,
        *added_covariances(
            np.maximum(next_inconsistency[0], model_error), inconsistency[1], next_inconsistency[1], psi, dt_s
        ),
    )


def inconsistency_after(
    inconsistency: np.ndarray,
    rejected: np.ndarray,
    model_error: np.ndarray,
    has_reading: np.ndarray,
    dt_s: Value,
) -> np.ndarray:
    """Return the inconsistency (2, 2) one row later: absolute value of the last rejected innovations, duration [s].

    `rejected` (2,) is the absolute value of the rejected innovations of this row, `model_error` (2,) that of the
    correction against the model; both are 0 if absent. `has_reading` (2,) is True if a reading arrived.
    """
    size = np.where(has_reading, rejected, inconsistency[0])
    shorter_s = np.maximum(np.minimum(inconsistency[1], MAX_HELD_S) - FADING_RATE * dt_s, 0.0)
    return np.stack([size, np.where(np.maximum(size, model_error) > 0.0, inconsistency[1] + dt_s, shorter_s)])


def added_covariances(
    size: np.ndarray, before_s: np.ndarray, now_s: np.ndarray, psi: Value, dt_s: Value
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances of pose (3, 3) and velocity (3, 3) that an inconsistency `size` (2,) adds.  (1)

    `before_s` and `now_s` (2,) are its durations before and after this row of `dt_s`.
    """
    is_lasting, directions = now_s >= MIN_INCONSISTENT_S, map_from_body(psi)[:, [0, 2]]
    added_s2 = np.where(before_s >= MIN_INCONSISTENT_S, dt_s * (2.0 * before_s + dt_s), now_s**2)
    is_growing = is_lasting & (now_s > before_s)
    pose_cov = (
        directions
        @ np.diag(np.where(is_growing, np.minimum(size**2 * added_s2, MAX_POSE_VARIANCE), 0.0))
        @ directions.T
    )
    variances = np.where(is_lasting, size**2, 0.0)
    return pose_cov, np.diag(np.array([variances[0], 0.0, variances[1]]))


def _largest(values: list[Value]) -> Value:
    """Return the largest of scalars that are at least 0; 0 for an empty list."""
    return reduce(np.maximum, values, 0.0)
