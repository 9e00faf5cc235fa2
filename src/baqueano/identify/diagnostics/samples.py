"""Find samples that are not measurements: not finite, held, stuck, logged as zero, or at an unknown end of range.

    P(equal) = q / (2 √π σ),   P(zero) = q / (√(2π) σ)     of white noise σ in steps of q, at most         (1)
    σ = 1.4826 median |z_{k+1} − 2 z_k + z_{k−1}| / √6     of the values that changed
    n(z = max) ≥ 5,   n(z = max) > 5 n(max − w ≤ z < max),   w = max(2 q, σ / 5),   on three visits        (2)
    median of z_{k−4} … z_{k+4} > max − 2 σ,   or three samples in a row at the end                       (3)

Samples that repeat the previous one, and exact zeros, are removed if they are `FACTOR` times more frequent than (1).
They stay if the signal moves by less than a step. For encoders, the values between two jumps decide
(runs/diagnostics/repeated_readings.py). Many equal values are their top speed, and a zero counts only between two
readings far from it. Many samples at one extreme (2) show a range that the file does not contain, as the tails of noise
contain few samples. The samples of (3) are then removed. (3) does not depend on the noise of the sample itself, so the
fit stays unbiased.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.residuals.noise_level import MAD
from baqueano.runs.diagnostics.repeated_readings import are_held, repeats
from baqueano.runs.run import Channel

FACTOR, FEW = 3.0, 5  # more samples than FACTOR times the expected number plus FEW are significant
ENOUGH = 20  # samples for a test
PILE, VISITS = 5, 3  # (2)
MUCH = 0.1  # part of the samples of a channel that may be lost without a warning
AROUND, IN_A_ROW = 9, 3  # samples, (3)
ROUNDING = 1e-12  # of the largest value: rounding difference between two ways to compute a reading
FAR = 10.0  # standard deviations between an isolated zero and its neighbours


class Grain(NamedTuple):
    """Noise and resolution of one channel."""

    sigma: float  # from second differences; 0 if too few values change
    step: float  # least difference of two values, without rounding


def check_samples(name: str, block: Tree, channel: Channel) -> tuple[Channel, list[Diagnostic]]:
    """Return the channel with NaN in place of invalid samples, and the findings."""
    z, messages = channel.z.copy(), []
    lost_count = int(np.sum(~np.isfinite(z)))
    if lost_count:
        messages.append(note("data.not-finite", subject=name, lost=lost_count))
    if len(z) < ENOUGH or optional.of(block, "cov") is None:
        return channel, messages
    imu, noise = has_field(block, "gyro_scale"), np.sqrt(np.maximum(np.diagonal(block.cov), 0.0))
    for i in range(z.shape[1]):
        bad, of_channel = _channel(f"{name}[{i}]", z[:, i], imu, float(noise[i]))
        z[bad, i] = np.nan
        messages += of_channel
    return channel._replace(z=z), _together(name, z.shape[1], messages)


def _channel(label: str, x: np.ndarray, imu: bool, noise: float) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask (M,) of invalid samples of one channel, and messages about them."""
    good, none = np.isfinite(x), np.zeros(len(x), bool)
    if good.sum() < ENOUGH:
        return none, []
    if np.ptp(x[good]) == 0.0:
        return (~none, [_dead(label, x[good])]) if noise > 0.0 else (none, [])
    sample_grain = grain(x[good])
    if sample_grain.sigma <= 0.0:
        return none, []
    end, messages = _limit_samples(label, x, sample_grain) if imu else (none, [])
    x = np.where(end, np.nan, x)
    zero, zero_message = _zeros(label, x, sample_grain, imu)
    same, more = _repeats(label, x, sample_grain, imu)
    return end | zero | same, messages + zero_message + more


def _together(name: str, m: int, messages: list[Diagnostic]) -> list[Diagnostic]:
    """Return the findings, merged to one if all m channels have the same finding."""
    out: list[Diagnostic] = []
    for message in messages:
        same = [o for o in messages if (o.code, o.figures) == (message.code, message.figures)]
        if m > 1 and len(same) == m:
            out += [replace(message, subject=name)] if message is same[0] else []
        else:
            out.append(message)
    return out


def grain(x: np.ndarray) -> Grain:
    """Return σ and q of finite values x (M,), both 0 if too few values change.  (1)"""
    fresh = x[np.concatenate([[True], np.diff(x) != 0.0])]
    levels = np.unique(x)
    if len(fresh) < ENOUGH or len(levels) < 3:
        return Grain(0.0, 0.0)
    gaps = np.diff(levels)
    gaps = gaps[gaps > ROUNDING * np.max(np.abs(levels))]
    if not len(gaps):
        return Grain(0.0, 0.0)
    step = float(np.quantile(gaps, 0.01))
    sigma = MAD * float(np.median(np.abs(np.diff(fresh, 2)))) / np.sqrt(6.0)
    return Grain(sigma, step)


