"""Select the rows that show the noise level of a channel, and bound σ by the sensor.

σ follows from rows with motion (`informative_rows`), because an encoder at rest reads 0 without noise. The least σ
follows from the converter's steps and from rounding. With fewer than MIN_MEASUREMENTS, σ is the value in the vehicle
file. numerics/noise_level.py estimates σ from the residuals of these rows.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.sensors.sampling import converter_steps
from baqueano.signals import ByName

MIN_RELATIVE_SIGMA = 1e-7  # fraction of the largest measurement of a channel
STILL_FRACTION = 1e-3  # fraction of the largest measurement of a channel
MIN_MEASUREMENTS = 30  # measurements, below which σ is the value in the file


def informative_rows(
    residuals: Sequence[np.ndarray], masks: Sequence[np.ndarray], z: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return the masks (N, m), with 0 if the measurement z is exactly 0 and the residual is within STILL_FRACTION of
    the largest measurement. A channel that would keep fewer than MIN_MEASUREMENTS rows is unchanged."""
    largest = _largest(z, masks)
    informative = [
        mask * ~((v == 0.0) & (np.abs(r) <= STILL_FRACTION * largest))
        for r, mask, v in zip(residuals, masks, z, strict=True)
    ]
    has_enough = np.sum([mask.sum(axis=0) for mask in informative], axis=0) >= MIN_MEASUREMENTS
    return [
        np.where(has_enough, is_informative, mask)
        for is_informative, mask in zip(informative, masks, strict=True)
    ]


def _largest(z: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Return the largest absolute measurement (m,) of each channel over all segments."""
    return np.max(
        [np.max(np.abs(v * mask), axis=0, initial=0.0) for v, mask in zip(z, masks, strict=True)], axis=0
    )


def min_sigma(blocks: "ByName[Tree]", z: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Return the least σ (m,): 1/√12 of a converter's step, or MIN_RELATIVE_SIGMA of the largest value, if larger."""
    steps = np.concatenate([converter_steps(block) for block in blocks])
    largest = _largest(z, masks)
    return np.maximum(steps / np.sqrt(12.0), np.maximum(MIN_RELATIVE_SIGMA * largest, 1e-12))


def rare_channel_sigma(blocks: "ByName[Tree]", masks: Sequence[np.ndarray]) -> np.ndarray:
    """Return σ (m,) from the covariance of the sensor blocks for channels with fewer than MIN_MEASUREMENTS, else 0."""
    count = np.sum([mask.sum(axis=0) for mask in masks], axis=0)
    return np.where(count < MIN_MEASUREMENTS, sensor_sigma(blocks), 0.0)


def sensor_sigma(blocks: "ByName[Tree]") -> np.ndarray:
    """Return σ (m,) from the covariance of the sensor blocks, 0 for a sensor without one."""
    covariances = [
        np.zeros((b.size, b.size)) if (Q := optional.attribute(b, "cov")) is None else Q for b in blocks
    ]
    return np.concatenate([np.sqrt(np.maximum(np.diagonal(Q), 0.0)) for Q in covariances])
