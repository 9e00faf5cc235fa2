"""The spread of residuals when a few of them are wrong.

    σ = 1.4826 median |r|                                                                                 (1)

of each channel, over the rows that have a measurement: half of them may be outliers. Rows in which nothing happens do
not count (`telling`): an encoder that stands says 0 without noise, as does the model, and much of it would make σ that
of nothing and every row of the drive an outlier. σ is never taken below
what the converter's steps and the numbers themselves allow, so that a run without noise can be fitted too.
A few measurements, a tape or a mark, show no spread (of FEW it is known to 1/√(2 · FEW) = 13 % at best): their
σ is that of the vehicle file.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.signals import ByName

MAD = 1.4826022185056018  # 1 / Φ⁻¹(3/4)
SMALLEST = 1e-7  # of the largest measurement of a channel
STILL = 1e-3  # of the largest measurement of a channel
FEW = 30  # measurements, below which the sensor's own σ is believed


def spread(residuals: Sequence[np.ndarray], has: Sequence[np.ndarray], floor: np.ndarray) -> np.ndarray:
    """σ (m,) of residuals (N, m) of several runs, in their own unit.  (1)"""
    m = residuals[0].shape[1]
    sigma = np.zeros(m)
    for c in range(m):
        x = np.concatenate([r[there[:, c] > 0.0, c] for r, there in zip(residuals, has, strict=True)])
        x = np.abs(x[np.isfinite(x)])
        sigma[c] = MAD * np.median(x) if len(x) else 0.0
    return np.maximum(sigma, floor)


def telling(
    residuals: Sequence[np.ndarray], has: Sequence[np.ndarray], z: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """`has` (N, m), 0 also where the measurement z is exactly 0 and the model says so to STILL of the largest; as it
    is for a channel that would be left with fewer than FEW rows."""
    largest = np.max(
        [np.max(np.abs(v * there), axis=0, initial=0.0) for v, there in zip(z, has, strict=True)], axis=0
    )
    out = [
        there * ~((v == 0.0) & (np.abs(r) <= STILL * largest))
        for r, there, v in zip(residuals, has, z, strict=True)
    ]
    enough = np.sum([there.sum(axis=0) for there in out], axis=0) >= FEW
    return [np.where(enough, moved, there) for moved, there in zip(out, has, strict=True)]


def smallest_spread(blocks: "ByName[Tree]", z: Sequence[np.ndarray], has: Sequence[np.ndarray]) -> np.ndarray:
    """(m,) below which no σ is believed: 1/√12 of a converter's step, and SMALLEST of the largest value."""
    steps = np.concatenate([_steps(block) for block in blocks])
    largest = np.max(
        [np.max(np.abs(v * there), axis=0, initial=0.0) for v, there in zip(z, has, strict=True)], axis=0
    )
    return np.maximum(steps / np.sqrt(12.0), np.maximum(SMALLEST * largest, 1e-12))


def believed(blocks: "ByName[Tree]", has: Sequence[np.ndarray]) -> np.ndarray:
    """(m,) σ of the sensors' own covariance for channels with FEW measurements or less; 0 for the others."""
    count = np.sum([there.sum(axis=0) for there in has], axis=0)
    own = [
        np.zeros(b.size) if (Q := optional.of(b, "cov")) is None else np.sqrt(np.maximum(np.diagonal(Q), 0.0))
        for b in blocks
    ]
    return np.where(count < FEW, np.concatenate(own), 0.0)


def _steps(block: Tree) -> np.ndarray:
    """(m,) steps of a sensor's converter, 0 where none is told."""
    if not has_field(block, "accel_step"):
        return np.zeros(block.size)
    return np.array([block.accel_step, block.accel_step, block.gyro_step])
