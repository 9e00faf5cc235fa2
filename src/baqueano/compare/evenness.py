"""Measure the evenness of a drive, by its commands and by its forward speed against the reference speed.

ν_x is the forward speed, ν_r the reference speed, e = ν_x − ν_r, from `START_S` until the reference brakes to its end:

    error        √ mean e²  /  mean |ν_r|                                                                (1)
    unevenness   √ mean (e − ē)²  /  mean |ν_r|,   ē the mean of e over 1 s, half of it before           (2)
    sign changes of the forward command per second, where |u_x| > dead band                              (3)
    at a limit   the share of ticks with |u_i| ≥ limit_i, or |w_k| ≥ limit of channel k,  w = mix(u)     (4)

(1) also grows with a wrong model: a dead zone that is wrong by 10 % causes 15 % of speed error. (2) excludes a constant
error and keeps the fluctuations. If the reference speed is constant, e − ē is the speed minus its 1 s mean. Compared
with (1), (2) weights a fluctuation of 1.4 Hz, the worst case, with 1.22, and one of 5 Hz or more with 1. An unknown
value is NaN.
"""

import tomllib
from typing import NamedTuple

import numpy as np

from baqueano.compare.errors import rms
from baqueano.runs.logs import ReferenceLog
from baqueano.signals import NANOSECONDS, seconds
from baqueano.vehicles.drivetrain import MIXINGS, mix

START_S = 1.0  # a vehicle that begins at rest needs this time to reach its speed
MEAN_WINDOW_S = 1.0  # length of the mean in (2)
DEAD_BAND = 0.01  # fraction of the largest command of the drive: the sign of a smaller command is ignored
REST_SHARE = 0.1  # fraction of the largest reference speed: a slower reference starts, or has braked to rest
LIMIT_SHARE = 1.0 - 1e-9  # share of a limit: a command scaled down to it can differ from it by rounding


class SpeedErrors(NamedTuple):
    """The errors of the forward speed against the reference speed."""

    error_m_s: float  # rms
    error: float  # the same, divided by the mean reference speed  (1)
    unevenness: float  # (2)


class Limits(NamedTuple):
    """The limits of the commands of a vehicle, and of the channels after its mixing."""

    command: np.ndarray  # (n,) of each entry; inf: no limit; 0: the entry is not used
    mixing: str = "none"
    channel: np.ndarray = np.full(1, np.inf)  # (k,) of each channel behind the mix, or (1,) of all


UNKNOWN_SPEED_ERRORS = SpeedErrors(float("nan"), float("nan"), float("nan"))


def speed_errors(
    t_ns: np.ndarray, speed: np.ndarray, speed_ref: np.ndarray, after_s: float = START_S
) -> SpeedErrors:
    """Return (1) and (2) of a forward speed (N,) against the reference speed (N,) at the same times [m/s].

    The first `after_s` seconds and the braking at the end are ignored. The result is NaN if the reference speed is
    always 0, because the vehicle then does not drive along a route.
    """
    if not len(t_ns):
        return UNKNOWN_SPEED_ERRORS
    e = speed - speed_ref
    is_counted = is_driving(t_ns, speed_ref, after_s)
    is_known = is_counted & np.isfinite(e)
    if not np.any(speed_ref[is_known]):
        return UNKNOWN_SPEED_ERRORS
    scale = float(np.mean(np.abs(speed_ref[is_known])))
    error, fluctuation = rms(e[is_counted]), rms(without_moving_mean(t_ns, e)[is_counted])
    return SpeedErrors(error, error / scale, fluctuation / scale)


def is_driving(t_ns: np.ndarray, speed_ref: np.ndarray, after_s: float = START_S) -> np.ndarray:
    """Return True (N,) from `after_s` on, while the reference speed (N,) is not that of a start or of the last braking.

    The start ends at REST_SHARE of the largest speed. The braking begins where the speed falls to rest at its end.
    """
    magnitude = np.abs(speed_ref)
    has_braked = len(magnitude) > 0 and magnitude[-1] < REST_SHARE * np.max(magnitude)
    not_falling = np.flatnonzero(np.diff(magnitude) >= 0.0)
    last = (not_falling[-1] + 1 if not_falling.size else 0) if has_braked else len(magnitude)
    has_started = np.maximum.accumulate(magnitude) >= REST_SHARE * np.max(magnitude, initial=0.0)
    return (seconds(t_ns, t_ns[:1]) >= after_s) & has_started & (np.arange(len(magnitude)) <= last)


