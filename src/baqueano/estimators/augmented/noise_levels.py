"""Adapt the noise of the filter to the run: a floor or a speed can shake a vehicle more than the run of the fit.

    Q' = Λ^½ Q Λ^½,   Λ = diag(λ);   σ_d'² = κ σ_d²,   σ_ν'² = κ σ_ν²   for the speed and for the yaw rate   (1)
    ρ = Q'_cc / S_cc,   a = y_c² / S_cc − 1,   b = y_c y_c⁻ / S_cc                                        (2)
    gyro:      r_λ = a − (1 − ρ) b,   r_κ = a + 2ρ b;        other channels:   r_λ = ρ a,   r_κ = (1 − ρ) a   (3)
    λ_c ← λ_c (1 + g r_λ),   κ_j ← κ_j (1 + g mean of r_κ over the channels that correct j)               (4)

y, y⁻, S: innovation, the one before, and its covariance; Q, σ_d, σ_ν: noise of the sensors, the disturbance and the
walk. (3) is the gradient of the likelihood, for a gyro divided by the share of the level in S (docs/derivations/
kalman.md). It ends where y²/S has the mean 1 and y of a gyro is white. Slip of a wheel lasts, so b of wheels does not
show the motion. The gain g is the share of one reading. A reading counts only if it and the one before are within the
gate. At rest nothing is adapted. Sensors of the pose keep their noise: place_gate.py decides about them.

Sources: Mehra 1972 for noise from innovations; Särkkä and Nummenmaa 2009 for one factor per channel.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Value

if TYPE_CHECKING:
    from baqueano.estimators.augmented.state import Layout

MAX_LEVEL = 16.0  # of a variance: a standard deviation of the file is wrong by at most 4 times


class NoiseLevels(NamedTuple):
    """The noise relative to that of the vehicle file, as variances. A belief contains them as one row (m + 2,)."""

    sensors: np.ndarray  # λ (m,) of each channel
    motion: np.ndarray  # κ (2,) of speed and yaw rate

    @classmethod
    def from_row(cls, row: np.ndarray) -> "NoiseLevels":
        """Return the levels of a row (m + 2,)."""
        return cls(row[:-2], row[-2:])

    def sensor_cov(self, Q: np.ndarray) -> np.ndarray:
        """Return Q' (m, m) for the covariance Q of the vehicle file.  (1)"""
        std = np.sqrt(self.sensors)
        return Q * np.outer(std, std)


class InnovationSquares(NamedTuple):
    """The innovations of a tick that change the levels."""

    y: np.ndarray  # (m,)
    previous: np.ndarray  # (m,) y⁻
    S: np.ndarray  # (m, m)
    noise_cov: np.ndarray  # Q' (m, m)
    counts: np.ndarray  # (m,) 1 for a reading that changes the levels, else 0


def next_levels(
    levels: NoiseLevels, squares: InnovationSquares, states: "Layout", gain: Value
) -> NoiseLevels:
    """Return the levels after the innovations of a tick of a moving vehicle; `gain` is g.  (3), (4)"""
    y, S, rho = squares.y, np.diag(squares.S), _noise_share(squares)
    a, b = squares.counts * (y**2 / S - 1.0), squares.counts * y * squares.previous / S
    pose_channels = [c for group in states.pose_groups for c in group]
    adapts = np.where(np.isin(np.arange(len(y)), pose_channels), 0.0, 1.0)
    correction_mask = _rate_masks(states) * adapts[:, None]
    is_gyro = correction_mask[:, 1] > correction_mask[:, 0]
    sensor_part = np.where(is_gyro, a - (1.0 - rho) * b, rho * a)
    motion_part = np.where(is_gyro, a + 2.0 * rho * b, (1.0 - rho) * a)
    mean = correction_mask / np.maximum(np.sum(correction_mask, axis=0), 1.0)
    return NoiseLevels(
        _limit_levels(levels.sensors * (1.0 + gain * adapts * sensor_part)),
        _limit_levels(levels.motion * (1.0 + gain * motion_part @ mean)),
    )


def file_innovation_cov(levels: NoiseLevels, squares: InnovationSquares, states: "Layout") -> np.ndarray:
    """Return S (m, m) with the noise of the vehicle file. The part p of S without Q' is assumed to be proportional to
    κ, or to √κ if κ < 1: in steady state p²/S is proportional to κ, and with little motion S depends less on it."""
    correction_mask = _rate_masks(states)
    count = np.sum(correction_mask, axis=1)
    motion = np.where(count > 0.0, correction_mask @ levels.motion / np.maximum(count, 1.0), 1.0)
    noise_share = _noise_share(squares)
    std = np.sqrt(noise_share / levels.sensors + (1.0 - noise_share) / np.maximum(motion, np.sqrt(motion)))
    return squares.S * np.outer(std, std)


def _rate_masks(states: "Layout") -> np.ndarray:
    """Return a mask (m, 2): 1 if the channel corrects the speed, or the yaw rate."""
    return np.where(states.rest_jacobian != 0.0, 1.0, 0.0)


def _noise_share(squares: InnovationSquares) -> np.ndarray:
    """Return ρ (m,).  (2)"""
    return np.diag(squares.noise_cov) / np.diag(squares.S)


def _limit_levels(level: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(level, 1.0 / MAX_LEVEL), MAX_LEVEL)
