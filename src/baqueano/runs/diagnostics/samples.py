"""Find samples that are not measurements: not finite, repeated, logged as zero, or at an unknown end of range.

    P(equal) = q / (2 √π σ),   P(zero) = q / (√(2π) σ)     of white noise σ in steps of q, at most         (1)
    σ = 1.4826 median |z_{k+1} − 2 z_k + z_{k−1}| / √6     of the values that changed
    n(z = max) ≥ 5,   > 5 n(max − w ≤ z < max),   w = max(2 q, σ / 5),   |max| > ½ max |z|,   3 visits;    (2)
    or max ≥ a known limit;   or n(z = max) ≥ 2, and max is a full scale of chips in use, within 0.15 %
    median of z_{k−4} … z_{k+4} > max − 2 σ,   or three samples in a row at the end                       (3)

Samples that repeat the previous one, and exact zeros, are removed if they are `CHANCE_FACTOR` times more frequent
than (1). They are kept if the signal changes by less than a step. For encoders, the test uses the values between two
jumps (repeated_readings.py). Many equal values can be the top speed, and a zero is removed only between two readings
far from it. The tails of noise contain few samples, so many samples at one extreme (2) show the end of a range. The
samples of (3) are then removed, because (3) does not depend on the noise of a sample.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import INF
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.numerics.statistics import white_std
from baqueano.runs.diagnostics.repeated_readings import find_repeats, is_read_too_fast
from baqueano.runs.run import Channel
from baqueano.sensors.sampling import sensor_range
from baqueano.signals import STANDARD_GRAVITY

# more samples than CHANCE_FACTOR times the expected number plus EXTRA_SAMPLES are significant
CHANCE_FACTOR, EXTRA_SAMPLES = 3.0, 5
MIN_SAMPLES = 20  # samples for a test
MIN_END_SAMPLES, MIN_VISITS = 5, 3  # (2)
MIN_END_RATIO = 0.5  # of the largest magnitude
MAX_LOST_FRACTION = 0.1  # part of the samples of a channel that can be lost without a warning
MEDIAN_SAMPLES, MIN_SPIKE_TICKS = 9, 3  # samples, (3)
ROUNDING = 1e-12  # of the largest value: rounding difference between two ways to compute a reading
ISOLATED_ZERO_SIGMA = 10.0  # standard deviations between an isolated zero and its neighbours
FULL_SCALE_TOLERANCE = 1.5e-3  # 32767 of 32768 words, and rounded sensitivities such as 131 words per deg/s
# of small IMUs, in SI; the second row is that of 35 mdps per word and its multiples
FULL_SCALES = {
    "acceleration": STANDARD_GRAVITY * np.array([2.0, 4.0, 8.0, 16.0]),
    "angular rate": np.radians(np.outer([1.0, 1.14685], [125.0, 250.0, 500.0, 1000.0, 2000.0]).ravel()),
}


class ChannelResolution(NamedTuple):
    """Noise and resolution of one channel."""

    sigma: float  # from second differences; 0 if too few values change
    step: float  # least difference of two values, without rounding


class EndSamples(NamedTuple):
    """The samples of one channel at the end of its range."""

    mask: np.ndarray  # (M,)
    ends: list[float]  # the largest and the least reading, if they are ends
    at_end: int  # samples that are equal to an end

    @property
    def lost(self) -> int:
        """Return the number of samples of the mask."""
        return int(self.mask.sum())


def check_samples(name: str, block: Tree, channel: Channel) -> tuple[Channel, list[Diagnostic]]:
    """Return the channel with NaN instead of invalid samples, and the findings."""
    z, messages = channel.z.copy(), []
    lost_count = int(np.sum(~np.isfinite(z)))
    if lost_count:
        messages.append(note("data.not-finite", subject=name, count=lost_count))
    if len(z) < MIN_SAMPLES or optional.attribute(block, "cov") is None:
        return channel, messages
    limits, noise = sensor_range(block), np.sqrt(np.maximum(np.diagonal(block.cov), 0.0))
    for i in range(z.shape[1]):
        limit = None if limits is None else float(limits[i])
        is_invalid, channel_messages = _check_channel(f"{name}[{i}]", z[:, i], limit, float(noise[i]))
        z[is_invalid, i] = np.nan
        messages += channel_messages
    return channel._replace(z=z), _merge_messages(name, z.shape[1], messages)


def _check_channel(
    label: str, x: np.ndarray, limit: float | None, noise: float
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of invalid samples of one channel, and messages about them. `limit` is the full scale of an
    IMU, and None for other sensors."""
    is_finite, zero_mask, is_imu = np.isfinite(x), np.zeros(len(x), bool), limit is not None
    if is_finite.sum() < MIN_SAMPLES:
        return zero_mask, []
    if np.ptp(x[is_finite]) == 0.0:
        return (~zero_mask, [_dead_channel(label, x[is_finite])]) if noise > 0.0 else (zero_mask, [])
    resolution = channel_resolution(x[is_finite])
    if resolution.sigma <= 0.0:
        return zero_mask, []
    is_at_end, messages = (zero_mask, []) if limit is None else _limit_samples(label, x, resolution, limit)
    x = np.where(is_at_end, np.nan, x)
    is_zero, zero_message = _lost_frames(label, x, resolution, is_imu)
    is_repeated, repeat_messages = _repeated_samples(label, x, resolution, is_imu)
    return is_at_end | is_zero | is_repeated, messages + zero_message + repeat_messages


