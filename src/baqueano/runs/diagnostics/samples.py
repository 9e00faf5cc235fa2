"""Find samples that are not measurements: not finite, repeated, logged as zero, or at an unknown end of range.

    P(equal) = q / (2 √π σ),   P(zero) = q / (√(2π) σ)     of white noise σ in steps of q, at most         (1)
    σ = 1.4826 median |z_{k+1} − 2 z_k + z_{k−1}| / √6     of the values that changed
    n(z = max) ≥ 5,   n(z = max) > 5 n(max − w ≤ z < max),   w = max(2 q, σ / 5),   on three visits        (2)
    median of z_{k−4} … z_{k+4} > max − 2 σ,   or three samples in a row at the end                       (3)

Samples that repeat the previous one, and exact zeros, are removed if they are `CHANCE_FACTOR` times more frequent
than (1). They are kept if the signal changes by less than a step. For encoders, the test uses the values between two
jumps (runs/diagnostics/repeated_readings.py). Many equal values can be the top speed, and a zero is removed only
between two readings far from it. Many samples at one extreme (2) show a range that the file does not contain, as the
tails of noise contain few samples. The samples of (3) are then removed. (3) does not depend on the noise of the
sample itself, so the fit stays unbiased.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.numerics.statistics import white_std
from baqueano.runs.diagnostics.repeated_readings import find_repeats, is_read_too_fast
from baqueano.runs.run import Channel

# more samples than CHANCE_FACTOR times the expected number plus EXTRA_SAMPLES are significant
CHANCE_FACTOR, EXTRA_SAMPLES = 3.0, 5
MIN_SAMPLES = 20  # samples for a test
MIN_END_SAMPLES, MIN_VISITS = 5, 3  # (2)
MAX_LOST_FRACTION = 0.1  # part of the samples of a channel that can be lost without a warning
MEDIAN_SAMPLES, MIN_CONSECUTIVE = 9, 3  # samples, (3)
ROUNDING = 1e-12  # of the largest value: rounding difference between two ways to compute a reading
ISOLATED_ZERO_SIGMA = 10.0  # standard deviations between an isolated zero and its neighbours


class ChannelResolution(NamedTuple):
    """Noise and resolution of one channel."""

    sigma: float  # from second differences; 0 if too few values change
    step: float  # least difference of two values, without rounding


def check_samples(name: str, block: Tree, channel: Channel) -> tuple[Channel, list[Diagnostic]]:
    """Return the channel with NaN in place of invalid samples, and the findings."""
    z, messages = channel.z.copy(), []
    lost_count = int(np.sum(~np.isfinite(z)))
    if lost_count:
        messages.append(note("data.not-finite", subject=name, lost=lost_count))
    if len(z) < MIN_SAMPLES or optional.attribute(block, "cov") is None:
        return channel, messages
    is_imu, noise = has_field(block, "gyro_scale"), np.sqrt(np.maximum(np.diagonal(block.cov), 0.0))
    for i in range(z.shape[1]):
        is_invalid, channel_messages = _check_channel(f"{name}[{i}]", z[:, i], is_imu, float(noise[i]))
        z[is_invalid, i] = np.nan
        messages += channel_messages
    return channel._replace(z=z), _merge_messages(name, z.shape[1], messages)


def _check_channel(
    label: str, x: np.ndarray, is_imu: bool, noise: float
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of invalid samples of one channel, and messages about them."""
    is_finite, no_samples = np.isfinite(x), np.zeros(len(x), bool)
    if is_finite.sum() < MIN_SAMPLES:
        return no_samples, []
    if np.ptp(x[is_finite]) == 0.0:
        return (~no_samples, [_dead_channel(label, x[is_finite])]) if noise > 0.0 else (no_samples, [])
    resolution = channel_resolution(x[is_finite])
    if resolution.sigma <= 0.0:
        return no_samples, []
    is_at_end, messages = _limit_samples(label, x, resolution) if is_imu else (no_samples, [])
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
    is_zero, no_samples = x == 0.0, np.zeros(len(x), bool)
    chance = len(x) * resolution.step / (np.sqrt(2.0 * np.pi) * resolution.sigma)
    if is_zero.sum() <= CHANCE_FACTOR * chance + EXTRA_SAMPLES:
        return no_samples, []
    if not is_imu:
        nonzero = np.flatnonzero(np.isfinite(x) & ~is_zero)
        if len(nonzero) < 2:
            return no_samples, []
        row, last = np.arange(len(x)), len(nonzero) - 1
        k = np.searchsorted(nonzero, row)
        before, after = nonzero[np.maximum(k - 1, 0)], nonzero[np.minimum(k, last)]
        is_zero &= (before < row) & (row < after) & (after - before <= EXTRA_SAMPLES)
        magnitude = np.minimum(np.abs(x[before]), np.abs(x[after]))
        is_zero &= (magnitude > ISOLATED_ZERO_SIGMA * resolution.sigma) & (x[before] * x[after] > 0.0)
        if is_zero.sum() <= EXTRA_SAMPLES:
            return no_samples, []
    percent = _percentage(is_zero, np.isfinite(x))
    return is_zero, [note("data.zeros", subject=label, lost=int(is_zero.sum()), percent=percent)]


