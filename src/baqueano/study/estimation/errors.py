"""Compute squared errors of an estimate and of its reference, in blocks of one run, and their ratio.

Speed is ν_x. Positions are relative to the first true pose: path and truth coincide there, in position and heading. A
window of T is aligned again at its first true pose. The blocks are the windows for positions in windows, and segments
of 10 s for the speed. For positions over the whole run, the run is one block, because one draw of the heading errors
determines all its position errors.

    ratio = √(Σ_b e_b² / Σ_b ẽ_b²),   its interval by drawing whole blocks b with replacement             (1)
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.compare.errors import absolute_pose_errors, align_trajectory
from baqueano.messages.language import mark as N_
from baqueano.numerics.statistics import block_ratio
from baqueano.runs.interpolation import interpolate_poses, true_speed
from baqueano.runs.run import TruthLog
from baqueano.signals import seconds

BLOCK_S = 10.0
WINDOWS_S = (10.0, 20.0)
SPEED = N_("speed [m/s rms]")
WHOLE_RUN = N_("position, whole run [m rms]")
QUANTITIES = (SPEED, WHOLE_RUN, N_("position, 10 s [m rms]"), N_("position, 20 s [m rms]"))


class BlockSums(NamedTuple):
    """Sums of squared errors over B blocks, of the estimate and of its reference."""

    estimate: np.ndarray  # (B,)
    reference: np.ndarray  # (B,)
    samples: np.ndarray  # (B,) number of samples

    @property
    def rms(self) -> tuple[float, float]:
        """Return the rms errors of the estimate and of the reference."""
        n = max(float(np.sum(self.samples)), 1.0)
        return float(np.sqrt(np.sum(self.estimate) / n)), float(np.sqrt(np.sum(self.reference) / n))

    @property
    def ratio(self) -> tuple[float, float, float]:
        """Return the ratio of the rms errors and its 95 % interval, which is NaN for few blocks.  (1)"""
        return block_ratio(self.estimate, self.reference)


def merge(block_sums: Sequence[BlockSums]) -> BlockSums:
    """Return the blocks of several runs joined into one."""
    return BlockSums(*(np.concatenate(column) for column in zip(*block_sums, strict=True)))


class EstimatedPath(NamedTuple):
    """Pose and speed at the ticks, by an estimator or a reference."""

    eta: np.ndarray  # (N, 3)
    speed: np.ndarray  # (N,)


def block_errors(
    t_ns: np.ndarray, candidate: EstimatedPath, reference: EstimatedPath, truth: TruthLog
) -> dict[str, BlockSums]:
    """Return the squared errors of `candidate` and `reference` at the ticks `t_ns` (N,) against the truth, summed
    by block."""
    eta = interpolate_poses(t_ns, truth.t_ns, truth.eta)
    speed = true_speed(t_ns, truth)
    t_s = seconds(t_ns, t_ns[0])
    block_index = (t_s // BLOCK_S).astype(int)
    errors = {
        SPEED: _sums((candidate.speed - speed) ** 2, (reference.speed - speed) ** 2, block_index),
        WHOLE_RUN: _sums(
            _squared_distance(candidate.eta, eta),
            _squared_distance(reference.eta, eta),
            np.zeros(len(t_s), dtype=int),
        ),
    }
    for window_s, name in zip(WINDOWS_S, QUANTITIES[2:], strict=True):
        windows = _windows(t_s, window_s)
        a, b = (
            np.concatenate([_squared_distance(path.eta[k], eta[k]) for k in windows])
            for path in (candidate, reference)
        )
        errors[name] = _sums(a, b, np.repeat(np.arange(len(windows)), [len(k) for k in windows]))
    return errors


def _squared_distance(eta: np.ndarray, eta_true: np.ndarray) -> np.ndarray:
    """Return the squared distance (N,) [m²] from the truth, after alignment at the first true pose."""
    if not np.isfinite(eta_true).all(axis=1).any():
        return np.full(len(eta), np.nan)
    return absolute_pose_errors(align_trajectory(eta, eta_true, "start"), eta_true).position_m ** 2


def _windows(t_s: np.ndarray, window_s: float) -> list[np.ndarray]:
    """Return the rows of consecutive windows; a shorter run is one window."""
    count = max(1, int((t_s[-1] + 0.05 * window_s) / window_s))
    return [np.flatnonzero((t_s >= k * window_s) & (t_s < (k + 1) * window_s)) for k in range(count)]


def _sums(estimate: np.ndarray, reference: np.ndarray, block: np.ndarray) -> BlockSums:
    is_finite, block_count = np.isfinite(estimate) & np.isfinite(reference), int(block[-1]) + 1
    sums = [
        np.bincount(block[is_finite], x[is_finite], block_count)
        for x in (estimate, reference, np.ones(len(estimate)))
    ]
    has_samples = sums[2] > 0
    return BlockSums(*(x[has_samples] for x in sums))