def _merge_messages(name: str, m: int, messages: list[Diagnostic]) -> list[Diagnostic]:
    """Return the findings, merged to one if all m channels have the same finding."""
    merged_messages: list[Diagnostic] = []
    for message in messages:
        equal_messages = [o for o in messages if (o.code, o.figures) == (message.code, message.figures)]
        if m > 1 and len(equal_messages) == m:
            merged_messages += [replace(message, subject=name)] if message is equal_messages[0] else []
        else:
            merged_messages.append(message)
    return merged_messages


def channel_resolution(x: np.ndarray) -> ChannelResolution:
    """Return σ and q of finite values x (M,); both are 0 if too few values change.  (1)"""
    new_values = x[np.concatenate([[True], np.diff(x) != 0.0])]
    levels = np.unique(x)
    if len(new_values) < MIN_SAMPLES or len(levels) < 3:
        return ChannelResolution(0.0, 0.0)
    gaps = np.diff(levels)
    gaps = gaps[gaps > ROUNDING * np.max(np.abs(levels))]
    if not len(gaps):
        return ChannelResolution(0.0, 0.0)
    step = float(np.quantile(gaps, 0.01))
    return ChannelResolution(white_std([new_values]), step)


def _dead_channel(label: str, x: np.ndarray) -> Diagnostic:
    return note("data.dead-channel", Severity.WARNING, subject=label, value=float(x[0]), samples=len(x))


def _percentage(is_invalid: np.ndarray, is_finite: np.ndarray) -> float:
    """Return the percentage of `is_invalid` (M,) samples among the `is_finite` (M,) samples."""
    return 100.0 * float(is_invalid.sum()) / max(1, int(is_finite.sum()))