def active_mask(t_ns: np.ndarray, ref: ReferenceLog) -> np.ndarray:
    """Return a mask (N,): True until the guide finished, or until the last reference if it did not finish."""
    done_ns = ref.t_ns[ref.at_end > 0.0]
    return t_ns <= (done_ns[0] if done_ns.size else ref.t_ns[-1])


def without_moving_mean(t_ns: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return x (N,) minus its centred mean over MEAN_WINDOW_S; NaN if this span is not completely inside the data."""
    half_ns = round(0.5 * MEAN_WINDOW_S * NANOSECONDS)
    first, last = np.searchsorted(t_ns, t_ns - half_ns), np.searchsorted(t_ns, t_ns + half_ns, side="right")
    is_finite = np.isfinite(x)
    total = np.concatenate([[0.0], np.cumsum(np.where(is_finite, x, 0.0))])
    count = np.concatenate([[0], np.cumsum(is_finite)])
    mean = (total[last] - total[first]) / np.maximum(count[last] - count[first], 1)
    is_inside = (t_ns - half_ns >= t_ns[:1]) & (t_ns + half_ns <= t_ns[-1:])
    return np.where(is_inside, x - mean, np.nan)


def sign_changes(t_ns: np.ndarray, forward: np.ndarray) -> float:
    """Return the sign changes per second of the forward command (N,); NaN for fewer than two known commands.  (3)

    A command of at most `DEAD_BAND` times the largest command of the drive counts as zero. So a pause or noise around 0
    is not a change. Forward, 0, forward is not a change, but forward, 0, backward is a change.
    """
    is_finite = np.isfinite(forward)
    t_ns, forward = t_ns[is_finite], forward[is_finite]
    if len(t_ns) < 2:
        return float("nan")
    magnitude = np.abs(forward)
    sign = np.sign(forward[magnitude > DEAD_BAND * np.max(magnitude)])
    return float(np.count_nonzero(np.diff(sign)) / seconds(t_ns[-1], t_ns[0]))


def at_limit(u: np.ndarray, limits: Limits) -> np.ndarray:
    """Return 1.0 for each command of u (N, n) that reaches a limit, 0.0 for others, NaN for an unknown one: (N,).  (4)
    The two wheels are checked too, because a wheel can reach its limit while u_x and u_ψ are within their limits.
    """
    w = np.abs(mix(limits.mixing, u.T)).T
    reaches_limit = _reaches_limit(np.abs(u), limits.command), _reaches_limit(w, limits.channel)
    is_at_limit = np.any(np.concatenate(reaches_limit, axis=1), axis=1)
    return np.where(np.all(np.isfinite(u), axis=1), is_at_limit.astype(float), np.nan)


def share_at_limit(u: np.ndarray, limits: Limits | None) -> float:
    """Return the share of ticks at which a command u (N, n) reaches a limit; NaN without limits for n entries.  (4)"""
    if limits is None or u.shape[1] != len(limits.command):
        return float("nan")
    limit_values = at_limit(u, limits)
    finite_values = limit_values[np.isfinite(limit_values)]
    return float(np.mean(finite_values)) if finite_values.size else float("nan")


def read_limits(vehicle_text: str) -> Limits | None:
    """Return the limits from the text of a vehicle file; None if the text does not contain limits.
    Only two tables are read and blocks are not built, so the comparison of a run does not execute code from its file.
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
    is_consistent = mixing in MIXINGS and (mixing == "none" or n == 3)
    return Limits(command, mixing, channel) if is_consistent else None


def _reaches_limit(magnitude: np.ndarray, limit: np.ndarray) -> np.ndarray:
    return (limit > 0.0) & (magnitude >= LIMIT_SHARE * limit)