def _repeated_samples(
    label: str, x: np.ndarray, resolution: ChannelResolution, is_imu: bool
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of samples that repeat the previous one, and a list with at most one message."""
    is_repeated = np.concatenate([[False], x[1:] == x[:-1]])
    chance = len(x) * resolution.step / (2.0 * np.sqrt(np.pi) * resolution.sigma)
    is_by_chance = is_repeated.sum() <= CHANCE_FACTOR * chance + EXTRA_SAMPLES
    if is_by_chance if is_imu else not is_read_too_fast(find_repeats(x).hold_counts):
        return np.zeros(len(x), bool), []
    edges = np.flatnonzero(~is_repeated)
    longest = int(np.max(np.diff(np.concatenate([edges, [len(x)]])))) - 1
    is_repeated &= is_imu | (x != 0.0)
    percent, lost = _percentage(is_repeated, np.isfinite(x)), int(is_repeated.sum())
    return is_repeated, [note("data.repeats", subject=label, lost=lost, percent=percent, longest=longest)]


def _limit_samples(
    label: str, x: np.ndarray, resolution: ChannelResolution
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of samples at the end of a range, and a list with at most one message.  (2), (3)"""
    finite, is_invalid, ends, end_count = np.isfinite(x), np.zeros(len(x), bool), [], 0
    if finite.sum() < MIN_SAMPLES or resolution.sigma < resolution.step:
        return is_invalid, []  # too coarse: every level has many samples
    width = max(2.0 * resolution.step, 0.2 * resolution.sigma)
    for sign in (1.0, -1.0):
        y = np.where(finite, sign * x, -np.inf)
        maximum = float(np.max(y))
        is_maximum = y == maximum
        inner_count = int(np.sum((y < maximum) & (y >= maximum - width)))
        visit_count = int(np.sum(is_maximum[1:] & ~is_maximum[:-1])) + int(is_maximum[0])
        count = int(is_maximum.sum())
        is_often = count >= MIN_END_SAMPLES and count > MIN_END_SAMPLES * inner_count
        if visit_count >= MIN_VISITS and is_often:  # (2)
            is_invalid |= _is_beyond_end(y, is_maximum, maximum, resolution.sigma)
            ends.append(sign * maximum)
            end_count += count
    if not ends:
        return is_invalid, []
    is_invalid, percent = is_invalid & finite, _percentage(is_invalid & finite, finite)
    severity = Severity.WARNING if percent > 100.0 * MAX_LOST_FRACTION else Severity.INFO
    details = {
        "lost": int(is_invalid.sum()),
        "ends": map(float, ends),
        "at_end": end_count,
    }
    return is_invalid, [note("data.clipped", severity, subject=label, percent=percent, **details)]


def _is_beyond_end(y: np.ndarray, index: np.ndarray, end: float, sigma: float) -> np.ndarray:
    """Return the mask (M,) of samples whose signal, apart from noise, is at the end `end` of the range.  (3)"""
    padded_signal = np.pad(y, MEDIAN_SAMPLES // 2, mode="edge")
    median = np.median(np.lib.stride_tricks.sliding_window_view(padded_signal, MEDIAN_SAMPLES), axis=1)
    is_beyond = median > end - 2.0 * sigma
    edges = np.flatnonzero(np.diff(np.concatenate([[0], index.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= MIN_CONSECUTIVE:
            is_beyond[first:last] = True
    return is_beyond