def _dead(label: str, x: np.ndarray) -> Diagnostic:
    return note("data.dead-channel", Severity.WARNING, subject=label, value=float(x[0]), samples=len(x))


def _part(bad: np.ndarray, finite: np.ndarray) -> float:
    """Return the percentage of `bad` (M,) samples among the `finite` (M,) samples."""
    return 100.0 * float(bad.sum()) / max(1, int(finite.sum()))


def _zeros(label: str, x: np.ndarray, sample_grain: Grain, imu: bool) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask of lost frames that were logged as zero, and a message."""
    zero, none = x == 0.0, np.zeros(len(x), bool)
    chance = len(x) * sample_grain.step / (np.sqrt(2.0 * np.pi) * sample_grain.sigma)
    if zero.sum() <= FACTOR * chance + FEW:
        return none, []
    if not imu:
        nonzero = np.flatnonzero(np.isfinite(x) & ~zero)
        if len(nonzero) < 2:
            return none, []
        row = np.arange(len(x))
        after = np.searchsorted(nonzero, row)
        before, after = nonzero[np.maximum(after - 1, 0)], nonzero[np.minimum(after, len(nonzero) - 1)]
        zero &= (before < row) & (row < after)
        far = np.minimum(np.abs(x[before]), np.abs(x[after])) > FAR * sample_grain.sigma
        zero &= far & (x[before] * x[after] > 0.0) & (after - before <= FEW)
        if zero.sum() <= FEW:
            return none, []
    part = _part(zero, np.isfinite(x))
    return zero, [note("data.zeros", subject=label, lost=int(zero.sum()), percent=part)]


def _repeats(
    label: str, x: np.ndarray, sample_grain: Grain, imu: bool
) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask of samples that repeat the previous one (held or stuck), and a message."""
    same = np.concatenate([[False], x[1:] == x[:-1]])
    chance = len(x) * sample_grain.step / (2.0 * np.sqrt(np.pi) * sample_grain.sigma)
    if same.sum() <= FACTOR * chance + FEW if imu else not are_held(repeats(x).lasting):
        return np.zeros(len(x), bool), []
    edges = np.flatnonzero(~same)
    longest = int(np.max(np.diff(np.concatenate([edges, [len(x)]])))) - 1
    same &= imu | (x != 0.0)
    part = _part(same, np.isfinite(x))
    return same, [note("data.repeats", subject=label, lost=int(same.sum()), percent=part, longest=longest)]


def _limit_samples(label: str, x: np.ndarray, sample_grain: Grain) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return the mask of samples at the end of a range, and a message.  (2), (3)"""
    finite, bad, ends, count = np.isfinite(x), np.zeros(len(x), bool), [], 0
    if finite.sum() < ENOUGH or sample_grain.sigma < sample_grain.step:
        return bad, []  # too coarse: every level has many samples
    width = max(2.0 * sample_grain.step, 0.2 * sample_grain.sigma)
    for sign in (1.0, -1.0):
        y = np.where(finite, sign * x, -np.inf)
        most = float(np.max(y))
        at = y == most
        inner = int(np.sum((y < most) & (y >= most - width)))
        visits = int(np.sum(at[1:] & ~at[:-1])) + int(at[0])
        if visits >= VISITS and at.sum() >= PILE and at.sum() > PILE * inner:
            bad |= _beyond(y, at, most, sample_grain.sigma)
            ends.append(sign * most)
            count += int(at.sum())
    if not ends:
        return bad, []
    bad, part = bad & finite, _part(bad & finite, finite)
    grave = Severity.WARNING if part > 100.0 * MUCH else Severity.INFO
    ends_at = ", ".join(f"{end:.4g}" for end in ends)
    return bad, [
        note(
            "data.clipped",
            grave,
            subject=label,
            lost=int(bad.sum()),
            percent=part,
            ends=ends_at,
            at_end=count,
        )
    ]


def _beyond(y: np.ndarray, index: np.ndarray, most: float, sigma: float) -> np.ndarray:
    """Return the mask (M,) of samples whose signal, apart from noise, is at the end `most` of the range.  (3)"""
    extended = np.pad(y, AROUND // 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(extended, AROUND), axis=1)
    near = middle > most - 2.0 * sigma
    edges = np.flatnonzero(np.diff(np.concatenate([[0], index.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= IN_A_ROW:
            near[first:last] = True
    return near
