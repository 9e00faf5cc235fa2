"""Adapt the noise of the filter to the run: a floor or a speed can shake a vehicle more than the run of the fit.

    Q' = Λ^½ Q Λ^½,   Λ = diag(λ);   σ_d'² = κ σ_d²,   σ_ν'² = κ σ_ν²   for the speed and for the yaw rate   (1)
    ρ = Q'_cc / S_cc,   a = y_c² / S_cc − 1                                                               (2)
    λ_c ← λ_c (1 + g ρ a),   κ_j ← κ_j (1 + g mean of (1 − ρ) a over the channels that correct j)         (3)

y, S: innovation and its covariance; Q, σ_d, σ_ν: noise of the sensors, the disturbance and the walk. A step of (3)
follows the gradient of log N(y; 0, S) by log λ and log κ; it ends where y²/S has the mean 1. The gain g is the share
of one reading. A reading counts only if it and the one before are within the gate: so a broken sensor cannot widen
it. At rest nothing is adapted, since a vehicle at rest does not shake. Sensors of the pose keep their noise:
place_gate.py decides about them.

Sources: Mehra 1972 for noise from innovations; Särkkä and Nummenmaa 2009 for one factor per channel.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Value

if TYPE_CHECKING:
    from baqueano.estimators.augmented.state import Layout

MAX_LEVEL = 16.0  # of a variance: a standard deviation of the file is wrong by at most 4 times
MIN_MOTION_LEVEL = 0.5  # a calm drive does not show that the next turn is calm, too


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
    S: np.ndarray  # (m, m)
    noise_cov: np.ndarray  # Q' (m, m)
    counts: np.ndarray  # (m,) 1 for a reading that changes the levels, else 0


def levels_after(
    levels: NoiseLevels, squares: InnovationSquares, states: "Layout", gain: Value
) -> NoiseLevels:
    """Return the levels after the innovations of a tick of a moving vehicle; `gain` is g.  (3)"""
    noise_share, excess = _noise_share(squares), squares.counts * (squares.y**2 / np.diag(squares.S) - 1.0)
    pose_channels = {c for group in states.pose_groups for c in group}
    adapts = np.array([0.0 if c in pose_channels else 1.0 for c in range(len(squares.y))])
    corrects = _corrects(states) * adapts[:, None]
    mean_excess = ((1.0 - noise_share) * excess) @ (corrects / np.maximum(np.sum(corrects, axis=0), 1.0))
    return NoiseLevels(
        _bounded(levels.sensors * (1.0 + gain * adapts * noise_share * excess), 1.0 / MAX_LEVEL),
        _bounded(levels.motion * (1.0 + gain * mean_excess), MIN_MOTION_LEVEL),
    )


def file_innovation_cov(levels: NoiseLevels, squares: InnovationSquares, states: "Layout") -> np.ndarray:
    """Return S (m, m) with the noise of the vehicle file; the part of S beside Q' is taken as proportional to κ."""
    corrects = _corrects(states)
    count = np.sum(corrects, axis=1)
    motion = np.where(count > 0.0, corrects @ levels.motion / np.maximum(count, 1.0), 1.0)
    noise_share = _noise_share(squares)
    std = np.sqrt(noise_share / levels.sensors + (1.0 - noise_share) / motion)
    return squares.S * np.outer(std, std)


def _corrects(states: "Layout") -> np.ndarray:
    """Return a mask (m, 2): 1 if the channel corrects the speed, or the yaw rate."""
    return np.where(states.rest_jacobian != 0.0, 1.0, 0.0)


def _noise_share(squares: InnovationSquares) -> np.ndarray:
    """Return ρ (m,).  (2)"""
    return np.diag(squares.noise_cov) / np.diag(squares.S)


def _bounded(level: np.ndarray, low: float) -> np.ndarray:
    return np.minimum(np.maximum(level, low), MAX_LEVEL)
