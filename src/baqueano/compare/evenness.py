"""Evenness of a drive: its forward speed compared with that of the reference, and its commands.

With ν_x the forward speed, ν_r that of the reference, e = ν_x − ν_r, all after the first `AFTER_S`:

    error        √ mean e²  /  mean |ν_r|                                                                (1)
    unevenness   √ mean (e − ē)²  /  mean |ν_r|,   ē the mean of e over 1 s, half of it before           (2)
    sign changes of the forward command per second, where |u_x| > dead band                              (3)
    at a limit   the share of ticks with |u_i| ≥ limit_i, or |w_k| ≥ limit of channel k,  w = mix(u)     (4)

(1) also grows with a wrong model: a dead zone wrong by 10 % gives 15 % of speed error. (2) excludes a steady error
and keeps a visible stutter. If the reference speed is steady, e − ē is the speed about its own 1 s mean. A stutter of
1.4 Hz, the worst case, counts 1.22 times in (2), one of 5 Hz or more as much as in (1).
Input: arrays; output: numbers. An unknown figure is NaN.
"""

import tomllib
from typing import NamedTuple

import numpy as np

from baqueano.compare.errors import rms
from baqueano.signals import NANOSECONDS, seconds
from baqueano.vehicles.drivetrain import MIXINGS, mix

AFTER_S = 1.0  # a vehicle that begins at rest needs this time to reach its speed
OVER_S = 1.0  # of the mean in (2)
DEAD_BAND = 0.01  # of the largest command of the drive: the sign of a smaller one does not count
AT_LIMIT = 1.0 - 1e-9  # of a limit: a command scaled down to it may differ by rounding


class Pace(NamedTuple):
    """The errors of the forward speed against that of the reference."""

    error_m_s: float  # rms
    error: float  # the same, divided by the mean reference speed  (1)
    uneven: float  # (2)


class Limits(NamedTuple):
    """The limits of the commands of a vehicle, and of the channels behind its mixing."""

    command: np.ndarray  # (n,) of each entry; inf: no limit; 0: the entry is not used
    mixing: str = "none"
    channel: np.ndarray = np.full(1, np.inf)  # (k,) of each channel behind the mix, or (1,) of all


UNKNOWN = Pace(float("nan"), float("nan"), float("nan"))


def pace(t_ns: np.ndarray, speed: np.ndarray, speed_ref: np.ndarray, after_s: float = AFTER_S) -> Pace:
    """Return (1) and (2) of a forward speed (N,) against the reference speed (N,) at the same times [m/s].

    The first `after_s` seconds are left out. NaN if the reference speed is always 0: that is not a drive along a route.
    """
    if not len(t_ns):
        return UNKNOWN
    e = speed - speed_ref
    late = seconds(t_ns, t_ns[0]) >= after_s
    finite = late & np.isfinite(e)
    if not np.any(speed_ref[finite]):
        return UNKNOWN
    scale = float(np.mean(np.abs(speed_ref[finite])))
    return Pace(rms(e[late]), rms(e[late]) / scale, rms(about_mean(t_ns, e)[late]) / scale)


def about_mean(t_ns: np.ndarray, x: np.ndarray, over_s: float = OVER_S) -> np.ndarray:
    """Return x (N,) minus its centred mean over `over_s`; NaN if the span reaches beyond either end."""
    half = round(0.5 * over_s * NANOSECONDS)
    first, last = np.searchsorted(t_ns, t_ns - half), np.searchsorted(t_ns, t_ns + half, side="right")
    finite = np.isfinite(x)
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, x, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    mean = (total[last] - total[first]) / np.maximum(count[last] - count[first], 1)
    whole = (t_ns - half >= t_ns[:1]) & (t_ns + half <= t_ns[-1:])
    return np.where(whole, x - mean, np.nan)


def sign_changes(t_ns: np.ndarray, forward: np.ndarray) -> float:
    """Return how often per second the forward command (N,) changes its sign.  (3)

    A command within ± `DEAD_BAND` of the largest command of the drive counts as zero, so a pause or noise around 0 is
    not a change. Forwards, 0, forwards is not a change either; forwards, 0, backwards is one.
    """
    finite = np.isfinite(forward)
    t_ns, forward = t_ns[finite], forward[finite]
    if len(t_ns) < 2:
        return float("nan")
    size = np.abs(forward)
    sign = np.sign(forward[size > DEAD_BAND * np.max(size)])
    return float(np.count_nonzero(np.diff(sign)) / seconds(t_ns[-1], t_ns[0]))


def at_limit(u: np.ndarray, limits: Limits) -> np.ndarray:
    """Return (N,): 1.0 if the command u (N, n) reaches a limit, 0.0 if not, NaN if u is not known.  (4)

    The two wheels are checked too: u_x and u_ψ may each be within their limits while a wheel reaches its own.
    """
    w = np.abs(mix(limits.mixing, u.T)).T
    full = np.any(_reaches(np.abs(u), limits.command), axis=1) | np.any(_reaches(w, limits.channel), axis=1)
    return np.where(np.all(np.isfinite(u), axis=1), full.astype(float), np.nan)


def share_at_limit(u: np.ndarray, limits: Limits | None) -> float:
    """Return the share of ticks at which a command u (N, n) reaches a limit; NaN without limits of its size.  (4)"""
    if limits is None or u.shape[1] != len(limits.command):
        return float("nan")
    full = at_limit(u, limits)
    finite = full[np.isfinite(full)]
    return float(np.mean(finite)) if finite.size else float("nan")


def limits_of(vehicle_text: str) -> Limits | None:
    """Return the limits from the text of a vehicle file; None if the text is empty or does not contain them.

    Only two tables are read and no block is built, so the comparison of a run does not execute code from its file.
    """
    try:
        data = tomllib.loads(vehicle_text)
        n = len(data["command"]["names"])
        drivetrain = data.get("model", {}).get("drivetrain", {})
        mixing = drivetrain.get("mixing", "none")
        command = np.broadcast_to(np.array(data["command"].get("limit", [np.inf]), dtype=float), (n,))
        k = 2 if mixing == "two_wheels" else n
        channel = np.broadcast_to(np.array(drivetrain.get("limit", [np.inf]), dtype=float), (k,))
    except (tomllib.TOMLDecodeError, RecursionError, KeyError, TypeError, ValueError, AttributeError):
        return None
    fits = mixing in MIXINGS and (mixing == "none" or n == 3)
    return Limits(command, mixing, channel) if fits else None


def _reaches(size: np.ndarray, limit: np.ndarray) -> np.ndarray:
    return (limit > 0.0) & (size >= AT_LIMIT * limit)
