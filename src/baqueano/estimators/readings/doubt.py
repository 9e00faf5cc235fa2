"""A lasting disagreement makes the estimate less certain, and the filter follows no reading for it.

The speed ν_x and the yaw rate ν_ψ are each in doubt while a number that shows them is refused, by a = |y / h'|, or
while the filter follows one against its model: |d| > gate_sigma σ_d, by a = |ν − ν of the model|. From DOUBT_S on,

    var ν ← var ν + a²  as it is reported,      P_ηη ← P_ηη + J g (2 a² t δ) gᵀ Jᵀ                         (1)

g is the axis, t how long it has lasted: the way grows by a t if the velocity is wrong by a all the time. Whichever of
sensor and model is right lies inside. The covariance that corrects stays as it is: a wider one would open the gate.
"""

from functools import reduce
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.pauses import FARTHEST
from baqueano.geometry import map_from_body

DOUBT_S = 0.5
AXES = (3, 5)  # of a state (η, ν, …)
HELD_S, FADING = 1.0, 2.0  # when readings agree again a doubt falls to this time, and fades so much faster


class DoubtUpdate(NamedTuple):
    """The doubt after a row, and what it adds to a covariance."""

    doubt: (
        np.ndarray
    )  # (2, 2) of speed and yaw rate: by how much the last readings were refused, for how long [s]
    of_pose: np.ndarray  # (3, 3)
    of_nu: np.ndarray  # (3, 3)


def doubted(
    doubt: np.ndarray, slope: np.ndarray, innovations: Value, against: np.ndarray, psi: Value, dt_s: Value
) -> DoubtUpdate:
    """Return the doubt a row of `dt_s` on.

    `slope` (m, 2) of each number by speed and yaw rate, 0 where it corrects neither; `innovations` y (m,), NaN where
    nothing arrived, with their weight (m,); `against` (2,) by how much the model is overruled.
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
    now = lasting(doubt, np.array(refusals), against, np.array(came) > 0.0, dt_s)
    return DoubtUpdate(now, *wider(np.maximum(now[0], against), doubt[1], now[1], psi, dt_s))


def lasting(
    doubt: np.ndarray, refused: np.ndarray, against: np.ndarray, came: np.ndarray, dt_s: Value
) -> np.ndarray:
    """Return the doubt one row on, (2, 2): by how much the last readings were refused, and for how long [s].

    `refused` (2,): by how much the readings of this row are; `against` (2,): by how much the model is overruled; 0 if
    not. `came` (2,) bool: there was a reading.
    """
    by = np.where(came, refused, doubt[0])
    less = np.maximum(np.minimum(doubt[1], HELD_S) - FADING * dt_s, 0.0)
    return np.stack([by, np.where(np.maximum(by, against) > 0.0, doubt[1] + dt_s, less)])


def wider(
    by: np.ndarray, before_s: np.ndarray, now_s: np.ndarray, psi: Value, dt_s: Value
) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of the doubt by `by` (2,) in the covariances of pose and velocity, (3, 3) each.  (1)"""
    lasts, way = now_s >= DOUBT_S, map_from_body(psi)[:, [0, 2]]
    longer = np.where(before_s >= DOUBT_S, dt_s * (2.0 * before_s + dt_s), now_s**2)
    grows = lasts & (now_s > before_s)
    of_pose = way @ np.diag(np.where(grows, np.minimum(by**2 * longer, FARTHEST), 0.0)) @ way.T
    of_nu = np.where(lasts, by**2, 0.0)
    return of_pose, np.diag(np.array([of_nu[0], 0.0, of_nu[1]]))


def _largest(values: list[Value]) -> Value:
    """Return the largest of scalars that are at least 0; 0 of none."""
    return reduce(np.maximum, values, 0.0)
