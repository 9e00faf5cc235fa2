"""What the data show, found in the information matrix.

    C_ij = A_ij / √(A_ii A_jj)                   information in units of each parameter's own effect      (1)
    s_i  = √((E_c − 30) / A_ii^c)                the change of θ_i that is as large as a signal itself    (2)

A_ii^c is the information of channel c on θ_i, c the channel that has most of it, and E_c the energy of what
the model says there, both in standard deviations of the noise; 30 is what a fit to noise alone may have. A
direction v with C v ≈ 0 moves parameters without moving any measurement: only the others are told, and one
of the direction's parameters is held where it was, by preference one that scale or tape can measure, and of two starts
that the data cannot tell apart the one that they show less. A
parameter of the vehicle whose standard error exceeds `BLIND` s_i is held too: nothing that was measured
depends on it. So is one with an error of half the span of its bounds, and a scale that would be known no better
than by its data sheet, `TOLERANCE`. One with an error above `WEAK_VALUE` of its own value and `WEAK_SIGNAL` of (2)
is kept and called weak.
Which others it could be mistaken for is told by the direction v_j of C that has most of its variance,
Σ_j v_ij²/λ_j: parameters with `LOADING` of its largest entry or more. In words: identifiability/advice.py.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify.covariance.information import Information, covariance_of
from baqueano.identify.parameters.free import Free

SINGULAR = 1e-9  # eigenvalue of C below which a direction is not seen
BLIND = 0.5
NOISE_ENERGY = 30.0  # that a model without any motion may take from the noise, 5 σ of one number
TOLERANCE = 0.03 / 3.0**0.5  # σ of a scale that a data sheet tells to ± 3 %, as that of an MPU-6050
WEAK_VALUE = 0.3
WEAK_SIGNAL = 0.02
TOUCHED = 0.01  # the same, of one that ends the confusion where it is measured
LOADING = 0.3  # part of the largest entry of a direction, above which a parameter belongs to it


class Seen(NamedTuple):
    """What can be told, and what cannot."""

    kept: np.ndarray  # (p,) bool: entries of θ that were told
    weak: np.ndarray  # (p,) bool: told, but hardly
    tied: dict[int, tuple[int, ...]]  # a held entry → the entries that it cannot be told from
    near: dict[int, tuple[int, ...]] = {}  # noqa: RUF012  a weak or held entry → those it is hardly told from


def seen(
    info: Information,
    energy: np.ndarray,
    theta: np.ndarray,
    told: Sequence[Free],
    held: np.ndarray,
    span: np.ndarray | None = None,
) -> Seen:
    """Which entries of θ (p,) the data show, of which those `told` are parameters of the vehicle, first; `held` (p,)
    bool are out of the question already, `span` (p,) is how far apart their bounds are."""
    by_hand = [k < len(told) and told[k].of.measured_by != "" for k in range(len(theta))]
    kept, tied, near = ~held & (np.diagonal(info.bread) > 0.0), {}, {}
    signal = _signal_scale(info.channels, energy)
    while kept.any():
        direction = _unseen_direction(info.bread, kept)
        if direction is None:
            break
        part = np.abs(direction) / np.max(np.abs(direction))
        inside = np.flatnonzero(part >= LOADING).tolist()
        touched, known = np.flatnonzero(part >= TOUCHED), np.diagonal(info.bread)
        rank = [(by_hand[i], round(part[i], 1), -known[i] if i >= len(told) else 0.0) for i in touched]
        out = int(touched[max(range(len(touched)), key=rank.__getitem__)])
        tied[out] = tuple(i for i in inside if i != out)
        kept[out] = False
    of_vehicle = np.arange(len(theta)) < len(told)
    signal = signal if span is None else np.minimum(signal, span)
    scales = np.array([k < len(told) and told[k].of.role == "scale" for k in range(len(theta))])
    signal = np.where(scales, np.minimum(signal, TOLERANCE / BLIND), signal)
    weak = np.zeros(len(theta), bool)
    while kept.any():
        index = np.flatnonzero(kept)
        sd = np.sqrt(np.diagonal(covariance_of(info, index)))
        excess = np.where(of_vehicle[index], sd - BLIND * signal[index], -1.0)
        if not np.any(excess > 0.0):
            large = (sd > WEAK_VALUE * np.abs(theta[index])) & (sd > WEAK_SIGNAL * signal[index])
            weak[index] = large & of_vehicle[index]
            near |= {int(k): _like(info.bread, kept & of_vehicle, int(k)) for k in np.flatnonzero(weak)}
            break
        relative = sd / np.maximum(signal[index], 1e-9 * sd)
        out = int(index[np.argmax(np.where(excess > 0.0, relative, -1.0))])
        near[out] = _like(info.bread, kept & of_vehicle, out)
        kept[out] = False
    return Seen(kept, weak, tied, near)


def _like(A: np.ndarray, kept: np.ndarray, k: int) -> tuple[int, ...]:
    """The other entries of the direction in which most of the variance of entry k lies."""
    index = np.flatnonzero(kept)
    root = 1.0 / np.sqrt(np.diagonal(A)[index])
    values, vectors = np.linalg.eigh(A[np.ix_(index, index)] * np.outer(root, root))
    row = vectors[int(np.searchsorted(index, k))]
    v = np.abs(vectors[:, np.argmax(row**2 / np.maximum(values, 1e-12 * values[-1]))])
    return tuple(int(i) for i in index[v >= LOADING * v.max()] if i != k)


def _unseen_direction(A: np.ndarray, kept: np.ndarray) -> np.ndarray | None:
    """v (p,) with C v ≈ 0 among the entries `kept`, or None.  (1)"""
    index = np.flatnonzero(kept)
    root = 1.0 / np.sqrt(np.diagonal(A)[index])
    values, vectors = np.linalg.eigh(A[np.ix_(index, index)] * np.outer(root, root))
    if values[0] > SINGULAR * values[-1]:
        return None
    v = np.zeros(len(A))
    v[index] = vectors[:, 0]
    return v


def _signal_scale(channels: np.ndarray, energy: np.ndarray) -> np.ndarray:
    """s (p,).  (2)"""
    most = np.argmax(channels, axis=0)
    info = channels[most, np.arange(channels.shape[1])]
    return np.sqrt(np.maximum(energy[most] - NOISE_ENERGY, 0.0) / np.maximum(info, 1e-300))
