"""Widen the covariance during a lasting disagreement; the correction of the state does not change.

A doubt a [m/s or rad/s] belongs to the speed ν_x, another to the yaw rate ν_ψ. While a channel of ν_x or ν_ψ is
refused, a = |y / h'| with its innovation y and derivative h'. While the filter follows a channel against its model,
a = |ν − ν of the model|; this is detected by |d| > gate_sigma σ_d. If the doubt lasts at least DOUBT_S:

    var ν ← var ν + a²  in the estimate only,   P_ηη ← P_ηη + J g (2 a² t δ) gᵀ Jᵀ                         (1)

P_ηη is the covariance of the pose, J rotates body to map. g is the axis of the velocity, δ the duration of the row, t
the duration of the doubt. The position error is a t if the velocity is wrong by a all the time. So the region contains
the truth if either the sensor or the model is correct. The correction uses the unchanged covariance: a wider covariance
would open the gate.
"""

from functools import reduce
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.pauses import FARTHEST
from baqueano.geometry import map_from_body

DOUBT_S = 0.5
AXES = (3, 5)  # of a state (η, ν, …)
# when readings agree again, the duration of a doubt falls to HELD_S, and then FADING times as fast as time
HELD_S, FADING = 1.0, 2.0


class DoubtUpdate(NamedTuple):
    """The doubt after a row, and its contributions to the covariances of pose and velocity."""

    doubt: np.ndarray  # (2, 2) of speed and yaw rate: size of the last refused innovations, and duration [s]
    of_pose: np.ndarray  # (3, 3)
    of_nu: np.ndarray  # (3, 3)


def update_doubt(
    doubt: np.ndarray, slope: np.ndarray, innovations: Value, against: np.ndarray, psi: Value, dt_s: Value
) -> DoubtUpdate:
    """Return the doubt of speed and yaw rate after a row of `dt_s`, with its contributions to the covariances.

    `slope` (m, 2) is the derivative of each channel with respect to speed and yaw rate; 0 if the channel may not
    correct them. `innovations` contains y (m,), NaN for a channel without a measurement, and the weights (m,).
    `against` (2,) is the size of the correction against the model.
    """
    refusals, came = [], []
    for h in slope.T:
        numbers = np.flatnonzero(h)
        refusals.append(
            _largest(
                [
                    np.where(innovations.weight[c] < 0.5, np.abs(innovations.y[c]) / abs(h[c]), 0.0)
                    for c in numbers
                ]
            )
        )
        came.append(_largest([np.where(np.isfinite(innovations.y[c]), 1.0, 0.0) for c in numbers]))
    now = updated_doubt(doubt, np.array(refusals), against, np.array(came) > 0.0, dt_s)
    return DoubtUpdate(now, *wider(np.maximum(now[0], against), doubt[1], now[1], psi, dt_s))


def updated_doubt(
    doubt: np.ndarray, refused: np.ndarray, against: np.ndarray, came: np.ndarray, dt_s: Value
) -> np.ndarray:
    """Return the doubt (2, 2) one row later: the size of the last refused innovations, and the duration [s].

    `refused` (2,) is the size of the refused innovations of this row, `against` (2,) the size of the correction against
    the model; both are 0 if absent. `came` (2,) is True if a reading arrived.
    """
    by = np.where(came, refused, doubt[0])
    less = np.maximum(np.minimum(doubt[1], HELD_S) - FADING * dt_s, 0.0)
    return np.stack([by, np.where(np.maximum(by, against) > 0.0, doubt[1] + dt_s, less)])


def wider(
    by: np.ndarray, before_s: np.ndarray, now_s: np.ndarray, psi: Value, dt_s: Value
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances of pose (3, 3) and velocity (3, 3) that a doubt of size `by` (2,) adds.  (1)"""
    lasts, way = now_s >= DOUBT_S, map_from_body(psi)[:, [0, 2]]
    longer = np.where(before_s >= DOUBT_S, dt_s * (2.0 * before_s + dt_s), now_s**2)
    grows = lasts & (now_s > before_s)
    of_pose = way @ np.diag(np.where(grows, np.minimum(by**2 * longer, FARTHEST), 0.0)) @ way.T
    of_nu = np.where(lasts, by**2, 0.0)
    return of_pose, np.diag(np.array([of_nu[0], 0.0, of_nu[1]]))


def _largest(values: list[Value]) -> Value:
    """Return the largest of scalars that are at least 0; 0 for an empty list."""
    return reduce(np.maximum, values, 0.0)