def _lost_frames(
    label: str, x: np.ndarray, resolution: ChannelResolution, is_imu: bool
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of lost frames that were logged as zero, and a list with at most one message."""
    is_zero, zero_mask = x == 0.0, np.zeros(len(x), bool)
    chance = len(x) * resolution.step / (np.sqrt(2.0 * np.pi) * resolution.sigma)
    if is_zero.sum() <= CHANCE_FACTOR * chance + EXTRA_SAMPLES:
        return zero_mask, []
    if not is_imu:
        nonzero = np.flatnonzero(np.isfinite(x) & ~is_zero)
        if len(nonzero) < 2:
            return zero_mask, []
        row, last = np.arange(len(x)), len(nonzero) - 1
        k = np.searchsorted(nonzero, row)
        previous_rows, next_rows = nonzero[np.maximum(k - 1, 0)], nonzero[np.minimum(k, last)]
        is_zero &= (previous_rows < row) & (row < next_rows) & (next_rows - previous_rows <= EXTRA_SAMPLES)
        magnitude = np.minimum(np.abs(x[previous_rows]), np.abs(x[next_rows]))
        is_zero &= (magnitude > ISOLATED_ZERO_SIGMA * resolution.sigma) & (
            x[previous_rows] * x[next_rows] > 0.0
        )
        if is_zero.sum() <= EXTRA_SAMPLES:
            return zero_mask, []
    percent = _percentage(is_zero, np.isfinite(x))
    return is_zero, [note("data.zeros", subject=label, count=int(is_zero.sum()), percent=percent)]


def _repeated_samples(
    label: str, x: np.ndarray, resolution: ChannelResolution, is_imu: bool
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of samples that repeat the previous one, and a list with at most one message."""
    is_repeated = np.concatenate([[False], x[1:] == x[:-1]])
    chance = len(x) * resolution.step / (2.0 * np.sqrt(np.pi) * resolution.sigma)
    is_chance = is_repeated.sum() <= CHANCE_FACTOR * chance + EXTRA_SAMPLES
    if is_chance if is_imu else not is_read_too_fast(find_repeats(x).hold_counts):
        return np.zeros(len(x), bool), []
    edges = np.flatnonzero(~is_repeated)
    longest_hold = int(np.max(np.diff(np.concatenate([edges, [len(x)]])))) - 1
    is_repeated &= is_imu | (x != 0.0)
    percent, repeat_count = _percentage(is_repeated, np.isfinite(x)), int(is_repeated.sum())
    return is_repeated, [
        note("data.repeats", subject=label, count=repeat_count, percent=percent, longest=longest_hold)
    ]


def end_samples(
    x: np.ndarray, resolution: ChannelResolution, limit: float = INF, full_scales: Collection[float] = ()
) -> EndSamples:
    """Return the samples of x (M,) at the end of a range. `limit` is a known end on both sides, and `full_scales` are
    the ranges of chips in use.  (2), (3)"""
    finite, is_invalid, ends, at_end = np.isfinite(x), np.zeros(len(x), bool), [], 0
    is_fine = 0.0 < resolution.step <= resolution.sigma  # otherwise every level has many samples
    width = max(2.0 * resolution.step, 0.2 * resolution.sigma)
    magnitude = float(np.max(np.abs(x[finite]), initial=0.0))
    for sign in (1.0, -1.0):
        y = np.where(finite, sign * x, -np.inf)
        max_value = float(np.max(y))
        end = min(max_value, limit)
        is_end = y >= end
        count, visits = int(is_end.sum()), int(np.sum(is_end[1:] & ~is_end[:-1])) + int(is_end[0])
        inner_count = int(np.sum((y < end) & (y >= end - width)))
        is_often = count >= MIN_END_SAMPLES and count > MIN_END_SAMPLES * inner_count and visits >= MIN_VISITS
        is_often &= abs(end) > MIN_END_RATIO * magnitude  # a range has two sides: 0 is not its end
        is_full_scale = count > 1 and any(abs(end / f - 1.0) < FULL_SCALE_TOLERANCE for f in full_scales)
        if end >= limit or (is_fine and (is_often or is_full_scale)):
            is_invalid |= _is_beyond_end(y, is_end, end, resolution.sigma)
            is_invalid |= is_end & (end >= limit)
            ends.append(sign * max_value)
            at_end += count
    return EndSamples(is_invalid & finite, ends, at_end)


def _limit_samples(
    label: str, x: np.ndarray, resolution: ChannelResolution, limit: float
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of samples at the end of a range, and a list with at most one message."""
    kind = "angular rate" if label.endswith("[2]") else "acceleration"
    at_end = end_samples(x, resolution, limit, FULL_SCALES[kind])
    if not at_end.lost:
        return at_end.mask, []
    percent = _percentage(at_end.mask, np.isfinite(x))
    severity = Severity.WARNING if percent > 100.0 * MAX_LOST_FRACTION else Severity.INFO
    details = {"count": at_end.lost, "ends": at_end.ends, "full_scale_count": at_end.at_end}
    return at_end.mask, [note("data.clipped", severity, subject=label, percent=percent, **details)]


def _is_beyond_end(y: np.ndarray, index: np.ndarray, end: float, sigma: float) -> np.ndarray:
    """Return the mask (M,) of samples whose signal, apart from noise, is at the end `end` of the range.  (3)"""
    padded_signal = np.pad(y, MEDIAN_SAMPLES // 2, mode="edge")
    median = np.median(np.lib.stride_tricks.sliding_window_view(padded_signal, MEDIAN_SAMPLES), axis=1)
    is_outside = median > end - 2.0 * sigma
    edges = np.flatnonzero(np.diff(np.concatenate([[0], index.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= MIN_SPIKE_TICKS:
            is_outside[first:last] = True
    return is_outside
